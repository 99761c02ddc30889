"""The columns of an element: what `row.name` means, in both engines and in `row["name"]`."""

from __future__ import annotations

from typing import Any

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.language.kinds import Handle, Opaque, list_attributes
from ss2sql.language.values import convert_value, format_value

_MISSING = object()


def read_column(element: Any, name: str, default: Any = _MISSING) -> Any:
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
        raise _build_missing_error(name, [key for key in element if isinstance(key, str)], "this row")
    owner = element.object if isinstance(element, Opaque) else element
    if isinstance(owner, Handle):
        try:
            return convert_value(owner.__column__(name), f"the column '{name}'")
        except KeyError:
            if default is not _MISSING:
                return default
            raise _build_missing_error(name, list(owner.__columns__()), repr(owner)) from None
    known = list_attributes(owner)
    if name in known:
        held = getattr(owner, "__dict__", {})
        found = held[name] if name in held else getattr(owner, name, default)  # a slot may be empty
        if found is not _MISSING:
            return convert_value(found, f"the attribute '{name}'", named=True)
    elif default is not _MISSING:
        return default
    list_columns = getattr(type(owner), "__columns__", None)  # of a world; other objects are not touched
    shown = known if list_columns is None else list_columns(owner)
    raise _build_missing_error(name, list(shown), format_value(element))


def _build_missing_error(name: str, known: list[str], owner: str) -> ExecutionError:
    hints = suggest_names(name, known) or (
        "dicts, and objects with public attributes, have columns; `this` is the element itself",
    )
    return ExecutionError("X008", f"{owner} has no column '{name}'", hints=hints)
