"""What is not lowered to SQL, in one table; such queries run natively.

Each rule looks at one query and gives the places that it objects to. The reasons are what `explain` and the error of
`engine="database"` say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from ss2sql.errors import Error, Span, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.operations.lists import are_of_one_kind
from ss2sql.language.plan_traversal import list_sources, list_states, walk, walk_own
from ss2sql.lowering.flat import is_sortable
from ss2sql.lowering.sql_query import can_be_literal

LANGUAGE_REPRESENTATIONS = ("dict", "list", "rows", "value", "set", "void")
MAX_SOURCES = 60  # SQLite joins at most 64 tables

FindPlaces = Callable[[plan.Query], Iterable[Span]]


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that runs natively: `find(query)` gives its places. A `nested` one is so inside of another query."""

    reason: str
    cure: str
    find: FindPlaces
    nested: bool = False


def _if_query(test: Callable[[plan.Query], object]) -> FindPlaces:
    """Objects to queries as a whole."""
    return lambda query: [query.span] if test(query) else []


def _if_node(*kinds: type[Any], test: Callable[[Any], object] = bool) -> FindPlaces:
    """Objects to parts of a query's expressions, those of queries inside it apart, in the order of the text."""
    return lambda query: (node.span for node in walk_own(query) if isinstance(node, kinds) and test(node))


def _if_output(test: Callable[[plan.Output], object]) -> FindPlaces:
    """Objects to columns."""
    return lambda query: (output.expr.span for output in query.columns if test(output))


def _find_unsortable(query: plan.Query) -> list[Span]:
    return [key.expr.span for key in query.order if not is_sortable(key.expr.type)]


def _find_nested_limit(query: plan.Query) -> Iterator[Span]:
    """A LIMIT is bound before the statement runs, and SQLite takes a negative one for none."""
    limits = query.limit, query.offset
    for limit in (one for one in limits if one is not None):
        is_count = limit.type.is_only(Kind.INT) and limit.type.is_at_least(0)
        reads_rows = list_sources(limit) or list_states(limit)
        if not is_count or reads_rows or any(isinstance(node, plan.GroupKey) for node in walk(limit)):
            yield limit.span


def _find_grouped_search(query: plan.Query) -> Iterator[Span]:
    """MAXIMUM counts the results, of which the statement shows the groups alone."""
    if query.search and query.aggregated and query.search.maximum:
        yield (query.group or (query.columns[0].expr,))[0].span


def _find_several_starts(query: plan.Query) -> Iterator[Span]:
    """One start after the other, where the next one may change what the one before has to do."""
    search = query.search
    if search is not None and search.each:
        one_by_one = search.by == "state" and (search.repeats == "no cycle" or search.order == "depth first")
        if one_by_one or search.siblings:
            yield search.each[0].span


def _find_unlowered_siblings(query: plan.Query) -> Iterator[Span]:
    """The queue sorts siblings where those of one depth that wait have one parent."""
    search = query.search
    for key in search.siblings if search is not None else ():
        if search is not None and (search.order != "depth first" or not is_sortable(key.expr.type)):
            yield key.expr.span


def _find_unlowered_groups(query: plan.Query) -> Iterator[Span]:
    """SQL's groups have no first member: what stands for them must not depend on which member that is."""
    return (key.span for key in query.group if query.aggregated and not are_of_one_kind(key.type))


def _is_unlowered_aggregate(node: plan.Aggregate) -> bool:
    return bool(node.argument and node.function != "collect" and not GROUPS[node.function].in_sql(node.argument.type))


# How a rule says that only Python does it, where there is nothing that a user could write instead.
_LEAVE = "leave the engine to ss2sql"
RULES: tuple[Rule, ...] = (
    Rule(
        "MEMORIZE builds a graph in memory",
        f"use NO CYCLE, or {_LEAVE}",
        _if_query(lambda query: query.search and query.search.repeats == "memorize"),
    ),
    Rule(
        "the query assigns a script variable",
        "move the assignment out of the query",
        _if_node(plan.Assign, plan.TemporalAssign, plan.AssignLate),
    ),
    Rule("eval reads its text when it runs", "write the expression itself", _if_node(plan.Eval)),
    Rule(
        "temporal variables are read row by row",
        "assign it to a variable before the query",
        _if_node(plan.Temporal),
    ),
    Rule(
        "a volatile function must be called in written order, which SQL does not promise here",
        "register it with volatility='immutable' or 'stable' if that is true",
        _if_node(plan.Call, test=lambda call: call.function.volatility == "volatile"),
    ),
    Rule(
        "a search inside another query",
        f"assign its result to a variable before the query, or {_LEAVE}",
        _if_query(lambda query: query.search),
        nested=True,
    ),
    Rule(
        "a representation that SQL does not make, inside another query",
        "use AS list or AS dict",
        _if_query(lambda query: query.representation.name not in LANGUAGE_REPRESENTATIONS),
        nested=True,
    ),
    Rule(
        "a partition inside another query",
        "assign it to a variable before the query",
        _if_query(lambda query: query.group and not query.aggregated),
        nested=True,
    ),
    Rule(
        "an inner ORDER BY over values of several kinds",
        "sort by numbers or strings alone",
        _find_unsortable,
        nested=True,
    ),
    Rule(
        "an inner LIMIT that is not known beforehand to be a count", "write a number", _find_nested_limit, nested=True
    ),
    Rule(
        "SELECT * over columns that only the elements know",
        "name the columns",
        _if_output(lambda output: output.star),
        nested=True,
    ),
    Rule(
        "a column name with half of a surrogate pair",  # which stands in the SQL as a text
        "give the column another name",
        _if_output(lambda output: not can_be_literal(output.name)),
        nested=True,
    ),
    Rule(
        "names of columns that a representation gives",  # which of a statement names them row by row
        "name the columns",
        _if_query(lambda query: query.representation.labels),
        nested=True,
    ),
    Rule(
        "a column name that is computed",
        "write the name itself in to(expr, name)",
        lambda query: (output.label.span for output in query.columns if output.label is not None),
    ),
    Rule("aggregates over the first results of a search", _LEAVE, _find_grouped_search),
    Rule("EACH starts a search anew for each element here", _LEAVE, _find_several_starts),
    Rule("ORDER SIBLINGS BY in another order than depth first", _LEAVE, _find_unlowered_siblings),
    Rule(
        "HAVING on a partition",
        _LEAVE,
        lambda query: [query.having.span] if query.having is not None and not query.aggregated else [],
    ),
    Rule("groups over values of several kinds", "group by integers or strings", _find_unlowered_groups),
    Rule(
        "groups in the order of values of several kinds",
        "order by float(...) or str(...)",
        lambda query: _find_unsortable(query) if query.aggregated else [],
    ),
    Rule(
        "an aggregate of values of several kinds",
        "make them numbers: min(float(...))",
        _if_node(plan.Aggregate, test=_is_unlowered_aggregate),
    ),
    Rule(
        "DISTINCT of whole paths",
        "take DISTINCT out, and write uniq(...) around the query",
        _if_query(lambda query: query.distinct),
    ),
    Rule(
        "LEFT JOIN in a search",
        _LEAVE,
        lambda query: (one.span for one in query.sources if query.search and getattr(one, "optional", False)),
    ),
    Rule(
        "a function of the values of a group, in their order",  # SQL promises none
        _LEAVE,
        _if_node(plan.Aggregate, test=lambda node: node.function == "collect"),
    ),
    Rule(
        "more sources than SQLite can join",
        "split the query",
        _if_query(lambda query: len(query.sources) > MAX_SOURCES),
    ),
)


def check_supported(query: plan.Query) -> None:
    """Raises UnsupportedError for the first objection to the query, or to one inside it."""
    for one in walk(query):
        if isinstance(one, plan.Query):
            for rule in RULES:
                if one is not query or not rule.nested:
                    for place in rule.find(one):
                        raise _build_lowering_refusal(rule.reason, rule.cure, place)


def build_sql_size_refusal(query: plan.Query, error: Error) -> UnsupportedError:
    """Why a query has to run natively that SQLite's own limits are too low for."""
    cure = "write fewer terms or queries inside of each other, or leave the engine to ss2sql"
    return _build_lowering_refusal(f"it is too much for {error.message}", cure, query.span)


def _build_lowering_refusal(reason: str, cure: str, place: Span) -> UnsupportedError:
    return UnsupportedError("U001", f"{reason}, so it runs natively", place, (cure,))
