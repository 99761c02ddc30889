"""Ctrl-C and `interrupt` at any moment: the run is cancelled, what was found is there, the session is as it was."""

from __future__ import annotations

import gc
import inspect
import json
import signal
import subprocess
import sys
import threading
import traceback
from pathlib import Path
from random import Random
from typing import Any

import interrupting
import pytest
from interrupting import KINDS, NumberWorld, check_session, press_at
from sessions import write

import ss2sql
from ss2sql.runtime.run import run_state
from ss2sql.runtime.sqlite import database_tables
from ss2sql.runtime.sqlite.database_tables import Tables

pytestmark = pytest.mark.usefixtures("usual")
SLOW = pytest.mark.slow
SIX = ("sql", "function", "world", "native", "memorize", "parallel")


def press(*_: Any) -> None:
    signal.raise_signal(signal.SIGINT)


def cancelled(ss: ss2sql.Session, script: str, engine: Any = "auto") -> ss2sql.Cancelled:
    """How a run ends."""
    with pytest.raises(ss2sql.Cancelled) as caught:
        ss.run(script, engine=engine)
    return caught.value


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("presses", "kinds"), [(5, SIX), *(pytest.param(100, [n], marks=SLOW) for n in KINDS)])
def test_of_a_hundred_runs_a_hundred_are_cancelled(tmp_path: Path, presses: int, kinds: Any) -> None:
    program = [sys.executable, interrupting.__file__, str(tmp_path), str(presses), "1", *kinds]
    done = subprocess.run(program, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")
    assert [json.loads(line) for line in done.stdout.splitlines()] == [[kind, presses] for kind in kinds]


HOP = "SELECT hop(n, this) FROM [1, 2, 3] START WITH n = 1, level = 1"
LITTLE = {
    "flat": "SELECT a.this, b.this FROM a = range(4), b = range(5) WHERE a.this <> b.this ORDER BY b.this AS rows;",
    "search": f"{HOP} CONNECT BY NO CYCLE n = hop(n, this), level = level + 1 STOP WITH level == 3;",
    "memorize": f"{HOP} CONNECT BY MEMORIZE 3 n = hop(n, this), level = level + 1;",
    "statements": "x = SELECT hop(this, 1) FROM range(9) AS list; y{3.0} = len(x); SELECT this FROM x;",
    "world": "SELECT n, square FROM numbers WHERE n < 9;",
}


@pytest.mark.parametrize("presses", [3, pytest.param(20, marks=SLOW)])
@pytest.mark.parametrize("name", LITTLE)
def test_at_any_line(file: Path, engine: Any, name: str, presses: int) -> None:
    if (name, engine) == ("memorize", "database"):
        engine = "auto"
    dice = Random(1)
    with ss2sql.connect(file) as ss:
        ss.function("hop", interrupting.hop, volatility="immutable")
        ss.attach("numbers", NumberWorld())
        query = ss.compile(LITTLE[name], engine=engine)
        answer = ss.run(LITTLE[name], engine=engine).value
        for work in (lambda: ss.run(LITTLE[name], engine=engine), query.run):
            ss.graphs().drop()
            _, lines = press_at(0, work)
            for line in sorted(dice.sample(range(40, lines - 20), presses)):
                ss.graphs().drop()
                error, reached = press_at(line, work)
                if error is None:  # a run has more lines or fewer, as some things are done every few milliseconds
                    assert line > max(reached, lines - 200) - 20
                    continue
                assert isinstance(error, ss2sql.Cancelled), line
                assert error.partial is None or error.partial.status == "cancelled"
                check_session(ss)
                assert query.run().value == ss.run(LITTLE[name], engine=engine).value == answer, line


def test_a_compiled_script_that_was_being_made_anew(ss: ss2sql.Session) -> None:
    ss.set("x", [1, 2])
    query = ss.compile("SELECT this + 1 FROM x WHERE this IN x AS list;")
    assert query.run().value == [2, 3]
    for line in range(1, 6_000, 500):
        ss.set("x", [1, 2])
        assert query.run().value == [2, 3]
        ss.set("x", [0.5, 4, 5])
        error, _ = press_at(line, query.run)
        assert error is None or isinstance(error, (ss2sql.Cancelled, KeyboardInterrupt))
        assert query.run().value == [1.5, 5, 6]


@pytest.mark.parametrize("answer", ["none", "go on", "raise"])
def test_a_function_cannot_hold_the_run_up(ss: ss2sql.Session, engine: Any, answer: str) -> None:
    """It ends at once; where it catches Ctrl-C, its call is the last one."""
    went_on = []

    def stubborn(x):
        try:
            press()
        except KeyboardInterrupt:
            if answer == "none":
                raise
            if answer == "raise":
                raise ValueError("what?") from None
        went_on.append(x)
        return x

    ss.function("stubborn", stubborn, volatility="stable")
    error = cancelled(ss, "SELECT stubborn(this) FROM range(5);", engine)
    assert isinstance(error.__cause__, ValueError) == (answer == "raise")
    assert went_on == ([0] if answer == "go on" else [])
    if answer == "none":
        assert list(error.partial) == []
    check_session(ss)


class Pressing:
    """An object whose end is the moment when Ctrl-C is pressed."""

    def __del__(self) -> None:
        press()


def in_the_collector() -> None:
    def callback(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            press()

    gc.callbacks.append(callback)
    try:
        gc.collect()
    finally:
        gc.callbacks.remove(callback)


@pytest.mark.parametrize("moment", [Pressing, in_the_collector])
def test_where_python_forgets_errors_none_is_raised(ss: ss2sql.Session, engine: Any, moment: Any) -> None:
    @ss.function(volatility="stable")
    def step(x: int) -> int:
        if x == 3:
            moment()  # an error there would be printed and forgotten, which pytest counts as one of its own
        return x

    partial = cancelled(ss, "SELECT step(this) FROM range(20000) AS list;", engine).partial
    assert partial is None or len(partial) < 20000


def test_no_generator_is_left_for_python_to_close(ss: ss2sql.Session) -> None:
    """Closed later, or where Ctrl-C is not noted, it would lose KeyboardInterrupt."""
    namespace: dict[str, Any] = {}
    exec("def generated(look): yield look()", namespace)
    assert next(namespace["generated"](lambda: run_state.can_interrupt(sys._getframe(1)))) is False

    @ss.function(volatility="stable")
    def hop(n: int, step: int) -> int:
        if n == 5:
            press()
        return n + step

    script = "SELECT this FROM [1] START WITH n = 1 CONNECT BY n = hop(n, this);"
    error = cancelled(ss, script, "native")
    raised = [error, error.__context__]
    frames = [frame for one in raised if one is not None for frame, _ in traceback.walk_tb(one.__traceback__)]
    assert [value for frame in frames for value in frame.f_locals.values() if inspect.isgenerator(value)] == []


def test_runs_inside_of_runs_end_together(ss: ss2sql.Session, engine: Any) -> None:
    other = ss2sql.connect()
    other.function("press", press, volatility="stable")
    inner = []

    def call(x):
        inner.append(cancelled(other, "SELECT press(this) FROM [1];", engine).partial.status)
        return x

    ss.function("call", call, volatility="stable")
    cancelled(ss, "SELECT call(this) FROM [1, 2];", engine)
    assert inner == ["cancelled"]
    check_session(ss)
    check_session(other)
    other.close()


def test_handlers_of_others_stay(ss: ss2sql.Session) -> None:
    """That of the program, which hears Ctrl-C, and one that a function sets; other threads leave it alone."""
    pressed: list[Any] = []
    signal.signal(signal.SIGINT, lambda *_: pressed.append(1))
    ss.function("press", press)
    assert ss.eval("SELECT press(this) FROM [1, 2] AS list;") == [None, None]
    assert pressed == [1, 1]
    ss.function("set_one", lambda x: signal.signal(signal.SIGINT, pressed.append) and None, volatility="volatile")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    ss.function("look", lambda x: pressed.append(signal.getsignal(signal.SIGINT)), volatility="volatile")
    thread = threading.Thread(target=lambda: ss.run("look(1);"))
    thread.start()
    thread.join()
    assert pressed[2:] == [signal.default_int_handler]
    ss.run("set_one(1);")
    assert signal.getsignal(signal.SIGINT) == pressed.append


def test_pressed_again_it_ends_the_run_wherever_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = sys._getframe()
    monkeypatch.setattr(run_state, "can_interrupt", lambda frame: False)
    with run_state.defer_keyboard_interrupt(None):
        handler: Any = signal.getsignal(signal.SIGINT)
        handler(signal.SIGINT, frame)
        handler(signal.SIGINT, frame)  # at once: a nervous finger
        monkeypatch.setattr(run_state, "PATIENCE_SECONDS", -1)
        with pytest.raises(KeyboardInterrupt):
            handler(signal.SIGINT, frame)
        run_state._ctrl_c.pressed = None


def test_what_is_no_run_is_finished_first(file: Path, staff: Path) -> None:
    world = NumberWorld()
    for line in range(1, 1500, 100):
        ss = ss2sql.connect()
        press_at(line, lambda ss=ss: ss.attach("numbers", world))
        here = ss.host.names.worlds.keys()
        assert here == {"numbers"} if ss.host.world_functions else not here
        assert ("numbers" in ss.tables()) == bool(here)
        press_at(line % 60 + 1, lambda ss=ss: ss.attach("data", staff))
        assert ("data.staff" in ss.tables()) == ("data" in ss.host.tables.files)
        press_at(line % 200 + 1, ss.close)
        ss.close()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_reading_a_large_table_to_compile_can_be_interrupted(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = "WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t LIMIT 20000) SELECT n FROM t"
    write(file, f"CREATE TABLE big AS {numbers}")
    with ss2sql.connect(file) as ss:
        read = Tables._find_indexes
        monkeypatch.setattr(Tables, "_find_indexes", lambda *arguments: ss.interrupt() or read(*arguments))
        monkeypatch.setattr(
            database_tables, "_find_sqlite_bounds", None
        )  # kinds of values come first, in 60,000 steps of SQLite
        assert cancelled(ss, "SELECT n FROM big;").partial is None
        monkeypatch.undo()
        assert len(ss.run("SELECT n FROM big;")) == 20_000


def test_the_partial_result_is_that_of_the_statement_that_ran(ss: ss2sql.Session) -> None:
    ss.function("stop", lambda x: ss.interrupt(), volatility="volatile")
    assert cancelled(ss, "SELECT this FROM [1, 2]; stop(1); SELECT this FROM [3];").partial is None
    error = cancelled(ss, "SELECT this FROM [1, 2]; SELECT stop(this), this FROM [3, 4];", "native")
    assert error.partial.columns == ("stop", "this")
    ss.representation("late")(lambda table: ss.interrupt())
    error = cancelled(ss, "SELECT this FROM [3, 1, 2] ORDER BY this AS late;")
    assert list(error.partial) == [(1,), (2,), (3,)]  # what is finished, though the press came late
