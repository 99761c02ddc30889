"""Compiled scripts in the SQL of other databases, to be read or to be taken there."""

from __future__ import annotations

from collections.abc import Sequence

from ss2sql.errors import UnsupportedError
from ss2sql.lowering.portable.portable_flat import write_flat
from ss2sql.lowering.sql_builder import SQLITE, Dialect
from ss2sql.lowering.sql_query import Sql
from ss2sql.results.explain.outline import join_outlined_sql
from ss2sql.runtime.external.level_query import LEVEL_STATEMENTS, plan_level_search
from ss2sql.session.compiled_query import CompiledQuery
from ss2sql.session.compiled_script import CompiledStatement, outline_compiled_script


def translate_script(statements: Sequence[CompiledStatement], dialect: Dialect) -> Sql:
    """The script in a dialect: queries as one SELECT each, searches as the statements of one level.

    Raises UnsupportedError where a query could mean something else there.
    """
    if dialect is SQLITE:
        return join_outlined_sql(outline_compiled_script(statements))
    texts = []
    for statement, outlined in zip(statements, outline_compiled_script(statements), strict=True):
        queries = [_translate_query(query, dialect) for query in statement.queries]
        texts.append("\n".join(queries) or outlined.sql)
    return Sql("\n\n".join(texts))


def _translate_query(query: CompiledQuery, dialect: Dialect) -> str:
    if query.query.search is None:
        return f"{dialect.print_tree(write_flat(query.query, query.world.variable))};"
    if dialect.name not in LEVEL_STATEMENTS:
        reason = f"a search needs many statements, and nothing runs them in {dialect.name}"
        raise UnsupportedError("U001", reason, query.query.span, ("--dialect duckdb and --dialect spark print them",))
    return plan_level_search(query.query, dialect.name).sql
