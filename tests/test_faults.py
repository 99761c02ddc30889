"""Functions and worlds that raise, return garbage, use their session again or close it, at the k-th call of each."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import apsw
import numpy as np
import pytest
from faulty import ALL, CLAUSES, WANTED, Caller, amounts, attempt, check_idle
from faulty_files import is_whole
from faulty_worlds import LONG, SCRIPTS, Inhabitant, Lives, Mishaps
from interrupting import at_line
from level_searches import ended
from remembering import MAZE, near
from sessions import code_of

import ss2sql


@amounts(2, 12)  # 45 ms each
@pytest.mark.parametrize("volatility", ["volatile", "stable"])
@pytest.mark.parametrize("engine", ["auto", "native"])
@pytest.mark.parametrize("clause", CLAUSES)
def test_faults_of_functions(clause: str, engine: Any, volatility: Any, amount: int | None) -> None:
    patient = Caller(clause, engine, volatility)
    most = min(patient.calls + 1, 40)  # one more than there are: nothing happens
    patient.endure(amount, lambda dice: [*range(1, most + 1)] if ALL else [dice.choice((1, 2, dice.randint(1, most)))])


@amounts(2, 12)  # 25 ms each
@pytest.mark.parametrize(("site", "script"), [(site, script) for site in SCRIPTS for script in SCRIPTS[site]])
def test_faults_of_worlds(site: str, script: str, engine: Any, amount: int | None) -> None:
    moves = "push" in script or site == "time"  # which the database alone leaves to Python
    patient = Inhabitant(site, script, "auto" if moves and engine == "database" else engine)
    most = patient.calls
    patient.endure(amount, lambda dice: sorted({1, 2, 3, most}) if ALL else [dice.choice((1, 2, most))])


def test_a_function_registered_anew_by_itself(ss: ss2sql.Session) -> None:
    def first(x: int) -> int:
        ss.function("f", second, volatility="stable")
        with pytest.raises(ss2sql.SessionError, match=r"S004.*registered anew while a query runs"):
            ss.run("SELECT f(this) FROM [1, 2] AS list;", engine="database")
        return x

    def second(x: int) -> int:
        return -x

    ss.function("f", first, volatility="stable")
    assert ss.run("SELECT f(this) FROM [1] AS list;", engine="database").value == [1]
    for engine in ("database", "native"):
        assert ss.run("SELECT f(this) FROM [1, 2] AS list;", engine=engine).value == [-1, -2]


# --- what worlds may give ------------------------------------------------------------------------------


@pytest.fixture
def break_once(ss: ss2sql.Session) -> Callable[..., None]:
    """Attaches a world in which one method goes wrong in its k-th call."""

    def attach(site: str, wrong: Callable[[Any], Any], k: int = 1) -> None:
        source = Lives(site)
        source.wrong, source.left = wrong, k
        ss.attach("things", Mishaps(source))

    return attach


def raising(error: Exception) -> Callable[[Any], Any]:
    def fail(_: Any) -> Any:
        raise error

    return fail


@pytest.mark.parametrize(
    ("site", "script", "value", "code", "words"),
    [("keys", "SELECT n FROM things AS list;", [[1]], "X011", "which cannot be hashed"),
     ("keys", "SELECT n FROM things AS list;", [1, {}], "X011", "which cannot be hashed"),
     ("keys", "SELECT n FROM things AS list;", np.arange(4).reshape(2, 2), "X011", "which cannot be hashed"),
     ("keys", "SELECT n FROM things AS list;", [10**5000], "X004", ""),
     ("mass", "SELECT mass FROM things AS list;", None, "X011", ""),  # an array without end
     ("size", "SELECT size FROM things AS list;", None, "X011", ""),
     *(("time", "SELECT getTime() FROM [1] AS list;", moment, "X004", "which is no time")
       for moment in (float("nan"), "noon", [1], 10**400))],
    ids=range(10),
)  # fmt: skip
def test_garbage_of_worlds(
    ss: ss2sql.Session, break_once: Any, engine: Any, site: str, script: str, value: Any, code: str, words: str
) -> None:
    break_once(site, lambda _: map(float, range(LONG)) if value is None else value)
    if site == "time" and engine == "database":
        engine = "auto"
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == code
    assert words in caught.value.message
    if "hashed" in words:
        assert isinstance(caught.value.__cause__, TypeError)
    if site == "time":
        ss.detach("things")
        ss.function("getTime", lambda: value)
        with pytest.raises(ss2sql.ExecutionError, match="the function 'getTime' says"):
            ss.run("v{5.0} = 1;", engine=engine)


@pytest.mark.parametrize(
    ("site", "script"),
    [("keys", "SELECT n FROM things;"), ("near", "SELECT n FROM things.near(1);"),
     ("beside", "SELECT m FROM things.beside(1);")],
)  # fmt: skip
def test_a_walk_without_end_can_be_ended(
    ss: ss2sql.Session, break_once: Any, engine: Any, site: str, script: str
) -> None:
    given: list[int] = []

    def endless(_: Any) -> Any:
        for number in range(LONG):
            given.append(number)
            if number == 1500:
                ss.interrupt()
            yield (number, number) if site == "beside" else number

    break_once(site, endless)
    with pytest.raises(ss2sql.Cancelled):
        ss.run(script, engine=engine)
    assert len(given) < 3000
    assert ss.eval("len(SELECT n FROM things);") == 12


@pytest.mark.parametrize("engine", ["auto", "native"])
def test_a_world_that_leaves_while_its_function_runs(ss: ss2sql.Session, break_once: Any, engine: Any) -> None:
    break_once("keys", lambda value: (ss.detach("things"), value)[1])
    assert code_of(ss.run, "SELECT push(this), x FROM things AS rows;", engine=engine) in ("X011", "X008")
    assert ss.tables() == {}


class MuteError(Exception):
    def __str__(self) -> str:
        raise ValueError


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (OSError("it is gone"), "it is gone"),
        (MuteError(), r"things\[0\] cannot be read: MuteError"),
    ],
    ids=["told", "mute"],
)
def test_errors_tell_what_the_world_has_raised(
    ss: ss2sql.Session, break_once: Any, engine: Any, raised: Exception, words: str
) -> None:
    break_once("color", raising(raised))
    with pytest.raises(ss2sql.ExecutionError, match=words) as caught:
        ss.run("SELECT color FROM things;", engine=engine)
    assert (caught.value.code, type(caught.value.__cause__)) == ("X011", type(raised))


WAITING = (
    "SELECT s FROM things START WITH s = 0.0 CONNECT BY NO CYCLE MAXIMUM 5 s = s + x STOP WITH s > 6;",
    "SELECT 1 / (4 - s) FROM frame START WITH s = 0 CONNECT BY UNIQUE MAXIMUM 5 s = s + 1 STOP WITH 1 / (4 - s) > 6;",
)


@pytest.mark.parametrize("script", WAITING)
def test_a_condition_that_waits_for_a_copied_source(ss: ss2sql.Session, script: str) -> None:
    """A search reads such a source from a copy, which has to have the column that the condition waits for."""
    pd = pytest.importorskip("pandas")
    ss.attach("things", Mishaps(Lives()))
    ss.attach("frame", pd.DataFrame({"x": [0.0, 1.0, 2.0]}))
    code = ended(ss, script, engine="database")[0]
    assert code == ended(ss, script, engine="native")[0] != "X009"


# --- other threads, and copies of the process, at any moment of a run: at its n-th line of Python --------------

RUNS = {
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
@pytest.mark.parametrize("script", RUNS)
@pytest.mark.parametrize("what", HAPPENS)
def test_at_any_moment_of_a_run(tmp_path: Path, script: str, what: str, amount: int | None) -> None:
    file = tmp_path / "data.db" if script in ("memorize", "statements") else None
    dice, lines = Random(f"{WANTED} {script} {what}"), 0
    for number in range(-1, (amount or 300) + 1):  # the first time loads modules, the second one counts lines
        ss = ss2sql.connect(file)
        ss.function("f", lambda x: x + 1, volatility="stable")
        ss.function("near", near)
        ss.attach("t", list(range(12)))
        ss.attach("things", Mishaps(Lives()))
        ss.set("x", 5)

        values, seen = list[Any](), list[Any]()

        def work(ss: ss2sql.Session = ss, values: list[Any] = values) -> None:
            values.append(ss.run(RUNS[script], engine="native" if script == "native" else "auto").value)

        work()
        quiet = number < 1
        moment = 0 if quiet else dice.randint(1, lines)
        error, count = at_line(moment, work, lambda _, ss=ss, seen=seen: HAPPENS[what](ss, seen))  # type: ignore[misc]
        lines = count if quiet else lines
        if quiet or what in ("use", "copy"):
            assert error is None
        if error is not None:
            assert isinstance(error, ss2sql.Cancelled) or (what, code_of(ss.run, "1;")) == ("close", "S001"), error
        if not quiet and what == "use":  # before it has its turn and after that the run is not in the way
            assert len(seen) == 6
            assert {getattr(error, "code", error) for error in seen} <= {None, "S004"}
        if not quiet and what == "copy":
            assert os.waitstatus_to_exitcode(os.waitpid(seen[0], 0)[1]) == 7
        if quiet or what != "close":
            work()
            check_idle(ss)
            ss.close()
        assert values == [values[0]] * len(values)
        assert code_of(ss.run, "1;") == "S001"
        assert file is None or is_whole(file)


def test_in_a_function_other_threads_may_only_close(ss: ss2sql.Session, engine: Any) -> None:
    seen: list[Any] = []

    def ask(x: int) -> int:
        meanwhile(ss.close if x == 3 else lambda: seen.extend(uses(ss)))
        return x + 1

    ss.function("ask", ask, volatility="stable")
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
