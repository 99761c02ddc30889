"""Rewrites of the plan, one per file, each with a name by which `connect(disable=[...])` switches it off.

A rewrite takes a query and gives one with the same rows, the same errors and the same effects. `optimise`
applies all of them, for both executors.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from ss2sql import plan
from ss2sql.lowering.rewrites import unnest

REWRITES: dict[str, Callable[[plan.Query], plan.Query]] = {"unnest": unnest.rewrite}


def optimise(query: plan.Query, disabled: Collection[str] = ()) -> plan.Query:
    """The query after all rewrites that are not disabled."""
    for name, rewrite in REWRITES.items():
        if name not in disabled:
            query = rewrite(query)
    return query
