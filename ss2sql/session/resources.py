"""What a session holds outside of itself, and lets go of when it is closed or forgotten."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.engines import open_table_engine
from ss2sql.vtables.frames import Reader

if TYPE_CHECKING:
    from ss2sql.runtime.external.level_query import TableEngine
    from ss2sql.runtime.parallel.process_pool import ProcessPool


@dataclass(slots=True)
class SessionResources:
    """The processes of `workers` and the databases that search by levels. A finalizer keeps it, so it knows no session.

    `session` is the user's connection of such a database; `active_runs` are the runs that are under way.
    """

    session: Any = None
    active_runs: Sequence[Run] = ()
    processes: ProcessPool | None = None
    engines: dict[str, TableEngine | None] = field(default_factory=dict)
    owner: int = field(default_factory=os.getpid)

    def get_engine(self, name: str) -> TableEngine | None:
        """The database of an engine, if there is one. Raises SessionError S003 if it is not installed."""
        if name not in self.engines:
            self.engines[name] = open_table_engine(name, self.session, self.active_runs)
        return self.engines[name]

    def get_parquet_reader(self, path: Path, name: str) -> Reader:
        """The reader of a Parquet file. Raises SessionError S002 for other files, S003 if DuckDB is not installed."""
        found = self.get_engine("duckdb")
        assert found is not None
        assert found.sources is not None
        return found.sources.make_parquet_reader(path, name)

    def end_all(self) -> None:
        """Ends all of it; a copy of the process made by `fork` leaves it to the original."""
        if self.processes is not None:
            self.processes.end_processes()
        while self.engines:
            _, engine = self.engines.popitem()
            if engine is not None and os.getpid() == self.owner:
                engine.close()
        self.session = None  # at the end of Python DuckDB tells of each connection that somebody holds, in twenty lines
