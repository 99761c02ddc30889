"""Who uses a session, one thread at a time, and what it lets go of when it is closed or forgotten."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import field
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import apsw

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.run.keyboard_interrupt import defer_keyboard_interrupt
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.engines import open_session_engine
from ss2sql.vtables.frames import Reader

if TYPE_CHECKING:
    from ss2sql.runtime.external.level_query import TableEngine
    from ss2sql.runtime.parallel.process_pool import ProcessPool
    from ss2sql.session.session import Session


P = ParamSpec("P")
T = TypeVar("T")


class SessionLock:
    """Lets one thread use the connection of a session, which may enter again while it is inside.

    A second thread gets an error: waiting could be a deadlock, and two runs would read each other's values.
    """

    def __init__(
        self,
        release: Callable[[], None],
        using: Callable[[], AbstractContextManager[None]],
        forget_pages: Callable[[], object],
        in_file: bool,
    ) -> None:
        self._lock = threading.RLock()
        self._depth = 0
        self._release = release
        self._using = using
        self._forget_pages = forget_pages
        self._used: AbstractContextManager[None] | None = None
        self._closed = False
        self._process = os.getpid()
        self._in_file = in_file

    @property
    def here(self) -> bool:
        """Whether this process has opened the session, and is no copy made by `fork`."""
        return os.getpid() == self._process

    def __enter__(self) -> None:
        if self._in_file and not self.here:  # the locks of SQLite on a file are not those of the copy
            hint = "connect to the file anew in each process"
            raise SessionError("S004", "the session belongs to the process that this one is a copy of", hints=(hint,))
        if not self._lock.acquire(blocking=False):
            hints = ("give each thread a session of its own, or let them take turns with a lock",)
            raise SessionError("S004", "the session is in use in another thread", hints=hints)
        if not self._depth:
            used = self._using()
            try:
                used.__enter__()
            except BaseException:
                self._lock.release()
                raise
            self._used = used
        self._depth += 1

    def __exit__(self, kind: object, error: BaseException | None, *_: object) -> None:
        if is_session_file_damaged(error) and not self._closed:
            self._forget_pages()  # SQLite checks a page when it reads it, and takes it as checked while it is kept
        self._depth -= 1
        if not self._depth and self._used is not None:
            self._used.__exit__(None, None, None)
            self._used = None
        self._lock.release()
        if self._closed:
            self._end_if_free()

    def release_resources(self) -> None:
        """Releases the resources of the session, now or when the last user leaves."""
        self._closed = True
        self._end_if_free()

    def _end_if_free(self) -> None:
        if self._lock.acquire(blocking=False):  # else whoever is there does it
            try:
                if not self._depth:
                    self._release()
            finally:
                self._lock.release()


def is_session_file_damaged(error: BaseException | None) -> bool:
    seen: set[int] = set()  # they may form a cycle
    while error is not None and id(error) not in seen:
        if isinstance(error, apsw.CorruptError):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False


def with_session_lock(work: Callable[Concatenate[Session, P], T]) -> Callable[Concatenate[Session, P], T]:
    """Decorator: a method of a session that uses its connection; Ctrl-C cannot interrupt it halfway."""

    @wraps(work)
    def call_locked(session: Session, /, *arguments: P.args, **named: P.kwargs) -> T:
        with defer_keyboard_interrupt(), session.host.session_lock:
            return work(session, *arguments, **named)

    return call_locked


# --- what a session holds outside of itself, and lets go of when it is closed or forgotten
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
            self.engines[name] = open_session_engine(name, self.session, self.active_runs)
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
