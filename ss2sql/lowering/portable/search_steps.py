"""The steps of a search as SQL: one SELECT makes all steps from the states of a level.

They are made from `steps`, which has those of the level before (`depth`) with the columns of their row, and one for
each START WITH variable that none of these has; `goes_on` says which are expanded. `elements` has what is read of the
sources, one row for each combination. A step's `place` is that of its state and its combination. Conditions of a query
in FROM that read the state join the two: `FROM (SELECT * FROM edges WHERE src == node)` is `elements.src = steps.node`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import sqlglot
from sqlglot import exp

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, INT, Kind
from ss2sql.language.plan_traversal import find_direct_assignments, list_states, split_and, walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.from_clause import can_lower_into_join
from ss2sql.lowering.portable.portable_expressions import (
    PortableExpressions,
    build_refusal,
    cast_literal,
    get_sql_column_type,
    is_nullable,
)
from ss2sql.lowering.portable.portable_flat import ColumnNames
from ss2sql.lowering.sqlite_expressions import SqlScope

MAX_ELEMENTS = 1 << 24  # of a state; a place is a step and an element, in 64 bits
Node = exp.Expr


@dataclass(frozen=True, slots=True)
class TypedColumn:
    """A column: its name and its type in SQL."""

    name: str
    type: str

    def __str__(self) -> str:
        return f"{self.name} {self.type}"


@dataclass(frozen=True, slots=True)
class StepSelect:
    """The steps of a search as a SELECT."""

    tries: str  # the SELECT, with the columns place, `rows`, goal, goes_on, and `own`
    rows: tuple[TypedColumn, ...]
    own: tuple[TypedColumn, ...]
    states: tuple[TypedColumn, ...]  # for each START WITH variable its column after a step, of `rows` or `own`
    reads: tuple[TypedColumn, ...]  # the columns of `elements` beside `nth`
    elements: plan.Query | None  # the query that gives the elements
    parameters: dict[str, str]  # script variable -> what stands for it in the text
    counted: str | None = None  # a SELECT that counts the elements of all states; None: each state has all of them

    def match_columns(self, state: Sequence[Any] | None) -> dict[TypedColumn, Any]:
        """The columns that have a state, with their values; none where there is no state."""
        return {} if state is None else dict(zip(self.states, state, strict=True))


def write_portable_steps(query: plan.Query, apart: bool = False) -> StepSelect:
    """The steps of a search as SQL. Raises UnsupportedError where they could mean something else, or need Python.

    Args:
        query: the search.
        apart: the states that are expanded have a table `frontier` of their own.
    """
    return _StepWriter(query).write_steps(apart)


class _StepWriter:
    def __init__(self, query: plan.Query) -> None:
        assert query.search is not None
        self.query, self.search = query, query.search
        self.portable = PortableExpressions()
        self.reads: list[tuple[plan.Expr, TypedColumn]] = []
        for node in walk(query):
            if isinstance(node, plan.Call) and not node.function.builtin:
                raise build_refusal(f"{node.function.name} is a Python function", node.span)
        self.names, self.element_names = ColumnNames(), ColumnNames()
        assigned = {expr: name for name, expr in self.search.connect}
        self.rows = tuple(
            TypedColumn(
                self.names.claim(assigned.get(output.expr, output.name), "row"), self._get_sql_type(output.expr)
            )
            for output in query.columns
        )
        self.states = self._list_state_columns()
        self.sources: list[plan.Source] = []
        self.conditions: list[plan.Expr] = []  # of queries in FROM
        before = {(query.id, name): sql_builder.column(kept.name, "frontier") for name, kept in self.states}
        self.name_scope = SqlScope({}, before)
        for source in query.sources:
            self._open_source(source)

    def _get_sql_type(self, expr: plan.Expr) -> str:
        kind = expr.type
        found = get_sql_column_type(kind)
        if found is None or is_nullable(kind):
            raise build_refusal("the kind of this value is not known, or may be None", expr.span)
        if kind.may_be(Kind.FLOAT) and self.search.repeats != "allowed":
            raise build_refusal("rows with floats are not compared in the same way everywhere", expr.span)
        return found

    def _list_state_columns(self) -> list[tuple[str, TypedColumn]]:
        """The column for each START WITH variable."""
        shown = {output.expr: column for output, column in zip(self.query.columns, self.rows, strict=True)}
        at_once, kinds = find_direct_assignments(self.query), dict(self.search.states)
        states: list[tuple[str, TypedColumn]] = []
        for name, start in self.search.start:
            kind = get_sql_column_type(kinds[name])
            if kind is None or is_nullable(kinds[name]):
                raise build_refusal("the kind of this variable is not known, or may be None", start.span)
            column = shown.get(at_once[name]) if name in at_once else None
            # Two that are equal after each step can differ at the start.
            if column is None or column.type != kind or any(column == other for _, other in states):
                column = TypedColumn(self.names.claim(name, "state"), kind)
            states.append((name, column))
        return states

    def _open_source(self, source: plan.Source) -> None:
        """Makes a source visible; of a query in FROM that is a join, its sources, conditions, and columns."""
        if not isinstance(source, plan.QuerySource) or source.optional or not can_lower_into_join(source.query):
            self._check_source(source)
            self.sources.append(source)
            self.name_scope = self.name_scope.with_source(source.id, partial(self._read_column, source))
            return
        for inner in source.query.sources:
            self._open_source(inner)
        self.conditions += split_and(source.query.where)
        columns = {output.name: output.expr for output in source.query.columns}

        def read_column(expr: plan.Element | plan.Column) -> Node:
            assert isinstance(expr, plan.Column), "a whole row is a dict, which has no type there"
            return self.portable.lower_expr(columns[expr.name], self.name_scope)

        self.name_scope = self.name_scope.with_source(source.id, read_column)

    def _check_source(self, source: plan.Source) -> None:
        """That the source has the same elements for all states."""
        own = set(self.name_scope.sources)
        for node in walk(source):
            if isinstance(node, plan.State) and node.query == self.query.id:
                raise build_refusal("what stands in FROM depends on the state", source.span)
            if isinstance(node, (plan.Element, plan.Column)) and node.source in own:
                raise build_refusal("what stands in FROM depends on another source", source.span)

    def _read_column(self, source: plan.Source, expr: plan.Element | plan.Column) -> Node:
        for known, column in self.reads:
            if known == expr:
                return sql_builder.column(column.name, "elements")
        kind = get_sql_column_type(expr.type)
        assert kind is not None, "`PortableExpressions.lower_expr` has looked"
        name = expr.name if isinstance(expr, plan.Column) else source.name
        self.reads.append((expr, TypedColumn(self.element_names.claim(name, "element"), kind)))
        return sql_builder.column(self.reads[-1][1].name, "elements")

    def _query_elements(self) -> plan.Query:
        """What is read of the sources, for each combination in their order that may be one of elements."""
        fixed = [part for part in self.conditions if not list_states(part)]
        return replace(
            self.query,
            columns=tuple(plan.Output(column.name, expr) for expr, column in self.reads),
            sources=tuple(self.sources),
            where=plan.And(tuple(fixed), BOOL, span=self.query.span) if fixed else None,
            search=None,
            group=(),
            having=None,
            order=(),
            limit=None,
            aggregated=False,
            representation=plan.Representation("rows"),
        )

    # --- the statement -----------------------------------------------------------------------------------

    def write_steps(self, apart: bool) -> StepSelect:
        goal, goes_on, kept = self._write_flags()
        if any(map(list_states, self.conditions)) and (self.query.group or self.query.order):
            reason = "GROUP BY and ORDER BY read the elements of a state, which are chosen in FROM"
            raise build_refusal(reason, (*self.query.group, *(key.expr for key in self.query.order))[0].span)
        joined = [self.portable.lower_condition(part, self.name_scope) for part in self.conditions if list_states(part)]
        place: Node = sqlglot.parse_one(f"frontier.step * {MAX_ELEMENTS} + elements.nth", read="duckdb")
        outputs: list[Node] = [sql_builder.alias(place, "place")]
        for output, column in zip(self.query.columns, self.rows, strict=True):
            outputs.append(self._cast_column(self.portable.lower_expr(output.expr, self.name_scope), column))
        outputs += [sql_builder.alias(goal, "goal"), sql_builder.alias(goes_on, "goes_on")]
        following = self._write_next_state()
        own = [(name, column) for name, column in self.states if column not in self.rows]
        outputs += [self._cast_column(following[name], column) for name, column in own]
        expanded: Node = sqlglot.parse_one("frontier.depth = :depth - 1 AND frontier.goes_on", read="duckdb")
        frontier = sql_builder.table("frontier", "frontier") if apart else sql_builder.table("steps", "frontier")
        items = [frontier, sql_builder.table("elements", "elements")]
        matched = joined if apart else [expanded, *joined]
        select = sql_builder.select(outputs, items, sql_builder.conjunction([*matched, *kept]))
        if not self.reads:  # a table has a column
            self.reads.append((plan.Constant(0, INT, span=self.query.span), TypedColumn("nothing", "BIGINT")))
        count = sql_builder.select([exp.Count(this=exp.Star())], items, sql_builder.conjunction(matched))
        states = tuple(column for _, column in self.states)
        return StepSelect(
            select.sql("duckdb"),
            self.rows,
            tuple(column for _, column in own),
            states,
            tuple(column for _, column in self.reads),
            self._query_elements(),
            self.portable.parameters,
            count.sql("duckdb") if joined else None,
        )

    def _write_flags(self) -> tuple[Node, Node, list[Node]]:
        """Whether a step is a goal, whether the search goes on from it, and the conditions of those that are kept."""
        where, stop = self.query.where, self.search.stop
        goal = exp.true() if where is None else self.portable.lower_condition(where, self.name_scope)
        if stop is None:
            return goal, exp.true(), []
        wanted = stop.parts if isinstance(stop, plan.Or) else (stop,)
        parts = [self.portable.lower_condition(part, self.name_scope) for part in wanted]
        goes_on = sql_builder.join_by_and([sql_builder.negate(part) for part in parts])
        if where is None:
            return goal, exp.true(), [goes_on]  # what stops leaves no trace
        return goal, goes_on, [sql_builder.disjunction([goes_on.copy(), goal.copy()])]

    def _write_next_state(self) -> dict[str, Node]:
        """The state after a step; a later assignment sees an earlier one."""
        states = dict(self.name_scope.states)
        for name, expr in self.search.connect:
            states[self.query.id, name] = self.portable.lower_expr(expr, SqlScope(self.name_scope.sources, states))
        return {name: states[self.query.id, name].copy() for name, _ in self.search.start}

    def _cast_column(self, node: Node, column: TypedColumn) -> Node:
        return sql_builder.alias(cast_literal(node, column.type), column.name)


def build_sql_limit_error(what: str) -> UnsupportedError:
    return UnsupportedError("U001", f"{what} has more than {MAX_ELEMENTS:,} elements", hints=("bound FROM",))
