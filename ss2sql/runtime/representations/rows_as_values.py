"""`AS dict`, `list`, `rows`, `set`, `value` and `void`: the rows as values of Python."""

from __future__ import annotations

from itertools import chain
from typing import Any

from ss2sql.errors import RepresentationError
from ss2sql.language.representation_table import Table
from ss2sql.language.values import format_value


def as_dict(table: Table) -> list[dict[str, Any]]:
    """A list of dicts, one per row, by the names of the columns."""
    return table.dicts()


def as_list(table: Table) -> list[Any]:
    """The values of all columns in one flat list, row after row."""
    return list(chain.from_iterable(table))


def as_rows(table: Table) -> list[tuple[Any, ...]]:
    """A list of tuples."""
    return list(table)


def as_set(table: Table) -> set[Any]:
    """The different values of all columns, lists as tuples; the first of equal values stands for all of them.

    Raises RepresentationError V001 for a value without a hash.
    """
    return set(map(_make_hashable, chain.from_iterable(table)))


def _make_hashable(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(map(_make_hashable, value))
    try:
        hash(value)
    except TypeError:
        hint = "select its parts, or use AS list"
        raise RepresentationError(
            "V001", f"{format_value(value)} cannot be an element of a set", hints=(hint,)
        ) from None
    return value


def as_value(table: Table) -> Any:
    """The first column of the first row; None where there is no row."""
    return table.rows[0][0] if table.rows else None


def as_void(table: Table) -> None:
    """None: the query runs for its effects."""
