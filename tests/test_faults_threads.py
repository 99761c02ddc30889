"""Other threads, and copies of the process, that come at any moment of a run: at its n-th line of Python."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import apsw
import pytest
from faulty import WANTED, amounts, attempt, check_idle
from faulty_files import is_whole
from faulty_worlds import Lives, Mishaps
from interrupting import at_line
from remembering import MAZE, near
from sessions import both, code_of

import ss2sql

SCRIPTS = {
    "flat": "SELECT f(this) + x FROM t AS list;",
    "native": "SELECT f(this) + x FROM t AS list;",
    "world": "SELECT n, x FROM things WHERE x > 2 ORDER BY -x AS rows;",
    "search": "SELECT n FROM t START WITH n = 0 CONNECT BY NO CYCLE MAXIMUM 20 n = f(n) + this STOP WITH n > 9;",
    "memorize": MAZE.replace("goal", "6").replace("bound", "4").replace("first", "1").replace("limit", "40"),
    "statements": "y = f(1); v{5.0} = y; SELECT this + y FROM t AS list;",
}


def meanwhile(work: Callable[[], object]) -> None:
    """Does something in another thread, and waits for it."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(30)
    assert not thread.is_alive(), "both threads wait for each other"


def uses(ss: ss2sql.Session) -> list[Exception | None]:
    """How all uses of a session end."""
    calls = (lambda: ss.eval("SELECT this FROM [1] AS list;"), lambda: ss.set("x", 5), ss.tables,
             lambda: ss.attach("more", [1]), lambda: ss.function("g", abs), ss.graphs)  # fmt: skip
    return [attempt(call) for call in calls]


def copy(ss: ss2sql.Session, children: list[int]) -> None:
    """A copy of the process, which lets the session go, and harms nothing.

    To go on with the run is not for it: where it was made in a function that SQLite has called, Python itself stands
    still when that returns.
    """
    in_file = bool(ss.host.connection.filename)
    children.append(os.fork())
    if not children[0]:
        code = "none"
        try:
            code = getattr(attempt(lambda: ss.set("x", 6)), "code", code) if in_file else "S004"
            ss.close()
        finally:
            os._exit(7 if code == "S004" else 1)


HAPPENS: dict[str, Callable[[ss2sql.Session, list[Any]], object]] = {
    "use": lambda ss, seen: meanwhile(lambda: seen.extend(uses(ss))),
    "interrupt": lambda ss, seen: meanwhile(ss.interrupt),
    "close": lambda ss, seen: meanwhile(ss.close),
    "copy": copy,
}


@amounts(1, 10)
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
@pytest.mark.parametrize("script", SCRIPTS)
@pytest.mark.parametrize("what", HAPPENS)
def test_at_any_moment_of_a_run(tmp_path: Path, script: str, what: str, amount: int | None) -> None:
    file = tmp_path / "data.db" if script in ("memorize", "statements") else None
    dice, lines = Random(f"{WANTED} {script} {what}"), 0
    for number in range((amount or 300) + 1):  # the first time nothing happens
        ss = ss2sql.connect(file)
        ss.function("f", lambda x: x + 1, volatility="stable")
        ss.function("near", near)
        ss.attach("t", list(range(12)))
        ss.attach("things", Mishaps(Lives()))
        ss.set("x", 5)

        values, seen = list[Any](), list[Any]()

        def work(ss: ss2sql.Session = ss, values: list[Any] = values) -> None:
            values.append(ss.run(SCRIPTS[script], engine="native" if script == "native" else "auto").value)

        work()
        moment = dice.randint(1, lines) if number else 0
        error, count = at_line(moment, work, lambda _, ss=ss, seen=seen: HAPPENS[what](ss, seen))  # type: ignore[misc]
        lines = lines or count
        if not number or what in ("use", "copy"):
            assert error is None
        if error is not None:
            assert isinstance(error, ss2sql.Cancelled) or (what, code_of(ss.run, "1;")) == ("close", "S001"), error
        if number and what == "use":  # before it has its turn and after that the run is not in the way
            assert len(seen) == 6
            assert {getattr(error, "code", error) for error in seen} <= {None, "S004"}
        if number and what == "copy":
            assert os.waitstatus_to_exitcode(os.waitpid(seen[0], 0)[1]) == 7
        if not number or what != "close":
            work()
            check_idle(ss)
            ss.close()
        assert values == [values[0]] * len(values)
        assert code_of(ss.run, "1;") == "S001"
        assert file is None or is_whole(file)


@both
def test_in_a_function_other_threads_may_only_close(ss: ss2sql.Session, engine: Any) -> None:
    seen: list[Any] = []

    def ask(x: int) -> int:
        meanwhile(ss.close if x == 3 else lambda: seen.extend(uses(ss)))
        return x + 1

    ss.function("ask", ask, volatility="volatile")
    assert ss.run("SELECT ask(this) FROM [1, 2] AS list;", engine=engine).value == [2, 3]
    assert [error.code for error in seen] == ["S004"] * 12
    assert ss.variables() == {}
    ss.set("x", 5)
    meanwhile(lambda: seen.append(ss.eval("x;")))
    assert seen[-1] == 5
    with pytest.raises(ss2sql.Cancelled) as caught:
        ss.run("SELECT ask(this) FROM range(3, 1000) AS list;", engine=engine)
    assert isinstance(caught.value.partial, ss2sql.Result)
    assert code_of(ss.run, "1;") == "S001"
    with pytest.raises(apsw.ConnectionClosedError):
        ss.host.connection.execute("SELECT 1")


@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
def test_a_copy_of_the_process_between_two_runs(file: Path) -> None:
    with ss2sql.connect(file) as ss, ss2sql.connect() as memory:
        ss.run("v{1000.0} = 1;")
        child = os.fork()
        if not child:
            code = 1
            try:
                assert memory.eval("1 + 1;") == 2
                code = 7 if code_of(ss.run, "v{1000.0} = 2;") == "S004" else 2
                ss.close()
                memory.close()
            finally:
                os._exit(code)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        ss.run("v{1000.0} = 3;")
        assert ss.eval("v{};") == [1, 3]
