"""Short ways to parse and to check errors, for the tests of the parser."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from typing import Any

import pytest

from ss2sql.errors import ParseError, Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse


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
