"""Worlds: Python objects as sets of tables. This is the contract of adapters, and which object has which.

A *world* wraps one Python object (a simulator, a handle, an object of one's own) and has *tables*. A table walks the
*keys* of its elements and gives their columns when they are read, group by group: a *group* is what one call of
the simulator gives. The first table is the principal one, `FROM space`; the others are `FROM space.joints`::

    class Balls(Table):
        name, key = "balls", "id"
        columns = (Column("id", int, filter="="), Column("x", float, "m", filter="< <= > >="), Column("y", float, "m"))
        groups = {"position": "x y"}

        def keys(self, where):                      # may give too many keys, never too few; always in the same order
            low, high = where.low("x"), where.high("x")
            return [ball.id for ball in self.world.source.balls if low <= ball.x <= high]

        def position(self, key):                    # made only when x or y is read
            ball = self.world.source.ball(key)
            return ball.x, ball.y

    class BallWorld(World):
        tables = (Balls,)

The caller guarantees that `keys` and groups are called within one thread and that nothing moves the world between
the rows of a query unless the query does so itself; such a query reads from a copy made at its start. Within one
query a group is called once for each key, `keys` once for each `where`.

The adapter guarantees:

- Keys are hashable, unique, and constant as long as their element lives. Where `key` names a column, the key is that
  column's value. The key of a dead element may vanish; an element that no longer exists raises `Gone`.
- `keys(where)` gives the keys in an order that does not depend on `where`, and at least all that `where` allows.
- Values fit the declared types. NumPy's scalars are converted to numbers; arrays are for list columns only.
- Reading changes nothing. Functions that change something are declared volatile.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from functools import lru_cache
from importlib import import_module
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NoReturn, TypeAlias, TypeVar, overload

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.from_clause import ATTACHED, find_file_ending, suggest_source
from ss2sql.language.kinds import Handle

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from ss2sql.vtables.schema import Schema

F = TypeVar("F", bound=Callable[..., Any])
Volatility = Literal["immutable", "stable", "volatile"]

OPERATORS = ("=", "<", "<=", ">", ">=")
LARGEST = 1e100  # of floats in columns: squares and sums stay finite


class Gone(Exception):  # noqa: N818 - it is the adapter's word for what it has found out
    """A group or function raises it for a key whose element no longer exists."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column, declared.

    Args:
        name: a name as scripts write it. It is also a function of an element: `mass`, `mass(this)`.
        type: int, float (within 1e100), str, bool, list, dict, `Element` (of a world), `object` (anything);
            `int | None` where there may be no value; a tuple of types for a list of this length:
            `(float, float, float)`.
        unit: "m", "kg"; empty for numbers without one.
        text: one line for `help` and the documentation.
        filter: the comparisons that `keys` can use: "=", "< <= > >=", or all five, with blanks between.
    """

    name: str
    type: Any
    unit: str = ""
    text: str = ""
    filter: str = ""

    @property
    def operators(self) -> frozenset[str]:
        """The comparisons in `filter`."""
        return frozenset(self.filter.split())


@dataclass(frozen=True, slots=True)
class Filter:
    """A condition on one column: `equal` to a value, or within `low`..`high`, both included.

    None means no condition. With `equal`, `low` and `high` are that value, too.
    """

    equal: Any = None
    low: Any = None
    high: Any = None

    def allows(self, value: Any) -> bool:
        """Whether a value of the column passes."""
        if self.equal is not None:
            return bool(value == self.equal)
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


class Where(dict[str, Filter]):
    """The conditions of a query by column, limited to the comparisons that the columns declare; all have to hold.

    Bounds are included even where the query excludes them, since every row is tested again. Names of other than
    columns belong to filters of another kind; adapters ignore those that they do not know.
    """

    def equal(self, column: str) -> Any:
        """The value that the column has to equal, or None."""
        found = self.get(column)
        return None if found is None else found.equal

    def low(self, column: str, default: Any = float("-inf")) -> Any:
        """The least value that the column may have."""
        found = self.get(column)
        return default if found is None or found.low is None else found.low

    def high(self, column: str, default: Any = float("inf")) -> Any:
        """The greatest value that the column may have."""
        found = self.get(column)
        return default if found is None or found.high is None else found.high

    def allows(self, column: str, value: Any) -> bool:
        """Whether an element with this value in the column passes."""
        found = self.get(column)
        return found is None or found.allows(value)


class Table:
    """One kind of elements of a world. An adapter derives a class and declares it in `World.tables`.

    `groups` maps the name of a method to the columns that it gives: `{"pose": "x y z"}` needs `def pose(self,
    key)`, which returns their values in this order; a group of one column returns the value itself. Where a value
    is a tuple, `{"pose": "pos(x=posX y z) quat"}` names what is in it: `pos` is the list, `x` and `posX` its first
    value. Every column is in one group, but the one named by `key`, which is the key itself. Without a `key`
    column, keys may be any hashable value, for example a pair of numbers.

    `arrays` is for simulators that hold everything in arrays: `def pose(self, keys)` gets the keys of all wanted
    elements and returns one array per column (a group of one column: the array itself). `blocks` is for simulators
    that answer quickly, with values that are numbers, strings or None of exactly the declared types: `def pose(self,
    keys)` gets the keys of the next few elements and returns a list of tuples, one for each (a block of one column:
    a list of values). A block with other values is read again, element by element.

    `places` maps elements to coordinates: `{"this": "x y z", "pos": "x y z"}`. With "this" the world promises that
    its function `distance` measures the straight distance from the point [x, y, z] of an element to a point, to a
    point of two numbers on the floor plan, or to another element with a place; any other name is a list column that
    holds this point. Queries for what is near then call `keys` with ranges of x, y and z.

    With `as_elements` the functions of the world get elements of this table as they are, in place of their keys,
    which would mean elements of another table.
    """

    name: ClassVar[str] = ""
    key: ClassVar[str] = ""
    columns: ClassVar[Sequence[Column]] = ()
    places: ClassVar[Mapping[str, str]] = {}
    groups: ClassVar[Mapping[str, str]] = {}
    blocks: ClassVar[Mapping[str, str]] = {}
    arrays: ClassVar[Mapping[str, str]] = {}
    as_elements: ClassVar[bool] = False
    text: ClassVar[str] = ""

    def __init__(self, world: Any) -> None:
        self.world = world

    def keys(self, where: Where) -> Iterable[Hashable]:
        """The keys of the elements that `where` allows, or of more, in the order of the table."""
        raise NotImplementedError(f"{type(self).__name__} needs keys(where)")

    def element(self, key: Hashable) -> Element:
        """The element with a key, as scripts see it in `this`; for columns that hold elements."""
        return Element(self, key)


class TableFunction:
    """A table with parameters: `FROM c = space.closest(a.this, b.this, 0.5)`.

    Its parameters are those of `rows`, which are required unless they have a default value. Elements of the same world
    arrive as their keys. `rows` gives tuples, one value per column. Where `table` names a table of the world, `rows`
    gives keys of that table instead: the columns are the table's, and `this` is its element.
    """

    name: ClassVar[str] = ""
    columns: ClassVar[Sequence[Column]] = ()
    table: ClassVar[str] = ""
    text: ClassVar[str] = ""

    def __init__(self, world: Any) -> None:
        self.world = world

    def rows(self, *arguments: Any, **named: Any) -> Iterable[Any]:
        """The rows; an adapter writes it with the parameters that it has."""
        raise NotImplementedError(f"{type(self).__name__} needs rows(...)")


class World:
    """An adapter. A derived class declares its tables, and methods as functions with `@function`.

    Args:
        source: the object that it makes a world of; kept in `self.source`.

    `serves` names the types of sources, as "module.Class", for which `Session.attach` takes this adapter: nothing is
    imported for it. `representations` maps the names of representations (`AS plane(...)`) to the names of methods,
    which are called as those of `Session.representation` are.

    `self.memory` is a cache for `keys`, `rows` and functions, such as an index of all positions. It is empty at the
    start of each query; outside of queries, and in a query that may move the world, at the start of each call.
    """

    tables: ClassVar[Sequence[type[Table] | type[TableFunction]]] = ()
    serves: ClassVar[Sequence[str]] = ()
    representations: ClassVar[Mapping[str, str]] = {}
    text: ClassVar[str] = ""
    remembered: dict[str, Any] | None = None  # the cache of the current query; see vtables/contract.py

    def __init__(self, source: Any = None) -> None:
        self.source = self if source is None else source

    @property
    def memory(self) -> dict[str, Any]:
        """The cache of the current query; outside of queries an empty one."""
        return {} if self.remembered is None else self.remembered

    @property
    def time(self) -> float | None:
        """The world's own clock in seconds, which `getTime()` then shows; None where it has none."""
        return None

    def fingerprint(self) -> str:
        """Identifies the world's present contents in any process; the graph cache uses it as a key.

        By default it is a hash of all columns of all elements. An adapter whose functions depend on more writes its
        own, or raises NotImplementedError with the reason.
        """
        from ss2sql.vtables.reading import digest_world

        return digest_world(self)

    def __columns__(self) -> Iterable[str]:
        """A world as a value: what its adapter holds is nothing that a hint may offer."""
        return ()

    def check(self) -> None:
        """Raises where the world cannot be read any more, with the reason: "the client is disconnected"."""


@dataclass(frozen=True, slots=True)
class WorldFunction:
    """The declaration by `@function`."""

    volatility: Volatility = "stable"
    indexed: bool = False


@overload
def function(method: F, /) -> F: ...
@overload
def function(volatility: Volatility, /, indexed: bool = False) -> Callable[[F], F]: ...


def function(volatility: Any = "stable", /, indexed: bool = False) -> Any:
    """Decorator for methods of a World: a function of scripts, `linearVelocity(this, 2)`.

    Elements of the same world arrive as their keys, see `Table.as_elements`, other values unchanged. `@function` alone
    declares it stable: equal arguments give equal values within one query. `@function("volatile")` is for functions
    that move or step the world, or read a clock; `@function("immutable")` for constant ones. `indexed=True` promises
    that the function equals the list column of its name: of an element it gives the list, and with an index 0, 1, ...
    after the element one item. Such calls are read as columns.
    """
    if callable(volatility):
        return function("stable")(volatility)

    def note_method(method: F) -> F:
        method.__ss2sql__ = WorldFunction(volatility, indexed)  # type: ignore[attr-defined]
        return method

    return note_method


class Element(Handle):
    """An element of a world: the value of `this`. It consists of its table and its key.

    In Python its columns are attributes, read at each access: `element.mass`. Two elements are equal if they
    are of the same table of the same source and have the same key.
    """

    __slots__ = ("key", "table")

    key: Hashable
    table: Table

    def __init__(self, table: Table, key: Hashable) -> None:
        object.__setattr__(self, "table", table)
        object.__setattr__(self, "key", key)

    @property
    def world(self) -> World:
        """The world that it belongs to."""
        return self.table.world  # type: ignore[no-any-return]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Element):
            return NotImplemented
        same = self.table is other.table or (
            type(self.table) is type(other.table) and self.world.source is other.world.source
        )
        return same and self.key == other.key

    def __hash__(self) -> int:
        return hash((self.table.name, self.key))

    def __repr__(self) -> str:
        return f"{self.table.name}[{self.key!r}]"

    @property
    def _schema(self) -> Schema:
        from ss2sql.vtables.schema import get_schema

        return get_schema(self.table)

    def __getattr__(self, name: str) -> Any:
        if name not in self._schema.kinds:
            raise AttributeError(f"{self.table.name} have no column '{name}'", name=name, obj=self)
        return self._schema.read_value(self.key, name)

    def __column__(self, name: str) -> Any:
        """A column, or what a method of its world gives for it."""
        if name in self._schema.kinds:
            return self._schema.read_value(self.key, name)
        method = getattr(type(self.world), name, None)
        if isinstance(getattr(method, "__ss2sql__", None), WorldFunction):
            return getattr(self.world, name)(self if self.table.as_elements else self.key)
        raise KeyError(name)

    def __columns__(self) -> Iterable[str]:
        return self._schema.kinds

    def __deepcopy__(self, memo: dict[int, Any]) -> Element:
        return self  # a copy refers to the same world

    def __copy__(self) -> Element:
        return self

    def __reduce__(self) -> NoReturn:
        raise TypeError(f"{self!r} is an element of a world and cannot be pickled; select its columns")

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{self!r} cannot be changed; a function of its world may do that")


# --- the query caches of worlds: `World.memory`
QueryCache: TypeAlias = dict[World, dict[str, Any]]


class QueryCaches:
    """The caches of a session's worlds, for each running query; the innermost is the last.

    A query that may move worlds itself, and a call outside of queries, have to read the present world: None stands for
    that, and every call then starts with an empty cache.
    """

    def __init__(self) -> None:
        self._queries: list[QueryCache | None] = [None]

    @contextmanager
    def begin_query(self, moves: bool) -> Iterator[None]:
        """The duration of a query."""
        self._queries.append(None if moves else {})
        try:
            yield
        finally:
            self._queries.pop()

    @property
    def now(self) -> QueryCache | None:
        """The caches of the running query."""
        return self._queries[-1]

    def get_cache(self, world: World) -> dict[str, Any]:
        """The cache for a call of a function."""
        known = self._queries[-1]
        return {} if known is None else known.setdefault(world, {})


class CacheOfQuery:
    """A context in which a world has this cache. It takes 0.2 us, a third of a generator's time."""

    __slots__ = ("memory", "outer", "world")

    def __init__(self, world: World, memory: dict[str, Any]) -> None:
        self.world = world
        self.memory = memory

    def __enter__(self) -> None:
        self.outer = self.world.remembered
        self.world.remembered = self.memory

    def __exit__(self, *_: object) -> None:
        self.world.remembered = self.outer


# --- which object has which adapter
ENTRY_POINTS = "ss2sql.worlds"  # of entry points: the name is that of a type, "module.Class", the value its adapter

# Adapters that ship with the package, by the type that they serve, imported on demand.
SHIPPED_ADAPTERS: dict[str, str] = {
    "pybullet_utils.bullet_client.BulletClient": "ss2sql.vtables.pybullet:PyBulletWorld",
    "ss2sql.vtables.pybullet.scene.Scene": "ss2sql.vtables.pybullet:PyBulletWorld",
    "mujoco._structs.MjData": "ss2sql.vtables.mujoco:MuJoCoWorld",
    "ode.SpaceBase": "ss2sql.vtables.ode:OdeWorld",
    **dict.fromkeys(
        (
            "openravepy.openravepy_int.Environment",
            "openravepy._openravepy_.openravepy_int.Environment",
            "openravepy._openravepy_0_9.openravepy_int.Environment",
            "openravepy_int.Environment",
        ),
        "ss2sql.vtables.openrave:OpenRaveWorld",
    ),
}

PYBULLET_CLIENTS = 1024  # PyBullet's own limit; its functions fail for numbers beyond 32 bits

_registered: dict[str, type[World]] = {}


def register_world(adapter: type[World]) -> type[World]:
    """Makes an adapter known for the types that it `serves`; also a decorator of its class."""
    for name in adapter.serves:
        _registered[name] = adapter
    _find_adapter_type.cache_clear()
    return adapter


def list_adapter_types() -> tuple[str, ...]:
    """The names of the types that have adapters."""
    return tuple(sorted({*_registered, *SHIPPED_ADAPTERS, *(point.name for point in _list_entry_points())}))


def _list_entry_points() -> Iterable[EntryPoint]:
    from importlib.metadata import entry_points  # 10 ms, for sessions with worlds only

    return entry_points(group=ENTRY_POINTS)


def find_adapter(source: Any) -> World | None:
    """The world for an object: itself, what its method `__world__` gives, or by the adapter for its type; else None."""
    if isinstance(source, World):
        return source
    own = getattr(type(source), "__world__", None)
    if own is not None:
        world = own(source)
        if not isinstance(world, World):
            raise SessionError("S002", f"{type(source).__name__}.__world__ gives a {type(world).__name__}, not a World")
        return world
    kind: Any = type(source)
    adapter = _find_adapter_type(kind)
    return None if adapter is None else adapter(source)


def has_adapter(value: Any) -> bool:
    """Whether an object is a world, or of a type that has an adapter; the adapter is not made."""
    kind: Any = type(value)
    return issubclass(kind, World) or hasattr(kind, "__world__") or _find_adapter_type(kind) is not None


@lru_cache(1000)
def _find_adapter_type(kind: type) -> type[World] | None:
    """The adapter for a type, cached: reading entry points takes 10 ms, and FROM may walk many objects."""
    names = [f"{one.__module__}.{one.__qualname__}" for one in kind.__mro__[:-1]]  # the type's own first
    for name in names:
        if name in _registered:
            return _registered[name]
        if name in SHIPPED_ADAPTERS:
            return _load_adapter(SHIPPED_ADAPTERS[name])
    if kind.__module__ in ("builtins", "numpy"):
        return None
    found: Iterator[type[World]] = (point.load() for point in _list_entry_points() if point.name in names)
    return next(found, None)


def _load_adapter(place: str) -> type[World]:
    module, _, name = place.partition(":")
    adapter: type[World] = getattr(import_module(module), name)
    return adapter


def make_attachable(name: str, source: Any) -> Any:
    """The object to attach for `source`: an iterator becomes a list, a number may mean a client of PyBullet.

    A pair of a model and data of MuJoCo is their world.

    Raises SessionError S002 for the path of a file that cannot be attached.
    """
    ending = find_file_ending(source)
    if ending is not None and ending not in ATTACHED:
        path = os.fspath(source)
        raise SessionError(
            "S002", f"a file {ending} cannot be attached by its path", hints=(suggest_source(path, name),)
        )
    pybullet = sys.modules.get("pybullet")  # without this import there are no clients
    if pybullet is not None and (source is pybullet or (type(source) is int and 0 <= source < PYBULLET_CLIENTS)):
        number = 0 if source is pybullet else source  # the default client of its functions
        if pybullet.getConnectionInfo(number)["isConnected"]:
            return _load_adapter(SHIPPED_ADAPTERS["ss2sql.vtables.pybullet.scene.Scene"])(number)
    if isinstance(source, (tuple, list)) and [type(part).__qualname__ for part in source] == ["MjModel", "MjData"]:
        return _load_adapter(SHIPPED_ADAPTERS["mujoco._structs.MjData"])(*source)
    from ss2sql.language.conversion import is_iterator_value

    return list(source) if is_iterator_value(source) else source


def refuse_without_adapter(source: Any) -> None:
    """Raises SessionError S002 for an object that is no value and has no columns, as it probably lacks an adapter."""
    from ss2sql.language.conversion import convert_value

    kind = type(source)
    if kind in (list, tuple, dict) or is_dataclass(source):
        return
    try:
        plain = convert_value(source, "the source")
    except ExecutionError:
        return  # reading it raises the error
    if isinstance(plain, (bool, int, float, str, list, dict, bytes, NoneType)):
        return
    known = ", ".join(list_adapter_types())
    hints = (
        "what can be attached: lists, dicts of columns, data frames, numbers, texts and other values, worlds, paths of"
        " SQLite files" + (f", objects of the types {known}" if known else ""),
        "write an adapter, a class derived from ss2sql.World; or make it a variable with session.set",
    )
    raise SessionError("S002", f"a {kind.__module__}.{kind.__qualname__} cannot be attached", hints=hints)
