"""Which engine for how many states: seconds and memory of one search whose states double with every level.

    python benchmarks/crossover.py [--depths 10,13,17,20] [--engines 'native;database;duckdb'] [--memory 2GB]
        [--seconds 900]

Each run has a process of its own. The states are texts of a and b; the last of them is the goal. `duckdb` and `spark`
make the steps in SQL; `duckdb, Python` and `spark, Python` are given a step that is more than one expression. An engine
that has failed or taken too long is given no more states. Spark has one core and has been started by then; all of
its processes count. Prints a table for Markdown.
"""

from __future__ import annotations

import argparse
import atexit
import shutil
import tempfile
import time
from typing import Any

from apart import run_apart, tell
from family import peak, processor
from local_spark import local_spark

SCRIPT = """
    SELECT {step} FROM b = ["a", "b"] WHERE {step} == goal START WITH t = ""
    CONNECT BY UNIQUE t = {step} STOP WITH len(t) >= {last} AS list
"""


def longer(text: str, letter: str) -> str:
    """The step for engines that are to ask Python; a loop is no expression."""
    for one in letter:
        text += one
    return text


def measure(engine: str, depth: int, memory: str) -> None:
    """Runs one search and prints what it took."""
    import ss2sql

    name, _, python = engine.partition(",")
    session = _SESSIONS[name](memory) if name in _SESSIONS else None
    with ss2sql.connect(engine=name, session=session) as ss:  # type: ignore[arg-type]
        ss.function("longer", longer, volatility="immutable")
        ss.set("goal", "b" * depth)
        step = "longer(t, b.this)" if python else "t + b.this"
        begin, busy = time.perf_counter(), processor()
        result = ss.run(SCRIPT.format(step=step, last=depth - 1))
        took = time.perf_counter() - begin, processor() - busy
        assert result.value[0][-1] == "b" * depth
        tell(states=result.stats.expanded, wall=took[0], cpu=took[1], peak=peak())


def _duckdb(memory: str) -> Any:
    import duckdb

    folder = tempfile.mkdtemp(prefix="ss2sql-")  # gone with the process, which has it for itself
    atexit.register(shutil.rmtree, folder)
    return duckdb.connect(config={"memory_limit": memory, "threads": 1, "temp_directory": folder})


def _spark(memory: str) -> Any:
    settings = {"spark.driver.memory": memory.removesuffix("B").lower(), "spark.local.dir": tempfile.gettempdir()}
    return local_spark(1, **settings)


_SESSIONS = {"duckdb": _duckdb, "spark": _spark}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--depths", default="10,13,17,20")
    parser.add_argument("--engines", default="native;database;duckdb;duckdb, Python")
    parser.add_argument("--memory", default="2GB")
    parser.add_argument("--seconds", type=int, default=900, help="that a run may take")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "DEPTH"))
    options = parser.parse_args()
    if options.one:
        measure(options.one[0], int(options.one[1]), options.memory)
        return
    engines = options.engines.split(";")
    print("| states | " + " | ".join(engines) + " |\n|--:|" + "--:|" * len(engines))
    given_up: set[str] = set()
    for depth in map(int, options.depths.split(",")):
        cells = dict.fromkeys(engines, "")
        for engine in engines:
            if engine not in given_up:
                arguments = ("--memory", options.memory, "--one", engine, str(depth))
                cells[engine], told = run_apart(__file__, arguments, options.seconds)
                given_up |= {engine} if told is None else set()
        print(f"| {2**depth - 2:,} | " + " | ".join(cells.values()) + " |", flush=True)


if __name__ == "__main__":
    main()
