"""The forms of operations for other databases: texts in DuckDB's SQL, which sqlglot turns into their own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import sqlglot
from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS, Form
from ss2sql.lowering import sql
from ss2sql.lowering.portable.types import column_type, typed
from ss2sql.walk import choices

if TYPE_CHECKING:
    from ss2sql.lowering.portable.expressions import Portable, Sight

Node = exp.Expr


def written(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    """A call that cannot fail, by the first form that fits."""
    for form in OPERATIONS[call.function.name].portable:
        given = choices(call) if form.spread else call.arguments
        if not given or form.only is not None or not form.when([one.type for one in given]):
            continue
        operands = [of.value(one, sight) for one in given]
        if call.type.kinds == Kind.INT and not any(one.find(exp.Column) for one in operands[1:]):
            operands[0] = typed(operands[0], column_type(given[0].type))  # literals alone would have the smallest type
        return filled(form, operands)
    return None


def aggregated(aggregate: plan.Aggregate, argument: Node) -> Node | None:
    """An aggregate that every database computes alike."""
    assert aggregate.argument is not None
    types = [aggregate.argument.type]
    form = next((form for form in GROUPS[aggregate.function].portable if form.when(types)), None)
    return None if form is None else filled(form, [argument])


def filled(form: Form, operands: Sequence[Node]) -> Node:
    """The text with the operands in their places, and with the parentheses that these need."""

    def fill(node: Node) -> Node:
        if isinstance(node, exp.Column):
            return operands[int(node.name[-1])].copy()
        if isinstance(node, exp.Paren):
            return fill(node.this)
        if isinstance(node, exp.Div):
            return exp.Div(this=sql.operand(fill(node.this)), expression=sql.operand(fill(node.expression)), typed=True)
        if isinstance(node, exp.Binary):
            return _folded(sql.binary(type(node), fill(node.this), fill(node.expression)))
        if isinstance(node, exp.Neg):
            return exp.Neg(this=sql.operand(fill(node.this)))
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

    return fill(parsed(str(form.text)))


@cache
def parsed(text: str) -> Node:
    """The tree of a text. Read it, and copy what you take."""
    return sqlglot.parse_one(
        re.sub(r"\{(\d)\}", r"argument_\1", text.replace("{*}", "all_arguments")), dialect="duckdb"
    )


def _folded(node: Node) -> Node:
    """`i + 1 + 1` as `i + 2`, of numbers that are written out."""
    match node:
        case exp.Add(this=exp.Literal(is_string=False) as one, expression=exp.Literal(is_string=False) as other):
            return sql.number(int(one.this) + int(other.this))
        case exp.Add(
            this=exp.Add(this=base, expression=exp.Literal(is_string=False) as one),
            expression=exp.Literal(is_string=False) as other,
        ):
            return sql.binary(exp.Add, base, sql.number(int(one.this) + int(other.this)))
    return node
