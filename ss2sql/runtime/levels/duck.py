"""Searches in the tables of DuckDB, which spills to disk what does not fit into memory."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.dialects import DUCKDB
from ss2sql.runtime.levels.arrow import batch
from ss2sql.runtime.levels.statements import Ask, Create, Statement, Value, printed
from ss2sql.runtime.levels.tables import Row, Tally, try_in_blocks, walked_ways
from ss2sql.runtime.levels.trial import Trial
from ss2sql.runtime.memorize.hunt import Hunt

if TYPE_CHECKING:
    import duckdb

BLOCK = 10_000  # rows that are read at once
_numbers = count(1)


class Duck:
    """A connection of DuckDB: the user's, or one of its own, which spills to a folder that goes with it."""

    def __init__(self, session: duckdb.DuckDBPyConnection | None) -> None:
        self.folder: TemporaryDirectory[str] | None = None
        if session is None:
            import duckdb

            self.folder = TemporaryDirectory(prefix="ss2sql-")
            session = duckdb.connect(config={"temp_directory": self.folder.name})
        self.session = session

    def open(self, hunt: Hunt) -> DuckTables:
        return DuckTables(self.session.cursor())

    def close(self) -> None:
        if self.folder is not None:
            self.session.close()
            self.folder.cleanup()
        del self.session  # what is held at the end of Python DuckDB reports as leaked


class DuckTables:
    """The tables of one run, in a database in memory of their own beside those of the connection."""

    def __init__(self, connection: duckdb.DuckDBPyConnection) -> None:
        self.connection = connection
        self.name = f"ss2sql_{next(_numbers)}"
        self.columns: dict[str, str] = {}  # of the tables that were made empty, with their types
        ((self.home,),) = connection.execute("SELECT current_database()").fetchall()
        connection.execute(f"ATTACH ':memory:' AS {self.name}")
        connection.execute(f"USE {self.name}")

    def run(self, statement: Statement, **values: Value) -> None:
        if isinstance(statement, Create):
            self.columns[statement.table] = statement.columns
        self.connection.execute(*_bound(statement, values))

    def rows(self, question: Ask, **values: Value) -> Iterator[Row]:
        reading = self.connection.cursor()
        try:
            reading.execute(f"USE {self.name}")
            found = reading.execute(*_bound(question, values))
            while block := found.fetchmany(BLOCK):
                yield from block
        finally:
            reading.close()

    def load(self, table: str, columns: Sequence[Sequence[Any]]) -> None:
        import pyarrow as pa  # type: ignore[import-untyped]

        self.connection.register("block", pa.Table.from_batches([batch(self.columns[table], columns)]))
        self.connection.execute(f"INSERT INTO {table} SELECT * FROM block")
        self.connection.unregister("block")

    def try_all(self, trial: Trial, pause: Callable[[], None]) -> Tally:
        return try_in_blocks(self, trial, pause)

    def ways(self) -> Iterator[Row]:
        return walked_ways(self)

    def interrupt(self) -> None:
        self.connection.interrupt()

    def close(self) -> None:
        self.connection.execute(f'USE "{self.home}"')
        self.connection.execute(f"DETACH {self.name}")
        self.connection.close()


def _bound(statement: Statement, values: dict[str, Value]) -> tuple[str, dict[str, Value] | None]:
    """The text of a statement, and the values for it; DuckDB wants no others than it names."""
    text = printed(DUCKDB, statement.text)
    return text, {name: value for name, value in values.items() if re.search(rf"\${name}\b", text)} or None
