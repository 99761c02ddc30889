"""Functions of strings."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import BOOL, NOTHING, STR, UNENCODABLE, Kind, Type, Types, make_text_type, unite
from ss2sql.language.operations.lists import LENGTH
from ss2sql.language.operations.operation import (
    Form,
    Operation,
    check_list,
    check_string,
    declare,
    each,
    element_type,
    exactly,
    misuse,
)

MOST_WIDTH = 1000  # characters of a value that `format` writes
_PLAIN = each(Kind.NONE | Kind.NUMBER | Kind.STR)
_STRINGS, _STRING = each(Kind.STR), exactly(Kind.STR)
# SQLite changes the case of ASCII letters alone; Python makes SS of a sharp s, other databases one letter.
_ASCII = "{0} NOT GLOB '*[^ -~]*' AND instr({0}, char(0)) = 0"


def _not_strings(types: Types) -> bool:
    return not _STRINGS(types)


def _declare_string_method(
    name: str, compute: Callable[..., Any], arity: int | tuple[int, int], **others: Any
) -> Operation:
    """The row of a function that is a method of Python's strings."""

    def call_method(*strings: Any) -> Any:
        return compute(*(check_string(name, one) for one in strings))

    call_method.__name__ = name
    others = {"result": make_text_type, "can_fail": _not_strings, "python": (Form(compute, _STRINGS),), **others}
    return declare(name, arity, call_method, others.pop("result"), others.pop("can_fail"), **others)


def _split_string(value: str, separator: str | None = None) -> list[str]:
    if separator == "":
        raise misuse("split by an empty string", "the characters of a string are x[0], x[1], ...")
    return value.split(separator)


def _infer_parts(types: Types) -> Type:
    text = make_text_type(types[:1])
    return Type(Kind.LIST, element=text, columns=()) if text != NOTHING else NOTHING


def join_list(values: Any, separator: Any = "") -> str:
    """The elements of a list, as `str` writes them, with the separator between them."""
    return check_string("join", separator).join(map(str, check_list("join", values)))


def _infer_join(types: Types) -> Type:
    known = _PLAIN([element_type(types[0])]) and _STRINGS(types[1:])
    return (STR if known else UNENCODABLE) if types[0].may_be(Kind.LIST) else NOTHING


def _can_join_fail(types: Types) -> bool:
    return not types[0].is_only(Kind.LIST) or element_type(types[0]).may_be(Kind.STRUCTURED) or _not_strings(types[1:])


def replace_text(value: Any, old: Any, new: Any) -> str:
    """The string with `new` in the place of each `old`."""
    for one in (value, old, new):
        check_string("replace", one)
    if not old:
        raise misuse("replace of an empty string", "name the part of the string that is to be replaced")
    return str(value.replace(old, new))


_FIELD = re.compile(r"\{\{|\}\}|\{(\d*)(?::([^{}]*))?\}|[{}]")


def _compute_format(pattern: Any, *values: Any) -> str:
    """Python's `format` with `{}`, `{0}` or `{:.2f}`; attributes and items of values are refused."""
    count = 0

    def fill_field(found: re.Match[str]) -> str:
        nonlocal count
        whole, place, spec = found.group(), found.group(1), found.group(2) or ""
        if whole in ("{{", "}}"):
            return whole[0]
        if place is None:
            raise misuse(
                f"format cannot read {format_value(pattern)}", "a value stands in {}, {0} or {:.2f}; {{ is a brace"
            )
        number = int(place) if place else count
        count += not place
        if number >= len(values):
            message = f"format has no value number {number} for {format_value(pattern)}"
            raise misuse(message, "each {} takes one more argument")
        return _compute_formatted(values[number], spec)

    return _FIELD.sub(fill_field, check_string("format", pattern))


def _compute_formatted(value: Any, spec: str) -> str:
    if any(int(width) > MOST_WIDTH for width in re.findall(r"\d+", spec)):
        raise misuse(f"format with {spec!r}", f"a value takes at most {MOST_WIDTH} characters")
    try:
        return format(value, spec) if spec else str(value)
    except (ValueError, TypeError, OverflowError):
        message = f"format cannot write {format_value(value)} with {spec!r}"
        raise misuse(message, "{:.2f} writes a number with two digits, {:>8} a string in eight places") from None


@lru_cache(maxsize=256)
def _compile_like_pattern(pattern: str) -> re.Pattern[str]:
    """The pattern as a regular expression. A part between two % is taken where it first occurs, and never elsewhere."""
    first, *others = ("".join("." if char == "_" else re.escape(char) for char in part) for part in pattern.split("%"))
    parts = [first, *(f"(?>.*?{part})" for part in others[:-1]), *(f".*{part}" for part in others[-1:])]
    return re.compile("".join(parts), re.DOTALL)


def matches_pattern(value: Any, pattern: Any) -> bool:
    """Whether a string matches the pattern: % is any text, _ any character, and case counts."""
    if type(value) is not str or type(pattern) is not str:
        hint = "LIKE compares strings: ask x IS NOT NULL AND ... before, or make a string with str(...)"
        raise ExecutionError(
            "X001", f"cannot compute {format_value(value)} LIKE {format_value(pattern)}", hints=(hint,)
        )
    return _compile_like_pattern(pattern).fullmatch(value) is not None


def _mismatches_pattern(value: Any, pattern: Any) -> bool:
    return not matches_pattern(value, pattern)


def _make_like(name: str, symbol: str, value: Callable[..., bool], negated: str, about: str, example: str) -> Operation:
    return declare(
        name, 2, value, BOOL, lambda types: not each(Kind.STR)(types),
        symbol=symbol, call=f"a {symbol} b", about=about, example=example, negated=negated,
        by_hand=frozenset({"sqlite", "portable"}),  # a pattern that is known beforehand
    )  # fmt: skip


OPERATIONS = (
    _make_like(
        "like", "LIKE", matches_pattern, "not_like", "a LIKE b: % is any text, _ is any character",
        "['Oslo' LIKE 'O%', 'Oslo' LIKE 'o___']",
    ),
    _make_like("not_like", "NOT LIKE", _mismatches_pattern, "like", "a NOT LIKE b", "'Oslo' NOT LIKE 'A%'"),
    declare(  # an object's own text may be anything
        "str", 1, str, lambda types: STR if _PLAIN(types) else UNENCODABLE,
        lambda types: types[0].may_be(Kind.STRUCTURED), call="str(x)", about="the value as text",
        example="str([1, 2.0])", grows=True,
        # Integers have the same text everywhere; Python's floats, bools and None have their own.
        sqlite=(Form("{0}", _STRING), Form("cast({0} AS TEXT)", exactly(Kind.INT))),
        python=(Form("str({0})", _PLAIN),),
        portable=(Form("{0}", _STRING), Form("cast({0} AS VARCHAR)", exactly(Kind.INT))),
    ),
    _declare_string_method(
        "upper", str.upper, 1, call="upper(s)", about="the string in capitals", example="upper('abc')", grows=True,
        sqlite=(Form("upper({0})", _STRING, only=_ASCII),),
    ),
    _declare_string_method(
        "lower", str.lower, 1, call="lower(s)", about="the string in small letters", example="lower('ABC')", grows=True,
        sqlite=(Form("lower({0})", _STRING, only=_ASCII),),
    ),
    _declare_string_method(
        "strip", str.strip, (1, 2), call="strip(s) or strip(s, characters)",
        about="the string without blanks, or these characters, at its ends",
        example="[strip(' a b '), strip('--a-', '-')]", result=lambda types: make_text_type(types[:1]),
    ),
    _declare_string_method(
        "split", _split_string, (1, 2), call="split(s) or split(s, separator)", result=_infer_parts, grows=True,
        about="the parts of a string between blanks or separators", example="[split('a b'), split('a,b', ',')]",
        can_fail=lambda types: _not_strings(types) or len(types) > 1, python=(),
    ),
    declare(
        "join", (1, 2), join_list, _infer_join, _can_join_fail, call="join(list) or join(list, separator)", grows=True,
        about="the elements of a list as one string", example="[join(['a', 'b']), join([1, 2], '-')]",
    ),
    declare(
        "replace", 3, replace_text, make_text_type, True, call="replace(s, old, new)", grows=True,
        about="the string with new in the place of each old", example="replace('a-b-c', '-', '+')",
        sqlite=(Form('"replace"({0}, {1}, {2})', _STRING,
                     " AND ".join(["{1} <> ''", *(f"instr({{{n}}}, char(0)) = 0" for n in range(3))])),),
    ),
    _declare_string_method(
        "starts", str.startswith, 2, call="starts(s, part)", about="whether the string begins with a part",
        example="starts('abc', 'ab')", result=lambda types: BOOL, portable=(Form("starts_with({0}, {1})", _STRING),),
    ),
    _declare_string_method(
        "ends", str.endswith, 2, call="ends(s, part)", about="whether the string ends with a part",
        example="ends('abc', 'bc')", result=lambda types: BOOL,
    ),
    _declare_string_method(
        "find", str.find, 2, call="find(s, part)", about="the place of the first such part, -1 without one",
        example="[find('abc', 'c'), find('abc', 'x')]", result=lambda types: Type(Kind.INT, -1, LENGTH),
        sqlite=(Form("instr({0}, {1}) - 1", _STRING),),
    ),
    declare(
        "format", (1, None), _compute_format,
        lambda types: unite((UNENCODABLE,)) if types[0].may_be(Kind.STR) else NOTHING, True,
        call="format(s, a, b, ...)", about="the string with values in the places of {}, {0} or {:.2f}",
        example="format('{} is {:.2f}', 'pi', pi())", grows=True,
    ),
)  # fmt: skip
