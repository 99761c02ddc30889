"""One measurement in a process of its own: `python benchmarks/worker.py PROBLEM SIZE CONTENDER REPEAT BUDGET`.

Prints one record as JSON. run.py starts these processes, with a time limit, one after the other.
"""

from __future__ import annotations

import gc
import hashlib
import json
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from problems import PROBLEMS, Problem
from problems.base import ENGINES, LIBRARIES, ON_DUCKDB

SHORT = 0.25  # seconds that the runs of a measurement take at least together: many of what is over at once
MANY = 100
COMPILED = 6  # times; the first loads modules and looks at tables, and counts by itself


class RefusedError(Exception):
    """The engine does not run this script."""

    status = "refused"


class MissingError(Exception):
    """The library is not installed."""

    status = "missing"


@dataclass(frozen=True)
class Measured:
    """What to run, what makes its value comparable, and what else there is to tell afterwards."""

    run: Callable[[], Any]
    answer: Callable[[Any], Any]
    facts: Callable[[], dict[str, Any]] = dict


def prepare(problem: Problem, size: int, contender: str) -> Measured:
    """Raises RefusedError, MissingError."""
    try:
        if contender in ENGINES:
            return prepare_script(problem, size, contender)
        if contender == ON_DUCKDB:
            return prepare_script(problem, size, "duckdb")
        work = problem.others[contender](size)
    except ModuleNotFoundError as error:
        if error.name not in LIBRARIES:
            raise
        raise MissingError(f"{error.name} is not installed") from error
    return Measured(work.run, work.answer or problem.answer)


def prepare_script(problem: Problem, size: int, engine: str) -> Measured:
    import ss2sql  # here, so that the other contenders owe it nothing

    assert problem.script
    script = problem.script(size)
    ss = ss2sql.connect(script.file, read_only=script.file is not None)
    for entry in script.functions:
        function, volatility = entry if isinstance(entry, tuple) else (entry, None)
        ss.function(function.__name__, function, volatility=volatility)  # type: ignore[arg-type]
    for function in script.array_functions:
        ss.function(function.__name__, function, volatility="immutable", vectorized=True)
    for name, value in script.variables.items():
        ss.set(name, value)
    for name, source in script.attached.items():
        ss.attach(name, source)
    compiled: list[float] = []
    for _ in range(COMPILED):
        started = time.process_time()
        try:
            query = ss.compile(script.text, engine=engine)  # type: ignore[arg-type]
            assert query.sql
        except ss2sql.UnsupportedError as error:
            raise RefusedError(error.message) from error
        compiled.append(time.process_time() - started)
    last: list[Any] = []

    def run() -> Any:
        last[:] = []
        last.append(query.run())
        return last[0].value if script.shaped else last[0]

    def answer(found: Any) -> Any:
        return problem.answer(found if script.shaped else found.paths)

    def facts() -> dict[str, Any]:
        result = last[0]
        return {
            "compile_first": compiled[0],
            "compile": statistics.median(compiled[1:]),
            "engine": result.engine,
            "auto": ss.compile(script.text).explain().facts.statements[-1].queries[0].engine,
            "steps": result.stats.generated,
            "calls": dict(result.stats.calls),
        }

    return Measured(run, answer, facts)


def measure(name: str, size: int, contender: str, repeat: int, budget: float) -> dict[str, Any]:
    """The record of one contender: seconds, processor seconds, answer; or why there are none."""
    record: dict[str, Any] = {"problem": name, "size": size, "contender": contender}
    try:
        work = prepare(PROBLEMS[name], size, contender)
    except (RefusedError, MissingError) as reason:
        return record | {"status": reason.status, "reason": str(reason)}
    started = time.perf_counter()
    value = work.run()
    record["first"] = time.perf_counter() - started
    record["answer"] = short(work.answer(value))
    del value
    record |= repeated(work.run, repeat, budget)
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return record | work.facts() | {"status": "ok", "megabytes": megabytes}


def repeated(run: Callable[[], Any], repeat: int, budget: float) -> dict[str, Any]:
    """Medians of `repeat` runs; of fewer where they exceed the budget, of more where they are over at once."""
    walls: list[float] = []
    cpus: list[float] = []
    while not walls or (len(walls) < repeat and sum(walls) < budget) or (len(walls) < MANY and sum(walls) < SHORT):
        if sum(walls) * 10 >= len(walls) * SHORT:
            gc.collect()  # takes longer than a short run does
        cpu, wall = time.process_time(), time.perf_counter()
        value = run()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        del value
    medians = {"seconds": statistics.median(walls), "cpu": statistics.median(cpus)}
    return medians | {"least": min(walls), "runs": len(walls)}


def short(answer: Any) -> str:
    """The answer as text, a long one as its length and digest."""
    text = json.dumps(answer, sort_keys=True)
    if len(text) <= 60:
        return text
    count = f"{len(answer):,} items, " if isinstance(answer, (list, dict)) else ""
    return f"{count}digest {hashlib.sha256(text.encode()).hexdigest()[:12]}"


if __name__ == "__main__":
    problem, size, contender, repeat, budget = sys.argv[1:]
    print(json.dumps(measure(problem, int(size), contender, int(repeat), float(budget))))
