"""Searches in the tables of DuckDB, which spills to disk what does not fit into memory."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import count
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.dialects import DUCKDB
from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.runtime.external.arrow_columns import batch_of_rows
from ss2sql.runtime.external.table_statements import Value, join_names, translate_sql
from ss2sql.runtime.search.search_run import SearchRun

if TYPE_CHECKING:
    import duckdb

ROWS_PER_BLOCK = 10_000  # rows that are read at once
REPLAN_GROWTH = 4  # a plan is made anew for so many times as many steps
_numbers = count(1)


class DuckEngine:
    """A connection of DuckDB: the user's, or one of its own, which spills to a folder that goes with it."""

    def __init__(self, session: duckdb.DuckDBPyConnection | None) -> None:
        self.folder: TemporaryDirectory[str] | None = None
        if session is None:
            import duckdb

            self.folder = TemporaryDirectory(prefix="ss2sql-")
            session = duckdb.connect(config={"temp_directory": self.folder.name})
        self.session = session

    def open_tables(self, search_run: SearchRun) -> DuckTables:
        return DuckTables(self.session.cursor())

    def close_engine(self) -> None:
        if self.folder is not None:
            self.session.close()
            self.folder.cleanup()
        del self.session  # what is held at the end of Python DuckDB reports as leaked


class DuckTables:
    """The tables of one run, in a database in memory of their own beside those of the connection.

    `:name` in a statement stands for a value.
    """

    def __init__(self, connection: duckdb.DuckDBPyConnection) -> None:
        self.connection = connection
        self.name = f"ss2sql_{next(_numbers)}"
        self.writer = _PreparedStatements(connection)
        self.idle: list[_PreparedStatements] = []  # what asks
        ((self.home,),) = connection.execute("SELECT current_database()").fetchall()
        connection.execute(f"ATTACH ':memory:' AS {self.name}")
        connection.execute(f"USE {self.name}")

    def create_table(self, table: str, columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]] = ()) -> None:
        """Makes a table in the place of one that there was."""
        self.connection.execute(translate_sql(DUCKDB, f"CREATE OR REPLACE TABLE {table}({join_names(*columns)})"))
        self.load_rows(table, columns, rows)

    def load_rows(self, table: str, columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]]) -> None:
        """Adds rows to a table."""
        import pyarrow as pa  # type: ignore[import-untyped]

        if rows:
            self.connection.register("block", pa.Table.from_batches([batch_of_rows(columns, rows)]))
            self.connection.execute(f"INSERT INTO {table} SELECT * FROM block")
            self.connection.unregister("block")

    def run_statement(self, text: str, **values: Value) -> None:
        self.writer.execute_statement(text, values, None)

    def add_rows(self, text: str, before: int, **values: Value) -> int:
        """Runs a statement that adds rows, and counts them; `before` says how many there are."""
        ((added,),) = self.writer.execute_statement(text, {"before": before, **values}, before).fetchall()
        return int(added)

    def read_rows(self, text: str, kept: bool = False, **values: Value) -> Iterator[tuple[Any, ...]]:
        """The rows of a query, read in blocks; another statement may run meanwhile. `kept`: its plan is."""
        reading = self.idle.pop() if self.idle else self._get_reader()
        found = reading.execute_statement(text, values, 0 if kept else None)
        while block := found.fetchmany(ROWS_PER_BLOCK):
            yield from block
        self.idle.append(reading)

    def _get_reader(self) -> _PreparedStatements:
        connection = self.connection.cursor()
        connection.execute(f"USE {self.name}")
        return _PreparedStatements(connection)

    def interrupt_statement(self) -> None:
        self.connection.interrupt()

    def close_tables(self) -> None:
        for reading in self.idle:
            reading.connection.close()
        self.connection.execute(f'USE "{self.home}"')
        self.connection.execute(f"DETACH {self.name}")
        self.connection.close()


class _PreparedStatements:
    """A connection that keeps the plans of what is run for every level: to make one takes DuckDB a millisecond."""

    def __init__(self, connection: duckdb.DuckDBPyConnection) -> None:
        self.connection = connection
        self.plans: dict[str, tuple[str, int]] = {}  # by the text: a name, and how many steps there were

    def execute_statement(self, text: str, values: dict[str, Value], steps: int | None) -> duckdb.DuckDBPyConnection:
        """Runs a statement, which has a plan for so many `steps`, or none that is kept."""
        text = translate_sql(DUCKDB, text)
        # DuckDB wants no values but those that it names.
        wanted = {name: value for name, value in values.items() if re.search(rf"\${name}\b", text)}
        if steps is None or not all(type(value) is int for value in wanted.values()):
            return self.connection.execute(text, wanted or None)
        name, before = self.plans.get(text, (f"plan_{len(self.plans)}", -1))
        if before < 0 or steps > REPLAN_GROWTH * before:
            self.connection.execute(f"PREPARE {name} AS {text}")
            self.plans[text] = name, steps
        arguments = ", ".join(f"{label} := {value}" for label, value in wanted.items())
        return self.connection.execute(f"EXECUTE {name}({arguments})")
