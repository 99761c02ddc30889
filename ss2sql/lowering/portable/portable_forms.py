"""The forms of operations for other databases: texts in DuckDB's SQL, which sqlglot turns into their own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import sqlglot
from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS, Form
from ss2sql.language.plan_traversal import list_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.sql_types import cast_literal, get_column_type

if TYPE_CHECKING:
    from ss2sql.lowering.portable.portable_expressions import PortableExpressions, PortableScope

Node = exp.Expr


def write_call(of: PortableExpressions, call: plan.Call, scope: PortableScope) -> Node | None:
    """A call that cannot fail, by the first form that fits."""
    for form in OPERATIONS[call.function.name].portable:
        given = list_choices(call) if form.spread else call.arguments
        if not given or form.only is not None or not form.when([one.type for one in given]):
            continue
        operands = [of.value(one, scope) for one in given]
        if call.type.kinds == Kind.INT and not any(one.find(exp.Column) for one in operands[1:]):
            operands[0] = cast_literal(
                operands[0], get_column_type(given[0].type)
            )  # literals alone would have the smallest type
        return fill_operands(form, operands)
    return None


def write_aggregate(aggregate: plan.Aggregate, argument: Node) -> Node | None:
    """An aggregate that every database computes alike."""
    assert aggregate.argument is not None
    types = [aggregate.argument.type]
    form = next((form for form in GROUPS[aggregate.function].portable if form.when(types)), None)
    return None if form is None else fill_operands(form, [argument])


def fill_operands(form: Form, operands: Sequence[Node]) -> Node:
    """The text with the operands in their places, and with the parentheses that these need."""

    def fill(node: Node) -> Node:
        if isinstance(node, exp.Column):
            return operands[int(node.name[-1])].copy()
        if isinstance(node, exp.Paren):
            return fill(node.this)
        if isinstance(node, exp.Div):
            return exp.Div(
                this=sql_builder.wrap_operand(fill(node.this)),
                expression=sql_builder.wrap_operand(fill(node.expression)),
                typed=True,
            )
        if isinstance(node, exp.Binary):
            return _fold_numbers(sql_builder.binary(type(node), fill(node.this), fill(node.expression)))
        if isinstance(node, exp.Neg):
            return exp.Neg(this=sql_builder.wrap_operand(fill(node.this)))
        if isinstance(node.this, exp.Column) and node.this.name == "all_arguments":  # greatest(a, b, ...)
            first, *others = (one.copy() for one in operands)
            return type(node)(this=first, expressions=others) if others else first
        made = node.copy()
        for name, part in node.args.items():
            if isinstance(part, list):
                made.set(name, [fill(one) for one in part])
            elif isinstance(part, exp.Expr) and not isinstance(part, exp.DataType):
                made.set(name, fill(part))
        return made

    return fill(parse_sql(str(form.text)))


@cache
def parse_sql(text: str) -> Node:
    """The tree of a text. Read it, and copy what you take."""
    return sqlglot.parse_one(
        re.sub(r"\{(\d)\}", r"argument_\1", text.replace("{*}", "all_arguments")), dialect="duckdb"
    )


def _fold_numbers(node: Node) -> Node:
    """`i + 1 + 1` as `i + 2`, of numbers that are written out."""
    match node:
        case exp.Add(this=exp.Literal(is_string=False) as one, expression=exp.Literal(is_string=False) as other):
            return sql_builder.number(int(one.this) + int(other.this))
        case exp.Add(
            this=exp.Add(this=base, expression=exp.Literal(is_string=False) as one),
            expression=exp.Literal(is_string=False) as other,
        ):
            return sql_builder.binary(exp.Add, base, sql_builder.number(int(one.this) + int(other.this)))
    return node
