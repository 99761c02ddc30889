"""What parser and compiler promise for any text, asked of one text: a program, or errors of ours inside the text.

`judge` is what `fuzz.py` runs millions of times and `test_fuzz.py` for the texts of `corpus/`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import apsw
from balls import BallWorld, Box
from cases.data import TABLES, VALUES
from cases.functions import FUNCTIONS, REPRESENTATIONS
from cases.needs import furnish

import ss2sql
from ss2sql.errors import CODES, Source, Span
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.runtime.sqlite.interning import Interning

SECONDS_PER_KIB = 2.0
VARIABLES: dict[str, Any] = {
    "xs": [1, 2, 3], "n": 2, "word": "ab", "rows": [{"k": "a", "v": 1}, {"k": "b", "v": None}],
    "columns": {"p": [1, 2], "q": ["a", "b"]}, "towers": [[3, 2, 1], [], []],
}  # fmt: skip
CALLED: dict[str, tuple[Any, str]] = {
    "f": (lambda x: x, "immutable"),
    "g": (lambda x, y=0: [x, y], "stable"),
    "tick": (lambda: 1, "volatile"),
}
# SQLite refuses statements that are too large for it; ss2sql runs such queries natively.
TOO_LARGE = ("too many", "too deep", "too large", "at most", "overflow", "too big", "too complex", "limit")


def session() -> ss2sql.Session:
    """A session with something of every kind: functions, variables, a table, a world."""
    ss = ss2sql.connect()
    for called, (function, volatility) in CALLED.items():
        ss.function(called, function, volatility=volatility)
    for name, value in VARIABLES.items():
        ss.attach(name, value)
    for need in (*FUNCTIONS, *VALUES, *REPRESENTATIONS):
        furnish(ss, [need])
    ss.host.connection.execute(";".join(TABLES.values()))
    ss.host.connection.execute("CREATE TABLE IF NOT EXISTS edges(src INTEGER, dst INTEGER, far REAL)")
    ss.attach("space", BallWorld(Box.row(2)))
    return ss


def judge(ss: ss2sql.Session, text: str, processor: Any = time.process_time) -> str:
    """Parses, resolves, lowers and compiles a text; says how far it came: "parsed", "resolved", "compiled".

    Raises AssertionError for a promise that is broken, and whatever parser and compiler raise that is no error of ours.
    """
    began = processor()
    stage = _stages(ss, text)
    used = processor() - began
    size = max(1.0, len(text) / 1024)
    assert used <= SECONDS_PER_KIB * size, f"{used:.1f} s for {size:.1f} KiB"
    return stage


def _stages(ss: ss2sql.Session, text: str) -> str:
    stage = "nothing"
    try:
        script = parse(Source(text))
        stage = "parsed"
        inside(script, 0, len(text))
        query = ss.compile(text)
        stage = "resolved"
        query.statements("auto")
        query.statements("native")
        stage = "compiled"
        with suppress(ss2sql.UnsupportedError):
            made = query.statements("database")
            for one in (one for statement in made for one in statement.queries):
                if one.lowered is not None:
                    _prepare(ss, one.lowered)
        assert query.sql is not None
    except ss2sql.Error as error:
        is_ours(error, text)
        if stage == "nothing" and not isinstance(error, ss2sql.ParseError):
            raise
    return stage


def _prepare(ss: ss2sql.Session, lowered: Any) -> None:
    """SQLite itself says whether a statement is one."""
    asked = replace(lowered, text=f"EXPLAIN {lowered.text}")
    try:
        ss.host.prepare_database().open_cursor(asked, Interning(), lambda parameter: 0).close(True)
    except (apsw.SQLError, apsw.TooBigError) as error:
        if not any(words in str(error).lower() for words in TOO_LARGE):
            raise AssertionError(f"{error}\n{lowered.text}") from error


def is_ours(error: ss2sql.Error, text: str) -> None:
    assert error.errors[0] is error
    for one in error.errors:
        assert one.code in CODES
        assert one.message
        assert one.hints, f"{one.code} says not what to do: {one.message}"
        assert one.span is not None, f"{one.code} has no place: {one.message}"
        for span in (one.span, *(place for place, _ in one.related)):
            assert 0 <= span.start <= span.end <= len(span.source.text), f"{one.code} has a place outside of the text"
        assert one.span.source.text == text or one.related, f"{one.code} shows a text that the script does not have"
        assert one.as_dict()["line"] >= 1
    str(error).encode("utf-8", "surrogatepass")


def inside(root: Any, start: int, end: int) -> None:
    """Every node of a tree lies inside its parent. Nothing here recurses."""
    for node, low, high in nodes(root, start, end):
        span: Span = node.span
        assert low <= span.start <= span.end <= high, f"{type(node).__name__} lies outside of what it belongs to"


def nodes(root: Any, start: int, end: int) -> Iterator[tuple[Any, int, int]]:
    """Every node of a tree, with the place of its parent."""
    waiting: list[tuple[Any, int, int]] = [(root, start, end)]
    while waiting:
        node, low, high = waiting.pop()
        if isinstance(node, tuple):
            waiting.extend((part, low, high) for part in node)
        elif type(node).__module__ == ast.__name__:
            yield node, low, high
            parts = (getattr(node, name) for name in node.__dataclass_fields__)
            waiting.extend((part, node.span.start, node.span.end) for part in parts)
