"""A function that every step of a search calls is called by the table of the list, once for each step."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from sessions import ENGINES

import ss2sql

SEARCH = """SELECT next(this, n) FROM moves WHERE next(this, n) == 5
    START WITH n = 0 CONNECT BY {} n = next(this, n) STOP WITH next(this, n) > 6 AS list;"""


class Calls:
    """`next(move, n)`, which notes its calls."""

    def __init__(self, gives: Any = None) -> None:
        self.seen: list[tuple[Any, ...]] = []
        self.gives = gives

    def next(self, move: Any, n: Any) -> Any:
        self.seen.append((move, n))
        return n + move if self.gives is None else self.gives(move, n)


def session(calls: Calls, moves: list[Any], **options: Any) -> ss2sql.Session:
    ss = ss2sql.connect(**options)
    ss.function("next", calls.next, volatility="immutable")
    ss.set("moves", moves)
    return ss


@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1"])
@pytest.mark.parametrize("moves", [[1, 2], [2, 1, 2], [1, 1.0, True], [], [3]], ids=str)
def test_each_call_is_made_once_and_stands_once_in_the_text(option: str, moves: list[Any]) -> None:
    found = []
    for engine in ENGINES:
        calls = Calls()
        with session(calls, moves) as ss:
            result = ss.run(SEARCH.format(option), engine=engine)
        assert len(calls.seen) == len(set(map(repr, calls.seen)))
        found.append((repr(result.value), Counter(map(repr, calls.seen)), result.stats.generated))
    assert found[0] == found[1]


def test_the_text_calls_the_function_nowhere_else() -> None:
    with session(Calls(), [1, 2]) as ss:
        text = ss.compile(SEARCH.format("UNIQUE")).sql
        assert "elements_with_next(:moves, search.n) AS moves" in text
        assert "next(moves.this" not in text
        of_the_element = SEARCH.format("UNIQUE").replace("next(this, n)", "next(this, 1)")
        assert "elements_with" not in str(ss.compile(of_the_element).sql)
    with session(Calls(), [1, 2], disable=["calls"]) as ss:
        text = ss.compile(SEARCH.format("UNIQUE")).sql
        assert "elements_with_next" not in text
        assert "next(moves.this, search.n)" in text


@pytest.mark.parametrize(
    "script",
    [
        # Asked of some steps only, or with other arguments elsewhere, which one memory serves.
        "SELECT 1 FROM moves WHERE n > 1 AND next(this, n) == 5 START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 2;",
        "SELECT next(this, n) FROM moves START WITH n = 0 CONNECT BY n = next(1, n) STOP WITH n == 3;",
        "SELECT 1 FROM moves WHERE next(this, n) == 3 START WITH n = 0 CONNECT BY this < 2 AND n < 3, n = n + 1;",
        "SELECT next(this + 1, n) FROM moves START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 3;",
    ],
)
def test_other_calls_stay_where_they_are(script: str) -> None:
    with session(Calls(), [1, 2]) as ss:
        assert "_with_next" not in ss.compile(script).sql
        assert ss.run(script, engine="database").paths == ss.run(script, engine="native").paths


def test_values_of_all_kinds_come_back_as_they_were() -> None:
    """Two lists that are equal in another form, an object, a dict, None, a list in a list, a long string."""
    thing = object()
    given = {0: [[1, 2]], 1: [[1.0, 2]], 2: thing, 3: {"a": [1]}, 4: None, 5: [[[]]], 6: "x" * 3000, 7: (1, 2), 8: True}
    paths = []
    for engine in ENGINES:
        calls = Calls(lambda move, n: given[n + move])
        with session(calls, list(given)) as ss:
            script = "SELECT next(this, n) FROM moves START WITH n = 0 CONNECT BY BREADTH FIRST MAXIMUM 9 n = n;"
            paths.append([list(path) for path in ss.run(script, engine=engine).paths])
    assert repr(paths[0]) == repr(paths[1])
    assert len(paths[0]) == len(given)


def test_a_function_in_from_is_called_once_for_its_arguments(engine: Any) -> None:
    """Whatever it gives, and though a condition calls it, too."""
    ends: list[Any] = [[1, 2], [[1], {"a": 2}, None, True, 1.0], (3, 4), None, 5, "ab", {"a": [6, 7]}, []]
    rows = [(0, 1), (0, 2), *((1, e) for e in ends[1]), (2, 3), (2, 4), (3, None), (4, 5), (5, "ab")]
    calls: list[tuple[Any, ...]] = []

    def look(n: int, step: int = 0) -> Any:
        calls.append((n, step))
        return ends[(n + step) % 8]

    with ss2sql.connect() as ss:
        ss.function(look, volatility="stable")
        ss.set("ns", list(range(8)))
        result = ss.run("SELECT n.this, e.this FROM n = ns, e = look(n.this) AS rows;", engine=engine)
        assert repr(result.value) == repr([*rows, (6, {"a": 6}), (6, {"a": 7})])
        assert calls == [(n, 0) for n in range(8)]
        assert engine == "native" or "elements_from_look(n.this) AS e" in result.sql
        calls.clear()
        search = "SELECT n, this FROM look(n, 1) WHERE look(n, 1) == [3, 4] START WITH n = 0 CONNECT BY n = n + 1 {};"
        found = ss.run(search.format("STOP WITH look(n, 1) == 5"), engine=engine)
        assert [path[-1] for path in found.paths] == [(1, 3), (1, 4)] * 5  # by each element of look(0, 1)
        assert calls == [(n, 1) for n in range(4)]


def test_a_table_of_the_same_name_and_columns_called_otherwise() -> None:
    """The columns of the one are a key of its dicts, those of the other a call; or the arguments are others."""
    with ss2sql.connect() as ss:
        ss.function("move", lambda a, b, *more: a * 2 + b + len(more), volatility="immutable")
        ss.set("moves", [1, 2])
        ss.set("dicts", [{"with": 1, "move": 2}])
        for call in ("move(this, n)", "move(n, this)", "move(this, n + 1, n)"):
            script = f"SELECT {call} FROM moves START WITH n = 1 CONNECT BY n = {call} STOP WITH n > 3 AS list;"
            assert ss.run(script, engine="database").value == ss.run(script, engine="native").value
        assert ss.run("SELECT d.move, d.with FROM d = dicts AS rows;", engine="database").value == [(2, 1)]


@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1"])
@pytest.mark.parametrize(
    ("goal", "left_out"), [([4], True), ([], False), (4, True), (None, True), ([1, 2], True), ([None], True)], ids=str
)
def test_what_stops_and_is_no_goal_is_left_out_by_the_table(option: str, goal: Any, left_out: bool) -> None:
    """`goal == next(..)` may be true of what STOP WITH drops only where the two values may be equal."""
    script = f"""SELECT this, n FROM moves WHERE level > 0 AND goal == next(this, n) START WITH n = [0], level = 1
        CONNECT BY {option} n = next(this, n), level = level + 1 STOP WITH [] == next(this, n) OR level == 4 AS rows;"""
    found = []
    for engine in ENGINES:
        calls = Calls(lambda move, n: [n[0] + move] if n and n[0] + move < 6 else [])
        with session(calls, [1, 2, 3]) as ss:
            ss.set("goal", [9])
            query = ss.compile(script, engine=engine)
            assert query.run().value == []
            ss.set("goal", goal)
            result = query.run()
            found.append((result.value, len(calls.seen)))
            if result.engine == "database":
                assert ("but not where next is" in query.explain()) == left_out
    assert found[0] == found[1]


def test_a_list_of_many_columns_loses_none() -> None:
    """SQLite tells of the first 63 columns which are used."""
    elements = [{f"c{number}": number * step for number in range(70)} for step in (1, 2, 3)]
    script = """SELECT c69, c1 FROM moves START WITH n = 0 CONNECT BY n = 1 STOP WITH [] == next(c68, n) AS rows;"""
    for engine in ENGINES:
        with session(Calls(lambda move, n: [] if n or move == 68 else [move]), elements) as ss:
            result = ss.run(script, engine=engine)
            assert result.value == [[(138, 2)], [(207, 3)]]
            assert result.engine != "database" or "moves.next IS NOT :p1" in result.sql
