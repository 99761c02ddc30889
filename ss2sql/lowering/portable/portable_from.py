"""What stands in FROM: tables of the same name, lists written out row by row, and what the database is given.

A source is sorted by its `places`, because SQL promises no order of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeAlias

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import list_sources
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.portable_expressions import ColumnReader, Node, PortableExpressions, write_constant
from ss2sql.lowering.portable.portable_names import ColumnNames
from ss2sql.lowering.portable.sql_types import build_refusal, get_column_type, is_nullable, write_cast

MAX_WRITTEN_ROWS = 1_000  # of a list that are written out
NUMBER_COLUMN = "nth"


@dataclass(frozen=True, slots=True)
class PortableSource:
    """A source: what stands in FROM, what sorts its rows, and how its columns are read."""

    item: Node
    places: tuple[Node, ...]
    read: ColumnReader


# Opens a source under a label; raises UnsupportedError.
OpenSource: TypeAlias = Callable[[plan.Source, str], PortableSource]


class RemoteSources:
    """Sources for a database that is not here: its tables have the names of SQLite's, lists are written out."""

    def __init__(self, query: plan.Query, portable: PortableExpressions) -> None:
        self.query, self.portable = query, portable

    def open_source(self, source: plan.Source, label: str) -> PortableSource:
        match source:
            case plan.TableSource(table=table):
                places = tuple(sql_builder.column(name, label) for name in self._choose_sort_columns(source))
                return PortableSource(sql_builder.table(table, label), places, partial(_write_values_column, label))
            case plan.ValueSource():
                return write_values(source, label, self._list_elements(source))
            case _:
                raise build_refusal("worlds are read by Python", source.span)

    def _choose_sort_columns(self, source: plan.TableSource) -> tuple[str, ...]:
        """The columns that sort the rows of a table: its primary key."""
        keys = (columns for columns, index in source.indexes if not index)
        order = next(keys, ()) if source.order == ("rowid",) else source.order
        nullable = {name for name, kind in source.columns if is_nullable(kind)}
        if not order or nullable.intersection(order):
            if self.query.order or self._is_one_group:
                return ()
            reason = f"the rows of {source.table} have no order but that of SQLite"
            raise build_refusal(reason, source.span, "give the table a primary key, or sort the rows")
        return order

    @property
    def _is_one_group(self) -> bool:
        """Whether there is one group at the most, whatever the rows are: it needs no order."""
        return self.query.aggregated and not any(map(list_sources, self.query.group))

    def _list_elements(self, source: plan.ValueSource) -> Iterable[tuple[int, Any]]:
        value = source.value
        if isinstance(value, plan.Variable) and self.portable.variable is not None:
            elements = self.portable.get_constant(value.name, source.span)
        else:
            elements = get_literal_elements(value)
            if elements is None:
                raise build_refusal("this list is not known before the query runs", source.span)
        if not isinstance(elements, list) or len(elements) > MAX_WRITTEN_ROWS:
            raise build_refusal(f"only lists of up to {MAX_WRITTEN_ROWS:,} elements are written out", source.span)
        return enumerate(elements)


def get_literal_elements(value: plan.Expr) -> list[Any] | None:
    """The elements of a list that the script spells out."""
    return value.value if isinstance(value, plan.Constant) and isinstance(value.value, list) else None


def get_element_columns(source: plan.ValueSource) -> dict[str | None, Type]:
    """The columns of the elements with their types; None is the element itself."""
    return dict(source.columns or ()) if source.element.kinds == Kind.DICT else {None: source.element}


def write_values(source: plan.ValueSource, label: str, elements: Iterable[tuple[int, Any]]) -> PortableSource:
    """The numbered elements of a list as VALUES."""
    columns = get_element_columns(source)
    names, found, kinds = ColumnNames(), dict[str | None, str](), dict[str, str]()
    for key, kind in columns.items():
        written = get_column_type(kind)
        if written is None:
            raise build_refusal(f"the kind of {source.name if key is None else key} is not known", source.span)
        found[key] = names.claim(source.name if key is None else key, "element")
        kinds[found[key]] = written
    rows = [exp.Tuple(expressions=[sql_builder.number(n), *_write_row(e, columns, source)]) for n, e in elements]
    alias = exp.TableAlias(
        this=sql_builder.identifier("listed"), columns=[sql_builder.identifier(n) for n in (NUMBER_COLUMN, *kinds)]
    )
    values = exp.Values(expressions=rows, alias=alias)
    typed = [
        sql_builder.column(NUMBER_COLUMN),
        *(sql_builder.alias(write_cast(sql_builder.column(name), kind), name) for name, kind in kinds.items()),
    ]
    select = sql_builder.select(typed, [values])
    if not rows:
        typed = [
            sql_builder.alias(write_cast(sql_builder.null(), kind), name)
            for name, kind in {NUMBER_COLUMN: "BIGINT", **kinds}.items()
        ]
        select = exp.Select(expressions=typed).where(exp.false())
    return PortableSource(
        sql_builder.derived(select, label),
        (sql_builder.column(NUMBER_COLUMN, label),),
        partial(build_named_column, label, found),
    )


def _write_row(element: Any, columns: dict[str | None, Type], source: plan.ValueSource) -> list[Node]:
    values = [element if key is None else element.get(key) for key in columns]
    return [write_constant(value, kind, source.value) for value, kind in zip(values, columns.values(), strict=True)]


def _write_values_column(label: str, expr: plan.Element | plan.Column) -> Node:
    assert isinstance(expr, plan.Column), "a whole row is a dict, which has no type there"
    return sql_builder.column(expr.name, label)


def build_named_column(label: str, names: dict[str | None, str], expr: plan.Element | plan.Column) -> Node:
    """A column by its name in SQL."""
    return sql_builder.column(names[expr.name if isinstance(expr, plan.Column) else None], label)
