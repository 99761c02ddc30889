"""Expressions as SQL that means the same everywhere.

They cannot fail, their kinds are known, and a bool is a BOOLEAN. None is NULL, which only comparisons and conditions
meet: they are written so that their truth is never NULL.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import Any, TypeAlias

from sqlglot import exp

from ss2sql import plan
from ss2sql.errors import Error, Span
from ss2sql.kinds import Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.lowering import sql
from ss2sql.lowering.portable import forms
from ss2sql.lowering.portable.functions import BY_HAND
from ss2sql.lowering.portable.types import cast, column_type, is_nullable, refused, typed
from ss2sql.records import dataclass
from ss2sql.walk import can_fail

Node: TypeAlias = exp.Expr
Read: TypeAlias = Callable[[plan.Element | plan.Column], Node]


@dataclass(frozen=True, slots=True)
class Sight:
    """How sources and START WITH variables are read where an expression stands."""

    sources: Mapping[int, Read] = field(default_factory=dict)
    states: Mapping[tuple[int, str], Node] = field(default_factory=dict)
    groups: Mapping[tuple[int, int], Node] = field(default_factory=dict)

    def with_source(self, source: int, read: Read) -> Sight:
        return replace(self, sources={**self.sources, source: read})


class Portable:
    """Writes the expressions of one query.

    `variable` gives the values of script variables where they are known, and raises KeyError where they are not.
    Without it they are parameters, which `parameters` names with their variables.
    """

    def __init__(self, variable: Callable[[str], Any] | None = None) -> None:
        self.variable = variable
        self.parameters: dict[str, str] = {}

    def value(self, expr: plan.Expr, sight: Sight) -> Node:
        """The expression. Raises UnsupportedError where it could mean something else."""
        if column_type(expr.type) is None and expr.type.kinds != Kind.NONE:
            raise refused("the kind of this value is not known, or other databases have no type for it", expr.span)
        match expr:
            case plan.Constant():
                return constant(expr.value, expr.type, expr)
            case plan.Variable(name=name) if self.variable is not None:
                return constant(self.known(name, expr.span), expr.type, expr)
            case plan.Variable():
                return self._parameter(expr)
            case plan.Element(source=source) | plan.Column(source=source) if source in sight.sources:
                return sight.sources[source](expr)
            case plan.State(query=query, name=name) if (query, name) in sight.states:
                return sight.states[(query, name)].copy()
            case plan.GroupKey(query=query, index=index) if (query, index) in sight.groups:
                return sight.groups[(query, index)].copy()
            case plan.And(parts=parts):
                joined = sql.conjunction([self.condition(part, sight) for part in parts])
                assert joined is not None
                return joined
            case plan.Or(parts=parts):
                return sql.disjunction([self.condition(part, sight) for part in parts])
            case plan.Xor(left=left, right=right):
                return sql.binary(exp.NEQ, self.condition(left, sight), self.condition(right, sight))
            case plan.Not(operand=operand):
                return exp.Not(this=sql.operand(self.condition(operand, sight)))
            case plan.If():
                return self._conditional(expr, sight)
            case plan.MakeList(items=items):
                return exp.Array(expressions=[self.value(item, sight) for item in items])
            case plan.Call(function=function) if function.builtin:
                return self.called(expr, sight)
            case plan.Call(function=function):
                raise refused(f"{function.name} is a Python function", expr.span)
            case _:
                raise refused("this is not SQL that every database has", expr.span)

    def called(self, expr: plan.Call, sight: Sight) -> Node:
        """The call of a built-in function."""
        name, fails = expr.function.name, can_fail(replace(expr, arguments=()))
        written = BY_HAND.get(name, forms.written if OPERATIONS[name].portable else None)
        node = None if fails or written is None else written(self, expr, sight)
        if node is None and not fails:
            node = self.of_python(expr, sight)
        if node is not None:
            return node
        if written is None:
            raise refused(f"{name} is not known to other databases", expr.span)
        if fails:
            raise refused("this may fail, which is not the same everywhere", expr.place)
        raise refused(f"{name} of such values is not the same everywhere", expr.place)

    def of_python(self, expr: plan.Call, sight: Sight) -> Node | None:
        """The call of a built-in function that has no form, where the database can call Python."""
        return None

    def rows_of(self, query: plan.Query) -> Node:
        """The rows of a query in an expression, which reads nothing around it."""
        raise refused("a query inside of an expression", query.span)

    def known(self, name: str, span: Span) -> Any:
        """The value that a script variable will have."""
        try:
            return None if self.variable is None else self.variable(name)
        except (KeyError, Error):
            raise refused(f"the value of {name} is not known before the script runs", span) from None

    def _parameter(self, expr: plan.Variable) -> Node:
        """A variable whose value is given when the statement runs, with the type that it has in SQL."""
        kind = column_type(expr.type)
        if kind is None:
            return sql.null()  # None, the only value of its type
        label = next((label for label, name in self.parameters.items() if name == expr.name), None)
        if label is None:
            label = self.label(expr.name)
            self.parameters[label] = expr.name
        return cast(sql.parameter(label), kind)

    def label(self, name: str) -> str:
        """What a new parameter is called in SQL."""
        return f"value_{len(self.parameters) + 1}"

    def condition(self, expr: plan.Expr, sight: Sight) -> Node:
        """The truth of an expression; never NULL."""
        node, kind = self.value(expr, sight), expr.type
        if kind.kinds == Kind.BOOL:
            return node
        plain = kind.kinds & ~Kind.NONE
        empty: Node
        match plain:
            case Kind.BOOL:
                empty = exp.false()
            case Kind.INT | Kind.FLOAT:
                empty = sql.number(0)
            case Kind.STR:
                empty = sql.string("")
            case _:
                raise refused("the truth of such a value is not the same everywhere", expr.span)
        test = sql.binary(exp.NEQ, node, empty)
        return exp.Coalesce(this=test, expressions=[exp.false()]) if is_nullable(kind) else test

    def _conditional(self, expr: plan.If, sight: Sight) -> Node:
        branches = expr.then[-1], expr.otherwise[-1]
        if any(can_fail(part) for branch in (expr.then, expr.otherwise) for part in branch[:-1]):
            raise refused("what stands before the last value of a branch may fail", expr.span)
        values = [self.value(branch, sight) for branch in branches]
        return sql.case([(self.condition(expr.condition, sight), values[0])], values[1])


def constant(value: Any, kind: Type, expr: plan.Expr) -> Node:
    """A known value."""
    match value:
        case None:
            return sql.null()
        case bool():
            return exp.true() if value else exp.false()
        case int() if -(2**63) <= value < 2**63:
            return sql.number(value)
        case float() if value - value == 0:
            return cast(exp.Literal.string(repr(value)) if "e" in repr(value) else sql.number(value), "DOUBLE")
        case str() if value.isprintable():
            return exp.Literal.string(value)
        case list() | tuple() if kind.item is not None:
            made = exp.Array(expressions=[constant(item, kind.item, expr) for item in value])
            return made if value else typed(made, column_type(kind))
        case _:
            raise refused("other databases cannot be given this value", expr.span)
