"""Collects the facts about a script: engines, rewrites, functions, SQLite's plan, the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import apsw

from ss2sql import plan
from ss2sql.explained.endless import endless
from ss2sql.explained.facts import (
    FunctionFacts,
    LevelTable,
    ParameterFacts,
    PlanLine,
    QueryFacts,
    RunFacts,
    ScriptFacts,
    StatementFacts,
)
from ss2sql.explained.levels import levels_of
from ss2sql.explained.outline import OutlinedQuery, OutlinedStatement
from ss2sql.explained.python_plan import plan_in_duckdb, plan_in_python, plan_in_tables
from ss2sql.explained.sqlite_plan import plan_of
from ss2sql.explained.words import cut, search_words
from ss2sql.frontend.inliner import Site
from ss2sql.frontend.instances import Body
from ss2sql.lowering.rewrites import REWRITES
from ss2sql.lowering.rewrites.inline import sites
from ss2sql.runtime.functions import UserFunction
from ss2sql.runtime.memorize.reverse import reverse_of
from ss2sql.runtime.native.deep import with_room
from ss2sql.runtime.notes import notes_of
from ss2sql.runtime.paths import Paths, lengths_of
from ss2sql.runtime.remembered.keeper import calls
from ss2sql.runtime.run import Stats
from ss2sql.runtime.values import show
from ss2sql.walk import functions

if TYPE_CHECKING:
    from ss2sql.runtime.result import Result

MOST_TEXT = 70  # characters of a bound value, and of its expression


def facts_of(
    outlined: Sequence[OutlinedStatement], result: Result | None, missing: Sequence[str] = (), levels: bool = False
) -> ScriptFacts:
    """All facts about the statements, and about the run of a result, with its `levels` counted."""
    stats = None if result is None else result.stats
    statements = tuple(
        StatementFacts(statement.text, tuple(_query(query, stats) for query in statement.queries))
        for statement in outlined
    )
    return ScriptFacts(statements, None if result is None else _run(result, levels), tuple(missing))


def _query(outlined: OutlinedQuery, stats: Stats | None) -> QueryFacts:
    lowered, query = outlined.lowered, outlined.query
    lines, missing = _plan(outlined)
    return QueryFacts(
        text=outlined.written.span.text,
        engine=outlined.engine,
        reason=_reason(outlined),
        cures=() if lowered else tuple(filter(None, map(_cure, outlined.cures))),
        search=search_words(query),
        rewrites={name: REWRITES[name].done for name in outlined.rewrites},
        functions=tuple(_functions(outlined, stats)),
        notes=tuple(_notes(outlined, stats)),
        warnings=(*endless(query), *notes_of(outlined.written)) if stats is None else (),
        plan=lines,
        plan_missing=missing,
        afterwards=tuple(_afterwards(outlined)),
        sql=lowered.text if lowered else str(outlined.sql) if outlined.levels or outlined.duck else None,
        parameters=tuple(_parameters(outlined)),
    )


def _reason(outlined: OutlinedQuery) -> str:
    if outlined.lowered and outlined.passed_on:
        return outlined.passed_on
    reason = "all of it can be said in SQL" if outlined.lowered else outlined.reason
    return f"{outlined.passed_on}; {reason}" if outlined.passed_on else reason


def _cure(hint: str) -> str:
    """The cure in a hint of `engine="database"`, if it has one."""
    return hint.removesuffix("leave the engine to ss2sql").removesuffix(", or ")


def _plan(outlined: OutlinedQuery) -> tuple[tuple[PlanLine, ...], str | None]:
    """The engine's plan, or the reason why SQLite's plan is gone."""
    if outlined.levels is not None:
        return plan_in_tables(outlined.query, outlined.levels.in_tables), None
    if outlined.duck is not None:
        return plan_in_duckdb(outlined.query, outlined.duck.written), None
    if outlined.lowered is None:
        return plan_in_python(outlined.query), None
    try:
        return plan_of(outlined), None
    except apsw.ConnectionClosedError:
        return (), "the session is closed"
    except apsw.Error as error:
        return (), str(error)


def _parameters(outlined: OutlinedQuery) -> Iterator[ParameterFacts]:
    given = [(p.name, p.expr.span.text) for p in outlined.lowered.parameters] if outlined.lowered else []
    if outlined.duck is not None:
        given = list(outlined.duck.parameters.items())
    for name, written in given:
        value = show(outlined.sql.parameters[name], MOST_TEXT) if name in outlined.sql.parameters else None
        yield ParameterFacts(name, cut(written, MOST_TEXT), value)


def _afterwards(outlined: OutlinedQuery) -> Iterator[str]:
    """The post-processing after SQL."""
    lowered, query = outlined.lowered, outlined.query
    if lowered is None:
        return
    if query.order and lowered.orders:
        yield "sorts the results for ORDER BY"
    if query.limit is not None and not lowered.limited:
        yield "keeps as many results as LIMIT says"
    if query.group and not query.aggregated:
        yield "puts the results into groups"


# --- functions -----------------------------------------------------------------------------------------


def _functions(outlined: OutlinedQuery, stats: Stats | None) -> Iterator[FunctionFacts]:
    """The functions of the user that the query calls, in the order in which they are written."""
    off = "inline" in outlined.host.disabled
    found = [] if off else with_room(lambda: sites(outlined.written))
    names = dict.fromkeys(function.name for function in functions(outlined.written) if not function.builtin)
    for name in names:
        entry = outlined.host.functions.get(name)
        if entry is not None:
            yield _function(entry, [site for site in found if site.function.name == name], off, stats)


def _function(entry: UserFunction, found: list[Site], off: bool, stats: Stats | None) -> FunctionFacts:
    body = entry.body
    inlined = []
    for limit in dict.fromkeys(site.limit for site in found if site.reason is None):
        assert isinstance(body, Body)
        beyond = "" if limit is None else f"; called for numbers beyond {limit:,}"
        inlined.append(f"{entry.name}({', '.join(body.parameters)}) is inlined: {body.text}{beyond}")
    reasons = [site.reason for site in found if site.reason is not None]
    if not found:
        reasons = [f"it {body}" if isinstance(body, str) else _switched_off(off)]
    return FunctionFacts(
        name=entry.name,
        inlined=tuple(inlined),
        called=tuple(dict.fromkeys(reasons)),
        volatility=entry.volatility,
        volatility_reason=f"{'it ' if entry.inferred else ''}{entry.reason}",
        calls=None if stats is None else stats.calls[entry.name],
        remembered=None if stats is None else stats.remembered[entry.name],
        blocks=None if stats is None or entry.name not in stats.blocks else stats.blocks[entry.name],
    )


def _switched_off(off: bool) -> str:
    if off:
        return "the rewrite inline is switched off"
    return "a built-in function or operator that it uses is replaced"


# --- searches with MEMORIZE ----------------------------------------------------------------------------


def _notes(outlined: OutlinedQuery, stats: Stats | None) -> Iterator[str]:
    query = outlined.query
    for handed in outlined.handed:
        conditions = " AND ".join(" ".join(part.span.text.split()) for part in handed.conditions)
        tables = ", ".join(source.name for source in handed.sources)
        yield f"DuckDB hands over the rows of {tables} with {conditions}"
    if outlined.lowered is not None or query.search is None or query.search.repeats != "memorize":
        return
    remembered = outlined.host.graphs is not None and calls(query)
    yield from _ends(query, stats, remembered)
    if stats is not None and stats.graph is not None:
        steps = "1 step was" if stats.remembered_steps == 1 else f"{stats.remembered_steps:,} steps were"
        yield f"graph: remembered, with the number {stats.graph} in ss2sql_graphs; {steps} known from there"


def _ends(query: plan.Query, stats: Stats | None, remembered: bool) -> Iterator[str]:
    """Whether MEMORIZE searches from both ends, and why not."""
    reverse = reverse_of(query)
    if isinstance(reverse, str):
        yield f"searched from the start only: {reverse}"
        return
    if remembered:
        yield "searched from the start only: its graph is remembered"
        return
    undone = [call for expr in reverse.before if expr is not None for call in functions(expr)]
    names = dict.fromkeys(f"the {function.name}" for function in undone if function.inverse_of)
    how = f"by {' and '.join(names)}" if names else "because sums of whole numbers can be undone"
    if stats is None:
        yield f"searched from both ends, from the goal {how}"
    elif stats.backward:
        back = "1 level" if len(stats.backward) == 1 else f"{len(stats.backward)} levels"
        yield f"searched from both ends: {back} back from the goal {how}"


# --- the run -------------------------------------------------------------------------------------------


def _run(result: Result, by_level: bool) -> RunFacts:
    stats = result.stats
    rows = None if result.answer is None else result.answer.rows
    levels, notes = _levels(result, by_level)
    return RunFacts(
        status=result.status,
        engine=result.engine,
        rows=len(result),
        paths=None if rows is None or rows.paths is None else len(rows.paths),
        generated=stats.generated,
        expanded=stats.expanded,
        pruned=stats.pruned,
        seconds=dict(stats.seconds),
        levels=levels,
        notes=(*result.notes, *stats.notes, *notes),
    )


def _levels(result: Result, by_level: bool) -> tuple[LevelTable | None, tuple[str, ...]]:
    """The levels of a search, counted where that is wanted, and why they could not be."""
    counted = levels_of(result) if by_level and not result.stats.levels else "not wanted"
    if isinstance(counted, str):
        wanted = by_level and not result.stats.levels and result.stats.generated
        return _known_levels(result), (f"steps are not counted by level: {counted}",) if wanted else ()
    paths = None if result.answer is None else result.answer.rows.paths
    results = Counter(lengths_of(paths or ()))
    rows = tuple(
        (number, level.generated, level.expanded, level.pruned, results[number])
        for number, level in enumerate(counted, 1)
    )
    return LevelTable("the search by level", ("level", "generated", "expanded", "pruned", "results"), rows), ()


def _known_levels(result: Result) -> LevelTable | None:
    """The graph of MEMORIZE by levels; of other searches the results, and the steps that SQLite has kept."""
    if result.stats.levels and result.engine not in ("database", "native"):
        told = tuple((n, x.steps, x.pruned) for n, x in enumerate(result.stats.levels, 1))
        return LevelTable("the search by level", ("level", "kept", "left out"), told)
    if result.stats.levels:
        table = ((n, x.rows, x.steps, x.repeated, x.pruned) for n, x in enumerate(result.stats.levels, 1))
        return LevelTable("the graph of MEMORIZE", ("level", "rows", "steps", "repeated", "pruned"), tuple(table))
    paths = None if result.answer is None else result.answer.rows.paths
    if not paths:
        return None
    results = Counter(lengths_of(paths))
    kept = paths.kept_by_level() if isinstance(paths, Paths) else {}
    levels = range(1, max((*results, *kept)) + 1)
    if kept:
        rows = tuple((level, kept.get(level, 0), results[level]) for level in levels)
        return LevelTable("the search by level", ("level", "kept", "results"), rows)
    return LevelTable("the search by level", ("level", "results"), tuple((level, results[level]) for level in levels))
