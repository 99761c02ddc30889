"""`AS rows`: a list of tuples."""

from __future__ import annotations

from typing import Any

from ss2sql.runtime.representations.base import Table


def represent(table: Table) -> list[tuple[Any, ...]]:
    return list(table)
