"""The built-in functions, each with an example whose value is computed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO

from writing import table

import ss2sql
from ss2sql.language.operations import (
    OPERATIONS,
    OPERATOR_FUNCTIONS,
    Operation,
    aggregates,
    generic,
    lists,
    numbers,
    strings,
)

GROUPS = {
    "operators": [row for name, row in OPERATIONS.items() if name in OPERATOR_FUNCTIONS],
    "lists": [row for row in lists.OPERATIONS if row.name not in OPERATOR_FUNCTIONS and not row.group],
    "aggregates": [row for row in (*lists.OPERATIONS, *aggregates.OPERATIONS) if row.group or row.collects],
    "numbers": numbers.OPERATIONS,
    "text": [row for row in strings.OPERATIONS if row.name not in OPERATOR_FUNCTIONS],
    "anything": generic.GENERIC,
    "dates": generic.DATES,
    "session": generic.SPECIAL_FORMS,
}


def functions(group: str) -> str:
    """The built-in functions of a group: how they are called, what they do, an example."""
    return table("function | meaning | example | result", map(_function, GROUPS[group]))


def _function(row: Operation) -> Iterator[str]:
    yield f"`{row.name}`"
    yield row.about.replace("*", "\\*")
    yield f"`{row.example}`" if row.example else ""
    yield f"`{_value(row.example)}`" if row.example else ""


def _value(script: str) -> str:
    with ss2sql.connect() as session, redirect_stdout(StringIO()):
        return repr(session.eval(f"{script};"))
