"""The shapes of result columns: the types that frames and files need before they take the values.

The values decide; where there are none, or only None, the plan's promise does. `ANY` has no type in frames: objects,
values of several kinds in one column, whole numbers beyond 2^53 beside floats.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from functools import reduce
from itertools import chain
from typing import Any, Literal, TypeAlias

from ss2sql.errors import RepresentationError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind, Type, is_encodable
from ss2sql.language.values import format_value

EXACT = 2**53  # floats hold whole numbers up to this one


@dataclass(frozen=True, slots=True)
class Scalar:
    """Values of one kind; `large`: some whole numbers have no exact float."""

    name: Literal["none", "bool", "int", "float", "str", "bytes", "date", "datetime", "any"]
    large: bool = False


@dataclass(frozen=True, slots=True)
class ListOf:
    item: Shape


@dataclass(frozen=True, slots=True)
class Struct:
    """Dicts; a key that one of them lacks counts as None."""

    fields: tuple[tuple[str, Shape], ...]


Shape: TypeAlias = Scalar | ListOf | Struct

NONE, BOOL, INT = Scalar("none"), Scalar("bool"), Scalar("int")
FLOAT, STR, ANY = Scalar("float"), Scalar("str"), Scalar("any")
LARGE = Scalar("int", large=True)
SCALARS: dict[type, Scalar] = {
    type(None): NONE, bool: BOOL, int: INT, float: FLOAT, str: STR,
    bytes: Scalar("bytes"), datetime.date: Scalar("date"), datetime.datetime: Scalar("datetime"),
}  # fmt: skip
PLAN = ((Kind.BOOL, BOOL), (Kind.INT, INT), (Kind.NUMBER & ~Kind.BOOL, FLOAT), (Kind.STR, STR))


def infer_column_shape(values: Sequence[Any], promised: Type | None = None) -> Shape:
    """The common shape of the values of a column; `promised` is the plan's type."""
    found = _find_values_shape(values)
    return found if promised is None else _fill_shape(found, _infer_shape_of_type(promised))


def _find_values_shape(values: Sequence[Any]) -> Shape:
    found: Shape = NONE
    for kind in dict.fromkeys(map(type, values)):
        found = merge_shapes(found, _infer_kind_shape(kind, values))
    return found


def _infer_kind_shape(kind: type, values: Sequence[Any]) -> Shape:
    """The shape of those of the values that are of one Python type."""
    if kind is type(None):
        return NONE
    own: list[Any] = [value for value in values if type(value) is kind]
    if kind is list:
        return ListOf(_find_values_shape(list(chain.from_iterable(own))))
    if kind is dict:
        return _find_dicts_shape(own)
    if kind is int:
        return INT if max(own) <= EXACT and min(own) >= -EXACT else LARGE
    if kind is str and not all(map(is_encodable, own)):
        return ANY
    if kind is datetime.datetime and any(value.tzinfo is not None for value in own):
        return ANY
    return SCALARS.get(kind, ANY)


def _find_dicts_shape(values: Sequence[dict[Any, Any]]) -> Shape:
    names = dict.fromkeys(chain.from_iterable(values))
    if not all(isinstance(name, str) for name in names) or not all(map(is_encodable, names)):
        return ANY
    return Struct(tuple((name, _find_values_shape([value.get(name) for value in values])) for name in names))


def merge_shapes(left: Shape, right: Shape) -> Shape:
    """The smallest shape for the values of both."""
    match left, right:
        case _ if left == right:
            return left
        case Scalar("none"), _:
            return right
        case _, Scalar("none"):
            return left
        case Scalar("int"), Scalar("int"):
            return LARGE
        case (Scalar("int", large=large), Scalar("float")) | (Scalar("float"), Scalar("int", large=large)):
            return ANY if large else FLOAT
        case ListOf(one), ListOf(other):
            return ListOf(merge_shapes(one, other))
        case Struct(one), Struct(other):
            known, more = dict(one), dict(other)
            names = dict.fromkeys((*known, *more))
            return Struct(tuple((name, merge_shapes(known.get(name, NONE), more.get(name, NONE))) for name in names))
        case _:
            return ANY


def _infer_shape_of_type(promised: Type) -> Shape:
    """The shape of all values of a type, NONE where the type does not say it."""
    kinds = promised.kinds & ~Kind.NONE
    if not kinds:
        return NONE
    if kinds == Kind.LIST:
        return ListOf(NONE if promised.element is None else _infer_shape_of_type(promised.element))
    if kinds == Kind.DICT and promised.columns:
        return Struct(tuple((name, _infer_shape_of_type(column)) for name, column in promised.columns))
    return next((shape for wide, shape in PLAN if kinds | wide == wide), NONE)


def _fill_shape(found: Shape, promised: Shape) -> Shape:
    """The shape found, completed by the promised one where no values were."""
    match found, promised:
        case Scalar("none"), _:
            return promised
        case ListOf(one), ListOf(other):
            return ListOf(_fill_shape(one, other))
        case Struct(one), Struct(other):
            known = dict(other)
            return Struct(tuple((name, _fill_shape(shape, known.get(name, NONE))) for name, shape in one))
        case _:
            return found


def is_untyped(shape: Shape) -> bool:
    """Whether it contains, at any depth, values without a type in frames."""
    match shape:
        case ListOf(item):
            return is_untyped(item)
        case Struct(fields):
            return any(is_untyped(field) for _, field in fields)
        case _:
            return shape == ANY


def convert_value_to_shape(value: Any, shape: Shape) -> Any:
    """The value with whole numbers as floats where its shape is float, for libraries that do not convert."""
    match shape:
        case _ if value is None:
            return None
        case Scalar("float"):
            return float(value)
        case ListOf(item):
            return [convert_value_to_shape(part, item) for part in value]
        case Struct(fields):
            return {name: convert_value_to_shape(value.get(name), field) for name, field in fields}
        case _:
            return value


def make_arrow_type(arrow: Any, shape: Shape) -> Any:
    """The type of Arrow for the values of a shape."""
    match shape:
        case ListOf(item):
            return arrow.list_(make_arrow_type(arrow, item))
        case Struct(fields):
            return arrow.struct([(name, make_arrow_type(arrow, field)) for name, field in fields])
        case Scalar("datetime"):
            return arrow.timestamp("us")
        case Scalar(name):
            own = {"none": "null", "bool": "bool_", "int": "int64", "float": "float64", "str": "string",
                   "bytes": "binary", "date": "date32"}  # fmt: skip
            return getattr(arrow, own[name])()


@dataclass(frozen=True, slots=True)
class ColumnShape:
    """What values of a column have in common; the text of one of them, and of one that does not go with it.

    Where a value alone has no type, `first` is that one.
    """

    shape: Shape = NONE
    first: str | None = None
    other: str | None = None

    def merge_shapes(self, more: ColumnShape) -> ColumnShape:
        for one in (self, more):
            if is_untyped(one.shape):
                return one
        shape = merge_shapes(self.shape, more.shape)
        return ColumnShape(shape, self.first or more.first, more.first if is_untyped(shape) else None)


def infer_shape(values: Sequence[Any]) -> ColumnShape:
    found = infer_column_shape(values)
    there = [value for value in values if value is not None]
    if not is_untyped(found) or not there:
        return ColumnShape(found, format_value(there[0]) if there else None)
    each = (ColumnShape(infer_column_shape([value]), format_value(value)) for value in there)
    return reduce(ColumnShape.merge_shapes, each)


def build_type_error(library: str, name: str, told: ColumnShape, *hints: str) -> RepresentationError:
    """The error for a column that has no type in a library."""
    if told.other is None:
        message = f"{library} has no type for {told.first} in the column '{name}'"
        return RepresentationError("V001", message, hints=hints)
    kinds = f"values of several kinds, such as {told.first} and {told.other}"
    message = f"the column '{name}' has {kinds}; a column of {library} has one"
    return RepresentationError(
        "V001", message, hints=("make them alike in SELECT, with str(...) or float(...)", *hints)
    )
