"""How a run ends before its time: timeouts, interrupts, and limits on its rows."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest
from sessions import code_of, leaping

import ss2sql

ENDLESS = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;"
STOPPED = "START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1"
PRODUCT = "SELECT a.this FROM a = range(2000), b = range(2000), c = range(2000) WHERE a.this + b.this + c.this < 0;"


def elapsed(call: Any, kind: type[ss2sql.Error]) -> tuple[float, Any]:
    started = time.monotonic()
    with pytest.raises(kind) as caught:
        call()
    return time.monotonic() - started, caught.value


SLOW = {
    "search": ENDLESS,
    "breadth": "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + 1;",
    "no cycle": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY NO CYCLE n = n + 1;",
    "unique": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;",
    "cost": "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY COST this n = n + 1;",
    "nested": "SELECT (SELECT 1 FROM b = range(900), c = range(900), d = range(900) WHERE a.this + d.this < 0)"
    " FROM a = range(900);",
    "search without results": "SELECT this FROM [1, 2] WHERE n < 0 START WITH n = 0 CONNECT BY n = n + 1;",
    "product": PRODUCT,
    "sorting": "SELECT a.this FROM a = range(2000), b = range(2000) ORDER BY b.this;",
    "groups": "SELECT a.this, sum(b.this) FROM a = range(3000), b = range(3000) GROUP BY a.this;",
    "partition": "SELECT a.this FROM a = range(2000), b = range(2000) GROUP BY b.this;",
    "python": "SELECT slow(this) FROM range(1000);",
    "python in a search": "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = slow(n) + 1;",
}


@pytest.mark.parametrize("script", SLOW.values(), ids=SLOW)
def test_a_timeout_ends_every_kind_of_run(ss: ss2sql.Session, engine: Any, script: str) -> None:
    ss.function("slow", lambda x: (time.sleep(0.005), x)[1], volatility="immutable")
    query = ss.compile(script, engine=engine)
    elapsed(lambda: query.run(timeout=0.01), ss2sql.Timeout)  # so it need not be compiled in the time that is measured
    seconds, error = elapsed(lambda: query.run(timeout=0.1), ss2sql.Timeout)
    assert error.code == "T001"
    assert error.span is not None
    assert 0.1 <= seconds < 5
    assert error.partial.status == "timeout"
    assert error.partial.engine == engine
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


def test_the_partial_result_has_what_was_found(
    ss: ss2sql.Session, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        ss.function("leap", leaping(patch, 500), volatility="immutable")
        script = ENDLESS.replace("n + 1", "leap(n)")
        _, error = elapsed(lambda: ss.run(script, engine=engine, timeout=3600), ss2sql.Timeout)
    partial = error.partial
    assert partial.value is None
    assert partial.columns == ("path", "step", "this")
    assert len(partial.paths) > 100
    assert partial.paths[:3] == [[(1,)], [(1,), (1,)], [(1,), (1,), (1,)]]  # depth first, a result at every step
    assert partial.stats.generated > 100
    script = "SELECT slow(this) FROM range(100);"
    ss.function("slow", lambda x: (time.sleep(0.01), x)[1], volatility="stable")
    _, error = elapsed(lambda: ss.run(script, engine=engine, timeout=0.5), ss2sql.Timeout)
    assert list(error.partial)[:2] == [(0,), (1,)]
    assert error.partial.stats.calls["slow"] >= len(error.partial)


def test_a_timeout_of_the_session_holds_for_every_run(engine: Any) -> None:
    with ss2sql.connect(timeout=0.2) as ss:
        assert elapsed(lambda: ss.run(ENDLESS, engine=engine), ss2sql.Timeout)[0] < 5
        query = ss.compile(ENDLESS, engine=engine)
        assert elapsed(query.run, ss2sql.Timeout)[0] < 5
        assert 0.3 < elapsed(lambda: query.run(timeout=0.35), ss2sql.Timeout)[0] < 5
        assert ss.run("1 + 1;").value == 2


@pytest.mark.parametrize("script", [ENDLESS, PRODUCT])
def test_a_run_can_be_interrupted_from_another_thread(ss: ss2sql.Session, engine: Any, script: str) -> None:
    ss.interrupt()  # nothing runs, nothing happens
    query = ss.compile(script, engine=engine)
    elapsed(lambda: query.run(timeout=0.01), ss2sql.Timeout)  # so it need not be compiled when it is interrupted
    timer = threading.Timer(0.1, ss.interrupt)
    timer.start()
    seconds, error = elapsed(lambda: query.run(timeout=5), ss2sql.Cancelled)
    timer.join()
    assert error.code == "T002"
    assert seconds < 5
    assert error.partial.status == "cancelled"
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


def test_an_interrupt_that_a_function_raises_ends_a_run(ss: ss2sql.Session, engine: Any) -> None:
    def press(x):
        raise KeyboardInterrupt

    ss.function("press", press)
    _, error = elapsed(lambda: ss.run("SELECT press(this) FROM [1];", engine=engine), ss2sql.Cancelled)
    assert error.partial.status == "cancelled"
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


def test_an_inner_run_ends_with_the_outer_one(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("inner", lambda x: ss.run(ENDLESS, engine=engine).value, volatility="stable")
    script = "SELECT inner(this) FROM [1, 2];"
    seconds, error = elapsed(lambda: ss.run(script, engine=engine, timeout=0.1), ss2sql.Timeout)
    assert seconds < 5
    assert error.partial.columns == ("inner",)
    assert ss.eval("1 + 1;") == 2
    ss.function("slow", lambda x: (time.sleep(0.02), x)[1], volatility="volatile")
    _, error = elapsed(lambda: ss.run("slow(1) + slow(2);", timeout=0.01), ss2sql.Timeout)
    assert error.partial is None  # it has ended before any query


def test_maximum_bounds_the_results_of_a_search(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run(ENDLESS, engine=engine, maximum=3)
    assert (len(result.paths), result.status) == (3, "maximum")
    assert result.value == ss.run(ENDLESS.replace("BY n", "BY MAXIMUM 3 n"), engine=engine).value
    assert len(ss.run(ENDLESS.replace("BY n", "BY MAXIMUM 2 n"), engine=engine, maximum=3).paths) == 2
    query = ss.compile("x = SELECT this FROM [1, 2, 3] AS list; " + ENDLESS)
    assert len(query.run(engine=engine, maximum=4).paths) == 4
    flat = ss.run("SELECT this FROM [1, 2, 3];", engine=engine, maximum=1)
    assert (len(flat), flat.status) == (3, "complete")
    # It counts for the outermost search alone.
    inner = "len((SELECT m.this FROM m = range(k) START WITH k = 2 CONNECT BY k = m.this AS list))"
    nested = f"SELECT {inner} FROM n = range(node) START WITH node = 3 CONNECT BY MAXIMUM 3 node = n.this AS list;"
    assert ss.run(nested, maximum=2).value == [[3], [3]]
    for wrong in (0, -1, 1.5, True):
        assert code_of(ss.run, ENDLESS, engine=engine, maximum=wrong) == "S002"


def test_max_rows_is_a_limit_that_must_not_be_passed(ss: ss2sql.Session, engine: Any) -> None:
    assert len(ss.run("SELECT this FROM [1, 2];", engine=engine, max_rows=2)) == 2
    assert len(ss.run("SELECT this FROM [1, 2, 3] LIMIT 2;", engine=engine, max_rows=2)) == 2
    too_many = "SELECT a.this FROM a = range(100000), b = range(100000);"  # for the memory too
    endings = ("", "ORDER BY this", "ORDER BY -this", "GROUP BY this", "LIMIT 3", STOPPED, f"{STOPPED} ORDER BY this")
    for script in (*(f"SELECT this FROM [3, 1, 2] {ending};" for ending in endings), ENDLESS, too_many):
        with pytest.raises(ss2sql.ExecutionError, match="max_rows=2") as caught:
            ss.run(script, engine=engine, max_rows=2)
        assert caught.value.code == "X010"
        assert caught.value.span is not None
    assert len(ss.run("SELECT this FROM [];", engine=engine, max_rows=0)) == 0
    assert code_of(ss.run, "1;", max_rows=-1) == "S002"


def test_errors_in_a_circle(engine: Any) -> None:
    """An exception of the user's whose causes lead back to itself ends the run like any other."""

    def f(value: int) -> int:
        error = ValueError("here")
        error.__cause__ = KeyError("there")
        error.__cause__.__cause__ = error
        raise error

    with ss2sql.connect() as ss:
        ss.function("f", f, volatility="stable")
        with pytest.raises(ValueError, match="here"):
            ss.run("SELECT f(this) FROM [1, 2] AS list;", engine=engine)
