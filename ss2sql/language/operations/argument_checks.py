"""Checks of arguments, with the language's errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.ordering import NUMBERS
from ss2sql.language.value_messages import format_value

INTEGERS = frozenset({int, bool})
_MISFITS = {
    type(None): "leave None out with WHERE",
    str: "int(...) and float(...) make numbers of text",
    dict: "the rows of a query are dicts: write {0}(SELECT ... AS list), with one column",
    list: "give the numbers themselves, as one flat list",
}


def misuse(message: str, hint: str) -> ExecutionError:
    return ExecutionError("X007", message, hints=(hint,))


def check_list(function: str, value: Any) -> list[Any]:
    """The argument, if it is a list."""
    if type(value) is list:
        return value
    hint = f"collect the values in a list first: {function}(SELECT ... AS list)"
    raise misuse(f"{function} works on a list, not on {format_value(value)}", hint)


def check_numbers(function: str, values: Sequence[Any]) -> set[type]:
    """The types of the values, which have to be numbers."""
    kinds = set(map(type, values))
    if kinds <= NUMBERS:
        return kinds
    misfit = next(value for value in values if type(value) not in NUMBERS)
    hint = _MISFITS.get(type(misfit), "{0} works on numbers alone").format(function)
    raise misuse(f"{function} works on numbers, not on {format_value(misfit)}", hint)


def check_number(function: str, value: Any) -> Any:
    check_numbers(function, (value,))
    return value


def check_integer(function: str, value: Any) -> int:
    """The argument, if it is an integer; True counts as 1."""
    if type(value) in INTEGERS:
        return int(value)
    raise misuse(f"{function} works on integers, not on {format_value(value)}", "int(...) makes an integer")


def check_string(function: str, value: Any) -> str:
    if type(value) is str:
        return value
    raise misuse(f"{function} works on strings, not on {format_value(value)}", "str(...) makes a string")
