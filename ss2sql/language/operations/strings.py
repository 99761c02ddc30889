"""Functions of strings."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.kinds import BOOL, STR, UNENCODABLE, Kind
from ss2sql.language.operations.row import Form, Operation, each, exactly, operation
from ss2sql.runtime.messages import show

_PLAIN = each(Kind.NONE | Kind.NUMBER | Kind.STR)


@lru_cache(maxsize=256)
def _pieces(pattern: str) -> list[re.Pattern[str]]:
    """What stands between the % of a pattern. Each has one length, so that no text makes it try again and again."""
    pieces = ("".join("." if char == "_" else re.escape(char) for char in piece) for piece in pattern.split("%"))
    return [re.compile(piece, re.DOTALL) for piece in pieces]


def like(value: Any, pattern: Any) -> bool:
    """Whether a string is what the pattern says: % stands for any text, _ for any character, and case counts."""
    if type(value) is not str or type(pattern) is not str:
        hint = "LIKE compares strings: ask x IS NOT NULL AND ... before, or make a string with str(...)"
        raise ExecutionError("X001", f"cannot compute {show(value)} LIKE {show(pattern)}", hints=(hint,))
    first, *rest = _pieces(pattern)
    if not rest:
        return first.fullmatch(value) is not None
    *middle, last = rest
    at = 0
    for number, piece in enumerate((first, *middle)):
        found = piece.search(value, at) if number else piece.match(value)
        if found is None:
            return False
        at = found.end()
    tail = len(pattern) - 1 - pattern.rindex("%")
    return at + tail <= len(value) and last.match(value, len(value) - tail) is not None


def _unlike(value: Any, pattern: Any) -> bool:
    return not like(value, pattern)


def _likeness(name: str, symbol: str, value: Callable[..., bool], negated: str, about: str, example: str) -> Operation:
    return operation(
        name, 2, value, BOOL, lambda types: not each(Kind.STR)(types),
        symbol=symbol, call=f"a {symbol} b", about=about, example=example, negated=negated,
        by_hand=frozenset({"sqlite", "portable"}),  # a pattern that is known beforehand
    )  # fmt: skip


OPERATIONS = (
    _likeness(
        "like", "LIKE", like, "not_like", "a LIKE b: % is any text, _ is any character",
        "['Oslo' LIKE 'O%', 'Oslo' LIKE 'o___']",
    ),
    _likeness("not_like", "NOT LIKE", _unlike, "like", "a NOT LIKE b", "'Oslo' NOT LIKE 'A%'"),
    operation(  # what an object writes of itself may be anything
        "str", 1, str, lambda types: STR if _PLAIN(types) else UNENCODABLE, lambda types: types[0].may(Kind.STRUCTURED),
        call="str(x)", about="the value as text", example="str([1, 2.0])", grows=True,
        # Integers look the same everywhere; Python's floats, bools and None do not.
        sqlite=(Form("{0}", exactly(Kind.STR)), Form("cast({0} AS TEXT)", exactly(Kind.INT))),
        python=(Form("str({0})", _PLAIN),),
        portable=(Form("{0}", exactly(Kind.STR)), Form("cast({0} AS VARCHAR)", exactly(Kind.INT))),
    ),
)  # fmt: skip
