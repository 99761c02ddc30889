"""`AS dict`: a list of dicts, one per row."""

from __future__ import annotations

from typing import Any

from ss2sql.runtime.representations.base import Table


def represent(table: Table) -> list[dict[str, Any]]:
    """The rows as dicts by their column names."""
    return table.dicts()
