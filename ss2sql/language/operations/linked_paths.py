"""The path of a step as a linked list, for `path(e)` and `cycle(e)`, see frontend/resolve/search_clauses.py.

The names of these operations have blanks, so scripts cannot call them.
"""

from __future__ import annotations

from typing import Any

from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import UNENCODABLE, Kind, Type
from ss2sql.language.operations.operation import declare, misuse


class PathCell:
    """The value of an expression in a step, linked to its values in the steps before."""

    __slots__ = ("before", "value")

    def __init__(self, before: PathCell | None, value: Any) -> None:
        self.before = before
        self.value = value


def list_path(cell: PathCell | None) -> list[Any]:
    """The values of the expression in each step, from the first on."""
    found: list[Any] = []
    while cell is not None:
        found.append(cell.value)
        cell = cell.before
    return found[::-1]


def join_path(cell: PathCell | None, between: Any) -> str:
    """The same values joined to one string."""
    if type(between) is not str:
        raise misuse(
            f"path puts a text between values, not {format_value(between)}",
            'write a text between two values: path(x, "/")',
        )
    return between.join(map(str, list_path(cell)))


OPERATIONS = (
    declare(
        "path cell", 2, PathCell, Type(Kind.OBJECT), False,
        call="path(x)", about="a step of path(x)", example="",
    ),
    declare(
        "path values", 1, list_path, Type(Kind.LIST), False,
        call="path(x)", about="what x was on the path", example="",
    ),
    declare(
        "path text", 2, join_path, UNENCODABLE, True,
        call='path(x, "/")', about="what x was on the path, as a text", example="", grows=True,
    ),
)  # fmt: skip
