"""Which classes of SQL values a type stands for: SQLite's own operators are right within one class only."""

from __future__ import annotations

from ss2sql.kinds import Kind, Type

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
