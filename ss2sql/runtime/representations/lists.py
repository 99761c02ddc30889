"""`AS list`: the values of all columns in one flat list, row after row."""

from __future__ import annotations

from itertools import chain
from typing import Any

from ss2sql.runtime.representations.base import Table


def represent(table: Table) -> list[Any]:
    return list(chain.from_iterable(table))
