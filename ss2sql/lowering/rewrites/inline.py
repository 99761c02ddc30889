"""`inline`: a call of a Python function that is one expression of its arguments becomes that expression.

    def cost(a, b): return abs(a - b)          WHERE cost(x, 3) < 2          asks          abs(x - 3) < 2

The function must be immutable. frontend/inline.py reads its body when it is registered, frontend/instances.py says
for each call whether the body does what the call does, frontend/inliner.py what becomes of large numbers.

Over a table of 100,000 rows `WHERE cost(id, 3) < 2` takes 9 ms in SQLite and 160 ms natively; with the calls, all of
different arguments, it takes 690 and 430 ms.
"""

from __future__ import annotations

from typing import Any

from ss2sql import plan
from ss2sql.frontend.inliner import Inliner, Site
from ss2sql.lowering.rewrites.nodes import bottom_up
from ss2sql.lowering.rewrites.world import World
from ss2sql.walk import functions, walk


def rewrite(query: plan.Query, world: World) -> plan.Query:
    """The query with calls of functions replaced by what they compute."""
    return _inlined(query, Inliner())


def sites(query: plan.Query) -> list[Site]:
    """What `rewrite` does with the calls of functions whose bodies are known, in their order."""
    inliner = Inliner()
    _inlined(query, inliner)
    return list(inliner.sites.values())


def _inlined(query: plan.Query, inliner: Inliner) -> plan.Query:
    if all(function.body is None for function in functions(query)):
        return query
    inliner.sources.update((node.id, node) for node in walk(query) if isinstance(node, plan.SOURCES))

    def change(node: Any) -> Any:
        return inliner.call(node) if isinstance(node, plan.Call) and node.function.body is not None else node

    return bottom_up(query, change)
