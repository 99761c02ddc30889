"""`workers`: calls in other processes, with the result, the order and the errors of one process."""

from __future__ import annotations

import gc
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import worker_functions
from sessions import code_of

import ss2sql
from ss2sql.runtime.workers import foretelling, processes, timing
from ss2sql.runtime.workers.processes import Processes

GRAPH = """SELECT onward(n, this) FROM [1, 2, 3] {where}
START WITH n = 1 CONNECT BY MEMORIZE {bound} {options} n = onward(n, this) {stop};"""


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """All calls are worth other processes."""
    monkeypatch.setattr(timing, "SAMPLES", 0)
    monkeypatch.setattr(timing, "CHEAP", 0.0)
    monkeypatch.setattr(foretelling, "LEAST", 0.0)
    monkeypatch.setattr(foretelling, "FEWEST", 1)
    monkeypatch.setattr(foretelling, "START", 0.0)
    monkeypatch.setattr(foretelling.Foreteller, "_own_answer", lambda _: None)


@pytest.fixture
def ss(eager: None) -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        yield session


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
    for name in ("calls", "remembered", "generated", "expanded", "pruned", "levels"):
        assert getattr(two.stats, name) == getattr(one.stats, name), name
    assert one.stats.calls
    return made


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
    "queries inside": "SELECT this, n FROM [1, 2] "
    "WHERE [] == SELECT this FROM [1, 2, 3] WHERE is_far(this + n) AS list "
    "START WITH n = 2 CONNECT BY MEMORIZE 3 n = onward(n, this);",
    "searches inside": "SELECT this, n FROM [1, 2] WHERE 2 < len(SELECT m FROM [1, 2] START WITH m = n "
    "CONNECT BY UNIQUE m = onward(m, this) STOP WITH is_far(m) AS list) "
    "START WITH n = 2 CONNECT BY MEMORIZE 2 n = onward(n, this);",
    "order and limit": "SELECT onward(n, this) FROM [1, 2, 3] "
    "START WITH n = 1 CONNECT BY MEMORIZE 3 n = onward(n, this) "
    "ORDER BY weight(n, this) DESC LIMIT 5;",
    "no function on the way": "SELECT this, n FROM [1, 2] WHERE is_far(n) "
    "START WITH n = 2 CONNECT BY MEMORIZE 3 n = n + this;",
}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_the_same_result_and_counts(ss: ss2sql.Session, script: str) -> None:
    declare(ss, "onward", "neighbours", "weight", "is_far")
    made = same(ss, script)
    if "ORDER BY" not in script:  # which is asked when paths are found, not by a level
        assert made == 0


def test_hanoi(ss: ss2sql.Session) -> None:
    declare(ss, "move")
    script = """SELECT this, tower FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
        WHERE [[], [], [3, 2, 1]] == move(this, tower)
        START WITH tower = [[3, 2, 1], [], []]
        CONNECT BY MEMORIZE 9 tower = move(this, tower)
        STOP WITH [] == move(this, tower);"""
    assert same(ss, script) == 0
    query = ss.compile(script)
    assert [len(path) for path in query.run(workers=3).paths] == [7, *[8] * 4, *[9] * 16]


@pytest.mark.parametrize("most", [1, 3, 10_000])
@pytest.mark.parametrize("name", ["odd_results", "printing"])
def test_small_blocks_and_all_kinds_of_results(
    ss: ss2sql.Session, name: str, most: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(foretelling, "MOST", most)
    declare(ss, onward=getattr(worker_functions, name))
    script = (
        "SELECT onward(n, this), this FROM range(7) WHERE n != 3 START WITH n = 1 CONNECT BY MEMORIZE 2 n = n + this;"
    )
    same(ss, script)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("limit", [0, 1, 7])
def test_a_memo_that_is_full(ss: ss2sql.Session, limit: int) -> None:
    declare(ss, "onward", "is_far")
    script = graph("WHERE is_far(onward(n, this))")
    expected = ss.run(script).value
    ss.host.memo_limit = limit
    with pytest.warns(ss2sql.WorkersWarning) if limit == 0 else _no_warning():
        assert ss.run(script, workers=2).value == expected


def _no_warning() -> Any:
    import warnings

    return warnings.catch_warnings()


def test_several_statements_and_runs_share_the_processes(ss: ss2sql.Session) -> None:
    declare(ss, "onward", "is_far")
    script = "a = " + graph("WHERE is_far(onward(n, this))") + graph(bound=2)
    same(ss, script)
    crew = ss.host.processes and ss.host.processes._crew
    same(ss, script)
    assert crew is not None
    assert crew is ss.host.processes._crew  # type: ignore[union-attr]
    ss.run(script, workers=1)
    ss.run(script, workers=3)
    assert len(ss.host.processes._crew.processes) == 3  # type: ignore[union-attr]


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


@pytest.mark.parametrize("name", ["failing", "not_a_number"])
def test_errors_are_raised_here_at_their_places(ss: ss2sql.Session, name: str) -> None:
    declare(ss, "is_far", onward=getattr(worker_functions, name))
    script = graph("WHERE is_far(onward(n, this))", bound=9)
    one, two = outcome(ss, script, 1), outcome(ss, script, 2)
    assert one == two
    assert one[0] in ("LookupError", "ExecutionError")
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


def test_an_idle_process_that_was_killed(ss: ss2sql.Session) -> None:
    declare(ss, "onward")
    same(ss, graph())
    for process in processes_of(ss):
        process.kill()
        process.wait()
    assert code_of(ss.run, graph(), workers=2) == "X013"
    assert same(ss, graph()) == 0


def test_a_call_that_ends_the_interpreter_is_made_here(ss: ss2sql.Session) -> None:
    declare(ss, onward=worker_functions.exiting)
    same(ss, graph())


# --- stopping ------------------------------------------------------------------------------------------


def processes_of(session: ss2sql.Session) -> list[subprocess.Popen[bytes]]:
    processes = session.host.processes
    crew = processes._crew if processes is not None else None
    return list(crew.processes) if crew is not None else []


def test_a_timeout_ends_the_processes(ss: ss2sql.Session) -> None:
    declare(ss, "onward")
    same(ss, graph())
    before = processes_of(ss)
    declare(ss, onward=worker_functions.endless)
    started = time.monotonic()
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(graph(), workers=2, timeout=0.3)
    assert time.monotonic() - started < 5  # a call takes a minute
    assert caught.value.partial.status == "timeout"
    assert None not in [process.returncode for process in before]
    declare(ss, "onward")
    same(ss, graph())


@pytest.mark.parametrize("way", ["interrupt", "Ctrl-C"])
def test_an_interrupt_ends_the_processes(ss: ss2sql.Session, way: str) -> None:
    declare(ss, onward=worker_functions.endless)
    press = ss.interrupt if way == "interrupt" else lambda: os.kill(os.getpid(), signal.SIGINT)
    timer = threading.Timer(0.5, press)
    timer.start()
    started = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        ss.run(graph(), workers=2)
    timer.join()
    assert time.monotonic() - started < 5
    assert processes_of(ss) == []


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


KILLED = """
import os, signal, sys
sys.path.insert(0, {folder!r})
import ss2sql, worker_functions
from ss2sql.runtime.workers import foretelling, timing
timing.SAMPLES, timing.CHEAP, foretelling.LEAST, foretelling.START = 0, 0.0, 0.0, 0.0
foretelling.Foreteller._own_answer = lambda _: None
ss = ss2sql.connect()
ss.function("onward", worker_functions.onward, volatility="immutable")
ss.run({script!r}, workers=2)
print(*(process.pid for process in ss.host.processes._crew.processes), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_end_with_a_program_that_is_killed() -> None:
    program = KILLED.format(folder=str(Path(__file__).parent), script=graph())
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
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


# --- where workers have no effect, and what is said -----------------------------------------------------


def by_closure() -> Callable[[int, int], int]:
    factor = 7

    def onward(state: int, element: int) -> int:
        return (state * factor + element) % 53

    return onward


KEPT = {
    "is a lambda; write it at the top of a module with def": lambda n, this: int(f"{n}") + this,
    "is defined inside of another function; write it at the top of a module": by_closure(),
    "cannot be pickled": worker_functions.Machine(lambda: 3).onward,  # type: ignore[arg-type]
}


@pytest.mark.parametrize("reason", KEPT)
def test_functions_that_other_processes_cannot_have(ss: ss2sql.Session, reason: str) -> None:
    declare(ss, "is_far", onward=KEPT[reason] if "pickled" not in reason else _with_lock)
    script = graph("WHERE is_far(n)")
    expected = ss.run(script)
    with pytest.warns(ss2sql.WorkersWarning, match=re.escape(reason)) as caught:
        found = ss.run(script, workers=2)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert found.value == expected.value
    assert (found.stats.calls, found.stats.remembered) == (expected.stats.calls, expected.stats.remembered)
    assert found.stats.notes == [str(caught[0].message)]
    assert found.stats.notes[0] in found.explain()
    assert found.stats.notes[0].startswith("workers: 'onward' is called in this process only: it ")


class _Locked:
    lock = None

    def __init__(self) -> None:
        self.lock = threading.Lock()

    def __call__(self, state: int, element: int) -> int:
        return state + element


_with_lock = _Locked()


@pytest.mark.parametrize("function", [worker_functions.Machine(3).onward, worker_functions.Machine(3),
                                      worker_functions.Machine.plain])  # fmt: skip
def test_other_callables(ss: ss2sql.Session, function: Any) -> None:
    declare(ss, onward=function)
    assert same(ss, graph()) == 0


def test_a_partial(ss: ss2sql.Session) -> None:
    declare(ss, "by_three")
    assert same(ss, "SELECT by_three(n) FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 9 n = by_three(n);") == 0


def test_a_stable_function_stays_here(ss: ss2sql.Session) -> None:
    declare(ss, "is_far")
    ss.function("onward", worker_functions.onward, volatility="stable")
    with pytest.warns(ss2sql.WorkersWarning, match="it is stable: .*; declare it immutable if"):
        same(ss, graph("WHERE is_far(n)"))


def test_a_function_that_takes_arrays_stays_here(ss: ss2sql.Session) -> None:
    declare(ss, "onward")
    ss.function("twice", lambda numbers: 2 * numbers, vectorized=True)
    script = graph("WHERE twice(this) > 2")
    one = ss.run(script)
    with pytest.warns(ss2sql.WorkersWarning, match="'twice' is called in this process only: it takes arrays"):
        two = ss.run(script, workers=2)
    assert two.value == one.value
    assert two.stats.calls == one.stats.calls


def test_only_functions_of_the_search_are_told_of(ss: ss2sql.Session) -> None:
    declare(ss, "onward")
    ss.function("other", lambda n: int(f"{n}"), volatility="immutable")
    script = "x = SELECT other(this), (y = this) FROM [1, 2] AS list;" + graph()
    assert ss.run(script, workers=2).value == ss.run(script).value


def test_from_both_ends(ss: ss2sql.Session) -> None:
    ss.function("walk", worker_functions.walk, volatility="immutable", inverse=worker_functions.walk_back)
    script = """SELECT this, n FROM [[1, 2], [2, 3], [3, 5]] WHERE walk(this, n) == 40
        START WITH n = 0 CONNECT BY MEMORIZE 7 n = walk(this, n) STOP WITH walk(this, n) > 40;"""
    assert ss.run(script).stats.backward
    one, two = ss.run(script), ss.run(script, workers=2)
    assert one.value
    assert two.value == one.value
    assert two.stats.calls == one.stats.calls
    assert two.stats.notes == []


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


def test_objects_stay_here(ss: ss2sql.Session) -> None:
    declare(ss, "is_far", onward=worker_functions.decimals)
    script = (
        "SELECT this, n FROM [1, 2] WHERE onward(n, this) != 9 START WITH n = 1 CONNECT BY MEMORIZE 3 n = n + this;"
    )
    expected = ss.run(script).value
    with pytest.warns(ss2sql.WorkersWarning, match="'onward' is called in this process only: it returns objects"):
        assert ss.run(script, workers=2).value == expected


def test_a_function_that_is_another_one_elsewhere(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    declare(ss, "sized")
    script = "SELECT sized(n, this) FROM [1, 2] START WITH n = 1 CONNECT BY MEMORIZE 9 n = sized(n, this);"
    same(ss, script)
    monkeypatch.setattr(worker_functions, "SIZE", 3)
    assert {row for path in ss.run(script).paths for row in path} == {(0,), (1,), (2,)}
    with pytest.warns(ss2sql.WorkersWarning, match="it reads 'SIZE', which is another one in a fresh process"):
        same(ss, script)


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("SELECT onward(this, 1) FROM [1, 2];", "no effect: only searches with MEMORIZE have levels"),
        ("SELECT n FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = onward(n, 1);", "only searches with MEMORIZE"),
        ("1 + 1;", "no effect: only searches with MEMORIZE have levels"),
        (
            "SELECT n FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2 n = n + 1;",
            "no effect: the search calls no Python",
        ),
        (
            "SELECT n FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2 n = roll(n);",
            "the search calls a function that is vol",
        ),
    ],
)
def test_runs_without_anything_to_do_for_workers(ss: ss2sql.Session, script: str, reason: str) -> None:
    declare(ss, "onward")
    ss.function("roll", lambda n: n + 1, volatility="volatile")
    with pytest.warns(ss2sql.WorkersWarning, match=reason):
        found = ss.run(script, workers=2)
    assert reason in found.explain()
    assert processes_of(ss) == []


def test_until_the_others_are_ready_this_process_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SAMPLES", 0)
    monkeypatch.setattr(timing, "CHEAP", 0.0)
    monkeypatch.setattr(foretelling, "START", 0.0)
    monkeypatch.setattr(foretelling, "LEAST", 0.0)
    monkeypatch.setattr(Processes, "ready", False)
    monkeypatch.setattr(processes, "_serve", lambda process, *_: (process.stdin.close(), process.stdout.close()))
    with ss2sql.connect() as session:
        for name, calls in {"onward": 6, "odd_results": 6, "failing": 12}.items():  # which calls `onward` itself
            declare(session, "is_far", onward=getattr(worker_functions, name))
            script = "SELECT onward(n, this) FROM range(6) START WITH n = 1 CONNECT BY MEMORIZE 1 n = n;"
            assert same(session, script) == calls
        declare(session, onward=worker_functions.decimals)
        with pytest.warns(ss2sql.WorkersWarning, match="it returns objects"):
            same(session, script)


def test_cheap_calls_stay_here_and_explain_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "CHEAP", 60.0)
    with ss2sql.connect() as session:
        declare(session, "onward")
        found = session.run(graph(), workers=2)
        assert found.stats.notes == ["workers: a call of 'onward' is too short to be made by another process"]
        assert found.stats.notes[0] in found.explain()
        assert processes_of(session) == []


def test_little_work_starts_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "CHEAP", 0.0)
    monkeypatch.setattr(foretelling, "START", 60.0)
    with ss2sql.connect() as session:
        declare(session, "onward")
        assert same(session, graph()) > 0
        assert processes_of(session) == []


@pytest.mark.parametrize("workers", [0, -1, True, 2.0, "2"])
def test_wrong_numbers_of_workers(ss: ss2sql.Session, workers: Any) -> None:
    with pytest.raises(ss2sql.SessionError, match="workers is a whole number of at least 1, not"):
        ss.run("1;", workers=workers)
    with pytest.raises(ss2sql.SessionError, match="workers is a whole number of at least 1, not"):
        ss.compile("1;").run(workers=workers)


# --- scripts and the command line -----------------------------------------------------------------------

SCRIPT = """
import ss2sql
from ss2sql.runtime.workers import foretelling, timing
timing.SAMPLES, timing.CHEAP, foretelling.LEAST, foretelling.START = 0, 0.0, 0.0, 0.0
foretelling.Foreteller._own_answer = lambda _: None
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
    [
        ('if __name__ == "__main__":', "file", 0, ""),
        ("if True:", "file", 40, "it is defined in script.py, which does its work whenever it is imported; write `if"),
        ('if __name__ == "__main__":', "module", 0, ""),
        ('if __name__ == "__main__":', "text", 40, "it is defined in a notebook or a shell"),
    ],
)
def test_functions_of_the_script_that_runs(tmp_path: Path, guard: str, way: str, made: int, said: str) -> None:
    (tmp_path / "script.py").write_text(SCRIPT.format(guard=guard, script=graph()))
    text = (tmp_path / "script.py").read_text()
    how = {"file": ["script.py"], "module": ["-m", "script"], "text": ["-c", text]}[way]
    done = subprocess.run([sys.executable, *how], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    paths = 3 + 9 + 27 + 81
    assert done.stdout.split()[0] == "begun"
    assert done.stdout.count("begun") == 1
    assert int(done.stdout.split()[1]) <= paths
    assert (int(done.stdout.split()[2]) > 0) == (made > 0)
    assert said in done.stderr
    assert bool(done.stderr) == bool(said)


def test_the_command_line(tmp_path: Path) -> None:
    source = "import time\ndef onward(n, m):\n    for k in range(20000): n += 0\n    return (n * 7 + m) % 53\n"
    (tmp_path / "functions.py").write_text(source)
    command = [sys.executable, "-m", "ss2sql.cli", "run", "-e", graph("WHERE onward(n, this) == 7"), "--format", "json"]
    command += ["--functions", str(tmp_path / "functions.py")]
    one, two, none = (
        subprocess.run([*command, *more], capture_output=True, text=True, timeout=60)
        for more in ([], ["--workers", "2"], ["--workers", "2", "-e", "1;"])
    )
    assert one.returncode == 0
    assert (two.stdout, two.stderr) == (one.stdout, one.stderr)
    assert none.stderr == "workers: no effect: only searches with MEMORIZE have levels\n"
