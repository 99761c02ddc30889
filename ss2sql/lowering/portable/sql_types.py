"""Types of typed columns: a value of the language has one where its kind is known."""

from __future__ import annotations

from sqlglot import exp

from ss2sql.errors import Span, UnsupportedError
from ss2sql.language.kinds import Kind, Type

SCALARS = {Kind.INT: "BIGINT", Kind.FLOAT: "DOUBLE", Kind.STR: "VARCHAR", Kind.BOOL: "BOOLEAN"}
MAX_EXACT_INTEGER = 2.0**53  # integers up to here are floats too


def get_column_type(kind: Type) -> str | None:
    """The type of a column for values of this type, None where there is none; such a column may hold NULL for None."""
    plain = kind.kinds & ~Kind.NONE
    if plain in SCALARS:
        return SCALARS[plain]
    if plain == Kind.LIST and kind.item is not None and not kind.item.may_be(Kind.NONE):
        inner = get_column_type(kind.item)
        return None if inner is None or kind.item.may_be(Kind.FLOAT) else f"{inner}[]"
    return None


def is_nullable(kind: Type) -> bool:
    return kind.may_be(Kind.NONE)


def is_integer(kind: Type) -> bool:
    return kind.kinds == Kind.INT and kind.is_bounded(2**63 - 1)


def is_exact_as_float(kind: Type) -> bool:
    """Whether the values are numbers that are the same as floats, whichever of both they are."""
    return kind.kinds == Kind.FLOAT or (kind.kinds == Kind.INT and kind.is_bounded(MAX_EXACT_INTEGER))


def write_cast(node: exp.Expr, kind: str) -> exp.Expr:
    return exp.Cast(this=node, to=exp.DataType.build(kind, dialect="duckdb"))


def cast_literal(node: exp.Expr, kind: str | None) -> exp.Expr:
    """A value as a column of this type, if it has one: literals alone would have the smallest."""
    return node if node.find(exp.Column) or kind in (None, "BOOLEAN") else write_cast(node, kind)


CURE = "leave engine and dialect to ss2sql, or ask for engine='native'"


def build_refusal(reason: str, span: Span, cure: str = CURE) -> UnsupportedError:
    """What is raised where SQL of other databases could mean something else."""
    return UnsupportedError("U001", reason, span, (cure,))
