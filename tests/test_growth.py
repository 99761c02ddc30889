"""What grows with the square of a list where nobody would expect it to: joins, inner queries and searches by equality.

The work of a run is counted, not timed: steps of SQLite's virtual machine, and lines of Python.
"""

from __future__ import annotations

import sys
from types import FrameType
from typing import Any, Literal

import pytest
from agreement import executor_outcome, reference_outcome
from programs import ProgramCase

import ss2sql
from ss2sql.runtime.sqlite import executor

Engine = Literal["database", "native"]

SMALL, LARGE = 150, 600
MOST_GROWTH = 1.3  # as a power of the size; sorting for an index is a little more than linear

JOINS = {
    "inner query by a key of the rows":
        'SELECT n.this, (SELECT this FROM es WHERE this["a"] == n.this AS list) FROM n = ns AS list;',
    "lists that equal in an element":
        "SELECT n.this, e.this[1] FROM n = ns, e = pairs WHERE e.this[0] == n.this AS list;",
    "computed key": "SELECT n.this, e.this FROM n = ns, e = es WHERE abs(e.x) == n.this AS list;",
    "key that is read deep inside": "SELECT n.this, e.a FROM n = ns, e = es WHERE e.p['q'] == n.this AS list;",
    "keys of several kinds": "SELECT n.this, m.this FROM n = ns, m = mixed WHERE m.this == n.this AS list;",
    "keys that are lists": "SELECT n.a, e.a FROM n = es, e = es WHERE e.p == n.p AND [e.a] == [n.a] AS list;",
    "two keys": "SELECT n.this, e.a FROM n = ns, e = es WHERE e.a == n.this AND abs(e.x) == n.this AS list;",
    "membership in what a query finds for a row":
        "SELECT k, x FROM n = groups WHERE x IN (SELECT e.x FROM e = groups WHERE e.k == n.k AS list) AS rows;",
    "no membership in it":
        "SELECT k, x FROM n = groups WHERE x + 1 NOT IN (SELECT e.x FROM e = groups WHERE e.k == n.k AS list) AS rows;",
    "membership in what a query finds once":
        "SELECT this IN (SELECT this FROM things AS list) FROM things AS list;",
    "the greatest of a group":
        "SELECT k, x FROM n = groups WHERE x == max(SELECT e.x FROM e = groups WHERE e.k == n.k AS list) AS rows;",
    "the greatest of all up to a row's group":
        "SELECT k, x FROM n = groups WHERE x == max(SELECT e.x FROM e = groups WHERE e.k <= n.k AS list) AS rows;",
    "the sum over a group":
        "SELECT k, x / sum(SELECT e.x FROM e = groups WHERE e.k == n.k AS list) FROM n = groups AS rows;",
    "the size of a group": "SELECT k FROM n = groups WHERE len(SELECT 1 FROM e = groups WHERE e.k < n.k) > 1 AS list;",
    "the greatest of several kinds": "SELECT this FROM ns WHERE this == max(SELECT 1 * x FROM halves AS list) AS list;",
    "steps by an element":
        "SELECT this FROM tree START WITH here = 0 CONNECT BY UNIQUE here = this[1] STOP WITH this[0] != here AS list;",
    "steps by an element, with a goal":
        "SELECT this FROM tree WHERE this[0] == here AND this[1] % 50 == 0 START WITH here = 0"
        " CONNECT BY UNIQUE here = this[1] STOP WITH this[0] != here AS list;",
    "steps of a list that a query gives":
        "SELECT this FROM (SELECT this FROM tree WHERE this[0] == here AS list)"
        " START WITH here = 0 CONNECT BY UNIQUE here = this[1] AS list;",
    "steps from a root that has no parent, in a query":
        "SELECT name FROM (SELECT * FROM staff WHERE (b == None AND boss == None) OR boss == b)"
        " START WITH b = None CONNECT BY UNIQUE b = name AS list;",
    "steps from a root that has no parent":
        "SELECT name FROM staff WHERE (b == None AND boss == None) OR boss == b START WITH b = None"
        " CONNECT BY UNIQUE b = name STOP WITH NOT ((b == None AND boss == None) OR boss == b) AS list;",
}  # fmt: skip


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
        "halves": [{"x": n / 2 if n % 2 else n} for n in range(size)],
        "things": list(map(Thing, range(size))),
        "tree": [[(n - 1) // 2, n] for n in range(1, size)],
    }


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
    monkeypatch.setattr(executor.Database, "_check_progress", step)
    with ss2sql.connect(engine=engine) as ss:
        for name, value in data(size).items():
            ss.set(name, value)
        query = ss.compile(script)
        query.run()  # what is done but once
        counted, before = 0, sys.gettrace()
        sys.settrace(line)
        try:
            query.run()
        finally:
            sys.settrace(before)
    return counted


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize("script", JOINS.values(), ids=JOINS)
def test_the_work_grows_with_the_size(script: str, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = (work(script, size, engine, monkeypatch) for size in (SMALL, LARGE))
    assert large < small * (LARGE / SMALL) ** MOST_GROWTH, (small, large)


@pytest.mark.parametrize("script", JOINS.values(), ids=JOINS)
@pytest.mark.parametrize("engine", ["database", "native"])
def test_the_values_are_those_of_trying_all(script: str, engine: Engine) -> None:
    case = ProgramCase(script, data(40))
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
