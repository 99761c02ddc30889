"""Worlds: what an object has to say of itself to be a set of tables. This is the contract of adapters.

A *world* wraps one Python object (a simulator, a handle, an object of one's own) and has *tables*. A table walks the
*keys* of its elements and gives their columns when they are asked for, group by group: a *group* is what one call of
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
query a group is asked once for each key, `keys` once for each `where`.

The adapter guarantees:

- Keys are hashable, unique, and the same for the same element as long as it lives. Where `key` names a column, the
  key is that column's value. Elements that die may take their keys along; what no longer exists raises `Gone`.
- `keys(where)` gives the keys in an order that does not depend on `where`, and at least all that `where` allows.
- Values fit the declared types. NumPy's scalars become numbers by themselves; arrays stand in list columns only.
- Reading changes nothing. What changes something is a function declared volatile.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Literal, TypeVar, overload

from ss2sql.kinds import Handle
from ss2sql.records import dataclass

F = TypeVar("F", bound=Callable[..., Any])
Volatility = Literal["immutable", "stable", "volatile"]

OPERATORS = ("=", "<", "<=", ">", ">=")
LARGEST = 1e100  # of floats in columns: so large that no world needs it, and squares and sums stay finite


class Gone(Exception):  # noqa: N818 - it is the adapter's word for what it has found out
    """A group or function raises it for a key whose element no longer exists."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column, declared.

    Args:
        name: a name as scripts write it. It is also a function of an element: `mass`, `mass(this)`.
        type: int, float (within 1e100), str, bool, list, dict, `object` (anything, elements of a world too);
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
    """What a query demands of one column: to be `equal` to a value, or to lie in `low`..`high`, both included.

    None stands for nothing demanded. With `equal`, `low` and `high` are that value, too.
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
    """What a query demands, by column: only those comparisons that the columns declare, all of which have to hold.

    Bounds are included even where the query excludes them, for every row is tested again. A name that is none of a
    column belongs to a filter of another kind; an adapter leaves alone what it does not know.
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

    `arrays` does the same for simulators that hold everything in arrays: `def pose(self, keys)` gets the keys of
    all elements that are wanted and returns one array per column (a group of one column: the array itself).
    `blocks` does it for simulators that answer quickly, with values that are numbers, strings or None of just the
    declared types: `def pose(self, keys)` gets the keys of the next few elements and returns a list of tuples, one
    for each (a block of one column: a list of values). These values are taken as they are; only that floats lie
    within 1e100 is looked after.

    `places` says what stands where: `{"this": "x y z", "pos": "x y z"}`. With "this" the world promises that its
    function `distance` measures the straight way from the point [x, y, z] of an element, to a point, to one of two
    numbers on the floor plan, or to another element that has a place; any other name is a list column that holds
    just this point. What is near something is then asked of `keys` by ranges of x, y and z.
    """

    name: ClassVar[str] = ""
    key: ClassVar[str] = ""
    columns: ClassVar[Sequence[Column]] = ()
    places: ClassVar[Mapping[str, str]] = {}
    groups: ClassVar[Mapping[str, str]] = {}
    blocks: ClassVar[Mapping[str, str]] = {}
    arrays: ClassVar[Mapping[str, str]] = {}
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

    `self.memory` is for `keys`, `rows` and functions: what they put there is theirs until the query that asks has
    ended, such as an index of all positions. Each query begins with an empty one. Outside of queries, and in a query
    that may move the world itself, each call of a function begins with an empty one.
    """

    tables: ClassVar[Sequence[type[Table] | type[TableFunction]]] = ()
    serves: ClassVar[Sequence[str]] = ()
    representations: ClassVar[Mapping[str, str]] = {}
    text: ClassVar[str] = ""
    remembered: dict[str, Any] | None = None  # the memory, while it is lent; see memories.py

    def __init__(self, source: Any = None) -> None:
        self.source = self if source is None else source

    @property
    def memory(self) -> dict[str, Any]:
        """What is remembered for the time of a query; what nobody asks for in a query is forgotten at once."""
        return {} if self.remembered is None else self.remembered

    @property
    def time(self) -> float | None:
        """The world's own clock in seconds, which `getTime()` then shows; None where it has none."""
        return None

    def fingerprint(self) -> str:
        """What tells the world as it is now from any other, in any process; graphs are remembered by it.

        By default it is made of all columns of all elements. An adapter whose functions depend on more writes its own,
        and raises NotImplementedError with the reason where there is none.
        """
        from ss2sql.vtables.contents import contents

        return contents(self)

    def check(self) -> None:
        """Raises where the world cannot be read any more, with the reason: "the client is disconnected"."""


@dataclass(frozen=True, slots=True)
class WorldFunction:
    """What `@function` notes of a method."""

    volatility: Volatility = "stable"
    indexed: bool = False


@overload
def function(method: F, /) -> F: ...
@overload
def function(volatility: Volatility, /, indexed: bool = False) -> Callable[[F], F]: ...


def function(volatility: Any = "stable", /, indexed: bool = False) -> Any:
    """Decorator for methods of a World: a function of scripts, `linearVelocity(this, 2)`.

    Elements of the same world arrive as their keys, all else as it is. `@function` alone says that it is stable: the
    same arguments give the same value within one query. `@function("volatile")` is for what moves or steps the world,
    or looks at a clock; `@function("immutable")` for what never changes. `indexed=True` promises that the function is a
    column: of an element it gives the list column of its name, and with 0, 1, ... behind the element one item of that
    list. Such calls are read as columns.
    """
    if callable(volatility):
        return function("stable")(volatility)

    def note(method: F) -> F:
        method.__ss2sql__ = WorldFunction(volatility, indexed)  # type: ignore[attr-defined]
        return method

    return note


class Element(Handle):
    """An element of a world: what `this` is. It knows its table and its key, and holds nothing else.

    In Python its columns are attributes, read when they are asked for: `element.mass`. Two elements are equal if they
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

    def __getattr__(self, name: str) -> Any:
        from ss2sql.vtables.schema import schema_of

        schema = schema_of(self.table)
        if name not in schema.kinds:
            raise AttributeError(f"{self.table.name} have no column '{name}'", name=name, obj=self)
        return schema.value(self.key, name)

    def __column__(self, name: str) -> Any:
        """A column, or what a method of its world gives for it."""
        from ss2sql.vtables.schema import schema_of

        schema = schema_of(self.table)
        if name in schema.kinds:
            return schema.value(self.key, name)
        method = getattr(type(self.world), name, None)
        if isinstance(getattr(method, "__ss2sql__", None), WorldFunction):
            return getattr(self.world, name)(self.key)
        raise KeyError(name)

    def __columns__(self) -> Iterable[str]:
        from ss2sql.vtables.schema import schema_of

        return schema_of(self.table).kinds

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{self!r} cannot be changed; a function of its world may do that")
