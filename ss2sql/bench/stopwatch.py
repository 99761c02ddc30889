"""Times one compiled statement."""

from __future__ import annotations

import os
import time
import tracemalloc
from contextlib import redirect_stdout
from typing import Any

import apsw

from ss2sql.bench.results import BenchResult, BenchRules
from ss2sql.frontend.resolve.resolver import resolve
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.language.recursion_limit import retry_with_stack
from ss2sql.results.result import Result
from ss2sql.session.compiled_script import Query
from ss2sql.session.engines import Engine
from ss2sql.session.session import Session


def compile_run(session: Session, statement: ast.Expr, engine: Engine) -> Query:
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
    variables = _Variables(session, query)
    first, seconds = _run_once(query, settings)
    spent = seconds
    if seconds > settings.timeout / 2:
        cell.seconds.append(seconds)
    else:
        while len(cell.seconds) < settings.repeat and (spent < settings.timeout or not cell.seconds):
            variables.restore_values()
            _, seconds = _run_once(query, settings)
            cell.seconds.append(seconds)
            spent += seconds
    if settings.memory:
        variables.restore_values()
        cell.memory = _measure_memory(query, settings)
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


def _measure_memory(query: Query, settings: BenchRules) -> int:
    """The peak memory of a run in bytes, the largest of Python's and SQLite's each."""
    apsw.memory_high_water(True)
    before = apsw.memory_used()
    tracemalloc.start()
    try:
        _run_once(query, BenchRules(timeout=settings.timeout * 10))  # watching memory slows a run down
        return tracemalloc.get_traced_memory()[1] + max(apsw.memory_high_water() - before, 0)
    finally:
        tracemalloc.stop()


_NOTHING = object()


class _Variables:
    """The variables that a statement assigns, as they were before it."""

    def __init__(self, session: Session, query: Query) -> None:
        self._names = session.host.names
        nodes = (node for statement in query.plan.statements for node in walk(statement.expr))
        assigned = [node.name for node in nodes if isinstance(node, plan.Assign)]
        self._before: dict[str, Any] = {name: self._names.values.get(name, _NOTHING) for name in assigned}

    def restore_values(self) -> None:
        for name, value in self._before.items():
            if value is _NOTHING:
                self._names.forget_name(name)
            else:
                self._names.assign_value(name, value)
