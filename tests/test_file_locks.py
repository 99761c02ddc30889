"""A file that another copy of SQLite has open in the same process: nothing of ss2sql touches it, in either order."""

from __future__ import annotations

import os
import signal
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import apsw
import pytest
from sessions import code_of

import ss2sql
from ss2sql.runtime.sqlite import connections

COUNT = "SELECT count(*) FROM t GROUP BY 1 AS value"
GRAPH = "SELECT this FROM [1, 2] WHERE n == 3 START WITH n = 0 CONNECT BY MEMORIZE 3 n = n + this AS list"
# What touches a file, each in a session that is new or was opened before.
TOUCHES: dict[str, Callable[[ss2sql.Session, Path], object]] = {
    "read": lambda ss, path: ss.eval(COUNT), "write": lambda ss, path: ss.eval("w{1.0} = range(2000);"),
    "graph": lambda ss, path: ss.run(GRAPH), "graphs": lambda ss, path: ss.graphs(),
    "tables": lambda ss, path: ss.tables(), "compile": lambda ss, path: ss.compile(COUNT),
    "connect": lambda ss, path: ss2sql.connect(path),
    "connect read-only": lambda ss, path: ss2sql.connect(path, read_only=True),
    "attach": lambda ss, path: ss2sql.connect().attach("g", path),
}  # fmt: skip


@pytest.fixture(params=["delete", "wal"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file of 500 rows, with a journal or a write-ahead log."""
    path = tmp_path / "x.db"
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA journal_mode = {request.param}")
    connection.execute("CREATE TABLE t(x)")
    connection.executemany("INSERT INTO t VALUES (?)", [(n,) for n in range(500)])
    connection.commit()
    connection.close()
    return path


@pytest.fixture
def nothing_parked() -> Iterator[None]:
    yield
    ss2sql.connect().close()
    with connections._lock:
        connections._close_parked_connections()
    assert connections._parked == []


def writing(path: Path) -> sqlite3.Connection:
    """A connection in a transaction that has spilled into the file."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA cache_size = 5")
    connection.execute("BEGIN EXCLUSIVE")
    connection.executemany("INSERT INTO t VALUES (?)", [(n,) for n in range(3000)])
    return connection


def assert_whole(connection: sqlite3.Connection, rows: int) -> None:
    connection.execute("COMMIT")
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert connection.execute("SELECT count(*) FROM t").fetchall() == [(rows,)]
    connection.close()


@pytest.mark.parametrize("touch", TOUCHES)
def test_a_file_that_was_opened_by_another_copy_before(path: Path, touch: str) -> None:
    other = writing(path)
    if touch.startswith(("connect", "attach")):
        assert code_of(TOUCHES[touch], ss2sql.connect(), path) == "S005"
    else:
        assert code_of(ss2sql.connect, path) == "S005"
    assert_whole(other, 3500)
    with ss2sql.connect(path) as ss:
        assert ss.eval(COUNT) == 3500


@pytest.mark.usefixtures("nothing_parked")
@pytest.mark.parametrize("touch", [*TOUCHES, "close", "drop"])
def test_a_file_that_is_opened_by_another_copy_afterwards(path: Path, touch: str) -> None:
    ss = ss2sql.connect(path)
    assert ss.eval(COUNT) == 500
    other = writing(path)
    if touch in TOUCHES:
        assert code_of(TOUCHES[touch], ss, path) == "S005"
    ss.close()
    if touch == "drop":
        del ss
    assert_whole(other, 3500)


@pytest.mark.usefixtures("nothing_parked")
def test_an_attached_file(path: Path) -> None:
    ss = ss2sql.connect()
    ss.attach("g", path)
    other = writing(path)
    for use in (lambda: ss.eval(COUNT.replace("t", "g.t", 1)), lambda: ss.detach("g"), lambda: ss.attach("g", [1])):
        assert code_of(use) == "S005"
    assert_whole(other, 3500)
    assert ss.eval("SELECT count(*) FROM g.t GROUP BY 1 AS value") == 3500
    ss.detach("g")
    ss.close()


def test_another_name_of_the_file(path: Path) -> None:
    link, same = path.with_name("link.db"), path.with_name("same.db")
    link.symlink_to(path)
    os.link(path, same)
    other = writing(path)
    assert [code_of(ss2sql.connect, name) for name in (link, same)] == ["S005", "S005"]
    assert_whole(other, 3500)


def test_connections_of_apsw_share_their_locks(path: Path) -> None:
    own = apsw.Connection(str(path))
    own.execute("ATTACH ? AS again", (str(path),))
    with ss2sql.connect(path) as ss, ss2sql.connect(path) as second:
        assert ss.eval(COUNT) == second.eval(COUNT) == 500
        ss.eval("w{1.0} = 1;")
    own.close()


@pytest.mark.usefixtures("nothing_parked")
def test_sessions_that_close_while_others_read(path: Path) -> None:
    """SQLite keeps the descriptor of a closed connection while another one reads: it is no other copy's."""
    with ss2sql.connect(path) as reading:

        def nested(n: int) -> int:
            ss2sql.connect(path).close()
            with ss2sql.connect(path) as inner:
                return int(inner.eval(COUNT)) + n

        reading.function("nested", nested, volatility="volatile")
        assert reading.eval("SELECT nested(x) FROM t LIMIT 3 AS list") == [500, 501, 502]


@pytest.mark.usefixtures("nothing_parked")
def test_threads_leave_a_file_alone_that_another_copy_writes(path: Path) -> None:
    """Three threads try again and again, while one writes: whoever comes too early is refused."""
    codes: list[list[str]] = [[], [], []]
    begun = threading.Barrier(4)
    ended = threading.Event()

    def own(number: int) -> None:
        begun.wait()
        while not ended.is_set():
            try:
                with ss2sql.connect(path) as ss:
                    ss.eval(COUNT)
                codes[number].append("")
            except ss2sql.Error as error:
                codes[number].append(error.code)

    other = writing(path)
    threads = [threading.Thread(target=own, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    begun.wait()
    other.executemany("INSERT INTO t VALUES (?)", [(n,) for n in range(20000)])
    assert {code for each in codes for code in each} <= {"S005"}
    assert_whole(other, 23500)
    ended.set()
    for thread in threads:
        thread.join()
    with ss2sql.connect(path) as ss:
        assert ss.eval(COUNT) == 23500


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copies of processes here")
def test_a_copy_of_the_process_has_locks_of_its_own(path: Path) -> None:
    other = sqlite3.connect(path)
    assert other.execute("SELECT count(*) FROM t").fetchall() == [(500,)]
    child = os.fork()
    if not child:
        with ss2sql.connect(path) as ss:
            found = ss.eval(COUNT)
        again = sqlite3.connect(path)
        os._exit(found != 500 or code_of(ss2sql.connect, path) != "S005" or again.total_changes)
    assert os.waitpid(child, 0)[1] == 0
    assert code_of(ss2sql.connect, path) == "S005"
    other.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copies of processes here")
def test_a_copy_that_is_made_while_another_thread_opens_a_file(path: Path) -> None:
    """The thread is not in the copy, so it lets nothing go there."""
    held, over = threading.Event(), threading.Event()

    def hold() -> None:
        with connections._lock:
            held.set()
            over.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    child = os.fork()
    if not child:
        signal.alarm(20)
        with ss2sql.connect(path) as ss:
            os._exit(ss.eval(COUNT) != 500)
    over.set()
    thread.join()
    assert os.waitpid(child, 0)[1] == 0


# --- connections of sqlite3 as sources -----------------------------------------------------------------


@pytest.fixture
def source(path: Path) -> Iterator[sqlite3.Connection]:
    connection = sqlite3.connect(path)
    yield connection
    connection.close()


def test_the_tables_of_a_connection(source: sqlite3.Connection, engine: Any, ss: ss2sql.Session) -> None:
    source.execute("CREATE VIEW odd AS SELECT x AS n FROM t WHERE x % 2")
    ss.attach("g", source)
    assert ss.run("SELECT x FROM g.t WHERE x < 3 AS list", engine=engine).value == [0, 1, 2]
    assert ss.run("SELECT n FROM g.odd LIMIT 2 AS list", engine=engine).value == [1, 3]
    assert {name: about.columns for name, about in ss.tables().items()} == {"g.odd": ("n",), "g.t": ("x",)}
    assert ss.eval("SELECT n, t.x FROM odd, t WHERE t.x == n * 2 AND n < 4 AS rows") == [(1, 2), (3, 6)]
    ss.detach("g")
    assert ss.tables() == {}


def test_each_run_sees_the_connection_as_it_is_then(source: sqlite3.Connection, ss: ss2sql.Session) -> None:
    ss.attach("g", source)
    query = ss.compile("SELECT x FROM g.t WHERE x == 'new' OR x > 498 AS list")
    assert query.run().value == [499]
    source.execute("INSERT INTO t VALUES ('new')")
    assert query.run().value == [499, "new"]
    source.rollback()
    assert query.run().value == [499]
    source.execute("INSERT INTO t VALUES (1000)")
    source.commit()
    assert query.run().value == [499, 1000]


def test_a_rollback_while_a_run_reads(source: sqlite3.Connection, ss: ss2sql.Session, engine: Any) -> None:
    source.executemany("INSERT INTO t VALUES (?)", [(n,) for n in range(2000)])
    ss.attach("g", source)
    ss.function("undo", lambda x: source.rollback() or x, volatility="stable")
    assert len(ss.run("SELECT undo(x) FROM g.t AS list", engine=engine).value) == 2500
    assert len(ss.run("SELECT x FROM g.t AS list", engine=engine).value) == 500


def test_a_connection_is_read_in_its_own_thread(source: sqlite3.Connection, ss: ss2sql.Session) -> None:
    ss.attach("g", source)
    codes: list[str] = []

    def elsewhere() -> None:
        codes.append(code_of(ss.eval, "SELECT x FROM g.t AS list"))
        codes.append(str(ss.eval("1 + 1;")))
        ss.detach("g")

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert codes == ["S004", "2"]


def test_a_connection_that_is_closed(path: Path, ss: ss2sql.Session) -> None:
    source = sqlite3.connect(path)
    ss.attach("g", source)
    source.close()
    assert code_of(ss.eval, "SELECT x FROM g.t AS list") == "S002"
    assert code_of(ss.attach, "h", source) == "S002"
    ss.attach("g", [1])
    assert ss.eval("SELECT this FROM g AS list") == [1]
