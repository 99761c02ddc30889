"""Calls that a search makes only once need no memory: to ask it and to fill it is a third of what such a step costs.

UNIQUE and MEMORIZE expand no row twice. Where a row is the state behind it they expand no state twice either, but for
the start, which a row may be as well. A call of all that makes a state and of the element is then another one in every
step, if the elements are all different and nobody else calls the function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ss2sql import plan
from ss2sql.runtime.native.call_code import is_remembered
from ss2sql.runtime.native.calls import NO_KEY, RememberedCalls
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.run import Places, Run
from ss2sql.walk import set_at_once, walk


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


def new_calls(query: plan.Query, analysis: Analysis) -> Iterator[plan.Call]:
    """The calls that the search makes once for each state and element."""
    search = query.search
    if (
        search is None
        or not search.plain
        or len(query.sources) != 1
        or analysis.roots[0] is not query
        or analysis.open_world
    ):
        return
    expands_once = search.repeats == "memorize" or (search.repeats == "unique" and search.weight is None)
    if not expands_once or not _rows_are_states(query, search, analysis):
        return
    moved = {name for name, _ in search.connect}
    calls: dict[str, list[plan.Call]] = {}
    for node in walk(query):
        if isinstance(node, plan.Call) and is_remembered(node):
            calls.setdefault(node.function.name, []).append(node)
    for same in calls.values():
        keys = {analysis.of(node).key for node in same}
        states = {part.name for part in same[0].arguments if isinstance(part, plan.State) and part.query == query.id}
        elements = {part.source for part in same[0].arguments if isinstance(part, plan.Element)}
        if len(keys) == 1 and None not in keys and moved <= states and query.sources[0].id in elements:
            yield same[0]


def _rows_are_states(query: plan.Query, search: plan.Search, analysis: Analysis) -> bool:
    """Whether equal rows mean equal states and the other way round."""
    outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
    shown = {analysis.of(expr).key for expr in outputs}
    at_once = set_at_once(query)  # SELECT sees the state before the step
    alike = shown == {analysis.of(expr).key for expr in at_once.values()}
    return None not in shown and alike and len(at_once) == len(search.connect)


def ways_of(
    run: Run, function: plan.Function, places: Places, items: Sequence[Any], keyed: bool, single: bool
) -> Callable[[Any], Any]:
    """What says for a state, by its key, how the calls of its steps are made.

    `places` is where the search calls the function, `items` has its elements: `single`, or with what accompanies them,
    which `keyed` ends with their exact keys.
    """
    calls: RememberedCalls = run.host.call(function, run)  # type: ignore[assignment]
    remembered, once = (calls.of_keys, calls.once) if keyed else (calls.of_plain, calls.once_of_plain)
    keys = items if single else [item[-1 if keyed else 0] for item in items]
    elsewhere = run.call_places.get(function.name, {None}) - places
    if elsewhere or calls.foretold or NO_KEY in keys or len(set(keys)) < len(keys):
        return lambda key: remembered
    start = None

    def way(key: Any) -> Any:
        nonlocal start
        if start is None:
            start = key
        has_objects = NO_KEY in key if type(key) is tuple else key == NO_KEY
        return remembered if has_objects or key == start else once

    return way
