"""Structured arrays of NumPy, whose fields are columns. All other arrays are lists, as everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ss2sql.vtables.frames.columns import column_of
from ss2sql.vtables.frames.frame import Frame, distinct_names

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader


def reader(source: Any, name: str) -> Reader | None:
    """What reads the array; None where it is a list to scripts."""
    return (lambda: _read(source.copy(), name)) if source.dtype.names and source.ndim == 1 else None


def _read(array: Any, name: str) -> Frame:
    names = distinct_names(array.dtype.names, name)
    columns = {word: column_of(array[word], None, f"the column '{word}' of '{name}'") for word in names}
    return Frame(columns, len(array))
