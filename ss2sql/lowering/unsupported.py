"""What is not lowered to SQL, in one table; such queries run natively.

Each rule looks at one query and gives the place that it objects to, or None. The reasons are what `explain`
and the error of `engine="database"` say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from ss2sql import plan
from ss2sql.errors import Error, Span, UnsupportedError
from ss2sql.kinds import Kind
from ss2sql.lowering.select import sortable_key, uniform
from ss2sql.lowering.sql import can_be_text
from ss2sql.lowering.strategies import GUARDS
from ss2sql.walk import behind_what_fails, can_fail, is_volatile, sources_read, states_read, walk, walk_own

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
    """Volatile calls keep their written order in a plain walk of one query; everywhere else SQL is free."""
    if not (nested or query.search or query.group or query.order):
        return None
    calls = (node for node in _own_nodes(query) if isinstance(node, plan.Call))
    return next((call.span for call in calls if call.function.volatility == "volatile"), None)


def _volatile_source(query: plan.Query, nested: bool) -> Span | None:
    values = [source.value for source in query.sources if isinstance(source, plan.ValueSource)]
    values += [e for source in query.sources if isinstance(source, plan.WorldSource) for e in source.arguments]
    return next((value.span for value in values if is_volatile(value)), None)


def _stored_behind(query: plan.Query, nested: bool) -> Span | None:
    """If a stored table is empty that it joins as the third or later, SQLite sees that first, and reads nothing."""
    for source in behind_what_fails(query):
        rows = isinstance(source, plan.QuerySource) and source.query.representation.name == "dict"
        if rows or (isinstance(source, plan.WorldSource) and query.search is not None):
            return source.span
    return None


def tables_behind_what_fails(query: plan.Query) -> list[plan.TableSource]:
    """Tables that must not be empty where the query, or one inside it, runs in SQLite."""
    queries = (node for node in walk(query) if isinstance(node, plan.Query))
    return [source for one in queries for source in behind_what_fails(one) if isinstance(source, plan.TableSource)]


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
    return next((key.expr.span for key in keys if not sortable_key(key.expr)), None)


def _nested_limit(query: plan.Query, nested: bool) -> Span | None:
    """A LIMIT is bound before the statement runs, and SQLite takes a negative one for none."""
    limit = query.limit
    if not nested or limit is None:
        return None
    is_count = limit.type.only(Kind.INT) and limit.type.at_least(0)
    fixed = not (can_fail(limit) or sources_read(limit) or states_read(limit))
    fixed = fixed and not any(isinstance(node, plan.GroupKey) for node in walk(limit))
    return None if is_count and fixed else limit.span


def cuts_unasked(query: plan.Query) -> bool:
    """Whether SQLite would leave out what SELECT shows of a row that may fail: while it sorts, it keeps the first n.

    Rows that come behind these it drops by their keys alone.
    """
    cut = query.limit is not None and (bool(query.order) or query.aggregated)  # groups are sorted by their first rows
    return cut and any(can_fail(output.expr) for output in query.columns)


def _nested_cut(query: plan.Query, nested: bool) -> Span | None:
    return query.limit.span if nested and query.limit is not None and cuts_unasked(query) else None


def _nested_none(query: plan.Query, nested: bool) -> Span | None:
    """A LIMIT of 0: SQLite reads nothing then, not even what is to be sorted or put into groups before."""
    limit = query.limit
    if not nested or limit is None or limit.type.at_least(1) or not (query.order or query.group):
        return None
    return limit.span if can_fail(replace(query, limit=None)) else None


def _label(query: plan.Query, nested: bool) -> Span | None:
    return next((output.label.span for output in query.columns if output.label is not None), None)


def _nested_star(query: plan.Query, nested: bool) -> Span | None:
    return next((output.expr.span for output in query.columns if nested and output.star), None)


def _unwritable_name(query: plan.Query, nested: bool) -> Span | None:
    """Of a query inside another the names of columns stand in the SQL as texts."""
    return next((o.expr.span for o in query.columns if nested and not can_be_text(o.name)), None)


def _grouped_search(query: plan.Query, nested: bool) -> Span | None:
    return query.group[0].span if query.search and query.aggregated else None


def _partition_having(query: plan.Query, nested: bool) -> Span | None:
    return query.having.span if query.having is not None and not query.aggregated else None


def _group_values(query: plan.Query, nested: bool) -> Span | None:
    """SQL's groups have no first member: what stands for them must not depend on which member that is."""
    if not query.aggregated:
        return None
    for key in query.group:
        if not uniform(key.type):
            return key.span
    columns = [output.expr for output in query.columns if can_fail(output.expr)]
    for key_ in query.order:  # evaluated before the columns
        same = all(one == key_.expr for one in (*columns, *(k.expr for k in query.order if can_fail(k.expr))))
        if not (sortable_key(key_.expr) or (isinstance(key_.expr, plan.Aggregate) and same)):
            return key_.expr.span
    for node in _own_nodes(query):
        if isinstance(node, plan.Aggregate) and node.argument is not None:
            kind = node.argument.type
            if node.function in ("min", "max") and not uniform(kind):
                return node.span
            if node.function in ("sum", "average") and not kind.only(Kind.NUMBER | Kind.NONE):
                return node.span
    return None


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
    Rule("a source calls a volatile function", "assign its list to a variable before the query", _volatile_source),
    Rule("a search inside another query", "assign its result to a variable before the query", _nested_search),
    Rule(
        "a representation that SQL does not make, inside another query",
        "use AS list or AS dict",
        _nested_representation,
    ),
    Rule("a partition inside another query", "assign it to a variable before the query", _nested_partition),
    Rule("an inner ORDER BY over values of several kinds", "sort by numbers or strings alone", _nested_order),
    Rule("an inner LIMIT that is not known beforehand to be a count", "write a number", _nested_limit),
    Rule("an inner LIMIT behind ORDER BY where SELECT may fail", "leave out ORDER BY or LIMIT", _nested_cut),
    Rule(
        "an inner LIMIT that may be 0, behind ORDER BY or GROUP BY of what may fail",
        "write a count above 0",
        _nested_none,
    ),
    Rule("SELECT * over columns that only the elements know", "name the columns", _nested_star),
    Rule("a column name with half of a surrogate pair", "give the column another name", _unwritable_name),
    Rule("a column name that is computed", "write the name itself in to(expr, name)", _label),
    Rule("aggregates over the paths of a search", "leave the engine to ss2sql", _grouped_search),
    Rule("HAVING on a partition", "leave the engine to ss2sql", _partition_having),
    Rule("groups over values of several kinds", "group by integers or strings", _group_values),
    Rule("more sources than SQLite can join", "split the query", _limits),
    Rule(
        "a query that may be empty, behind a source that may fail for each element of another",
        "write it before that source",
        _stored_behind,
    ),
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


def refusal_of_empty(source: plan.TableSource) -> UnsupportedError:
    """Why a query has to run natively that reads this empty table behind a source that may fail."""
    reason = "the table is empty, which SQLite would see before the source in front of it fails"
    return _refusal(reason, "write it before that source", source.span)


def refusal_of_failed(query: plan.Query, error: Exception) -> UnsupportedError | None:
    """Why a query in which something failed has to run natively, for its result or for the error that comes first."""
    place = _later_element(query)
    if place is None:
        return None
    failed = error.message if isinstance(error, Error) else type(error).__name__  # its text is the user's own code
    reason = f"{failed}; SQLite makes all elements of a step before it takes the first of them"
    return _refusal(reason, "leave the engine to ss2sql", place)


def refusal_of_too_much(query: plan.Query, error: Error) -> UnsupportedError:
    """Why a query has to run natively that SQLite's own limits are too low for."""
    cure = "write fewer terms or queries inside of each other, or leave the engine to ss2sql"
    return _refusal(f"it is too much for {error.message}", cure, query.span)


def refusal_of_value(error: Error, query: plan.Query) -> UnsupportedError:
    """Why a query has to run natively of which SQLite was to have a value that its answer may not need."""
    reason = f"{error.message}; SQLite asks for it before it is known to be needed"
    return _refusal(reason, "leave the engine to ss2sql", error.span or query.span)


def _later_element(query: plan.Query) -> Span | None:
    """A source that is made anew for each element of another; the language evaluates the step before the next one.

    So does SQLite where all is evaluated on entering, which with weights is always so.
    """
    if query.search is None or query.search.weight is not None:
        return None
    own = {source.id for source in query.sources}
    return next((source.span for source in query.sources if can_fail(source) and sources_read(source) & own), None)


def _refusal(reason: str, cure: str, place: Span) -> UnsupportedError:
    return UnsupportedError("U001", f"{reason}, so it runs natively", place, (cure,))
