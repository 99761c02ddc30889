"""Expressions as SQL that means the same everywhere, with the types of typed columns.

Every entry gives the SQL of a call that cannot fail, or None where the types do not promise enough. Numbers are BIGINT
and DOUBLE: integers beside floats only as far as floats hold them. Texts are compared by code point.

They cannot fail, their kinds are known, and a bool is a BOOLEAN. None is NULL, which only comparisons and conditions
meet: they are written so that their truth is never NULL.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from sqlglot import exp

from ss2sql.errors import Error, Span, UnsupportedError
from ss2sql.language import plan
from ss2sql.language.kinds import NOTHING, Kind, Type
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.plan_traversal import list_plan_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.guards import is_free, is_free_by_itself
from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope
from ss2sql.lowering.sqlite_forms import fill_operands

SCALARS = {Kind.INT: "BIGINT", Kind.FLOAT: "DOUBLE", Kind.STR: "VARCHAR", Kind.BOOL: "BOOLEAN"}
EMPTY_VALUES = {
    Kind.BOOL: exp.false(),
    Kind.STR: sql_builder.string(""),
    **dict.fromkeys((Kind.INT, Kind.FLOAT), sql_builder.number(0)),
}
MAX_EXACT_INTEGER = 2.0**53  # integers up to here are floats too


def get_sql_column_type(kind: Type) -> str | None:
    """The type of a column for values of this type, None where there is none; such a column may hold NULL for None."""
    plain = kind.kinds & ~Kind.NONE
    if plain in SCALARS:
        return SCALARS[plain]
    if plain == Kind.LIST and kind.element is not None and not kind.element.may_be(Kind.NONE):
        inner = get_sql_column_type(kind.element)
        return None if inner is None or kind.element.may_be(Kind.FLOAT) else f"{inner}[]"
    return None


def is_nullable(kind: Type) -> bool:
    return kind.may_be(Kind.NONE)


def is_exact_as_float(kind: Type) -> bool:
    """Whether the values are numbers that are the same as floats, whichever of both they are."""
    return kind.kinds == Kind.FLOAT or (kind.kinds == Kind.INT and kind.is_bounded(MAX_EXACT_INTEGER))


def write_cast(node: exp.Expr, kind: str) -> exp.Expr:
    return exp.Cast(this=node, to=exp.DataType.build(kind, dialect="duckdb"))


def cast_literal(node: exp.Expr, kind: str | None) -> exp.Expr:
    """A value as a column of this type, if it has one: literals alone would have the smallest."""
    return node if node.find(exp.Column) or kind in (None, "BOOLEAN") else write_cast(node, kind)


CURE = "leave engine and dialect to ss2sql, or run the script with engine='native'"


def build_refusal(reason: str, span: Span, cure: str = CURE) -> UnsupportedError:
    """What is raised where SQL of other databases could mean something else."""
    return UnsupportedError("U001", reason, span, (cure,))


# --- equality and membership, which have no forms, each under the types for which its meaning is the same
WriteFunction: TypeAlias = "Callable[[PortableExpressions, plan.Call, SqlScope], Node | None]"


def _are_comparable(left: Type, right: Type) -> bool:
    """Whether both have one type in SQL, or are numbers that compare exactly."""
    one, other = (Type(kind.kinds & ~Kind.NONE, kind.low, kind.high, kind.element) for kind in (left, right))
    return get_sql_column_type(one) == get_sql_column_type(other) is not None or (
        is_exact_as_float(one) and is_exact_as_float(other)
    )


def _write_equality(of: PortableExpressions, call: plan.Call, scope: SqlScope) -> Node | None:
    equal = call.function.name == "eq"
    nodes = [of.lower_expr(argument, scope) for argument in call.arguments]
    for known, other in (nodes, reversed(nodes)):
        if isinstance(known, exp.Null):
            test: Node = exp.Is(this=sql_builder.wrap_operand(other), expression=exp.Null())
            return test if equal else exp.Not(this=test)
    left, right = (argument.type for argument in call.arguments)
    if not _are_comparable(left, right):
        return None
    if is_nullable(left) or is_nullable(right):
        return sql_builder.binary(exp.NullSafeEQ if equal else exp.NullSafeNEQ, *nodes)
    return sql_builder.binary(exp.EQ if equal else exp.NEQ, *nodes)


def _write_membership(of: PortableExpressions, call: plan.Call, scope: SqlScope) -> Node | None:
    item, container = call.arguments
    test: Node
    if item.type.kinds == Kind.STR == container.type.kinds:
        text, part = of.lower_expr(container, scope), of.lower_expr(item, scope)
        test = exp.Contains(this=text, expression=part)
    else:
        inner = container.type.element or NOTHING
        if not _are_comparable(item.type, inner) or is_nullable(item.type):
            return None
        if get_sql_column_type(item.type) != get_sql_column_type(inner) and not isinstance(container, plan.Constant):
            return None
        if isinstance(container, plan.Subquery):
            if is_nullable(inner):
                return None
            rows = exp.Subquery(this=of.write_rows(container.query))
            test = exp.In(this=sql_builder.wrap_operand(of.lower_expr(item, scope)), query=rows)
        elif isinstance(values := of.lower_expr(container, scope), exp.Array):
            test = exp.In(this=sql_builder.wrap_operand(of.lower_expr(item, scope)), expressions=values.expressions)
        else:
            test = exp.ArrayContains(this=values, expression=of.lower_expr(item, scope))
    return test if call.function.name == "in" else exp.Not(this=sql_builder.wrap_operand(test))


def _write_like(of: PortableExpressions, call: plan.Call, scope: SqlScope) -> Node | None:
    """LIKE; what a backslash means in its pattern is not the same everywhere."""
    pattern = call.arguments[1]
    if not isinstance(pattern, plan.Constant) or "\\" in pattern.value:
        return None
    text, known = (of.lower_expr(argument, scope) for argument in call.arguments)
    test = exp.Like(this=sql_builder.wrap_operand(text), expression=known)
    return test if call.function.name == "like" else exp.Not(this=sql_builder.wrap_operand(test))


SPECIAL_OPERATIONS: dict[str, WriteFunction] = {
    "eq": _write_equality,
    "ne": _write_equality,
    "in": _write_membership,
    "not_in": _write_membership,
    "like": _write_like,
    "not_like": _write_like,
}

assert SPECIAL_OPERATIONS.keys() == {name for name, row in OPERATIONS.items() if "portable" in row.by_hand}


# --- expressions as SQL that means the same everywhere
Node: TypeAlias = exp.Expr


class PortableExpressions(ExpressionLowering):
    """Writes the expressions of one query with the types that their values have; no value is a flag or a handle.

    `variable` gives the values of script variables where they are known, and raises KeyError where they are not.
    Without it they are parameters, which `parameters` names with their variables.
    """

    def __init__(self, variable: Callable[[str], Any] | None = None) -> None:
        self.variable = variable
        self.parameters: dict[str, str] = {}

    def lower_expr(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """The expression. Raises UnsupportedError where it could mean something else."""
        if isinstance(expr, plan.Call) and not expr.function.builtin:
            raise build_refusal(f"{expr.function.name} is a Python function", expr.span)
        typed = get_sql_column_type(expr.type) is not None or expr.type.kinds == Kind.NONE
        if not typed and not isinstance(expr, plan.Aggregate):
            raise build_refusal(
                "the kind of this value is not known, or other databases have no type for it", expr.span
            )
        return super().lower_expr(expr, scope)

    def lower_value(self, expr: plan.Expr, scope: SqlScope) -> Node:
        return self.lower_expr(expr, scope)

    def lower_constant(self, expr: plan.Constant) -> Node:
        return lower_constant(expr.value, expr.type, expr)

    def lower_variable(self, expr: plan.Variable) -> Node:
        if self.variable is None:
            return self._make_parameter(expr)
        return lower_constant(self.get_constant(expr.name, expr.span), expr.type, expr)

    def lower_list(self, expr: plan.MakeList, scope: SqlScope) -> Node:
        return exp.Array(expressions=[self.lower_expr(item, scope) for item in expr.items])

    def lower_query(self, expr: plan.Expr, scope: SqlScope) -> Node:
        raise build_refusal("this is not SQL that every database has", expr.span)

    def lower_and(self, parts: tuple[plan.Expr, ...], scope: SqlScope) -> Node:
        return sql_builder.join_by_and([self.lower_condition(part, scope) for part in parts])

    def write_aggregate(self, expr: plan.Aggregate, argument: Node) -> Node:
        assert expr.argument is not None
        for form in GROUPS[expr.function].portable:
            if form.when([expr.argument.type]):
                return fill_operands(str(form.text), [argument], dialect="duckdb")
        raise build_refusal(f"{expr.function} of such values is not the same everywhere", expr.span)

    def lower_call(self, expr: plan.Call, scope: SqlScope) -> Node:
        name, fails = expr.function.name, not is_free_by_itself(expr)
        written = SPECIAL_OPERATIONS.get(name, _write_form if OPERATIONS[name].portable else None)
        node = None if fails or written is None else written(self, expr, scope)
        if node is None and not fails:
            node = self.call_function(expr, scope)
        if node is not None:
            return node
        if written is None:
            raise build_refusal(f"{name} is not known to other databases", expr.span)
        if fails:
            raise build_refusal("this may fail, which is not the same everywhere", expr.place)
        raise build_refusal(f"{name} of such values is not the same everywhere", expr.place)

    def call_function(self, expr: plan.Call, scope: SqlScope) -> Node | None:
        """The call of a built-in function that has no form, where the database can call Python."""
        return None

    def write_rows(self, query: plan.Query) -> Node:
        """The rows of a query in an expression, which reads nothing around it."""
        raise build_refusal("a query inside of an expression", query.span)

    def get_constant(self, name: str, span: Span) -> Any:
        """The value that a script variable will have."""
        try:
            return None if self.variable is None else self.variable(name)
        except (KeyError, Error):
            raise build_refusal(f"the value of {name} is not known before the script runs", span) from None

    def _make_parameter(self, expr: plan.Variable) -> Node:
        """A variable whose value is given when the statement runs, with the type that it has in SQL."""
        kind = get_sql_column_type(expr.type)
        if kind is None:
            return sql_builder.null()  # None, the only value of its type
        label = next((label for label, name in self.parameters.items() if name == expr.name), None)
        if label is None:
            label = self.name_parameter(expr.name)
            self.parameters[label] = expr.name
        return write_cast(sql_builder.parameter(label), kind)

    def name_parameter(self, name: str) -> str:
        """What a new parameter is called in SQL."""
        return f"value_{len(self.parameters) + 1}"

    def lower_condition(self, expr: plan.Expr, scope: SqlScope) -> Node:
        """The truth of an expression; never NULL."""
        node, kind = self.lower_expr(expr, scope), expr.type
        if kind.kinds == Kind.BOOL:
            return node
        empty = EMPTY_VALUES.get(kind.kinds & ~Kind.NONE)
        if empty is None:
            raise build_refusal("the truth of such a value is not the same everywhere", expr.span)
        test = sql_builder.binary(exp.NEQ, node, empty.copy())
        return exp.Coalesce(this=test, expressions=[exp.false()]) if is_nullable(kind) else test

    def lower_if(self, expr: plan.If, scope: SqlScope) -> Node:
        if not is_free(*expr.then[:-1], *expr.otherwise[:-1]):
            raise build_refusal("what stands before the last value of a branch may fail", expr.span)
        return super().lower_if(expr, scope)


def lower_constant(value: Any, kind: Type, expr: plan.Expr) -> Node:
    match value:
        case None:
            return sql_builder.null()
        case bool():
            return exp.true() if value else exp.false()
        case int() if -(2**63) <= value < 2**63:
            return sql_builder.number(value)
        case float() if value - value == 0:
            return write_cast(
                exp.Literal.string(repr(value)) if "e" in repr(value) else sql_builder.number(value), "DOUBLE"
            )
        case str() if value.isprintable():
            return exp.Literal.string(value)
        case list() | tuple() if kind.element is not None:
            made = exp.Array(expressions=[lower_constant(item, kind.element, expr) for item in value])
            return made if value else cast_literal(made, get_sql_column_type(kind))
        case _:
            raise build_refusal("other databases cannot be given this value", expr.span)


def _write_form(of: PortableExpressions, call: plan.Call, scope: SqlScope) -> Node | None:
    """A call that cannot fail, by the first form that fits."""
    for form in OPERATIONS[call.function.name].portable:
        inputs = list_plan_choices(call) if form.spread else call.arguments
        if not inputs or form.only is not None or not form.when([one.type for one in inputs]):
            continue
        operands = [of.lower_expr(one, scope) for one in inputs]
        if call.type.kinds == Kind.INT and not any(one.find(exp.Column) for one in operands[1:]):
            # literals alone would have the smallest type
            operands[0] = cast_literal(operands[0], get_sql_column_type(inputs[0].type))
        return fill_operands(str(form.text), operands, dialect="duckdb")
    return None
