"""Python text as syntax trees at a place of the script; names and copies of such trees."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, TypeVar

from ss2sql.runtime.python.ast_builder import AstBuilder

T = TypeVar("T")
POSITION_FIELDS = ("lineno", "end_lineno", "col_offset", "end_col_offset")

# What the words of a text stand for: an expression, or statements where the word stands alone on its line.
Substitutions = Mapping[str, ast.expr | list[ast.stmt]]


def write_template(text: str, build: AstBuilder, words: Substitutions) -> list[ast.stmt]:
    """The statements of a text, each word in it replaced by what it stands for.

    >>> build = AstBuilder((1, 1, 0, 0))
    >>> words = {"KEY": build.name("row"), "DROP": [build.continue_loop()]}
    >>> code = write_template("if KEY in closed:\\n    DROP", build, words)
    >>> print(ast.unparse(code[0]))
    if row in closed:
        continue
    """

    def fill_node(node: Any) -> Any:
        match node:
            case ast.Name(id=word, ctx=context) if word in words:
                meant = words[word]
                return ast.Name(meant.id, context, **build.at) if isinstance(meant, ast.Name) else meant
            case ast.AST():
                fields = {name: fill_node(value) for name, value in ast.iter_fields(node)}
                return type(node)(**fields, **(build.at if "lineno" in node._attributes else {}))
            case list():
                return [one for part in node for one in fill_parts(part)]
        return node

    def fill_parts(part: Any) -> list[Any]:
        if isinstance(part, ast.Expr) and isinstance(part.value, ast.Name):
            meant = words.get(part.value.id)
            if isinstance(meant, list):
                return meant
        return [fill_node(part)]

    return fill_node(_parse_template(text))  # type: ignore[no-any-return]


@cache
def _parse_template(text: str) -> list[ast.stmt]:
    return ast.parse(text).body


def strip_positions(code: list[ast.stmt]) -> list[ast.stmt]:
    """The statements without their places, which mean nothing in a script; `set_positions` gives them others."""
    for node in (node for part in code for node in ast.walk(part)):
        for word in POSITION_FIELDS:
            if hasattr(node, word):
                delattr(node, word)
    return code


def set_positions(tree: ast.AST, at: Mapping[str, int]) -> None:
    for node in ast.walk(tree):
        if "lineno" in node._attributes and not hasattr(node, "lineno"):
            for word, value in at.items():
                setattr(node, word, value)


def copy_tree(node: T) -> T:
    """A copy of syntax trees: `copy.deepcopy` takes four times as long.

    Fields and places alone: who shows tracebacks, as IPython does, notes the parents of nodes in them, and all trees
    share their `Load`.
    """
    if isinstance(node, list):
        return [copy_tree(part) for part in node]  # type: ignore[return-value]
    if not isinstance(node, ast.AST):
        return node
    made: Any = type(node).__new__(type(node))
    fields = node.__dict__
    made.__dict__.update({name: copy_tree(fields[name]) for name in node._fields if name in fields})
    made.__dict__.update({name: fields[name] for name in node._attributes if name in fields})
    return made  # type: ignore[no-any-return]


def list_names_read(code: Iterable[ast.AST]) -> set[str]:
    """The names that are read, in functions further in, too."""
    return {node.id for node in _iterate_names(code) if isinstance(node.ctx, ast.Load)}


def list_names_set(code: Iterable[ast.AST]) -> list[str]:
    """The names that are set, once for each time."""
    return [node.id for node in _iterate_names(code) if isinstance(node.ctx, ast.Store)]


def _iterate_names(code: Iterable[ast.AST]) -> Iterable[ast.Name]:
    return (node for part in code for node in ast.walk(part) if isinstance(node, ast.Name))
