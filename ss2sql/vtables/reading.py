"""The reading of worlds by one query, for both executors: keys and rows are checked, columns fetched in groups.

Within a query every key list and every group is fetched once and cached, since the inner loops of joins read them
again. A query that may move the world itself reads from a copy, made at its start.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence, Sized
from hashlib import sha256
from itertools import chain, islice, tee
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Error, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, Opaque
from ss2sql.language.plan_traversal import can_move_world, walk
from ss2sql.language.values import make_hashable
from ss2sql.vtables.contract import CacheOfQuery, Element, Filter, QueryCache, Table, TableFunction, Where, World
from ss2sql.vtables.schema import (
    AdapterGuard,
    Place,
    Schema,
    get_schema,
    get_world_tables,
    make_adapter_error,
    world_error,
)

if TYPE_CHECKING:
    from ss2sql.vtables.attached_worlds import AttachedWorldTable


BLOCK = 1000  # elements between two checks of whether the run has to end


def check_adapter_rows(items: Iterable[Any], check: Callable[[], None]) -> list[Any]:
    """The elements as a list. `check` raises where the run has to end, since an iterator may be endless."""
    if isinstance(items, Sized):
        return list(items)
    found: list[Any] = []
    rest = iter(items)
    while block := list(islice(rest, BLOCK)):
        found += block
        check()
    return found


def check_adapter_keys(items: Iterable[Any], check: Callable[[], None], schema: Schema) -> list[Any]:
    """The keys as a list. Raises ExecutionError X011 for one that cannot be hashed, since caches use them.

    Putting a thousand numbers into a set takes 10 us, a hundredth of the time of a walk over them.
    """
    found = check_adapter_rows(items, check)
    try:
        if len(found) == 1:
            hash(found[0])
        else:
            set(found)
    except Exception as error:
        message = f"{schema.title} has a key that cannot be hashed and compared: {type(error).__name__}"
        bad = next((key for key in found if type(key).__hash__ is None), None)
        raise world_error(
            message if bad is None else f"{schema.title} has the key {format_value(bad)}, which cannot be hashed",
            "give numbers, texts, or tuples of these as keys",
        ) from error
    return found


# --- fetching groups of columns: element by element, in blocks that grow, or as whole arrays
Values: TypeAlias = tuple[Any, ...]
Fetch: TypeAlias = Callable[[Any], Values]
LARGEST_BLOCK = 64  # elements: their data are still in the processor's cache when the next group is fetched


class BlockFetcher:
    """Fetches other elements along with the one that is wanted.

    Arrays are fetched for all keys that were given last. Of blocks the first is one element. As long as the query reads
    one element after the other, each block is twice as long as the one before; where it skips some, blocks start with
    one again. So at most about twice the elements that are read are fetched, and exactly three for `LIMIT 3`.
    """

    def __init__(self, reading: Reading, group: str, rows: dict[Hashable, Values]) -> None:
        self.reading = reading
        self.group = group
        self.method: Callable[[Any], Any] = getattr(reading.table, group)
        self.rows = rows
        self.arrays = group in reading.schema.arrays
        self.together = True  # until a value does not fit
        self.single = len(reading.schema.groups[group].parts) == 1  # a block of values, not of tuples
        self.fits = reading.schema.quick_tests[group]
        self.keys: Sequence[Hashable] = ()  # that were given when the last block was fetched
        self.end = 0  # of the last block
        self.size = 1

    def fetch_key(self, key: Hashable) -> Values:
        block = self._choose_block(key)
        if len(block) > 1:
            try:
                self.rows.update(zip(block, self._read_block(block), strict=True))
                return self.rows[key]
            except Exception as error:
                if self.arrays and getattr(error, "code", "") != "X004":  # a value that does not fit
                    raise
                # Perhaps of an element that the query never reads; else it is raised again below.
                self.size, self.together = 1, False
        row = self.rows[key] = self.reading.schema.read_row(self.group, key, self.reading.span)
        return row

    def _read_block(self, block: Sequence[Hashable]) -> Iterable[Values]:
        if self.arrays:
            with AdapterGuard(self.reading.schema, span=self.reading.span):
                return list(self.reading.schema.split_arrays(self.group, self.method(block), block))
        found = self.method(block)
        if self.single:
            found = list(zip(islice(found, len(block) + 1), strict=True))
        if len(found) != len(block) or not all(map(self.fits, found)):
            raise ValueError("values that have to be converted one by one")
        return found  # type: ignore[no-any-return]

    def _choose_block(self, key: Hashable) -> Sequence[Hashable]:
        keys, place = self.reading.announced, self.end
        if len(keys) == 1:
            return keys
        if self.arrays:
            wanted = [one for one in keys if one not in self.rows] if self.together else ()
            return wanted if key in wanted else (key,)
        if keys is self.keys and place < len(keys) and keys[place] == key:
            self.size = min(2 * self.size, LARGEST_BLOCK)
        else:
            self.size = 1
            try:
                place = keys.index(key, place if keys is self.keys else 0)
            except ValueError:
                return (key,)
            self.keys = keys
        self.end = place + self.size
        block = keys[place : self.end]
        return block if self.rows.keys().isdisjoint(block) else [one for one in block if one not in self.rows]


Read = Callable[[Any], Any]
MOST_KEPT = 10_000  # lists of keys, and of rows of table functions


def make_endless_reading() -> None:
    """The check for readings that nothing can end."""


class Readings:
    """The tables that one query reads. `remembered` has the caches of adapters, by world.

    `places` are the first spans of tables in FROM, which errors get. `check` raises where the run has to end.
    """

    def __init__(
        self,
        remembered: QueryCache | None = None,
        places: Iterable[tuple[Table | TableFunction, Span]] = (),
        check: Callable[[], None] = make_endless_reading,
    ) -> None:
        self.check = check
        self.places = dict(places)
        self._tables: dict[Table | TableFunction, Reading] = {}
        self._memories: QueryCache = {} if remembered is None else remembered

    def get_reading(self, table: Table | TableFunction) -> Reading:
        """The reading of a table; a table function that gives keys shares the data of its table."""
        known = self._tables.get(table)
        if known is None:
            schema, span = get_schema(table), self.places.get(table)
            shared = None
            if schema.walked is not None:
                if span is not None:
                    self.places.setdefault(schema.walked, span)
                shared = self.get_reading(schema.walked)
            memory = self._memories.setdefault(table.world, {})
            known = self._tables[table] = Reading(schema, shared, memory, span, self.check)
        return known


class Reading:
    """The reading of one table by one query."""

    def __init__(
        self,
        schema: Schema,
        shared: Reading | None = None,
        memory: dict[str, Any] | None = None,
        span: Span | None = None,
        check: Callable[[], None] = make_endless_reading,
    ) -> None:
        self.schema = schema
        self.check = check
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
        if len(values) == 1 and type(values[0]) is int and demands[0] == self._lookup and self._taken is None:
            key = values[0]
            found = self._lists.get(key)
            if found is None:
                found = self._ask_adapter(Where({demands[0][0]: Filter(key, key, key)}))
                self._cache_keys(key, found)
            self.announced = found
            return found
        return self.list_keys(merge_column_demands(zip(demands, values, strict=True), self.schema))

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

    def call_function(self, arguments: Sequence[Any]) -> list[Any]:
        """The rows of a table function for these arguments: keys of its table, or tuples of clean values."""
        key = (tuple(map(type, arguments)), tuple(map(make_hashable, arguments)))
        found = self._lists.get(key)
        if found is None:
            table, schema = self.table, self.schema
            assert isinstance(table, TableFunction)
            arguments_as_keys = [unwrap_world_key(argument, table.world) for argument in arguments]
            with AdapterGuard(schema, span=self.span), CacheOfQuery(table.world, self.memory):
                table.world.check()
                raw = table.rows(*arguments_as_keys)
                if self._shared is not None:
                    found = check_adapter_keys(raw, self.check, schema)
                else:
                    found = list(map(schema.convert_function_row, check_adapter_rows(raw, self.check)))
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
        return _make_reader(schema.groups[group].places[name], known, self._get_fetcher(group))

    def _get_fetcher(self, group: str) -> Fetch:
        """What fetches a group of the element with a key. Its columns share one: blocks grow with what is read."""
        if group not in self._fetches:
            schema, span, rows = self.schema, self.span, self._rows[group]

            def fetch_key(key: Hashable) -> Values:
                row = rows[key] = schema.read_row(group, key, span)
                return row

            together = group in schema.arrays or group in schema.blocks
            self._fetches[group] = BlockFetcher(self, group, rows).fetch_key if together else fetch_key
        return self._fetches[group]

    def get_handles(self, name: str) -> dict[Hashable, Any]:
        """The SQL values of a column, or of the elements, by key, for values that are passed as handles.

        Encoding a value takes 1 to 2 us, and joins read the same elements again.
        """
        return (self if self._shared is None else self._shared)._handles.setdefault(name, {})

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


def _make_reader(place: Place, known: Callable[[Any], Values | None], fetch: Fetch) -> Read:
    """A function that reads the column at a place, from known values or by a fetch."""
    number, inner = place.number, place.inner
    if inner is not None:
        return lambda key: (known(key) or fetch(key))[number][inner]
    if place.whole:
        return lambda key: [*(known(key) or fetch(key))[number]]
    return lambda key: (known(key) or fetch(key))[number]


def unwrap_world_key(value: Any, world: Any) -> Any:
    """An argument as the adapter gets it: the key in place of an element of its own."""
    if isinstance(value, Element) and (value.world is world or value.world.source is world.source):
        return value if value.table.as_elements else value.key
    return value


# --- what a query demands ------------------------------------------------------------------------------

NOTHING = Where()
_NUMBERS = (int, float)


def merge_column_demands(demands: Iterable[tuple[tuple[str, str], Any]], schema: Schema) -> Where:
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


# --- columns that are read after the rows of a query are found
# Passing a value through SQLite costs 0.3 us, a list 4 us. Where a query shows only elements of worlds and their
# columns, SQLite selects the keys alone, and each row is made from these.
Row: TypeAlias = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class LateColumns:
    """Makes the rows of a query from keys, which its SQL selects.

    `tables` are the tables of the sources; `cells` are what is shown: the number of a source and the name of its
    column, None for its element.
    """

    tables: tuple[AttachedWorldTable, ...]
    cells: tuple[tuple[int, str | None], ...]

    def iterate_rows(self, readings: Readings, keys: Iterable[Sequence[Any]]) -> Iterator[Row]:
        known = [readings.get_reading(table.table) for table in self.tables]
        columns = []
        for (number, name), copy in zip(self.cells, tee(keys, len(self.cells)), strict=True):
            read = known[number].get_element if name is None else known[number].make_reader(name)
            columns.append(map(read, map(itemgetter(number), copy)))
        return zip(*columns, strict=True)  # row by row, each from the left to the right


def find_late_columns(query: plan.Query) -> tuple[plan.Column, ...]:
    """The columns of keys that SQL selects where the other columns are better read late; else none.

    The query may show elements and columns only, since expressions must fail in their written order.
    """
    worlds = {source.id: source for source in query.sources if isinstance(source, plan.WorldSource)}
    shown = [output.expr for output in query.columns]
    keys: dict[int, plan.Column] = {}
    for expr in shown:
        if not isinstance(expr, (plan.Element, plan.Column)) or expr.source not in worlds:
            return ()
        schema = worlds[expr.source].table.schema
        key = getattr(schema.keyed, "key", "")
        if not key or schema.kinds[key].kinds != Kind.INT:
            return ()
        keys[expr.source] = plan.Column(expr.source, key, schema.kinds[key], span=expr.span)
    plain = sum(isinstance(expr, plan.Column) and not expr.type.may_be(Kind.STRUCTURED) for expr in shown)
    return tuple(keys.values()) if len(keys) < plain or plain < len(shown) else ()


def plan_late_columns(query: plan.Query, keys: Sequence[plan.Column]) -> LateColumns:
    """How the rows of a query are made from these keys."""
    worlds = {source.id: source for source in query.sources if isinstance(source, plan.WorldSource)}
    number_of = {key.source: number for number, key in enumerate(keys)}
    cells = [
        (number_of[expr.source], None if isinstance(expr, plan.Element) else expr.name)
        for expr in (output.expr for output in query.columns)
        if isinstance(expr, (plan.Element, plan.Column))  # all are
    ]
    return LateColumns(tuple(worlds[key.source].table for key in keys), tuple(cells))


# --- snapshots: the tables that a query copies at its start, because it may move the world during the walk
@dataclass(frozen=True, slots=True)
class Snapshot:
    """The columns that a query copies at its start, by table; none where it reads the world directly.

    `places` are the first spans of its tables.
    """

    columns: tuple[tuple[AttachedWorldTable, tuple[str, ...]], ...] = ()
    places: tuple[tuple[Table | TableFunction, Span], ...] = ()

    def copy_tables(self, remembered: QueryCache | None, check: Callable[[], None]) -> Readings:
        """The readings of a run of the query, with the copy made. `remembered` gets the caches of worlds.

        `check` raises where the run has to end.
        """
        readings = Readings(remembered, self.places, check)
        for table, columns in self.columns:
            readings.get_reading(table.table).freeze_columns(columns)
        return readings


NO_SNAPSHOT = Snapshot()


def plan_snapshot(roots: Collection[Any]) -> Snapshot:
    """The snapshot for these parts of a plan, which run together.

    Only functions of the user or of a world can move it. The string of an `eval` may call any, and read any column.
    """
    nodes = list(chain.from_iterable(map(walk, roots)))
    sources = [node for node in nodes if isinstance(node, plan.WorldSource)]
    if not sources:
        return NO_SNAPSHOT
    places = tuple({source.table.table: source.span for source in reversed(sources)}.items())
    if not any(map(can_move_world, roots)):
        return Snapshot((), places)
    texts = any(isinstance(node, plan.Eval) for node in nodes)
    columns: dict[AttachedWorldTable, dict[str, None]] = {}
    for source in sources:
        wanted = columns.setdefault(source.table, {})
        if texts:
            wanted.update(dict.fromkeys(name for name, _ in source.columns))
        for node in nodes:
            if isinstance(node, plan.Column) and node.source == source.id:
                wanted[node.name] = None
    return Snapshot(tuple((table, tuple(wanted)) for table, wanted in columns.items()), places)


# --- a digest of a world's contents, equal for equal contents in any process
def digest_world(world: World, without: Collection[str] = ()) -> str:
    """A hash of all columns of all elements, except those named in `without` as "table.column".

    Raises NotImplementedError for values that have no canonical text.
    """
    readings, made = Readings(), sha256()
    for table in get_world_tables(world):
        if not isinstance(table, Table):
            continue
        reading = readings.get_reading(table)
        keys = reading.list_keys(Where())
        made.update(repr((table.name, [replace_world_elements(key) for key in keys])).encode("utf-8", "surrogatepass"))
        for name in reading.schema.kinds:
            if f"{table.name}.{name}" in without:
                continue
            read = reading.make_reader(name)
            made.update(
                repr((name, [replace_world_elements(read(key)) for key in keys])).encode("utf-8", "surrogatepass")
            )
    return made.hexdigest()


def replace_world_elements(value: Any) -> Any:
    """A value with the keys of elements in their place. Raises NotImplementedError for any other object."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return list(map(replace_world_elements, value))
    if kind is tuple:
        return tuple(map(replace_world_elements, value))
    if kind is dict:
        return [(replace_world_elements(key), replace_world_elements(part)) for key, part in value.items()]
    if isinstance(value, Element):
        return Element.__name__, value.table.name, replace_world_elements(value.key)
    kind = type(value.object) if isinstance(value, Opaque) else kind
    raise NotImplementedError(f"there is an object of the type {kind.__name__}")
