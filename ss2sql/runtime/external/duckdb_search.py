"""Searches in the tables of DuckDB, level by level; it spills to disk what does not fit into memory.

It finds the results of the breadth-first search that takes one step after the other, in its order. Only what nobody can
notice is different: the clauses of all steps of a level are evaluated, also of those after the last result that is
wanted, and after the first step to their row; so one of these may fail.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import count, groupby
from operator import itemgetter
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS
from ss2sql.lowering.sql_builder import DUCKDB
from ss2sql.runtime.external.duckdb_query import fetch_duckdb_rows
from ss2sql.runtime.external.duckdb_sources import DuckSources
from ss2sql.runtime.external.level_query import DuckLevelStatements
from ss2sql.runtime.external.level_steps import FirstLevels, PythonSteps, SqlSteps, make_level_steps
from ss2sql.runtime.external.table_statements import Value, table_of_rows, translate_duckdb_sql
from ss2sql.runtime.run.run_state import GraphLevel, Run
from ss2sql.runtime.search.search_run import Found, SearchRun

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa  # type: ignore[import-untyped]


ROWS_PER_BLOCK = 10_000  # rows that are read at once
_numbers = count(1)


class DuckEngine:
    """A connection of DuckDB: the user's, or one of its own, which spills to a folder that goes with it."""

    name = "duckdb"

    def __init__(self, session: Any, begun: Sequence[Run]) -> None:
        import duckdb

        if session is not None and not isinstance(session, duckdb.DuckDBPyConnection):
            message = f"the session of engine='duckdb' is a connection of DuckDB, not {type(session).__name__}"
            raise SessionError("S002", message, hints=("give duckdb.connect(), or nothing",))
        self.folder: TemporaryDirectory[str] | None = None
        if session is None:
            self.folder = TemporaryDirectory(prefix="ss2sql-")
            session = duckdb.connect(config={"temp_directory": self.folder.name})
        self.session = session
        self.errors: tuple[type[Exception], ...] = (duckdb.Error,)
        self.sources: DuckSources | None = DuckSources(lambda: self.session.cursor(), self.errors, begun)

    def open_tables(self) -> DuckTables:
        return DuckTables(self.session.cursor())

    def find_results(self, search_run: SearchRun, opened: DuckTables, written: DuckLevelStatements) -> Iterator[Found]:
        assert self.sources is not None
        return DuckSearch(self.sources, search_run, opened, written).find_results()

    def close(self) -> None:
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
        self.idle: list[duckdb.DuckDBPyConnection] = []  # what asks
        ((self.home,),) = connection.execute("SELECT current_database()").fetchall()
        connection.execute(f"ATTACH ':memory:' AS {self.name}")
        connection.execute(f"USE {self.name}")

    def create_table(self, table: str, rows: pa.Table) -> None:
        """Makes a table in the place of one that there was."""
        self._read_block(f"CREATE OR REPLACE TABLE {table} AS", rows)

    def load_rows(self, table: str, rows: pa.Table) -> None:
        self._read_block(f"INSERT INTO {table}", rows)

    def _read_block(self, text: str, rows: pa.Table) -> None:
        self.connection.register("block", rows)
        self.connection.execute(f"{text} SELECT * FROM block")
        self.connection.unregister("block")

    def run_statement(self, text: str, **values: Value) -> None:
        _execute_statement(self.connection, text, values)

    def add_rows(self, text: str, **values: Value) -> int:
        """Runs a statement that adds rows, and counts them."""
        ((added,),) = _execute_statement(self.connection, text, values).fetchall()
        return int(added)

    def read_rows(self, text: str, **values: Value) -> Iterator[tuple[Any, ...]]:
        """The rows of a query, read in blocks; another statement may run meanwhile."""
        if not self.idle:
            self.idle.append(self.connection.cursor())
            self.idle[-1].execute(f"USE {self.name}")
        reading = self.idle.pop()
        found = _execute_statement(reading, text, values)
        while block := found.fetchmany(ROWS_PER_BLOCK):
            yield from block
        self.idle.append(reading)

    def interrupt_statement(self) -> None:
        self.connection.interrupt()

    def close_tables(self) -> None:
        for reading in self.idle:
            reading.close()
        self.connection.execute(f'USE "{self.home}"')
        self.connection.execute(f"DETACH {self.name}")
        self.connection.close()


def _execute_statement(
    connection: duckdb.DuckDBPyConnection, text: str, values: dict[str, Value]
) -> duckdb.DuckDBPyConnection:
    text = translate_duckdb_sql(DUCKDB, text)
    # DuckDB wants no values but those that it names.
    wanted = {name: value for name, value in values.items() if re.search(rf"\${name}\b", text)}
    return connection.execute(text, wanted or None)


# --- going from level to level in DuckDB: steps from the states of a level are tried, then a statement says which sta
TRIES = 2_000  # steps of a level that are SQL but tried in memory: DuckDB takes 5 ms for the smallest one
MAX_LOOKED_UP = 20_000  # elements that a search in memory reads, to look up those of a state
BLOCK = 5_000  # steps that are added to their table at once


class DuckSearch:
    def __init__(
        self, sources: DuckSources, search_run: SearchRun, tables: DuckTables, written: DuckLevelStatements
    ) -> None:
        self.search_run, self.tables, self.written = search_run, tables, written
        self.steps: PythonSteps = make_level_steps(search_run, written, partial(fetch_duckdb_rows, sources))

    def find_results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        beginning = FirstLevels(self.search_run, self._choose_state_limit())
        yield from map(beginning.make_result, beginning.find_goals())
        depth, going = len(beginning.levels), len(beginning.frontier)
        if going:
            steps = self._load_first_levels(beginning)
            del beginning  # the tables have it all
            yield from self._search_levels(depth, steps, going)

    def _choose_state_limit(self) -> float:
        """How many states a level may have that is done in memory."""
        if not isinstance(self.steps, SqlSteps):
            return math.inf
        elements, joined = len(self.steps.elements), self.steps.steps.counted is not None
        return TRIES if joined and elements <= MAX_LOOKED_UP else TRIES // max(elements, 1)

    def _load_first_levels(self, beginning: FirstLevels) -> int:
        """Hands over what the first levels have come to; gives the number of the last step."""
        steps, free = self.steps, bool(self.written.trails)
        rows: list[Sequence[Any]] = [(0, None, None, 0, *steps.make_start_row(), *([[]] if free else ()))]
        first = before = 0  # how many steps were kept before a level, and before the one above
        for depth, level in enumerate(beginning.levels, 1):
            for step, begun in enumerate(level, first + 1):
                parent, nth = divmod(begun.place, MAX_ELEMENTS)
                parent += before if parent else 0
                trail = [steps.collect_trail(beginning.trace_path(begun, depth))] if free else ()
                rows.append((step, parent, nth, depth, *steps.make_table_row(begun), *trail))
            first, before = first + len(level), first
        self.tables.create_table("steps", table_of_rows(self.written.columns, rows))
        if isinstance(steps, SqlSteps):
            self.tables.create_table("elements", steps.elements)
        return first

    def _search_levels(self, depth: int, steps: int, going: int) -> Iterator[Found]:
        """The results after that level and step, where so many states of the level are to be expanded."""
        search_run, tables, written = self.search_run, self.tables, self.written
        while going:
            depth += 1
            generated = search_run.stats.generated
            if isinstance(self.steps, SqlSteps):
                self.steps.count_tries(going, self._count_chosen_elements(depth))
            else:
                self._expand_level(depth)
            kept = tables.add_rows(written.kept, before=steps, depth=depth, **self.steps.values)
            steps += kept
            search_run.stats.levels.append(GraphLevel(kept, kept, search_run.stats.generated - generated - kept))
            search_run.check()
            ((goals, going),) = tables.read_rows(written.counts, depth=depth)
            if goals:
                yield from self._read_goals(depth)

    def _count_chosen_elements(self, depth: int) -> int | None:
        """How many elements the states of a level have where FROM chooses them; None where each has all of them."""
        counted = self.steps.steps.counted
        if counted is None:
            return None
        ((matched,),) = self.tables.read_rows(counted, depth=depth, **self.steps.values)
        return int(matched)

    def _expand_level(self, depth: int) -> None:
        """Adds the steps from all states of a level to `tries`."""
        tables, written, after = self.tables, self.written, -1
        tables.create_table("tries", table_of_rows(written.tries, ()))
        block: list[Any] = []
        while page := list(tables.read_rows(written.page, depth=depth, after=after)):
            for after, state in page:
                block += self.steps.evaluation.evaluate_steps(after, state)
                if len(block) >= BLOCK:
                    tables.load_rows("tries", table_of_rows(written.tries, block))
                    block.clear()
        tables.load_rows("tries", table_of_rows(written.tries, block))
        self.search_run.flush()

    def _read_goals(self, depth: int) -> Iterator[Found]:
        self.tables.run_statement(self.written.backpointers, depth=depth)
        for _, rows in groupby(self.tables.read_rows(self.written.paths), itemgetter(0)):
            path = [row[1:] for row in rows]
            (nth, *shown), before = path[-1], path[-2][1:] if len(path) > 1 else None
            yield [self.steps.read_row(values) for _, *values in path], self.steps.read_last_part(nth, shown, before)
