"""`workers`: calls in other processes, with the result, the order and the errors of one process."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import pytest
import worker_functions
from sessions import code_of
from worker_runs import EAGER, declare, graph, processes_of, same

import ss2sql
from ss2sql.runtime.workers import foretelling


@pytest.fixture
def ss(eager: None, ss: ss2sql.Session) -> ss2sql.Session:
    return ss


# --- the same as in one process ------------------------------------------------------------------------

SCRIPTS = {
    "plain": graph(),
    "goals": graph("WHERE is_far(onward(n, this))"),
    "stops": graph(stop="STOP WITH is_far(n) AND is_far(this + n)"),
    "goals that stop": graph("WHERE onward(n, this) < 25", stop="STOP WITH is_far(onward(n, this))"),
    "costs": graph(options="COST weight(n, this)"),
    "chances": graph(options="PROBABILITY weight(n, this) / 2"),
    "one result": graph("WHERE onward(n, this) == 7", options="MAXIMUM 1"),
    "no bound": graph("WHERE onward(n, this) == 7", options="MAXIMUM 1", bound=99),
    "chained": "SELECT this, n FROM [1, 2] WHERE is_far(onward(onward(onward(n, this), this), this)) "
    "START WITH n = 2 CONNECT BY MEMORIZE 4 n = onward(onward(n, this), 1);",
    "sources": "SELECT this FROM neighbours(n) WHERE is_far(this) START WITH n = 2 CONNECT BY MEMORIZE 3 n = this;",
    "sources of sources": "SELECT b.this FROM a = neighbours(n), b = neighbours(a.this) WHERE is_far(b.this) "
    "START WITH n = 2 CONNECT BY MEMORIZE 2 n = b.this;",
    "queries inside": "SELECT this, n FROM [1, 2] WHERE [] == SELECT this FROM [1, 2, 3] WHERE is_far(this + n) "
    "AS list START WITH n = 2 CONNECT BY MEMORIZE 3 n = onward(n, this);",
    "searches inside": "SELECT this, n FROM [1, 2] WHERE 2 < len(SELECT m FROM [1, 2] START WITH m = n "
    "CONNECT BY UNIQUE m = onward(m, this) STOP WITH is_far(m) AS list) "
    "START WITH n = 2 CONNECT BY MEMORIZE 2 n = onward(n, this);",
    "order and limit": "SELECT onward(n, this) FROM [1, 2, 3] "
    "START WITH n = 1 CONNECT BY MEMORIZE 3 n = onward(n, this) ORDER BY weight(n, this) DESC LIMIT 5;",
    "no function on the way": "SELECT this, n FROM [1, 2] WHERE is_far(n) "
    "START WITH n = 2 CONNECT BY MEMORIZE 3 n = n + this;",
    "a partial": "SELECT by_three(n) FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 9 n = by_three(n);",
    "hanoi": "SELECT this, tower FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] "
    "WHERE [[], [], [3, 2, 1]] == move(this, tower) START WITH tower = [[3, 2, 1], [], []] "
    "CONNECT BY MEMORIZE 9 tower = move(this, tower) STOP WITH [] == move(this, tower);",
}  # fmt: skip


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_the_same_result_and_counts(ss: ss2sql.Session, script: str) -> None:
    declare(ss, "onward", "neighbours", "weight", "is_far", "move", "by_three")
    made = same(ss, script)
    if "ORDER BY" not in script:  # which is asked when paths are found, not by a level
        assert made == 0


@pytest.mark.parametrize("function", [worker_functions.Machine(3).onward, worker_functions.Machine(3),
                                      worker_functions.Machine.plain])  # fmt: skip
def test_other_callables(ss: ss2sql.Session, function: Any) -> None:
    declare(ss, onward=function)
    assert same(ss, graph()) == 0


@pytest.mark.parametrize("most", [1, 3, 10_000])
@pytest.mark.parametrize("name", ["odd_results", "printing", "exiting"])
def test_small_blocks_and_all_kinds_of_results(
    ss: ss2sql.Session, name: str, most: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A call that ends the interpreter is made here."""
    monkeypatch.setattr(foretelling, "MOST", most)
    declare(ss, onward=getattr(worker_functions, name))
    script = "SELECT onward(n, this), this FROM range(7) START WITH n = 1 CONNECT BY MEMORIZE 2 n = n + this;"
    same(ss, script)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("limit", [0, 1, 7])
def test_a_memo_that_is_full(ss: ss2sql.Session, limit: int) -> None:
    declare(ss, "onward", "is_far")
    script = graph("WHERE is_far(onward(n, this))")
    expected = ss.run(script).value
    ss.host.memo_limit = limit
    with pytest.warns(ss2sql.WorkersWarning) if limit == 0 else warnings.catch_warnings():
        assert ss.run(script, workers=2).value == expected


def test_several_statements_and_runs_share_the_processes(ss: ss2sql.Session) -> None:
    declare(ss, "onward", "is_far")
    script = "a = " + graph("WHERE is_far(onward(n, this))") + graph(bound=2)
    same(ss, script)
    crew = processes_of(ss)
    same(ss, script)
    assert len(crew) == 2
    assert crew == processes_of(ss)
    ss.run(script, workers=1)
    ss.run(script, workers=3)
    assert len(processes_of(ss)) == 3
    assert all(os.getsid(process.pid) != os.getsid(0) for process in processes_of(ss))  # out of the terminal's reach


def test_a_run_inside_of_a_run(ss: ss2sql.Session) -> None:
    declare(ss, "onward", "is_far")

    def inner(state: int) -> int:
        return len(ss.run(graph(), workers=2, n=state).paths)

    ss.function("inner", inner, volatility="immutable")
    script = graph("WHERE inner(is_far(n)) > 0")
    expected = ss.run(script).value
    with pytest.warns(ss2sql.WorkersWarning, match="'inner' is called in this process only"):
        assert ss.run(script, workers=2).value == expected


# --- errors --------------------------------------------------------------------------------------------


def outcome(session: ss2sql.Session, script: str, workers: int) -> tuple[str, ...]:
    with pytest.raises(Exception) as caught:  # noqa: PT011 - of whatever kind, it is compared
        session.run(script, workers=workers)
    error = caught.value
    return type(error).__name__, str(error), *getattr(error, "__notes__", ())


@pytest.mark.parametrize(("name", "kind"), [("failing", "LookupError"), ("not_a_number", "ExecutionError")])
def test_errors_are_raised_here_at_their_places(ss: ss2sql.Session, name: str, kind: str) -> None:
    declare(ss, "is_far", onward=getattr(worker_functions, name))
    script = graph("WHERE is_far(onward(n, this))", bound=9)
    assert outcome(ss, script, 1) == outcome(ss, script, 2)
    assert outcome(ss, script, 1)[0] == kind
    assert same(ss, "SELECT onward(n, this) FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 1 n = n;") == 0


def test_what_raises_behind_the_last_result_is_not_raised(ss: ss2sql.Session) -> None:
    declare(ss, onward=worker_functions.failing)
    script = (
        "SELECT onward(n, this) FROM [1, 2] WHERE this == 1 "
        "START WITH n = 16 CONNECT BY MEMORIZE 1 n = n STOP WITH this == 2;"
    )
    assert outcome(ss, script, 1) == outcome(ss, script, 2)
    lazy = "SELECT this FROM [1, 2] WHERE this == 1 OR onward(n, 3) == 2 START WITH n = 16 CONNECT BY MEMORIZE 1 n = n;"
    same(ss, lazy)


ENDINGS = {"deadly": "was killed by signal 9", "leaving": "has ended with exit code 3"}


@pytest.mark.parametrize(("name", "ending"), ENDINGS.items())
def test_a_process_that_dies_is_an_error(ss: ss2sql.Session, name: str, ending: str) -> None:
    declare(ss, onward=getattr(worker_functions, name))
    expected = ss.run(graph()).value
    with pytest.raises(ss2sql.ExecutionError, match=f"a worker {ending} while it called 'onward'") as caught:
        ss.run(graph(), workers=2)
    assert caught.value.code == "X013"
    assert caught.value.span is not None
    assert caught.value.hints
    assert ss.run(graph()).value == expected
    declare(ss, "onward")
    same(ss, graph())
    for process in processes_of(ss):  # while they are idle
        process.kill()
        process.wait()
    assert code_of(ss.run, graph(), workers=2) == "X013"
    assert same(ss, graph()) == 0


# --- how runs end before their time, and no process outlives its session or its program -----------------


@pytest.mark.usefixtures("usual")
@pytest.mark.parametrize("way", ["timeout", "interrupt", "Ctrl-C"])
def test_what_ends_a_run_ends_the_processes(ss: ss2sql.Session, way: str) -> None:
    declare(ss, "onward")
    same(ss, graph())
    before = processes_of(ss)
    declare(ss, onward=worker_functions.endless)  # a call takes a minute
    press = {"interrupt": ss.interrupt, "Ctrl-C": lambda: os.kill(os.getpid(), signal.SIGINT)}.get(way, int)
    timer = threading.Timer(0.5, press)
    timer.start()
    started = time.monotonic()
    with pytest.raises(ss2sql.Timeout if way == "timeout" else ss2sql.Cancelled) as caught:
        ss.run(graph(), workers=2, timeout=0.3 if way == "timeout" else None)
    assert time.monotonic() - started < 5
    timer.join()
    assert caught.value.partial.status == ("timeout" if way == "timeout" else "cancelled")
    assert None not in [process.returncode for process in before]
    assert processes_of(ss) == []
    declare(ss, "onward")
    same(ss, graph())


def test_closed_and_forgotten_sessions_leave_no_process(eager: None) -> None:
    left = []
    for forget in (False, True):
        session = ss2sql.connect()
        declare(session, "onward")
        same(session, graph())
        left += processes_of(session)
        if forget:
            del session
            gc.collect()
        else:
            session.close()
    assert len(left) == 4
    assert None not in [process.returncode for process in left]


KILLED = f"""
import os, signal, worker_functions
ss = ss2sql.connect()
ss.function("onward", worker_functions.onward, volatility="immutable")
ss.run({graph()!r}, workers=2)
print(*(process.pid for process in ss.host.processes._crew.processes), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_end_with_a_program_that_is_killed() -> None:
    folders = [str(Path(__file__).parent), str(Path(ss2sql.__file__).parents[1])]
    named = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    command = [sys.executable, "-c", EAGER + KILLED]
    done = subprocess.run(command, env=named, capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGKILL, done.stderr
    left = [int(pid) for pid in done.stdout.split()]
    assert len(left) == 2
    for _ in range(500):
        left = [pid for pid in left if _is_alive(pid)]
        if not left:
            break
        time.sleep(0.01)
    assert left == []


def _is_alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
