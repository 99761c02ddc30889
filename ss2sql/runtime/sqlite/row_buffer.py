"""The row buffer of a walk: at each new row it receives all columns that are known already.

Each set of columns has a generated function. Three columns take 0.2 us as single assignments, in a loop 0.8; a
generator whose next row SQLite takes itself saves 0.1 us more for each row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, Type
from ss2sql.vtables.declared_types import Place
from ss2sql.vtables.reading import Reading
from ss2sql.vtables.schema import Schema

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.table_cursor import CurrentRow

Fill: TypeAlias = Callable[[Any], None]
Walk: TypeAlias = Callable[[Iterator[Any]], Iterator[None]]
_PLAIN = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR


def is_plain_in_sqlite(kind: Type) -> bool:
    """Whether values have their own form in SQL; a bool alone is 0 or 1."""
    return kind.is_only(_PLAIN) or kind.kinds == Kind.BOOL


@dataclass(frozen=True, slots=True)
class RowBuffer:
    """How some columns are buffered. `filled` are their numbers, `together` those whose groups have several of them."""

    make: Callable[..., tuple[Fill, Walk]]
    groups: tuple[str, ...]  # read by key
    handled: tuple[str, ...]  # columns, and `this` as "", that are passed as handles
    filled: frozenset[int]
    together: frozenset[int]

    def make_fill(self, row: CurrentRow, over: list[bool], reading: Reading) -> tuple[Fill, Walk]:
        """The function that fills a row, and one that makes a walk over keys and fills each row."""
        known = [reading.get_read_values(group) for group in self.groups]
        known += [reading.get_handles(name).get for name in self.handled]
        return self.make(row, over, row.alone, row.remove_unfilled, reading.make_key_cleaner, *known)


def make_row_buffer(schema: Schema, numbers: Sequence[int]) -> RowBuffer:
    """The buffer for the columns with these numbers; 0 is `this`."""
    names = ("", *schema.kinds)
    key, keys, keyed = getattr(schema.keyed, "key", ""), 0, schema.keyed is not None
    groups: dict[str, list[tuple[int, Place]]] = {}
    handled: dict[str, int] = {}
    for number in numbers:
        if number >= len(names):  # a parameter, or the place
            continue
        name = names[number]
        if not keyed:
            if name and is_plain_in_sqlite(schema.kinds[name]):
                groups.setdefault("", []).append((number, Place(number - 1)))
        elif name and name == key:
            keys = number if schema.kinds[name].kinds == Kind.INT else 0
        elif name and is_plain_in_sqlite(schema.kinds[name]):
            group = schema.group_of[name]
            groups.setdefault(group, []).append((number, schema.groups[group].places[name]))
        else:
            handled[name] = number
    places = tuple(map(tuple, groups.values()))
    make = _compile_fill_and_walk(keys, keyed, places, tuple(handled.values()))
    together = {number for group in places for number, _ in group if len(group) > 1}
    filled = {number for group in places for number, _ in group} | {keys} - {0} | set(handled.values())
    return RowBuffer(make, tuple(filter(None, groups)), tuple(handled), frozenset(filled), frozenset(together))


@cache
def _compile_fill_and_walk(
    keys: int, keyed: bool, groups: tuple[tuple[tuple[int, Place], ...], ...], handled: tuple[int, ...]
) -> Callable[..., tuple[Fill, Walk]]:
    """Generates both functions. They remove unknown columns, which still have the values of the row before.

    Clearing and filling a dict takes twice as long as overwriting it.
    """
    lines = ["row.key = key", "if alone: forget()"]
    if keys:
        lines.append(f"row[{keys}] = key if type(key) is int and {INT_MIN} <= key <= {INT_MAX} else clean(key)")
    parameters = []
    for number, places in enumerate(groups):
        noted = [f"row[{column}] = {place.write_code('values' if keyed else 'key')}" for column, place in places]
        if not keyed:
            lines += noted
            continue
        parameters.append(f"group{number}")
        lines += [f"values = group{number}(key)", "if values is None:", f" if {places[0][0]} in row:"]
        lines += [f"  row.pop({column}, None)" for column, _ in places]
        lines += ["else:", *(f" {line}" for line in noted)]
    for column in handled:
        parameters.append(f"handle{column}")
        lines += [f"value = handle{column}(key)", f"if value is not None: row[{column}] = value"]
        lines.append(f"elif {column} in row: del row[{column}]")
    text = [f"def make({', '.join(['row', 'over', 'alone', 'forget', 'clean', *parameters])}):"]
    text += [" def fill(key):", *(f"  {line}" for line in lines)]
    text += [" def walk(keys):", "  for key in keys:", *(f"   {line}" for line in lines), "   yield"]
    text += ["  over.append(True)", "  yield", " return fill, walk"]
    made: dict[str, Any] = {}
    exec("\n".join(text), made)  # the code comes from this file, apart from numbers
    return made["make"]  # type: ignore[no-any-return]
