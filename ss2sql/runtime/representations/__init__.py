"""Representations: what `AS name` makes of rows. One file each; `ALL` is what the session starts with.

A representation is a function of a `Table` and the arguments of AS. Of a search it is asked once per path.
Worlds bring along others of their own: see `World.representations`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.runtime.representations import dicts, lists, plane, prolog, rows, sets, value, void
from ss2sql.runtime.representations.base import Table

ALL: dict[str, Callable[..., Any]] = {
    "dict": dicts.represent,
    "list": lists.represent,
    "rows": rows.represent,
    "value": value.represent,
    "set": sets.represent,
    "void": void.represent,
    "plane": plane.represent,
    "prolog": prolog.represent,
}

__all__ = ["ALL", "Table"]
