"""Which functions a statement of SQL calls."""

from __future__ import annotations

import re

from ss2sql.lowering.sql_names import SQLITE_FUNCTIONS

WORDS = {"from", "in", "as", "when", "then", "else", "and", "or", "not", "where", "over", "select", "by", "cast"}


def python_calls(text: str) -> set[str]:
    """The functions that a statement calls and SQLite does not have; sources that walk lists apart."""
    without_strings = re.sub(r"'(?:[^']|'')*'", "''", text)
    called = {name.lower() for name in re.findall(r'(\w+)"?\(', without_strings)}
    return {name for name in called - SQLITE_FUNCTIONS - WORDS if not name.startswith("elements")}
