"""What is not lowered to SQL, in one table; such queries run natively.

Each rule looks at one query and gives the place that it objects to, or None. The reasons are what `explain`
and the error of `engine="database"` say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

from ss2sql.errors import Error, Span, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import list_sources, list_states, walk, walk_own
from ss2sql.lowering.flat import has_one_form, is_sortable
from ss2sql.lowering.sql_names import can_be_literal
from ss2sql.lowering.strategies import REPEAT_RULES

LANGUAGE_REPRESENTATIONS = ("dict", "list", "rows", "value", "set", "void")
MAX_SOURCES = 60  # SQLite joins at most 64 tables


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that runs natively: `find(query, nested)` gives its place, where it occurs."""

    reason: str
    cure: str
    find: Callable[[plan.Query, bool], Span | None]


def _iterate_own_nodes(query: plan.Query) -> Iterator[Any]:
    """The nodes of a query's expressions, those of queries inside it apart, in the order of the text."""
    return islice(walk_own(query), 1, None)


def _find_unlowered_memorize(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and not REPEAT_RULES[query.search.repeats].lowered else None


def _find_unlowered_assignment(query: plan.Query, nested: bool) -> Span | None:
    kinds = (plan.Assign, plan.TemporalAssign, plan.AssignLate)
    return next((node.span for node in _iterate_own_nodes(query) if isinstance(node, kinds)), None)


def _find_unlowered_eval(query: plan.Query, nested: bool) -> Span | None:
    return next((node.span for node in _iterate_own_nodes(query) if isinstance(node, plan.Eval)), None)


def _find_unlowered_temporal(query: plan.Query, nested: bool) -> Span | None:
    return next((node.span for node in _iterate_own_nodes(query) if isinstance(node, plan.Temporal)), None)


def _find_unlowered_volatile(query: plan.Query, nested: bool) -> Span | None:
    calls = (node for node in _iterate_own_nodes(query) if isinstance(node, plan.Call))
    return next((call.span for call in calls if call.function.volatility == "volatile"), None)


def _find_nested_search(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.search else None


def _find_nested_representation(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.representation.name not in LANGUAGE_REPRESENTATIONS else None


def _find_nested_partition(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.group and not query.aggregated else None


def _find_nested_order(query: plan.Query, nested: bool) -> Span | None:
    if not nested:
        return None
    keys = query.order
    if keys and any(isinstance(source, plan.QuerySource) for source in query.sources):
        return keys[0].expr.span
    return next((key.expr.span for key in keys if not is_sortable(key.expr.type)), None)


def _find_nested_limit(query: plan.Query, nested: bool) -> Span | None:
    """A LIMIT is bound before the statement runs, and SQLite takes a negative one for none."""
    for limit in (query.limit, query.offset) if nested else ():
        if limit is None:
            continue
        is_count = limit.type.is_only(Kind.INT) and limit.type.is_at_least(0)
        fixed = not (list_sources(limit) or list_states(limit))
        fixed = fixed and not any(isinstance(node, plan.GroupKey) for node in walk(limit))
        if not (is_count and fixed):
            return limit.span
    return None


def _find_unlowered_labels(query: plan.Query, nested: bool) -> Span | None:
    """Of a query that is the statement the representation names columns row by row."""
    computed = (output.label.span for output in query.columns if output.label is not None)
    return query.span if nested and query.representation.labels else next(computed, None)


def _find_unlowered_star(query: plan.Query, nested: bool) -> Span | None:
    return next((output.expr.span for output in query.columns if nested and output.star), None)


def _find_unwritable_name(query: plan.Query, nested: bool) -> Span | None:
    """Of a query inside another the names of columns stand in the SQL as texts."""
    return next((o.expr.span for o in query.columns if nested and not can_be_literal(o.name)), None)


def _find_grouped_search(query: plan.Query, nested: bool) -> Span | None:
    """MAXIMUM counts the results, of which the statement shows the groups alone."""
    counted = query.search and query.aggregated and query.search.maximum
    return (query.group or (query.columns[0].expr,))[0].span if counted else None


def _find_several_starts(query: plan.Query, nested: bool) -> Span | None:
    """One start after the other, where the next one may change what the one before has to do."""
    search = query.search
    if search is None or not search.each:
        return None
    one_by_one = search.by == "state" and (search.repeats == "no cycle" or search.order == "depth first")
    return search.each[0].span if one_by_one or search.siblings else None


def _find_unlowered_siblings(query: plan.Query, nested: bool) -> Span | None:
    """The queue sorts siblings where those of one depth that wait have one parent."""
    search = query.search
    if search is None or not search.siblings:
        return None
    found = next((key.expr for key in search.siblings if not is_sortable(key.expr.type)), None)
    found = search.siblings[0].expr if search.order != "depth first" else found
    return None if found is None else found.span


def _find_partition_having(query: plan.Query, nested: bool) -> Span | None:
    return query.having.span if query.having is not None and not query.aggregated else None


def _find_unlowered_groups(query: plan.Query, nested: bool) -> Span | None:
    """SQL's groups have no first member: what stands for them must not depend on which member that is."""
    if not query.aggregated:
        return None
    for key in query.group:
        if not has_one_form(key.type):
            return key.span
    for key_ in query.order:
        if not is_sortable(key_.expr.type):
            return key_.expr.span
    for node in _iterate_own_nodes(query):
        if (
            isinstance(node, plan.Aggregate)
            and node.argument
            and node.function != "collect"
            and not GROUPS[node.function].in_sql(node.argument.type)
        ):
            return node.span
    return None


def _find_unlowered_left_join(query: plan.Query, nested: bool) -> Span | None:
    sources = (s for s in query.sources if isinstance(s, plan.QuerySource) and s.optional)
    return next((source.span for source in sources if query.search is not None), None)


def _find_unlowered_distinct(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.distinct else None


def _find_unlowered_collect(query: plan.Query, nested: bool) -> Span | None:
    """SQL promises no order of the rows in a group."""
    nodes = (node for node in _iterate_own_nodes(query) if isinstance(node, plan.Aggregate))
    return next((node.span for node in nodes if node.function == "collect"), None)


def _find_unlowered_sources(query: plan.Query, nested: bool) -> Span | None:
    return query.span if len(query.sources) > MAX_SOURCES else None


RULES: tuple[Rule, ...] = (
    Rule("MEMORIZE builds a graph in memory", "use NO CYCLE, or leave the engine to ss2sql", _find_unlowered_memorize),
    Rule("the query assigns a script variable", "move the assignment out of the query", _find_unlowered_assignment),
    Rule("eval reads its text when it runs", "write the expression itself", _find_unlowered_eval),
    Rule(
        "temporal variables are read row by row", "assign it to a variable before the query", _find_unlowered_temporal
    ),
    Rule(
        "a volatile function must be called in written order, which SQL does not promise here",
        "register it with volatility='immutable' or 'stable' if that is true",
        _find_unlowered_volatile,
    ),
    Rule("a search inside another query", "assign its result to a variable before the query", _find_nested_search),
    Rule(
        "a representation that SQL does not make, inside another query",
        "use AS list or AS dict",
        _find_nested_representation,
    ),
    Rule("a partition inside another query", "assign it to a variable before the query", _find_nested_partition),
    Rule("an inner ORDER BY over values of several kinds", "sort by numbers or strings alone", _find_nested_order),
    Rule("an inner LIMIT that is not known beforehand to be a count", "write a number", _find_nested_limit),
    Rule("SELECT * over columns that only the elements know", "name the columns", _find_unlowered_star),
    Rule("a column name with half of a surrogate pair", "give the column another name", _find_unwritable_name),
    Rule("a column name that is computed", "write the name itself in to(expr, name)", _find_unlowered_labels),
    Rule("aggregates over the first results of a search", "leave the engine to ss2sql", _find_grouped_search),
    Rule("EACH starts a search anew for each element here", "leave the engine to ss2sql", _find_several_starts),
    Rule("ORDER SIBLINGS BY in another order than depth first", "leave the engine to ss2sql", _find_unlowered_siblings),
    Rule("HAVING on a partition", "leave the engine to ss2sql", _find_partition_having),
    Rule("groups over values of several kinds", "group by integers or strings", _find_unlowered_groups),
    Rule(
        "DISTINCT of whole paths", "take DISTINCT out, and write uniq(...) around the query", _find_unlowered_distinct
    ),
    Rule("LEFT JOIN in a search", "leave the engine to ss2sql", _find_unlowered_left_join),
    Rule("a function of the values of a group, in their order", "leave the engine to ss2sql", _find_unlowered_collect),
    Rule("more sources than SQLite can join", "split the query", _find_unlowered_sources),
)


def iterate_objections(query: plan.Query, nested: bool = False) -> Iterator[tuple[Rule, Span]]:
    """Every rule that the query, or a query inside it, breaks, with the place."""
    for rule in RULES:
        place = rule.find(query, nested)
        if place is not None:
            yield rule, place
    for node in walk(query):
        if isinstance(node, plan.Query) and node is not query:
            for rule in RULES:
                place = rule.find(node, True)
                if place is not None:
                    yield rule, place


def check_supported(query: plan.Query) -> None:
    """Raises UnsupportedError for the first objection."""
    for rule, place in iterate_objections(query):
        raise _build_lowering_refusal(rule.reason, rule.cure, place)


def build_sql_size_refusal(query: plan.Query, error: Error) -> UnsupportedError:
    """Why a query has to run natively that SQLite's own limits are too low for."""
    cure = "write fewer terms or queries inside of each other, or leave the engine to ss2sql"
    return _build_lowering_refusal(f"it is too much for {error.message}", cure, query.span)


def _build_lowering_refusal(reason: str, cure: str, place: Span) -> UnsupportedError:
    return UnsupportedError("U001", f"{reason}, so it runs natively", place, (cure,))
