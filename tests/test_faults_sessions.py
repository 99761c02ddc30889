"""Full disks, damaged files, threads, copies of processes, and results that would fill the memory."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import apsw
import pytest
from faulty import attempt, limited
from sessions import both, code_of

import ss2sql

# --- files ---------------------------------------------------------------------------------------------


def test_a_full_disk(file: Path) -> None:
    with ss2sql.connect(file) as ss:
        ss.run("v{1000.0} = 'kept';")
        connection = ss.host.connection
        pages = connection.execute("PRAGMA page_count").get
        connection.execute(f"PRAGMA max_page_count = {pages}")  # a file that cannot grow is what a full disk comes to
        error = attempt(lambda: ss.run("v{1000.0} = text;", text="x" * 100_000))
        assert isinstance(error, ss2sql.Error)
        assert error.code == "X009"
        assert not connection.in_transaction
        assert ss.eval("SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]
    with ss2sql.connect(file) as ss:
        assert ss.eval("v{};")[0] == "kept"


@pytest.mark.parametrize("place", [0, 18, 100, 2000])
def test_a_damaged_file(file: Path, place: int) -> None:
    connection = apsw.Connection(str(file))
    connection.execute("CREATE TABLE t(a, b); WITH RECURSIVE n(i) AS (VALUES (1) UNION ALL SELECT i + 1 FROM n "
                       "WHERE i < 2000) INSERT INTO t SELECT i, hex(i) FROM n")  # fmt: skip
    connection.close()
    data = bytearray(file.read_bytes())
    data[place : place + 3000] = b"\xa5" * 3000
    file.write_bytes(data)
    opened: list[ss2sql.Session] = []
    error = attempt(lambda: opened.append(ss2sql.connect(file)))
    if error is not None:
        assert isinstance(error, ss2sql.SessionError)
        return
    with opened[0] as ss:
        assert isinstance(attempt(lambda: ss.run("SELECT a, b FROM t ORDER BY b, a AS rows;")), ss2sql.Error | None)
        assert ss.eval("SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]


# --- threads and copies of the process -----------------------------------------------------------------


@both
def test_a_second_thread_is_refused(ss: ss2sql.Session, engine: Any) -> None:
    errors: list[str] = []

    def meanwhile() -> None:
        calls = (lambda: ss.run("1;"), lambda: ss.set("x", 1), lambda: ss.attach("x", [1]), ss.tables,
                 lambda: ss.function("g", abs), ss.graphs)  # fmt: skip
        errors.extend(code_of(call) for call in calls)

    def ask(x: int) -> int:
        thread = threading.Thread(target=meanwhile)
        thread.start()
        thread.join()
        return x + 1

    ss.function("ask", ask, volatility="volatile")
    assert ss.run("SELECT ask(this) FROM [1, 2] AS list;", engine=engine).value == [2, 3]
    assert errors == ["S004"] * 12
    assert ss.variables() == {}
    ss.set("x", 5)
    thread = threading.Thread(target=lambda: errors.append(ss.eval("x;")))
    thread.start()
    thread.join()
    assert errors[-1] == 5


@both
def test_closing_from_another_thread_ends_the_run(engine: Any) -> None:
    ss = ss2sql.connect()

    def shut(x: int) -> int:
        thread = threading.Thread(target=ss.close)
        thread.start()
        thread.join()
        return x

    ss.function("shut", shut, volatility="volatile")
    with pytest.raises(ss2sql.Cancelled) as caught:
        ss.run("SELECT shut(this) FROM range(1000) AS list;", engine=engine)
    assert isinstance(caught.value.partial, ss2sql.Result)
    assert code_of(ss.run, "1;") == "S001"
    with pytest.raises(apsw.ConnectionClosedError):
        ss.host.connection.execute("SELECT 1")


def test_a_function_registered_anew_by_itself(ss: ss2sql.Session) -> None:
    def first(x: int) -> int:
        ss.function("f", second, volatility="volatile")
        with pytest.raises(ss2sql.SessionError, match="registered anew while a query runs") as caught:
            ss.run("SELECT f(this) FROM [1, 2] AS list;", engine="database")
        assert caught.value.code == "S004"
        return x

    def second(x: int) -> int:
        return -x

    ss.function("f", first, volatility="volatile")
    assert ss.run("SELECT f(this) FROM [1] AS list;", engine="database").value == [1]
    for engine in ("database", "native"):
        assert ss.run("SELECT f(this) FROM [1, 2] AS list;", engine=engine).value == [-1, -2]


FORK = """
import os, sys
import ss2sql
ss = ss2sql.connect(sys.argv[1])
ss.run("v{1000.0} = 1;")
memory = ss2sql.connect()
child = os.fork()
if not child:
    assert memory.eval("1 + 1;") == 2
    try:
        ss.run("v{1000.0} = 2;")
    except ss2sql.SessionError as error:
        ss.close()
        memory.close()
        os._exit(7 if error.code == "S004" else 1)
    os._exit(2)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
ss.run("v{1000.0} = 3;")
assert ss.eval("v{};")[:1] == [3] or ss.eval("v{};")[-1:] == [3]
"""


def test_a_copy_of_the_process(file: Path) -> None:
    subprocess.run([sys.executable, "-c", FORK, str(file)], check=True, timeout=60)


# --- memory --------------------------------------------------------------------------------------------


def test_max_rows_ends_what_would_fill_the_memory(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT a.this FROM a = range(100000), b = range(100000);"
    with limited(20):
        assert code_of(lambda: ss.run(script, engine=engine, max_rows=1000)) == "X010"
    assert ss.eval("SELECT this + 1 FROM [1, 2] AS list;") == [2, 3]
