"""What sessions leave behind: no memory and no open files, and nothing of what was attached or compiled in them."""

from __future__ import annotations

import gc
import resource
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas
import pytest
from faulty import amounts, attempt
from faulty_files import handles
from faulty_worlds import Lives, Mishaps
from remembering import near, run
from sessions import ENGINES, write

import ss2sql

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="there is no /proc")
MOST = 10_000_000  # bytes that the process may grow by
SCRIPTS = (
    "SELECT f(this) FROM t WHERE f(this) > 48 AS list;",
    "SELECT n, x, mass FROM things WHERE x > 2 AS rows;",
    "SELECT n FROM things START WITH s = 0 CONNECT BY NO CYCLE MAXIMUM 20 s = s + n STOP WITH s > 9;",
    "SELECT (SELECT b.this FROM b = t WHERE b.this < a.this AS list) FROM a = t AS list;",
    "x = SELECT sum(this) FROM t GROUP BY this % 3 AS list; v{5.0} = x;",
    "SELECT this FROM t AS mine;",
)


def resident() -> int:
    """The memory of the process, in bytes."""
    with Path("/proc/self/statm").open() as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def repeat(work: Callable[[int], Any], times: int) -> None:
    """Does work so often; the process must not grow by more than it may, nor have more open files.

    What Python and SQLite keep for themselves they have after some times.
    """
    for number in range(min(60, times // 2)):
        work(number)
    gc.collect()
    start, files = resident(), handles()
    for number in range(times):
        work(number)
    gc.collect()
    assert resident() - start < MOST
    assert handles() == files


@amounts(8, 100)
def test_sessions_leave_nothing(file: Path, amount: int | None) -> None:
    left: weakref.WeakSet[Any] = weakref.WeakSet()

    def fail(x: int) -> int:
        raise ValueError("no")

    def use(number: int) -> None:
        ss = ss2sql.connect(file if number % 4 == 0 else None)
        source = Lives()
        left.update((ss, ss.host, source))
        ss.function("f", lambda x: x + 1, volatility="stable")
        ss.function("near", near)
        ss.function("fail", fail)
        ss.function("halt", lambda x: ss.interrupt(), volatility="volatile")
        ss.function("again", lambda x: ss.eval("SELECT this FROM [1, 2] AS list;"), volatility="volatile")
        ss.representation("mine")(lambda table: len(table.rows))
        ss.attach("t", list(range(50)))
        ss.attach("things", Mishaps(source))
        for script in SCRIPTS:
            ss.run(script)
            ss.run(script, engine="native")
        run(ss)
        ss.run("SELECT again(this) FROM [1, 2] AS list;")
        for script in (
            "SELECT f(this) / 0 FROM t;",
            "SELECT fail(this) FROM t;",
            "SELECT halt(this) FROM t;",
            "SELECT",
        ):
            assert attempt(lambda script=script: ss.run(script)) is not None  # type: ignore[misc]
        ss.compile("SELECT f(this) FROM t;").explain()
        if number % 3:
            ss.close()
        else:
            with ss:
                ss.eval("1;")

    repeat(use, amount or 2000)
    assert len(left) == 0


@amounts(40, 400)
def test_what_was_attached_leaves_nothing(ss: ss2sql.Session, file: Path, amount: int | None) -> None:
    write(file, "CREATE TABLE t(x); INSERT INTO t VALUES (1), (2)")
    left: weakref.WeakSet[Any] = weakref.WeakSet()
    makers: tuple[Callable[[], Any], ...] = (
        lambda: Mishaps(Lives()), lambda: [{"x": 1.0}], lambda: file, lambda: pandas.DataFrame({"x": [1.0]}),
    )  # fmt: skip

    def use(number: int) -> None:
        made = makers[number % 4]()
        if isinstance(made, Mishaps):
            left.update((made, made.source))
        ss.attach("s", made)
        for engine in ENGINES:
            ss.run("SELECT x FROM s.t AS list;" if made is file else "SELECT x FROM s AS list;", engine=engine)  # type: ignore[arg-type]
        if number % 8 < 4:  # else the next one takes its place
            ss.detach("s")

    ss.attach("s", 1)
    repeat(use, amount or 2000)
    ss.attach("s", 1)
    gc.collect()
    assert len(left) == 0
    assert not ss.host.database.worlds.tables
    assert not ss.host.tables.files


@amounts(100, 2000)
def test_scripts_leave_nothing(ss: ss2sql.Session, amount: int | None) -> None:
    ss.function("f", lambda x: x + 1, volatility="stable")
    ss.function("halt", lambda x: ss.interrupt() if x == 30 else x, volatility="volatile")
    left: weakref.WeakSet[Any] = weakref.WeakSet()
    partial: list[weakref.ref[Any]] = []
    search = ss.compile("SELECT n FROM [1] WHERE n == 2000 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 2000;")

    def use(number: int) -> None:
        cancelled: Any = attempt(lambda: ss.run("SELECT halt(this) FROM range(100);"))
        left.add(cancelled)
        partial.append(weakref.ref(cancelled.partial))
        script = f"SELECT f(this) + {number} FROM [1, 2] WHERE this > {number % 2} AS list;"
        query = ss.compile(script, ENGINES[number % 2])  # type: ignore[arg-type]
        if number % 4 == 0:
            assert query.run().value
        left.add(query)
        assert len(search.run(engine=ENGINES[number % 2]).paths[0]) == 2000  # type: ignore[arg-type]

    repeat(use, amount or 20_000)
    assert len(left) == 0
    assert [one for one in partial if one() is not None] == []
