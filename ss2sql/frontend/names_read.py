"""Which columns a script may read, by their names alone: before it is resolved, and without a look at any table."""

from __future__ import annotations

from typing import Any

from ss2sql.frontend import ast


def names_read(*trees: ast.Script | ast.Expr) -> frozenset[str] | None:
    """The names in trees that may be columns; None where any column may be read: by `*`, `this` or `eval`."""
    names: set[str] = set()
    waiting: list[Any] = list(trees)
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Star() | ast.This() | ast.Call(function="eval", owner=None):
                return None
            case ast.Name(name=name) | ast.Attribute(name=name):
                names.add(name)
        waiting.extend(ast.children(node))
    return frozenset(names)
