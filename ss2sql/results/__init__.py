"""Conversions of results: to text (`show`), frames (`kinds`, `frames`), files (`files`), graphs and plots.

All of them read the table of a result, its `columns` and the tuples of its iteration, or the paths of a search.
Packages of the extras are imported by the functions that need them; `package` raises for a missing one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError
from ss2sql.extras import install_line
from ss2sql.runtime.checking import checked
from ss2sql.runtime.rows import Row
from ss2sql.runtime.values import fresh

if TYPE_CHECKING:
    from ss2sql.runtime.result import Result


def package(name: str, extra: str, user: str) -> Any:
    """A package of an extra. Raises SessionError S003 with the install command; `user` is what needs it."""
    try:
        return import_module(name)
    except ImportError as reason:
        raise SessionError(
            "S003",
            f"{user} needs the package {name.partition('.')[0]}, which is not installed",
            hints=(install_line(extra),),
        ) from reason


def rows_of(result: Result) -> Iterator[Row]:
    """Copies of the rows of a result as plain tuples."""
    if result.answer is None:
        yield (result.value,)
    elif result.answer.rows.paths is not None:
        for number, path in enumerate(result.answer.rows.paths, 1):
            for step, row in enumerate(path, 1):
                yield (number, step, *fresh_row(row))
    else:
        rows = result.answer.rows.rows or ()
        yield from rows if result.answer.rows.plain else map(fresh_row, rows)


def all_rows_of(result: Result) -> list[Row]:
    """All these rows at once. Raises Timeout or OutOfMemory beyond the remaining limits of the run."""
    with result.reading() as check:
        return list(checked(rows_of(result), check))


def fresh_row(row: Row) -> Row:
    """A row with copies of its values."""
    return tuple(map(fresh, row))


def found_paths(result: Result) -> Sequence[Sequence[Row]] | None:
    """The paths of a search without copies, not to be changed; None of other results."""
    return None if result.answer is None else result.answer.rows.paths
