"""Databases of Python's `sqlite3` as sources: a copy in memory, made anew when they have changed.

Two copies of SQLite must not open one file in one process, see `file_locks.py`; so a connection of `sqlite3` is read
through itself. It is read whole: what is read row by row may be rolled back in between.
"""

from __future__ import annotations

import sqlite3
from typing import Any

import apsw

from ss2sql.errors import SessionError
from ss2sql.runtime.sqlite.column_types import quote_sqlite_name

# Where a database file says that it is in WAL mode, and what says that it is not: a copy in memory has no WAL.
WAL_VERSIONS, ROLLBACK = slice(18, 20), b"\x01\x01"


class CopiedDatabase:
    """The main database of a connection of `sqlite3`, as the database `name` of a session's connection."""

    def __init__(self, connection: apsw.Connection, name: str, source: sqlite3.Connection) -> None:
        self.connection, self.name, self.source = connection, name, source
        self._seen: tuple[Any, ...] | None = None
        self.stale = True

    def refresh_copy(self) -> bool:
        """Copies the database where it is `stale` and may have changed; gives whether it did so.

        Raises SessionError S004 in another thread than that of the connection, S002 where it is closed.
        """
        if not self.stale:
            return False
        try:
            now = self._read_state()
            self.stale = False
            if now == self._seen and not self.source.in_transaction:  # a ROLLBACK changes nothing that is counted
                return False
            data = self.source.serialize()
        except sqlite3.Error as error:
            raise self._build_refusal(error) from error
        if self._seen is None:
            self.connection.execute(f"ATTACH ':memory:' AS {quote_sqlite_name(self.name)}")
        if data:
            copy = bytearray(data)
            copy[WAL_VERSIONS] = ROLLBACK
            self.connection.deserialize(self.name, copy)
        self._seen = now
        return True

    def _read_state(self) -> tuple[Any, ...]:
        pragmas = [self.source.execute(f"PRAGMA {name}").fetchall() for name in ("data_version", "schema_version")]
        return (*pragmas, self.source.total_changes, self.source.in_transaction)

    def _build_refusal(self, error: sqlite3.Error) -> SessionError:
        reason = str(error).partition(" The object")[0].rstrip(".")  # without the numbers of threads
        message = f"the connection '{self.name}' cannot be read: {reason}"
        if "thread" in str(error):
            hint = "run the script in the thread of the connection, or connect with check_same_thread=False"
            return SessionError("S004", message, hints=(hint,))
        return SessionError("S002", message, hints=("attach a connection that is open",))
