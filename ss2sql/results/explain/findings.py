"""The facts of an explanation, as data: found by results/explain/collector.py, written by
results/explain/explanation_text.py.
"""

from __future__ import annotations

from collections.abc import Mapping

from ss2sql.fast_dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlanLine:
    """One line of a plan: its depth, in words, and as in SQLite's EXPLAIN QUERY PLAN."""

    depth: int
    words: str
    sqlite: str | None = None


@dataclass(frozen=True, slots=True)
class ParameterFacts:
    """A bound value of the SQL: its name, its expression in the script, and the value as text, once known."""

    name: str
    written: str
    value: str | None


@dataclass(frozen=True, slots=True)
class FunctionFacts:
    """The calls of one function.

    `inlined` are the expressions that replace calls, `called` the reasons for remaining calls. `calls` counts those of
    the whole run, for a function of arrays the rows, in `blocks` calls; None before a run.
    """

    name: str
    inlined: tuple[str, ...]
    called: tuple[str, ...]
    volatility: str
    volatility_reason: str
    calls: int | None = None
    remembered: int | None = None
    blocks: int | None = None


@dataclass(frozen=True, slots=True)
class QueryFacts:
    """One query."""

    text: str
    engine: str
    reason: str
    cures: tuple[str, ...]  # would let SQLite run it
    search: Mapping[str, str]
    rewrites: Mapping[str, str]
    functions: tuple[FunctionFacts, ...]
    notes: tuple[str, ...]  # about the search
    warnings: tuple[str, ...]
    plan: tuple[PlanLine, ...]  # of the engine
    plan_missing: str | None  # why there is no plan
    afterwards: tuple[str, ...]  # the post-processing in Python
    sql: str | None
    parameters: tuple[ParameterFacts, ...]  # the bound values of `sql`


@dataclass(frozen=True, slots=True)
class StatementFacts:
    text: str
    queries: tuple[QueryFacts, ...]


@dataclass(frozen=True, slots=True)
class LevelTable:
    """Counts of a search level by level: the names of the columns, and one row of numbers for each level."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """A run: its status, the steps of a search, seconds per stage, notes on problems."""

    status: str
    engine: str
    rows: int
    paths: int | None
    generated: int
    expanded: int
    pruned: int
    seconds: Mapping[str, float]
    levels: LevelTable | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ScriptFacts:
    """A script, and its run, if any; `missing` are the parameters that a run would need."""

    statements: tuple[StatementFacts, ...]
    run: RunFacts | None = None
    missing: tuple[str, ...] = ()
