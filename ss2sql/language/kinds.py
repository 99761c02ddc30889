"""Static types: the set of kinds that a value may have, with bounds for numbers.

A type is a promise: every value of the expression has one of its kinds and lies within its bounds. Lowering
chooses SQLite's own operators where the types prove that they compute the same value.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Flag
from functools import lru_cache, reduce
from itertools import chain
from operator import itemgetter
from types import FunctionType, ModuleType, NoneType
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass


class Kind(Flag):
    """The kinds of values of the language; a type is a union of them.

    STR alone promises text that SQLite can hold: a string with a lone surrogate, which cannot be written
    as UTF-8 and travels like an object, has the type STR | OBJECT.
    """

    NONE = 1
    BOOL = 2
    INT = 4
    FLOAT = 8
    STR = 16
    LIST = 32
    DICT = 64
    OBJECT = 128
    NUMBER = BOOL | INT | FLOAT
    STRUCTURED = LIST | DICT | OBJECT
    ANY = NONE | BOOL | INT | FLOAT | STR | LIST | DICT | OBJECT


INT_MIN, INT_MAX = -(2**63), 2**63 - 1


class Opaque:
    """An opaque object that Python cannot compare by hash, so that it stands in lists and dicts like a value.

    `object` is what was given. Equality goes by `key`: the object's identity, unless another key is given.
    Hashable objects need no wrapper, they stand for themselves.
    """

    __slots__ = ("key", "object")

    def __init__(self, value: Any, key: Hashable = None) -> None:
        self.object = value
        self.key = (id(value),) if key is None else key

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Opaque) and bool(self.key == other.key)

    def __hash__(self) -> int:
        return hash(self.key)

    def __bool__(self) -> bool:
        """The object's truth; an object whose `bool` raises, such as a data frame, counts as true."""
        try:
            return bool(self.object)
        except Exception:
            return True

    def __repr__(self) -> str:
        return repr(self.object)

    def __str__(self) -> str:
        return str(self.object)


@dataclass(frozen=True, slots=True)
class Type:
    """A set of kinds, and what is known of the values; None: nothing is known."""

    kinds: Kind = Kind.ANY
    low: float | int | None = None  # bounds the numbers among the values, as does `high`
    high: float | int | None = None
    element: Type | None = None  # the type of the elements of a list
    columns: tuple[tuple[str, Type], ...] | None = None  # the keys that a dict, or each element of a list, has
    positions: tuple[Type, ...] | None = None  # of lists of one length: the types of their elements
    length: int | None = None  # of lists without `positions`, if it is not 0

    @property
    def size(self) -> int | None:
        """The length of all lists among the values, None if that is not known."""
        return self.length if self.positions is None else len(self.positions)

    def is_only(self, kinds: Kind) -> bool:
        """Whether every value is of one of `kinds`."""
        return self.kinds | kinds == kinds

    def may_be(self, kinds: Kind) -> bool:
        """Whether a value of one of `kinds` is possible."""
        return bool(self.kinds & kinds)

    def excludes(self, kinds: Kind) -> bool:
        """Whether values are known, and none is of `kinds`. A column without rows excludes nothing."""
        return bool(self.kinds) and not self.may_be(kinds)

    def is_bounded(self, limit: float) -> bool:
        """Whether the numbers among the values provably lie in -limit..limit."""
        return self.low is not None and self.high is not None and self.low >= -limit and self.high <= limit

    def is_at_least(self, number: float) -> bool:
        """Whether the numbers among the values are provably at least `number`."""
        return self.low is not None and self.low >= number


class Typed:
    """A source whose type is known before its values are read: a data frame."""

    __slots__ = ("type",)

    def __init__(self, known: Type) -> None:
        self.type = known


SCALAR = Kind.NONE | Kind.NUMBER | Kind.STR

ANY = Type()
NONE = Type(Kind.NONE)
BOOL = Type(Kind.BOOL, 0, 1)
INT = Type(Kind.INT)
FLOAT = Type(Kind.FLOAT)
STR = Type(Kind.STR)
LIST = Type(Kind.LIST)
NOTHING = Type(Kind(0))
UNENCODABLE = Type(Kind.STR | Kind.OBJECT)

# Types describe nested lists and dicts down to this depth.
_DETAIL = 8
# Lists up to this length are described element by element if they hold nothing but scalars: a point, a move with
# its cost, an edge. Longer lists are usually collections, whose length changes.
_POSITIONS = 16


def unite(types: Iterable[Type]) -> Type:
    """The smallest type that covers all of `types`; of none: a type without values."""
    return reduce(_unite_pair, types, NOTHING)


def _unite_pair(a: Type, b: Type) -> Type:
    if a.kinds == Kind(0):
        return b
    if b.kinds == Kind(0):
        return a
    numeric_a, numeric_b = a.may_be(Kind.NUMBER), b.may_be(Kind.NUMBER)
    if numeric_a and numeric_b:
        low = None if a.low is None or b.low is None else min(a.low, b.low)
        high = None if a.high is None or b.high is None else max(a.high, b.high)
    else:
        low, high = (a.low, a.high) if numeric_a else (b.low, b.high)
    positions = _unite_positions(a, b)
    length = _unite_lengths(a, b) if positions is None else None
    return Type(a.kinds | b.kinds, low, high, _unite_element_types(a, b), _unite_columns(a, b), positions, length)


def _unite_element_types(a: Type, b: Type) -> Type | None:
    lists = [t.element for t in (a, b) if t.may_be(Kind.LIST)]
    known = [item for item in lists if item is not None]
    return unite(known) if lists and len(known) == len(lists) else None


def _unite_positions(a: Type, b: Type) -> tuple[Type, ...] | None:
    lists = [t.positions for t in (a, b) if t.may_be(Kind.LIST)]
    match lists:
        case [one]:
            return one
        case [tuple() as one, tuple() as other] if len(one) == len(other):
            return tuple(map(_unite_pair, one, other))
        case _:
            return None


def _unite_lengths(a: Type, b: Type) -> int | None:
    sizes = {t.size for t in (a, b) if t.may_be(Kind.LIST)}
    return sizes.pop() if len(sizes) == 1 else None


def _unite_columns(a: Type, b: Type) -> tuple[tuple[str, Type], ...] | None:
    """The columns of both types, in the order of their first appearance; a column of one side alone may be None."""
    holders = [t for t in (a, b) if t.may_be(Kind.STRUCTURED)]
    # An empty list lacks nothing: its elements have whatever columns the others have.
    filled = [t for t in holders if not _is_empty(t)]
    known = [dict(t.columns) for t in filled or holders if t.columns is not None]
    if not holders or len(known) < len(filled or holders):
        return None
    absent = NONE if filled else NOTHING
    names = dict.fromkeys(chain.from_iterable(known))
    return tuple((name, unite(columns.get(name, absent) for columns in known)) for name in names)


def _is_empty(t: Type) -> bool:
    """Whether the type says that all its lists are empty, and that there are no dicts or objects."""
    return t.element == NOTHING and not t.may_be(Kind.DICT | Kind.OBJECT)


def can_be_equal(a: Type, b: Type) -> bool:
    """Whether a value of the one type may equal one of the other."""
    common = _add_equal_kinds(a.kinds) & _add_equal_kinds(b.kinds)
    if common == Kind.LIST:
        sizes = [0 if _is_empty(t) else t.size for t in (a, b)]
        return None in sizes or sizes[0] == sizes[1]
    if common == Kind.NUMBER:
        bounds = (a.low, a.high, b.low, b.high)
        return None in bounds or (a.low <= b.high and b.low <= a.high)  # type: ignore[operator]
    return bool(common) or bool((a.kinds | b.kinds) & Kind.OBJECT)


def _add_equal_kinds(kinds: Kind) -> Kind:
    """`kinds` and all kinds that may hold equal values: 1, 1.0 and True are equal."""
    return kinds | Kind.NUMBER if kinds & Kind.NUMBER else kinds


def make_list_type(types: Sequence[Type]) -> Type:
    """The type of a list whose elements have these types, one by one; it has columns if all of them may have some."""
    item = unite(types)
    columns = item.columns if types and all(one.may_be(Kind.DICT | Kind.OBJECT) for one in types) else ()
    return Type(Kind.LIST, element=item, columns=columns, positions=_unite_position_types(types, item))


def _unite_position_types(types: Sequence[Type], item: Type) -> tuple[Type, ...] | None:
    return tuple(types) if 0 < len(types) <= _POSITIONS and item.is_only(SCALAR) else None


def _choose_type_length(length: int, item: Type, positions: tuple[Type, ...] | None) -> int | None:
    """The length to record in a list's type; None for a list of dicts, a table whose rows come and go."""
    return length if length and positions is None and item.is_only(SCALAR | Kind.LIST) else None


def drop_bounds(t: Type) -> Type:
    """The type without bounds of numbers, inside lists and dicts too."""
    item = None if t.element is None else drop_bounds(t.element)
    columns = None if t.columns is None else tuple((name, drop_bounds(column)) for name, column in t.columns)
    positions = None if t.positions is None else tuple(map(drop_bounds, t.positions))
    return Type(t.kinds, None, None, item, columns, positions)


def limit_type_depth(t: Type, detail: int = _DETAIL) -> Type:
    """The type down to a depth of `detail`. Columns occur twice in it, so each level doubles the work of a walk."""
    if t.element is None and t.columns is None and t.positions is None:
        return t
    if not detail:
        return Type(t.kinds, t.low, t.high)
    item = None if t.element is None else limit_type_depth(t.element, detail - 1)
    columns = (
        None if t.columns is None else tuple((name, limit_type_depth(column, detail - 1)) for name, column in t.columns)
    )
    return replace(t, element=item, columns=columns)


def is_supertype(wide: Type, narrow: Type) -> bool:
    """Whether every value of `narrow` also belongs to `wide`, so that a plan made for `wide` fits `narrow`."""
    return _unite_pair(wide, narrow) == wide


def type_of(value: Any) -> Type:
    """The exact type of a value; lists are read whole, plain ones at the speed of C."""
    return _infer_type(value, _DETAIL)


def _infer_type(value: Any, detail: int) -> Type:
    match value:
        case None:
            return NONE
        case bool():
            return Type(Kind.BOOL, int(value), int(value))
        case int():
            return Type(Kind.INT, value, value)
        case float():
            return Type(Kind.FLOAT, value, value)
        case str():
            return STR if is_encodable(value) else UNENCODABLE
        case list() if detail:
            columns = _infer_column_types(value, detail - 1)
            if columns and set(map(type, value)) == {dict}:
                item = Type(Kind.DICT, columns=tuple((n, limit_type_depth(t, detail - 2)) for n, t in columns))
            else:
                item = _infer_element_type(value, detail - 1)
            positions = _unite_position_types([_infer_type(part, 0) for part in value[: _POSITIONS + 1]], item)
            return Type(
                Kind.LIST, None, None, item, columns, positions, _choose_type_length(len(value), item, positions)
            )
        case list():
            return LIST
        case dict() if detail:
            return Type(Kind.DICT, columns=_infer_column_types([value], detail - 1))
        case dict():
            return Type(Kind.DICT)
        case Typed(type=known):
            return known
        case _:
            return Type(Kind.OBJECT, columns=_infer_column_types([value], 0))


# Modules whose objects are scalar values: equal only within their type, and without columns.
VALUE_MODULES = frozenset({"datetime", "uuid", "pathlib", "zoneinfo"})


class Handle:
    """A reference to something that knows its columns: an element of a world."""

    __slots__ = ()

    def __column__(self, name: str) -> Any:
        """The value of a column. Raises KeyError where there is none of this name."""
        raise NotImplementedError

    def __columns__(self) -> Iterable[str]:
        """The names of its columns."""
        raise NotImplementedError


_WITHOUT_ATTRIBUTES = (Handle, type, ModuleType, FunctionType)

_SCALARS: dict[type, Kind] = {NoneType: Kind.NONE, bool: Kind.BOOL, int: Kind.INT, float: Kind.FLOAT, str: Kind.STR}
_WITHOUT_COLUMNS = {*_SCALARS, list, bytes}


def _infer_element_type(items: Sequence[Any], detail: int) -> Type:
    """The union of the types of `items`; items of one plain kind are described at once."""
    classes = set(map(type, items))
    if classes == {list} and detail:
        inner = list(chain.from_iterable(items))
        if set(map(type, inner)) <= _SCALARS.keys():
            types = _infer_position_types(items, inner, detail - 1)
            item = unite(types) if types else _infer_element_type(inner, detail - 1)
            positions = _unite_position_types(types, item)
            length = _choose_type_length(len(items[0]), item, positions) if len(set(map(len, items))) == 1 else None
            return Type(Kind.LIST, element=item, columns=(), positions=positions, length=length)
    if classes == {dict} and detail:
        return Type(Kind.DICT, columns=_infer_column_types(items, detail - 1))
    if items and not classes & _WITHOUT_COLUMNS and dict not in classes:
        return Type(Kind.OBJECT, columns=_infer_column_types(items, 0))
    if not classes <= _SCALARS.keys():
        return unite(_infer_type(item, detail) for item in items)
    kinds = reduce(Kind.__or__, (_SCALARS[c] for c in classes), Kind(0))
    if classes == {str}:
        return Type(kinds) if is_encodable("".join(items)) else Type(kinds | Kind.OBJECT)
    if str in classes and not is_encodable("".join(item for item in items if type(item) is str)):
        kinds |= Kind.OBJECT
    numbers: Sequence[Any] = items
    if not classes <= {bool, int, float}:
        numbers = [item for item in items if isinstance(item, (int, float))]
    if not numbers:
        return Type(kinds)
    return Type(kinds, +min(numbers), +max(numbers))  # + makes 0 and 1 of bools


def _infer_position_types(items: Sequence[list[Any]], inner: list[Any], detail: int) -> list[Type]:
    """The types of the elements of short lists, one by one; empty where the lists differ in length.

    `inner` are the elements of all lists in a row. Slices of it take a third of the time of `zip` over the lists,
    0.06 s for 200,000 pairs.
    """
    width = len(items[0])
    if width > _POSITIONS or set(map(len, items)) != {width}:
        return []
    return [_infer_element_type(inner[position::width], detail) for position in range(width)]


def is_encodable(text: str) -> bool:
    """Whether a text can be written as UTF-8; one with a lone surrogate cannot."""
    if text.isascii():
        return True
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _infer_column_types(items: Sequence[Any], detail: int) -> tuple[tuple[str, Type], ...]:
    """The columns of a list of dicts and objects: keys and attributes, by first appearance; missing values are None."""
    classes = set(map(type, items))
    if classes == {dict}:
        layouts = dict.fromkeys(map(tuple, items))  # the keys of the dicts, most often all the same
        names = [name for name in dict.fromkeys(chain.from_iterable(layouts)) if isinstance(name, str)]
        return tuple((name, _infer_element_type(_list_cells(items, name, layouts), detail)) for name in names)
    if not items or classes & _WITHOUT_COLUMNS:
        return ()
    known = dict.fromkeys(tuple(item) if type(item) is dict else list_attributes(item) for item in items)
    return tuple((name, ANY) for name in dict.fromkeys(chain.from_iterable(known)) if isinstance(name, str))


def _list_cells(items: Sequence[dict[Any, Any]], name: str, layouts: Iterable[tuple[Any, ...]]) -> list[Any]:
    if all(name in layout for layout in layouts):
        return list(map(itemgetter(name), items))
    return [item.get(name) for item in items]


def list_attributes(value: Any) -> tuple[str, ...]:
    """The public data attributes of an object: no methods, no properties, no names with an underscore in front."""
    owner = value.object if type(value) is Opaque else value
    kind: Any = type(owner)
    declared = _infer_declared_fields(kind)
    if declared is None:
        return ()
    held = getattr(owner, "__dict__", ())
    return (*declared, *(name for name in held if not name.startswith("_") and name not in declared))


@lru_cache(1000)
def _infer_declared_fields(kind: type) -> tuple[str, ...] | None:
    """The fields and slots of a type's objects; None where these have no data attributes."""
    if issubclass(kind, _WITHOUT_ATTRIBUTES) or kind.__module__ in VALUE_MODULES:
        return None
    names = [field.name for field in fields(kind)] if is_dataclass(kind) else []
    for one in reversed(kind.__mro__):
        slots = one.__dict__.get("__slots__", ())
        names += [slots] if isinstance(slots, str) else slots
    return tuple(name for name in dict.fromkeys(names) if not name.startswith("_"))


def is_flag(kind: Type) -> bool:
    """Whether an expression of this type is a flag (0 or 1) in SQL."""
    return kind.kinds == Kind.BOOL


# --- bounds of numbers, by interval arithmetic
# They are computed separately for integers, which are exact, and for floats, which are rounded: rounding never swaps
# two numbers, so the same float operation on the bounds of the operands gives the bounds of the result.
Types: TypeAlias = Sequence[Type]
NumberOperation: TypeAlias = Callable[[float, float], float]

INTEGER = Kind.BOOL | Kind.INT
MAX_FLOAT = sys.float_info.max


def bound_integers(t: Type) -> tuple[int, int] | None:
    """The least and the greatest integer that may be among the values; None if there can be none."""
    if not t.may_be(INTEGER):
        return None
    low, high = (INT_MIN, INT_MAX) if t.may_be(Kind.INT) else (0, 1)
    if t.low is not None:
        low = max(low, math.ceil(t.low))
    if t.high is not None:
        high = min(high, math.floor(t.high))
    return (low, high) if low <= high else None


def bound_floats(t: Type) -> tuple[float, float]:
    """The bounds of the numbers, each turned into a float as float arithmetic does it; there must be numbers."""
    if t.is_only(INTEGER):
        low, high = bound_integers(t) or (0, 0)
        return float(low), float(high)
    return -MAX_FLOAT if t.low is None else float(t.low), MAX_FLOAT if t.high is None else float(t.high)


def make_numbers(kinds: Kind, corners: Sequence[float]) -> Type:
    """The type of numbers between the least and the greatest corner; a bound beyond all values is dropped."""
    low, high = min(corners), max(corners)
    least, greatest = (-MAX_FLOAT, MAX_FLOAT) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return Type(kinds, low if least < low <= greatest else None, high if least <= high < greatest else None)


def fits_bounds(kinds: Kind, corners: Sequence[float]) -> bool:
    """Whether all numbers between the corners are values."""
    least, greatest = (-MAX_FLOAT, MAX_FLOAT) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return all(least <= corner <= greatest for corner in corners)


def is_nonnegative(t: Type) -> bool:
    """Whether no number among the values is negative."""
    return t.is_only(Kind.BOOL) if t.low is None else t.low >= 0


def keep_lists(t: Type) -> Type:
    """The lists among the values."""
    return Type(Kind.LIST, element=t.element, columns=t.columns) if t.may_be(Kind.LIST) else NOTHING


def make_text_type(types: Types) -> Type:
    """The type of text made of parts of the strings among the values."""
    if not all(t.may_be(Kind.STR) for t in types):
        return NOTHING
    odd = any(t.may_be(Kind.OBJECT) for t in types)
    return Type(Kind.STR | Kind.OBJECT if odd else Kind.STR)


def are_comparable(a: Type, b: Type) -> bool:
    """Whether any two values of both types can be ordered."""
    if any(a.is_only(kinds) and b.is_only(kinds) for kinds in (Kind.NUMBER, Kind.STR)):
        return True
    if not (a.is_only(Kind.LIST) and b.is_only(Kind.LIST)) or a.element is None or b.element is None:
        return False
    return are_comparable(a.element, b.element)


def apply_bounds(operation: NumberOperation, types: Types) -> list[tuple[Kind, list[float]]]:
    """The kinds of results with their corners: of two integers, and of operands with a float.

    The operation must take its extremes over two intervals at their ends.
    """
    a, b = types
    found: list[tuple[Kind, list[float]]] = []
    if (first := bound_integers(a)) and (second := bound_integers(b)):
        found.append((Kind.INT, [operation(x, y) for x in first for y in second]))
    if a.may_be(Kind.NUMBER) and b.may_be(Kind.NUMBER) and (a.may_be(Kind.FLOAT) or b.may_be(Kind.FLOAT)):
        found.append((Kind.FLOAT, [operation(x, y) for x in bound_floats(a) for y in bound_floats(b)]))
    return found


def round_bounds(t: Type, operation: Callable[[float], int]) -> list[tuple[int, int]]:
    """The bounds of the integers, and of the floats made integers by `operation`, which keeps their order."""
    parts = []
    if known := bound_integers(t):
        parts.append(known)
    if t.may_be(Kind.FLOAT):
        low, high = bound_floats(t)
        parts.append((operation(low), operation(high)))
    return parts


def widen_number_type(kinds: Kind, low: float | None, high: float | None) -> Type:
    """The type of numbers between these, with powers of two as bounds, so that few changes of a table change it."""
    if low is None or high is None:  # no number is left where SQLite found one, as in a damaged file
        return Type(kinds)
    if math.isinf(low) or math.isinf(high):
        return Type(kinds | Kind.OBJECT)  # no float of the language
    least, greatest = (-MAX_FLOAT, MAX_FLOAT) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    below, above = -_round_bound_up(-low), _round_bound_up(high)
    return Type(kinds, below if least < below else None, above if above < greatest else None)


def _round_bound_up(value: float) -> int:
    """The least that is not below the value of 0, the powers of two from 1 on, and their negatives."""
    whole = math.ceil(value)
    if whole == 0:
        return 0
    return 1 << (whole - 1).bit_length() if whole > 0 else -1 << ((-whole).bit_length() - 1)
