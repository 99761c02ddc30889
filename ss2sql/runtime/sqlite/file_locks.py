"""Files that another copy of SQLite has open in this process, such as that of Python's `sqlite3`.

POSIX locks belong to the process: two copies of SQLite in one process do not see each other's locks, and a copy that
unlocks or closes a file drops the locks of the other, which may then lose what it writes. See "How To Corrupt An
SQLite Database File", section 2.2, in SQLite's documentation. So before a session opens, reads, writes or closes a file
it looks whether a descriptor of the file is open that none of apsw's connections has. It looks by `fstat`, never by
opening the file, which would drop the lock by itself. With 50 descriptors a look takes 60 microseconds. A copy that
opens the file while a script runs is noticed by the next one: nothing can keep another module from opening files.

Windows locks by handle, so nothing is looked for there.
"""

from __future__ import annotations

import os
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TypeAlias

import apsw

from ss2sql.errors import SessionError
from ss2sql.runtime.sqlite.column_types import quote_sqlite_name

# The device and the number of a file, which all its names share.
FileId: TypeAlias = tuple[int, int]

POSIX = os.name == "posix"
DESCRIPTORS = "/dev/fd"
RETRY_SECONDS = (
    0.002  # seconds until the second look, which descriptors of a connection just being opened or closed need
)

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
                if (
                    len(_own_descriptors.get(identity, ())) > 1
                ):  # descriptors of others may have been closed with the last lock
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
