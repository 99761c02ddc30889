"""The scouts of a compiled query, run beside it: in SQL where the query runs in SQL, else natively."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Stopped, UnsupportedError
from ss2sql.language import plan
from ss2sql.lowering.sql_query import SqlQuery
from ss2sql.runtime.python import NativeQuery, compile_statement
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.sqlite.call_sites import Site, sites_of
from ss2sql.runtime.sqlite.coming_arguments import Ahead, Rows
from ss2sql.runtime.sqlite.interning import FALSE, TRUE, OtherFormError

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import Database, StatementExecution

Lower = Callable[[plan.Query], SqlQuery]


class Scouts:
    """Those of one query. `lower` makes SQL of a scout."""

    def __init__(self, query: plan.Query, lower: Lower | None = None) -> None:
        self.sites = sites_of(query)
        self.early = query.limit is not None or (query.search is not None and query.search.maximum is not None)
        self.lower = lower
        self.lowered: dict[Site, SqlQuery | None] = {}
        self.native: dict[Site, NativeQuery] = {}

    def of_run(self, run: Run) -> Ahead:
        """What is coming in a run of the query on the native executor."""
        return Ahead(self.sites, lambda site: self._read_native_rows(site, run), self._may_end_early(run))

    def of_execution(self, database: Database, execution: StatementExecution) -> Ahead:
        """What is coming in an execution of the query in SQL."""

        def rows(site: Site) -> Rows | None:
            if site.repeats:
                return self._encoded_rows(site, execution)
            lowered = self._lowered(site)
            return None if lowered is None else _sql_rows(database, execution, lowered)

        return Ahead(self.sites, rows, self._may_end_early(execution.run))

    def _may_end_early(self, run: Run) -> bool:
        return self.early or run.max_rows is not None or run.maximum is not None

    def _lowered(self, site: Site) -> SqlQuery | None:
        if site not in self.lowered:
            assert self.lower is not None
            try:
                self.lowered[site] = self.lower(site.scout)
            except UnsupportedError:
                self.lowered[site] = None
        return self.lowered[site]

    def _read_native_rows(self, site: Site, run: Run) -> Rows:
        if site not in self.native:
            self.native[site] = NativeQuery(site.scout)
        try:
            yield from self.native[site].stream(run)
        except Stopped:
            raise
        except Exception:  # what fails here fails again where the script comes to it, if it does
            return

    def _encoded_rows(self, site: Site, execution: StatementExecution) -> Rows:
        for row in self._read_native_rows(site, execution.run):
            yield (row[0], *map(execution.interning.encode, row[1:]))


@contextmanager
def looking_ahead(scouts: Scouts | None, database: Database, execution: StatementExecution) -> Iterator[None]:
    """For as long as it lasts functions that take arrays know what is coming in an execution."""
    if scouts is None:
        yield
        return
    execution.ahead = scouts.of_execution(database, execution)
    try:
        yield
    finally:
        execution.ahead.close()


def _sql_rows(database: Database, execution: StatementExecution, lowered: SqlQuery) -> Rows:
    """The rows of a scout; it ends where something fails, which fails again where the script comes to it."""

    def evaluate(parameter: Any) -> Any:
        return parameter.bound(compile_statement(parameter.expr)(execution.run))

    flags = [shown.flag for shown in lowered.outputs[1:]]
    cursor = None
    try:
        cursor = database.open_cursor(lowered, execution.interning, evaluate)
        for row in cursor:
            if True in flags:
                rest = zip(row[1:], flags, strict=True)
                row = (row[0], *((TRUE if value else FALSE) if flag else value for value, flag in rest))
            yield row
    except (Stopped, OtherFormError):
        raise
    except Exception:
        execution.failed = False  # as it was, for what has failed in a statement ends it
    finally:
        if cursor is not None:
            cursor.close(True)
