"""Measures the problems in problems/, prints a table and writes out/bench.json. `make bench` runs it.

Every script is measured beside the same work written by hand in Python, in the same process: the ratio is what can be
compared between machines. Each number is the median of several runs after one to warm up.
"""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import apsw
from problems import COMPILES, RUNS, Compiling, Problem
from rich.console import Console
from rich.table import Table

import ss2sql

OUT = Path(__file__).parent.parent / "out" / "bench.json"
ENGINES = ("database", "native")
BUDGET = 1.5  # seconds for the repetitions of one measurement


def seconds(work: Callable[[], Any], least: int = 3, most: int = 25) -> float:
    """The median of several runs; the first one warms up and does not count."""
    work()
    times: list[float] = []
    while len(times) < least or (len(times) < most and sum(times) < BUDGET):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def measure(problem: Problem) -> list[dict[str, Any]]:
    """One record per engine. The answers of script and loop have to agree."""
    expected = problem.loop()
    loop = seconds(problem.loop)
    records = []
    for engine in ENGINES:
        with ss2sql.connect() as ss:
            for function in problem.functions:
                ss.function(function)
            for name, value in problem.variables.items():
                ss.set(name, value)
            query = ss.compile(problem.script, engine=engine)
            result = query.run()
            lengths = [len(path) for path in result.value]
            if lengths != expected:
                sys.exit(f"{problem.name}, {engine}: paths of {lengths[:9]} steps, not {expected[:9]}")
            took = seconds(query.run)
        records.append(
            {
                "problem": problem.name,
                "engine": engine,
                "seconds": took,
                "loop": loop,
                "ratio": took / loop,
                "steps": result.stats.generated,
                "calls": dict(result.stats.calls),
            }
        )
    return records


def measure_compiling(problem: Compiling) -> dict[str, Any]:
    with ss2sql.connect() as ss:
        for function in problem.functions:
            ss.function(function)
        took = seconds(lambda: ss.compile(problem.script).sql, least=20, most=200)
    return {"problem": f"compile: {problem.name}", "seconds": took, "limit": problem.limit}


def table(records: list[dict[str, Any]]) -> Table:
    shown = Table(box=None, pad_edge=False)
    shown.add_column("problem")
    shown.add_column("engine")
    for name in ("ms", "by hand, ms", "ratio", "steps", "us per step"):
        shown.add_column(name, justify="right")
    for record in records:
        milliseconds = record["seconds"] * 1000
        row = [record["problem"], record.get("engine", ""), f"{milliseconds:,.2f}"]
        if "loop" in record:
            row += [f"{record['loop'] * 1000:,.2f}", f"{record['ratio']:.2f}", f"{record['steps']:,}"]
            row.append(f"{record['seconds'] / record['steps'] * 1e6:.2f}")
        shown.add_row(*row)
    return shown


def findings(records: list[dict[str, Any]]) -> list[str]:
    """What the numbers are measured for."""
    by_name = {(record["problem"], record.get("engine")): record["seconds"] for record in records}
    lines = []
    for (name, engine), took in by_name.items():
        if name.startswith("chain of 10,000"):
            longer = by_name[name.replace("10,000", "20,000"), engine]
            lines.append(f"{name.split(', ')[1]}, {engine}: twice the chain takes {longer / took:.2f} times as long")
    deep, flat = (by_name[f"compile: nested calls, depth {depth}", None] for depth in (8, 1))
    lines.append(f"calls nested 8 deep compile in {deep / flat:.2f} times the time of 1 deep (at most 12)")
    for record in records:
        if record.get("limit"):
            lines.append(f"{record['problem']}: {record['seconds'] * 1000:.2f} ms (at most {record['limit']:.0f})")
    return lines


def main() -> None:
    started = time.perf_counter()
    console = Console(width=120)
    records: list[dict[str, Any]] = []
    for problem in RUNS:
        console.print(f"[dim]{problem.name} ...")
        records += measure(problem)
    records += [measure_compiling(problem) for problem in COMPILES]
    console.print(table(records))
    for line in findings(records):
        console.print(line, highlight=False)
    machine = {"python": platform.python_version(), "sqlite": apsw.sqlite_lib_version(), "machine": platform.machine()}
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps({"machine": machine, "records": records}, indent=2) + "\n", encoding="utf-8")
    console.print(
        f"written to {OUT.relative_to(OUT.parents[1])}; all took {time.perf_counter() - started:.0f} s", highlight=False
    )


if __name__ == "__main__":
    main()
