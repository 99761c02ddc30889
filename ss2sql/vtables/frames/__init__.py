"""What stands in FROM: data frames of pandas, Polars, Arrow, structured arrays of NumPy, and the elements of a value.

A frame has named columns of one length and of known types, whose values are made when they are first read.
array_columns makes columns of arrays and the values of single cells; the other files know one library each, which is
imported when one of its objects is attached.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import cached_property
from importlib import import_module
from typing import Any, TypeAlias

from ss2sql.errors import ExecutionError, SessionError, require_package
from ss2sql.language.kinds import Kind, Opaque, Type, Typed
from ss2sql.language.values import convert_value, format_value
from ss2sql.vtables.contract import has_adapter


class Column:
    """One column. `type` is that of its values, which `make` converts when they are first read."""

    def __init__(self, kind: Type, make: Callable[[], list[Any]]) -> None:
        self.type = kind
        self._make = make

    @cached_property
    def values(self) -> list[Any]:
        return self._make()

    def __getstate__(self) -> dict[str, Any]:
        """What `pickle` writes: the values, without the data frame that they are read from."""
        return {"type": self.type, "values": self.values}


class Frame(Typed):
    """A snapshot of a data frame. Its value is a dict of columns, its elements are the rows."""

    __slots__ = ("columns", "length")

    def __init__(self, columns: dict[str, Column], length: int) -> None:
        self.columns = columns
        self.length = length
        empty = Type(Kind.LIST, element=Type(Kind.DICT, columns=()), columns=())  # rows without columns
        super().__init__(_type_of_frame(columns) if columns else empty)

    def make_value(self) -> Any:
        """The value of the language: a dict of columns; of a frame without columns a list of empty rows."""
        if not self.columns:
            return [{}] * self.length
        return {name: column.values for name, column in self.columns.items()}

    def list_rows(self, names: Sequence[str]) -> list[tuple[Any, ...]]:
        """The rows as tuples of the values in some columns."""
        if not names:
            return [()] * self.length
        return list(zip(*(self.columns[name].values for name in names), strict=True))

    def list_dicts(self) -> list[dict[str, Any]]:
        names = tuple(self.columns)
        return [dict(zip(names, row, strict=True)) for row in self.list_rows(names)]

    def __repr__(self) -> str:
        return f"<data frame of {self.length:,} rows: {', '.join(self.columns)}>"


def _type_of_frame(columns: dict[str, Column]) -> Type:
    types = ((name, column.type) for name, column in columns.items())
    return Type(Kind.DICT, columns=tuple((n, Type(Kind.LIST, element=t, columns=t.columns or ())) for n, t in types))


def name_frame_columns(labels: Iterable[Hashable], owner: str) -> list[str]:
    """The names of columns: strings unchanged, the parts of a tuple joined by `_`, other labels as strings.

    Raises ExecutionError X005 where two columns have one name.
    """
    names = ["_".join(map(str, label)) if isinstance(label, tuple) else str(label) for label in labels]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        hints = ("give every column a name of its own",)
        raise ExecutionError("X005", f"the data frame '{owner}' has two columns called '{twice}'", hints=hints)
    return names


# --- which objects are frames, and what reads them
# Reads a frame as it stands now.
Reader: TypeAlias = Callable[[], Frame]

# By the package and the name of a type: the file here, and its function of a source and its name that gives a Reader.
_FUNCTIONS = {
    ("pandas", "DataFrame"): ("pandas", "reader"),
    ("polars", "DataFrame"): ("arrow", "polars_reader"),
    ("pyarrow", "Table"): ("arrow", "reader"),
    ("pyarrow", "RecordBatch"): ("arrow", "reader"),
    ("numpy", "ndarray"): ("array_columns", "reader"),
}
_CURES = {
    ("polars", "LazyFrame"): "it has no rows yet: attach what its collect() gives",
    ("polars", "Series"): "attach its to_frame(), or its to_list()",
    ("pandas", "Series"): "attach its to_frame(), or its tolist()",
    ("pyarrow", "Array"): "attach its to_pylist(), or a table that it is a column of",
    ("mujoco", "MjModel"): "attach its MjData, after mj_forward(model, data)",
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
        if own in _FUNCTIONS:
            return _load_reader(*_FUNCTIONS[own], source)(source, name)
    if hasattr(type(source), "__arrow_c_stream__"):
        make = _load_reader("arrow", "reader", source)
        # Some objects give Arrow data only once, so they are read here and now.
        return make(import_module("pyarrow").RecordBatchReader.from_stream(source).read_all(), name)
    return None


_SERIES = {("polars", "Series"), ("pandas", "Series")}


def convert_given_value(name: str, value: Any) -> Any:
    """What a variable is given, as a value of the language: a data frame as its columns, a Series as its values.

    Raises SessionError S002 as `find_reader` does, ExecutionError X004 and X005 for what has no value.
    """
    if type(value) not in PLAIN_TYPES:
        series = (type(value).__module__.partition(".")[0], type(value).__name__) in _SERIES
        reader = find_reader(value.to_frame() if series else value, name)
        if reader is not None:
            frame = reader()
            value = next(iter(frame.columns.values())).values if series else frame.make_value()
    return convert_value(value, f"the variable '{name}'", named=True)


def _load_reader(file: str, function: str, source: Any) -> Callable[[Any, str], Reader | None]:
    if file == "arrow":
        require_package("pyarrow", "df", f"to read a {type(source).__name__}, ss2sql")
    return getattr(import_module(f"ss2sql.vtables.frames.{file}"), function)  # type: ignore[no-any-return]


# --- the elements of a value that stands in FROM; both engines read them here
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
