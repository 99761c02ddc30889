"""The path of a step as a linked list, for `path(e)` and `cycle(e)`, see frontend/path_functions.py.

The names of these operations have blanks, so scripts cannot call them.
"""

from __future__ import annotations

from typing import Any

from ss2sql.kinds import UNENCODABLE, Kind, Type
from ss2sql.language.operations.arguments import wrong
from ss2sql.language.operations.row import operation
from ss2sql.runtime.messages import show


class Cell:
    """The value of an expression in a step, linked to its values in the steps before."""

    __slots__ = ("before", "value")

    def __init__(self, before: Cell | None, value: Any) -> None:
        self.before = before
        self.value = value


def values(cell: Cell | None) -> list[Any]:
    """The values of the expression in each step, from the first on."""
    found: list[Any] = []
    while cell is not None:
        found.append(cell.value)
        cell = cell.before
    return found[::-1]


def text(cell: Cell | None, between: Any) -> str:
    """The same values joined to one string."""
    if type(between) is not str:
        raise wrong(
            f"path puts a text between values, not {show(between)}", 'write a text between two values: path(x, "/")'
        )
    return between.join(map(str, values(cell)))


OPERATIONS = (
    operation(
        "path cell", 2, Cell, Type(Kind.OBJECT), False,
        call="path(x)", about="a step of path(x)", example="",
    ),
    operation(
        "path values", 1, values, Type(Kind.LIST), False,
        call="path(x)", about="what x was on the path", example="",
    ),
    operation(
        "path text", 2, text, UNENCODABLE, True,
        call='path(x, "/")', about="what x was on the path, as a text", example="", grows=True,
    ),
)  # fmt: skip
