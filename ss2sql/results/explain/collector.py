"""Collects the facts about a script: engines, rewrites, functions, whether a search ends, the run and its levels.

A search counts all its steps together, because counting by level would cost time in its innermost loop. So a second,
native run of the same search counts them, where calling functions again has no effect.

It does where it has MAXIMUM or MEMORIZE n, where STOP WITH or the condition of CONNECT BY counts its steps, or where
rows or keys do not repeat and there are only so many. What cannot be shown may still end; `explain` advises a bound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import apsw

from ss2sql.frontend.inlining.substitution import FunctionBody, InlinedCall
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.plan_traversal import find_direct_assignments, list_plan_functions, split_and, walk
from ss2sql.language.step_identity import split_stop_conditions
from ss2sql.language.values import format_value
from ss2sql.lowering.rewrites import REWRITES
from ss2sql.lowering.rewrites.inline_functions import list_calls_to_rewrite
from ss2sql.lowering.rewrites.rewrite_context import negate_expression
from ss2sql.results.explain.engine_plans import (
    describe_duckdb_plan,
    describe_python_plan,
    describe_sqlite_plan,
    describe_table_plan,
)
from ss2sql.results.explain.findings import (
    FunctionFacts,
    LevelTable,
    ParameterFacts,
    PlanLine,
    QueryFacts,
    RunFacts,
    ScriptFacts,
    StatementFacts,
    cut_explained_script,
    describe_search,
)
from ss2sql.results.explain.outline import OutlinedQuery, OutlinedStatement
from ss2sql.results.result_notes import find_notes
from ss2sql.runtime.graph_cache.cached_steps import do_steps_call_user
from ss2sql.runtime.python import NativeQuery
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.search_execution import LevelCount, LevelCounter
from ss2sql.runtime.run.run_state import Stats
from ss2sql.runtime.run.search_paths import SearchPaths, measure_path_lengths
from ss2sql.runtime.search.bidirectional import find_regression

if TYPE_CHECKING:
    from ss2sql.results.result import Result
    from ss2sql.runtime.run.run_state import Run


def count_levels(result: Result) -> list[LevelCount] | str:
    """The steps of the result's search by level, or the reason why they cannot be counted."""
    query = result.outline[-1].queries[-1].query if result.outline and result.outline[-1].queries else None
    if result.answer is None or query is None or query.search is None:
        return "the result is not that of a search"
    if not ExpressionAnalysis((query,)).facts(query).steady:
        return "what it calls or assigns is not to be done twice"
    if any(isinstance(node, plan.WorldSource) for node in walk(query)):
        return "it reads a world"
    if result.status not in ("complete", "maximum"):
        return "the search was broken off"
    if result.rerun is None:
        return "the search cannot be run again"
    found: list[LevelCount] = result.rerun(lambda run: _count_again(query, run))
    return found


def _count_again(query: plan.Query, run: Run) -> list[LevelCount]:
    run.by_level = LevelCounter(run.stats)
    NativeQuery(query, by_level=True).compute_rows(run)
    run.by_level.add_counts()
    levels: list[LevelCount] = run.by_level.levels
    return levels


# --- whether a search can be shown to end
CHANGING_NODES = (plan.Eval, plan.Assign, plan.AssignLate, plan.TemporalAssign)
ADVICE = (
    "nothing shows that this search ends: bound it with MAXIMUM, by counting its steps in STOP WITH, or by timeout="
)


def _is_bounded(query: plan.Query, search: plan.Search) -> bool:
    if search.maximum is not None or search.bound is not None:
        return True
    made = split_and(search.made) if search.first is None else ()
    if any(
        _does_end_by_steps(p, query, search) for p in (*split_stop_conditions(query), *map(negate_expression, made))
    ):
        return True
    if search.repeats == "allowed" or any(isinstance(node, CHANGING_NODES) for node in walk(query)):
        return False
    return all(_is_of_sources(expr, query, query.id) for expr in _list_compared(query, search))


def _list_compared(query: plan.Query, search: plan.Search) -> list[plan.Expr]:
    """What is compared; of the state reached what CONNECT BY assigns."""
    if search.by != "state":
        return list(search.key or (output.expr for output in query.columns))
    values = find_direct_assignments(query)
    states = [node for key in search.key for node in walk(key) if isinstance(node, plan.State)]
    return [values.get(state.name, state) for state in states]


def _does_end_by_steps(stop: plan.Expr, query: plan.Query, search: plan.Search) -> bool:
    """Whether a condition always holds, or compares a variable that grows with every step and does not miss a limit."""
    match stop:
        case plan.Constant(value=value):
            return bool(value)
        case plan.Call(plan.Function(name="eq" | "ge" | "gt" as name, builtin=True), (plan.State() as state, limit)):
            pass
        case plan.Call(plan.Function(name="le" | "lt" as name, builtin=True), (limit, plan.State() as state)):
            pass
        case _:
            return False
    match find_direct_assignments(query).get(state.name):
        case plan.Call(
            plan.Function(name="add", builtin=True),
            (plan.State(name=own), plan.Constant(value=step)) | (plan.Constant(value=step), plan.State(name=own)),
        ) if own == state.name and type(step) is int and step > 0:
            pass
        case _:
            return False
    if any(isinstance(node, (plan.State, plan.Element, plan.Column)) for node in walk(limit)):
        return False
    ends = [end.value for end in (dict(search.start).get(state.name), limit) if isinstance(end, plan.Constant)]
    met = list(map(type, ends)) == [int, int] and ends[1] >= ends[0] and (ends[1] - ends[0]) % step == 0
    return met or name != "eq"


def _is_of_sources(expr: plan.Expr, query: plan.Query, search: int) -> bool:
    """Whether an expression has only so many values: it is made of elements of sources that are the same throughout."""
    still = {source.id for source in query.sources if _is_constant_source(source, search)}
    for node in walk(expr):
        match node:
            case plan.State(query=own) if own == search:
                return False
            case plan.Element(source=source) | plan.Column(source=source):
                if source not in still:
                    return False
            case plan.Call(function) if function.volatility == "volatile":
                return False
    return True


def _is_constant_source(source: plan.Source, search: int) -> bool:
    """Whether a source has the same elements for every state, or a part of what a still table has."""
    if isinstance(source, plan.QuerySource):
        inner = source.query
        plain = inner.search is None and not inner.grouped
        return plain and all(_is_of_sources(output.expr, inner, search) for output in inner.columns)
    return not any(isinstance(node, plan.State) and node.query == search for node in walk(source))


# --- collects the facts about a script: engines, rewrites, functions, SQLite's plan, the run
MOST_TEXT = 70  # characters of a bound value, and of its expression


def collect_facts(
    outlined: Sequence[OutlinedStatement], result: Result | None, missing: Sequence[str] = (), levels: bool = False
) -> ScriptFacts:
    """All facts about the statements, and about the run of a result, with its `levels` counted."""
    stats = None if result is None else result.stats
    statements = tuple(
        StatementFacts(statement.text, tuple(_collect_query(query, stats) for query in statement.queries))
        for statement in outlined
    )
    return ScriptFacts(statements, None if result is None else _collect_run(result, levels), tuple(missing))


def _collect_query(outlined: OutlinedQuery, stats: Stats | None) -> QueryFacts:
    lowered, query = outlined.lowered, outlined.query
    lines, missing = _collect_plan(outlined)
    cures = (hint.removesuffix("leave the engine to ss2sql").removesuffix(", or ") for hint in outlined.cures)
    endless = (n for n in walk(query) if isinstance(n, plan.Query) and n.search and not _is_bounded(n, n.search))
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


def _collect_plan(outlined: OutlinedQuery) -> tuple[tuple[PlanLine, ...], str | None]:
    """The engine's plan, or the reason why SQLite's plan is gone."""
    if outlined.levels is not None:
        return describe_table_plan(outlined.query, outlined.levels.level_plan), None
    if outlined.duck is not None:
        return describe_duckdb_plan(outlined.query, outlined.duck.written), None
    if outlined.lowered is None:
        return describe_python_plan(outlined.query), None
    try:
        return describe_sqlite_plan(outlined), None
    except apsw.ConnectionClosedError:
        return (), "the session is closed"
    except apsw.Error as error:
        return (), str(error)


def _collect_parameter_facts(outlined: OutlinedQuery) -> Iterator[ParameterFacts]:
    parameters = [(p.name, p.expr.span.text) for p in outlined.lowered.parameters] if outlined.lowered else []
    if outlined.duck is not None:
        parameters = list(outlined.duck.parameters.items())
    for name, written in parameters:
        value = format_value(outlined.sql.parameters[name], MOST_TEXT) if name in outlined.sql.parameters else None
        yield ParameterFacts(name, cut_explained_script(written, MOST_TEXT), value)


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
    for limit in dict.fromkeys(site.limit for site in found if site.reason is None):
        assert isinstance(body, FunctionBody)
        beyond = "" if limit is None else f"; called for numbers beyond {limit:,}"
        inlined.append(f"{entry.name}({', '.join(body.parameters)}) is inlined: {body.text}{beyond}")
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


def _collect_run(result: Result, by_level: bool) -> RunFacts:
    stats = result.stats
    rows = None if result.answer is None else result.answer.rows
    levels, notes = _collect_levels(result, by_level)
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


def _collect_levels(result: Result, by_level: bool) -> tuple[LevelTable | None, tuple[str, ...]]:
    """The levels of a search, counted where that is wanted, and why they could not be."""
    counted = count_levels(result) if by_level and not result.stats.levels else "not wanted"
    if isinstance(counted, str):
        wanted = by_level and not result.stats.levels and result.stats.generated
        return _collect_level_facts(result), (f"steps are not counted by level: {counted}",) if wanted else ()
    paths = None if result.answer is None else result.answer.rows.paths
    results = Counter(measure_path_lengths(paths or ()))
    rows = tuple(
        (number, level.generated, level.expanded, level.pruned, results[number])
        for number, level in enumerate(counted, 1)
    )
    return LevelTable("the search by level", ("level", "generated", "expanded", "pruned", "results"), rows), ()


def _collect_level_facts(result: Result) -> LevelTable | None:
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
