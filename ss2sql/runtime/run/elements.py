"""What stands in FROM: the elements of a value. Both engines read them here."""

from __future__ import annotations

from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import Opaque
from ss2sql.language.values import format_value
from ss2sql.vtables import has_adapter
from ss2sql.vtables.frames import Frame

PLAIN_TYPES = frozenset({type(None), bool, int, float, str, list, dict, bytes})


def list_source_elements(value: Any) -> list[Any]:
    """The elements of a value as a new list, which stays as it is when the value changes.

    A list gives its items, a dict of equally long lists one dict per row, anything else itself.

    Raises:
        ExecutionError: X005 for a dict of lists that are not equally long.
    """
    kind = type(value)
    if kind is list:
        return list(value)
    if isinstance(value, Frame):
        return value.list_dicts()
    if kind is dict and value and set(map(type, value.values())) == {list}:
        return _zip_from_columns(value)
    if kind not in PLAIN_TYPES and has_adapter(value.object if kind is Opaque else value):
        hint = "attach it: attach(name, object); its tables and columns are then known"
        raise ExecutionError("X005", f"a {type(value).__name__} is a world, and no list", hints=(hint,))
    return [value]


def list_elements_or_none(value: Any) -> list[Any]:
    """The elements of a value; None alone where there are none."""
    return list_source_elements(value) or [None]


def _zip_from_columns(columns: dict[Any, list[Any]]) -> list[Any]:
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ExecutionError(
            "X005",
            f"a dict of columns needs lists of equal length, and these have the lengths {format_value(lengths)}",
            hints=("fill up the shorter columns with None, or put the dict into a list to make it one element",),
        )
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
