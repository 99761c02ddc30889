"""`AS value`: the first column of the first row, or None."""

from __future__ import annotations

from typing import Any

from ss2sql.runtime.representations.base import Table


def represent(table: Table) -> Any:
    return table.rows[0][0] if table.rows else None
