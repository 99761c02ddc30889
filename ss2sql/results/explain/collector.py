"""Collects the facts about a script: engines, rewrites, functions, whether a search is bounded, the run, its levels."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import apsw

from ss2sql.frontend.inlining import InlinedCall
from ss2sql.frontend.user_functions import FunctionBody, UserFunction
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.plan_traversal import list_plan_functions, walk
from ss2sql.language.values import format_value
from ss2sql.lowering.rewrites import REWRITES
from ss2sql.lowering.rewrites.inline_functions import list_calls_to_rewrite
from ss2sql.results import cut_script
from ss2sql.results.explain.explanation import (
    Explanation,
    FunctionFacts,
    LevelTable,
    ParameterFacts,
    PlanLine,
    QueryFacts,
    RunFacts,
    ScriptFacts,
    StatementFacts,
    describe_queue,
    describe_search,
)
from ss2sql.results.notes import find_notes
from ss2sql.results.result import OutlinedQuery, OutlinedStatement
from ss2sql.runtime.graph_cache.fingerprint import do_steps_call_user
from ss2sql.runtime.run.run_state import Stats
from ss2sql.runtime.run.search_paths import SearchPaths, measure_path_lengths
from ss2sql.runtime.search.bidirectional import find_regression
from ss2sql.runtime.sqlite.interning import Interning

if TYPE_CHECKING:
    from ss2sql.results.result import Result


MOST_TEXT = 70  # characters of a bound value, and of its expression
ADVICE = "nothing bounds this search: bound it with MAXIMUM, by a condition in STOP WITH or CONNECT BY, or by timeout="


def explain_run(
    outlined: Sequence[OutlinedStatement],
    result: Result | None = None,
    missing: Sequence[str] = (),
) -> Explanation:
    """For every statement and query the engine and the reason, the plan, and the facts of the run of a result."""
    stats = None if result is None else result.stats
    statements = tuple(
        StatementFacts(statement.text, tuple(_collect_query(query, stats) for query in statement.queries))
        for statement in outlined
    )
    return Explanation(ScriptFacts(statements, None if result is None else _collect_run(result), tuple(missing)))


def _collect_query(outlined: OutlinedQuery, stats: Stats | None) -> QueryFacts:
    lowered, query = outlined.lowered, outlined.query
    lines, missing = _collect_plan(outlined)
    cures = (hint.removesuffix("leave the engine to ss2sql").removesuffix(", or ") for hint in outlined.cures)
    endless = (n for n in walk(query) if isinstance(n, plan.Query) and n.search and not _is_bounded(n.search))
    return QueryFacts(
        text=outlined.written.span.text,
        engine=outlined.engine,
        reason="all of it can be said in SQL" if lowered else outlined.reason,
        cures=() if lowered else tuple(filter(None, cures)),
        search=describe_search(query),
        rewrites={name: REWRITES[name].done for name in outlined.rewrites},
        functions=tuple(_collect_functions(outlined, stats)),
        notes=tuple(_collect_notes(outlined, stats)),
        warnings=(*(ADVICE for _ in endless), *find_notes(outlined.written)) if stats is None else (),
        plan=lines,
        plan_missing=missing,
        afterwards=tuple(_list_post_processing(outlined)),
        sql=lowered.text if lowered else str(outlined.sql) if outlined.levels or outlined.duck else None,
        parameters=tuple(_collect_parameter_facts(outlined)),
    )


def _is_bounded(search: plan.Search) -> bool:
    bounds = (search.maximum, search.bound, search.stop, search.made)
    return search.repeats != "allowed" or any(bound is not None for bound in bounds)


def _collect_plan(outlined: OutlinedQuery) -> tuple[tuple[PlanLine, ...], str | None]:
    """SQLite's plan, or the reason why it is gone: the session is closed, a table is gone."""
    if outlined.lowered is None:
        return (), None
    explaining = replace(outlined.lowered, text=f"EXPLAIN QUERY PLAN {outlined.lowered.text}")
    try:
        cursor = outlined.host.prepare_database().open_cursor(explaining, Interning(), lambda parameter: 0)
        with closing(cursor):
            rows: list[tuple[int, int, int, str]] = list(cursor)
    except apsw.ConnectionClosedError:
        return (), "the session is closed"
    except apsw.Error as error:
        return (), str(error)
    return tuple(_nest_plan_lines(rows, 0, 0, describe_queue(outlined.query))), None


def _collect_parameter_facts(outlined: OutlinedQuery) -> Iterator[ParameterFacts]:
    parameters = [(p.name, p.expr.span.text) for p in outlined.lowered.parameters] if outlined.lowered else []
    if outlined.duck is not None:
        parameters = list(outlined.duck.parameters.items())
    for name, written in parameters:
        value = format_value(outlined.sql.parameters[name], MOST_TEXT) if name in outlined.sql.parameters else None
        yield ParameterFacts(name, cut_script(written, MOST_TEXT), value)


def _list_post_processing(outlined: OutlinedQuery) -> Iterator[str]:
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


def _collect_functions(outlined: OutlinedQuery, stats: Stats | None) -> Iterator[FunctionFacts]:
    """The functions of the user that the query calls, in the order in which they are written."""
    off = "inline" in outlined.host.disabled
    found = [] if off else retry_with_stack(lambda: list_calls_to_rewrite(outlined.written))
    names = dict.fromkeys(function.name for function in list_plan_functions(outlined.written) if not function.builtin)
    for name in names:
        entry = outlined.host.functions.get(name)
        if entry is not None:
            yield _collect_function(entry, [site for site in found if site.function.name == name], off, stats)


def _collect_function(entry: UserFunction, found: list[InlinedCall], off: bool, stats: Stats | None) -> FunctionFacts:
    body = entry.body
    inlined = []
    if any(site.reason is None for site in found):
        assert isinstance(body, FunctionBody)
        inlined.append(f"{entry.name}({', '.join(body.parameters)}) is inlined: {body.text}")
    reasons = [site.reason for site in found if site.reason is not None]
    if not found:
        replaced = "a built-in function or operator that it uses is replaced"
        reasons = [f"it {body}" if isinstance(body, str) else "the rewrite inline is switched off" if off else replaced]
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


# --- searches with MEMORIZE ----------------------------------------------------------------------------


def _collect_notes(outlined: OutlinedQuery, stats: Stats | None) -> Iterator[str]:
    query = outlined.query
    for handed in outlined.handed:
        conditions = " AND ".join(" ".join(part.span.text.split()) for part in handed.conditions)
        yield f"DuckDB hands over the rows of {handed.source.name} with {conditions}"
    if outlined.levels is not None:
        hindrance = outlined.levels.level_plan.hindrance
        yield f"tries the steps of a level together, in {'SQL' if hindrance is None else f'Python: {hindrance}'}"
    if outlined.lowered is not None or query.search is None or query.search.repeats != "memorize":
        return
    remembered = outlined.host.graphs is not None and do_steps_call_user(query)
    yield from _find_bidirectional_fact(query, stats, remembered)
    if stats is not None and stats.graph is not None:
        steps = "1 step was" if stats.remembered_steps == 1 else f"{stats.remembered_steps:,} steps were"
        yield f"graph: remembered, with the number {stats.graph} in ss2sql_graphs; {steps} known from there"


def _find_bidirectional_fact(query: plan.Query, stats: Stats | None, remembered: bool) -> Iterator[str]:
    """Whether MEMORIZE searches from both ends, and why not."""
    regression = find_regression(query)
    if isinstance(regression, str):
        yield f"searched from the start only: {regression}"
        return
    if remembered:
        yield "searched from the start only: its graph is remembered"
        return
    undone = [call for expr in regression.before if expr is not None for call in list_plan_functions(expr)]
    names = dict.fromkeys(f"the {function.name}" for function in undone if function.inverse_of)
    how = f"by {' and '.join(names)}" if names else "because sums of whole numbers can be undone"
    if stats is None:
        yield f"searched from both ends, from the goal {how}"
    elif stats.backward:
        back = "1 level" if len(stats.backward) == 1 else f"{len(stats.backward)} levels"
        yield f"searched from both ends: {back} back from the goal {how}"


# --- the run -------------------------------------------------------------------------------------------


def _collect_run(result: Result) -> RunFacts:
    stats = result.stats
    rows = None if result.answer is None else result.answer.rows
    return RunFacts(
        status=result.status,
        engine=result.engine,
        rows=len(result),
        paths=None if rows is None or rows.paths is None else len(rows.paths),
        generated=stats.generated,
        expanded=stats.expanded,
        pruned=stats.pruned,
        seconds=dict(stats.seconds),
        levels=_collect_levels(result),
        notes=(*result.notes, *stats.notes),
    )


def _collect_levels(result: Result) -> LevelTable | None:
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
    results = Counter(measure_path_lengths(paths))
    kept = paths.count_kept_by_level() if isinstance(paths, SearchPaths) else {}
    levels = range(1, max((*results, *kept)) + 1)
    if kept:
        rows = tuple((level, kept.get(level, 0), results[level]) for level in levels)
        return LevelTable("the search by level", ("level", "kept", "results"), rows)
    return LevelTable("the search by level", ("level", "results"), tuple((level, results[level]) for level in levels))


# --- SQLite's plan of a query in words
# `EXPLAIN QUERY PLAN` gives a tree of short lines such as `SEARCH edge USING INDEX i (src=?)`. Each kind of line for
# lowered queries has its sentence here; any other is shown unchanged.
def _nest_plan_lines(
    rows: Sequence[tuple[int, int, int, str]], parent: int, depth: int, queue: str, recursive: bool = False
) -> Iterator[PlanLine]:
    """The lines below a parent. Loops over tables are nested: a later one runs for each row of the one before."""
    loops = 0
    for own, above, _, text in rows:
        if above != parent:
            continue
        waiting = recursive and text == "SCAN search"
        words = f"takes the steps that wait in a queue one by one, {queue}" if waiting else _put_line_in_words(text)
        if text.startswith(("SCAN ", "SEARCH ")):
            words = f"for each of them, {words}" if loops else words
            loops += 1
        yield PlanLine(depth, words, text)
        yield from _nest_plan_lines(rows, own, depth + 1, queue, recursive or text == "RECURSIVE STEP")


def _put_line_in_words(text: str) -> str:
    for pattern, words in SENTENCES:
        if found := re.fullmatch(pattern, text):
            return found.expand(words)
    return text


# The kinds of lines for lowered queries and their words; any other is shown as it is. Names are those of the SQL.
SENTENCES = (
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:each element", r"walks the elements of \1"),
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:elements in order of (.+)", r"looks up the elements of \1 in the order of \2"),
    (
        r"SCAN (.+) VIRTUAL TABLE INDEX \d+:each element, (.*) IS NOT \?",
        r"walks the elements of \1, but not where \2 is ?",
    ),
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:all", r"reads every element of \1"),
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:(.*)", r"asks for the elements of \1 with \2"),
    (r"SCAN CONSTANT ROW|SCAN \d+ CONSTANT ROWS?", "makes a row of what is known"),
    (r"SCAN search", "gives the results as the search finds them"),
    (r"SCAN (\S+)", r"reads every row of \1"),
    (r"SCAN (\S+) USING (?:COVERING )?INDEX (\S+)", r"reads every row of \1 in the order of its index \2"),
    (r"SEARCH (\S+) USING AUTOMATIC.*? \((.*)\).*", r"looks up \2 in an index of \1 that SQLite makes for this query"),
    (r"SEARCH (\S+) USING (?:COVERING )?INDEX (\S+) \((.*)\).*", r"looks up \3 in the index \2 of \1"),
    (r"SEARCH (\S+) USING .*PRIMARY KEY \((.*)\).*", r"looks up \2 in \1 by its primary key"),
    (r"BLOOM FILTER ON (\S+) .*", r"keeps a note of the values of \1, to skip lookups that find nothing"),
    (r"CO-ROUTINE search", "searches step by step:"),
    (r"CO-ROUTINE (.+)", r"makes the rows of \1 on demand:"),
    (r"MATERIALIZE (.+)", r"once, beforehand, and kept as \1:"),
    (r"SETUP|INITIAL RECURSIVE PART", "the start:"),
    (r"RECURSIVE STEP", "the steps:"),
    (r"CORRELATED (?:SCALAR|LIST) SUBQUERY \d+", "for each row, a query of its own:"),
    (r"(?:REUSE )?(?:SCALAR|LIST) SUBQUERY \d+", "once, a query of its own:"),
    (r"USE TEMP B-TREE FOR (.*)", r"sorts the rows for \1"),
)
