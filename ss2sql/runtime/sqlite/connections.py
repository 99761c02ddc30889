"""Connections of SQLite: what statements of scripts may do, files, and databases of Python's `sqlite3`.

The text of the statements is made by lowering, which has no words for anything but reading and registered functions.
The authorizer is the second lock: SQLite asks it while it prepares a statement, and refuses it before it runs. A small
query takes 2 us longer the first time that SQLite sees its text (8 instead of 6) and less than 1 us after that (of 64);
a search takes no longer, for SQLite asks nothing while it runs.

POSIX locks belong to the process: two copies of SQLite in one process do not see each other's locks, and a copy that
unlocks or closes a file drops the locks of the other, which may then lose what it writes. See "How To Corrupt An
SQLite Database File", section 2.2, in SQLite's documentation. So before a session opens, reads, writes or closes a file
it looks whether a descriptor of the file is open that none of apsw's connections has. It looks by `fstat`, never by
opening the file, which would drop the lock by itself. With 50 descriptors a look takes 60 microseconds. A copy that
opens the file while a script runs is noticed by the next one: nothing can keep another module from opening files.
Windows locks by handle, so nothing is looked for there.

So a connection of `sqlite3` is read through itself: its database is copied into memory, and anew when it has
changed. It is copied whole: what is read row by row may be rolled back in between.
"""

from __future__ import annotations

import os
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

import apsw

from ss2sql.errors import Error, ExecutionError, SessionError
from ss2sql.language.conversion import build_utf8_error
from ss2sql.runtime.run.run_state import Run, build_memory_error

if TYPE_CHECKING:
    import sqlite3


CHECK_EVERY = 10_000  # steps of SQLite's virtual machine between looks at the clock, about 0.2 ms
# What reading a file may raise: a text in it may be no UTF-8.
READ_ERRORS = (apsw.Error, UnicodeDecodeError)


class TooLargeToBindError(apsw.TooBigError):
    """A value that Python gave is larger than SQLite takes. No row was evaluated, so the query can run natively."""


class Authorizer:
    """The authorizer of a connection. It looks at statements of scripts; ss2sql's own pass.

    What functions run while a statement runs (another script, a temporal variable that is written) is looked at by
    itself, for SQLite has prepared the outer statement by then.
    """

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection
        self.functions: set[str] = set()
        self._looks = False
        self._text = ""
        connection.authorizer = self._authorize_action

    def add_scalar(self, name: str, function: Callable[..., Any], arguments: int = -1) -> None:
        self.connection.create_scalar_function(name, function, arguments)
        self.functions.add(name.lower())

    def add_aggregate(self, name: str, factory: Callable[[], Any]) -> None:
        self.connection.create_aggregate_function(name, factory)
        self.functions.add(name.lower())

    def execute_reading(self, text: str, values: Mapping[str, Any], cursor: apsw.Cursor | None = None) -> apsw.Cursor:
        """The cursor on the rows of one statement that only reads. Raises apsw.Error for anything else."""
        cursor = cursor or self.connection.cursor()
        cursor.exec_trace = self._check_prepared_statement
        self._looks, self._text = True, text
        try:
            return cursor.execute(text, values)
        except apsw.TooBigError as error:
            if self._looks:  # it has not begun
                raise TooLargeToBindError(str(error)) from None
            raise
        finally:
            self._looks = False

    def _check_prepared_statement(self, cursor: apsw.Cursor, text: str, values: Any) -> bool:
        """apsw asks this between preparing a statement and running it: one that only reads, and no other after it."""
        self._looks = False
        return cursor.is_readonly and len(text) == len(self._text)

    def _authorize_action(
        self, action: int, first: str | None, second: str | None, database: str | None, inside: str | None
    ) -> int:
        if not self._looks or action == apsw.SQLITE_SELECT or action == apsw.SQLITE_RECURSIVE:
            return apsw.SQLITE_OK
        if inside is not None and action in (apsw.SQLITE_READ, apsw.SQLITE_FUNCTION):
            return apsw.SQLITE_OK  # of a view, whose definition is the file's, see lock_down_connection
        if action == apsw.SQLITE_READ:
            return apsw.SQLITE_DENY if (first or "").lower().startswith("sqlite_") else apsw.SQLITE_OK
        if action == apsw.SQLITE_FUNCTION:
            name = (second or "").lower()
            return apsw.SQLITE_OK if name in self.functions or name in _list_allowed_functions() else apsw.SQLITE_DENY
        return apsw.SQLITE_DENY


@cache
def _list_allowed_functions() -> frozenset[str]:
    from ss2sql.lowering.sqlite_forms import list_form_functions  # loaded by now, if it has written a statement

    return list_form_functions() | {"char", "coalesce", "count", "glob", "instr", "row_number", "substr", "typeof"}


def lock_down_connection(connection: apsw.Connection) -> None:
    """Switches off what no script needs, and what a file that comes from a stranger could use.

    Views, indexes and generated columns of such a file call none of the functions that are registered here, and none of
    SQLite's that have effects.
    """
    connection.config(apsw.SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, 0)
    connection.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)
    connection.config(apsw.SQLITE_DBCONFIG_DEFENSIVE, 1)


def find_sqlite_run_error(error: apsw.Error | UnicodeDecodeError, run: Run) -> Error:
    """The error of a run whose statement SQLite broke off."""
    if isinstance(error, apsw.TooBigError) and not isinstance(error, TooLargeToBindError):
        return run.sizes.build_size_error("a text")
    if isinstance(error, apsw.NoMemError):
        return build_memory_error()
    return build_sqlite_error(error, "run it with engine='native'")


def build_sqlite_error(error: apsw.Error | UnicodeDecodeError, *hints: str) -> ExecutionError:
    """The error for what SQLite does not do, or for a text that it gives and Python cannot read."""
    if isinstance(error, UnicodeDecodeError):
        return build_utf8_error(error.object)
    return ExecutionError("X009", f"SQLite: {error}", hints=hints)


def quote_sqlite_name(name: str) -> str:
    """A name as SQL reads it whatever characters it has."""
    return '"' + name.replace('"', '""') + '"'


# --- files that another copy of SQLite has open in this process, such as that of Python's `sqlite3`
FileId: TypeAlias = tuple[int, int]  # the device and the number of a file, which all its names share

POSIX = os.name == "posix"
DESCRIPTORS = "/dev/fd"
RETRY_SECONDS = 0.002  # until the second look, which descriptors of a connection just being opened or closed need

_lock = threading.RLock()
_files: weakref.WeakKeyDictionary[apsw.Connection, dict[str, FileId]] = weakref.WeakKeyDictionary()
# The descriptors that connections of sessions have opened. SQLite keeps that of a closed connection while another one
# has a lock on the file, and in WAL mode each one has a lock for as long as it is open.
_own_descriptors: dict[FileId, set[int]] = {}
_parked: list[apsw.Connection] = []  # closed for their sessions, and open while another copy has the file open
# What this process has of the one that it was copied from: locks of a copy are its own, so nothing here counts.
_inherited_descriptors: dict[int, FileId] = {}
_inherited_connections: list[apsw.Connection] = []


def open_sqlite_file(path: str, flags: int) -> apsw.Connection:
    """A connection to a file. Raises SessionError S005 where another copy of SQLite has it open; what apsw raises."""
    with _lock:
        _close_parked_connections()
        with _note_descriptors(path):
            connection = apsw.Connection(path, flags=flags)
        if identity := _get_locked_file_id(path):
            _files[connection] = {"main": identity}
    return connection


def attach_file(connection: apsw.Connection, name: str, path: str) -> None:
    """Attaches a file to a connection under a name. Raises as `open_sqlite_file` does."""
    with _lock:
        _close_parked_connections()
        with _note_descriptors(path):
            connection.execute(f"ATTACH ? AS {quote_sqlite_name(name)}", (path,))
        if identity := _get_locked_file_id(path):
            _files.setdefault(connection, {})[name] = identity


def detach_file(connection: apsw.Connection, name: str) -> None:
    """Lets an attached file go. Raises SessionError S005 where another copy of SQLite has it open."""
    with _lock:
        known = _files.get(connection, {})
        if name in known and _is_shared(known[name]):
            raise _build_sqlite_lock_error(connection.db_filename(name))
        connection.execute(f"DETACH {quote_sqlite_name(name)}")
        if name in known:
            _forget_closed_files(known.pop(name))


def close_file(connection: apsw.Connection) -> None:
    """Closes a connection: at once, or when no other copy of SQLite has its files open any more."""
    with _lock:
        _parked.append(connection)
        _close_parked_connections()


@contextmanager
def while_using_files(connection: apsw.Connection) -> Iterator[None]:
    """While a session works with its files. Raises SessionError S005 where another copy of SQLite has one open."""
    files = _files.get(connection)
    if not files:
        yield
        return
    with _lock:
        for name, identity in files.items():
            if _is_shared(identity):
                raise _build_sqlite_lock_error(connection.db_filename(name))
    try:
        yield
    finally:
        with _lock:
            for identity in set(files.values()):
                # Descriptors of others may have been closed with the last lock.
                if len(_own_descriptors.get(identity, ())) > 1:
                    _forget_closed_files(identity)


@contextmanager
def _note_descriptors(path: str) -> Iterator[None]:
    """While a file is opened: the descriptors that come of it are those of sessions. Raises as `open_sqlite_file`."""
    identity = _get_locked_file_id(path)  # None of a file that is not there yet, and so open nowhere
    if identity is not None and _is_shared(identity):
        raise _build_sqlite_lock_error(path)
    before = set() if identity is None else _find_descriptors(identity)
    yield
    if identity := _get_locked_file_id(path):
        _own_descriptors.setdefault(identity, set()).update(_find_descriptors(identity) - before)


def _close_parked_connections() -> None:
    for connection in list(_parked):
        identities = set(_files.get(connection, {}).values())
        if not any(map(_is_shared, identities)):
            _parked.remove(connection)
            connection.close()
            _files.pop(connection, None)
            for identity in identities:
                _forget_closed_files(identity)


def _forget_closed_files(identity: FileId) -> None:
    """Leaves those descriptors of sessions that are open."""
    left = _own_descriptors.get(identity, set()) & _find_descriptors(identity)
    if left:
        _own_descriptors[identity] = left
    else:
        _own_descriptors.pop(identity, None)


def _build_sqlite_lock_error(path: str) -> SessionError:
    message = f"{path} is open in this process in another copy of SQLite, such as sqlite3"
    hints = (
        "close the other connection first, or let ss2sql read through it: attach('name', connection)",
        "two copies of SQLite in one process drop each other's locks, and can damage the file",
    )
    return SessionError("S005", message, hints=hints)


def _get_locked_file_id(path: str) -> FileId | None:
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def _is_shared(identity: FileId) -> bool:
    """Whether a file has descriptors that are neither a session's nor of another connection of apsw."""
    if not POSIX or _count_other_connections(identity) <= 0:
        return False
    time.sleep(RETRY_SECONDS)
    return _count_other_connections(identity) > 0


def _count_other_connections(identity: FileId) -> int:
    others = len(_find_descriptors(identity) - _own_descriptors.get(identity, set()))
    return others - sum(_find_open_files(one).count(identity) for one in apsw.connections()) if others else 0


def _find_descriptors(identity: FileId) -> set[int]:
    """The open descriptors of a file, but for those of the process that this one is a copy of."""
    found = set()
    for name in os.listdir(DESCRIPTORS) if POSIX else ():
        number = int(name)
        with suppress(OSError):  # of the listed folder itself, which is closed by now
            status = os.fstat(number)
            if (status.st_dev, status.st_ino) == identity != _inherited_descriptors.get(number):
                found.add(number)
    return found


def _find_open_files(connection: apsw.Connection) -> list[FileId | None]:
    """The files that a connection has open which is the user's own."""
    if connection in _files or any(connection is one for one in _inherited_connections):
        return []
    try:
        paths = [connection.db_filename(name) for name in connection.db_names()]
    except apsw.Error:  # another thread works with it
        paths = [connection.filename]
    return [_get_locked_file_id(path) for path in paths if path]


def _note_inherited_descriptors() -> None:
    global _lock
    _lock = threading.RLock()  # a thread that is not in the copy may have held it
    _inherited_descriptors.clear()
    for name in os.listdir(DESCRIPTORS):
        with suppress(OSError):
            status = os.fstat(int(name))
            _inherited_descriptors[int(name)] = (status.st_dev, status.st_ino)
    _inherited_connections[:] = apsw.connections()
    _parked.clear()
    _own_descriptors.clear()


if POSIX:
    os.register_at_fork(after_in_child=_note_inherited_descriptors)


# --- databases of Python's `sqlite3` as sources: a copy in memory, made anew when they have changed
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
        except self.source.Error as error:
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
