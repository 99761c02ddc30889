"""Dataclasses that are made quickly: `dataclass` as in the standard library, without `order` and `unsafe_hash`.

A first query needs some 130 classes. The standard library compiles up to seven functions for each; here comparison,
hash and representation are closures, which takes half the time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, **options):
        return _build_class(cls) if cls is not None else lambda cls: _build_class(cls, **options)


def _build_class(cls: type, frozen: bool = False, eq: bool = True, repr: bool = True, **others: bool) -> Any:
    """Builds the class: fields and `__init__` by the standard library, the other methods from here."""
    own, cls.__doc__ = vars(cls), cls.__doc__ or cls.__name__  # the library would write a signature
    made: Any = dataclasses.dataclass(cls, repr=False, eq=False, frozen=frozen, **others)
    known = dataclasses.fields(made)
    if eq and "__eq__" not in own:
        values = _write_field_values([one.name for one in known if one.compare])
        made.__eq__ = _make_field_equality(values)
        if "__hash__" not in own:
            made.__hash__ = (lambda self: hash(values(self))) if frozen else None
    if repr and "__repr__" not in own:
        made.__repr__ = _make_repr([one.name for one in known if one.repr])
    return made


def _write_field_values(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """What gives the values of fields."""
    if len(names) > 1:
        return attrgetter(*names)
    return (lambda made: (getattr(made, names[0]),)) if names else (lambda made: ())


def _make_field_equality(values: Callable[[Any], tuple[Any, ...]]) -> Callable[[Any, Any], bool]:
    def are_equal(self: Any, other: Any) -> bool:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    return are_equal


def _make_repr(names: list[str]) -> Callable[[Any], str]:
    def format_repr(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    return format_repr
