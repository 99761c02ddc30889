"""Where a query calls functions that take arrays, and the query that gives the arguments of such a call.

A function is called for a block of rows although rows are evaluated one by one: when its first row comes, the
arguments of the next ones are found out by a query of their own, the *scout*. It has the sources of the call and the
conditions that are tested before it, so what it gives are the arguments that are coming, in the order in which they
come. It may go wrong, end early or give too much: whatever it does not foretell is called by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, BOOL, Kind
from ss2sql.language.plan_traversal import (
    can_fail,
    is_volatile,
    list_functions,
    list_parts,
    list_sources,
    list_states,
    split_and,
    walk,
)
from ss2sql.runtime.run.run_state import Places

SCOUT = 0  # the number of scouts as queries: nothing in them asks for it


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """One call, whose arguments a query gives beforehand."""

    function: str
    scout: plan.Query  # gives the truth of the conditions before the call, then the arguments `free`
    free: tuple[int, ...]  # the other arguments depend on the state of a search, which no scout knows
    repeats: bool  # the rows are the same for every state of a search


@dataclass(frozen=True, slots=True)
class _Place:
    """What is known where an expression stands: the sources in sight, what has been tested, the search around it."""

    sources: tuple[plan.Source, ...] = ()
    tested: tuple[plan.Expr, ...] = ()
    searching: bool = False
    outside: frozenset[int] = frozenset()  # sources around the search


def takes_arrays(query: plan.Query) -> bool:
    return any(function.vectorized for function in list_functions(query))


def sites_of(query: plan.Query) -> tuple[Site, ...]:
    """The calls of functions that take arrays whose arguments can be foretold, in the order of the text."""
    if not takes_arrays(query):
        return ()
    changing = {
        node.name for node in walk(query) if isinstance(node, (plan.Assign, plan.TemporalAssign, plan.AssignLate))
    }
    found = [*_in_query(query, _Place()), *_of_groups(query)]
    moving = is_volatile(query)
    return tuple(site for site in found if _is_foretold(site.scout, changing, moving))


def _is_foretold(scout: plan.Query, changing: set[str], moving: bool) -> bool:
    """Whether evaluating the scout early cannot be noticed, and gives what will be.

    Of what lives outside of the script that cannot be said where the query is `moving`, for it may change it.
    """
    if is_volatile(scout):
        return False
    for node in walk(scout):
        if isinstance(node, plan.Temporal) or (isinstance(node, plan.Variable) and node.name in changing):
            return False
        if moving and isinstance(node, plan.Query) and _reads_outside(node):
            return False
    return True


# --- the walk ------------------------------------------------------------------------------------------


def _in_query(query: plan.Query, place: _Place) -> Iterator[Site]:
    if query.search is not None:
        place = replace(place, searching=True, outside=frozenset(source.id for source in place.sources))
        for _, start in query.search.start:
            yield from _in_expr(start, place)
    for source in query.sources:
        match source:
            case plan.ValueSource(value=value):
                yield from _in_expr(value, place)
            case plan.QuerySource(query=inner):
                yield from _in_query(inner, place)
        place = replace(place, sources=(*place.sources, source))
    if query.where is not None:
        yield from _in_expr(query.where, place)
    if query.search is not None:
        clauses: list[Any] = [query.search.stop, query.search.weight, query.search.heuristic]
        clauses += [expr for _, expr in query.search.connect]
        for clause in clauses:
            if clause is not None:
                yield from _in_expr(clause, place)
    elif query.where is not None:
        place = replace(place, tested=(*place.tested, *split_and(query.where)))
    rest = [*(output.expr for output in query.columns), *query.rows, *query.group, *(key.expr for key in query.order)]
    for expr in (*rest, *(() if query.having is None else (query.having,))):
        yield from _in_expr(expr, place)


def _in_expr(node: Any, place: _Place) -> Iterator[Site]:
    match node:
        case plan.Query():
            yield from _in_query(node, place)
        case plan.And(parts=items):
            for index, item in enumerate(items):
                yield from _in_expr(item, replace(place, tested=(*place.tested, *items[:index])))
        case plan.Or(parts=items):
            for index, item in enumerate(items):
                refused = tuple(plan.Not(before, span=before.span) for before in items[:index])
                yield from _in_expr(item, replace(place, tested=(*place.tested, *refused)))
        case plan.If(condition=condition, then=then, otherwise=otherwise):
            yield from _in_expr(condition, place)
            for expr in then:
                yield from _in_expr(expr, replace(place, tested=(*place.tested, condition)))
            refusal = plan.Not(condition, span=condition.span)
            for expr in otherwise:
                yield from _in_expr(expr, replace(place, tested=(*place.tested, refusal)))
        case plan.Eval():
            return
        case _:
            if isinstance(node, plan.Call) and node.function.vectorized:
                site = _of_search(node, place) if place.searching else _of_rows(node, place)
                if site is not None:
                    yield site
            for part in list_parts(node):
                yield from _in_expr(part, place)


# --- scouts --------------------------------------------------------------------------------------------


def _of_rows(call: plan.Call, place: _Place) -> Site | None:
    """A call in a flat query: its scout walks the sources that it reads, in step with the query."""
    sources = _sources(call.arguments, place)
    if not sources or _reads_groups(call) or any(list_states(node) for node in (call, *sources)):
        return None
    ids = {source.id for source in sources}
    tested = [expr for expr in place.tested if _read_outside(expr) <= ids and not _reads_groups(expr)]
    tested = [expr for expr in tested if not list_states(expr) and not is_volatile(expr)]
    # A condition that calls such functions does not stand in WHERE: rows must be counted that it drops, or the scout
    # would run ahead of the memory of these calls.
    late = [expr for expr in tested if any(function.vectorized for function in list_functions(expr))]
    early = [expr for expr in tested if expr not in late]
    passed = _all(late, call)
    arguments = list(call.arguments)
    if late:
        nothing = plan.Constant(None, ANY, span=call.span)
        arguments = [
            plan.If(passed, (expr,), (nothing,), span=expr.span) if can_fail(expr) else expr for expr in arguments
        ]
    where = _all(early, call) if early else None
    return Site(call.function.name, _scout(call, sources, [passed, *arguments], where), _all_of(call), False)


def _of_search(call: plan.Call, place: _Place) -> Site | None:
    """A call in a search: its scout walks the elements, once for all states."""
    arguments = call.arguments
    fixed = [
        position for position, expr in enumerate(arguments) if list_states(expr) or _read_outside(expr) & place.outside
    ]
    free = [position for position in range(len(arguments)) if position not in fixed]
    inside = frozenset(source.id for source in place.sources) - place.outside
    sources = _sources([arguments[position] for position in free], place)
    mixed = any(_read_outside(arguments[position]) & inside for position in fixed)
    lateral = any(list_states(source) or source.id in place.outside for source in sources)
    if not sources or mixed or lateral or _reads_groups(call):
        return None
    outputs = [_all([], call), *(arguments[position] for position in free)]
    scout = _scout(call, sources, outputs, None)
    if any(not function.builtin for function in list_functions(scout)):
        return None
    return Site(call.function.name, scout, tuple(free), True)


def _of_groups(query: plan.Query) -> Iterator[Site]:
    """Calls on the values of the groups of a query that stands by itself: its scout makes the groups."""
    if not query.aggregated or query.search is not None:
        return
    for expr in (*(output.expr for output in query.columns), *(key.expr for key in query.order)):
        for node in walk(expr):
            if isinstance(node, plan.Call) and node.function.vectorized and _reads_groups(node):
                columns = _outputs([_all([], node), *node.arguments])
                scout = replace(query, columns=columns, order=(), limit=None)
                if not any(isinstance(part, plan.Subquery) for part in walk(expr)):
                    yield Site(node.function.name, scout, _all_of(node), False)


def _scout(
    call: plan.Call, sources: tuple[plan.Source, ...], outputs: list[plan.Expr], where: plan.Expr | None
) -> plan.Query:
    form = plan.Representation("rows")
    return plan.Query(SCOUT, sources, _outputs(outputs), where, representation=form, span=call.span)


def _outputs(exprs: list[plan.Expr]) -> tuple[plan.Output, ...]:
    names = ["coming", *(f"argument_{number}" for number in range(1, len(exprs)))]
    return tuple(plan.Output(name, expr) for name, expr in zip(names, exprs, strict=True))


def _all(exprs: list[plan.Expr], call: plan.Call) -> plan.Expr:
    """Whether all of the expressions are true, as a bool."""
    match exprs:
        case []:
            return plan.Constant(True, BOOL, span=call.span)
        case [only]:
            return only if only.type.only(Kind.BOOL) else plan.Not(plan.Not(only, span=only.span), span=only.span)
        case _:
            return plan.And(tuple(exprs), span=call.span)


def _all_of(call: plan.Call) -> tuple[int, ...]:
    return tuple(range(len(call.arguments)))


# --- what expressions read -----------------------------------------------------------------------------


def _sources(exprs: Any, place: _Place) -> tuple[plan.Source, ...]:
    """The sources in sight that the expressions read, and those that these mention, in order."""
    wanted = frozenset[int]().union(*map(_read_outside, exprs))
    for source in reversed(place.sources):
        if source.id in wanted:
            wanted |= _read_outside(source)
    return tuple(source for source in place.sources if source.id in wanted)


def _read_outside(node: Any) -> frozenset[int]:
    """The sources that the node reads, but for those of queries inside it."""
    own = {source.id for part in walk(node) if isinstance(part, plan.Query) for source in part.sources}
    return list_sources(node) - own


def _reads_outside(query: plan.Query) -> bool:
    """Whether a source is neither a value nor a query."""
    return not all(isinstance(source, (plan.ValueSource, plan.QuerySource)) for source in query.sources)


def _reads_groups(node: Any) -> bool:
    return any(isinstance(part, (plan.GroupKey, plan.Aggregate)) for part in walk(node))


def call_places(*roots: Any) -> dict[str, Places]:
    """Where each function of the user is called; empty where that is not known before the script runs."""
    found: dict[str, set[tuple[int, int]]] = {}
    for root in roots:
        for node in walk(root):
            if isinstance(node, (plan.Eval, plan.AssignLate)):
                return {}
            if isinstance(node, plan.Call) and not node.function.builtin:
                found.setdefault(node.function.name, set()).add((node.place.start, node.place.end))
    return {name: frozenset(places) for name, places in found.items()}
