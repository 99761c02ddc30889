"""Reads the forms of operations that are SQL: texts, parsed once, with the operands in their places."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import sqlglot
from sqlglot import exp
from sqlglot.dialects.sqlite import SQLite

from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node

_VALUE = "the_value"


def _build_parser(*known: str) -> Callable[[str], Any]:
    """A parser of SQLite's SQL to which a call stays what is written, but for these functions."""
    base: Any = SQLite.Parser
    syntax = {name: base.FUNCTION_PARSERS[name] for name in ("CAST", "CHAR")}
    functions = {name: base.FUNCTIONS[name] for name in known}
    parser = type(base)("Parser", (base,), {"FUNCTIONS": functions, "FUNCTION_PARSERS": syntax})
    return lambda text: parser(dialect="sqlite").parse(SQLite().tokenize(text), text)[0]


_PARSERS: dict[str, Callable[[str], Any]] = {
    "sqlite": _build_parser(),
    "sqlite groups": _build_parser("COUNT", "MIN", "MAX"),  # sqlglot has to know that they are aggregates
    "duckdb": lambda text: sqlglot.parse_one(text, dialect="duckdb"),
}


@cache
def _parse_sql(text: str, dialect: str, count: int) -> Node:
    """The tree of a text for so many operands, which are columns in it. Read it, and copy what you take."""
    places = [f"{{{index}}}" for index in range(count)]
    text = text.replace("{*}", ", ".join(places)).replace("{reversed}", ", ".join(reversed(places)))
    node: Node = _PARSERS[dialect](re.sub(r"\{(\d+)\}", r"argument_\1", text).replace("{value}", _VALUE))
    return node


def fill_operands(text: str, operands: Sequence[Node], value: Node | None = None, dialect: str = "sqlite") -> Node:
    """A text with the operands in their places, and with the parentheses that these need."""
    if len(operands) == 1 and ("{*}" in text or "{reversed}" in text):  # SQLite takes a max of one for the aggregate
        return operands[0].copy()
    finish = _finish_duckdb if dialect == "duckdb" else _finish_sqlite

    def fill_node(node: Node) -> Node:
        match node:
            case exp.Column(name=name):
                known = value if name == _VALUE else operands[int(name.removeprefix("argument_"))]
                assert known is not None
                return known.copy()
            case exp.Paren():
                return fill_node(node.this)
            case exp.And():
                joined = sql_builder.conjunction([fill_node(part) for part in node.flatten()])
                assert joined is not None
                return joined
            case exp.Binary():
                made: Node = sql_builder.binary(type(node), fill_node(node.this), fill_node(node.expression))
                made.set("typed", True if isinstance(node, exp.Div) else None)  # sqlglot adds no cast of its own
                return finish(made)
        made = node.copy()
        for name, part in node.args.items():
            if isinstance(part, list):
                made.set(name, [fill_node(one) for one in part])
            elif isinstance(part, exp.Expr) and not isinstance(part, exp.DataType):
                made.set(name, fill_node(part))
        if isinstance(made, (exp.Not, exp.Neg, exp.Between)):
            made.set("this", sql_builder.wrap_operand(made.this))
        return finish(made)

    return fill_node(_parse_sql(text, dialect, len(operands)))


def _finish_sqlite(node: Node) -> Node:
    """Names of functions as they are written, and a float of an integer that is written out."""
    match node:
        case exp.Anonymous():
            return sql_builder.call(node.name, *node.expressions)
        case exp.Chr():
            return sql_builder.call("char", *node.expressions)
        case exp.Cast(this=exp.Literal() as known) if node.to.sql("sqlite") == "REAL" and known.this.isdigit():
            return exp.Literal.number(f"{known.this}.0")
    return node


def _finish_duckdb(node: Node) -> Node:
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
