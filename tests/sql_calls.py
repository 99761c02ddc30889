"""What SQL that a result shows calls, and gives in another session that has the same functions."""

from __future__ import annotations

import re
from typing import Any

import ss2sql
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS, Sql
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.sqlite.executor import SqliteExecution, _encode_parameter

WORDS = {"from", "in", "as", "when", "then", "else", "and", "or", "not", "where", "over", "select", "by", "cast"}


def python_calls(text: str) -> set[str]:
    """The functions that a statement calls and SQLite does not have; sources that walk lists apart."""
    without_strings = re.sub(r"'(?:[^']|'')*'", "''", text)
    called = {name.lower() for name in re.findall(r'(\w+)"?\(', without_strings)}
    return {name for name in called - SQLITE_FUNCTIONS - WORDS if not name.startswith("elements")}


def run_shown_sql(session: ss2sql.Session, sql: Sql) -> list[tuple[Any, ...]]:
    """The rows of SQL as a result shows it, with the values beside it."""
    database = session.host.prepare_database()
    database.lists.register_modules(sql.modules)
    execution = SqliteExecution(Run(session.host), calls=dict.fromkeys(database.memos, ()))
    with database._push_execution(execution):
        execution.interning.key_all_values()
        database.search.begin_search(execution.interning.keys)
        execution.modules.update(sql.modules)
        values = {name: _encode_parameter(execution.interning, value) for name, value in sql.parameters.items()}
        rows = database.guard.execute_reading(str(sql), values)
        return [tuple(map(execution.interning.decode, row)) for row in rows]
