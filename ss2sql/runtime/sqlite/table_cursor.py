"""The cursor of a world's table, by SQLite's protocol: Filter, then Eof, Column and Next for each row.

The calls for every row and column are methods of a dict, a list or a generator where possible: a call of Python code
takes as long as three of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.runtime.sqlite.interning import Interning
from ss2sql.runtime.sqlite.row_buffer import Fill, Walk, is_plain_in_sqlite
from ss2sql.vtables.reading import NOTHING, Reading

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.virtual_table import WorldModule

SqlValue: TypeAlias = Any
Read: TypeAlias = Callable[[Any], SqlValue]


@lru_cache(maxsize=1000)
def read_cursor_plan(plan: str) -> tuple[tuple[str, str], ...]:
    """The columns and comparisons, or the parameters, of a plan's arguments, in their order."""
    if plan == "all":
        return ()
    parts = (text.split(" ") for text in plan.split(", "))
    return tuple((name, operator) for name, operator, _ in parts)


class Cursor:
    """One walk. Its row is a buffer of the current element's columns."""

    def __init__(self, module: WorldModule) -> None:
        self.module = module
        self.reading: Reading | None = None
        self.interning: Interning | None = None
        self.parameters: dict[str, SqlValue] = {}
        self.keys: Any = iter(())  # the rest of the walk, an iterator of a list
        self.count = 0  # of all elements of the walk
        self.over: list[bool] = []
        self.row = CurrentRow(self)
        self.Column = self.row.__getitem__
        self.Eof = self.over.__len__
        self._end = partial(self.over.append, True)
        self.Next: Callable[[], None] = self._end

    def Filter(self, number: int, plan: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802
        if self.reading is None:
            self.reading, self.interning = self.module.current()
            self.row.buffer_columns(())
        demands = read_cursor_plan(plan)
        if self.module.parameters:
            found = self._read_rows(self.reading, demands, arguments)
        else:
            found = self.reading.find_keys(demands, arguments) if demands else self.reading.list_keys(NOTHING)
        self.count = len(found)
        self.over.clear()
        if len(found) == 1:  # a lookup in a join; a generator would take 0.3 us more
            self.keys, self.Next = _NO_MORE, self._end
            self.row.fill(found[0])
        else:
            self.keys = iter(found)
            self.continue_walk()
            self.Next()

    def continue_walk(self) -> None:
        """Continues the walk with the present set of buffered columns."""
        if self.keys is not _NO_MORE:
            self.Next = self.row.walk(self.keys).__next__

    def _read_rows(
        self, reading: Reading, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]
    ) -> list[Any]:
        """The rows of a table function, without filters on its columns."""
        assert self.interning is not None
        pairs = zip(demands, arguments, strict=True)
        self.parameters = {name: value for (name, operator), value in pairs if operator == ":="}
        values = [self.interning.decode(self.parameters[n]) for n in self.module.parameters if n in self.parameters]
        return reading.call_function(values)

    @property
    def place(self) -> int:
        """How many elements came before this one."""
        return self.count - int(self.keys.__length_hint__()) - 1

    def Rowid(self) -> int:  # noqa: N802
        """The identity of the row, the same in every plan: SQLite combines the parts of OR by it."""
        assert self.reading is not None
        return self.place if self.reading.schema.keyed is None else self.reading.number_key(self.row.key)

    def Close(self) -> None:  # noqa: N802
        # Frees all that was read at the end of the query, before the collector of cycles runs.
        self.keys, self.reading, self.interning, self.Next = _NO_MORE, None, None, self._end
        self.row.clear_row()

    def make_reader(self, number: int) -> Read:
        """The function that reads a column of SQL."""
        module, reading, interning = self.module, self.reading, self.interning
        assert reading is not None
        assert interning is not None
        first = module.first_parameter
        if number < 0:
            return lambda key: self.Rowid()
        if number == 0:
            return self._make_this_reader(reading, interning)
        if number < first:
            name = module.columns[number - 1][0]
            read, kind = reading.make_reader(name), reading.schema.kinds[name]
            if is_plain_in_sqlite(kind):
                return read
            if reading.schema.keyed is None:
                return lambda row: interning.encode(read(row))
            return _make_encoder(read, interning.encode, reading.get_handles(name))
        if number < first + len(module.parameters):
            parameter = module.parameters[number - first]
            return lambda key: self.parameters.get(parameter)
        return lambda key: self.place

    def _make_this_reader(self, reading: Reading, interning: Interning) -> Read:
        if reading.schema.keyed is not None:
            return _make_encoder(reading.get_element, interning.encode, reading.get_handles(""))
        names = tuple(reading.schema.kinds)
        return lambda row: interning.encode(dict(zip(names, row, strict=True)))


class CurrentRow(dict[int, SqlValue]):
    """The buffer of the current row: its columns that have been read so far, by number.

    SQLite reads them by the dict's own method; missing ones are computed by Python code. Each row starts with its known
    columns, see runtime/sqlite/row_buffer.py; `key` is that of its element, or the row of a table function itself.
    """

    __slots__ = ("alone", "cursor", "fill", "filled", "key", "numbers", "readers", "together", "walk")

    fill: Fill
    walk: Walk

    def __init__(self, cursor: Cursor) -> None:
        super().__init__()
        self.cursor = cursor
        self.key: Any = None
        self.alone: list[int] = []  # the columns of this row that `fill` does not set
        self.clear_row()

    def clear_row(self) -> None:
        self.clear()
        self.alone.clear()
        self.readers: dict[int, Read] = {}
        self.numbers: tuple[int, ...] = ()
        self.filled: frozenset[int] = frozenset()
        self.together: frozenset[int] = frozenset()
        self.fill, self.walk = _refuse_fill, _refuse_walk

    def buffer_columns(self, numbers: tuple[int, ...]) -> None:
        """Buffers the columns with these numbers from now on."""
        cursor = self.cursor
        assert cursor.reading is not None
        self.numbers = numbers
        filling = cursor.module.get_row_buffer(cursor.reading.schema, numbers)
        self.filled, self.together = filling.filled, filling.together
        self.fill, self.walk = filling.make_fill(self, cursor.over, cursor.reading)

    def remove_unfilled(self) -> None:
        """Removes the columns that `fill` does not set."""
        for number in self.alone:
            self.pop(number, None)
        self.alone.clear()

    def __missing__(self, number: int) -> SqlValue:
        read = self.readers.get(number)
        if read is None:
            read = self.readers[number] = self.cursor.make_reader(number)
            self.buffer_columns((*self.numbers, number))
            self.cursor.continue_walk()
        value = self[number] = read(self.key)
        if number in self.together:
            self.fill(self.key)  # the other columns of its group are known now
        elif number not in self.filled:
            self.alone.append(number)
        return value


_NO_MORE: Any = iter(())


def _refuse_fill(key: Any) -> None:
    raise AssertionError("the walk has not begun")


def _refuse_walk(keys: Any) -> Any:
    raise AssertionError("the walk has not begun")


def _make_encoder(read: Callable[[Any], Any], encode: Callable[[Any], SqlValue], known: dict[Any, SqlValue]) -> Read:
    def encode_key(key: Any) -> SqlValue:
        value = known.get(key)
        if value is None:
            value = known[key] = encode(read(key))
        return value

    return encode_key
