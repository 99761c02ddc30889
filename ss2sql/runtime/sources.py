"""What stands in FROM: the elements of a value, and the columns of an element. Both executors read them here."""

from __future__ import annotations

from typing import Any

from ss2sql.errors import ExecutionError, did_you_mean
from ss2sql.kinds import Opaque, attributes
from ss2sql.runtime.values import normalise, show
from ss2sql.vtables import has_adapter
from ss2sql.vtables.base import Element
from ss2sql.vtables.frames.frame import Frame
from ss2sql.vtables.schema import element_column, schema_of

_MISSING = object()
PLAIN = frozenset({type(None), bool, int, float, str, list, dict, bytes})


def elements(value: Any) -> list[Any]:
    """The elements of a value as a new list, which stays as it is when the value changes.

    A list gives its items, a dict of equally long lists one dict per row, anything else itself.

    Raises:
        ExecutionError: X005 for a dict of lists that are not equally long.
    """
    kind = type(value)
    if kind is list:
        return list(value)
    if isinstance(value, Frame):
        return value.elements()
    if kind is dict and value and set(map(type, value.values())) == {list}:
        return _rows_of_columns(value)
    if kind not in PLAIN and has_adapter(value.object if kind is Opaque else value):
        hint = "attach it: attach(name, object); its tables and columns are then known"
        raise ExecutionError("X005", f"a {type(value).__name__} is a world, and no list", hints=(hint,))
    return [value]


def elements_or_none(value: Any) -> list[Any]:
    """The elements of a value; None alone where there are none."""
    return elements(value) or [None]


def _rows_of_columns(columns: dict[Any, list[Any]]) -> list[Any]:
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ExecutionError(
            "X005",
            f"a dict of columns needs lists of equal length, and these have the lengths {show(lengths)}",
            hints=("fill up the shorter columns with None, or put the dict into a list to make it one element",),
        )
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def column_of(element: Any, name: str, default: Any = _MISSING) -> Any:
    """The column of an element: the value of a dict's key, or a public data attribute of an object.

    Args:
        element: the current element of a source.
        name: the column.
        default: what stands for a missing column; without it a missing column is an error.

    Raises:
        ExecutionError: X008 for a missing column, X004 where an attribute holds what is not a value.
    """
    if type(element) is dict:
        found = element.get(name, default)
        if found is not _MISSING:
            return found
        raise _missing(name, [key for key in element if isinstance(key, str)], "this row")
    owner = element.object if isinstance(element, Opaque) else element
    if isinstance(owner, Element):
        try:
            return normalise(element_column(owner, name), f"the column '{name}'")
        except KeyError:
            if default is not _MISSING:
                return default
            raise _missing(name, list(schema_of(owner.table).kinds), repr(owner)) from None
    known = attributes(owner)
    if name in known:
        held = getattr(owner, "__dict__", {})
        found = held[name] if name in held else getattr(owner, name, default)  # a slot may be empty
        if found is not _MISSING:
            return normalise(found, f"the attribute '{name}'", named=True)
    elif default is not _MISSING:
        return default
    raise _missing(name, list(known), show(element))


def _missing(name: str, known: list[str], owner: str) -> ExecutionError:
    hints = did_you_mean(name, known) or (
        "dicts, and objects with public attributes, have columns; `this` is the element itself",
    )
    return ExecutionError("X008", f"{owner} has no column '{name}'", hints=hints)
