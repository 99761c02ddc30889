"""Growing the graph of MEMORIZE from both ends, and whether a search can go backwards from its goal.

For that the state at the goal has to be known (`WHERE goal == move(this, state)`), and the state before a step from
the one after it: by the inverse that a function was registered with, or because only whole numbers were added. What
lies in FROM must not depend on the state, and the row of a step has to tell the state after it.

From the goal backwards only states are found: which elements lead from them towards the goal, and how many steps they
take to it at least. Nothing is decided there. The graph itself grows forwards as ever; but as soon as the two depths
together are the bound, a state is only expanded by those of its elements that still lead to the goal in time. What the
graph then lacks lies on no path from the start to the goal, so its paths, and their order, are the same.

The side with fewer states in its last level goes on. Of the two halves each reaches about the square root of the
states that the whole would: bidirectional search as Pohl described it in 1971.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from ss2sql.errors import Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import INT, Kind
from ss2sql.language.plan_traversal import is_volatile, split_and, walk
from ss2sql.language.values import State
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_contract import NotedSearch, list_step_elements

# A state at the goal: the value of each START WITH variable, None for one that no step changes.
GoalState: TypeAlias = tuple[plan.Expr | None, ...]


@dataclass(frozen=True, slots=True)
class Regression:
    """How a search goes backwards.

    `before` gives for each START WITH variable its value before a step, from the elements of the step and the state
    after it, for which the variables stand; None where no step changes it. The search ends in the state `goal`.
    """

    before: tuple[plan.Expr | None, ...]
    goal: GoalState


class _NotReversibleError(Exception):
    """The reason why a search cannot go backwards."""


def find_regression(query: plan.Query) -> Regression | str:
    """How the search of a query goes backwards, or the reason why it cannot."""
    try:
        return _build_regression(query)
    except _NotReversibleError as reason:
        return str(reason)


def _build_regression(query: plan.Query) -> Regression:
    search = query.search
    assert search is not None
    if is_volatile(query):
        raise _NotReversibleError("what it calls is volatile, so steps have to come in their order")
    if search.bound is None:
        raise _NotReversibleError("MEMORIZE has no bound, so there is no half of the path")
    steps = dict(search.connect)
    if len(steps) < len(search.connect):
        raise _NotReversibleError("CONNECT BY gives a variable two values")
    _check_backward_order(query)
    for source in query.sources:
        if any(isinstance(node, plan.State) and node.query == query.id for node in walk(source)):
            raise _NotReversibleError(f"the elements of '{source.name}' depend on the state")
    goal = _find_goal(query, steps)
    before = tuple(_invert_assignment(query, name, steps[name]) if name in steps else None for name, _ in search.start)
    _check_row_determines_state(query, steps)
    return Regression(before, goal)


def _check_backward_order(query: plan.Query) -> None:
    """Raises unless each variable follows from itself, or CONNECT BY changes just one."""
    assert query.search is not None
    for name, expr in query.search.connect:
        others = {state.name for state in _iterate_states(query, expr)} - {name}
        if others:
            raise _NotReversibleError(
                f"'{name}' follows from '{min(others)}', which may be another one before the step"
            )


def _iterate_states(query: plan.Query, expr: plan.Expr) -> Iterator[plan.State]:
    return (node for node in walk(expr) if isinstance(node, plan.State) and node.query == query.id)


def _is_step_constant(query: plan.Query, expr: plan.Expr) -> bool:
    own = {source.id for source in query.sources}
    return not any(
        (isinstance(node, (plan.Element, plan.Column)) and node.source in own)
        or (isinstance(node, plan.State) and node.query == query.id)
        for node in walk(expr)
    )


# --- the goal ------------------------------------------------------------------------------------------


def _find_goal(query: plan.Query, steps: dict[str, plan.Expr]) -> GoalState:
    assert query.search is not None
    known: dict[str, plan.Expr] = {}
    for part in split_and(query.where):
        match part:
            case plan.Call(plan.Function(name="eq", builtin=True), (left, right)):
                found = _solve_backward_equality(query, left, right, steps)
                known = (found or _solve_backward_equality(query, right, left, steps)) | known
    for name in steps:
        if name not in known:
            raise _NotReversibleError(
                f"WHERE does not say what '{name}' is at the goal: {name} after the step == a value"
            )
    return tuple(known.get(name) for name, _ in query.search.start)


def _solve_backward_equality(
    query: plan.Query, value: plan.Expr, expr: plan.Expr, steps: dict[str, plan.Expr]
) -> dict[str, plan.Expr]:
    """The values of variables after the step for which the expression equals a fixed value."""
    if not _is_step_constant(query, value):
        return {}
    for name, step in steps.items():
        if step == expr:
            return {name: value}
    items = _get_backward_elements(value)
    if not isinstance(expr, plan.MakeList) or items is None or len(items) != len(expr.items):
        return {}
    found: dict[str, plan.Expr] = {}
    for item, part in zip(items, expr.items, strict=True):
        found.update(_solve_backward_equality(query, item, part, steps))
    return found


def _get_backward_elements(expr: plan.Expr) -> list[plan.Expr] | None:
    if isinstance(expr, plan.MakeList):
        return list(expr.items)
    if isinstance(expr, plan.Constant) and isinstance(expr.value, list):
        return [plan.Constant(value, expr.type.element or INT, span=expr.span) for value in expr.value]
    return None


# --- one step back -------------------------------------------------------------------------------------


def _invert_assignment(query: plan.Query, name: str, step: plan.Expr) -> plan.Expr:
    """A variable before the step, as an expression of the variables after it."""
    states = list(_iterate_states(query, step))
    if not states:
        raise _NotReversibleError(f"'{name}' after a step does not tell what it was before")
    return _invert_expression(query, step, states[0], states[0])


def _invert_expression(query: plan.Query, step: plan.Expr, whole: plan.Expr, after: plan.Expr) -> plan.Expr:
    """The value of `whole`, a variable or an item of it, for which the expression has the value `after`."""
    if step == whole:
        return after
    match step:
        case plan.Call(plan.Function(name="add" | "sub" as name, builtin=True), (left, right)) if _is_backward_int(
            step
        ):
            in_left = not _is_backward_constant(query, left)
            if in_left and _is_backward_constant(query, right):
                return _invert_expression(
                    query, left, whole, _make_backward_call(step, "sub" if name == "add" else "add", after, right)
                )
            if _is_backward_constant(query, left):
                parts = (after, left) if name == "add" else (left, after)
                return _invert_expression(query, right, whole, _make_backward_call(step, "sub", *parts))
        case plan.MakeList(items) if isinstance(whole, plan.State) and whole == after and whole.type.size == len(items):
            own = [_check_backward_element(query, item, whole, at) for at, item in enumerate(items)]
            undone = (_invert_expression(query, item, part, part) for item, part in zip(items, own, strict=True))
            return replace(step, items=tuple(undone))
        case plan.Call(function, arguments) if not function.builtin:
            if not function.has_inverse:
                raise _NotReversibleError(f"'{function.name}' has no inverse: register it with inverse=")
            place = [at for at, argument in enumerate(arguments) if not _is_backward_constant(query, argument)]
            if len(place) == 1 and arguments[place[0]] == whole:
                inverted = (*arguments[: place[0]], after, *arguments[place[0] + 1 :])
                return replace(step, function=function.make_inverse(), arguments=inverted)
    raise _NotReversibleError("CONNECT BY is neither a call of a function with an inverse nor a sum of whole numbers")


def _is_backward_constant(query: plan.Query, expr: plan.Expr) -> bool:
    return not any(_iterate_states(query, expr))


def _is_backward_int(expr: plan.Expr) -> bool:
    return expr.type.is_only(Kind.INT)


def _make_backward_call(step: plan.Call, name: str, left: plan.Expr, right: plan.Expr) -> plan.Call:
    return replace(step, function=replace(step.function, name=name), arguments=(left, right), type=INT)


def _check_backward_element(query: plan.Query, item: plan.Expr, whole: plan.State, at: int) -> plan.Expr:
    """Raises unless an item of the new list reads the item at the same place of the old one."""
    for node in walk(item):
        match node:
            case plan.Call(plan.Function(name="item", builtin=True), (plan.State() as state, plan.Constant(value))):
                if state == whole and value == at:
                    return node
    raise _NotReversibleError(f"item {at} of the new '{whole.name}' does not follow from item {at} of the old one")


# --- rows ----------------------------------------------------------------------------------------------


def _check_row_determines_state(query: plan.Query, steps: dict[str, plan.Expr]) -> None:
    """Raises unless the row determines the state after its step, because rows are compared."""
    shown = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
    whole = {expr.source for expr in shown if isinstance(expr, plan.Element)}
    for name, step in steps.items():
        if step in shown:
            continue
        for node in walk(step):
            if isinstance(node, (plan.Element, plan.Column, plan.State)) and node not in shown:
                if not isinstance(node, plan.State) and node.source in whole:
                    continue
                raise _NotReversibleError(
                    f"SELECT does not tell '{name}' after the step: it names neither that nor all it follows from"
                )


# --- growing the graph of MEMORIZE from both ends, where the goal is known and steps can be undone (bidirectional.py)
MAX_ELEMENTS = 100_000  # of a state; they are kept as a list
CHECK_EVERY = 255


class BackwardSearch:
    """The states from which the goal is reached, level by level.

    `depth` is the number of levels, `last` the states of the last one. `edges` gives for the frozen state before a step
    the position of its element and the number of steps to the goal, this one included.
    """

    def __init__(self, search_run: SearchRun, noted: NotedSearch, items: list[Any]) -> None:
        assert noted.goal is not None
        assert noted.before is not None
        self.search_run, self.items, self.before = search_run, items, noted.before
        self.elements = list(map(noted.read_elements, items))
        self.key = search_run.shapes.freeze_state
        self.depth = 0
        self.edges: dict[Hashable, list[tuple[int, int]]] = {}
        self.met: set[Hashable] = set()  # from the start
        goal = noted.goal(search_run.start)
        self.seen: set[Hashable] = {self.key(goal)}
        self.last: list[State] = [goal]

    def add_level(self) -> None:
        self.depth += 1
        depth, before, key_of, edges, seen = self.depth, self.before, self.key, self.edges, self.seen
        level: list[State] = []
        steps = 0
        for number, state in enumerate(self.last):
            if not number & CHECK_EVERY:
                self.search_run.check()
            for position, elements in enumerate(self.elements):
                earlier = before(elements + state)
                if earlier is None:
                    continue
                steps += 1
                key = key_of(earlier)
                known = edges.get(key)
                if known is None:
                    edges[key] = [(position, depth)]
                    if key not in seen:
                        seen.add(key)
                        level.append(earlier)
                else:
                    known.append((position, depth))
        self.last = level
        self.search_run.stats.backward.append(GraphLevel(len(level), steps))

    def has_all_states(self, depth: int) -> bool:
        """Whether the backward search has reached all states that so many steps from the start can have."""
        bound = self.search_run.bound
        return not self.last or (bound is not None and depth + self.depth >= bound)

    def choose_elements(self, depth: int, elements: list[Any], state: State) -> list[Any]:
        """The elements of a frozen state of that level from which the goal can be reached in time."""
        bound = self.search_run.bound
        assert bound is not None
        known = self.edges.get(state, ())
        return [elements[position] for position in sorted(place for place, left in known if depth + left <= bound)]


def start_backward_search(search_run: SearchRun) -> BackwardSearch | None:
    """The search from the goal; None if there is none or, with a note, if it cannot start.

    It evaluates the goal before the first step, so an error here need not be one of the forward search.
    """
    noted = search_run.noted
    if noted is None or noted.goal is None:
        return None
    try:
        items = list_step_elements(noted, search_run.problem.starts[0])
        if len(items) <= MAX_ELEMENTS:
            return BackwardSearch(search_run, noted, items)
        _note_failure(search_run, f"a state has more than {MAX_ELEMENTS:,} elements")
    except Stopped:
        raise
    except Exception as error:
        _note_failure(search_run, f"what is known of the goal failed: {type(error).__name__}: {error}")
    return None


def balance_backward_search(backward: BackwardSearch, depth: int, level: Sequence[State]) -> BackwardSearch | None:
    """Grows the backward search while its last level is no larger than `level` of the forward search.

    Gives None, with a note, after an error or beyond `max_rows`. The script need not reach the states that only the
    backward search meets, so its errors are not those of the script: the forward search goes on alone.
    """
    most = backward.search_run.run.max_rows
    new = set(level) - backward.met  # more than one row may lead to a state
    backward.met |= new
    try:
        while not backward.has_all_states(depth) and len(backward.last) <= len(new):
            backward.add_level()
            if most is not None and len(backward.seen) > most:
                _note_failure(backward.search_run, f"more than max_rows={most} states lead to the goal")
                return None
    except Stopped:
        raise
    except Exception as error:
        _note_failure(backward.search_run, f"going back from the goal failed: {type(error).__name__}: {error}")
        return None
    return backward


def _note_failure(search_run: SearchRun, reason: str) -> None:
    search_run.stats.notes.append(f"searched from the start only: {reason}")
    search_run.stats.backward.clear()
