"""`workers`: calls in other processes, with the result, the order and the errors of one process.

Also where they have no effect or little, and what is said then; scripts and the command line.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import worker_functions
from command_lines import call, good
from golden import each_row
from level_searches import ended
from sessions import code_of

import ss2sql
from ss2sql.runtime.parallel import block_calls, process_pool

GRAPH = """SELECT onward(n, this) FROM [1, 2, 3] {where}
START WITH n = 1 CONNECT BY MEMORIZE {bound} {options} n = onward(n, this) {stop};"""
# How a program in a process of its own begins, so that all calls are worth other processes.
EAGER = """
import ss2sql
from ss2sql.runtime.parallel import block_calls
block_calls.SAMPLES, block_calls.CHEAP, block_calls.LEAST, block_calls.START = 0, 0.0, 0.0, 0.0
block_calls.PATIENCE = 30.0
"""


def declare(session: ss2sql.Session, *names: str, **others: Callable[..., Any]) -> None:
    """Registers functions of worker_functions, and others, as immutable."""
    for name in names:
        session.function(name, getattr(worker_functions, name), volatility="immutable")
    for name, function in others.items():
        session.function(name, function, volatility="immutable")


def graph(where: str = "", options: str = "", stop: str = "", bound: int = 4) -> str:
    return GRAPH.format(where=where, options=options, stop=stop, bound=bound)


def same(session: ss2sql.Session, script: str, **named: Any) -> int:
    """Compares two workers with one, and gives the number of calls that were made here."""
    one = session.run(script, **named)
    worker_functions.MADE.made = 0
    two = session.run(script, workers=2, **named)
    made = worker_functions.MADE.made
    assert repr(two.value) == repr(one.value)
    inside = script.count("START WITH") > 1  # whose steps count as often as they are taken
    for name in () if inside else ("generated", "expanded", "pruned", "levels"):
        assert getattr(two.stats, name) == getattr(one.stats, name), name
    assert one.stats.calls
    assert two.stats.calls >= one.stats.calls  # a few more where steps wait for the result of another function
    assert two.stats.calls.total() <= 1.3 * one.stats.calls.total() or one.stats.calls.total() < 20
    return made


def processes_of(session: ss2sql.Session) -> list[subprocess.Popen[bytes]]:
    pool = session.host.held.processes
    return list(pool.processes) if pool is not None else []


@pytest.fixture
def ss(eager: None, ss: ss2sql.Session) -> ss2sql.Session:
    return ss


# --- the same as in one process ------------------------------------------------------------------------


@each_row("search/with-workers", "script", "here")
def test_the_same_result_and_counts(ss: ss2sql.Session, script: str, here: str) -> None:
    """What ORDER BY asks for is called when paths are found, not by a level."""
    declare(ss, "onward", "neighbours", "weight", "is_far", "move", "by_three")
    made = same(ss, script)
    assert here == "some" or made == 0


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
    monkeypatch.setattr(block_calls, "BLOCK", most)
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


@pytest.mark.parametrize(("name", "kind"), [("failing", "LookupError"), ("not_a_number", "X004")])
def test_errors_are_raised_here_at_their_places(ss: ss2sql.Session, name: str, kind: str) -> None:
    declare(ss, "is_far", onward=getattr(worker_functions, name))
    script = graph("WHERE is_far(onward(n, this))", bound=9)
    assert ended(ss, script, workers=1) == ended(ss, script, workers=2)
    assert ended(ss, script, workers=1)[0] == kind
    assert same(ss, "SELECT onward(n, this) FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 1 n = n;") == 0


def test_what_raises_behind_the_last_result_is_not_raised(ss: ss2sql.Session) -> None:
    declare(ss, onward=worker_functions.failing)
    script = (
        "SELECT onward(n, this) FROM [1, 2] WHERE this == 1 "
        "START WITH n = 16 CONNECT BY MEMORIZE 1 n = n STOP WITH this == 2;"
    )
    assert ended(ss, script, workers=1) == ended(ss, script, workers=2)
    lazy = "SELECT this FROM [1, 2] WHERE this == 1 OR onward(n, 3) == 2 START WITH n = 16 CONNECT BY MEMORIZE 1 n = n;"
    same(ss, lazy)


ENDINGS = {"deadly": "was killed by signal 9", "leaving": "has ended with exit code 3"}


@pytest.mark.parametrize(("name", "ending"), ENDINGS.items())
def test_a_process_that_dies_is_an_error(ss: ss2sql.Session, name: str, ending: str) -> None:
    declare(ss, onward=getattr(worker_functions, name))
    expected = ss.run(graph()).value
    with pytest.raises(ss2sql.ExecutionError, match=f"X013.*a worker {ending} while it called 'onward'") as caught:
        ss.run(graph(), workers=2)
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
    declare(ss, onward=worker_functions.endless)
    press = {"interrupt": ss.interrupt, "Ctrl-C": lambda: os.kill(os.getpid(), signal.SIGINT)}.get(way, int)
    timer = threading.Timer(0.5, press)
    timer.start()
    started = time.monotonic()
    with pytest.raises(ss2sql.Timeout if way == "timeout" else ss2sql.Cancelled) as caught:
        ss.run(graph(), workers=2, timeout=0.3 if way == "timeout" else None)
    assert time.monotonic() - started < 30  # a call takes a minute
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
print(*(process.pid for process in ss.host.held.processes.processes), flush=True)
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


# --- where they have no effect or little ------------------------------------------------------------------


def by_closure(factor: int) -> Callable[[int, int], int]:
    def onward(state: int, element: int) -> int:
        return (int(f"{state}") * factor + element) % 53

    return onward


class Locked:
    """It cannot be pickled."""

    def __init__(self) -> None:
        self.lock = threading.Lock()

    def __call__(self, state: int, element: int) -> int:
        return state + element


STATES = graph("WHERE is_far(n)")  # come from the function; here they do not:
GOALS = "SELECT this, n FROM [1, 2] WHERE onward(n, this) != 9 START WITH n = 1 CONNECT BY MEMORIZE 3 n = n + this;"
IMMUTABLE = {"volatility": "immutable"}
# Functions that other processes cannot have, and why.
KEPT: dict[str, tuple[Any, dict[str, Any], str]] = {
    "has no name in a module; write it at the top of one with def": (
        lambda n, this: int(f"{n}") + this,
        IMMUTABLE,
        STATES,
    ),
    "has no name in a module": (by_closure(7), IMMUTABLE, STATES),
    "cannot be pickled": (Locked(), IMMUTABLE, STATES),
    "returns objects": (worker_functions.decimals, IMMUTABLE, GOALS),
    "is stable: .*; declare it immutable if": (worker_functions.onward, {"volatility": "stable"}, STATES),
    "takes arrays": (lambda n, this: n + this, {"vectorized": True}, GOALS),
}


@pytest.mark.parametrize("reason", KEPT)
def test_functions_that_other_processes_cannot_have(ss: ss2sql.Session, reason: str) -> None:
    function, how, script = KEPT[reason]
    declare(ss, "is_far")
    ss.function("onward", function, **how)
    expected = ss.run(script)
    said = f"^workers: 'onward' is called in this process only: it {reason}"
    with pytest.warns(ss2sql.WorkersWarning, match=said) as caught:
        found = ss.run(script, workers=2)
    assert (len(caught), caught[0].filename) == (1, __file__)
    assert found.value == expected.value
    assert found.stats.calls >= expected.stats.calls
    assert found.stats.notes == [str(caught[0].message)]
    assert found.stats.notes[0] in found.explain()


def test_from_both_ends(ss: ss2sql.Session) -> None:
    ss.function("walk", worker_functions.walk, volatility="immutable", inverse=worker_functions.walk_back)
    script = """SELECT this, n FROM [[1, 2], [2, 3], [3, 5]] WHERE walk(this, n) == 40
        START WITH n = 0 CONNECT BY MEMORIZE 7 n = walk(this, n) STOP WITH walk(this, n) > 40;"""
    assert ss.run(script).stats.backward
    one, two = ss.run(script), ss.run(script, workers=2)
    assert one.value
    assert (two.value, two.stats.calls, two.stats.notes) == (one.value, one.stats.calls, [])


def test_a_remembered_graph(eager: None, tmp_path: Path) -> None:
    scripts = [graph("WHERE onward(n, this) == 7", bound=bound) for bound in (3, 5)]
    with ss2sql.connect() as session:
        declare(session, onward=worker_functions.remembered_onward)
        expected = [session.run(script) for script in scripts]
    calls = [sum(result.stats.calls.values()) for result in expected]
    with ss2sql.connect(tmp_path / "graphs.db") as session:
        declare(session, onward=worker_functions.remembered_onward)
        for script, alone, new in zip(scripts, expected, (calls[0], calls[1] - calls[0]), strict=True):
            first, again = session.run(script, workers=2), session.run(script, workers=2)
            assert processes_of(session)
            assert [sum(result.stats.calls.values()) for result in (first, again)] == [new, 0]
            assert first.value == again.value == alone.value


def test_a_function_that_is_another_one_elsewhere(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    declare(ss, "sized")
    script = "SELECT sized(n, this) FROM [1, 2] START WITH n = 1 CONNECT BY MEMORIZE 9 n = sized(n, this);"
    same(ss, script)
    monkeypatch.setattr(worker_functions, "SIZE", 3)
    assert {row for path in ss.run(script).paths for row in path} == {(0,), (1,), (2,)}
    with pytest.warns(ss2sql.WorkersWarning, match="it is another one in a fresh process"):
        same(ss, script)


IDLE = {
    "SELECT n FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2, n < 9, n = onward(n, 1);": "no effect on a search with",
    "SELECT onward(this, 1) FROM [1, 2];": "no effect: only searches with MEMORIZE have levels",
    "SELECT n FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = onward(n, 1);": "only searches with MEMORIZE",
    "1 + 1;": "no effect: only searches with MEMORIZE have levels",
    "SELECT n FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2 n = n + 1;": "no effect: the search calls no Python",
    "SELECT n FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2 n = roll(n);": "the search calls a function that is vol",
}


@pytest.mark.parametrize(("script", "reason"), IDLE.items())
def test_runs_without_anything_to_do_for_workers(ss: ss2sql.Session, script: str, reason: str) -> None:
    declare(ss, "onward")
    ss.function("roll", lambda n: n + 1, volatility="volatile")
    with pytest.warns(ss2sql.WorkersWarning, match=reason):
        found = ss.run(script, workers=2)
    assert reason in found.explain()
    assert processes_of(ss) == []


def test_until_the_others_are_ready_this_process_makes_the_calls(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(block_calls, "PATIENCE", 0.0)
    monkeypatch.setattr(process_pool.ProcessPool, "are_ready", lambda *_: False)
    for name, calls in {"onward": 6, "failing": 12}.items():  # which calls `onward` itself
        declare(ss, "is_far", onward=getattr(worker_functions, name))
        assert same(ss, "SELECT onward(n, this) FROM range(6) START WITH n = 1 CONNECT BY MEMORIZE 1 n = n;") == calls


def test_cheap_calls_and_little_work_stay_here(monkeypatch: pytest.MonkeyPatch) -> None:
    with ss2sql.connect() as session:
        declare(session, "onward")
        monkeypatch.setattr(block_calls, "CHEAP", 60.0)
        found = session.run(graph(), workers=2)
        assert found.stats.notes == ["workers: a call of 'onward' is too short to be made by another process"]
        assert found.stats.notes[0] in found.explain()
        monkeypatch.setattr(block_calls, "CHEAP", 0.0)
        monkeypatch.setattr(block_calls, "START", 60.0)
        assert same(session, graph()) > 0
        assert processes_of(session) == []


@pytest.mark.parametrize("workers", [0, -1, True, 2.0, "2"])
def test_wrong_numbers_of_workers(ss: ss2sql.Session, workers: Any) -> None:
    for run in (lambda **given: ss.run("1;", **given), ss.compile("1;").run):
        with pytest.raises(ss2sql.SessionError, match="workers is a whole number of at least 1, not"):
            run(workers=workers)


# --- scripts and the command line -----------------------------------------------------------------------

SCRIPT = """
print("begun")
made = []

def onward(state, element):
    made.append(state)
    return (state * 7 + element) % 53
{guard}
    ss = ss2sql.connect()
    ss.function("onward", onward, volatility="immutable")
    print(len(ss.run({script!r}, workers=2).paths), len(made))
"""


@pytest.mark.parametrize(
    ("guard", "way", "made", "said"),
    [('if __name__ == "__main__":', "file", 0, ""),
     ("if True:", "file", 40, "it is defined in script.py, which does its work whenever it is imported; write `if"),
     ('if __name__ == "__main__":', "module", 0, ""),
     ('if __name__ == "__main__":', "text", 40, "it is defined in a notebook or a shell")],
)  # fmt: skip
def test_functions_of_the_script_that_runs(tmp_path: Path, guard: str, way: str, made: int, said: str) -> None:
    (tmp_path / "script.py").write_text(EAGER + SCRIPT.format(guard=guard, script=graph()))
    text = (tmp_path / "script.py").read_text()
    how = {"file": ["script.py"], "module": ["-m", "script"], "text": ["-c", text]}[way]
    done = subprocess.run([sys.executable, *how], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout.split()[0] == "begun"
    assert done.stdout.count("begun") == 1
    assert int(done.stdout.split()[1]) <= 3 + 9 + 27 + 81, done.stderr
    assert (int(done.stdout.split()[2]) > 0) == (made > 0)
    assert said in done.stderr
    assert bool(done.stderr) == bool(said)


def test_the_command_line(eager: None, tmp_path: Path) -> None:
    (tmp_path / "functions.py").write_text("def onward(n, m):\n    seven = n * 7\n    return (seven + m) % 53\n")
    search = ("-e", graph("WHERE onward(n, this) == 7"), "--functions", str(tmp_path / "functions.py"))
    assert good("run", *search, "--workers", "2") == good("run", *search)
    answer = call("run", "-e", "1;", "--workers", "2")
    assert answer.stderr == "workers: no effect: only searches with MEMORIZE have levels\n"
