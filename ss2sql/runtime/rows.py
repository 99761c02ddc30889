"""What an executor hands to the representations: rows, or the paths of a search, with the names of the columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

Row: TypeAlias = tuple[Any, ...]


@dataclass(slots=True)
class Rows:
    """The answer of one query, before `AS`.

    `rows` holds the rows of a flat query, `paths` those of a search (one list of rows per path), the other
    is None. With a GROUP BY that partitions, `groups` lists each group's value and the positions of its
    members in `rows` or `paths`, in order of first appearance.
    """

    columns: tuple[str, ...]
    rows: list[Row] | None = None
    paths: list[list[Row]] | None = None
    groups: list[tuple[Any, list[int]]] | None = None
