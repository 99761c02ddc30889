"""What an executor hands to the representations: rows or the paths of a search, and what a representation is given."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import field, replace
from functools import lru_cache
from itertools import chain
from math import isfinite
from typing import Any, ClassVar, Literal, NoReturn, TypeAlias, TypeVar

from ss2sql.errors import ExecutionError, RepresentationError, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.cancellation import ITEMS_PER_CHECK, Check, iterate_with_check
from ss2sql.language.plan import FactColumn
from ss2sql.language.values import convert_value, copy_deep, format_value

Path = TypeVar("Path", bound=Sequence[Any])
Row: TypeAlias = tuple[Any, ...]


class NamedRow(tuple[Any, ...]):
    """A row of a result: a tuple whose values are also found by the names of their columns, `row["x"]` and `row.x`.

    A name that tuples use for themselves, `count` or `index`, is found as `row["count"]` only.
    """

    __slots__ = ()
    _fields: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, key: Any) -> Any:
        if type(key) is not str:
            return tuple.__getitem__(self, key)
        if key not in self._fields:
            raise KeyError(self._explain_name(key))
        return tuple.__getitem__(self, self._fields.index(key))

    def __getattr__(self, name: str) -> Any:
        if name not in self._fields:
            raise AttributeError(self._explain_name(name))
        return self[name]

    def _explain_name(self, name: str) -> str:
        return f"no column '{name}'; the columns are {', '.join(self._fields)}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _make_row, (self._fields, tuple(self))


def _make_row(columns: tuple[str, ...], values: Row) -> NamedRow:
    return make_row_class(columns)(values)


@lru_cache(maxsize=64)
def make_row_class(columns: tuple[str, ...]) -> Callable[[Row], NamedRow]:
    """What makes rows of these columns; it takes 0.2 us for each, and the garbage collector as much again."""
    return type("Row", (NamedRow,), {"__slots__": (), "_fields": columns})


@dataclass(slots=True)
class Rows:
    """The answer of one query, before `AS`."""

    columns: tuple[str, ...]
    rows: list[Row] | None = None  # of a flat query
    paths: Sequence[Sequence[Row]] | None = None  # of a search: the rows of each path
    groups: list[tuple[Any, list[int]]] | None = None  # values, and positions in `rows` or `paths`
    plain: bool = False  # rows consist of immutable values: numbers, strings, bools and None
    hidden: int = 0  # how many of the last columns are for the representation alone
    ended: bool = False  # by MAXIMUM, of the script or of the run

    def clear_rows(self) -> None:
        """Forgets all rows and paths."""
        if self.rows is not None:
            self.rows.clear()
        if self.paths is not None:
            self.paths = []

    def copy_values(self) -> None:
        """Makes the rows independent of values that somebody else may change."""
        if not self.plain:
            self.rows = copy_deep(self.rows)
            self.paths = copy_deep(self.paths)  # Paths, which a database has found, hold nothing of anybody else
            self.groups = copy_deep(self.groups)

    def check_values(self) -> None:
        """Raises ExecutionError X004 for what is no value of the language, such as an infinity in a table."""
        for name, values in zip(self.columns, zip(*self.list_all_rows(), strict=True), strict=False):
            convert_value(list(values), f"the column '{name}'")
        convert_value([value for value, _ in self.groups or ()], "GROUP BY")

    def name_as_selected(self) -> Rows:
        hidden = self.hidden
        if not hidden:
            return self
        rows = None if self.rows is None else [row[:-hidden] for row in self.rows]
        paths = None if self.paths is None else [[row[:-hidden] for row in path] for path in self.paths]
        return replace(self, columns=self.columns[:-hidden], rows=rows, paths=paths, hidden=0)

    def list_all_rows(self) -> Iterator[Row]:
        """The rows, or the rows of all paths."""
        return iter(self.rows or ()) if self.paths is None else chain.from_iterable(self.paths)

    def expand_stars(self, stars: frozenset[int], check: Check | None = None) -> Rows:
        """The rows with the columns at these positions taken apart, where all their values are dicts.

        This is SELECT * over a source whose columns only its elements know.
        """
        parts: list[tuple[int, tuple[str, ...] | None]] = []
        for index in range(len(self.columns)):
            values = [row[index] for row in iterate_with_check(self.list_all_rows(), check)] if index in stars else []
            apart = bool(values) and all(isinstance(value, dict) and value for value in values)
            parts.append((index, tuple({key: None for value in values for key in value}) if apart else None))
        names = make_unique_column_names(name for index, keys in parts for name in keys or (self.columns[index],))

        def expand_row(row: Row) -> Row:
            cells: list[Any] = []
            for index, keys in parts:
                cells.extend((row[index],) if keys is None else map(row[index].get, keys))
            return tuple(cells)

        rows = None if self.rows is None else [expand_row(row) for row in iterate_with_check(self.rows, check)]
        paths = (
            None
            if self.paths is None
            else [list(map(expand_row, path)) for path in iterate_checked_paths(self.paths, check)]
        )
        return replace(self, columns=names, rows=rows, paths=paths)


def make_unique_name(name: str, taken: Collection[str]) -> str:
    """The name, or the name with the first number that makes it a new one: `name_2`."""
    candidate, count = name, 1
    while candidate in taken:
        count += 1
        candidate = f"{name}_{count}"
    return candidate


def make_unique_column_names(names: Iterable[str]) -> tuple[str, ...]:
    """The names of columns, a repeated one with `_2`, then `_3`."""
    taken: dict[str, None] = {}
    for name in names:
        taken[make_unique_name(name, taken)] = None
    return tuple(taken)


def iterate_checked_paths(paths: Iterable[Path], check: Check | None) -> Iterable[Path]:
    """The paths, or the lists of their cells, with a check after every few thousand rows or cells."""
    return paths if check is None else _iterate_checked_paths(paths, check)


def _iterate_checked_paths(paths: Iterable[Path], check: Check) -> Iterator[Path]:
    seen = 0
    for path in paths:
        yield path
        seen += len(path) + 1
        if seen >= ITEMS_PER_CHECK:
            seen = 0
            check()


def iterate_limited_rows(rows: Iterable[Row], most: int) -> Iterator[Row]:
    """The rows; raises ExecutionError X010 at the first one beyond `most`."""
    for number, row in enumerate(rows, 1):
        check_row_limit(number, most)
        yield row


def check_row_limit(number: int, most: int | None) -> None:
    """Raises ExecutionError X010 for more results than `most`."""
    if most is not None and number > most:
        raise build_row_limit_error(most)


def build_row_limit_error(most: int, span: Span | None = None) -> ExecutionError:
    """The error for more results than the run allows."""
    hints = ("add LIMIT or MAXIMUM to the query, or raise max_rows",)
    return ExecutionError("X010", f"the query has more than max_rows={most} results", span, hints)


# --- what a representation is given
def make_label(value: Any) -> str:
    """The name that `to(expr, value)` gives a column."""
    return value if isinstance(value, str) else str(value)


F = TypeVar("F", bound=Callable[..., Any])
HIDDEN_COLUMNS_ATTRIBUTE = "__ss2sql_asks__"


def request_hidden_columns(wanted: Literal["elements", "calls"]) -> Callable[[F], F]:
    """Decorator of representations that ask for more than the columns: they find it in `Table.hidden`.

    "elements": the element of the source that the columns read, one for each row, if there is no choice. "calls": the
    arguments of the calls in SELECT.
    Searches and groups with aggregates have rows that belong to no single element; of them nothing is hidden.
    """

    def note_columns(function: F) -> F:
        setattr(function, HIDDEN_COLUMNS_ATTRIBUTE, wanted)
        return function

    return note_columns


@dataclass(frozen=True, slots=True)
class Table:
    """Rows with names for their columns: `columns` a tuple of strings, `rows` a list of tuples.

    `hidden` are tuples, one for each row, of what a representation has requested; without any where there is nothing.
    `facts` says how the columns are calls, see `ss2sql.language.plan.FactColumn`; `labels` are the places of columns
    that each row names by its hidden values. Who walks the table itself, not its `rows`, is ended where the run
    has to end, which is what `check` says.
    """

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]
    hidden: list[tuple[Any, ...]] = field(default_factory=list)
    facts: tuple[FactColumn, ...] = ()
    labels: tuple[int, ...] = ()
    check: Check | None = field(default=None, compare=False, repr=False)

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        return iter(iterate_with_check(self.rows, self.check))

    def __len__(self) -> int:
        return len(self.rows)

    def dicts(self) -> list[dict[str, Any]]:
        """The rows as dicts."""
        if not self.labels:
            return [dict(zip(self.columns, row, strict=True)) for row in self]
        return [dict(zip(self._choose_names(n), row, strict=True)) for row, n in zip(self, self.hidden, strict=True)]

    def _choose_names(self, labels: tuple[Any, ...]) -> tuple[str, ...]:
        names = dict(enumerate(self.columns)) | dict(zip(self.labels, map(make_label, labels), strict=True))
        return make_unique_column_names(names.values())


# --- the arguments of representations over an area: what they have to be, and the error that shows how AS is written
MAX_CELLS = 16_000_000  # as many numbers take 128 MB
_AREA = "(0.3, 0.1), or (0.3, 0.1, [[0, 0], [16, 12]]): height, edge of a cell, and area in metres"
_USAGE = {
    "plane": 'write AS plane("XY", [-5, -5], [100, 100, 0.1], 3): corner, 100 x 100 cells of 0.1 m, blur in cells',
    "occupancygrid": f"write AS occupancygrid{_AREA}",
    "sensorgrid": f"write AS sensorgrid{_AREA}",
}


def refuse_argument(form: str, message: str, *hints: str) -> NoReturn:
    """Raises the error of a representation, whose place is that of AS. Without hints it shows how it is called."""
    raise RepresentationError("V001", f"AS {form} {message}", hints=hints or (_USAGE[form],))


def check_number(form: str, what: str, value: Any, above: float = float("-inf")) -> float:
    """An argument that has to be a number, and larger than `above`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value) or not value > above:
        limit = f" above {above:g}" if isfinite(above) else ""
        refuse_argument(form, f"needs {what}, a number{limit}, not {format_value(value)}")
    return float(value)


def check_numbers(form: str, what: str, value: Any, count: int) -> list[float]:
    """An argument that has to be a list of numbers."""
    if not isinstance(value, list) or len(value) != count:
        refuse_argument(form, f"needs {what}, a list of {count} numbers, not {format_value(value)}")
    return [check_number(form, what, part) for part in value]


def check_area_cells(form: str, columns: float, rows: float, *hints: str) -> None:
    """Raises where a grid would be too large."""
    if columns * rows > MAX_CELLS:
        hint = f"choose larger cells: {MAX_CELLS:,} are possible"
        refuse_argument(form, f"would have {columns:.0f} x {rows:.0f} cells", hint, *hints)
