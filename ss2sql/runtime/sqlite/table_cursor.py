"""The cursor of a world's table, by SQLite's protocol: Filter, then Eof, Column and Next for each row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.language.kinds import Kind
from ss2sql.runtime.sqlite.interning import Interning
from ss2sql.vtables.reading import NOTHING, Reading

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.virtual_table import WorldModule

SqlValue: TypeAlias = Any
Read: TypeAlias = Callable[[Any], SqlValue]
_PLAIN = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR


@lru_cache(maxsize=1000)
def read_cursor_plan(plan: str) -> tuple[tuple[str, str], ...]:
    """The columns and comparisons, or the parameters, of a plan's arguments, in their order."""
    if plan == "all":
        return ()
    parts = (text.split(" ") for text in plan.split(", "))
    return tuple((name, operator) for name, operator, _ in parts)


class Cursor:
    """One walk over elements, by their keys; of a table function over its rows."""

    def __init__(self, module: WorldModule) -> None:
        self.module = module
        self.reading: Reading | None = None
        self.interning: Interning | None = None
        self.parameters: dict[str, SqlValue] = {}
        self.readers: dict[int, Read] = {}  # by the numbers of columns
        self.keys: Sequence[Any] = ()
        self.position = self.count = 0

    def Filter(self, number: int, plan: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802 - SQLite's names
        if self.reading is None:
            self.reading, self.interning = self.module.current()
        demands = read_cursor_plan(plan)
        if self.module.parameters:
            self.keys = self._read_rows(self.reading, demands, arguments)
        else:
            self.keys = self.reading.find_keys(demands, arguments) if demands else self.reading.list_keys(NOTHING)
        self.position, self.count = 0, len(self.keys)

    def _read_rows(
        self, reading: Reading, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]
    ) -> Sequence[Any]:
        """The rows of a table function, without filters on its columns."""
        assert self.interning is not None
        pairs = zip(demands, arguments, strict=True)
        self.parameters = {name: value for (name, operator), value in pairs if operator == ":="}
        values = [self.interning.decode(self.parameters[n]) for n in self.module.parameters if n in self.parameters]
        return reading.call_function(values)

    def Eof(self) -> bool:  # noqa: N802
        return self.position >= self.count

    def Next(self) -> None:  # noqa: N802
        self.position += 1

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        try:
            read = self.readers[number]
        except KeyError:
            read = self.readers[number] = self.make_reader(number)
        return read(self.keys[self.position])

    def Rowid(self) -> int:  # noqa: N802
        """The identity of the row, the same in every plan: SQLite combines the parts of OR by it."""
        assert self.reading is not None
        keyed = self.reading.schema.keyed is not None
        return self.reading.number_key(self.keys[self.position]) if keyed else self.position

    def Close(self) -> None:  # noqa: N802
        # Frees all that was read at the end of the query, before the collector of cycles runs.
        self.keys, self.reading, self.interning = (), None, None
        self.readers.clear()

    def make_reader(self, number: int) -> Read:
        """The function that reads a column of SQL."""
        module, reading, interning = self.module, self.reading, self.interning
        assert reading is not None
        assert interning is not None
        first = module.first_parameter
        if number < 0:
            return lambda key: self.Rowid()
        if number == 0:
            return _make_this_reader(reading, interning)
        if number < first:
            name = module.columns[number - 1][0]
            read, kind = reading.make_reader(name), reading.schema.kinds[name]
            if kind.is_only(_PLAIN) or kind.kinds == Kind.BOOL:  # which have their own form in SQL
                return read
            if reading.schema.keyed is None:
                return lambda row: interning.encode(read(row))
            return _make_encoder(read, interning.encode, reading.get_handles(name))
        if number < first + len(module.parameters):
            parameter = module.parameters[number - first]
            return lambda key: self.parameters.get(parameter)
        return lambda key: self.position


def _make_this_reader(reading: Reading, interning: Interning) -> Read:
    if reading.schema.keyed is not None:
        return _make_encoder(reading.get_element, interning.encode, reading.get_handles(""))
    names = tuple(reading.schema.kinds)
    return lambda row: interning.encode(dict(zip(names, row, strict=True)))


def _make_encoder(read: Callable[[Any], Any], encode: Callable[[Any], SqlValue], known: dict[Any, SqlValue]) -> Read:
    def encode_key(key: Any) -> SqlValue:
        value = known.get(key)
        if value is None:
            value = known[key] = encode(read(key))
        return value

    return encode_key
