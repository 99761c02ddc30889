"""Where `workers` have no effect or little, and what is said then; scripts and the command line."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import worker_functions
from worker_runs import EAGER, declare, graph, processes_of, same

import ss2sql
from ss2sql.runtime.workers import foretelling, processes, timing
from ss2sql.runtime.workers.processes import Processes


@pytest.fixture
def ss(eager: None, ss: ss2sql.Session) -> ss2sql.Session:
    return ss


def by_closure() -> Callable[[int, int], int]:
    factor = 7

    def onward(state: int, element: int) -> int:
        return (state * factor + element) % 53

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
    "is a lambda; write it at the top of a module with def": (lambda n, this: int(f"{n}") + this, IMMUTABLE, STATES),
    "is defined inside of another function; write it at the top of a module": (by_closure(), IMMUTABLE, STATES),
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
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert found.value == expected.value
    assert found.stats.calls == expected.stats.calls
    assert found.stats.remembered == expected.stats.remembered or "vectorized" in how
    assert found.stats.notes == [str(caught[0].message)]
    assert found.stats.notes[0] in found.explain()


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


def test_a_function_that_is_another_one_elsewhere(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    declare(ss, "sized")
    script = "SELECT sized(n, this) FROM [1, 2] START WITH n = 1 CONNECT BY MEMORIZE 9 n = sized(n, this);"
    same(ss, script)
    monkeypatch.setattr(worker_functions, "SIZE", 3)
    assert {row for path in ss.run(script).paths for row in path} == {(0,), (1,), (2,)}
    with pytest.warns(ss2sql.WorkersWarning, match="it reads 'SIZE', which is another one in a fresh process"):
        same(ss, script)


IDLE = {
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


def test_until_the_others_are_ready_this_process_works(monkeypatch: pytest.MonkeyPatch) -> None:
    for place, name in ((timing, "SAMPLES"), (timing, "CHEAP"), (foretelling, "START"), (foretelling, "LEAST")):
        monkeypatch.setattr(place, name, 0)
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


def test_cheap_calls_and_little_work_stay_here(monkeypatch: pytest.MonkeyPatch) -> None:
    with ss2sql.connect() as session:
        declare(session, "onward")
        monkeypatch.setattr(timing, "CHEAP", 60.0)
        found = session.run(graph(), workers=2)
        assert found.stats.notes == ["workers: a call of 'onward' is too short to be made by another process"]
        assert found.stats.notes[0] in found.explain()
        monkeypatch.setattr(timing, "CHEAP", 0.0)
        monkeypatch.setattr(foretelling, "START", 60.0)
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
    [
        ('if __name__ == "__main__":', "file", 0, ""),
        ("if True:", "file", 40, "it is defined in script.py, which does its work whenever it is imported; write `if"),
        ('if __name__ == "__main__":', "module", 0, ""),
        ('if __name__ == "__main__":', "text", 40, "it is defined in a notebook or a shell"),
    ],
)
def test_functions_of_the_script_that_runs(tmp_path: Path, guard: str, way: str, made: int, said: str) -> None:
    (tmp_path / "script.py").write_text(EAGER + SCRIPT.format(guard=guard, script=graph()))
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
