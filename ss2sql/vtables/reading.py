"""The reading of worlds by one query, for both executors.

Within a query every key list and every group is fetched once and cached, since the inner loops of joins read them
again. A query that may move the world itself reads from a copy, made at its start.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, Span
from ss2sql.language.kinds import INT_MAX, INT_MIN
from ss2sql.language.values import make_hashable
from ss2sql.vtables.batch_fetching import Fetch, make_fetcher
from ss2sql.vtables.checked_input import check_adapter_keys, check_adapter_rows
from ss2sql.vtables.column_layouts import Place
from ss2sql.vtables.contract import Element, Filter, Table, TableFunction, Where
from ss2sql.vtables.declared_types import Cleaner
from ss2sql.vtables.query_cache import CacheOfQuery, QueryCache
from ss2sql.vtables.schema import AdapterGuard, Schema, get_schema, make_adapter_error

if TYPE_CHECKING:
    from ss2sql.vtables.attached_worlds import AttachedTable

Read = Callable[[Any], Any]
MOST_KEPT = 10_000  # lists of keys, and of rows of table functions


def never_end() -> None:
    """The check for readings that nothing can end."""


class Readings:
    """The tables that one query reads. `remembered` has the caches of adapters, by world.

    `once` says that the query walks one table, once; `places` are the spans of tables in FROM. `check` raises where the
    run has to end.
    """

    def __init__(
        self,
        remembered: QueryCache | None = None,
        once: bool = False,
        places: Iterable[tuple[AttachedTable, Span | None]] = (),
        check: Callable[[], None] = never_end,
    ) -> None:
        self.once = once
        self.check = check
        self.places = dict(places)
        self._tables: dict[Table | TableFunction, Reading] = {}
        self._memories: QueryCache = {} if remembered is None else remembered

    def get_reading(self, table: Table | TableFunction, span: Span | None = None) -> Reading:
        """The reading of a table; a table function that gives keys shares the data of its table.

        Errors get `span`, the place where the table first stands in FROM.
        """
        known = self._tables.get(table)
        if known is None:
            schema = get_schema(table)
            shared = self.get_reading(schema.walked, span) if schema.walked is not None else None
            memory = self._memories.setdefault(table.world, {})
            known = self._tables[table] = Reading(schema, shared, memory, span, self.once, self.check)
        return known


class Reading:
    """The reading of one table by one query."""

    def __init__(
        self,
        schema: Schema,
        shared: Reading | None = None,
        memory: dict[str, Any] | None = None,
        span: Span | None = None,
        once: bool = False,
        check: Callable[[], None] = never_end,
    ) -> None:
        self.schema = schema
        self.check = check
        self.once = once  # whether the query has finished with an element at the next block
        self.span = span
        self.memory = {} if memory is None else memory
        self.table = schema.table
        self._lists: dict[Hashable, list[Any]] = {}  # keys, or rows, by the request
        self._rows: dict[str, dict[Hashable, tuple[Any, ...]]] = {name: {} for name in schema.groups}
        self._fetches: dict[str, Fetch] = {}
        self._elements: dict[Hashable, Element] = {}
        self._numbers: dict[Hashable, int] = {}
        self._handles: dict[str, dict[Hashable, Any]] = {}
        self.announced: Sequence[Hashable] = ()  # the keys that were given last, of which columns will be read
        self._taken: list[Any] | None = None
        self._shared = shared
        self._checked = False  # whether the world has been checked
        self._lookup = (getattr(self.table, "key", ""), "=")  # the demand of a lookup by key

    # --- keys and rows ---------------------------------------------------------------------------------

    def find_keys(self, demands: Sequence[tuple[str, str]], values: Sequence[Any]) -> list[Any]:
        """The keys of the elements whose columns compare so with these values, and perhaps others.

        A lookup by key has code of its own: a join does it for each of its rows.
        """
        self.once = False  # SQLite may evaluate the parts of an OR one after the other
        if len(values) == 1 and type(values[0]) is int and demands[0] == self._lookup and self._taken is None:
            key = values[0]
            found = self._lists.get(key)
            if found is None:
                found = self._ask_adapter(Where({demands[0][0]: Filter(key, key, key)}))
                self._cache_keys(key, found)
            self.announced = found
            return found
        return self.list_keys(merge_demands(zip(demands, values, strict=True), self.schema))

    def list_keys(self, where: Where) -> list[Any]:
        """The keys that `where` allows, and perhaps others, in the order of the table."""
        if self._taken is not None:
            return self._taken
        key = tuple([(name, one.equal, one.low, one.high) for name, one in where.items()]) if where else ()
        found = self._lists.get(key)
        if found is None:
            found = self._ask_adapter(where)
            self._cache_keys(key, found)
        self.announced = found
        return found

    def _ask_adapter(self, where: Where) -> list[Any]:
        # Two `with` blocks, for errors and for the cache, would take 0.4 us more, a tenth of a lookup.
        table = self.table
        assert isinstance(table, Table)
        world = table.world
        outer, world.remembered = world.remembered, self.memory
        try:
            if not self._checked:
                world.check()
                self._checked = True
            return check_adapter_keys(table.keys(where), self.check, self.schema)
        except Error as error:
            raise error.with_span(self.span) from error.__cause__
        except Exception as error:
            raise make_adapter_error(self.schema, error).with_span(self.span) from error
        finally:
            world.remembered = outer

    def announce_keys(self, keys: Sequence[Hashable]) -> None:
        """Announces that columns of these keys will be read."""
        self.announced = keys

    def call_function(self, arguments: Sequence[Any]) -> list[Any]:
        """The rows of a table function for these arguments: keys of its table, or tuples of clean values."""
        key = (tuple(map(type, arguments)), tuple(map(make_hashable, arguments)))
        found = self._lists.get(key)
        if found is None:
            table, schema = self.table, self.schema
            assert isinstance(table, TableFunction)
            arguments_as_keys = [unwrap_element_key(argument, table.world) for argument in arguments]
            with AdapterGuard(schema, span=self.span), CacheOfQuery(table.world, self.memory):
                table.world.check()
                raw = table.rows(*arguments_as_keys)
                if self._shared is not None:
                    found = check_adapter_keys(raw, self.check, schema)
                else:
                    names = tuple(schema.kinds)
                    found = [schema.convert_values(names, row, "a row") for row in check_adapter_rows(raw, self.check)]
            self._cache_keys(key, found)
        if self._shared is not None:
            self._shared.announced = found
        return found

    def _cache_keys(self, key: Hashable, found: list[Any]) -> None:
        if len(self._lists) >= MOST_KEPT:
            self._lists.clear()
        self._lists[key] = found

    # --- elements and columns --------------------------------------------------------------------------

    def get_element(self, key: Hashable) -> Element:
        """The element with this key, the same object throughout the query."""
        if self._shared is not None:
            return self._shared.get_element(key)
        found = self._elements.get(key)
        if found is None:
            assert isinstance(self.table, Table)
            found = self._elements[key] = Element(self.table, key)
        return found

    def number_key(self, key: Hashable) -> int:
        """A whole number for a key, the same throughout the query."""
        if type(key) is int and INT_MIN <= key <= INT_MAX:
            return key
        numbers = self._numbers if self._shared is None else self._shared._numbers
        return numbers.setdefault(key, len(numbers))

    def make_reader(self, name: str) -> Read:
        """A function from a key to the value of a column; where rows are tuples, from the row."""
        if self._shared is not None:
            return self._shared.make_reader(name)
        schema, table = self.schema, self.table
        if not isinstance(table, Table):
            place = list(schema.kinds).index(name)
            return lambda row: row[place]
        if name == table.key:
            return schema.cleaners[name]
        group = schema.group_of[name]
        known = self._rows[group].get
        return _make_reader(schema.groups[group].places[name])(known, self.get_fetcher(group))

    def get_fetcher(self, group: str) -> Fetch:
        """The fetcher of a group; its columns share one, since blocks grow with what is read."""
        if self._shared is not None:
            return self._shared.get_fetcher(group)
        found = self._fetches.get(group)
        if found is None:
            assert isinstance(self.table, Table)
            found = self._fetches[group] = make_fetcher(self, self.table, group, self._rows[group])
        return found

    def get_read_values(self, group: str) -> Callable[[Any], tuple[Any, ...] | None]:
        """The values of a group that have been read, by key."""
        return (self if self._shared is None else self._shared)._rows[group].get

    def get_handles(self, name: str) -> dict[Hashable, Any]:
        """The SQL values of a column, or of the elements, by key, for values that are passed as handles.

        Encoding a value takes 1 to 2 us, and joins read the same elements again.
        """
        return (self if self._shared is None else self._shared)._handles.setdefault(name, {})

    @property
    def make_key_cleaner(self) -> Cleaner | None:
        """The function that converts a key to a value of the key column, if there is one."""
        return self.schema.cleaners.get(getattr(self.schema.keyed, "key", ""))

    # --- the snapshot ----------------------------------------------------------------------------------

    def freeze_columns(self, columns: Iterable[str]) -> None:
        """Reads all keys and these columns now; later reads see them as they were."""
        if self._shared is not None:
            self._shared.freeze_columns(columns)
            return
        if not isinstance(self.table, Table):
            return
        keys = self.list_keys(Where())
        for name in columns:
            read = self.make_reader(name)
            for key in keys:
                read(key)
        self._taken = keys


@cache
def _make_reader(place: Place) -> Callable[[Callable[[Any], Any], Fetch], Read]:
    """Generates the function that reads the column at a place, from known values or by a fetch."""
    lines = ["def make(known, fetch):", " def read(key):", "  values = known(key)", "  if values is None:"]
    lines += ["   values = fetch(key)", f"  return {place.write_code('values')}", " return read"]
    made: dict[str, Any] = {}
    exec("\n".join(lines), made)  # the code comes from this file, apart from numbers
    return made["make"]  # type: ignore[no-any-return]


def unwrap_element_key(value: Any, world: Any) -> Any:
    """An argument as the adapter gets it: the key in place of an element of its own."""
    if isinstance(value, Element) and (value.world is world or value.world.source is world.source):
        return value.key
    return value


# --- what a query demands ------------------------------------------------------------------------------

NOTHING = Where()
_NUMBERS = (int, float)


def merge_demands(demands: Iterable[tuple[tuple[str, str], Any]], schema: Schema) -> Where:
    """The conjunction of comparisons ((column, operator), value).

    A value that cannot be compared with the column is ignored, since the row is tested again.
    """
    bounds: dict[str, list[Any]] = {}  # equal, low, high
    for (name, operator), value in demands:
        expected: Any = str if name in schema.texts else _NUMBERS
        if isinstance(value, bool) or not isinstance(value, expected):
            continue
        known = bounds.setdefault(name, [None, None, None])
        equal, low, high = known
        if operator == "=":
            known[:] = value, value, value
        elif equal is not None:
            continue
        elif operator in (">", ">="):
            known[1] = value if low is None else max(low, value)
        else:
            known[2] = value if high is None else min(high, value)
    return Where({name: Filter(*known) for name, known in bounds.items()})
