"""The settings and the results of a comparison, and the timing of one compiled statement."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import asdict, field
from statistics import median
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import resolve
from ss2sql.frontend.syntax import ast
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.results.result import Result
from ss2sql.session.compiled_script import Query
from ss2sql.session.engines import Engine
from ss2sql.session.session import Session
from ss2sql.session.variables import Variables


@dataclass(frozen=True, slots=True)
class BenchRules:
    """The settings: engines, strategies, the number of runs after a first one, and a limit in seconds.

    `strategies` are options of CONNECT BY as a user writes them; "all" means all that suit the search.
    """

    engines: tuple[Engine, ...] = ("database", "native")
    strategies: tuple[str, ...] = ("all",)
    repeat: int = 5
    timeout: float = 10.0


@dataclass(slots=True)
class BenchResult:
    """The result of one strategy on one engine."""

    strategy: str
    engine: str
    seconds: list[float] = field(default_factory=list)  # of its runs
    compile_seconds: float | None = None
    paths: int | None = None  # None for statements that are no search
    rows: int | None = None
    steps: int = 0  # of one run
    calls: dict[str, int] = field(default_factory=dict)  # of one run
    answer: str = ""  # in a few words
    same: bool = False  # equals the answer of the script as written, in any order
    forbidden: bool = False  # the language forbids the answer
    missing: str | None = None  # the reason why there are no runs

    @property
    def name(self) -> str:
        return f"{self.strategy} in {self.engine}" if self.strategy else self.engine

    @property
    def best(self) -> float | None:
        return min(self.seconds, default=None)

    @property
    def middle(self) -> float | None:
        return median(self.seconds) if self.seconds else None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"best": self.best, "median": self.middle}


# --- times one compiled statement
def compile_raced_statement(session: Session, statement: ast.Expr, engine: Engine) -> Query:
    """One statement, compiled for an engine. Raises the errors of compilation, such as UnsupportedError."""
    tree = ast.Script((statement,), span=statement.span)
    program = retry_with_stack(lambda: resolve(tree, session.host.make_catalog()))
    query = Query(session.host, session.execute, tree, program, engine)
    query.statements()
    return query


def time_statement(session: Session, query: Query, settings: BenchRules, cell: BenchResult) -> Result:
    """Runs a statement repeatedly, records the times in the cell, and gives the result of the first run.

    The first run has cold caches and does not count, unless it took more than half of the time limit. No further run
    begins after the limit. Every run starts with the variables of the first one.
    """
    before = dict(session.host.names.values)
    first, seconds = _run_once(query, settings)
    spent = seconds
    if seconds > settings.timeout / 2:
        cell.seconds.append(seconds)
    else:
        while len(cell.seconds) < settings.repeat and (spent < settings.timeout or not cell.seconds):
            _restore_variables(session.host.names, before)
            _, seconds = _run_once(query, settings)
            cell.seconds.append(seconds)
            spent += seconds
    stats = first.stats
    cell.steps, cell.calls = stats.generated, dict(stats.calls)
    return first


def _run_once(query: Query, settings: BenchRules) -> tuple[Result, float]:
    """One run, with the value that AS makes; the script's output is hidden."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        started = time.perf_counter()
        result = query.run(timeout=settings.timeout)
        result.value  # noqa: B018 - the paths of a search are put together when they are read
        return result, time.perf_counter() - started


def _restore_variables(names: Variables, before: Mapping[str, Any]) -> None:
    for name in names.values.keys() - before.keys():
        names.forget_name(name)
    for name, value in before.items():
        if names.values.get(name) is not value:
            names.assign_value(name, value)
