"""What is not lowered to SQL, in one table; such queries run natively.

Each rule looks at one query and gives the place that it objects to, or None. The reasons are what `explain`
and the error of `engine="database"` say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

from ss2sql import plan
from ss2sql.errors import Error, Span, UnsupportedError
from ss2sql.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.lowering.names import can_be_text
from ss2sql.lowering.select import sortable, uniform
from ss2sql.lowering.strategies import GUARDS
from ss2sql.records import dataclass
from ss2sql.walk import sources_read, states_read, walk, walk_own

LANGUAGE_REPRESENTATIONS = ("dict", "list", "rows", "value", "set", "void")
MOST_SOURCES = 60  # SQLite joins at most 64 tables


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that runs natively: `find(query, nested)` gives its place, where it occurs."""

    reason: str
    cure: str
    find: Callable[[plan.Query, bool], Span | None]


def _own_nodes(query: plan.Query) -> Iterator[Any]:
    """The nodes of a query's expressions, those of queries inside it apart, in the order of the text."""
    return islice(walk_own(query), 1, None)


def _memorize(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and not GUARDS[query.search.repeats].lowered else None


def _assignment(query: plan.Query, nested: bool) -> Span | None:
    kinds = (plan.Assign, plan.TemporalAssign, plan.AssignLate)
    return next((node.span for node in _own_nodes(query) if isinstance(node, kinds)), None)


def _eval(query: plan.Query, nested: bool) -> Span | None:
    return next((node.span for node in _own_nodes(query) if isinstance(node, plan.Eval)), None)


def _temporal(query: plan.Query, nested: bool) -> Span | None:
    return next((node.span for node in _own_nodes(query) if isinstance(node, plan.Temporal)), None)


def _volatile(query: plan.Query, nested: bool) -> Span | None:
    calls = (node for node in _own_nodes(query) if isinstance(node, plan.Call))
    return next((call.span for call in calls if call.function.volatility == "volatile"), None)


def _nested_search(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.search else None


def _nested_representation(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.representation.name not in LANGUAGE_REPRESENTATIONS else None


def _nested_partition(query: plan.Query, nested: bool) -> Span | None:
    return query.span if nested and query.group and not query.aggregated else None


def _nested_order(query: plan.Query, nested: bool) -> Span | None:
    if not nested:
        return None
    keys = query.order
    if keys and any(isinstance(source, plan.QuerySource) for source in query.sources):
        return keys[0].expr.span
    return next((key.expr.span for key in keys if not sortable(key.expr.type)), None)


def _nested_limit(query: plan.Query, nested: bool) -> Span | None:
    """A LIMIT is bound before the statement runs, and SQLite takes a negative one for none."""
    for limit in (query.limit, query.offset) if nested else ():
        if limit is None:
            continue
        is_count = limit.type.only(Kind.INT) and limit.type.at_least(0)
        fixed = not (sources_read(limit) or states_read(limit))
        fixed = fixed and not any(isinstance(node, plan.GroupKey) for node in walk(limit))
        if not (is_count and fixed):
            return limit.span
    return None


def _label(query: plan.Query, nested: bool) -> Span | None:
    """Of a query that is the statement the representation names columns row by row."""
    computed = (output.label.span for output in query.columns if output.label is not None)
    return query.span if nested and query.representation.labels else next(computed, None)


def _nested_star(query: plan.Query, nested: bool) -> Span | None:
    return next((output.expr.span for output in query.columns if nested and output.star), None)


def _unwritable_name(query: plan.Query, nested: bool) -> Span | None:
    """Of a query inside another the names of columns stand in the SQL as texts."""
    return next((o.expr.span for o in query.columns if nested and not can_be_text(o.name)), None)


def _grouped_search(query: plan.Query, nested: bool) -> Span | None:
    """MAXIMUM counts the results, of which the statement shows the groups alone."""
    counted = query.search and query.aggregated and query.search.maximum
    return (query.group or (query.columns[0].expr,))[0].span if counted else None


def _several_starts(query: plan.Query, nested: bool) -> Span | None:
    """One start after the other, where the next one may change what the one before has to do."""
    search = query.search
    if search is None or not search.each:
        return None
    one_by_one = search.by == "state" and (search.repeats == "no cycle" or search.order == "depth first")
    return search.each[0].span if one_by_one or search.siblings else None


def _siblings(query: plan.Query, nested: bool) -> Span | None:
    """The queue sorts siblings where those of one depth that wait have one parent."""
    search = query.search
    if search is None or not search.siblings:
        return None
    found = next((key.expr for key in search.siblings if not sortable(key.expr.type)), None)
    found = search.siblings[0].expr if search.order != "depth first" else found
    return None if found is None else found.span


def _partition_having(query: plan.Query, nested: bool) -> Span | None:
    return query.having.span if query.having is not None and not query.aggregated else None


def _group_values(query: plan.Query, nested: bool) -> Span | None:
    """SQL's groups have no first member: what stands for them must not depend on which member that is."""
    if not query.aggregated:
        return None
    for key in query.group:
        if not uniform(key.type):
            return key.span
    for key_ in query.order:
        if not sortable(key_.expr.type):
            return key_.expr.span
    for node in _own_nodes(query):
        if (
            isinstance(node, plan.Aggregate)
            and node.argument
            and node.function != "collect"
            and not GROUPS[node.function].in_sql(node.argument.type)
        ):
            return node.span
    return None


def _optional(query: plan.Query, nested: bool) -> Span | None:
    sources = (s for s in query.sources if isinstance(s, plan.QuerySource) and s.optional)
    return next((source.span for source in sources if query.search is not None), None)


def _distinct(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.distinct else None


def _collected(query: plan.Query, nested: bool) -> Span | None:
    """SQL promises no order of the rows in a group."""
    nodes = (node for node in _own_nodes(query) if isinstance(node, plan.Aggregate))
    return next((node.span for node in nodes if node.function == "collect"), None)


def _limits(query: plan.Query, nested: bool) -> Span | None:
    return query.span if len(query.sources) > MOST_SOURCES else None


RULES: tuple[Rule, ...] = (
    Rule("MEMORIZE builds a graph in memory", "use NO CYCLE, or leave the engine to ss2sql", _memorize),
    Rule("the query assigns a script variable", "move the assignment out of the query", _assignment),
    Rule("eval reads its text when it runs", "write the expression itself", _eval),
    Rule("temporal variables are read row by row", "assign it to a variable before the query", _temporal),
    Rule(
        "a volatile function must be called in written order, which SQL does not promise here",
        "register it with volatility='immutable' or 'stable' if that is true",
        _volatile,
    ),
    Rule("a search inside another query", "assign its result to a variable before the query", _nested_search),
    Rule(
        "a representation that SQL does not make, inside another query",
        "use AS list or AS dict",
        _nested_representation,
    ),
    Rule("a partition inside another query", "assign it to a variable before the query", _nested_partition),
    Rule("an inner ORDER BY over values of several kinds", "sort by numbers or strings alone", _nested_order),
    Rule("an inner LIMIT that is not known beforehand to be a count", "write a number", _nested_limit),
    Rule("SELECT * over columns that only the elements know", "name the columns", _nested_star),
    Rule("a column name with half of a surrogate pair", "give the column another name", _unwritable_name),
    Rule("a column name that is computed", "write the name itself in to(expr, name)", _label),
    Rule("aggregates over the first results of a search", "leave the engine to ss2sql", _grouped_search),
    Rule("EACH starts a search anew for each element here", "leave the engine to ss2sql", _several_starts),
    Rule("ORDER SIBLINGS BY in another order than depth first", "leave the engine to ss2sql", _siblings),
    Rule("HAVING on a partition", "leave the engine to ss2sql", _partition_having),
    Rule("groups over values of several kinds", "group by integers or strings", _group_values),
    Rule("DISTINCT of whole paths", "take DISTINCT out, and write uniq(...) around the query", _distinct),
    Rule("LEFT JOIN in a search", "leave the engine to ss2sql", _optional),
    Rule("a function of the values of a group, in their order", "leave the engine to ss2sql", _collected),
    Rule("more sources than SQLite can join", "split the query", _limits),
)


def objections(query: plan.Query, nested: bool = False) -> Iterator[tuple[Rule, Span]]:
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


def check(query: plan.Query) -> None:
    """Raises UnsupportedError for the first objection."""
    for rule, place in objections(query):
        raise _refusal(rule.reason, rule.cure, place)


def refusal_of_too_much(query: plan.Query, error: Error) -> UnsupportedError:
    """Why a query has to run natively that SQLite's own limits are too low for."""
    cure = "write fewer terms or queries inside of each other, or leave the engine to ss2sql"
    return _refusal(f"it is too much for {error.message}", cure, query.span)


def _refusal(reason: str, cure: str, place: Span) -> UnsupportedError:
    return UnsupportedError("U001", f"{reason}, so it runs natively", place, (cure,))
