"""`AS void`: the query runs for its effects; its value is None."""

from __future__ import annotations

from ss2sql.runtime.representations.base import Table


def represent(table: Table) -> None:
    return None
