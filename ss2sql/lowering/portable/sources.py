"""What stands in FROM: tables of the same name, lists written out row by row, and what the database is given.

A source is sorted by its `places`, because SQL promises no order of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeAlias

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.lowering import sql
from ss2sql.lowering.portable.expressions import Node, Portable, Read, constant
from ss2sql.lowering.portable.names import Names
from ss2sql.lowering.portable.types import cast, column_type, is_nullable, refused
from ss2sql.records import dataclass
from ss2sql.walk import sources_read

MOST_ROWS = 1_000  # of a list that are written out
NUMBER = "nth"


@dataclass(frozen=True, slots=True)
class Opened:
    """A source: what stands in FROM, what sorts its rows, and how its columns are read."""

    item: Node
    places: tuple[Node, ...]
    read: Read


# Opens a source under a label; raises UnsupportedError.
Opener: TypeAlias = Callable[[plan.Source, str], Opened]


class Elsewhere:
    """Sources for a database that is not here: its tables have the names of SQLite's, lists are written out."""

    def __init__(self, query: plan.Query, portable: Portable) -> None:
        self.query, self.portable = query, portable

    def open(self, source: plan.Source, label: str) -> Opened:
        match source:
            case plan.TableSource(table=table):
                places = tuple(sql.column(name, label) for name in self._key(source))
                return Opened(sql.table(table, label), places, partial(_column, label))
            case plan.ValueSource():
                return written_out(source, label, self._elements(source))
            case _:
                raise refused("worlds are read by Python", source.span)

    def _key(self, source: plan.TableSource) -> tuple[str, ...]:
        """The columns that sort the rows of a table: its primary key."""
        keys = (columns for columns, index in source.indexes if not index)
        order = next(keys, ()) if source.order == ("rowid",) else source.order
        nullable = {name for name, kind in source.columns if is_nullable(kind)}
        if not order or nullable.intersection(order):
            if self.query.order or self._is_one_group:
                return ()
            reason = f"the rows of {source.table} have no order but that of SQLite"
            raise refused(reason, source.span, "give the table a primary key, or sort the rows")
        return order

    @property
    def _is_one_group(self) -> bool:
        """Whether there is one group at the most, whatever the rows are: it needs no order."""
        return self.query.aggregated and not any(map(sources_read, self.query.group))

    def _elements(self, source: plan.ValueSource) -> Iterable[tuple[int, Any]]:
        value = source.value
        if isinstance(value, plan.Variable) and self.portable.variable is not None:
            elements = self.portable.known(value.name, source.span)
        else:
            elements = listed(value)
            if elements is None:
                raise refused("this list is not known before the query runs", source.span)
        if not isinstance(elements, list) or len(elements) > MOST_ROWS:
            raise refused(f"only lists of up to {MOST_ROWS:,} elements are written out", source.span)
        return enumerate(elements)


def listed(value: plan.Expr) -> list[Any] | None:
    """The elements of a list that the script spells out."""
    return value.value if isinstance(value, plan.Constant) and isinstance(value.value, list) else None


def columns_of(source: plan.ValueSource) -> dict[str | None, Type]:
    """The columns of the elements with their types; None is the element itself."""
    return dict(source.columns or ()) if source.element.kinds == Kind.DICT else {None: source.element}


def written_out(source: plan.ValueSource, label: str, elements: Iterable[tuple[int, Any]]) -> Opened:
    """The numbered elements of a list as VALUES."""
    columns = columns_of(source)
    names, found, kinds = Names(), dict[str | None, str](), dict[str, str]()
    for key, kind in columns.items():
        written = column_type(kind)
        if written is None:
            raise refused(f"the kind of {source.name if key is None else key} is not known", source.span)
        found[key] = names.free(source.name if key is None else key, "element")
        kinds[found[key]] = written
    rows = [exp.Tuple(expressions=[sql.number(n), *_row(element, columns, source)]) for n, element in elements]
    alias = exp.TableAlias(this=sql.identifier("listed"), columns=[sql.identifier(n) for n in (NUMBER, *kinds)])
    values = exp.Values(expressions=rows, alias=alias)
    typed = [sql.column(NUMBER), *(sql.alias(cast(sql.column(name), kind), name) for name, kind in kinds.items())]
    select = sql.select(typed, [values])
    if not rows:
        typed = [sql.alias(cast(sql.null(), kind), name) for name, kind in {NUMBER: "BIGINT", **kinds}.items()]
        select = exp.Select(expressions=typed).where(exp.false())
    return Opened(sql.derived(select, label), (sql.column(NUMBER, label),), partial(named, label, found))


def _row(element: Any, columns: dict[str | None, Type], source: plan.ValueSource) -> list[Node]:
    values = [element if key is None else element.get(key) for key in columns]
    return [constant(value, kind, source.value) for value, kind in zip(values, columns.values(), strict=True)]


def _column(label: str, expr: plan.Element | plan.Column) -> Node:
    assert isinstance(expr, plan.Column), "a whole row is a dict, which has no type there"
    return sql.column(expr.name, label)


def named(label: str, names: dict[str | None, str], expr: plan.Element | plan.Column) -> Node:
    """A column by its name in SQL."""
    return sql.column(names[expr.name if isinstance(expr, plan.Column) else None], label)
