"""The native executor on queries: how often what is called, read and compiled, in which order, and lookups."""

from __future__ import annotations

import random
from typing import Any

import pytest
from native_host import FakeHost

import ss2sql
from ss2sql import plan
from ss2sql.errors import ExecutionError, Source, Span
from ss2sql.kinds import INT, STR
from ss2sql.runtime.values import places_in_order


@pytest.mark.parametrize(
    ("script", "value", "calls"),
    [
        # A source is read again only for what it mentions: below(a.this) for each a, below(2) once.
        ("SELECT 1 FROM a = [2, 3], b = [5, 6, 7], c = below(a.this), d = below(2) AS list", [1] * 30, 3),
        ("SELECT b.this FROM a = [1, 2, 3], b = draw() AS list", [1, 2] * 3, 1),
        # Early conditions save calls: ten times for a, ten times for b with the one a that passes.
        ("SELECT 1 FROM a = ten, b = ten WHERE twice(a.this) == 4 AND twice(b.this) == 6 AS list", [1], 20),
        # Volatile ones are called for every combination: 100 times the left one; the right one where a passes.
        ("SELECT 1 FROM a = ten, b = ten WHERE loud(a.this) == 4 AND loud(b.this) == 6 AS list", [1], 110),
        ("SELECT 1 FROM a = l, b = l, c = l WHERE add1(c.this, add1(b.this, add1(a.this, []))) == [3, 2, 1] AS list",
         [1], 3 + 9 + 27),
        # A repeated call runs once per row, one of constants once and only if needed.
        ("SELECT twice(this), twice(this) + 1 FROM [1, 2] WHERE twice(this) > 2 AS rows", [[4, 5]], 2),
        ("SELECT this + twice(4) FROM l AS list", [9, 10, 11], 1),
        ("SELECT this + twice(5) FROM empty AS list", [], 0),
        # A nested query runs once per row that it sees, one with volatile calls every time.
        ("SELECT this FROM l WHERE this IN (SELECT twice(b.this) FROM b = l AS list) AS list", [2], 3),
        ("SELECT this FROM l WHERE this IN (SELECT loud(b.this) FROM b = l AS list) AS list", [2], 9),
        ("SELECT (SELECT b.this + max((SELECT twice(c.this) FROM c = [a.this] AS list)) FROM b = l AS list)"
         " FROM a = [1, 2] AS list", [[3, 4, 5], [5, 6, 7]], 2),
        # A limit without an order stops early.
        ("SELECT loud(this) FROM ten LIMIT 3 AS list", [0, 2, 4], 3),
    ],
)  # fmt: skip
def test_how_often_functions_are_called(script: str, value: Any, calls: int) -> None:
    functions = {
        "twice": lambda value: 2 * value,
        "loud": lambda value: 2 * value,
        "below": lambda n: list(range(n)),
        "draw": lambda: [1, 2],
        "add1": lambda a, b: [*b, a],
    }
    host = FakeHost(functions, {"loud": "volatile", "draw": "volatile"}, l=[1, 2, 3], ten=list(range(10)), empty=[])
    run = host.start()
    assert host.run(script, run) == value
    assert sum(run.stats.calls.values()) == calls


def test_arguments_of_a_run_come_before_variables() -> None:
    host = FakeHost(x=1)
    run = host.start(arguments={"x": 10})
    assert host.run("x = x + 1; x", run) == 11
    assert (run.arguments, host.variables["x"]) == ({"x": 11}, 1)


def test_a_text_is_compiled_once_per_run() -> None:
    host = FakeHost(texts=["rows.n", "1", "rows.n"], rows=[{"n": number} for number in range(20)])
    assert host.run("SELECT eval(t.this) FROM rows, t = texts AS list")[:3] == [0, 1, 0]
    assert host.texts == 2
    query = host.query("SELECT eval('n * 2') FROM rows WHERE n < 2 AS list")
    host.texts = 0
    for _ in range(3):
        assert query.value(host.start()) == [0, 2]
    assert host.texts == 3


def test_a_list_that_changes_while_it_is_read() -> None:
    host = FakeHost(l=[1, 2])
    host.functions["grow"] = lambda: host.variables["l"].append(9) or 0
    host.volatility["grow"] = "volatile"
    assert host.run("SELECT this + grow() FROM l AS list") == [1, 2]


# --- the order of evaluation ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("script", "seen"),
    [
        ("SELECT note('s', this) FROM [1] WHERE note('w', 1) GROUP BY note('g', 1) ORDER BY note('o', 1)", "wsgo"),
        # Arguments are evaluated before keys, and all rows before any group.
        ("SELECT sum(note('s', a.this)) FROM a = [1, 2] GROUP BY note('g', 1) HAVING max(note('h', a.this)) == 2",
         "shgshg"),
        ("SELECT sum(note('s', this)) FROM [1, 2] GROUP BY note('k', 0) HAVING note('h', count(*)) == 2", "skskh"),
        # A query in FROM that can fail is read before its rows are used.
        ("SELECT note('r', p.c) FROM n = [6], p = (SELECT to(n.this / m.this, c) FROM m = [1, 2, 0]) AS list", ""),
    ],
)  # fmt: skip
def test_order_of_evaluation(script: str, seen: str) -> None:
    words: list[str] = []

    def note(word: str, value: Any) -> Any:
        words.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    if seen:
        host.run(script)
    else:
        assert host.error(script).code == "X002"
    assert "".join(words) == seen


# --- order and limits ----------------------------------------------------------------------------------


@pytest.mark.parametrize("falling", [False, True])
@pytest.mark.parametrize("kinds", [(1, 2.5, True, 3), ("a", "b"), (None, 1, 2), ([1], [2], [1, 0])])
def test_the_first_ones_are_those_of_the_whole_order(falling: bool, kinds: tuple[Any, ...]) -> None:
    chance = random.Random(5)
    for count in (0, 1, 7, 8, 9, 50):
        column = [chance.choice(kinds) for _ in range(count)]
        order = places_in_order(count, [column], [falling])
        for limit in (0, 1, 2, 6):
            assert places_in_order(count, [column], [falling], limit)[:limit] == order[:limit]


def test_too_many_rows_are_too_many_in_any_order() -> None:
    with pytest.raises(ExecutionError) as caught:
        ss2sql.connect().run("SELECT this FROM [1, 3, 2] ORDER BY -this AS list;", engine="native", max_rows=2)
    assert caught.value.code == "X010"


# --- tables and searches over queries ------------------------------------------------------------------


def test_a_hierarchy_costs_its_size() -> None:
    number = 3000
    columns = (("id", INT), ("boss", INT), ("name", STR))
    source = plan.TableSource(0, "staff", "main", "staff", columns, ("rowid",), span=Span(Source(""), 0, 0))
    host = FakeHost(tables={"staff": (source, [(index + 1, (index + 1) // 2, str(index)) for index in range(number)])})
    in_source = "SELECT id FROM (SELECT * FROM staff WHERE boss == top) START WITH top = 1 CONNECT BY top = id"
    in_where = "SELECT id FROM staff WHERE boss == top START WITH top = 1 CONNECT BY top = id STOP WITH boss != top"
    # Below 1 are 2 and 3, below k are 2k and 2k + 1: everybody but 1.
    for script in (in_source, in_where):
        run = host.start()
        assert len(host.run(script, run)) == number - 1
        assert run.stats.generated == number - 1
    assert host.reads == 2


@pytest.mark.parametrize("order", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "COST 1", "UNIQUE DEPTH FIRST"])
@pytest.mark.parametrize("column", ["SELECT b", "SELECT a, b", "SELECT b, a", "SELECT *", "SELECT to(a + b - a, b)"])
def test_searches_over_queries_in_from(order: str, column: str) -> None:
    edges = [(1, 2), (1, 3), (2, 4), (3, 4), (4, 5), (2, 5)]
    ss = ss2sql.connect()
    ss.set("edges", [{"a": a, "b": b} for a, b in edges])
    ss.set("after", {"of": [[b for a, b in edges if a == node] for node in range(6)]})
    search = f"START WITH n = 1 CONNECT BY {order} n = @ STOP WITH n == 5 AS list;"
    read = ss.run(f"SELECT b FROM ({column} FROM edges WHERE a == n) {search.replace('@', 'b')}", engine="native")
    given = ss.run(f"SELECT m.this FROM m = after['of'][n] {search.replace('@', 'm.this')}", engine="native")
    assert read.value == given.value
    assert read.stats.generated == given.stats.generated
