"""What grows with the square of a list where nobody would expect it to: joins, inner queries and searches by equality.

The work of a run is counted, not timed: steps of SQLite's virtual machine, and lines of Python.
"""

from __future__ import annotations

import sys
from types import FrameType
from typing import Any, Literal

import pytest
from agreement import executor_outcome, reference_outcome, session_for
from golden import each_row
from programs import ProgramCase

import ss2sql
from ss2sql.runtime.sqlite import executor

Engine = Literal["database", "native"]

SMALL, LARGE = 150, 600


class Thing:
    """An object that says how often it is compared."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Thing) and self.number == other.number

    def __hash__(self) -> int:
        return hash(self.number)


def data(size: int) -> dict[str, Any]:
    return {
        "ns": [n * 7 % size for n in range(size)],
        "es": [{"a": n, "x": -n, "p": {"q": n}} for n in range(size)],
        "pairs": [[n, n + 1] for n in range(size)],
        "mixed": [n if n % 3 else str(n) for n in range(size)],
        "staff": [{"name": n, "boss": (n - 1) // 2 if n else None} for n in range(size)],
        "groups": [{"k": n % 5, "x": n * 7 % size} for n in range(size)],
        "stops": [{"k": n % 5, "a": n, "x": n} for n in range(size)],
        "halves": [{"x": n / 2 if n % 2 else n} for n in range(size)],
        "days": [{"day": f"{n * 7 % size:04}", "next": f"{n * 7 % size + 2:04}", "x": n} for n in range(size)],
        "things": list(map(Thing, range(size))),
        "tree": [[(n - 1) // 2, n] for n in range(1, size)],
    }


def make_case(script: str, size: int) -> ProgramCase:
    parents = [{"id": n, "parent": (n - 1) // 2 if n else None} for n in range(size)]
    return ProgramCase(script, data(size), tables={"nodes": parents, "links": parents[::-1]})


def work(script: str, size: int, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> int:
    """What one run does, in steps of SQLite and lines of Python."""
    counted = 0

    def step(self: executor.Database) -> bool:
        nonlocal counted
        counted += 10
        return False

    def line(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal counted
        counted += event == "line"
        return line

    monkeypatch.setattr(executor, "CHECK_EVERY", 10)
    monkeypatch.setattr(executor.Database, "_check_search", step)
    with session_for(make_case(script, size), engine=engine) as ss:
        for name in ("nodes", "links"):  # a column that no script reads
            ss.host.connection.execute(f"ALTER TABLE {name} ADD COLUMN weight REAL DEFAULT 1")
        query = ss.compile(script)
        query.run()  # what is done but once
        counted, before = 0, sys.gettrace()
        sys.settrace(line)
        try:
            query.run()
        finally:
            sys.settrace(before)
    return counted


@each_row("queries/growth", "script", "power")
def test_the_work_grows_with_the_size(script: str, power: str, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = (work(script, size, engine, monkeypatch) for size in (SMALL, LARGE))
    assert large < small * (LARGE / SMALL) ** float(power), (small, large)


@each_row("queries/growth", "script", "power")
def test_the_values_are_those_of_trying_all(script: str, power: str, engine: Engine) -> None:
    case = make_case(script, 20)
    assert executor_outcome(case, engine) == reference_outcome(case)


def test_a_key_calls_a_function_for_no_row_behind_the_last_one_shown(engine: Any) -> None:
    called: list[int] = []
    with ss2sql.connect(engine=engine) as ss:

        @ss.function(volatility="immutable")
        def half(number: int) -> int:
            called.append(number)
            return number // 2

        ss.set("ns", list(range(50)))
        script = "SELECT n.this, e.this FROM n = ns, e = ns WHERE half(e.this) == n.this"
        assert ss.eval(f"{script} LIMIT 3 AS rows;") == [(0, 0), (0, 1), (1, 2)]
        assert sorted(called) == list(range(50))  # the first rows ask for all of them
        called.clear()
        assert ss.eval("SELECT e.this FROM n = [0], e = ns WHERE half(e.this) == n.this LIMIT 2 AS list;") == [0, 1]
        assert called == [0, 1]
        called.clear()
        assert len(ss.eval(f"{script} AS rows;")) == 50
        assert sorted(called) == list(range(50))  # once each


def test_rows_are_walked_in_the_order_of_the_first_key_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Natively; SQLite sorts all that lies before each row."""
    last = "SELECT b.x FROM b = groups WHERE b.x < a.x ORDER BY b.x DESC, b.k DESC LIMIT 1 AS value"
    script = f"SELECT a.x, ({last}) AS v FROM a = groups AS rows;"
    small, large = (work(script, size, "native", monkeypatch) for size in (SMALL, LARGE))
    assert large < small * (LARGE / SMALL) ** 1.2
    case = make_case(script.replace("b.x DESC, b.k DESC LIMIT 1", "b.k, b.x DESC LIMIT 3"), 40)
    assert executor_outcome(case, "native") == reference_outcome(case)
