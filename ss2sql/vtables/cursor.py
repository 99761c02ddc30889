"""Walks over one table of a world, as SQLite asks for them: Filter, then Eof, Column and Next for each row.

What is called for every row and column is a method of a dict or list where possible: a call of Python code takes
as long as three of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.kinds import INT_MAX, INT_MIN, Kind, Type
from ss2sql.runtime.pool import Pool
from ss2sql.vtables.reading import NOTHING, Reading

if TYPE_CHECKING:
    from ss2sql.vtables.module import WorldModule

SqlValue: TypeAlias = Any
Read: TypeAlias = Callable[[Any], SqlValue]
Known: TypeAlias = Callable[[Any], "tuple[Any, ...] | None"]  # what has been read of a group, by key
_PLAIN = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR
_END = object()


@lru_cache(maxsize=1000)
def demands_of(plan: str) -> tuple[tuple[str, str], ...]:
    """The columns and comparisons, or the parameters, that the arguments of a plan stand for, in their order."""
    if plan == "all":
        return ()
    parts = (text.split(" ") for text in plan.split(", "))
    return tuple((name, operator) for name, operator, _ in parts)


class Cursor:
    """One walk. Its row is what the query has read of the current element."""

    def __init__(self, module: WorldModule) -> None:
        self.module = module
        self.reading: Reading | None = None
        self.pool: Pool | None = None
        self.given: dict[str, SqlValue] = {}
        self.keys: Any = iter(())  # the rest of the walk, an iterator of a list
        self.key: Any = None
        self.count = 0  # of all elements of the walk
        self.over: list[bool] = []
        self.row = _Row(self)
        self.Column = self.row.__getitem__
        self.Eof = self.over.__len__

    def Filter(self, number: int, plan: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802
        if self.reading is None:
            self.reading, self.pool = self.module.current()
        demands = demands_of(plan)
        read = self._rows if self.module.parameters else self._keys
        found = read(self.reading, demands, arguments)
        self.keys, self.count = iter(found), len(found)
        self.over.clear()
        self.Next()

    def _keys(self, reading: Reading, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]) -> list[Any]:
        return reading.asked(demands, arguments) if demands else reading.keys(NOTHING)

    def _rows(self, reading: Reading, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]) -> list[Any]:
        """The rows of a table function, whatever is demanded of its columns."""
        assert self.pool is not None
        pairs = zip(demands, arguments, strict=True)
        self.given = {name: value for (name, operator), value in pairs if operator == ":="}
        values = [self.pool.decode(self.given[name]) for name in self.module.parameters if name in self.given]
        return reading.rows(values)

    def Next(self) -> None:  # noqa: N802
        row = self.row
        if row.alone:
            row.forget()
        key = self.key = next(self.keys, _END)
        if key is _END:
            self.over.append(True)
        else:
            row.fill(row, key)

    @property
    def place(self) -> int:
        """How many elements came before this one."""
        return self.count - int(self.keys.__length_hint__()) - 1

    def Rowid(self) -> int:  # noqa: N802
        """The identity of the row, the same in every plan: SQLite puts OR together by it."""
        assert self.reading is not None
        return self.place if self.reading.schema.keyed is None else self.reading.number(self.key)

    def Close(self) -> None:  # noqa: N802
        # All that was read goes with the query, and does not wait for the collector of cycles.
        self.keys, self.reading, self.pool = iter(()), None, None
        self.row.let_go()

    def reader(self, number: int) -> Read:
        """The function that reads a column of SQL."""
        module, reading, pool = self.module, self.reading, self.pool
        assert reading is not None
        assert pool is not None
        first = module.first_parameter
        if number < 0:
            return lambda key: self.Rowid()
        if number == 0:
            return self._this(reading, pool)
        if number < first:
            name = module.columns[number - 1][0]
            read, kind = reading.reader(name), reading.schema.kinds[name]
            return read if _travels(kind) else _encoded(read, pool.encode)
        if number < first + len(module.parameters):
            parameter = module.parameters[number - first]
            return lambda key: self.given.get(parameter)
        return lambda key: self.place

    def _this(self, reading: Reading, pool: Pool) -> Read:
        if reading.schema.keyed is not None:
            return _encoded(reading.element, pool.encode)
        names = tuple(reading.schema.kinds)
        return lambda row: pool.encode(dict(zip(names, row, strict=True)))

    def filler(self, numbers: Sequence[int]) -> tuple[frozenset[int], Callable[[_Row, Any], None]]:
        """Which of these columns are read with others, and a function that notes in a row those that are known."""
        module, reading = self.module, self.reading
        assert reading is not None
        kinds = reading.schema.kinds
        groups: dict[str, tuple[Known, list[tuple[int, int]]]] = {}
        keys = 0
        for number in numbers:
            name = module.columns[number - 1][0] if 0 < number < module.first_parameter else ""
            group = reading.group_reader(name) if name and _travels(kinds[name]) else None
            if group is not None:
                groups.setdefault(group.names[0], (group.known, []))[1].append((number, group.names.index(name)))
            elif name and name == module.key and kinds[name].kinds == Kind.INT:
                keys = number
        make = _filler(keys, tuple(tuple(places) for _, places in groups.values()))
        together = {number for _, places in groups.values() for number, _ in places}
        clean = reading.reader(module.key) if keys else None
        return frozenset(together | {keys} - {0}), make(clean, *(known for known, _ in groups.values()))


class _Row(dict[int, SqlValue]):
    """The columns of the current row that have been read so far, by number.

    SQLite asks for them by the dict's own method, and what is missing comes to Python code. Each row begins with what
    is known already of the columns that earlier rows were asked for. They are written over those of the row before: a
    dict that is emptied and filled again takes twice as long.
    """

    __slots__ = ("alone", "cursor", "fill", "filled", "readers")

    def __init__(self, cursor: Cursor) -> None:
        super().__init__()
        self.cursor = cursor
        self.readers: dict[int, Read] = {}
        self.filled: frozenset[int] = frozenset()  # the columns that `fill` looks after
        self.alone: list[int] = []  # the columns of this row that it does not
        self.fill: Callable[[_Row, Any], None] = _nothing

    def forget(self) -> None:
        """Lets go of the columns that `fill` does not look after."""
        for number in self.alone:
            del self[number]
        self.alone.clear()

    def let_go(self) -> None:
        """Ends the last row."""
        self.clear()
        self.readers.clear()
        self.alone.clear()
        self.filled, self.fill = frozenset(), _nothing

    def __missing__(self, number: int) -> SqlValue:
        read = self.readers.get(number)
        if read is None:
            read = self.readers[number] = self.cursor.reader(number)
            self.filled, self.fill = self.cursor.filler(tuple(self.readers))
            self.alone = [number for number in self.alone if number not in self.filled]
        value = self[number] = read(self.cursor.key)
        if number in self.filled:
            self.fill(self, self.cursor.key)  # the other columns of its group are known now
        else:
            self.alone.append(number)
        return value


def _nothing(row: _Row, key: Any) -> None:
    return


@lru_cache(maxsize=1000)
def _filler(keys: int, groups: tuple[tuple[tuple[int, int], ...], ...]) -> Callable[..., Callable[[Any, Any], None]]:
    """Makes what notes the keys, if they are a column, and of each group these numbers from these places.

    What is not known leaves the row. As assignments one by one they take 0.2 us for three columns, in a loop 0.8.
    """
    names = [f"known{number}" for number in range(len(groups))]
    lines = [f"def make({', '.join(['clean', *names])}):", " def fill(row, key):"]
    if keys:
        lines.append(f"  row[{keys}] = key if type(key) is int and {INT_MIN} <= key <= {INT_MAX} else clean(key)")
    for name, places in zip(names, groups, strict=True):
        lines += [f"  values = {name}(key)", "  if values is None:"]
        lines += [f"   if {places[0][0]} in row:", *(f"    row.pop({number}, None)" for number, _ in places)]
        lines += ["  else:", *(f"   row[{number}] = values[{place}]" for number, place in places)]
    lines += ["  return", " return fill"]
    made: dict[str, Any] = {}
    exec("\n".join(lines), made)  # a text of this file, with nothing but numbers in it from elsewhere
    return made["make"]  # type: ignore[no-any-return]


def _travels(kind: Type) -> bool:
    """Whether values travel through SQL as they are; a bool that is nothing else is 0 or 1."""
    return kind.only(_PLAIN) or kind.kinds == Kind.BOOL


def _encoded(read: Callable[[Any], Any], encode: Callable[[Any], SqlValue]) -> Read:
    return lambda key: encode(read(key))
