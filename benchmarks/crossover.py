"""Which engine for how many states: seconds and memory of one search whose states double with every level.

    python benchmarks/crossover.py [--depths 10,13,17,20] [--engines 'native;database;duckdb'] [--memory 2GB]

Each run has a process of its own. The states are texts of a and b; the last of them is the goal. `duckdb` makes the
steps in SQL; `duckdb, Python` is given a step that is more than one expression. Prints a table for Markdown.
"""

from __future__ import annotations

import argparse
import atexit
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time

SCRIPT = """
    SELECT {step} FROM b = ["a", "b"] WHERE {step} == goal START WITH t = ""
    CONNECT BY UNIQUE t = {step} STOP WITH len(t) >= {last} AS list
"""
SECONDS = 900


def longer(text: str, letter: str) -> str:
    """The step for engines that are to ask Python; a loop is no expression."""
    for one in letter:
        text += one
    return text


def measure(engine: str, depth: int, memory: str) -> None:
    """Runs one search and prints what it took."""
    import ss2sql

    name, _, python = engine.partition(",")
    session = None
    if name == "duckdb":
        import duckdb

        folder = tempfile.mkdtemp(prefix="ss2sql-")  # gone with the process, which has it for itself
        atexit.register(shutil.rmtree, folder)
        session = duckdb.connect(config={"memory_limit": memory, "threads": 1, "temp_directory": folder})
    with ss2sql.connect(engine=name, session=session) as ss:  # type: ignore[arg-type]
        ss.function("longer", longer, volatility="immutable")
        ss.set("goal", "b" * depth)
        step = "longer(t, b.this)" if python else "t + b.this"
        begin, busy = time.perf_counter(), time.process_time()
        result = ss.run(SCRIPT.format(step=step, last=depth - 1))
        took = time.perf_counter() - begin, time.process_time() - busy
        assert result.value[0][-1] == "b" * depth
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps({"states": result.stats.expanded, "wall": took[0], "cpu": took[1], "peak": peak}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--depths", default="10,13,17,20")
    parser.add_argument("--engines", default="native;database;duckdb;duckdb, Python")
    parser.add_argument("--memory", default="2GB")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "DEPTH"))
    options = parser.parse_args()
    if options.one:
        measure(options.one[0], int(options.one[1]), options.memory)
        return
    engines = options.engines.split(";")
    print("| states | " + " | ".join(engines) + " |\n|--:|" + "--:|" * len(engines))
    for depth in map(int, options.depths.split(",")):
        cells = [cell(engine, depth, options.memory) for engine in engines]
        print(f"| {2**depth - 2:,} | " + " | ".join(cells) + " |", flush=True)


def cell(engine: str, depth: int, memory: str) -> str:
    """Seconds of the processor and peak memory of one run in a process of its own."""
    command = [sys.executable, __file__, "--memory", memory, "--one", engine, str(depth)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True)
    except subprocess.TimeoutExpired:
        return f"more than {SECONDS} s"
    except subprocess.CalledProcessError as error:
        return (error.stderr.strip().splitlines() or ["failed"])[-1][:40]
    took = json.loads(done.stdout.strip().splitlines()[-1])
    return f"{took['cpu']:.2f} s, {took['peak']:,.0f} MB"


if __name__ == "__main__":
    main()
