"""The parser: trees of expressions and queries, their places in the text, and which words are names where.

The plans of the golden cases show what the clauses of a query become.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from fuzz_judge import nodes
from hypothesis import given, settings
from hypothesis import strategies as st

from trees import (  # isort: skip
    NOWHERE, A, B, C, D, assign, call, code, cut, expr, iff, index, items, lit, name, op, query, same, script, select,
    shape, source, this,
)  # fmt: skip

from ss2sql.errors import ParseError, Span
from ss2sql.frontend.syntax import ast, tokenizer

EXPRESSIONS: dict[str, ast.Expr] = {
    "7": lit(7), "007": lit(7), "1.": lit(1.0), ".5": lit(0.5), "1e3": lit(1000.0), "1.5E-3": lit(0.0015),
    "2.e+1": lit(20.0), "1e-999": lit(0.0), "-5": lit(-5), "- 2.5": lit(-2.5), "9223372036854775807": lit(2**63 - 1),
    "-9223372036854775808": lit(-(2**63)), "-00009223372036854775808": lit(-(2**63)),
    "True": lit(True), "FALSE": lit(False), "none": lit(None), "'text'": lit("text"), '"text"': lit("text"),
    "a": A, "this": this(), "THIS": this(), "n.this": this("n"), "n.This": this("n"),
    "n.mass": ast.Attribute("n", "mass", span=NOWHERE), "n . mass": ast.Attribute("n", "mass", span=NOWHERE),
    "[]": items(), "[1, [a], 'x']": items(lit(1), items(A), lit("x")), "[a = 1, b]": items(assign("a", lit(1)), B),
    "f()": call("f"), "f(a, g(b))": call("f", A, call("g", B)), "f((a))": call("f", A),
    "f(a = 1, b = c)": call("f", assign("a", lit(1)), assign("b", C)), "count(*)": call("count", star=True),
    "a[0]": index(A, lit(0)), "a[0][1]": index(index(A, lit(0)), lit(1)), "a[0, 1]": index(index(A, lit(0)), lit(1)),
    'a["key"]': index(A, lit("key")), "[1, 2][0]": index(items(lit(1), lit(2)), lit(0)),
    "f(a)[-1]": index(call("f", A), lit(-1)), "'abc'[0]": index(lit("abc"), lit(0)),
    "n.col[0]": index(ast.Attribute("n", "col", span=NOWHERE), lit(0)),
    "a[b:c]": cut(A, B, C), "a[b:]": cut(A, B, None), "a[:b]": cut(A, None, B), "a[:]": cut(A, None, None),
    "a[1:2, 0]": index(cut(A, lit(1), lit(2)), lit(0)), "a[1.:2]": cut(A, lit(1.0), lit(2)),
    "a -1": op("sub", A, lit(1)), "-a": op("neg", A), "--5": op("neg", lit(-5)), "-(5)": op("neg", lit(5)),
    "a AND b and c": ast.And((A, B, C), span=NOWHERE), "a OR b or c": ast.Or((A, B, C), span=NOWHERE),
    "a XOR b xor c": ast.Xor(ast.Xor(A, B, span=NOWHERE), C, span=NOWHERE),
    "NOT not a": ast.Not(ast.Not(A, span=NOWHERE), span=NOWHERE),
    "(a AND b) AND c": ast.And((ast.And((A, B), span=NOWHERE), C), span=NOWHERE),
    "(a < b) < c": op("lt", op("lt", A, B), C), "a not in b": op("not_in", A, B),
    "a = 1": assign("a", lit(1)), "a = b = 1": assign("a", assign("b", lit(1))), "(a = 1)": assign("a", lit(1)),
    "(a = 1) + 2": op("add", assign("a", lit(1)), lit(2)),
    "IF(a)": iff(A), "IF(a; b)": iff(A, (B,)), "if(a; b, c; d)": iff(A, (B, C), (D,)), "IF(a;; b)": iff(A, (), (B,)),
    "IF(a; b;)": iff(A, (B,)), "IF(a;;)": iff(A),
    "IF(a; n = n + 1, True; False)": iff(A, (assign("n", op("add", name("n"), lit(1))), lit(True)), (lit(False),)),
    "v{}": ast.Temporal("v", None, span=NOWHERE), "v{-2.0}": ast.Temporal("v", lit(-2.0), span=NOWHERE),
    "v{22.2}": ast.Temporal("v", lit(22.2), span=NOWHERE),
    "v{a + b}[0]": index(ast.Temporal("v", op("add", A, B), span=NOWHERE), lit(0)),
    "v{5.0} = a": ast.TemporalAssign("v", lit(5.0), A, span=NOWHERE),
    "w = v{5} = a": assign("w", ast.TemporalAssign("v", lit(5), A, span=NOWHERE)),
    "v{1} = SELECT a FROM b": ast.TemporalAssign("v", lit(1), select((A,), (source(B),)), span=NOWHERE),
    # comments and white space
    "a # b\n + /* c; \n 'd */ b # ; end": op("add", A, B), "\ufeffa\u00a0+\tb\r\n": op("add", A, B),
    "a /**/ + /***/ b": op("add", A, B),
    **{word: name(word) for word in ("ﬁnd", "größe", "变量", "क्षेत्र", "_x", "Σ2", "e\u0301")},
    # strings
    r"'a\nb\tc'": lit("a\nb\tc"), r"'\a\b\f\r\v\\'": lit("\a\b\f\r\v\\"), r"'it\'s'": lit("it's"),
    r'"say \"x\""': lit('say "x"'), "'say \"x\"'": lit('say "x"'), r"'\x41\u00e9\U0001F600'": lit("Aé😀"),
    r"'\N{GREEK SMALL LETTER ALPHA}'": lit("α"), r"'\0\101\7779'": lit("\x00A\u01ff9"), r"'\q\8\.'": lit(r"\q\8\."),
    r"'\\n'": lit(r"\n"), "'one \\\n line'": lit("one  line"), "'one \\\r\n line'": lit("one  line"), "''": lit(""),
    "'# no comment /* */'": lit("# no comment /* */"), "'ünïcödé →'": lit("ünïcödé →"),
}  # fmt: skip


@pytest.mark.parametrize("source", EXPRESSIONS, ids=ascii)
def test_expressions(source: str) -> None:
    same(expr(source), EXPRESSIONS[source])


# Section 3 of the language: each line of operators binds tighter than the one above. NOT stands between AND and ==, the
# minus of one operand between * and ^.
LEVELS: list[dict[str, str]] = [
    {"OR": ""}, {"XOR": ""}, {"AND": ""},
    {"==": "eq", "!=": "ne", "<>": "ne", "<": "lt", "<=": "le", ">": "gt", ">=": "ge", "IN": "in", "NOT IN": "not_in"},
    {"+": "add", "-": "sub"}, {"*": "mul", "/": "div", "%": "mod"}, {"^": "pow"},
]  # fmt: skip
PREFIXES = {"NOT": 2.5, "-": 5.5}
SIGNS = [(sign, level) for level, signs in enumerate(LEVELS) for sign in signs]


def test_operators_bind_as_their_levels_say() -> None:
    for left, outer in SIGNS:
        for right, inner in SIGNS:
            if outer < inner or left == right == "^":
                same(expr(f"a {left} b {right} c"), expr(f"a {left} (b {right} c)"))
            elif outer > inner or outer in (4, 5):
                same(expr(f"a {left} b {right} c"), expr(f"(a {left} b) {right} c"))
        for prefix, inside in PREFIXES.items():
            grouped = f"({prefix} a) {left} b" if outer < inside else f"{prefix} (a {left} b)"
            same(expr(f"{prefix} a {left} b"), expr(grouped))
            if outer < inside or prefix == "-":
                same(expr(f"a {left} {prefix} b"), expr(f"a {left} ({prefix} b)"))


@pytest.mark.parametrize(
    ("short", "long"),
    [("a = b OR c", "a = (b OR c)"), ("a AND b == c OR d", "(a AND (b == c)) OR d"), ("- -a", "-(-a)"),
     ("2 ^ -a ^ b", "2 ^ (-(a ^ b))"), ("a ^ b[0]", "a ^ (b[0])"), ("-a[0]", "-(a[0])"), ("-f(a)", "-(f(a))"),
     ("-n.a", "-(n.a)"), ("-2 ^ 2", "-(2 ^ 2)")],
)  # fmt: skip
def test_what_else_binds(short: str, long: str) -> None:
    same(expr(short), expr(long))


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00")))
def test_any_string_can_be_written(value: str) -> None:
    quoted = value.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n").replace("\r", "\\r")
    same(expr(f"'{quoted}'"), lit(value))


@settings(max_examples=50)
@given(st.integers(0, 2**64))
def test_integers_have_64_bits(value: int) -> None:
    for written, fits, number in ((f"{value}", value < 2**63, value), (f"-{value}", value <= 2**63, -value)):
        if fits:
            same(expr(written), lit(number))
        else:
            assert code(written) == "P007"


def test_statements() -> None:
    found = script("a = 1;\nSELECT this FROM a AS list;\n[a, b]")
    assert [type(statement) for statement in found.statements] == [ast.Assign, ast.Query, ast.ListLiteral]
    assert len(script(";; a;\n;b;;").statements) == 2


# --- queries ---------------------------------------------------------------------------------------------


def test_the_name_of_a_representation_is_kept_as_written() -> None:
    same(query("select a from b as VALUE;"), select((A,), (source(B),), representation=shape("VALUE")))
    same(query("SELECT a FROM b AS list()"), select((A,), (source(B),), representation=shape("list")))


SOURCES = ["a", "w.t", "n.this", "f(a, 1)", "[1, 2]", "a[0]", "f(a)[0, 1]", "'text'", "5", "None", "this", "v{-2.0}",
           "(a + b)", "(x = a)", "(SELECT a FROM b)", "SELECT a FROM b AS list", "IF(a; b; c)"]  # fmt: skip


@pytest.mark.parametrize("written", SOURCES)
def test_sources(written: str) -> None:
    for named in ("", "n = "):
        found = query(f"SELECT a FROM x, {named}{written}, y WHERE c")
        assert [part.name for part in found.sources] == [None, "n" if named else None, None]
        same(found.sources[1].expr, expr(written))


A_VALUE = select((A,), (source(B),), representation=shape("value"))
OPTIONS: dict[str, tuple[str, ast.Expr | None]] = {
    "DEPTH FIRST": ("DEPTH FIRST", None), "breadth first": ("BREADTH FIRST", None),
    "BREADTH /* and */\n FIRST": ("BREADTH FIRST", None), "no cycle": ("NO CYCLE", None), "Unique": ("UNIQUE", None),
    "MEMORIZE": ("MEMORIZE", None), "MEMORIZE 5": ("MEMORIZE", lit(5)), "MEMORIZE (a + 1)":
    ("MEMORIZE", op("add", A, lit(1))), "MAXIMUM 5": ("MAXIMUM", lit(5)), "MAXIMUM (a)": ("MAXIMUM", A),
    "COST 1": ("COST", lit(1)), "COST cost": ("COST", name("cost")), "COST first": ("COST", name("first")),
    "COST (f(a)[0] + 2 OR unique)":
    ("COST", ast.Or((op("add", index(call("f", A), lit(0)), lit(2)), name("unique")), span=NOWHERE)),
    "HEURISTIC a - b": ("HEURISTIC", op("sub", A, B)), "PROBABILITY 0.5": ("PROBABILITY", lit(0.5)),
    "COST (SELECT a FROM b AS value)": ("COST", A_VALUE), "COST SELECT a FROM b AS value": ("COST", A_VALUE),
}  # fmt: skip


@pytest.mark.parametrize("written", OPTIONS)
def test_options(written: str) -> None:
    option = ast.Option(*OPTIONS[written], span=NOWHERE)
    unique = ast.Option("UNIQUE", None, span=NOWHERE)
    for options, wanted in ((written, (option,)), (f"{written} UNIQUE", (option, unique))):
        found = query(f"SELECT a FROM b START WITH t = 1 CONNECT BY {options} t = 2, level = 3 STOP WITH c")
        same(found.options, wanted)
        same(found.connect, (assign("t", lit(2)), assign("level", lit(3))))


# A query without parentheses stands between { and }: it is the same tree with parentheses.
OPEN = [
    "[] == {SELECT this FROM p AS list}", "x = {SELECT a FROM b, c}", "max({SELECT a FROM b AS list})",
    "max({SELECT a FROM b})", "max({SELECT a FROM b AS list}, c)", "max({SELECT a FROM b, c})",
    "max(c, {SELECT a FROM b, c})", "[{SELECT a FROM b AS list}, {SELECT c FROM d AS list}]",
    "[{SELECT a FROM b AS list}, {SELECT c FROM d}]", "IF(a; {SELECT a FROM b, c}; {SELECT c FROM d})",
    "IF({SELECT a FROM b}; c)", "x[{SELECT a FROM b AS value}]", "a + {SELECT b FROM c LIMIT 1 * 2}",
    "a OR b == {SELECT c FROM d WHERE e AND f OR g}", "NOT {SELECT a FROM b}", "-{SELECT a FROM b AS value}",
    "2 ^ {SELECT a FROM b AS value}", "a AND b IN {SELECT c FROM d AS list}",
    # AS ends the query; what follows belongs to the outside.
    "[] == {SELECT a FROM b AS list} AND c", "{SELECT a FROM b AS value} + 1", "2 * {SELECT a FROM b AS value} + 1",
    "a = {SELECT b FROM c AS value} OR d", "SELECT a FROM {SELECT b FROM c AS list}",
    "SELECT a FROM {SELECT b FROM c WHERE d AS list} WHERE e", "SELECT a FROM x = {SELECT b FROM c AS list}, d",
    "SELECT a FROM {SELECT b FROM c, d AS list}, e",
    "SELECT a FROM b WHERE [] == {SELECT c FROM d WHERE e == f AS list}",
    "SELECT a FROM b WHERE c == {SELECT d FROM e AS value} AND f LIMIT 1 AS list",
    "SELECT a FROM b WHERE c IN {SELECT d FROM e LIMIT 1 AS list} LIMIT 2",
    "SELECT a FROM b WHERE c IN {SELECT d FROM e AS list} AS dict",
    "SELECT {SELECT a FROM b AS value}, c FROM d",
    "SELECT a FROM b START WITH x = {SELECT c FROM d AS value}, y = 1 CONNECT BY x = 2",
    "SELECT a FROM b ORDER BY {SELECT c FROM d ORDER BY e ASC AS value} DESC",
    "SELECT a FROM b GROUP BY {SELECT c FROM d AS value} HAVING e",
    "SELECT a FROM b WHERE max({SELECT c FROM d}) > 1",
]  # fmt: skip


@pytest.mark.parametrize("written", OPEN)
def test_open_queries(written: str) -> None:
    same(expr(written.replace("{", "").replace("}", "")), expr(written.replace("{", "(").replace("}", ")")))


# --- places ----------------------------------------------------------------------------------------------


SPANNED = [
    "  a  + b*(c - 1) ;", "x = [1, 'zwei', [], -3][0]; # comment\n y{5.0} = f(a, n = n + 1)",
    "IF(a == b AND NOT c; d; e, (f))", "a OR (b XOR c) OR v{-2.0}[1:]",
    "spheres = SELECT obj, n.this, n.mass FROM n = space, f(a) WHERE isSphere(this) AND 1 NOT IN x AS list;",
    "SELECT count(*) FROM (SELECT b FROM c) GROUP BY a HAVING d ORDER BY e DESC, f LIMIT 3",
    "SELECT a FROM b START WITH t = [1] CONNECT BY COST f(t) NO  CYCLE MAXIMUM (5) t = g(t) STOP WITH []==t AS l(x=1)",
]  # fmt: skip
PARTS = (ast.Script, ast.From, ast.Option, ast.OrderKey, ast.Representation, ast.Star)  # which cannot stand alone


@pytest.mark.parametrize("written", SPANNED)
def test_the_text_of_a_span_is_the_node(written: str) -> None:
    whole, *found = (node for node, *_ in nodes(script(written), 0, 0))
    assert isinstance(whole, ast.Script)
    assert len(found) > 5
    for node in found:
        assert node.span.text == node.span.text.strip()
        if not isinstance(node, PARTS):
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
    parts = (*found.columns, *found.sources, *found.options, *found.order, found.representation, found)
    texts = ["*", "n = a", "(b)", "no  cycle", "MAXIMUM (5)", "(c) DESC", "d", "AS f( 1 )", written]
    assert [part.span.text for part in parts if part is not None] == texts
    assert script(" a ; b ").span.text == " a ; b "
    assert expr("ﬁnd").span.text == "ﬁnd"


# --- names and keywords ----------------------------------------------------------------------------------

WORDS = [*sorted(tokenizer.CONTEXTUAL), "LIST", "VALUE", "LEVEL", "SET", "RATIO", "INDEX"]
POSITIONS = [
    "{0}", "{0} = 1", "{0} == {0}", "{0} + {0}({0}, {0} = {0})[{0}:{0}]", "{0}.{0} + {0}.this",
    "{0}{{}} + {0}{{{0}}}", "{0}{{5.0}} = {0}", "[{0}, -{0}, NOT {0}, ({0})]", "IF({0}; {0}, {0} = {0}; {0})",
    "SELECT {0}, {0} FROM x", "SELECT x FROM {0}", "SELECT x FROM {0}, {0} = {0}, {0}.{0}",
    "SELECT x FROM {0} WHERE {0} AND {0} IN {0}",
    "SELECT {0} FROM {0} START WITH {0} = {0} CONNECT BY {0} = {0} STOP WITH {0} == 7",
    "SELECT x FROM x START WITH {0} = 1, {0} = 2 CONNECT BY {0} = {0} + 1, {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY UNIQUE {0} = {0}, y = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY COST {0} {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY NO CYCLE MEMORIZE {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY MEMORIZE ({0}) MAXIMUM 3 {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY HEURISTIC {0} + 1 DEPTH FIRST {0} # word\n /* and */ = {0}",
    *(f"SELECT x FROM x START WITH y = 1 CONNECT BY UNIQUE {{0}}{gap}= 1, y = 2" for gap in
      ("", "\n", " # sign\n", " /* sign */ ")),
    "SELECT x FROM {0} GROUP BY {0}, {0} HAVING {0}", "SELECT x FROM {0} ORDER BY {0}, {0} DESC, {0} ASC",
    "SELECT x FROM {0} LIMIT {0}", "SELECT x FROM {0} LIMIT {0} GROUP BY {0} ORDER BY {0} AS {0}",
    "SELECT x FROM x AS {0}({0}, {0} = {0})",
    "SELECT {0} FROM {0} WHERE {0} GROUP BY {0} HAVING {0} ORDER BY {0} DESC LIMIT {0} AS {0}",
]  # fmt: skip


def rename(node: Any, old: str, new: str) -> Any:
    """The tree with one name changed everywhere."""
    if is_dataclass(node) and not isinstance(node, Span | type):
        values = {field.name: getattr(node, field.name) for field in fields(node)}
        return type(node)(**{key: rename(value, old, new) for key, value in values.items()})
    if isinstance(node, tuple):
        return tuple(rename(part, old, new) for part in node)
    return new if node == old and isinstance(node, str) else node


@pytest.mark.parametrize("word", WORDS)
def test_other_keywords_are_names_wherever_a_name_can_stand(word: str) -> None:
    for written in (word, word.lower(), word.capitalize()):
        for position in POSITIONS:
            if word == "PRIOR" and "{0} {0}" in position:  # which is the value of the step before
                continue
            plain = script(position.format("zz"))
            same(script(position.format(written)), rename(plain, "zz", written))


@pytest.mark.parametrize("word", sorted(tokenizer.RESERVED))
def test_reserved_words_are_no_names_in_any_case(word: str) -> None:
    for written in (word, word.lower(), word.capitalize()):
        for position in ("{} = 1", "SELECT a FROM b AS {}"):
            with pytest.raises(ParseError):
                script(position.format(written))
