"""Frozen values: what the states and rows of a search in Python are made of.

A frozen value is hashable, and equal to another one where the language says that the values are equal; `thaw_value`
gives the value back as it was. A list is a tuple of frozen values, a scalar and an object are themselves, a dict is
wrapped. The garbage collector soon leaves tuples of scalars alone, where it would walk through lists for ever.

    >>> freeze_any([[3, 2.0], [], "x"])
    ((3, 2.0), (), 'x')
    >>> thaw_value(freeze_any([[3, 2.0], [], "x"]))
    [[3, 2.0], [], 'x']

A value that comes back with every step has a `Shape`, guessed from what START WITH gives: `flat` is a list of scalars,
`nested` a list of such lists. A value of that shape is frozen and thawed without a call in Python. Every other value of
its place is wrapped, so a tuple there is proof of the shape.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Any, Literal, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import SCALARS, convert_value
from ss2sql.language.kinds import SCALAR, Kind, Type
from ss2sql.language.value_messages import DEPTH_LIMIT

Shape: TypeAlias = Literal["scalar", "flat", "nested", "any"]
State: TypeAlias = tuple[Any, ...]  # of the frozen values of the START WITH variables, or of the values
FrozenRow: TypeAlias = tuple[Any, ...]
Row: TypeAlias = tuple[Any, ...]
Thaw: TypeAlias = Callable[[Iterable[FrozenRow]], tuple[Row, ...]]

UNSET = object()  # in place of a value that is not evaluated yet


class Frozen:
    """A frozen value that is no tuple: a dict, or a list that has not the shape of its place."""

    __slots__ = ("key", "value")

    def __init__(self, value: Any, key: Hashable) -> None:
        self.value, self.key = value, key

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frozen) and bool(self.key == other.key)


def freeze_any(value: Any) -> Any:
    """The frozen value of any shape."""
    return _retry_with_stack(_freeze_deep, value)


def _freeze_deep(value: Any) -> Any:
    kind = type(value)
    if kind is list:
        return tuple([item if type(item) in SCALARS else _freeze_deep(item) for item in value])
    if kind is dict:
        return Frozen(value, frozenset(zip(value, map(_freeze_deep, value.values()), strict=True)))
    return value


def thaw_value(value: Any) -> Any:
    """The value that was frozen."""
    return _retry_with_stack(_thaw_deep, value)


def _thaw_deep(value: Any) -> Any:
    kind = type(value)
    if kind is tuple:
        return [item if type(item) in SCALARS else _thaw_deep(item) for item in value]
    return value.value if kind is Frozen else value


def _retry_with_stack(work: Callable[[Any], Any], value: Any) -> Any:
    """The work on a value, begun afresh with room where it is nested too deeply for Python's usual stack."""
    try:
        return work(value)
    except RecursionError:
        from ss2sql.language.recursion_limit import deepen_stack  # rarely needed

        with deepen_stack(DEPTH_LIMIT // 10):  # two frames for a level
            return work(value)


def freeze_flat(value: Any) -> Any:
    """The frozen value of a place whose shape is `flat`."""
    if type(value) is list:
        return tuple(value) if SCALARS.issuperset(map(type, value)) else Frozen(value, freeze_any(value))
    return freeze_any(value)


def freeze_nested(value: Any) -> Any:
    """The frozen value of a place whose shape is `nested`."""
    if type(value) is not list:
        return freeze_any(value)
    if all(type(part) is list and SCALARS.issuperset(map(type, part)) for part in value):
        return tuple(map(tuple, value))
    return Frozen(value, freeze_any(value))


def thaw_nested(value: Any) -> Any:
    """The value of a place whose shape is `nested`: in a quarter of the time."""
    return list(map(list, value)) if type(value) is tuple else thaw_value(value)


THAWERS: dict[Shape, Callable[[Any], Any]] = {
    "scalar": thaw_value,
    "any": thaw_value,
    "flat": thaw_value,
    "nested": thaw_nested,
}
FREEZERS: dict[Shape, Callable[[Any], Any]] = {
    "scalar": freeze_any,
    "any": freeze_any,
    "flat": freeze_flat,
    "nested": freeze_nested,
}


def choose_shape(known: Type) -> Shape:
    """The shape that values of this type have, or most of them."""
    if known.is_only(SCALAR):
        return "scalar"
    if is_flat_list(known):
        return "flat"
    return "nested" if known.is_only(Kind.LIST) and known.item is not None and is_flat_list(known.item) else "any"


def is_flat_list(known: Type) -> bool:
    """Whether values of this type are lists of scalars."""
    return known.is_only(Kind.LIST) and known.item is not None and known.item.is_only(SCALAR)


def convert_and_freeze(value: Any, giver: str, freezer: Callable[[Any], Any]) -> tuple[Any, Any]:
    """The value of the language for what a function gave, and its frozen value."""
    value = convert_value(value, f"the function '{giver}'")
    return value, freezer(value)


@dataclass(frozen=True, slots=True)
class FrozenShapes:
    """How the START WITH variables of a search are frozen, and the columns of its rows."""

    states: tuple[Shape, ...]
    columns: tuple[Shape, ...]

    def freeze_state(self, state: State) -> State:
        """The frozen state."""
        return tuple([FREEZERS[shape](value) for shape, value in zip(self.states, state, strict=True)])

    def thaw_state(self, state: State) -> State:
        """The values of a frozen state."""
        return tuple(map(thaw_value, state))

    def make_row_thaw(self) -> Thaw | None:
        """What makes the rows of paths of frozen ones, for one run; None where they are the same.

        Paths share their rows, so after the first path, which often is the only one, each row is thawed once: the
        garbage collector looks through all that are made.
        """
        if all(shape == "scalar" for shape in self.columns):
            return None
        rows_of = _thaw_rows_of_lists if self.columns == ("flat",) else _thaw_rows
        known: dict[int, tuple[FrozenRow, Row]] = {}  # by identity, which the frozen row keeps
        begun = False

        def thaw_first(path: Iterable[FrozenRow]) -> tuple[Row, ...]:
            return tuple(rows_of(path))

        def thaw_other(path: Iterable[FrozenRow]) -> tuple[Row, ...]:
            rows = []
            for row in path:
                found = known.get(id(row))
                if found is None:
                    made = tuple([value if type(value) in SCALARS else _thaw_deep(value) for value in row])
                    found = known[id(row)] = row, made
                rows.append(found[1])
            return tuple(rows)

        def thaw_path(path: Iterable[FrozenRow]) -> tuple[Row, ...]:
            nonlocal begun
            work, begun = thaw_other if begun else thaw_first, True
            return _retry_with_stack(work, path)  # type: ignore[no-any-return]

        return thaw_path


def _thaw_rows(path: Iterable[FrozenRow]) -> list[Row]:
    return [tuple([value if type(value) in SCALARS else _thaw_deep(value) for value in row]) for row in path]


def _thaw_rows_of_lists(path: Iterable[FrozenRow]) -> list[Row]:
    """The same for rows whose only column is `flat`."""
    return [(list(value) if type(value) is tuple else _thaw_deep(value),) for (value,) in path]
