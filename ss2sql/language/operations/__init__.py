"""The table of operations: a row for each operator, built-in function and aggregate.

The resolver reads types and arity, both engines and other databases read the forms, completion and documentation the
texts. operation says what a row holds and checks arguments; the rows stand in operators, numbers, strings, lists,
generic and aggregates.
"""

from __future__ import annotations

from ss2sql.language.operations import aggregates, generic, lists, numbers, operators, strings
from ss2sql.language.operations.operation import AggregateOperation as AggregateOperation
from ss2sql.language.operations.operation import Check as Check
from ss2sql.language.operations.operation import Form as Form
from ss2sql.language.operations.operation import Operation as Operation

MODULES = (operators, lists, aggregates, numbers, strings, generic)

OPERATIONS: dict[str, Operation] = {row.name: row for page in MODULES for row in page.OPERATIONS}
WRITTEN = {name: row for name, row in OPERATIONS.items() if " " not in name}  # the others are no names in scripts
GROUPS: dict[str, AggregateOperation] = {name: row.group for name, row in OPERATIONS.items() if row.group is not None}
GROUPS["collect"] = aggregates.COLLECT
# Those that always give a bool; in SQL they give a flag.
PREDICATES = frozenset(name for name, row in OPERATIONS.items() if row.arity == (2, 2) and row.symbol and row.negated)
OPERATOR_FUNCTIONS = frozenset(name for name, row in OPERATIONS.items() if row.symbol) | {"neg", "item", "slice"}
