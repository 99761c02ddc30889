"""The parser: expressions, their precedence, strings, names, comments, statements."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trees import (
    NOWHERE,
    A,
    B,
    C,
    D,
    assign,
    call,
    code,
    cut,
    expr,
    iff,
    index,
    items,
    lit,
    name,
    op,
    same,
    script,
    this,
)

from ss2sql.frontend import ast

EXPRESSIONS: list[tuple[str, ast.Expr]] = [
    ("7", lit(7)),
    ("007", lit(7)),
    ("1.", lit(1.0)),
    (".5", lit(0.5)),
    ("1e3", lit(1000.0)),
    ("1.5E-3", lit(0.0015)),
    ("2.e+1", lit(20.0)),
    ("-5", lit(-5)),
    ("- 2.5", lit(-2.5)),
    ("9223372036854775807", lit(2**63 - 1)),
    ("-9223372036854775808", lit(-(2**63))),
    ("-00009223372036854775808", lit(-(2**63))),
    ("1e-999", lit(0.0)),
    ("True", lit(True)),
    ("FALSE", lit(False)),
    ("none", lit(None)),
    ("'text'", lit("text")),
    ('"text"', lit("text")),
    ("a", A),
    ("this", this()),
    ("THIS", this()),
    ("n.this", this("n")),
    ("n.This", this("n")),
    ("n.mass", ast.Attribute("n", "mass", span=NOWHERE)),
    ("n . mass", ast.Attribute("n", "mass", span=NOWHERE)),
    ("[]", items()),
    ("[1, [a], 'x']", items(lit(1), items(A), lit("x"))),
    ("[a = 1, b]", items(assign("a", lit(1)), B)),
    ("f()", call("f")),
    ("f(a, g(b))", call("f", A, call("g", B))),
    ("f(a = 1, b = c)", call("f", assign("a", lit(1)), assign("b", C))),
    ("count(*)", call("count", star=True)),
    ("x[0]", index(name("x"), lit(0))),
    ("x[0][1]", index(index(name("x"), lit(0)), lit(1))),
    ("x[0, 1]", index(index(name("x"), lit(0)), lit(1))),
    ('x["key"]', index(name("x"), lit("key"))),
    ("[1, 2][0]", index(items(lit(1), lit(2)), lit(0))),
    ("f(a)[-1]", index(call("f", A), lit(-1))),
    ("'abc'[0]", index(lit("abc"), lit(0))),
    ("n.col[0]", index(ast.Attribute("n", "col", span=NOWHERE), lit(0))),
    ("x[a:b]", cut(name("x"), A, B)),
    ("x[a:]", cut(name("x"), A, None)),
    ("x[:b]", cut(name("x"), None, B)),
    ("x[:]", cut(name("x"), None, None)),
    ("x[1:2, 0]", index(cut(name("x"), lit(1), lit(2)), lit(0))),
    ("x[1.:2]", cut(name("x"), lit(1.0), lit(2))),
    ("a + b", op("add", A, B)),
    ("a - b", op("sub", A, B)),
    ("a -1", op("sub", A, lit(1))),
    ("a * b", op("mul", A, B)),
    ("a / b", op("div", A, B)),
    ("a % b", op("mod", A, B)),
    ("a ^ b", op("pow", A, B)),
    ("-a", op("neg", A)),
    ("--5", op("neg", lit(-5))),
    ("-(5)", op("neg", lit(5))),
    ("a == b", op("eq", A, B)),
    ("a != b", op("ne", A, B)),
    ("a <> b", op("ne", A, B)),
    ("a < b", op("lt", A, B)),
    ("a <= b", op("le", A, B)),
    ("a > b", op("gt", A, B)),
    ("a >= b", op("ge", A, B)),
    ("a IN b", op("in", A, B)),
    ("a not in b", op("not_in", A, B)),
    ("a AND b and c", ast.And((A, B, C), span=NOWHERE)),
    ("a OR b or c", ast.Or((A, B, C), span=NOWHERE)),
    ("a XOR b xor c", ast.Xor(ast.Xor(A, B, span=NOWHERE), C, span=NOWHERE)),
    ("NOT not a", ast.Not(ast.Not(A, span=NOWHERE), span=NOWHERE)),
    ("a = 1", assign("a", lit(1))),
    ("a = b = 1", assign("a", assign("b", lit(1)))),
    ("(a = 1)", assign("a", lit(1))),
    ("(a = 1) + 2", op("add", assign("a", lit(1)), lit(2))),
    ("f((a))", call("f", A)),
    ("IF(a)", iff(A)),
    ("IF(a; b)", iff(A, (B,))),
    ("if(a; b, c; d)", iff(A, (B, C), (D,))),
    ("IF(a;; b)", iff(A, (), (B,))),
    ("IF(a; b;)", iff(A, (B,))),
    ("IF(a;;)", iff(A)),
    ("IF(a; n = n + 1, True; False)", iff(A, (assign("n", op("add", name("n"), lit(1))), lit(True)), (lit(False),))),
    ("v{}", ast.Temporal("v", None, span=NOWHERE)),
    ("v{-2.0}", ast.Temporal("v", lit(-2.0), span=NOWHERE)),
    ("v{22.2}", ast.Temporal("v", lit(22.2), span=NOWHERE)),
    ("v{a + b}[0]", index(ast.Temporal("v", op("add", A, B), span=NOWHERE), lit(0))),
    ("v{5.0} = a", ast.TemporalAssign("v", lit(5.0), A, span=NOWHERE)),
    ("w = v{5} = a", assign("w", ast.TemporalAssign("v", lit(5), A, span=NOWHERE))),
]  # fmt: skip


@pytest.mark.parametrize(("source", "tree"), EXPRESSIONS)
def test_expressions(source: str, tree: ast.Expr) -> None:
    same(expr(source), tree)


# Each pair is one tree: the right side writes out what the precedence of section 3 says.
PRECEDENCE = [
    ("a = b OR c", "a = (b OR c)"),
    ("a OR b XOR c", "a OR (b XOR c)"),
    ("a XOR b AND c", "a XOR (b AND c)"),
    ("a AND NOT b", "a AND (NOT b)"),
    ("NOT a AND b", "(NOT a) AND b"),
    ("NOT a == b", "NOT (a == b)"),
    ("NOT a IN b", "NOT (a IN b)"),
    ("a == b + c", "a == (b + c)"),
    ("a + b < c - d", "(a + b) < (c - d)"),
    ("a NOT IN b + c", "a NOT IN (b + c)"),
    ("a AND b == c OR d", "(a AND (b == c)) OR d"),
    ("a + b * c", "a + (b * c)"),
    ("a - b - c", "(a - b) - c"),
    ("a - b + c", "(a - b) + c"),
    ("a / b * c % d", "((a / b) * c) % d"),
    ("a * -b", "a * (-b)"),
    ("-a * b", "(-a) * b"),
    ("- -a", "-(-a)"),
    ("-2 ^ 2", "-(2 ^ 2)"),
    ("-a ^ b", "-(a ^ b)"),
    ("a ^ b ^ c", "a ^ (b ^ c)"),
    ("2 ^ -1", "2 ^ (-1)"),
    ("2 ^ -a ^ b", "2 ^ (-(a ^ b))"),
    ("a * b ^ c", "a * (b ^ c)"),
    ("a ^ b * c", "(a ^ b) * c"),
    ("a ^ b[0]", "a ^ (b[0])"),
    ("-a[0]", "-(a[0])"),
    ("-f(a)", "-(f(a))"),
    ("-n.a", "-(n.a)"),
    ("a == b AND c == d", "(a == b) AND (c == d)"),
]


@pytest.mark.parametrize(("short", "long"), PRECEDENCE)
def test_precedence(short: str, long: str) -> None:
    same(expr(short), expr(long))


def test_a_parenthesis_keeps_chains_apart() -> None:
    same(expr("(a AND b) AND c"), ast.And((ast.And((A, B), span=NOWHERE), C), span=NOWHERE))
    same(expr("(a < b) < c"), op("lt", op("lt", A, B), C))


STRINGS = [
    (r"'a\nb\tc'", "a\nb\tc"),
    (r"'\a\b\f\r\v\\'", "\a\b\f\r\v\\"),
    (r"'it\'s'", "it's"),
    (r'"say \"x\""', 'say "x"'),
    ("'say \"x\"'", 'say "x"'),
    (r"'\x41\u00e9\U0001F600'", "Aé😀"),
    (r"'\N{GREEK SMALL LETTER ALPHA}'", "α"),
    (r"'\0\101\7779'", "\x00A\u01ff9"),
    (r"'\q\8\.'", r"\q\8\."),
    (r"'\\n'", r"\n"),
    ("'one \\\n line'", "one  line"),
    ("'one \\\r\n line'", "one  line"),
    ("'# no comment /* */'", "# no comment /* */"),
    ("''", ""),
    ("'ünïcödé →'", "ünïcödé →"),
]


@pytest.mark.parametrize(("source", "value"), STRINGS)
def test_strings(source: str, value: str) -> None:
    same(expr(source), lit(value))


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00")))
def test_any_string_can_be_written(value: str) -> None:
    quoted = value.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n").replace("\r", "\\r")
    same(expr(f"'{quoted}'"), lit(value))


def test_comments_and_white_space() -> None:
    same(expr("a # b\n + /* c; \n 'd */ b # ; end"), op("add", A, B))
    same(expr("\ufeffa\u00a0+\tb\r\n"), op("add", A, B))
    same(expr("a /**/ + /***/ b"), op("add", A, B))
    assert len(script(";; a;\n;b;;").statements) == 2


def test_names_are_python_identifiers() -> None:
    for text_ in ("größe", "变量", "क्षेत्र", "_x", "Σ2", "e\u0301"):
        assert isinstance(found := expr(text_), ast.Name)
        assert found.name.isidentifier()
    same(expr("ﬁnd"), name("ﬁnd"))
    assert expr("ﬁnd").span.text == "ﬁnd"


def test_statements() -> None:
    found = script("a = 1;\nSELECT this FROM a AS list;\n[a, b]")
    assert [type(statement) for statement in found.statements] == [ast.Assign, ast.Query, ast.ListLiteral]


@settings(max_examples=50)
@given(st.integers(0, 2**64))
def test_integers_have_64_bits(value: int) -> None:
    if value < 2**63:
        same(expr(str(value)), lit(value))
    else:
        assert code(str(value)) == "P007"
    if value <= 2**63:
        same(expr(f"-{value}"), lit(-value))
    else:
        assert code(f"-{value}") == "P007"
