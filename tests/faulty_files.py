"""Files that go wrong: a VFS whose n-th operation fails, files that were damaged, and what has to hold afterwards."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import apsw
from faulty import attempt
from remembering import connect, fresh, run
from sessions import write

import ss2sql

ROWS = 400
TABLE = f"""
    CREATE TABLE t(a INTEGER PRIMARY KEY, b TEXT, c INTEGER);
    WITH RECURSIVE n(i) AS (VALUES (1) UNION ALL SELECT i + 1 FROM n WHERE i < {ROWS})
    INSERT INTO t SELECT i, hex(i), i % 7 FROM n;
    CREATE INDEX by_c ON t(c);
"""
VALUE = {"kept": [1, 2.5, None, "text"]}
WALK = "SELECT a, b FROM t AS rows;"
LOOKUP = "SELECT a FROM t WHERE c == 3 AS list;"
HISTORY = "v{};"


def prepare(file: Path) -> None:
    """A database with a table, a temporal variable and a remembered graph."""
    write(file, TABLE)
    with connect(file) as ss:
        ss.function("getTime", lambda: 5.0)
        ss.run("v{1000.0} = value;", value=VALUE)
        assert run(ss, goal=6, bound=5, limit=400).stats.remembered_steps == 0
        assert len(ss.graphs()) == 1


# What is done with such a file; of those that only read, what they have to give.
READS: dict[str, Callable[[ss2sql.Session], Any]] = {
    "walk": lambda ss: ss.eval(WALK), "walk natively": lambda ss: ss.run(WALK, engine="native").value,
    "lookup": lambda ss: ss.eval(LOOKUP), "history": lambda ss: ss.eval(HISTORY),
    "search": lambda ss: run(ss, goal=6, bound=5, limit=400).value,
}  # fmt: skip


def right() -> dict[str, Any]:
    """What they give, and `farther`, from a file that is whole."""
    walk = [(i, str(i).encode().hex().upper()) for i in range(1, ROWS + 1)]
    lookup = [i for i in range(1, ROWS + 1) if i % 7 == 3]
    search, farther = fresh(goal=6, bound=5, limit=400), fresh(goal=7, bound=6, limit=500)
    return {"walk": walk, "walk natively": walk, "lookup": lookup, "history": [VALUE], "search": search,
            "farther": farther}  # fmt: skip


LOOKS: dict[str, Callable[[ss2sql.Session], Any]] = {
    "graphs": lambda ss: repr(ss.graphs()), "tables": lambda ss: ss.tables(), "describe": lambda ss: ss.describe("t"),
}  # fmt: skip
WRITES: dict[str, Callable[[ss2sql.Session], Any]] = {
    "store": lambda ss: ss.run("v{1000.0} = 7;"), "long": lambda ss: ss.run("w{1000.0} = text;", text="x" * 60_000),
    "farther": lambda ss: run(ss, goal=7, bound=6, limit=500), "drop": lambda ss: ss.graphs().drop(),
    "forget": lambda ss: ss.set("v", 3),
}  # fmt: skip


# --- a VFS that fails ----------------------------------------------------------------------------------


class Failing(apsw.VFS):
    """The system's VFS, but the `left`-th call of one of its `operations` fails, and all after that if it `stays`."""

    def __init__(self, name: str = "failing") -> None:
        self.operations: frozenset[str] = frozenset()
        self.error: type[apsw.Error] = apsw.IOError
        self.left = 0
        self.stays = False
        self.base = apsw.vfs_names()[0]
        super().__init__(name, self.base, makedefault=True)

    def look(self, operation: str) -> None:
        """Raises where this call is the one to fail."""
        if operation in self.operations:
            self.left -= 1
            if self.left == 0 or (self.stays and self.left < 0):
                raise self.error("the disk is broken")

    def xOpen(self, name: Any, flags: Any) -> apsw.VFSFile:  # noqa: N802 - the names are SQLite's
        self.look("open")
        return FailingFile(self, name, flags)

    def xDelete(self, filename: str, sync: bool) -> None:  # noqa: N802
        self.look("delete")
        super().xDelete(filename, sync)


class FailingFile(apsw.VFSFile):
    """A file each of whose METHODS looks first whether it is the one to fail."""

    METHODS = {"xRead": "read", "xWrite": "write", "xSync": "sync", "xTruncate": "truncate", "xLock": "lock",
               "xFileSize": "size"}  # fmt: skip

    def __init__(self, vfs: Failing, name: Any, flags: Any) -> None:
        self.vfs = vfs
        super().__init__(vfs.base, name, flags)


def failing_method(method: str, operation: str) -> Callable[..., Any]:
    def call(file: FailingFile, *arguments: Any) -> Any:
        file.vfs.look(operation)
        return getattr(apsw.VFSFile, method)(file, *arguments)

    return call


for method, operation in FailingFile.METHODS.items():
    setattr(FailingFile, method, failing_method(method, operation))


@contextmanager
def failing() -> Iterator[Failing]:
    """The VFS, by which every connection is opened meanwhile."""
    vfs = Failing()
    try:
        yield vfs
    finally:
        vfs.unregister()
        apsw.set_default_vfs(vfs.base)


FAULTS: dict[str, tuple[frozenset[str], type[apsw.Error]]] = {
    "full": (frozenset({"write"}), apsw.FullError),
    "no space for a write": (frozenset({"write", "truncate"}), apsw.IOError),
    "sync": (frozenset({"sync"}), apsw.IOError), "read": (frozenset({"read", "size"}), apsw.IOError),
    "lock": (frozenset({"lock"}), apsw.IOError), "open": (frozenset({"open"}), apsw.CantOpenError),
    "delete": (frozenset({"delete"}), apsw.IOError),
}  # fmt: skip


# --- damage --------------------------------------------------------------------------------------------


def flip(data: bytearray, dice: Random, page: int) -> None:
    for _ in range(dice.choice((1, 3, 20))):
        data[dice.randrange(len(data))] = dice.randrange(256)


def overwrite(data: bytearray, dice: Random, page: int) -> None:
    place, size = dice.randrange(len(data)), dice.choice((8, 100, 4096))
    data[place : place + size] = dice.randbytes(min(size, len(data) - place))


def zero(data: bytearray, dice: Random, page: int) -> None:
    data[page : page + 4096] = bytes(4096)


def cut(data: bytearray, dice: Random, page: int) -> None:
    del data[dice.randrange(len(data)) :]


def swap(data: bytearray, dice: Random, page: int) -> None:
    """Two pages change places."""
    other = dice.randrange(len(data) // 4096) * 4096
    data[page : page + 4096], data[other : other + 4096] = data[other : other + 4096], data[page : page + 4096]


def head(data: bytearray, dice: Random, page: int) -> None:
    """A byte of a page's own header, or of the file's."""
    data[page + dice.randrange(100)] = dice.randrange(256)


DAMAGES = (flip, overwrite, zero, cut, swap, head)


def is_whole(file: Path) -> bool:
    """Whether SQLite finds nothing wrong with a file."""
    connection = apsw.Connection(str(file), flags=apsw.SQLITE_OPEN_READONLY)
    try:
        return connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    finally:
        connection.close()


PLAIN = {
    "walk": "SELECT a, b FROM t ORDER BY rowid",
    "walk natively": "SELECT a, b FROM t ORDER BY rowid",
    "lookup": "SELECT a FROM t WHERE c = 3 ORDER BY rowid",
}


def as_sqlite_reads(file: Path, name: str) -> list[Any]:
    """What SQLite itself gives, whose pages know of no damage inside of values."""
    connection = apsw.Connection(str(file), flags=apsw.SQLITE_OPEN_READONLY)
    connection.execute("PRAGMA cell_size_check = ON")
    rows = connection.execute(PLAIN[name]).fetchall()
    connection.close()
    return [row[0] for row in rows] if name == "lookup" else rows


def outcome(work: Callable[[], Any]) -> tuple[Any, ss2sql.Error | None]:
    """What some work gives, or the error of ours that it ends with, which is about the file."""
    found: list[Any] = []
    error = attempt(lambda: found.append(work()))
    if error is None:
        return found[0], None
    assert isinstance(error, ss2sql.Error), repr(error)
    assert error.code in ("S002", "X009", "R001"), str(error)  # R001: a column has another name in a damaged schema
    return None, error


def handles() -> int:
    """How many files are open."""
    return len(os.listdir("/proc/self/fd"))
