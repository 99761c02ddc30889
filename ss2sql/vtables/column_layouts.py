"""The layout of a group: columns side by side, or inside of tuples.

"mass friction" are two values. "pos(x=posX y z) quat" are a tuple of three and another value: the tuple is the column
`pos`, as a list, and its values are columns, too; the first has two names. So a group may return the result of one
call of a simulator unchanged, and only what is read is unpacked.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind, Type
from ss2sql.vtables.declared_types import Cleaner, Kinds

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

    def write_code(self, values: str) -> str:
        """Python code for the value of the column; `values` is code for the group's value."""
        if self.inner is not None:
            return f"{values}[{self.number}][{self.inner}]"
        return f"[*{values}[{self.number}]]" if self.whole else f"{values}[{self.number}]"

    def get_value(self, values: Sequence[Any]) -> Any:
        """The value of the column."""
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
        """The kinds that a quick test checks."""
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
            if inner and (kinds[part.names[0]].positions != inner or not all(kind.is_only(_PLAIN) for kind in inner)):
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


_PLAIN = Kind.NONE | Kind.BOOL | Kind.INT | Kind.FLOAT | Kind.STR
