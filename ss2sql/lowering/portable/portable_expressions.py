"""Expressions as SQL that means the same everywhere.

They cannot fail, their kinds are known, and a bool is a BOOLEAN. None is NULL, which only comparisons and conditions
meet: they are written so that their truth is never NULL.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import Any, TypeAlias

from sqlglot import exp

from ss2sql.errors import Error, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import can_fail, list_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.operation_forms import fill_operands
from ss2sql.lowering.portable.portable_equality import SPECIAL_OPERATIONS
from ss2sql.lowering.portable.sql_types import build_refusal, cast_literal, get_column_type, is_nullable, write_cast

Node: TypeAlias = exp.Expr
ColumnReader: TypeAlias = Callable[[plan.Element | plan.Column], Node]


@dataclass(frozen=True, slots=True)
class PortableScope:
    """How sources and START WITH variables are read where an expression stands."""

    sources: Mapping[int, ColumnReader] = field(default_factory=dict)
    states: Mapping[tuple[int, str], Node] = field(default_factory=dict)
    groups: Mapping[tuple[int, int], Node] = field(default_factory=dict)

    def with_source(self, source: int, read: ColumnReader) -> PortableScope:
        return replace(self, sources={**self.sources, source: read})


class PortableExpressions:
    """Writes the expressions of one query.

    `variable` gives the values of script variables where they are known, and raises KeyError where they are not.
    Without it they are parameters, which `parameters` names with their variables.
    """

    def __init__(self, variable: Callable[[str], Any] | None = None) -> None:
        self.variable = variable
        self.parameters: dict[str, str] = {}

    def lower_value(self, expr: plan.Expr, scope: PortableScope) -> Node:
        """The expression. Raises UnsupportedError where it could mean something else."""
        if isinstance(expr, plan.Call) and not expr.function.builtin:
            raise build_refusal(f"{expr.function.name} is a Python function", expr.span)
        if get_column_type(expr.type) is None and expr.type.kinds != Kind.NONE:
            raise build_refusal(
                "the kind of this value is not known, or other databases have no type for it", expr.span
            )
        match expr:
            case plan.Constant():
                return write_constant(expr.value, expr.type, expr)
            case plan.Variable(name=name) if self.variable is not None:
                return write_constant(self.get_constant(name, expr.span), expr.type, expr)
            case plan.Variable():
                return self._make_parameter(expr)
            case plan.Element(source=source) | plan.Column(source=source) if source in scope.sources:
                return scope.sources[source](expr)
            case plan.State(query=query, name=name) if (query, name) in scope.states:
                return scope.states[(query, name)].copy()
            case plan.GroupKey(query=query, index=index) if (query, index) in scope.groups:
                return scope.groups[(query, index)].copy()
            case plan.And(parts=parts):
                joined = sql_builder.conjunction([self.lower_condition(part, scope) for part in parts])
                assert joined is not None
                return joined
            case plan.Or(parts=parts):
                return sql_builder.disjunction([self.lower_condition(part, scope) for part in parts])
            case plan.Xor(left=left, right=right):
                return sql_builder.binary(
                    exp.NEQ, self.lower_condition(left, scope), self.lower_condition(right, scope)
                )
            case plan.Not(operand=operand):
                return exp.Not(this=sql_builder.wrap_operand(self.lower_condition(operand, scope)))
            case plan.If():
                return self._write_conditional(expr, scope)
            case plan.MakeList(items=items):
                return exp.Array(expressions=[self.lower_value(item, scope) for item in items])
            case plan.Call():
                return self.lower_call(expr, scope)
            case _:
                raise build_refusal("this is not SQL that every database has", expr.span)

    def lower_call(self, expr: plan.Call, scope: PortableScope) -> Node:
        name, fails = expr.function.name, can_fail(replace(expr, arguments=()))
        written = SPECIAL_OPERATIONS.get(name, _write_form if OPERATIONS[name].portable else None)
        node = None if fails or written is None else written(self, expr, scope)
        if node is None and not fails:
            node = self.write_python_call(expr, scope)
        if node is not None:
            return node
        if written is None:
            raise build_refusal(f"{name} is not known to other databases", expr.span)
        if fails:
            raise build_refusal("this may fail, which is not the same everywhere", expr.place)
        raise build_refusal(f"{name} of such values is not the same everywhere", expr.place)

    def write_python_call(self, expr: plan.Call, scope: PortableScope) -> Node | None:
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
        kind = get_column_type(expr.type)
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

    def lower_condition(self, expr: plan.Expr, scope: PortableScope) -> Node:
        """The truth of an expression; never NULL."""
        node, kind = self.lower_value(expr, scope), expr.type
        if kind.kinds == Kind.BOOL:
            return node
        plain = kind.kinds & ~Kind.NONE
        empty: Node
        match plain:
            case Kind.BOOL:
                empty = exp.false()
            case Kind.INT | Kind.FLOAT:
                empty = sql_builder.number(0)
            case Kind.STR:
                empty = sql_builder.string("")
            case _:
                raise build_refusal("the truth of such a value is not the same everywhere", expr.span)
        test = sql_builder.binary(exp.NEQ, node, empty)
        return exp.Coalesce(this=test, expressions=[exp.false()]) if is_nullable(kind) else test

    def _write_conditional(self, expr: plan.If, scope: PortableScope) -> Node:
        branches = expr.then[-1], expr.otherwise[-1]
        if any(can_fail(part) for branch in (expr.then, expr.otherwise) for part in branch[:-1]):
            raise build_refusal("what stands before the last value of a branch may fail", expr.span)
        values = [self.lower_value(branch, scope) for branch in branches]
        return sql_builder.case([(self.lower_condition(expr.condition, scope), values[0])], values[1])


def write_constant(value: Any, kind: Type, expr: plan.Expr) -> Node:
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
        case list() | tuple() if kind.item is not None:
            made = exp.Array(expressions=[write_constant(item, kind.item, expr) for item in value])
            return made if value else cast_literal(made, get_column_type(kind))
        case _:
            raise build_refusal("other databases cannot be given this value", expr.span)


def _write_form(of: PortableExpressions, call: plan.Call, scope: PortableScope) -> Node | None:
    """A call that cannot fail, by the first form that fits."""
    for form in OPERATIONS[call.function.name].portable:
        inputs = list_choices(call) if form.spread else call.arguments
        if not inputs or form.only is not None or not form.when([one.type for one in inputs]):
            continue
        operands = [of.lower_value(one, scope) for one in inputs]
        if call.type.kinds == Kind.INT and not any(one.find(exp.Column) for one in operands[1:]):
            # literals alone would have the smallest type
            operands[0] = cast_literal(operands[0], get_column_type(inputs[0].type))
        return fill_operands(str(form.text), operands, dialect="duckdb")
    return None
