"""What stands in FROM, in the plan: tables, values, queries and worlds."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Type

if TYPE_CHECKING:
    from ss2sql.language import plan


@dataclass(frozen=True, slots=True)
class TableSource:
    """A table or view of the database. `order` names what sorts it: `rowid`, primary key columns, or nothing (a view).

    `collated`: columns that SQLite would not compare byte by byte. `indexes`: (columns, index), "" for the primary key.
    """

    id: int
    name: str
    schema: str
    table: str
    columns: tuple[tuple[str, Type], ...]
    order: tuple[str, ...]
    collated: tuple[str, ...] = ()
    indexes: tuple[tuple[tuple[str, ...], str], ...] = ()
    indexed: bool = False  # SQLite may find its rows in another order
    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class ValueSource:
    """The elements of a value, which may mention earlier sources, the search's state and outer queries.

    `columns` is None where they are known only at run time. `lateral`: as written it reads an earlier source or the
    state, so it is evaluated again for each; rewrites may have removed the dependency since.
    """

    id: int
    name: str
    value: plan.Expr
    element: Type
    columns: tuple[tuple[str, Type], ...] | None
    lateral: bool = False
    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class QuerySource:
    """A query in FROM: its elements are those of the query's value. `lateral` see ValueSource.

    Where it is `optional` and the query has none, there is one element, None, and so is every column.
    """

    id: int
    name: str
    query: plan.Query
    element: Type
    columns: tuple[tuple[str, Type], ...] | None
    lateral: bool = False
    optional: bool = False
    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class WorldSource:
    """A table of an attached world; the `arguments` of a table function may mention earlier sources and the state.

    `table` is the session's, see vtables/attached_worlds.py.
    """

    id: int
    name: str
    table: Any
    arguments: tuple[plan.Expr, ...]
    element: Type
    columns: tuple[tuple[str, Type], ...]
    span: Span = field(compare=False, repr=False, kw_only=True)


Source: TypeAlias = TableSource | ValueSource | QuerySource | WorldSource
SOURCES = (TableSource, ValueSource, QuerySource, WorldSource)
