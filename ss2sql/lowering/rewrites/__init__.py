"""Rewrites of the plan, each with a name by which `connect(disable=[...])` switches it off.

A rewrite takes a query and gives one with the same result and the same effects. `optimise` applies them in the order of
the registry, for both engines; rewrite_context is what they share. Some are about SQL alone, and lowering applies them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.lowering.rewrites.constant_folding import fold_constants
from ss2sql.lowering.rewrites.distance_ranges import limit_distances
from ss2sql.lowering.rewrites.inline_functions import inline_functions, read_keys_as_columns, read_lists_as_rows
from ss2sql.lowering.rewrites.normalize_conditions import normalize_conditions
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext
from ss2sql.lowering.rewrites.unnest_subqueries import search_for_members, unnest_subqueries


@dataclass(frozen=True, slots=True)
class Rewrite:
    """The `purpose` of a rewrite and what it has `done` to a query, both in words, and the function that applies it.

    A query without a node that it `looks_for` has nothing for it. Where there is no function lowering applies it, and
    reads the switch.
    """

    purpose: str
    done: str
    apply: Callable[[plan.Query, RewriteContext], plan.Query] | None = None
    looks_for: Callable[[Any], bool] = lambda node: False


REWRITES: dict[str, Rewrite] = {
    "inline": Rewrite(
        "puts the expression that a function returns in the place of its call",
        "calls of Python functions became the expressions that they compute",
        inline_functions,
        lambda node: isinstance(node, plan.Call) and node.function.body is not None,
    ),
    "columns": Rewrite(
        'reads this["a"] of rows that have it as the column a',
        "keys of rows are read as columns",
        read_keys_as_columns,
        lambda node: isinstance(node, plan.Call) and node.function.name == "item",
    ),
    "fold": Rewrite(
        "computes what is made of constants before the query runs",
        "what is made of constants alone was computed beforehand",
        fold_constants,
        lambda node: isinstance(node, plan.Call | plan.Constant | plan.MakeList),
    ),
    "unnest": Rewrite(
        "makes conditions of a nested query over a known list, and reads constant texts for eval",
        "a nested query over a list that is known became plain conditions",
        unnest_subqueries,
        lambda node: isinstance(node, plan.Subquery | plan.Eval),
    ),
    "exists": Rewrite(
        "asks of x IN (SELECT ...) whether a row equals x, where the query reads the row around it",
        "membership in what a query finds for a row is looked up",
        search_for_members,
        lambda node: isinstance(node, plan.Subquery),
    ),
    "split": Rewrite(
        "flattens AND and OR, moves NOT inwards, drops repeated parts, compares lists item by item",
        "conditions were taken apart, so that each is evaluated as early as possible",
        normalize_conditions,
        lambda node: isinstance(node, plan.And | plan.Or | plan.Not | plan.MakeList),
    ),
    "rows": Rewrite(
        "reads a query in FROM that gives a list of one column as rows",
        "rows of a query in FROM are joined, not collected in a list",
        read_lists_as_rows,
        lambda node: isinstance(node, plan.QuerySource),
    ),
    "near": Rewrite(
        "looks up only the box around a point where distance(a, b) <= 1, or the times where abs(a.t - b.t) <= 1",
        "a distance became ranges of coordinates, in which elements are looked up",
        limit_distances,
        lambda node: (
            isinstance(node, plan.WorldSource)
            or (isinstance(node, plan.Call) and node.function.name in {"abs", "distance", "sub"})
        ),
    ),
    "none": Rewrite(
        "has SQLite compute x + 1 by itself after x != None",
        "what was found not to be None is computed by SQLite",
    ),
    "early": Rewrite(
        "evaluates conditions that can fail as soon as their sources are bound",
        "conditions that can fail are evaluated as soon as their sources are known",
    ),
    "hoist": Rewrite(
        "computes a call or nested query once for the sources that it depends on",
        "calls that depend on the first sources alone are made once for each of their rows",
    ),
    "arms": Rewrite(
        "gives each item of the list that a search goes over a SELECT of its own",
        "each item of a list has a SELECT of its own",
    ),
    "calls": Rewrite(
        "calls a function that several clauses of a search share once for each step",
        "a call that every step makes is a column of the list that the step comes from",
    ),
    "lookup": Rewrite(
        "looks up the rows of a list that must equal something, and those that a step of a search can go to",
        "what rows must equal is looked up, not found by trying all",
    ),
    "positions": Rewrite(
        "reads this[0] of short lists as a column of their source", "elements of short lists are read as columns"
    ),
    "cells": Rewrite(
        "finds grid[y][x], and [x, y] IN points, by its place in a BLOB",
        "indexes into lists of numbers became places in a block of bytes",
    ),
    "late": Rewrite(
        "has SQLite find the keys of a world's elements, and reads what is shown of them afterwards",
        "SQLite finds keys of a world alone; the columns that are shown are read of these",
    ),
}


def optimise(
    query: plan.Query, disabled: Collection[str] = (), world: RewriteContext | None = None
) -> tuple[plan.Query, tuple[str, ...]]:
    """The query after all rewrites that are not disabled, in the order of the registry, and their names."""
    world = world or RewriteContext()
    changed: list[str] = []
    nodes = list(walk(query))
    for name, rewrite in REWRITES.items():
        if rewrite.apply is None or name in disabled or not any(map(rewrite.looks_for, nodes)):
            continue
        before, query = query, rewrite.apply(query, world)
        if query is not before:
            changed.append(name)
            nodes = list(walk(query))
    return query, tuple(changed)
