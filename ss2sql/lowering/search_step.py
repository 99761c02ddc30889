"""One step while it is made: what decides whether it enters the queue, and what it carries (see search.py).

The order of the parts is that of the language: the guard, STOP WITH, WHERE, the row, the weight, HEURISTIC,
CONNECT BY. Where nobody sees the order, what SQLite does by itself is evaluated before what costs a Python call.

    SELECT name FROM staff START WITH boss = 1 CONNECT BY boss = id STOP WITH manager != boss
    SELECT name FROM staff WHERE manager == boss AND pay > 5 ... STOP WITH manager != boss OR level == 3

STOP WITH holds the negation of an equality. Without a WHERE, or where WHERE demands the equality, a step that does
not meet it stops without being a goal. So the equality becomes a condition of the join, for which SQLite uses
an index: a hierarchy of a million rows then costs its size, not its square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type, can_be_equal, is_flag
from ss2sql.language.plan_traversal import is_volatile, join_conditions, list_sources, split_and
from ss2sql.lowering import sql_builder
from ss2sql.lowering.evaluation_order import get_equality_sides
from ss2sql.lowering.guards import is_costly, is_free, list_free_parts
from ss2sql.lowering.sql_builder import Node, negate
from ss2sql.lowering.sqlite_expressions import SqlScope

if TYPE_CHECKING:
    from ss2sql.lowering.search import EagerSearch


class SearchStep:
    """`scope` reads the elements and the state before the step; `first` says that this is the START WITH state.

    `item` is that of the list which the step is one with, where each has a SELECT of its own.
    """

    def __init__(self, search: EagerSearch, scope: SqlScope, first: bool, item: plan.Expr | None = None) -> None:
        self.of = search
        self.item = item
        self.scope = scope
        self.first = first
        self.expressions = search.expressions
        self.query = search.query
        self.search = search.search
        self.parent: Node = sql_builder.number(0) if first else search.column("step")
        self.best = search.total is not None and self.search.repeats == "unique"
        self.next = search.lower_next_state(scope)

    def lower_row(self) -> list[Node]:
        """The row, as far as it is shown or compared."""
        if self.of.arms is not None and self.item is not None:
            return list(self.of.arms.lower_row(self.expressions, self.query, self.item, self.scope))
        if not self.query.gives_paths and (self.search.repeats == "allowed" or self.of.keyed):
            return []
        return [self.expressions.lower_value(expr, self.scope) for expr in self.of.outputs]

    def lower_key(self) -> list[Node]:
        """What is compared: the row, or what BY names."""
        if not self.of.keyed:
            return self.lower_row()
        scope = self.scope if self.search.by != "state" else self.scope.with_states(self.next)
        return [self.expressions.lower_value(expr, scope) for expr in self.of.compared]

    @property
    def made(self) -> plan.Expr | None:
        """The condition of CONNECT BY, without which there is no step."""
        other = self.search.first if self.first else None
        return self.search.made if other is None else other

    def lower_stop(self) -> Node:
        """Whether a step that enters stops."""
        assert self.of.stops.goals is not None
        return self.expressions.lower_condition(self.of.stops.goals, self.scope)

    def lower_goal(self) -> Node:
        assert self.query.where is not None
        return self.expressions.lower_condition(self.query.where, self.scope)

    def list_lookups(self) -> list[Node]:
        """What SQLite may look up or evaluate early.

        This is the part of CONNECT BY that cannot fail, and equalities without which the step would stop as no goal.
        """
        parts = list_free_parts(self.made, plan.And)
        return [self.expressions.lower_condition(part, self.scope) for part in (*parts, *self.of.looked_up)]

    def _lower_connect_test(self) -> list[Node]:
        """The condition of CONNECT BY if it can fail, so that it is evaluated before the rest."""
        made = self.made
        if made is None or is_free(self.search.stop, self.query.where, self.search.weight, *self.of.compared, made):
            return []
        return [self.expressions.lower_condition(made, self.scope)]

    # --- whether it enters -----------------------------------------------------------------------------

    def lower_entering(self) -> list[Node]:
        new, alive = self._is_new(), self._lower_goes_on_or_goal()
        weighed = [] if self.of.total is None else self._lower_weight_tests()
        weighs = self.best and not new
        if weighs:
            new, weighed = weighed, []
        # What SQLite computes by itself is evaluated before what calls Python.
        calls = self._do_call_python(alive) or bool(self.of.shared)
        by_row = self.search.by == "row"
        new_first = calls and by_row and not (weighs and not is_free(self.search.weight))
        made = self._lower_connect_test()
        conditions = [*made, *(new + alive if new_first else alive + new), *weighed]
        key = () if by_row else (*self.of.compared, *(expr for _, expr in self.search.connect))
        if made or (alive and not is_free(self.search.weight, *key)):
            # STOP WITH guards the weight and the key; parts of AND SQLite evaluates as early as it can.
            return [sql_builder.case_in_order(conditions)]
        return conditions

    def _do_call_python(self, drops: list[Node]) -> bool:
        return any(map(sql_builder.calls_python, drops))

    def _is_new(self) -> list[Node]:
        """Whether the row is new; `improves` is stricter than `closed`, but needs the weight."""
        name = self.of.guard.repeat_test
        if name is None:
            return []
        arguments: list[Node] = []
        if name == "on_path":
            arguments.append(self.parent.copy())
        elif self.of.total is not None:
            weights = (self.search.weight, self.search.heuristic)
            if not any(clause is not None and is_costly(clause) for clause in weights):
                return []
            arguments.append(self.of.rank_total(self.of.column(self.of.total)))
        if self.first and name in ("on_path", "closed") and not self.of.keyed:
            return []  # nothing was met yet
        return [negate(sql_builder.call(name, *arguments, *self.lower_key()))]

    def _lower_goes_on_or_goal(self) -> list[Node]:
        """Whether the step goes on or is a goal; a part of STOP WITH that is never true of goals stands alone."""
        conditions = [negate(self.expressions.lower_condition(part, self.scope)) for part in self.of.stops.others]
        drops = self.of.stops.pruning_condition
        if drops is not None:
            conditions.append(
                sql_builder.disjunction(
                    [negate(self.expressions.lower_condition(drops, self.scope)), self.lower_goal()]
                )
            )
        return conditions

    def _lower_weight_tests(self) -> list[Node]:
        """The conditions on COST or PROBABILITY of a step."""
        tests: list[Node] = []
        if self.search.order == "probability":
            tests.append(sql_builder.binary(exp.GT, self.lower_weight(), sql_builder.number(0)))
        if self.best:
            tests.append(sql_builder.call("improves", self.of.rank_total(self.lower_total()), *self.lower_key()))
        return tests

    # --- what it carries -------------------------------------------------------------------------------

    def lower_columns(self) -> list[Node]:
        """The columns of the recursive table."""
        of = self.of
        carried: dict[str | None, Node] = {"step": self._number_step(), "parent": self.parent}
        if of.depth is not None:
            one = sql_builder.number(1)
            carried[of.depth] = one if self.first else sql_builder.binary(exp.Add, of.column(of.depth), one)
        if of.goal is not None:
            carried[of.goal] = self.lower_goal()
        if of.continues_column is not None:
            # Whatever enters goes on, unless it is a goal: only then STOP WITH is evaluated once more.
            both = not self._do_call_python([self.lower_goal()])
            if of.stops.pruning_condition != of.stops.goals and both:
                carried[of.continues_column] = negate(self.lower_goal())
            else:
                calls = both and self._do_call_python([self.lower_stop()])
                carried[of.continues_column] = (
                    sql_builder.case([(self.lower_goal(), negate(self.lower_stop()))], sql_builder.number(1))
                    if calls
                    else negate(self.lower_stop())
                )
        if of.waits is not None:
            carried[of.waits] = sql_builder.number(0) if self.query.where is None else negate(self.lower_goal())
        if of.total is not None:
            carried[of.total] = self.lower_total()
        if of.estimate is not None:
            carried[of.estimate] = self._choose_by_goal(sql_builder.number(0), self.lower_estimate())
            if of.rank is not None:
                later = sql_builder.binary(exp.Add, self.lower_total(), self.lower_estimate())
                carried[of.rank] = self._choose_by_goal(self.lower_total(), later)
            if of.later is not None:
                # Only a goal waits twice, and needs the estimate when it has come out.
                estimate = self.lower_estimate()
                heuristic = self.search.heuristic
                checked = heuristic is not None and not is_within_bound(heuristic.type, of.most)
                if of.admits_stopping_goals and (checked or not is_free(heuristic)):
                    estimate = self._write_null_if_stopped(estimate, sql_builder.number(0))
                carried[of.later] = self._choose_by_goal(estimate, sql_builder.null())
        for name, key in zip(of.siblings, self.search.siblings, strict=True):
            carried[name] = self.expressions.lower_expr(key.expr, self.scope)
        for name in of.variables:
            node = self.next[(self.query.id, name)].copy()
            anyway = name not in of.assigned or of.can_assign_when_stopped(name)
            carried[of.states[name]] = node if anyway else self._write_null_if_stopped(node, sql_builder.null())
        for name, short in of.before.items():
            carried[short] = self.scope.states[(self.query.id, name)].copy()
        for short, read in of.reads:
            carried[short] = self.expressions.lower_expr(read, self.scope)
        return [carried[name] for name in of.all_column_names]

    def _number_step(self) -> Node:
        """The number of the step; it notes the step's row with it."""
        guard = self.of.guard
        # Depth first, a row is marked when its step is taken.
        number = "enter" if guard.number == "enter_first" and self.of.depth is not None else guard.number
        rank = [self.of.rank_total(self.lower_total())] if self.best else []
        if self.of.all_results or self.of.steps_unkept:
            return sql_builder.call("next_number")
        # The repeat test that was evaluated last knows the row: `enter_first` and `enter_best` take it from there.
        row = self.lower_row() if number == "enter" or self.of.keyed else []
        return sql_builder.call(number, self.parent.copy(), *rank, *row)

    def _choose_by_goal(self, then: Node, otherwise: Node) -> Node:
        """One value for goals, another one for other steps; without WHERE each step is a goal."""
        return then if self.query.where is None else sql_builder.case([(self.lower_goal(), then)], otherwise)

    def _write_null_if_stopped(self, node: Node, otherwise: Node) -> Node:
        return sql_builder.case([(self.lower_stop(), otherwise)], node)

    # --- weights ---------------------------------------------------------------------------------------

    def lower_weight(self) -> Node:
        weight = self.search.weight
        assert weight is not None
        return self._lower_checked(weight, f"step_{self.search.order}")

    def lower_estimate(self) -> Node:
        assert self.search.heuristic is not None
        return self._lower_checked(self.search.heuristic, "step_heuristic")

    def _lower_checked(self, expr: plan.Expr, check: str) -> Node:
        node = self.expressions.lower_expr(expr, self.scope)
        if is_within_bound(expr.type, self.of.most):
            return node
        return sql_builder.call(check, node, self.expressions.write_place(expr.span))

    def lower_total(self) -> Node:
        """The total of the path with this step."""
        of = self.of
        assert of.total is not None
        if self.first:
            return self.lower_weight()
        kind = exp.Mul if self.search.order == "probability" else exp.Add
        return sql_builder.binary(kind, of.column(of.total), self.lower_weight())


@dataclass(frozen=True, slots=True)
class StopConditions:
    """STOP WITH, split by what it says of goals and of other steps; None: nothing.

    `others` is never true of a goal: these steps do not enter. `goals` is the rest; `drops` is the part of it that
    drops steps which are no goals: of `STOP WITH there OR far` it is `far`.
    """

    others: tuple[plan.Expr, ...] = ()
    goals: plan.Expr | None = None
    pruning_condition: plan.Expr | None = None


def split_stop_conditions(query: plan.Query) -> StopConditions:
    """Splits STOP WITH.

    A part on its own reads the last source; SQLite would evaluate one of the state alone before it makes the steps.
    """
    stop = None if query.search is None else query.search.stop
    goal = query.where
    if stop is None:
        return StopConditions()
    parts = stop.parts if isinstance(stop, plan.Or) else (stop,)
    apart = [part for part in parts if query.sources[-1].id in list_sources(part)]
    if goal is None:
        return StopConditions((stop,))
    assert not is_volatile(goal), "a search that calls volatile functions is not lowered"
    others = tuple(part for part in apart if are_exclusive(part, goal))
    left = tuple(part for part in parts if part not in others)
    drops = tuple(part for part in left if part != goal)
    return StopConditions(others, *(join_conditions(plan.Or, s, stop.span) if s else None for s in (left, drops)))


def are_exclusive(one: plan.Expr, other: plan.Expr) -> bool:
    """Whether two conditions are never true together, such as `x == 1` and `x != 1`."""
    return any(
        a == c and not can_be_equal(b.type, d.type)
        for part in split_and(other)
        for a, b in get_equality_sides(one)
        for c, d in get_equality_sides(part)
    )


def is_within_bound(kind: Type, most: float) -> bool:
    """Whether the type promises numbers from 0 to `most`; a bool among other values is a handle."""
    return (kind.is_only(Kind.INT | Kind.FLOAT) or is_flag(kind)) and kind.is_at_least(0) and kind.is_bounded(most)


# --- `lookup`: what a step of a search must equal lest it leaves no trace is looked up, not found by going through al
def find_step_equalities(query: plan.Query) -> list[plan.Expr]:
    """The equalities of a search that every step must meet; none of them can fail."""
    search = query.search
    if search is None or search.stop is None:
        return []
    wanted = None if query.where is None else list_free_parts(query.where, plan.And)
    found: list[plan.Expr] = []
    for part in list_free_parts(search.stop, plan.Or):
        equality = _get_denied_equality(part)
        if equality is not None and (wanted is None or equality in wanted):
            found.append(equality)
    return found


def simplify_by_equalities(query: plan.Query, known: list[plan.Expr]) -> plan.Query:
    """The query for steps that meet these equalities: WHERE and STOP WITH without what is known of such a step."""
    search = query.search
    if search is None or search.stop is None or not known:
        return query
    stop = _remove_known_parts(search.stop, plan.Or, lambda part: _get_denied_equality(part) in known)
    where = None if query.where is None else _remove_known_parts(query.where, plan.And, known.__contains__)
    if where is None and stop is not None:
        where = query.where  # without it a step that stops would be no goal
    return replace(query, where=where, search=replace(search, stop=stop))


def _remove_known_parts(
    clause: plan.Expr, kind: type[plan.And] | type[plan.Or], is_known: Callable[[plan.Expr], bool]
) -> plan.Expr | None:
    """A clause without the parts that are known; None where nothing is left of it."""
    parts = clause.parts if isinstance(clause, kind) else (clause,)
    left = [part for part in parts if not is_known(part)]
    return join_conditions(kind, left, clause.span) if left else None


def _get_denied_equality(part: plan.Expr) -> plan.Expr | None:
    """The equality that a part of STOP WITH denies."""
    match part:
        case plan.Call(function=plan.Function(name="ne", builtin=True) as function):
            return replace(part, function=replace(function, name="eq"))
        case _:
            return None
