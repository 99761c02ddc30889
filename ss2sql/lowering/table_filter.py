"""What SQLite leaves out while it reads a table for the Python engine, which tests all of WHERE by itself.

    SELECT sqrt(x) FROM t WHERE id == n AND near(y);
    SELECT "id", "x", "y" FROM "main"."t" AS t WHERE t.id = :n ORDER BY "rowid"

These are rows that a part of WHERE drops that SQLite evaluates without Python. It may find the others by an index.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering import sql_builder
from ss2sql.lowering.flat import FlatLowering
from ss2sql.lowering.from_clause import lower_sources
from ss2sql.lowering.sql_builder import SQLITE
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS, Parameter, can_be_literal
from ss2sql.lowering.sqlite_expressions import SqlScope
from ss2sql.lowering.sqlite_forms import strip_numeric_affinity
from ss2sql.lowering.statement_needs import StatementNeeds

PLAIN = (int, float, str, type(None))


@dataclass(frozen=True, slots=True)
class TableFilter:
    """What comes after the table in FROM, and before its order; what is bound in it; how many rows are enough."""

    text: str
    parameters: tuple[Parameter, ...] = ()
    limit: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)

    def bind_values(self, values: Sequence[Any]) -> TableFilter | None:
        """The filter with values of its parameters; None where one is neither a number nor a string in SQLite."""
        encoded = {}
        for parameter, value in zip(self.parameters, values, strict=True):
            plain = encoded[parameter.name] = int(value) if parameter.flag else parameter.encode_value(value)
            if type(plain) not in PLAIN or (type(plain) is str and not can_be_literal(plain)):
                return None
        return replace(self, values=encoded)


def lower_table_filter(source: plan.TableSource, parts: Sequence[plan.Expr], enough: int | None) -> TableFilter | None:
    """The filter of a table, if there is anything to leave out.

    The `parts` of WHERE cannot fail and read nothing else of a row. No more than `enough` rows that meet all are read.
    """
    needs = StatementNeeds({})
    selects = FlatLowering(needs)
    opened, scope = lower_sources(selects, (source,), SqlScope())
    lowered = [selects.expressions.lower_condition(part, scope) for part in parts]
    terms = [term for term in lowered if _can_stand_alone(term, needs)]
    where = sql_builder.conjunction(terms)
    if where is not None:
        strip_numeric_affinity(where, (source,))
    limit = enough if len(terms) == len(parts) else None
    if where is None:
        return None if limit is None else TableFilter("", limit=limit)
    label = sql_builder.identifier(opened[0].items[0].alias_or_name).sql("sqlite")
    text = f" AS {label} WHERE {SQLITE.print_tree(where)}"
    return TableFilter(text, tuple(_list_sql_values(where, needs)), limit)


def _can_stand_alone(term: sql_builder.Node, needs: StatementNeeds) -> bool:
    """Whether SQLite needs nothing of Python but values that are known beforehand."""
    own = all(call.name.lower() in SQLITE_FUNCTIONS for call in term.find_all(exp.Anonymous))
    return own and all(isinstance(one.expr, (plan.Constant, plan.Variable)) for one in _list_sql_values(term, needs))


def _list_sql_values(node: sql_builder.Node, needs: StatementNeeds) -> list[Parameter]:
    bound = {placeholder.name for placeholder in node.find_all(exp.Placeholder)}
    return [parameter for name, parameter in needs.parameters.items() if name in bound]
