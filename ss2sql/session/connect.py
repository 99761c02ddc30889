"""How a session begins."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from ss2sql.runtime.run.option_checks import Limits
from ss2sql.runtime.run.value_sizes import MAX_SIZE
from ss2sql.session.engines import Engine
from ss2sql.session.session import Session


def connect(
    path: str | os.PathLike[str] | None = None,
    timeout: float | None = None,
    progress: str | bool = "auto",
    read_only: bool = False,
    disable: Sequence[str] = (),
    max_size: int = MAX_SIZE,
    max_memory: int | None = None,
    max_steps: int | None = None,
    max_output: int | None = None,
    engine: Engine = "auto",
    session: Any = None,
) -> Session:
    """A new session.

    Args:
        path: a SQLite file whose tables scripts can read; it keeps temporal variables and remembered graphs. None for a
            database in memory.
        timeout: seconds after which a run is broken off; None for no limit.
        progress: "auto", True or False: whether long runs show a line of progress on a terminal.
        read_only: opens the file without the right to change it.
        disable: names of optimisations to switch off: "memo", "remember", "inline" and others.
        max_size: bytes of one value that a script makes, a text or a list: at least 262,144, at most 10**9.
        max_memory: bytes by which the process may grow while a script runs; None for no limit. Only on Linux.
        max_steps: steps that the searches of one run may try together, as `result.stats.generated` counts them.
        max_output: characters that one run may print.
        engine: where scripts run for which nothing else is said, see `Session.run`.
        session: with the engine "duckdb" a connection of DuckDB, whose tables and views scripts can read by their names
            and whose settings count: memory, threads, folder; with "spark" a SparkSession.

    Raises:
        SessionError: the file cannot be opened, a name in `disable` is unknown, or the engine is not installed.
    """
    limits = Limits(max_size, max_memory, max_steps, max_output)
    return Session(path, timeout, progress, read_only, disable, limits, engine, session)
