"""Times one compiled statement."""

from __future__ import annotations

import os
import time
import tracemalloc
from contextlib import redirect_stdout
from typing import Any

import apsw

from ss2sql import plan
from ss2sql.frontend import ast
from ss2sql.frontend.resolve import resolve
from ss2sql.race.cells import Cell, Rules
from ss2sql.runtime.compiled import Query
from ss2sql.runtime.engines import Engine
from ss2sql.runtime.native.deep import with_room
from ss2sql.runtime.result import Result
from ss2sql.runtime.session import Session
from ss2sql.walk import walk


def compiled(session: Session, statement: ast.Expr, engine: Engine) -> Query:
    """One statement, compiled for an engine. Raises the errors of compilation, such as UnsupportedError."""
    tree = ast.Script((statement,), span=statement.span)
    program = with_room(lambda: resolve(tree, session.host.catalog()))
    query = Query(session.host, session.execute, tree, program, engine)
    query.statements()
    return query


def timed(session: Session, query: Query, rules: Rules, cell: Cell) -> Result:
    """Runs a statement repeatedly, records the times in the cell, and gives the result of the first run.

    The first run has cold caches and does not count, unless it took more than half of the time limit. No further run
    begins after the limit. Every run starts with the variables of the first one.
    """
    keeper = _Variables(session, query)
    first, seconds = _run(query, rules)
    spent = seconds
    if seconds > rules.timeout / 2:
        cell.seconds.append(seconds)
    else:
        while len(cell.seconds) < rules.repeat and (spent < rules.timeout or not cell.seconds):
            keeper.restore()
            _, seconds = _run(query, rules)
            cell.seconds.append(seconds)
            spent += seconds
    if rules.memory:
        keeper.restore()
        cell.memory = _memory(query, rules)
    stats = first.stats
    cell.steps, cell.calls = stats.generated, dict(stats.calls)
    return first


def _run(query: Query, rules: Rules) -> tuple[Result, float]:
    """One run, with the value that AS makes; the script's output is hidden."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        started = time.perf_counter()
        result = query.run(timeout=rules.timeout)
        result.value  # noqa: B018 - the paths of a search are put together when they are read
        return result, time.perf_counter() - started


def _memory(query: Query, rules: Rules) -> int:
    """The peak memory of a run in bytes, the largest of Python's and SQLite's each."""
    apsw.memory_high_water(True)
    before = apsw.memory_used()
    tracemalloc.start()
    try:
        _run(query, Rules(timeout=rules.timeout * 10))  # watching memory slows a run down
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

    def restore(self) -> None:
        for name, value in self._before.items():
            if value is _NOTHING:
                self._names.forget(name)
            else:
                self._names.assign(name, value)
