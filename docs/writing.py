"""Markdown: tables, and sentences made of docstrings."""

from __future__ import annotations

from collections.abc import Iterable


def table(head: str, rows: Iterable[Iterable[str]], numbers: int = 0) -> str:
    """A table; `head` has the titles of its columns, with bars between them. The last columns may be numbers."""
    texts = head.count("|") + 1 - numbers
    lines = [f"| {head} |", "|" + "---|" * texts + "--:|" * numbers]
    lines += (f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in rows)
    return "\n".join(lines)


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    text = text.rstrip(".")
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def first(text: str) -> str:
    """The first paragraph of a docstring in one line."""
    return " ".join(text.strip().split("\n\n")[0].split())
