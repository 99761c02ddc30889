"""The table of operations: one row for each operator, built-in function and aggregate; row.py says what is in a row.

Read by the resolver (`result`, `can_fail`, `arity`), both engines and other databases (forms), completion, help and
the docs (`call`, `about`, `example`), and tests/test_operations.py, which asks every row for its promises.
"""

from __future__ import annotations

from ss2sql.language.operations import (
    aggregates,
    anything,
    arithmetic,
    comparison,
    dates,
    lists,
    numbers,
    paths,
    session,
    strings,
)
from ss2sql.language.operations.row import Check as Check
from ss2sql.language.operations.row import Form as Form
from ss2sql.language.operations.row import Group as Group
from ss2sql.language.operations.row import Operation as Operation

PAGES = (arithmetic, comparison, lists, aggregates, numbers, strings, anything, dates, session, paths)

OPERATIONS: dict[str, Operation] = {row.name: row for page in PAGES for row in page.OPERATIONS}
WRITTEN = {name: row for name, row in OPERATIONS.items() if " " not in name}  # the others are no names in scripts
GROUPS: dict[str, Group] = {name: row.group for name, row in OPERATIONS.items() if row.group is not None}
GROUPS["collect"] = aggregates.COLLECT
# Those that always give a bool; in SQL they give a flag.
PREDICATES = frozenset(name for name, row in OPERATIONS.items() if row.arity == (2, 2) and row.symbol and row.negated)
OF_OPERATORS = frozenset(name for name, row in OPERATIONS.items() if row.symbol) | {"neg", "item", "slice"}


def checked() -> None:
    """Raises AssertionError for a row that contradicts itself or another one."""
    assert len(OPERATIONS) == sum(len(page.OPERATIONS) for page in PAGES), "two rows have one name"
    for name, row in OPERATIONS.items():
        assert not row.negated or OPERATIONS[row.negated].negated == name
        assert not row.mirrored or OPERATIONS[row.mirrored].mirrored == name


checked()
