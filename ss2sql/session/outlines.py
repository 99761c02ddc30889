"""What a run notes of its compiled statements, so that they can be explained later."""

from __future__ import annotations

from collections.abc import Iterable

from ss2sql.results.explain.outline import OutlinedQuery, OutlinedStatement
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.compiled_query import CompiledQuery
from ss2sql.session.compiled_script import CompiledStatement


def outline(statements: Iterable[CompiledStatement], run: Run | None = None) -> tuple[OutlinedStatement, ...]:
    """The statements as they are compiled now, with the values that a run has bound."""
    return tuple(
        OutlinedStatement(statement.tree.span.text, tuple(_outlined(query, run) for query in statement.queries))
        for statement in statements
    )


def _outlined(query: CompiledQuery, run: Run | None) -> OutlinedQuery:
    return OutlinedQuery(
        query.host,
        query.written,
        query.query,
        query.engine,
        query.shown(run),
        query.levels,
        query.duck,
        query.reason,
        query.cures,
        query.rewrites,
        query.sql(run),
        tuple(query.handed.values()),
    )
