"""Expressions as SQL.

    WHERE n.x == max(SELECT e.x FROM e = es WHERE e.k == n.k AS list)

    WHERE n.x IS coalesce(
      recall(1, n.k),
      remember(1, n.k, (SELECT max(e.x) FROM es_once AS e WHERE e.k = n.k))
    )

The query is evaluated once for each value of what it reads of the rows around it: 4,000 rows in 10 groups take 0.02 s
so, 0.8 s where each row walks over its group. None is not remembered.

An expression whose type is bool alone is a *flag* in SQL, the integer 0 or 1, never NULL. Every other
expression is a *value*: None, numbers and strings are themselves, all else is a handle of the interning (see
runtime/sqlite/interning.py). SQLite's own operators are used only where the types promise that they do what the
language demands; everything else is a call of the function of the language, whose last argument is the
place in the script, for its errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import TypeAlias, TypeVar

from sqlglot import exp

from ss2sql.errors import NOWHERE, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, Kind, Type, is_flag
from ss2sql.language.operations import OPERATIONS, PREDICATES
from ss2sql.language.operations.operation import find_sql_class
from ss2sql.language.plan_traversal import (
    has_constant_source,
    list_inside,
    list_parts,
    list_sources,
    walk,
    walk_own,
)
from ss2sql.lowering import sql_builder, sqlite_forms
from ss2sql.lowering.equality import SPECIAL_OPERATIONS
from ss2sql.lowering.guards import can_be_parameter, is_in_order
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import get_builtin_name
from ss2sql.lowering.statement_needs import StatementNeeds

_EXTREMES: dict[str, type[exp.AggFunc]] = {"max": exp.Max, "min": exp.Min}


def lower_function_of_rows(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """A call of a built-in function on the list that a query gives; None for any other call."""
    match call.arguments:
        case (plan.Subquery(query=query) as inner,) if query.representation.name in ("list", "rows", "dict"):
            aggregate = _choose_aggregate(lowering, call, query)
            if aggregate is None:
                node = lowering.call_python(call, scope)
            else:
                node = exp.Subquery(this=lowering.lower_unordered(inner, scope, aggregate))
            return lower_memoized_reduction(lowering, call, node, scope) if has_constant_source(query) else node
        case _:
            return None


def _choose_aggregate(
    lowering: ExpressionLowering, call: plan.Call, query: plan.Query
) -> Callable[[SqlScope], Node] | None:
    """The aggregate of SQL that makes the same of the rows as the function of their list: of values of one kind."""
    name, column = call.function.name, query.columns[0].expr
    if query.search or query.group or query.limit or len(query.columns) > 1 or query.columns[0].star:
        return None
    if name == "len":
        return lambda scope: exp.Count(this=exp.Star())
    # An aggregate belongs to the innermost query whose columns it mentions.
    own = not list_sources(column).isdisjoint(source.id for source in query.sources)
    plain = any(column.type.kinds == kind for kind in (Kind.INT, Kind.FLOAT, Kind.STR))
    if name in _EXTREMES and own and plain and query.representation.name == "list":
        return lambda scope: _EXTREMES[name](this=lowering.lower_expr(column, scope))
    return None


def lower_memoized_reduction(lowering: ExpressionLowering, call: plan.Call, node: Node, scope: SqlScope) -> Node:
    """The value, which is computed once for each of the values that it reads of the rows around it."""
    inside = list_inside(call)
    queries = {part.id for part in walk(call) if isinstance(part, plan.Query)}
    keys: list[Node] = []
    parts: list[plan.Node] = [call]
    while parts:
        part = parts.pop()
        if (known := scope.get_known(part)) is not None:
            keys.append(known)
            continue
        match part:
            case plan.Element(source=source) | plan.Column(source=source) if source not in inside:
                keys.append(lowering.lower_value(part, scope))
            case plan.State(query=query) | plan.GroupKey(query=query) if query not in queries:
                keys.append(lowering.lower_value(part, scope))
        parts.extend(reversed(list(list_parts(part))))
    if not keys and not sql_builder.calls_python(node):
        return node  # SQLite evaluates it once
    number = sql_builder.number(lowering.needs.number_reduction(call))
    different = list(dict.fromkeys(keys))
    found = sql_builder.call("recall", number, *(key.copy() for key in different))
    return sql_builder.call("coalesce", found, sql_builder.call("remember", number.copy(), *different, node))


# --- expressions as SQL
N = TypeVar("N")
Reader: TypeAlias = Callable[[plan.Element | plan.Column], Node]


@dataclass(frozen=True, slots=True)
class SqlScope:
    """How sources and START WITH variables are read in the SQL scope at hand: a flag where the type is bool alone."""

    sources: Mapping[int, Reader] = field(default_factory=dict)
    states: Mapping[tuple[int, str], Node] = field(default_factory=dict)
    groups: Mapping[tuple[int, int], Node] = field(default_factory=dict)
    known: tuple[tuple[plan.Expr, Callable[[], Node]], ...] = ()  # what stands in a column already, read when needed
    again: bool = False  # what stands here is evaluated any number of times, maybe never

    def with_source(self, source: int, reader: Reader) -> SqlScope:
        return replace(self, sources={**self.sources, source: reader})

    def with_states(self, states: Mapping[tuple[int, str], Node]) -> SqlScope:
        return replace(self, states={**self.states, **states})

    def get_known(self, expr: plan.Node) -> Node | None:
        """The column in which the expression stands already, if any."""
        return next((read().copy() for known, read in self.known if known == expr), None)

    def enter_query(self) -> SqlScope:
        """The scope of a query in an expression: aggregates belong to the innermost query."""
        kept = [one for one in self.known if not any(isinstance(node, plan.Aggregate) for node in walk_own(one[0]))]
        return replace(self, known=tuple(kept), again=True)

    def with_groups(self, groups: Mapping[tuple[int, int], Node]) -> SqlScope:
        return replace(self, groups={**self.groups, **groups})


class ExpressionLowering:
    """Lowers the expressions of one statement; `needs` collects what they require.

    What is written in another way in databases with typed columns, portable/portable_expressions.py replaces.
    """

    _lowered: dict[tuple[int, int], tuple[plan.Expr, SqlScope, Node]] | None = None

    def __init__(
        self,
        needs: StatementNeeds,
        subquery: Callable[[plan.Query, SqlScope], Node],
        rows: Callable[[plan.Query, SqlScope, Callable[[SqlScope], Node]], exp.Select],
    ) -> None:
        self.needs = needs
        self.subquery = subquery
        self.rows = rows

    def lower_value(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """The expression as a value."""
        node = self.lower_expr(expr, scope)
        return self.box_flag(node) if is_flag(expr.type) else node

    def box_flag(self, flag: Node) -> Node:
        """A flag as a value: True or False."""
        return sql_builder.case([(flag, self.needs.bind_value(TRUE, "true"))], self.needs.bind_value(FALSE, "false"))

    def unbox_value(self, node: Node, kind: Type) -> Node:
        """A value in the form of its type: a bool becomes a flag."""
        return sql_builder.binary(exp.NullSafeEQ, node, self.needs.bind_value(TRUE, "true")) if is_flag(kind) else node

    def lower_condition(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """The truth of an expression as a flag."""
        node = self.lower_expr(expr, scope)
        kind = expr.type
        if is_flag(kind):
            return node
        if kind.is_only(Kind.INT | Kind.FLOAT):
            return sql_builder.binary(exp.NEQ, node, sql_builder.number(0))
        if kind.is_only(Kind.STR):
            return sql_builder.binary(exp.NEQ, node, sql_builder.string(""))
        if kind.is_only(Kind.NONE | Kind.NUMBER | Kind.LIST | Kind.DICT):
            # A handle begins with the number that SQLite takes for its truth.
            return exp.Is(this=sql_builder.wrap_operand(node), expression=exp.true())
        return sql_builder.call("truth", node)

    def lower_expr(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """The expression as a flag or a value, by its type.

        Subexpressions are kept until the whole is lowered: some are lowered twice, and n of them inside each other
        would take 2^n steps.
        """
        outermost = self._lowered is None
        lowered = self._lowered = {} if self._lowered is None else self._lowered
        key = id(expr), id(scope)
        if key in lowered:
            return lowered[key][-1].copy()
        try:
            node = self._lower_node(expr, scope)
        finally:
            if outermost:
                self._lowered = None
        lowered[key] = expr, scope, node  # with what has the identities, lest others come to have them
        return node

    def _lower_node(self, expr: plan.Expr, scope: SqlScope) -> Node:
        if (known := scope.get_known(expr)) is not None:
            return known
        match expr:
            case plan.Constant():
                return self.lower_constant(expr)
            case plan.Variable():
                return self.lower_variable(expr)
            case plan.Element(source=source) | plan.Column(source=source):
                return scope.sources[source](expr)
            case plan.State(query=query, name=name):
                return scope.states[(query, name)].copy()
            case plan.Call():
                return self.lower_call(expr, scope)
            case plan.And(parts=parts):
                return self.lower_and(parts, scope)
            case plan.Or(parts=parts):
                return self.lower_or(parts, scope)
            case plan.Xor(left=left, right=right):
                one, other = self.lower_condition(left, scope), self.lower_condition(right, scope)
                return sql_builder.binary(exp.NEQ, one, other)
            case plan.Not(operand=operand):
                return exp.Not(this=sql_builder.wrap_operand(self.lower_condition(operand, scope)))
            case plan.If():
                return self.lower_if(expr, scope)
            case plan.MakeList():
                return self.lower_list(expr, scope)
            case plan.GroupKey(query=query, index=index):
                return scope.groups[(query, index)].copy()
            case plan.Aggregate(argument=argument):
                if argument is None:
                    return exp.Count(this=exp.Star())
                return self.write_aggregate(expr, self.lower_value(argument, scope))
            case _:
                return self.lower_query(expr, scope)

    def lower_query(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """A query in an expression."""
        assert isinstance(expr, plan.Subquery), "all others are declared in unsupported.py"
        return self.unbox_value(self._lower_query(self.subquery, expr, scope), expr.type)

    def lower_exists(self, expr: plan.Subquery, scope: SqlScope) -> Node:
        """Whether a query has a row, as a flag."""
        return exp.Exists(this=self.lower_unordered(expr, scope, lambda scope: sql_builder.number(1)))

    def lower_unordered(self, expr: plan.Subquery, scope: SqlScope, output: Callable[[SqlScope], Node]) -> exp.Select:
        """A value computed from the rows of a query in any order."""
        return self._lower_query(lambda query, scope: self.rows(query, scope, output), expr, scope)

    def _lower_query(self, lower: Callable[[plan.Query, SqlScope], N], expr: plan.Subquery, scope: SqlScope) -> N:
        outer, self._lowered = self._lowered, None  # the parts of a query change after they are lowered
        try:
            return lower(expr.query, scope.enter_query())
        finally:
            self._lowered = outer

    def lower_constant(self, expr: plan.Constant) -> Node:
        value = expr.value
        match value:
            case None:
                return sql_builder.null()
            case bool():
                return sql_builder.number(int(value))
            case int() if abs(value) < 2**53:
                return sql_builder.number(value)
            case float() if _prints_exactly(value):
                return sql_builder.number(value)
            case str() if value.isprintable() and len(value) <= 200:
                return sql_builder.string(value)
            case _:
                return self.needs.bind_value(expr)

    def lower_variable(self, expr: plan.Variable) -> Node:
        return self.needs.bind_value(expr, expr.name, is_flag(expr.type))

    def lower_list(self, expr: plan.MakeList, scope: SqlScope) -> Node:
        if can_be_parameter(expr):
            return self.needs.bind_value(expr)
        return sql_builder.call("list", *(self.lower_value(item, scope) for item in expr.items))

    def lower_call(self, expr: plan.Call, scope: SqlScope) -> Node:
        function = expr.function
        if not function.builtin:
            name = self.needs.name_function(function.name, expr.place)
            return self.unbox_value(
                sql_builder.call(name, *(self.lower_value(a, scope) for a in expr.arguments)), expr.type
            )
        reduced = lower_function_of_rows(self, expr, scope)
        if reduced is not None:
            return reduced
        by_hand = SPECIAL_OPERATIONS.get(function.name, sqlite_forms.lower_unchecked)
        node = by_hand(self, expr, scope)
        if node is not None:
            return node
        if can_be_parameter(expr):
            return self.needs.bind_value(expr, None, is_flag(expr.type))
        node = sqlite_forms.lower_checked(self, expr, scope)
        if node is not None:
            return node
        return self.call_python(expr, scope)

    def call_python(self, expr: plan.Call, scope: SqlScope, rarely: bool = False) -> Node:
        """A call of the language's own function on values."""
        arguments = _list_items(expr) or expr.arguments
        node = self.write_python_call(expr, [self.lower_value(argument, scope) for argument in arguments])
        return sql_builder.mark_sql_as_rare(node) if rarely else node

    def write_python_call(self, expr: plan.Call, arguments: Sequence[Node]) -> Node:
        node = sql_builder.call(get_builtin_name(expr.function.name), *arguments, self.write_place(expr.place))
        return node if expr.function.name in PREDICATES else self.unbox_value(node, expr.type)

    def read_field(self, element: Node, column: plan.Column) -> Node:
        """A column that is looked up in the element when it is read."""
        return sql_builder.call("field", element, sql_builder.string(column.name), self.write_place(column.span))

    def write_place(self, span: Span) -> Node:
        return sql_builder.string(f"{span.line}:{span.column}")

    def lower_and(self, parts: tuple[plan.Expr, ...], scope: SqlScope) -> Node:
        """A conjunction; CASE keeps later parts from being evaluated where that could be noticed."""
        conditions = [self.lower_condition(part, scope) for part in parts]
        if not is_in_order(parts):
            return sql_builder.join_by_and([sql_builder.keep_condition(condition) for condition in conditions])
        return sql_builder.case_in_order(conditions)

    def lower_or(self, parts: tuple[plan.Expr, ...], scope: SqlScope) -> Node:
        return sql_builder.disjunction(
            [sql_builder.keep_condition(self.lower_condition(part, scope)) for part in parts]
        )

    def lower_if(self, expr: plan.If, scope: SqlScope) -> Node:
        lower = self.lower_expr if is_flag(expr.type) else self.lower_value
        then, otherwise = (lower(branch[-1], scope) for branch in (expr.then, expr.otherwise))
        return sql_builder.case([(self.lower_condition(expr.condition, scope), then)], otherwise)

    def write_aggregate(self, expr: plan.Aggregate, argument: Node) -> Node:
        """The aggregate of an argument that is lowered."""
        node = sqlite_forms.lower_aggregate(expr, argument)
        if node is not None:
            return node
        return self.unbox_value(
            sql_builder.call(f"group_{expr.function}", argument, self.write_place(expr.span)), expr.type
        )


def _list_items(call: plan.Call) -> list[plan.Expr]:
    """The items of lists of numbers that are written out, where the call takes them so: a list costs 1 us to make."""
    if not OPERATIONS[call.function.name].takes_items:
        return []
    lists = [argument.items for argument in call.arguments if isinstance(argument, plan.MakeList)]
    items = [item for one in lists for item in one]
    fits = len(lists) == len(call.arguments) and len(set(map(len, lists))) == 1
    return items if fits and all(find_sql_class(item.type, none=True) == "number" for item in items) else []


def _prints_exactly(value: float) -> bool:
    """Whether SQLite reads the float's shortest text back exactly."""
    digits, _, power = repr(abs(value)).partition("e")
    return len(digits.replace(".", "").strip("0")) <= 15 and (not power or abs(int(power)) <= 20)


TRUE = plan.Constant(True, BOOL, span=NOWHERE)
FALSE = plan.Constant(False, BOOL, span=NOWHERE)
