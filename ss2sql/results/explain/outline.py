"""Outlines: what a result keeps of its compiled queries, so that it can be explained later.

A compiled query is replaced when its assumptions change, so an outline has its parts as they were in this run.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Protocol

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering.sql_query import Sql, SqlQuery, join_sql

if TYPE_CHECKING:
    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.runtime.external.duckdb_query import DuckQuery
    from ss2sql.runtime.external.level_query import LevelQuery
    from ss2sql.runtime.external.predicate_pushdown import PredicatePushdown
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy
    from ss2sql.runtime.sqlite.executor import Database


class OutlineOwner(Protocol):
    """The session of a query, as an explanation sees it: rewrites that are off, functions, cached graphs, SQLite."""

    @property
    def disabled(self) -> Collection[str]: ...

    @property
    def functions(self) -> Mapping[str, UserFunction]: ...

    @property
    def database(self) -> Database: ...

    @property
    def graphs(self) -> CachePolicy | None: ...


@dataclass(frozen=True, slots=True)
class OutlinedQuery:
    """One query: as written and after the rewrites, and how it runs."""

    host: OutlineOwner
    written: plan.Query
    query: plan.Query
    engine: str
    lowered: SqlQuery | None  # SQLite's statement, else `reason` and `cures`
    levels: LevelQuery | None  # a search by levels in another database
    duck: DuckQuery | None  # another query in DuckDB
    reason: str
    cures: tuple[str, ...]
    rewrites: tuple[str, ...]
    tell: Callable[[], Sql]  # makes `sql`
    handed: tuple[PredicatePushdown, ...]  # reads in place of tables of DuckDB

    @property
    def sql(self) -> Sql:
        return self.tell()


@dataclass(frozen=True, slots=True)
class OutlinedStatement:
    """The text of a statement and its queries."""

    text: str
    queries: tuple[OutlinedQuery, ...]

    @property
    def sql(self) -> Sql:
        texts = [query.sql for query in self.queries]
        if len(texts) == 1:
            return texts[0]
        if not texts:
            return Sql(f"-- no query: {' '.join(self.text.split())}")
        return Sql("\n".join(f"{text};" for text in texts), statements=tuple(texts))


def join_outlined_sql(statements: Iterable[OutlinedStatement]) -> Sql:
    """The texts of all statements as one, each with its own parameters in `statements`."""
    return join_sql([statement.sql for statement in statements])
