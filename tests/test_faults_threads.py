"""Other threads, and copies of the process, that come at any moment of a run: at its n-th call of a Python function.

By default some moments are tried, drawn with a seed; `SS2SQL_FAULTS=all` tries 300 of each script, and
`SS2SQL_FAULTS=3` draws with another seed.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
from faulty import attempt
from faulty_files import is_whole
from faulty_worlds import Mishaps, Source
from remembering import MAZE, near

import ss2sql

WANTED = os.environ.get("SS2SQL_FAULTS", "1")
MOMENTS = 300 if WANTED == "all" else 3
OWN = str(Path(ss2sql.__file__).parent)
SCRIPTS = {
    "flat": "SELECT f(this) + x FROM t AS list;",
    "native": "SELECT f(this) + x FROM t AS list;",
    "world": "SELECT n, x FROM things WHERE x > 2 ORDER BY -x AS rows;",
    "search": "SELECT n FROM t START WITH n = 0 CONNECT BY NO CYCLE MAXIMUM 20 n = f(n) + this STOP WITH n > 9;",
    "memorize": MAZE.replace("goal", "6").replace("bound", "4").replace("first", "1").replace("limit", "40"),
    "statements": "y = f(1); v{5.0} = y; SELECT this + y FROM t AS list;",
}


def patient(script: str, file: Path | None) -> tuple[ss2sql.Session, Callable[[], Any]]:
    """A session, and a run in it."""
    ss = ss2sql.connect(file)
    ss.function("f", lambda x: x + 1, volatility="stable")
    ss.function("near", near)
    ss.attach("t", list(range(12)))
    ss.attach("things", Mishaps(Source()))
    ss.set("x", 5)
    engine: Any = "native" if script == "native" else "auto"
    return ss, lambda: ss.run(SCRIPTS[script], engine=engine).value


def at_call(work: Callable[[], Any], moment: int, happens: Callable[[], object]) -> tuple[Any, Exception | None, int]:
    """What some work gives, or raises, where something happens in its n-th call of a function of ss2sql; all calls."""
    calls, found = 0, list[Any]()

    def look(frame: Any, event: str, _: Any) -> None:
        nonlocal calls
        if event == "call" and frame.f_code.co_filename.startswith(OWN):
            calls += 1
            if calls == moment:
                happens()

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        error = attempt(lambda: found.append(work()))
    finally:
        sys.setprofile(before)
    return (found or [None])[0], error, calls


def moments(script: str, file: Path | None, what: str) -> list[int]:
    """Where something is to happen."""
    ss, work = patient(script, file)
    with ss:
        work()
        _, error, calls = at_call(work, 0, int)
    assert error is None
    dice = Random(f"{WANTED} {script} {what}")
    return [dice.randint(1, calls) for _ in range(MOMENTS)]


def meanwhile(work: Callable[[], object]) -> None:
    """Does something in another thread, and waits for it."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(30)
    assert not thread.is_alive(), "both threads wait for each other"


@pytest.mark.parametrize("script", SCRIPTS)
def test_another_thread_uses_the_session(tmp_path: Path, script: str) -> None:
    file = tmp_path / "data.db" if script in ("memorize", "statements") else None
    for moment in moments(script, file, "use"):
        ss, work = patient(script, file)
        wanted = work()
        outcomes: list[Exception | None] = []

        def use(ss: ss2sql.Session = ss, outcomes: list[Exception | None] = outcomes) -> None:
            calls = (lambda: ss.eval("SELECT this FROM [1] AS list;"), lambda: ss.set("x", 5), ss.tables,
                     lambda: ss.attach("more", [1]), lambda: ss.function("g", abs), ss.graphs)  # fmt: skip
            outcomes.extend(map(attempt, calls))

        value, error, _ = at_call(work, moment, lambda use=use: meanwhile(use))  # type: ignore[misc]
        assert error is None
        assert value == wanted
        assert len(outcomes) == 6
        for outcome in outcomes:  # before it has its turn and after that the run is not in the way
            assert outcome is None or (isinstance(outcome, ss2sql.SessionError) and outcome.code == "S004"), outcome
        assert work() == wanted
        ss.close()


@pytest.mark.parametrize("script", SCRIPTS)
@pytest.mark.parametrize("ending", ["interrupt", "close"])
def test_another_thread_ends_the_run(tmp_path: Path, script: str, ending: str) -> None:
    file = tmp_path / "data.db" if script in ("memorize", "statements") else None
    for moment in moments(script, file, ending):
        ss, work = patient(script, file)
        wanted = work()
        value, error, _ = at_call(work, moment, lambda ss=ss: meanwhile(getattr(ss, ending)))  # type: ignore[misc]
        if isinstance(error, ss2sql.SessionError):
            assert (ending, error.code) == ("close", "S001")
        else:
            assert isinstance(error, ss2sql.Cancelled) if error else value == wanted
        if ending == "interrupt":
            assert (ss.host.runs, ss.host.begun, ss.host.database.stack) == ([], [], [])
            assert work() == wanted
            ss.close()
        with pytest.raises(ss2sql.SessionError) as caught:
            ss.run("1;")
        assert caught.value.code == "S001"
        assert file is None or is_whole(file)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_copy_of_the_process_in_the_middle_of_a_run(tmp_path: Path, script: str) -> None:
    """The copy lets the session go, and harms nothing. To go on with the run is not for it: where it was made in a
    function that SQLite has called, Python itself stands still when that returns.
    """
    file = tmp_path / "data.db" if script in ("memorize", "statements") else None
    for moment in moments(script, file, "fork"):
        ss, work = patient(script, file)
        wanted = work()
        children: list[int] = []

        def copy(ss: ss2sql.Session = ss, children: list[int] = children) -> None:
            children.append(os.fork())
            if not children[0]:
                code = "none"
                try:
                    code = getattr(attempt(lambda: ss.set("x", 6)), "code", code) if file else "S004"
                    ss.close()
                finally:
                    os._exit(7 if code == "S004" else 1)

        value, error, _ = at_call(work, moment, copy)
        assert error is None
        assert value == wanted
        assert os.waitstatus_to_exitcode(os.waitpid(children[0], 0)[1]) == 7
        assert work() == wanted
        ss.close()
        assert file is None or is_whole(file)
