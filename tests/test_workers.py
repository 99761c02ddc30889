"""`workers`: calls in other processes, with the result, the order and the errors of one process."""

from __future__ import annotations

from typing import Any

import pytest
import worker_functions
from sessions import code_of
from worker_runs import declare, graph, processes_of, same

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
