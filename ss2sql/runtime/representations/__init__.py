"""Representations: what `AS name` makes of rows. `ALL` is what a session starts with.

A representation is a function of a `Table` and the arguments of AS. Of a search it is called once per path. Adapters of
worlds declare their own, see `World.representations`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.runtime.representations.as_plane import as_plane
from ss2sql.runtime.representations.rows_as_values import (
    as_dict,
    as_list,
    as_prolog,
    as_rows,
    as_set,
    as_value,
    as_void,
)

ALL: dict[str, Callable[..., Any]] = {
    "dict": as_dict,
    "list": as_list,
    "rows": as_rows,
    "value": as_value,
    "set": as_set,
    "void": as_void,
    "plane": as_plane,
    "prolog": as_prolog,
}
