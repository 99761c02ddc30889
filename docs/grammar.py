"""The grammar of the language as people read it: EBNF made of ss2sql/frontend/syntax/grammar.lark."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import Any

import lark
from lark import Lark, Token, Tree

from ss2sql.frontend.syntax.parser import GRAMMAR

NOTATION = Path(lark.__file__).parent / "grammars" / "lark.lark"  # lark's own syntax
WIDTH = 96
PARTS = {"script": "Scripts", "condition": "Expressions", "query": "Queries", "option": "Options of CONNECT BY"}


def rules() -> dict[str, Any]:
    """The right sides of all rules, as trees of lark's notation."""
    notation = Lark(NOTATION.read_text("utf-8"), parser="lalr")
    found = notation.parse(GRAMMAR.read_text("utf-8")).children
    return {
        plain(str(rule.children[0])): rule.children[-1]
        for rule in found
        if isinstance(rule, Tree) and rule.data == "rule"
    }


def grammar() -> str:
    """All rules, a part under each heading."""
    lines: list[str] = []
    for name, right in rules().items():
        if name in PARTS:
            lines += ["```", "", f"## {PARTS[name]}", "", "```ebnf"]
        lines += _lines(name, list(_choices(right)))
    return "\n".join([*lines[2:], "```"])


def plain(name: str) -> str:
    """A rule's name without the signs that are about the tree: `?`, `!` and `_`."""
    return name.lstrip("?!_")


def _choices(node: Any) -> Iterator[str]:
    """The alternatives of a rule."""
    if isinstance(node, Tree) and node.data == "expansions":
        yield from (_text(child) for child in node.children)
    else:
        yield _text(node)


def _lines(name: str, choices: list[str]) -> Iterator[str]:
    whole = f"{name} = {' | '.join(choices)} ;"
    if len(whole) <= WIDTH:
        yield whole
        return
    sign = "="
    for choice in choices:
        head, *rest = wrap(choice, WIDTH - 8, break_long_words=False)
        yield f"{name if sign == '=' else ''}{'' if sign == '=' else '   '} {sign} {head}"
        yield from (f"        {line}" for line in rest)
        sign = "|"
    yield "    ;"


def _text(node: Any) -> str:
    """A part of a rule. `x?` is written [ x ], `x*` { x }, and `x+` x { x }."""
    if isinstance(node, Token):
        text = str(node)
        return text.removesuffix("i") if text.startswith('"') else plain(text)
    parts = [child for child in node.children if child is not None]
    match node.data:
        case "alias":  # the name of the builder's method is left out
            return _text(node.children[0])
        case "expansions":
            return " | ".join(map(_text, parts))
        case "expansion":
            return " ".join(_grouped(part) for part in parts)
        case "expr" if len(parts) == 1:
            return _text(parts[0])
        case "expr":
            inner = _text(parts[0])
            return {"?": f"[ {inner} ]", "*": f"{{ {inner} }}", "+": f"{inner} {{ {inner} }}"}[str(parts[1])]
        case "name" | "literal":
            return _text(parts[0])
    raise ValueError(f"grammar.lark uses what this page has no notation for: {node.data}")


def _grouped(node: Any) -> str:
    """The part in parentheses, where it is a choice among others."""
    inner = node
    while isinstance(inner, Tree) and inner.data in ("expr", "alias") and len(_present(inner)) == 1:
        inner = _present(inner)[0]
    choice = isinstance(inner, Tree) and inner.data == "expansions" and len(inner.children) > 1
    return f"( {_text(node)} )" if choice else _text(node)


def _present(node: Tree[Any]) -> list[Any]:
    return [child for child in node.children if child is not None]
