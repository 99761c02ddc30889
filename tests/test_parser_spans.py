"""The parser: the span of every node, and trees that are known by how they are written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trees import (
    NOWHERE,
    A,
    call,
    expr,
    iff,
    index,
    items,
    lit,
    name,
    op,
    query,
    same,
    script,
    select,
    shape,
    source,
    this,
)

from ss2sql.errors import Span
from ss2sql.frontend import ast


def nodes(node: Any) -> Iterator[Any]:
    """All nodes of a tree, parents first."""
    if isinstance(node, tuple):
        for part in node:
            yield from nodes(part)
    elif is_dataclass(node) and not isinstance(node, Span):
        yield node
        for field in fields(node):
            yield from nodes(getattr(node, field.name))


SPANNED = [
    "  a  + b*(c - 1) ;",
    "x = [1, 'zwei', [], -3][0]; # comment\n y{5.0} = f(a, n = n + 1)",
    "IF(a == b AND NOT c; d; e, (f))",
    "a OR (b XOR c) OR v{-2.0}[1:]",
    "spheres = SELECT obj, n.this, n.mass FROM n = space, f(a) WHERE isSphere(this) AND 1 NOT IN x AS list;",
    "SELECT count(*) FROM (SELECT b FROM c) GROUP BY a HAVING d ORDER BY e DESC, f LIMIT 3",
    "SELECT a FROM b START WITH t = [1] CONNECT BY COST f(t) NO  CYCLE MAXIMUM (5) t = g(t) STOP WITH []==t AS l(x=1)",
]
STANDING = (ast.Literal, ast.Name, ast.This, ast.Attribute, ast.ListLiteral, ast.Call, ast.Index, ast.Slice,
            ast.Operator, ast.And, ast.Or, ast.Xor, ast.Not, ast.If, ast.Assign, ast.TemporalAssign, ast.Temporal,
            ast.Query)  # fmt: skip


@pytest.mark.parametrize("written", SPANNED)
def test_the_text_of_a_span_is_the_node(written: str) -> None:
    whole, *found = nodes(script(written))
    assert isinstance(whole, ast.Script)
    assert len(found) > 5
    for node in found:
        assert node.span.text == node.span.text.strip()
        if isinstance(node, STANDING):
            same(expr(node.span.text), node)
        if isinstance(node, ast.Assign):
            assert node.name_span.text == node.name
        if isinstance(node, ast.Operator):
            assert node.span.start <= node.place.start < node.place.end <= node.span.end


def test_spans_of_the_other_nodes() -> None:
    written = (
        "SELECT * FROM n = a, (b) START WITH t = 1 CONNECT BY no  cycle MAXIMUM (5) t = 2"
        " ORDER BY (c) DESC, d AS f( 1 )"
    )
    found = query(written)
    assert [column.span.text for column in found.columns] == ["*"]
    assert [part.span.text for part in found.sources] == ["n = a", "(b)"]
    assert [option.span.text for option in found.options] == ["no  cycle", "MAXIMUM (5)"]
    assert [key.span.text for key in found.order] == ["(c) DESC", "d"]
    assert found.representation is not None
    assert found.representation.span.text == "AS f( 1 )"
    assert found.span.text == written
    assert script(" a ; b ").span.text == " a ; b "


def test_the_place_of_an_operator_is_its_sign() -> None:
    for sign in ("+", "-", "*", "/", "%", "^", "==", "!=", "<>", "<", "<=", ">", ">=", "IN", "NOT IN"):
        found = expr(f"a {sign} b")
        assert isinstance(found, ast.Operator)
        assert found.place.text == sign
    negative = expr("- a")
    assert isinstance(negative, ast.Operator)
    assert negative.place.text == "-"


# Trees that are known by how they are made


Written = tuple[str, ast.Expr]
LEAVES = st.sampled_from([("a", A), ("this", this()), ("n.b", ast.Attribute("n", "b", span=NOWHERE)), ("7", lit(7)),
                          ("'x'", lit("x")), ("True", lit(True)), ("start", name("start"))])  # fmt: skip


def _operation(pair: tuple[Written, Written], sign: tuple[str, str]) -> Written:
    (left, first), (right, second) = pair
    return f"({left}) {sign[0]} ({right})", op(sign[1], first, second)


def _query(pair: tuple[Written, Written]) -> Written:
    (column, first), (condition, second) = pair
    tree = select((first,), (source(name("s")),), where=second, representation=shape("list"))
    return f"(SELECT {column} FROM s WHERE {condition} AS list)", tree


def _several(some: list[Written]) -> tuple[str, tuple[ast.Expr, ...]]:
    return ", ".join(text for text, _ in some), tuple(tree for _, tree in some)


def _grow(part: st.SearchStrategy[Written]) -> st.SearchStrategy[Written]:
    pairs = st.tuples(part, part)
    lists = st.lists(part, min_size=1, max_size=3).map(_several)
    signs = st.sampled_from([("+", "add"), ("^", "pow"), ("<=", "le"), ("NOT IN", "not_in"), ("%", "mod")])
    return st.one_of(
        st.builds(_operation, pairs, signs),
        pairs.map(_query),
        part.map(lambda one: (f"NOT ({one[0]})", ast.Not(one[1], span=NOWHERE))),
        pairs.map(lambda two: (f"({two[0][0]})[{two[1][0]}]", index(two[0][1], two[1][1]))),
        pairs.map(lambda two: (f"IF({two[0][0]}; {two[1][0]})", iff(two[0][1], (two[1][1],)))),
        lists.map(lambda some: (f"[{some[0]}]", items(*some[1]))),
        lists.map(lambda some: (f"f({some[0]})", call("f", *some[1]))),
    )


@given(st.recursive(LEAVES, _grow, max_leaves=12))
def test_a_written_tree_is_read_back(pair: Written) -> None:
    same(expr(pair[0]), pair[1])
