"""Whether a search can be shown to end.

It does where it has MAXIMUM or MEMORIZE n, where STOP WITH or the condition of CONNECT BY counts its steps, or where
rows or keys do not repeat and there are only so many. What cannot be shown may still end; `explain` advises a bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ss2sql.language import plan
from ss2sql.language.plan_traversal import find_direct_assignments, split_and, walk
from ss2sql.lowering.rewrites.plan_nodes import negate_expression

CHANGING_NODES = (plan.Eval, plan.Assign, plan.AssignLate, plan.TemporalAssign)
ADVICE = (
    "nothing shows that this search ends: bound it with MAXIMUM, by counting its steps in STOP WITH, or by timeout="
)


def warn_of_endless_searches(query: plan.Query) -> Iterator[str]:
    """A warning for each search of a query that cannot be shown to end."""
    for node in walk(query):
        if isinstance(node, plan.Query) and node.search is not None and not _is_bounded(node, node.search):
            yield ADVICE


def _is_bounded(query: plan.Query, search: plan.Search) -> bool:
    if search.maximum is not None or search.bound is not None:
        return True
    if search.stop is not None and any(_is_step_bound(part, query, search) for part in _split_certain(search.stop)):
        return True
    made = split_and(search.made) if search.first is None else ()
    if any(_is_step_bound(negate_expression(part), query, search) for part in made):
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


def _split_certain(expr: plan.Expr) -> Sequence[plan.Expr]:
    """The conditions of which each one alone stops a step."""
    return [part for inner in expr.parts for part in _split_certain(inner)] if isinstance(expr, plan.Or) else [expr]


def _is_step_bound(stop: plan.Expr, query: plan.Query, search: plan.Search) -> bool:
    """Whether a condition holds at the latest after so many steps."""
    match stop:
        case plan.Constant(value=value):
            return bool(value)
        case plan.Call(plan.Function(name="eq" | "ge" | "gt" as name, builtin=True), (plan.State() as state, limit)):
            return _does_rise_to(state, limit, name, query, search)
        case plan.Call(plan.Function(name="le" | "lt" as name, builtin=True), (limit, plan.State() as state)):
            return _does_rise_to(state, limit, "ge" if name == "le" else "gt", query, search)
    return False


def _does_rise_to(state: plan.State, limit: plan.Expr, name: str, query: plan.Query, search: plan.Search) -> bool:
    """Whether a state variable grows with every step, and does not miss the limit."""
    step = _find_increment(find_direct_assignments(query).get(state.name), state)
    moving = (plan.State, plan.Element, plan.Column)
    if step is None or step <= 0 or any(isinstance(node, moving) for node in walk(limit)):
        return False
    if name != "eq":
        return True
    start = dict(search.start).get(state.name)
    if not isinstance(start, plan.Constant) or not isinstance(limit, plan.Constant):
        return False
    ends = (start.value, limit.value)
    return all(type(end) is int for end in ends) and ends[1] >= ends[0] and (ends[1] - ends[0]) % step == 0


def _find_increment(expr: plan.Expr | None, state: plan.State) -> int | None:
    """By how much `state + 1` or `1 + state` differs from the state."""
    match expr:
        case plan.Call(plan.Function(name="add", builtin=True), (plan.State(name=own), plan.Constant(value=step))):
            pass
        case plan.Call(plan.Function(name="add", builtin=True), (plan.Constant(value=step), plan.State(name=own))):
            pass
        case _:
            return None
    return step if own == state.name and type(step) is int else None


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
