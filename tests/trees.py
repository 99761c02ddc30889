"""Short ways to write syntax trees and to check errors, for the tests of the parser."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from ss2sql.errors import ParseError, Source, Span
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

NOWHERE = Span(Source(""), 0, 0)


def script(source: str) -> ast.Script:
    """The tree of a script."""
    return parse(Source(source))


def expr(source: str) -> ast.Expr:
    (statement,) = script(source).statements
    return statement


def query(source: str) -> ast.Query:
    found = expr(source)
    assert isinstance(found, ast.Query)
    return found


def same(found: object, wanted: object) -> None:
    """Equal trees, and equal in the types of their literals (1 == 1.0 == True)."""
    assert found == wanted
    assert repr(found) == repr(wanted)


lit = partial(ast.Literal, span=NOWHERE)
name = partial(ast.Name, span=NOWHERE)
index = partial(ast.Index, span=NOWHERE)
cut = partial(ast.Slice, span=NOWHERE)
assign = partial(ast.Assign, span=NOWHERE, name_span=NOWHERE)
select = partial(ast.Query, span=NOWHERE)
A, B, C, D = map(name, "abcd")


def op(function: str, *operands: ast.Expr) -> ast.Operator:
    return ast.Operator(function, operands, span=NOWHERE, place=NOWHERE)


def items(*parts: ast.Expr) -> ast.ListLiteral:
    return ast.ListLiteral(parts, span=NOWHERE)


def call(function: str, *arguments: ast.Expr, star: bool = False) -> ast.Call:
    return ast.Call(function, arguments, span=NOWHERE, star=star)


def this(source: str | None = None) -> ast.This:
    return ast.This(source, span=NOWHERE)


def iff(condition: ast.Expr, then: tuple[ast.Expr, ...] = (), otherwise: tuple[ast.Expr, ...] = ()) -> ast.If:
    return ast.If(condition, then, otherwise, span=NOWHERE)


def source(expr: ast.Expr, named: str | None = None) -> ast.From:
    return ast.From(named, expr, span=NOWHERE)


def shape(named: str, *arguments: ast.Expr, **keywords: ast.Expr) -> ast.Representation:
    return ast.Representation(named, arguments, tuple(assign(*pair) for pair in keywords.items()), span=NOWHERE)


def failure(source: str) -> ParseError:
    """The error of a script."""
    with pytest.raises(ParseError) as caught:
        parse(Source(source))
    return caught.value


def check(marked: str, code: str, message: str, hint: str) -> None:
    """One error, at the text between `«` and `»`, with these words in its message and in its hints.

    If an open bracket is marked by `‹` and `›`, the error says where it was opened.
    """
    plain = re.sub("[‹›]", "", marked)
    start, end = plain.index("«"), plain.index("»") - 1
    error = failure(re.sub("[«»]", "", plain))
    rendered = str(error)
    assert len(error.errors) == 1, rendered
    assert error.span is not None
    assert (error.span.start, error.span.end) == (start, end), rendered
    assert error.code == code, rendered
    assert error.hints, rendered
    assert message in error.message, rendered
    assert hint in "\n".join(error.hints), rendered
    if "‹" in marked:
        ((place, label),) = error.related
        assert (place.start, label) == (re.sub("[«»]", "", marked).index("‹"), "opened here")


def code(source: str) -> str:
    """The code of a script's error, which must say what to do."""
    error = failure(source)
    assert error.hints, str(error)
    return error.code


def calls_of(work: Callable[[], Any]) -> int:
    """How many functions are called, those of C included: what takes time, whatever the machine."""
    count = 0

    def note(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count
