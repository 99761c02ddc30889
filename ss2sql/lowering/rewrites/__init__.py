"""Rewrites of the plan, one per file, each with a name by which `connect(disable=[...])` switches it off.

A rewrite takes a query and gives one with the same rows, the same errors and the same effects. `optimise`
applies all of them, for both executors; what it may know of the session is in world.py. Some are about SQL
alone, and lowering applies them (levels.py, product.py, lookup.py, positions.py, cells.py); the native executor
always does the same in its way.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TypeAlias

from ss2sql import plan
from ss2sql.lowering.rewrites import fold, inline, near, split, unnest
from ss2sql.lowering.rewrites.world import World

Rewrite: TypeAlias = Callable[[plan.Query, World], plan.Query]


def by_lowering(query: plan.Query, world: World) -> plan.Query:
    """The plan stays as it is: lowering reads the switch."""
    return query


REWRITES: dict[str, Rewrite] = {
    "inline": inline.rewrite,
    "fold": fold.rewrite,
    "unnest": unnest.rewrite,
    "split": split.rewrite,
    "near": near.rewrite,
    "early": by_lowering,
    "hoist": by_lowering,
    "lookup": by_lowering,
    "positions": by_lowering,
    "cells": by_lowering,
    "late": by_lowering,
}


def optimise(
    query: plan.Query, disabled: Collection[str] = (), world: World | None = None
) -> tuple[plan.Query, tuple[str, ...]]:
    """The query after all rewrites that are not disabled, in the order of the registry, and their names."""
    world = world or World()
    changed: list[str] = []
    for name, rewrite in REWRITES.items():
        if name not in disabled:
            before, query = query, rewrite(query, world)
            if query is not before:
                changed.append(name)
    return query, tuple(changed)
