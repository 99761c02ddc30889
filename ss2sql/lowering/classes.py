"""What lowering asks of operands: the class of their SQL values, and whether they may be written twice.

SQLite's own operators are right within one class only.
"""

from __future__ import annotations

from sqlglot import exp

from ss2sql.kinds import Kind, Type
from ss2sql.lowering.sql import Node

REAL_NUMBER = Kind.INT | Kind.FLOAT
EXACT = 2**53  # integers up to here are exact as floats


def class_of(kind: Type, none: bool = False) -> str | None:
    """`number` or `text` if all values, None apart if allowed, are of that class in SQL.

    Bools are numbers where there is nothing else, for then they travel as flags.
    """
    allowed = Kind.NONE if none else Kind(0)
    if kind.kinds == Kind.BOOL or (kind.only(REAL_NUMBER | allowed) and kind.may(REAL_NUMBER)):
        return "number"
    if kind.only(Kind.STR | allowed) and kind.may(Kind.STR):
        return "text"
    return None


def is_number(kind: Type) -> bool:
    return class_of(kind) == "number"


def same_class(left: Type, right: Type, none: bool = False) -> bool:
    known = class_of(left, none)
    return known is not None and known == class_of(right, none)


WHOLE = Kind.BOOL | Kind.INT
MOST_FACTORS = 4  # of a product that stands for a power
MOST_NODES = 12  # what is written twice must not be longer: two columns and a literal with operators between them

_PLAIN = (exp.Column, exp.Identifier, exp.Literal, exp.Placeholder, exp.Paren, exp.Neg, exp.Add, exp.Sub, exp.Mul)


def may_repeat(node: Node, most: int = MOST_NODES) -> bool:
    """Whether an operand is so short that it may stand several times in the text, and so quick to compute."""
    parts = list(node.walk())
    return len(parts) <= most and all(isinstance(part, _PLAIN) for part in parts)
