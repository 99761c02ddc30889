"""Data frames as sources: pandas, Polars, Arrow, and structured arrays of NumPy.

frame is what a frame is to the rest of the package: named columns of known types, whose values are made when they are
first read. array_columns makes columns of arrays, cell_values values of single cells; the other files know one library
each, which is imported when one of its objects is attached.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeAlias

from ss2sql.errors import SessionError, require_package
from ss2sql.vtables.frames.frame import Frame as Frame

# Reads a frame as it stands now.
Reader: TypeAlias = Callable[[], Frame]

# By the package and the name of a type: the file here whose `reader(source, name)` gives a Reader.
_FILES = {
    ("pandas", "DataFrame"): "pandas",
    ("polars", "DataFrame"): "polars",
    ("pyarrow", "Table"): "arrow",
    ("pyarrow", "RecordBatch"): "arrow",
    ("numpy", "ndarray"): "array_columns",
}
_CURES = {
    ("polars", "LazyFrame"): "it has no rows yet: attach what its collect() gives",
    ("polars", "Series"): "attach its to_frame(), or its to_list()",
    ("pandas", "Series"): "attach its to_frame(), or its tolist()",
    ("pyarrow", "Array"): "attach its to_pylist(), or a table that it is a column of",
    ("pyarrow", "ChunkedArray"): "attach its to_pylist(), or a table that it is a column of",
}


def find_reader(source: Any, name: str) -> Reader | None:
    """The function that reads an object as a data frame; None for other objects.

    Args:
        source: anything.
        name: its name in scripts, for errors.

    Raises:
        SessionError: S002 for a part of a frame, a frame without rows, and where pyarrow is needed and missing.
    """
    for kind in type(source).__mro__:
        own = (kind.__module__.partition(".")[0], kind.__name__)
        if own in _CURES:
            raise SessionError("S002", f"a {own[0]}.{own[1]} cannot be attached", hints=(_CURES[own],))
        if own in _FILES:
            return _find_frame_module(_FILES[own]).reader(source, name)  # type: ignore[no-any-return]
    if hasattr(type(source), "__arrow_c_stream__"):
        return _find_frame_module("arrow").reader(_read_arrow_table(source), name)  # type: ignore[no-any-return]
    return None


def _find_frame_module(name: str) -> Any:
    return import_module(f"ss2sql.vtables.frames.{name}")


def _read_arrow_table(source: Any) -> Any:
    """Arrow data, which some objects give only once, are read here and now."""
    pyarrow = require_package("pyarrow", "df", f"to read a {type(source).__name__}, ss2sql")
    return pyarrow.RecordBatchReader.from_stream(source).read_all()
