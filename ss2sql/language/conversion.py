"""Where Python's values become values of the language, how they look in messages, and the columns of an element."""

from __future__ import annotations

import sys
from array import array
from collections import deque
from collections.abc import Iterable, Iterator
from datetime import date, datetime
from io import IOBase
from itertools import chain
from marshal import dumps
from math import isfinite
from types import GeneratorType, MappingProxyType, NoneType
from typing import Any, NoReturn

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.language.kinds import INT_MAX, INT_MIN, VALUE_MODULES, Handle, Opaque, list_attributes

# A list nested deeper than this, or one that contains itself, is refused: Python's own == and repr recurse
# into lists on a stack of 1,000 frames, which they share with the code that calls them.
DEPTH_LIMIT = 500


def format_value(value: Any, limit: int = 60) -> str:
    """The value as the language writes it; longer than `limit` characters, it is cut with `...`."""
    text = _write_value_text(value, limit)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def _write_value_text(value: Any, room: int) -> str:
    """The text of a value; once it is longer than `room` it may be broken off anywhere."""
    if room <= 0:
        return "..."
    if isinstance(value, Opaque):
        value = value.object
    kind = type(value)
    if kind is str:
        return repr(value[: room + 1])
    if kind is int and value.bit_length() > 512:
        return f"<integer of {value.bit_length()} bits>"
    if kind is list or kind is dict:
        text = "[" if kind is list else "{"
        for item in value:
            text += ", " if len(text) > 1 else ""
            if kind is dict:
                text += _write_value_text(item, room - len(text)) + ": "
                item = value[item]
            text += _write_value_text(item, room - len(text))
            if len(text) > room:
                break
        return text + ("]" if kind is list else "}")
    try:
        return " ".join(repr(value).split())
    except Exception:  # the object is the user's, and so is its repr
        return f"<{kind.__name__}>"


def build_depth_error(subject: str) -> ExecutionError:
    """The error for a value that is nested too deeply; `subject` begins the sentence, verb included."""
    return ExecutionError(
        "X004",
        f"{subject} a value nested deeper than {DEPTH_LIMIT} levels",
        hints=("a list or dict must not contain itself; keep long chains flat, as one list",),
    )


FLOAT_CURE = "make one of the operands a float, for example with float(...)"
# What to do about an integer that is too large, where these functions gave it.
CURES = {
    "int": "an integer has 64 bits; float(...) holds larger numbers",
    "abs": "write abs(float(x)): a float can be larger",
    "sum": "add floats, for example SELECT float(x)",
}


def check_arithmetic(value: Any, cure: str = FLOAT_CURE) -> Any:
    """The result of arithmetic, if it is a value: integers within 64 bits, finite floats.

    Args:
        value: the result.
        cure: what to do about an integer that is too large.

    Raises:
        ExecutionError: X004 for any other number.
    """
    kind = type(value)
    if kind is int:
        if INT_MIN <= value <= INT_MAX:
            return value
        raise ExecutionError(
            "X004", f"integer overflow: {format_value(value)} does not fit into 64 bits", hints=(cure,)
        )
    if kind is float and not isfinite(value):
        raise build_overflow_error()
    if kind is complex:
        raise build_complex_error(f"the result {format_value(value)}")
    return value


def build_complex_error(what: str) -> ExecutionError:
    """The error for a power that is no real number."""
    hint = "a negative number has no real fractional power; use abs(...) or a whole exponent"
    return ExecutionError("X004", f"{what} is a complex number", hints=(hint,))


def build_overflow_error() -> ExecutionError:
    """The error for a float result beyond all floats."""
    return ExecutionError(
        "X004",
        "float overflow: the result is beyond the largest float, about 1.8e308",
        hints=("scale the values down, or add logarithms instead of multiplying",),
    )


# --- a text of a table that is not UTF-8: natively it stands in its row, and is an error only where somebody reads it
def build_utf8_error(raw: bytes) -> ExecutionError:
    """The error for a text that Python cannot read."""
    written = repr(raw) if len(raw) <= 60 else f"{raw[:50]!r}..."
    hint = "read its bytes, by a view in the file with CAST(column AS BLOB), or write it anew as UTF-8"
    return ExecutionError("X009", f"SQLite: a text is not UTF-8: {written}", hints=(hint,))


def decode_text(raw: bytes, encoding: str) -> Any:
    """The text with these bytes, or what stands for it."""
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError:
        return UnreadableText(raw)


def is_unreadable(error: Exception) -> bool:
    """Whether such a text is why there is this error."""
    return isinstance(error, ExecutionError) and isinstance(error.__cause__, UnicodeDecodeError)


class UnreadableText(Opaque):
    """Equals texts of the same bytes, is true, and raises ExecutionError X009 for any other operation."""

    __slots__ = ()

    def __init__(self, raw: bytes) -> None:
        self.key = (UnreadableText, raw)

    def make_error(self) -> ExecutionError:
        return build_utf8_error(self.key[1])  # type: ignore[index]

    def _refuse_use(self, *_: Any) -> NoReturn:
        raise self.make_error()

    def __reduce__(self) -> Any:
        return UnreadableText, (self.key[1],)  # type: ignore[index]

    def __bool__(self) -> bool:
        return True

    object = property(_refuse_use)
    __lt__ = __le__ = __gt__ = __ge__ = __add__ = __radd__ = __mod__ = _refuse_use
    __len__ = __iter__ = __contains__ = __getitem__ = __repr__ = __str__ = __format__ = _refuse_use
    __hash__ = Opaque.__hash__

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise self.make_error()


# --- where Python's values become values of the language: results of functions, variables, elements of sources
SCALARS = frozenset({NoneType, bool, int, float, str})
_SEQUENCES: tuple[type[Iterable[Any]], ...] = (
    list,
    tuple,
    range,
    deque,
    array,
    GeneratorType,
    type({}.keys()),
    type({}.values()),
    type({}.items()),
)

_MAPPINGS = (dict, MappingProxyType)
_CONTAINERS: tuple[type, ...] = (*_SEQUENCES, *_MAPPINGS, set, frozenset)


def convert_value(value: Any, giver: str, named: bool = False) -> Any:
    """The value of the language that a Python value stands for.

    Tuples, sets, ranges, iterators, views and NumPy arrays become lists, a set in sorted order; NumPy
    scalars and instances of subclasses (an IntEnum, an OrderedDict) become plain values; everything that
    the language does not know is an opaque object. What is a value already is returned as it is, not copied. With
    `named` a named tuple is a row, a dict, as in data that people hand over; what functions return are lists.

    Args:
        value: anything.
        giver: who hands it over, for the error: "the function 'f'", "the variable 'x'".

    Raises:
        ExecutionError: X004 for NaN, infinities, complex numbers, integers beyond 64 bits, and for lists that
            contain themselves or are nested too deeply.
    """
    kind = type(value)
    if kind is str or kind is bool or value is None:
        return value
    if kind is int and INT_MIN <= value <= INT_MAX:
        return value
    if kind is float and isfinite(value):
        return value
    try:
        return value if _is_clean_value(value, 0) else _convert_value(value, 0, named)
    except _RefusedValue as refused:
        raise refused.make_error(_name_value_giver(giver)) from None
    except (_TooDeep, RecursionError):
        raise build_depth_error(_name_value_giver(giver)) from None


def is_iterator_value(value: Any) -> bool:
    """Whether a value is an iterator, which becomes a list: not an open file, nor a stream of Arrow data, a frame."""
    return isinstance(value, Iterator) and not isinstance(value, IOBase) and not hasattr(value, "__arrow_c_stream__")


def is_marshalled_value(marshalled: bytes) -> bool:
    """Whether the marshal bytes of a shallow list say that it is a value already."""
    return b"g" not in marshalled and b"l" not in marshalled and b"(" not in marshalled


def is_shallow_list_value(value: list[Any] | tuple[Any, ...]) -> bool:
    """Whether a list or tuple consists of scalars, and of lists and tuples of scalars.

    Marshal must see no more than that before a value has been normalised: of a NumPy scalar it would write
    the bytes, and in a list that contains itself it would lose its way.
    """
    # Loops, not map and issuperset, which cost 0.7 us for three lists of eight numbers; this costs 0.4 us.
    for item in value:
        kind = type(item)
        if kind is list or kind is tuple:
            for part in item:
                if type(part) not in SCALARS:
                    return False
        elif kind not in SCALARS:
            return False
    return True


def _name_value_giver(giver: str) -> str:
    return f"{giver} {'returned' if giver.startswith('the function') else 'holds'}"


class _TooDeep(Exception):  # noqa: N818 - never leaves this module
    """The value is nested deeper than the limit, or contains itself."""


class _RefusedValue(Exception):  # noqa: N818 - never leaves this module
    """The value, or one inside of it, is not allowed; `path` grows from the inside out."""

    def __init__(self, what: str, hint: str, reason: str = "") -> None:
        self.what = what
        self.hint = hint
        self.reason = reason
        self.path: list[str] = []

    def make_error(self, subject: str) -> ExecutionError:
        path = "".join(reversed(self.path))
        place = f" at {path if len(path) <= 60 else path[:57] + '...'}" if path else ""
        return ExecutionError("X004", f"{subject} {self.what}{place}{self.reason}", hints=(self.hint,))


# --- values that are clean already ---------------------------------------------------------------------


def _is_clean_value(value: Any, depth: int) -> bool:
    """Whether `value` is a list or dict of plain values, all the way down."""
    kind = type(value)
    if kind is dict:
        return set(map(type, value)) <= {str} and _are_clean_values(list(value.values()), depth)
    return kind is list and _are_clean_values(value, depth)


def _are_clean_values(items: list[Any], depth: int) -> bool:
    """Whether the items of a list or dict at this depth are clean, without a look at each where they are alike."""
    kinds = set(map(type, items))
    if kinds <= SCALARS:
        return _are_number_values_valid(items, kinds)
    if depth + 1 >= DEPTH_LIMIT:
        return False
    if kinds == {list}:
        inner = list(chain.from_iterable(items))
        inner_kinds = set(map(type, inner))
        if inner_kinds <= SCALARS:
            return _are_number_values_valid(inner, inner_kinds)
    for item in items:
        kind = type(item)
        if kind is dict:
            clean = set(map(type, item)) <= {str} and _are_clean_values(list(item.values()), depth + 1)
        else:
            clean = kind in SCALARS or (kind is list and _are_clean_values(item, depth + 1))
        if not clean:
            return False
    return _are_number_values_valid(items, kinds)


def _are_number_values_valid(items: list[Any], kinds: set[type]) -> bool:
    """Whether the numbers among the items, whose types are `kinds`, are allowed."""
    if int in kinds:
        integers = items if len(kinds) == 1 else [item for item in items if type(item) is int]
        if min(integers) < INT_MIN or max(integers) > INT_MAX:
            return False
    if float in kinds:
        return all(map(isfinite, items if len(kinds) == 1 else [item for item in items if type(item) is float]))
    return True


# --- all other values ----------------------------------------------------------------------------------


def _convert_value(value: Any, depth: int, named: bool) -> Any:
    """The value of the language that `value` stands for; a level of nesting takes one Python frame."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int):
        return _convert_integer_value(value)
    if isinstance(value, float):
        return _convert_float_value(value)
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, _CONTAINERS) and depth >= DEPTH_LIMIT:
        raise _TooDeep
    if named and isinstance(value, tuple) and hasattr(type(value), "_fields"):
        value = dict(zip(getattr(type(value), "_fields"), value, strict=True))  # noqa: B009
    if isinstance(value, _SEQUENCES):
        items = []
        for index, item in enumerate(value):
            try:
                items.append(_convert_value(item, depth + 1, named))
            except _RefusedValue as refused:
                refused.path.append(f"[{index}]")
                raise
        return items
    if isinstance(value, (set, frozenset)):
        return _sort_set_elements([_convert_value(item, depth + 1, named) for item in value])
    if isinstance(value, _MAPPINGS):
        mapping = {}
        for key, item in dict(value).items():
            try:
                mapping[_convert_dict_key_value(_convert_value(key, depth + 1, False))] = _convert_value(
                    item, depth + 1, named
                )
            except _RefusedValue as refused:
                refused.path.append(f"[{format_value(key)}]")
                raise
        return mapping
    if isinstance(value, complex):
        raise _RefusedValue(f"the complex number {value}", "give its parts, for example [z.real, z.imag]")
    if isinstance(value, datetime) and type(value) is not datetime:
        return _convert_datetime(value)
    if is_iterator_value(value):
        return _convert_value(list(value), depth, named)
    return _convert_numpy(value, depth, named)


def _convert_datetime(value: datetime) -> Any:
    """A time of a subclass, such as pandas.Timestamp, as the time that it equals; NaT as None.

    One that equals no time, as its nanoseconds are lost, stays an object.
    """
    if value != value:  # NaT
        return None
    parts = (value.year, value.month, value.day, value.hour, value.minute, value.second, value.microsecond)
    plain = datetime(*parts, value.tzinfo, fold=value.fold)
    return plain if plain == value and not getattr(value, "nanosecond", 0) else _wrap_object(value)


def _convert_integer_value(value: int) -> int:
    value = int.__index__(value)
    if INT_MIN <= value <= INT_MAX:
        return value
    hint = "integers have 64 bits; give a float or a string instead"
    raise _RefusedValue(format_value(value), hint, ", which does not fit into 64 bits")


def _convert_float_value(value: float) -> float:
    value = float.__float__(value)
    if isfinite(value):
        return value
    hint = "floats have to be finite; None can say that there is no value"
    raise _RefusedValue("NaN" if value != value else format_value(value), hint)


def _sort_set_elements(items: list[Any]) -> list[Any]:
    """The elements of a set in an order that does not depend on their hashes."""
    kinds = set(map(type, items))
    if not kinds <= {bool, int, float} and kinds != {str}:
        items.sort(key=lambda item: (type(item).__name__, format_value(item, 1000)))
    try:
        return sorted(items)
    except Exception:  # elements of several kinds, or objects whose < does not work
        return items


def _convert_dict_key_value(value: Any) -> Any:
    """A value as a key of a dict: lists become tuples again."""
    if isinstance(value, list):
        return tuple(map(_convert_dict_key_value, value))
    return Opaque(value) if isinstance(value, dict) else value


def _convert_numpy(value: Any, depth: int, named: bool) -> Any:
    """An array as a list, a scalar as a number, string, date or time; all else are objects."""
    numpy = sys.modules.get("numpy")  # where nobody imported NumPy, there is nothing of it
    if numpy is None or not isinstance(value, (numpy.generic, numpy.ndarray)):
        return _wrap_object(value)
    if value.dtype.kind in "mM":  # their items would lose their unit
        if isinstance(value, numpy.generic):
            return _convert_numpy_time(value)
        return _convert_numpy_time(value[()]) if value.ndim == 0 else _convert_value(list(value), depth, named)
    if isinstance(value, numpy.longdouble):
        return _convert_float_value(float(value))
    if isinstance(value, numpy.clongdouble):
        return _convert_value(complex(value), depth, named)
    items = value.tolist()
    return items if _is_clean_value(items, depth) else _convert_value(items, depth, named)


def _convert_numpy_time(value: Any) -> Any:
    """A date or time as the one of Python that it equals, NaT as None; all else are objects."""
    if value != value:  # NaT
        return None
    plain = value.item()
    if value.dtype.kind == "M" and isinstance(plain, int):  # nanoseconds, or a year beyond 9999
        rounded = value.astype("M8[us]")
        plain = rounded.item() if rounded == value else plain
    return plain if isinstance(plain, date) else _wrap_object(value)


def _wrap_object(value: Any) -> Any:
    """The object, wrapped unless it is hashable and `==` finds it equal to itself.

    Objects with an equality of their own, which may call them equal to a number or string, are wrapped as well and keep
    it among themselves; so are those that marshal would write as bytes (a memoryview, code), which it must not touch.
    Elements of worlds are equal to elements only.
    """
    if type(value) is UnreadableText:
        raise value.make_error()
    if type(value) is bytes or isinstance(value, (Opaque, Handle)):
        return value
    try:
        hash(value)
        if not value == value:  # noqa: SIM201 - it is == that must work
            return Opaque(value)
    except Exception:  # whatever a user's __hash__ or __eq__ raises
        return Opaque(value)
    equality: Any = type(value).__eq__
    if equality is not object.__eq__ and type(value).__module__ not in VALUE_MODULES:
        return Opaque(value, key=value)
    try:
        dumps(value, 2)
    except ValueError:
        return value
    return Opaque(value, key=value)


# --- the columns of an element: what `row.name` means, in both engines and in `row["name"]`
_NO_COLUMN = object()


def read_column(element: Any, name: str, default: Any = _NO_COLUMN) -> Any:
    """The column of an element: the value of a dict's key, or a public data attribute of an object.

    Args:
        element: the current element of a source.
        name: the column.
        default: what stands for a missing column; without it a missing column is an error.

    Raises:
        ExecutionError: X008 for a missing column, X004 where an attribute holds what is not a value.
    """
    if type(element) is dict:
        found = element.get(name, default)
        if found is not _NO_COLUMN:
            return found
        raise _build_no_column_error(name, [key for key in element if isinstance(key, str)], "this row")
    owner = element.object if isinstance(element, Opaque) else element
    if isinstance(owner, Handle):
        try:
            return convert_value(owner.__column__(name), f"the column '{name}'")
        except KeyError:
            if default is not _NO_COLUMN:
                return default
            raise _build_no_column_error(name, list(owner.__columns__()), repr(owner)) from None
    known = list_attributes(owner)
    if name in known:
        held = getattr(owner, "__dict__", {})
        found = held[name] if name in held else getattr(owner, name, default)  # a slot may be empty
        if found is not _NO_COLUMN:
            return convert_value(found, f"the attribute '{name}'", named=True)
    elif default is not _NO_COLUMN:
        return default
    list_columns = getattr(type(owner), "__columns__", None)  # of a world; other objects are not touched
    shown = known if list_columns is None else list_columns(owner)
    kind = type(owner)
    cure = _FRAMES.get((kind.__module__.partition(".")[0], kind.__name__))
    if cure is not None:
        message = f"a {kind.__name__} is one value here, so it has no column '{name}'"
        raise ExecutionError("X008", message, hints=(f"let the function return frame.{cure}",))
    raise _build_no_column_error(name, list(shown), format_value(element))


# What makes lists of data frames, by the package and the name of their type.
_FRAMES = {
    ("pandas", "DataFrame"): 'to_dict("list")',
    ("polars", "DataFrame"): "to_dicts()",
    ("pyarrow", "Table"): "to_pylist()",
}


def _build_no_column_error(name: str, known: list[str], owner: str) -> ExecutionError:
    hints = suggest_names(name, known) or (
        "dicts, and objects with public attributes, have columns; `this` is the element itself",
    )
    return ExecutionError("X008", f"{owner} has no column '{name}'", hints=hints)
