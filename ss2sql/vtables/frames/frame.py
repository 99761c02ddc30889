"""Data frames as scripts see them: named columns of one length, with types that are known before the values."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import Kind, Type, Typed


class Column:
    """One column. `type` is that of its values, which `make` converts when they are first read."""

    __slots__ = ("_make", "_values", "type")

    def __init__(self, kind: Type, make: Callable[[], list[Any]]) -> None:
        self.type = kind
        self._make = make
        self._values: list[Any] | None = None

    @property
    def values(self) -> list[Any]:
        if self._values is None:
            self._values = self._make()
        return self._values


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
