"""Columns of DuckDB as columns of the language: their types, and their values as SQL where it has them exactly.

The types are read from the data, as those of tables of SQLite are.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import sqlglot
from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, Type
from ss2sql.language.operations.intervals import MAX, widen_bounds
from ss2sql.lowering.portable.pushdown import quote_identifier
from ss2sql.lowering.portable.sql_types import write_cast
from ss2sql.vtables.frames.cell_values import convert_frame_cell

_INTEGERS = ("TINYINT", "SMALLINT", "INTEGER", "UTINYINT", "USMALLINT", "UINTEGER")
_LARGE = ("UBIGINT", "HUGEINT", "UHUGEINT")
_TIMES = ("DATE", "TIME", "TIMESTAMP")
# Times as texts in ISO 8601, by the type; `{0}` stands for the column. Years before 1 and after 9999 look otherwise.
_SQL_FORMS = {
    "DATE": "CAST({0} AS VARCHAR)",
    "TIMESTAMP": """
        CASE
          WHEN MICROSECOND({0}) % 1000000 = 0 THEN STRFTIME({0}, '%Y-%m-%dT%H:%M:%S')
          ELSE STRFTIME({0}, '%Y-%m-%dT%H:%M:%S.%f')
        END
    """,
}
_IN_RANGE = "MIN({0}) >= '0001-01-01' AND MAX({0}) < '9999-12-31'"
# What Arrow gives as something else: a time without its zone, bits and large numbers as bytes.
_UNSUPPORTED = ("TIME WITH TIME ZONE", "BIT", "BIGNUM", "VARINT")
_DECIMAL = re.compile(r"DECIMAL\((\d+),(\d+)\)\Z")
_EXACT_DIGITS = 15  # of a decimal: dividing by a power of ten then rounds once


@dataclass(frozen=True, slots=True)
class DuckColumn:
    """A column of a table of DuckDB, by its name and its type there."""

    name: str
    kind: str

    @property
    def plain(self) -> exp.Column:
        return exp.Column(this=quote_identifier(self.name))

    @property
    def decimals(self) -> tuple[int, int] | None:
        """Digits of a decimal, and how many of them stand behind the point."""
        match = _DECIMAL.match(self.kind)
        return None if match is None else (int(match[1]), int(match[2]))

    @property
    def holds(self) -> Kind | None:
        """The kind of its values; None where that shows in the values alone."""
        if self.strange:
            return None
        if self.kind in (*_INTEGERS, "BIGINT", *_LARGE):
            return Kind.INT
        if self.decimals is not None:
            return Kind.FLOAT if self.decimals[1] else Kind.INT
        if self.kind in ("DOUBLE", "FLOAT"):
            return Kind.FLOAT
        if self.kind == "VARCHAR" or self.kind.startswith(("ENUM(", *_TIMES)):
            return Kind.STR if "[" not in self.kind else None
        return Kind.BOOL if self.kind == "BOOLEAN" else None

    @property
    def strange(self) -> bool:
        """Whether the language has no values for it."""
        return self.kind in _UNSUPPORTED

    @property
    def has_nan(self) -> bool:
        return self.kind in ("DOUBLE", "FLOAT")

    def write_questions(self) -> Iterator[exp.Expr]:
        """What is computed over all rows: how many have a value, the ends of numbers, how many are no numbers."""
        if self.holds is None:
            return
        yield exp.Count(this=self.plain)
        if self.kind in _SQL_FORMS:
            yield self._parse_expression(_IN_RANGE)
        if self.holds in Kind.INT | Kind.FLOAT:
            ends: list[exp.Expr] = [exp.Min(this=self.plain), exp.Max(this=self.plain)]
            if self.has_nan:
                number = exp.Where(this=exp.Not(this=exp.IsNan(this=self.plain)))
                yield exp.CountIf(this=exp.IsNan(this=self.plain))
                ends = [exp.Filter(this=end, expression=number.copy()) for end in ends]
            yield from ends

    def interpret_answers(self, rows: int, answers: Iterator[Any], collated: bool) -> ColumnFacts:
        """What the answers say of the column in a table of so many rows."""
        kind = self.holds
        if kind is None:
            return ColumnFacts(Type(), None)
        present = next(answers)
        nan = (next(answers) or 0) if self.has_nan else 0
        missing = Kind.NONE if present - nan < rows else Kind(0)
        if kind is Kind.STR:
            usual = self.kind not in _SQL_FORMS or next(answers) is not False
            return ColumnFacts(Type(kind | missing), self._write_text(collated) if usual else None)
        if kind is Kind.BOOL:
            return ColumnFacts(Type(kind | missing, 0, 1), self.plain)
        low, high = (convert_frame_cell(next(answers)) for _ in range(2))
        if low is None:
            return ColumnFacts(Type(kind | missing), self._write_number(nan))
        least, greatest = (INT_MIN, INT_MAX) if kind is Kind.INT else (-MAX, MAX)
        if not least <= low <= high <= greatest:
            return ColumnFacts(Type(), None, refused=True)
        return ColumnFacts(widen_bounds(kind | missing, low, high), self._write_number(nan))

    def _write_text(self, collated: bool) -> exp.Expr | None:
        if self.kind.startswith(_TIMES):
            return self._parse_expression(_SQL_FORMS[self.kind]) if self.kind in _SQL_FORMS else None
        text = self.plain if self.kind == "VARCHAR" else write_cast(self.plain, "VARCHAR")
        return exp.Collate(this=text, expression=exp.Var(this="C")) if collated else text

    def _parse_expression(self, text: str) -> exp.Expr:
        tree = sqlglot.parse_one(text.format("placeholder"), read="duckdb")
        for column in tree.find_all(exp.Column):
            column.set("this", quote_identifier(self.name))
        return tree

    def _write_number(self, nan: int) -> exp.Expr | None:
        if self.decimals is not None and self.decimals[1] and self.decimals[0] > _EXACT_DIGITS:
            return None
        wide = "BIGINT" if self.holds is Kind.INT else "DOUBLE"
        number = self.plain if self.kind == wide else write_cast(self.plain, wide)
        if not nan:
            return number
        return exp.Anonymous(this="NULLIF", expressions=[number, write_cast(exp.Literal.string("NaN"), "DOUBLE")])


@dataclass(frozen=True, slots=True)
class ColumnFacts:
    """What is known of a column: its type, its values as SQL, and whether a value is none of the language."""

    type: Type
    sql: exp.Expr | None
    refused: bool = False
