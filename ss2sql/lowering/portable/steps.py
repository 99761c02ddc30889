"""The steps of a search as SQL: one SELECT makes all steps from the states of a level.

They are made from `steps`, which has those of the level before (`depth`) with the columns of their row, and one for
each START WITH variable that none of these has; `goes_on` says which are expanded. `elements` has what is read of the
sources, one row for each combination. A step's `place` is that of its state and its combination.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import sqlglot
from sqlglot import exp

from ss2sql import plan
from ss2sql.errors import UnsupportedError
from ss2sql.kinds import INT, Kind
from ss2sql.lowering import sql
from ss2sql.lowering.portable.expressions import Portable, Sight
from ss2sql.lowering.portable.names import Names
from ss2sql.lowering.portable.types import column_type, is_nullable, refused, typed
from ss2sql.records import dataclass
from ss2sql.walk import set_at_once, walk

ELEMENTS = 1 << 24  # of a state; a place is a step and an element, in 64 bits
Node = exp.Expr


@dataclass(frozen=True, slots=True)
class Typed:
    """A column: its name and its type in SQL."""

    name: str
    type: str

    def __str__(self) -> str:
        return f"{self.name} {self.type}"


@dataclass(frozen=True, slots=True)
class WrittenSteps:
    """`tries` is the SELECT, with the columns place, `rows`, goal, goes_on, and those of `own`.

    `goal` and `goes_on` are what these columns have in every row, None where it depends on the row.

    `states` names for each START WITH variable the column that has it after a step: one of `rows`, or of `own`.
    `reads` are the columns of `elements` beside `nth`, `elements` the query that gives them. `parameters` are what
    stands for script variables in the text, with these.
    """

    tries: str
    rows: tuple[Typed, ...]
    own: tuple[Typed, ...]
    states: tuple[Typed, ...]
    reads: tuple[Typed, ...]
    elements: plan.Query | None
    parameters: dict[str, str]
    goal: bool | None
    goes_on: bool | None

    def after(self, state: Sequence[Any] | None) -> dict[Typed, Any]:
        """The columns that have a state, with their values; none where there is no state."""
        return {} if state is None else dict(zip(self.states, state, strict=True))


def write_steps(query: plan.Query, apart: bool = False) -> WrittenSteps:
    """The steps of a search as SQL. Raises UnsupportedError where they could mean something else, or need Python.

    Args:
        query: the search.
        apart: the states that are expanded have a table `frontier` of their own.
    """
    return _Writer(query).written(apart)


class _Writer:
    def __init__(self, query: plan.Query) -> None:
        assert query.search is not None
        self.query, self.search = query, query.search
        self.portable = Portable()
        self.reads: list[tuple[plan.Element | plan.Column, Typed]] = []
        for source in query.sources:
            self._check(source)
        for node in walk(query):
            if isinstance(node, plan.Call) and not node.function.builtin:
                raise refused(f"{node.function.name} is a Python function", node.span)
        self.names, self.element_names = Names(), Names()
        assigned = {expr: name for name, expr in self.search.connect}
        self.rows = tuple(
            Typed(self.names.free(assigned.get(output.expr, output.name), "row"), self._type(output.expr))
            for output in query.columns
        )
        self.states = self._states()
        sight = Sight()
        for source in query.sources:
            sight = sight.with_source(source.id, partial(self._read, source))
        before = {(query.id, name): sql.column(kept.name, "frontier") for name, kept in self.states}
        self.sight = Sight(sight.sources, before)

    def _type(self, expr: plan.Expr) -> str:
        kind = expr.type
        found = column_type(kind)
        if found is None or is_nullable(kind):
            raise refused("the kind of this value is not known, or may be None", expr.span)
        if kind.may(Kind.FLOAT) and self.search.repeats != "allowed":
            raise refused("rows with floats are not compared in the same way everywhere", expr.span)
        return found

    def _states(self) -> list[tuple[str, Typed]]:
        """The column for each START WITH variable."""
        shown = {output.expr: column for output, column in zip(self.query.columns, self.rows, strict=True)}
        at_once, kinds = set_at_once(self.query), dict(self.search.states)
        states: list[tuple[str, Typed]] = []
        for name, start in self.search.start:
            kind = column_type(kinds[name])
            if kind is None or is_nullable(kinds[name]):
                raise refused("the kind of this variable is not known, or may be None", start.span)
            column = shown.get(at_once[name]) if name in at_once else None
            # Two that are equal after each step can differ at the start.
            if column is None or column.type != kind or any(column == other for _, other in states):
                column = Typed(self.names.free(name, "state"), kind)
            states.append((name, column))
        return states

    def _check(self, source: plan.Source) -> None:
        """That the source has the same elements for all states."""
        own = {other.id for other in self.query.sources}
        for node in walk(source):
            if isinstance(node, plan.State) and node.query == self.query.id:
                raise refused("what stands in FROM depends on the state", source.span)
            if isinstance(node, (plan.Element, plan.Column)) and node.source in own:
                raise refused("what stands in FROM depends on another source", source.span)

    def _read(self, source: plan.Source, expr: plan.Element | plan.Column) -> Node:
        for known, column in self.reads:
            if known == expr:
                return sql.column(column.name, "elements")
        kind = column_type(expr.type)
        assert kind is not None, "`Portable.value` has looked"
        name = expr.name if isinstance(expr, plan.Column) else source.name
        self.reads.append((expr, Typed(self.element_names.free(name, "element"), kind)))
        return sql.column(self.reads[-1][1].name, "elements")

    def _elements(self) -> plan.Query:
        """What is read of the sources, for each combination in their order."""
        columns = tuple(plan.Output(column.name, expr) for expr, column in self.reads)
        return replace(
            self.query,
            columns=columns or (plan.Output("nothing", plan.Constant(0, INT, span=self.query.span)),),
            where=None,
            search=None,
            group=(),
            having=None,
            order=(),
            limit=None,
            aggregated=False,
            rows=(),
            representation=plan.Representation("rows"),
        )

    # --- the statement -----------------------------------------------------------------------------------

    def written(self, apart: bool) -> WrittenSteps:
        goal, goes_on, kept = self._flags()
        place: Node = sqlglot.parse_one(f"frontier.step * {ELEMENTS} + elements.nth", read="duckdb")
        outputs: list[Node] = [sql.alias(place, "place")]
        for output, column in zip(self.query.columns, self.rows, strict=True):
            outputs.append(self._column(self.portable.value(output.expr, self.sight), column))
        outputs += [sql.alias(goal, "goal"), sql.alias(goes_on, "goes_on")]
        following = self._following()
        own = [(name, column) for name, column in self.states if column not in self.rows]
        outputs += [self._column(following[name], column) for name, column in own]
        expanded: Node = sqlglot.parse_one("frontier.depth = :depth - 1 AND frontier.goes_on", read="duckdb")
        frontier = sql.table("frontier", "frontier") if apart else sql.table("steps", "frontier")
        where = sql.conjunction(kept if apart else [expanded, *kept])
        select = sql.select(outputs, [frontier, sql.table("elements", "elements")], where)
        states = tuple(column for _, column in self.states)
        return WrittenSteps(
            select.sql("duckdb"),
            self.rows,
            tuple(column for _, column in own),
            states,
            tuple(column for _, column in self.reads),
            self._elements(),
            self.portable.parameters,
            _same_everywhere(goal),
            _same_everywhere(goes_on),
        )

    def _flags(self) -> tuple[Node, Node, list[Node]]:
        """Whether a step is a goal, whether the search goes on from it, and what is asked of those that are kept."""
        where, stop = self.query.where, self.search.stop
        goal = exp.true() if where is None else self.portable.condition(where, self.sight)
        if stop is None:
            return goal, exp.true(), []
        goes_on = negated(self.portable.condition(stop, self.sight))
        if where is None or goal == exp.false():
            return goal, exp.true(), [goes_on]  # what stops leaves no trace
        return goal, goes_on, [sql.disjunction([goes_on.copy(), goal.copy()])]

    def _following(self) -> dict[str, Node]:
        """The state after a step; a later assignment sees an earlier one."""
        states = dict(self.sight.states)
        for name, expr in self.search.connect:
            states[self.query.id, name] = self.portable.value(expr, Sight(self.sight.sources, states))
        return {name: states[self.query.id, name].copy() for name, _ in self.search.start}

    def _column(self, node: Node, column: Typed) -> Node:
        """A column of the SELECT."""
        return sql.alias(typed(node, column.type), column.name)


def too_many_elements(what: str) -> UnsupportedError:
    return UnsupportedError("U001", f"{what} has more than {ELEMENTS:,} elements", hints=("bound FROM",))


_OPPOSITE: dict[type[exp.Expr], type[exp.Binary]] = {
    exp.EQ: exp.NEQ,
    exp.NEQ: exp.EQ,
    exp.LT: exp.GTE,
    exp.GTE: exp.LT,
    exp.GT: exp.LTE,
    exp.LTE: exp.GT,
}


def negated(node: Node) -> Node:
    """The opposite of a condition that is never NULL; an equality is what databases look up."""
    if type(node) in _OPPOSITE:
        return sql.binary(_OPPOSITE[type(node)], node.this.copy(), node.expression.copy())
    if isinstance(node, exp.Not):
        inside: Node = node.this.unnest()
        return inside.copy()
    if isinstance(node, exp.Or):
        return sql.binary(exp.And, negated(node.this), negated(node.expression))
    return exp.Not(this=sql.operand(node.copy()))


def _same_everywhere(condition: Node) -> bool | None:
    return bool(condition.this) if isinstance(condition, exp.Boolean) else None
