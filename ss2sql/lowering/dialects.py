"""The SQL dialects that a lowered query can be printed in, one row each."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import sqlglot
from sqlglot import exp
from sqlglot.errors import TokenError
from sqlglot.generator import Generator

from ss2sql.fast_dataclasses import dataclass
from ss2sql.lowering.sql_builder import WithoutAffinity

if TYPE_CHECKING:
    _Base = Generator
else:
    _Base = object

MAX_LINE_WIDTH = 60  # characters in parentheses that stay on their line


class _ShortParentheses(_Base):
    """Printing as sqlglot does it, but for parentheses: it would give each of them a line of its own.

    `OWN` prints nodes that sqlglot does not have.
    """

    OWN: ClassVar[dict[type[exp.Expr], Callable[[Generator, Any], str]]] = {}

    def paren_sql(self, expression: exp.Paren) -> str:
        inside = self.sql(expression, "this")
        if len(inside) <= MAX_LINE_WIDTH and "\n" not in inside:
            return f"({inside})"
        # Not sqlglot's own method: it would print the inside again, and so on within it, 2 ^ depth times.
        return f"({self.seg(self.indent(inside), sep='')}{self.seg(')', sep='')}"


class _Sqlite(_ShortParentheses):
    """What later releases of sqlglot 30 do, for all of them: the text is the same whichever prints it."""

    OWN: ClassVar[dict[type[exp.Expr], Callable[[Generator, Any], str]]] = {
        WithoutAffinity: lambda printer, node: f"+{printer.sql(node, 'this')}"
    }
    SUPPORTS_TABLE_ALIAS_COLUMNS = True  # nothing but a CTE is given any; early ones leave them out

    def nullsafeeq_sql(self, expression: exp.NullSafeEQ) -> str:
        return self.binary(expression, "IS")

    def nullsafeneq_sql(self, expression: exp.NullSafeNEQ) -> str:
        return self.binary(expression, "IS NOT")


@dataclass(frozen=True, slots=True)
class Dialect:
    """A dialect by its name in sqlglot. User names keep their case; lines are indented by two blanks."""

    name: str
    printer_class: type[_ShortParentheses] = _ShortParentheses

    def print_tree(self, tree: exp.Expr) -> str:
        """The SQL tree as text."""
        options: dict[str, Any] = {"pretty": True, "normalize_functions": False}
        try:
            return _build_generator_class(self)(dialect=self.name, **options).generate(tree)
        except TokenError as error:
            if isinstance(error.__cause__, RecursionError):  # sqlglot reads types while it prints
                raise error.__cause__ from None
            raise


@cache
def _build_generator_class(dialect: Dialect) -> type[Generator]:
    """The class that prints a dialect: what sqlglot has for it, printing as the row says."""
    known: type[Generator] = sqlglot.Dialect.get_or_raise(dialect.name).generator_class
    return type(
        "Printer", (dialect.printer_class, known), {"TRANSFORMS": {**known.TRANSFORMS, **dialect.printer_class.OWN}}
    )


SQLITE = Dialect("sqlite", _Sqlite)
DUCKDB = Dialect("duckdb")
SPARK = Dialect("spark")
POSTGRES = Dialect("postgres")

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (SQLITE, DUCKDB, SPARK, POSTGRES)}
