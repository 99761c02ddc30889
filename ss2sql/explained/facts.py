"""What is told of a script, as data: `collect.py` finds it, `text.py` writes it down, `as_dict` hands it out."""

from __future__ import annotations

from collections.abc import Mapping

from ss2sql.records import dataclass


@dataclass(frozen=True, slots=True)
class PlanLine:
    """One line of what is done: how deep it is nested, in words, and as SQLite's EXPLAIN QUERY PLAN says it."""

    depth: int
    words: str
    sqlite: str | None = None


@dataclass(frozen=True, slots=True)
class ParameterFacts:
    """A value that is bound in the SQL: its name there, what the script says, and the value as text, once known."""

    name: str
    written: str
    value: str | None


@dataclass(frozen=True, slots=True)
class FunctionFacts:
    """What became of the calls of one function.

    `inlined` are the expressions that calls became, `called` the reasons why there still are calls. `calls` counts
    those of the whole run, of a function that takes arrays the rows, in `blocks` calls; None where nothing has run.
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
    """One query.

    `cures` say what would let SQLite run it. `search` and `rewrites` map names to what they mean, `notes` are about the
    search. `plan` is what the engine does, `afterwards` what is left over for Python; `plan_missing` says why there is
    no plan. `parameters` are what is bound in `sql`.
    """

    text: str
    engine: str
    reason: str
    cures: tuple[str, ...]
    search: Mapping[str, str]
    rewrites: Mapping[str, str]
    functions: tuple[FunctionFacts, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    plan: tuple[PlanLine, ...]
    plan_missing: str | None
    afterwards: tuple[str, ...]
    sql: str | None
    parameters: tuple[ParameterFacts, ...]


@dataclass(frozen=True, slots=True)
class StatementFacts:
    text: str
    queries: tuple[QueryFacts, ...]


@dataclass(frozen=True, slots=True)
class LevelTable:
    """What a search did level by level: the names of the columns, and one row of numbers for each level."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What a run did: how it ended, its steps where there was a search, seconds per stage, notes of what went amiss."""

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
    """A script, and its run if it was run; `missing` are the names that a run would have to be given values for."""

    statements: tuple[StatementFacts, ...]
    run: RunFacts | None = None
    missing: tuple[str, ...] = ()
