"""The declared types of columns, the conversion of adapters' values to them, and the layout of groups of columns.

Every value of a world passes through the cleaner of its column: NumPy's scalars become numbers, integers in float
columns floats, tuples lists. Values that do not fit are refused with the name of the column.

"mass friction" are two values. "pos(x=posX y z) quat" are a tuple of three and another value: the tuple is the column
`pos`, as a list, and its values are columns, too; the first has two names. So a group may return the result of one
call of a simulator unchanged, and only what is read is unpacked.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import chain
from types import NoneType, UnionType
from typing import Any, TypeAlias, Union, get_args, get_origin

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import convert_value, format_value
from ss2sql.language.kinds import (
    ANY,
    BOOL,
    INT,
    INT_MAX,
    INT_MIN,
    LIST,
    NONE,
    STR,
    Kind,
    Type,
    is_encodable,
    make_list_type,
    unite,
)
from ss2sql.vtables.contract import LARGEST

Cleaner = Callable[[Any], Any]

_PLAIN: dict[Any, Type] = {
    int: INT,
    float: Type(Kind.FLOAT, -LARGEST, LARGEST),
    bool: BOOL,
    str: STR,
    list: LIST,
    dict: Type(Kind.DICT),
    object: ANY,
    None: NONE,
    NoneType: NONE,
}


def find_declared_type(declared: Any) -> Type:
    """The type of the language that a declared type stands for. Raises TypeError for anything else."""
    if isinstance(declared, tuple):
        return make_list_type([find_declared_type(part) for part in declared])
    if get_origin(declared) in (UnionType, Union):
        return unite(map(find_declared_type, get_args(declared)))
    try:
        return _PLAIN[declared]
    except (KeyError, TypeError):
        raise TypeError(f"{declared!r} is no type of a column") from None


def format_declared_type(declared: Any) -> str:
    """A declared type as it is written in Python."""
    if isinstance(declared, tuple):
        return f"({', '.join(map(format_declared_type, declared))})"
    return declared.__name__ if isinstance(declared, type) else str(declared)


def misfit_error(message: str, *hints: str) -> ExecutionError:
    return ExecutionError("X004", message, hints=hints)


def make_cleaner(kind: Type, giver: str) -> Cleaner:
    """The function that converts values of one declared type to values of the language; `giver` names the column."""
    scalar = _SCALARS.get(kind.kinds)
    return _make_other_cleaner(kind, giver) if scalar is None else _make_scalar_cleaner(scalar, kind.kinds, giver)


_SCALARS: dict[Kind, type] = {Kind.FLOAT: float, Kind.INT: int, Kind.BOOL: bool, Kind.STR: str}
_LIMITS: dict[type, tuple[float, float]] = {float: (-LARGEST, LARGEST), int: (INT_MIN, INT_MAX), bool: (False, True)}


def _make_scalar_cleaner(wanted: type[Any], kind: Kind, giver: str) -> Cleaner:
    low, high = _LIMITS.get(wanted, (0, 0))

    def clean_scalar(value: Any) -> Any:
        if type(value) is not wanted:
            value = _convert_scalar(value, giver)
            if wanted is float and type(value) is int:
                value = float(value)
            if type(value) is not wanted:
                raise _make_column_kind_error(giver, value, _ONE[kind])
        if wanted is str:
            if not is_encodable(value):
                raise misfit_error(f"{giver} holds {value!r}, which is no text that can be written as UTF-8")
        elif not low <= value <= high:
            if wanted is int:
                raise misfit_error(f"{giver} holds {format_value(value)}, which does not fit into 64 bits")
            hint = "floats of worlds lie within 1e100; None needs a column `float | None`"
            raise misfit_error(f"{giver} holds {value}", hint)
        return value

    return clean_scalar


def _make_other_cleaner(kind: Type, giver: str) -> Cleaner:
    """The cleaner of types of several kinds, and of structured ones."""
    if kind.kinds == Kind.LIST and kind.positions:
        return _make_list_cleaner(kind.positions, giver)
    optional = kind.may_be(Kind.NONE)
    scalars = [_ONE[one] for one in _ONE if kind.may_be(one)]
    single = any(kind.is_only(one | Kind.NONE) and kind.may_be(one) for one in _SINGLE)
    inner = make_cleaner(replace(kind, kinds=kind.kinds & ~Kind.NONE), giver) if single and optional else None

    def clean_value(value: Any) -> Any:
        if value is None and optional:
            return None
        if inner is not None:
            return inner(value)
        plain = convert_value(value, giver)
        if kind.kinds != Kind.ANY and not kind.may_be(_CLASSES.get(type(plain), Kind.OBJECT)):
            raise _make_column_kind_error(giver, value, " or ".join(scalars) or "another value")
        return plain

    return clean_value


def _make_list_cleaner(kinds: Sequence[Type], giver: str) -> Cleaner:
    parts = [make_cleaner(part, giver) for part in kinds]
    fits = make_column_test(tuple(kind.kinds for kind in kinds)) or (lambda value: False)

    def clean_list(value: Any) -> Any:
        if type(value) is tuple and fits(value):
            return list(value)
        items = value.tolist() if hasattr(value, "tolist") else value
        if not isinstance(items, (list, tuple)) or len(items) != len(parts):
            raise _make_column_kind_error(giver, value, f"a list of {len(parts)} values")
        return [part(item) for part, item in zip(parts, items, strict=True)]

    return clean_list


_TESTS = {
    Kind.FLOAT: "type({0}) is float and LOW <= {0} <= HIGH",
    Kind.INT: "type({0}) is int and LEAST <= {0} <= GREATEST",
    Kind.STR: "type({0}) is str and ({0}.isascii() or WRITTEN({0}))",
    Kind.BOOL: "({0} is True or {0} is False)",
}


_NAMES = {"LOW": -LARGEST, "HIGH": LARGEST, "LEAST": INT_MIN, "GREATEST": INT_MAX, "WRITTEN": is_encodable}


Kinds: TypeAlias = "tuple[Kind | tuple[Kind, ...], ...]"  # of values; a tuple for one that is a tuple itself


@cache
def make_column_test(kinds: Kinds) -> Callable[[Any], bool] | None:
    """A test that all values of a tuple are clean scalars of these kinds; None for other kinds.

    As one function of plain tests it takes 0.2 us for four values, a call for each value 0.6 us.
    """
    lines, tests = ["def fits(values):"], list[str]()

    def add_tests(names: str, wanted: Sequence[Any]) -> None:
        parts = [f"{names}_{number}" for number in range(len(wanted))]
        lines.append(f" if type({names}) is not tuple or len({names}) != {len(wanted)}: return False")
        lines.append(f" {', '.join(parts)}, = {names}")
        for name, kind in zip(parts, wanted, strict=True):
            if isinstance(kind, tuple):
                add_tests(name, kind)
            else:
                test = _TESTS[kind & ~Kind.NONE].format(name)
                tests.append(f"({name} is None or {test})" if kind & Kind.NONE else test)

    try:
        add_tests("values", kinds)
    except KeyError:
        return None
    lines.append(f" return {' and '.join(tests)}")
    made: dict[str, Any] = dict(_NAMES)
    exec("\n".join(lines), made)  # the code comes from this file alone
    return made["fits"]  # type: ignore[no-any-return]


_ONE = {Kind.INT: "an int", Kind.FLOAT: "a float", Kind.BOOL: "a bool", Kind.STR: "a str", Kind.LIST: "a list",
        Kind.DICT: "a dict", Kind.NONE: "None"}  # fmt: skip
_SINGLE = (Kind.INT, Kind.FLOAT, Kind.BOOL, Kind.STR, Kind.LIST, Kind.DICT)
_CLASSES: dict[type, Kind] = {
    NoneType: Kind.NONE, bool: Kind.BOOL, int: Kind.INT, float: Kind.FLOAT, str: Kind.STR, list: Kind.LIST,
    dict: Kind.DICT,
}  # fmt: skip


def _convert_scalar(value: Any, giver: str) -> Any:
    """A scalar of NumPy's as a number or string; arrays, even those with one element, are refused."""
    if getattr(value, "ndim", 0):
        raise misfit_error(
            f"{giver} holds an array of the shape {tuple(value.shape)}",
            "declare a list column: a tuple of types, or list",
        )
    return convert_value(value, giver)


def _make_column_kind_error(giver: str, value: Any, wanted: str) -> ExecutionError:
    return misfit_error(f"{giver} holds {format_value(value)}, which is not {wanted}")


# --- the layout of a group: columns side by side, or inside of tuples
_PART = re.compile(r"([^\s()=]+(?:=[^\s()=]+)*)(?:\(([^()]*)\))?(?=\s|$)")


@dataclass(frozen=True, slots=True)
class Part:
    """One value of a group: the columns that show it, and where it is a tuple, those that show its values."""

    names: tuple[str, ...]
    inner: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a column: the value with a number, or one of the values of this tuple; `whole` is the tuple."""

    number: int
    inner: int | None = None
    whole: bool = False

    def get_value(self, values: Sequence[Any]) -> Any:
        value = values[self.number]
        if self.inner is not None:
            return value[self.inner]
        return list(value) if self.whole else value


class Layout:
    """The layout of one group. Raises ValueError for a text that is none."""

    def __init__(self, text: str) -> None:
        parts = [
            Part(tuple(names.split("=")), tuple(tuple(one.split("=")) for one in inner.split()))
            for names, inner in _PART.findall(text)
        ]
        if _PART.sub("", text).strip() or not parts:
            raise ValueError(f"{text!r} does not name columns")
        self.parts = tuple(parts)
        self.places: dict[str, Place] = {}
        for number, part in enumerate(parts):
            self.places.update(dict.fromkeys(part.names, Place(number, whole=bool(part.inner))))
            for inner, names in enumerate(part.inner):
                self.places.update(dict.fromkeys(names, Place(number, inner)))
        self.names = tuple(chain.from_iterable((*part.names, *chain.from_iterable(part.inner)) for part in parts))

    @property
    def is_flat(self) -> bool:
        """Whether every column is a value of its own with one name."""
        return len(self.parts) == len(self.names)

    @property
    def items(self) -> dict[str, tuple[str, ...]]:
        """The columns of lists, each with a column for each item."""
        lists = [part for part in self.parts if part.inner]
        return {name: tuple(inner[0] for inner in part.inner) for part in lists for name in part.names}

    @property
    def heads(self) -> tuple[str, ...]:
        """A column for each value."""
        return tuple(part.names[0] for part in self.parts)

    def list_tested_kinds(self, kinds: Mapping[str, Type]) -> Kinds:
        return tuple(
            tuple(kinds[names[0]].kinds for names in part.inner) if part.inner else kinds[part.names[0]].kinds
            for part in self.parts
        )

    def find_contradiction(self, kinds: Mapping[str, Type]) -> str | None:
        """The contradiction between the layout and the types of the columns, if any."""
        for part in self.parts:
            for names in (part.names, *part.inner):
                if len({kinds[name] for name in names}) > 1:
                    return f"{' and '.join(names)} are the same value, and of different types"
            inner = tuple(kinds[names[0]] for names in part.inner)
            if inner and (kinds[part.names[0]].positions != inner or not all(kind.is_only(_FLAT) for kind in inner)):
                return f"'{part.names[0]}' is no list of {len(inner)} plain values as they are declared"
        return None

    def clean_values(self, cleaners: Mapping[str, Cleaner], raw: Sequence[Any]) -> tuple[Any, ...]:
        """The group's values, converted; tuples stay tuples. Raises TypeError, ValueError for too few."""
        return tuple(
            [
                tuple(cleaners[part.names[0]](value)) if part.inner else cleaners[part.names[0]](value)
                for part, value in zip(self.parts, raw, strict=True)
            ]
        )


_FLAT = Kind.NONE | Kind.BOOL | Kind.INT | Kind.FLOAT | Kind.STR
