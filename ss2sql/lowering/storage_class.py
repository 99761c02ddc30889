"""What lowering needs to know of operands: the class of their SQL values, and whether they may be written twice.

SQLite's own operators are right within one class only.
"""

from __future__ import annotations

from sqlglot import exp

from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations.operation import find_sql_class
from ss2sql.lowering.sql_builder import Node

REAL_NUMBER = Kind.INT | Kind.FLOAT


def is_sql_number(kind: Type) -> bool:
    return find_sql_class(kind) == "number"


def have_same_storage_class(left: Type, right: Type, none: bool = False) -> bool:
    known = find_sql_class(left, none)
    return known is not None and known == find_sql_class(right, none)


INTEGRAL = Kind.BOOL | Kind.INT
MAX_REPEATED_NODES = (
    12  # what is written twice must not be longer: two columns and a literal with operators between them
)

_PLAIN = (exp.Column, exp.Identifier, exp.Literal, exp.Placeholder, exp.Paren, exp.Neg, exp.Add, exp.Sub, exp.Mul)


def can_repeat(node: Node, most: int = MAX_REPEATED_NODES) -> bool:
    """Whether an operand is so short that it may stand several times in the text, and so quick to compute."""
    parts = list(node.walk())
    return len(parts) <= most and all(isinstance(part, _PLAIN) for part in parts)
