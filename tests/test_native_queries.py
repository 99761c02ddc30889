"""The native executor on queries: how often what is called, read and compiled, in which order; runs that end early,
and plans that are very deep or very wide."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest
from native_host import FakeHost, place

import ss2sql
from ss2sql import plan
from ss2sql.errors import Cancelled, ExecutionError, Source, Span, Timeout
from ss2sql.kinds import ANY, BOOL, INT, STR, type_of
from ss2sql.runtime.native import compile_statement
from ss2sql.runtime.rows import Rows
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


# --- runs that end early -------------------------------------------------------------------------------

ENDLESS = [
    ("SELECT this FROM [0, 1] START WITH n = 1 CONNECT BY n = n + 1", True),
    ("SELECT this FROM [0, 1] START WITH n = 1 CONNECT BY BREADTH FIRST n = n + 1", True),
    ("SELECT n FROM [0, 1] START WITH n = 1 CONNECT BY NO CYCLE n = n + 1", True),
    ("SELECT n FROM [0, 1] START WITH n = 1 CONNECT BY UNIQUE n = n + 1", True),
    ("SELECT this FROM [0, 1] START WITH n = 1 CONNECT BY COST this n = n + 1", True),
    ("SELECT this FROM [0, 1] WHERE this == 2 START WITH n = 1 CONNECT BY n = 1 - n", False),
    ("SELECT a.this FROM a = l, b = l, c = l, d = l WHERE c.this + d.this < 0", False),
    ("SELECT (SELECT 1 FROM b = l, c = l, d = l WHERE a.this + d.this < 0) FROM a = l", False),
    ("SELECT a.this FROM a = l, b = l, c = l, d = l, e = []", False),
]


@pytest.mark.parametrize(("script", "found"), ENDLESS)
def test_a_timeout_keeps_what_was_found(script: str, found: bool) -> None:
    host = FakeHost(l=list(range(300)))
    query = host.query(script)
    sink = Rows((), rows=[], paths=[])
    started = time.monotonic()
    with pytest.raises(Timeout) as raised:
        query.rows(host.start(deadline=time.monotonic() + 0.05), sink)
    assert time.monotonic() - started < 5  # it tells an end from a hang, on any machine
    assert raised.value.span == query.query.span
    assert bool(sink.paths or sink.rows) is found


def test_a_timeout_in_the_paths_of_memorize() -> None:
    # 14 nodes, each with an edge to each other one, and a goal behind the last: very many paths, all found late.
    host = FakeHost({"near": lambda node: [other for other in range(14) if other != node] + [14] * (node == 13)})
    script = """SELECT n.this FROM n = near(node) WHERE n.this == 14 START WITH node = 0
    CONNECT BY MEMORIZE node = n.this STOP WITH n.this == 14"""
    sink = Rows((), paths=[])
    with pytest.raises(Timeout):
        host.query(script).rows(host.start(deadline=time.monotonic() + 0.2), sink)
    assert sink.paths
    assert [len(path) for path in sink.paths] == sorted(len(path) for path in sink.paths)


def test_an_interrupt() -> None:
    host = FakeHost()
    run = host.start()

    def interrupt(value: Any) -> Any:
        run.interrupted = value > 5
        return True

    host.functions["interrupt"] = interrupt
    host.volatility["interrupt"] = "volatile"
    query = host.query("SELECT n FROM [0] WHERE interrupt(n) START WITH n = 1 CONNECT BY n = n + 1")
    sink = Rows((), paths=[])
    with pytest.raises(Cancelled):
        query.rows(run, sink)
    assert sink.paths is not None
    # Somebody looks at least every 128 steps, and everything that was counted is in the statistics.
    assert 6 <= len(sink.paths) <= 6 + 128
    assert run.stats.generated >= len(sink.paths)


def test_an_error_keeps_what_was_found() -> None:
    host = FakeHost()
    sink = Rows((), rows=[])
    with pytest.raises(ExecutionError):
        host.query("SELECT 1 / this FROM [1, 2, 0, 4]").rows(host.start(), sink)
    assert sink.rows == [(1.0,), (0.5,)]


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this FROM l",
        "SELECT this FROM l LIMIT 6",
        "SELECT this FROM l ORDER BY this",
        "SELECT this FROM l ORDER BY -this",
        "SELECT this FROM l GROUP BY this % 2",
        "SELECT this, count(*) FROM l GROUP BY this",
        "SELECT this FROM l START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1",
        "SELECT this FROM l START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1 ORDER BY this",
    ],
)
def test_more_results_than_allowed(script: str) -> None:
    host = FakeHost(l=list(range(7)))
    query = host.query(script)
    with pytest.raises(ExecutionError) as raised:
        query.rows(host.start(max_rows=5))
    assert (raised.value.code, place(raised.value)) == ("X010", f"1:1 {script}")
    assert query.rows(host.start(max_rows=7)) is not None
    if "LIMIT" not in script:
        found = host.query(f"{script} LIMIT 5").rows(host.start(max_rows=5))
        assert len(found.rows or found.paths or ()) == 5


def test_rows_of_inner_queries_are_counted_where_they_become_a_value() -> None:
    host = FakeHost(l=list(range(100)))
    script = "SELECT len((SELECT this FROM l AS list)) FROM [1] AS value"
    assert host.query(script).value(host.start(max_rows=100)) == 100
    with pytest.raises(ExecutionError) as refused:
        host.query(script).value(host.start(max_rows=99))
    assert refused.value.code == "X010"
    source = "SELECT x FROM (SELECT to(this, x) FROM l) WHERE x == 7 AS value"
    assert host.query(source).value(host.start(max_rows=1)) == 7


# --- depth and width -----------------------------------------------------------------------------------

SPAN = Span(Source("deep"), 0, 4)


def constant(value: Any) -> plan.Expr:
    return plan.Constant(value, type_of(value), span=SPAN)


def call(name: str, *arguments: plan.Expr, builtin: bool = True) -> plan.Expr:
    return plan.Call(plan.Function(name, 0, None, "immutable", builtin), arguments, span=SPAN, place=SPAN)


def listed(number: int, value: plan.Expr, where: plan.Expr | None = None) -> plan.Expr:
    """`(SELECT this FROM value WHERE where AS list)`; its source has this number."""
    source = plan.ValueSource(number, "s", value, ANY, (), span=SPAN)
    output = plan.Output("this", plan.Element(number, span=SPAN))
    form = plan.Representation("list")
    query = plan.Query(number, (source,), (output,), where, representation=form, span=SPAN)
    return plan.Subquery(query, span=SPAN)


def wrapped(levels: int, start: plan.Expr, wrap: Callable[[int, plan.Expr], plan.Expr]) -> plan.Expr:
    for level in range(1, levels + 1):
        start = wrap(level, start)
    return start


def below(level: int, inner: plan.Expr) -> plan.Expr:
    """A nested query that also sees the element of the outermost one."""
    same = call("eq", plan.Element(300, span=SPAN), constant(1))
    return listed(level, constant([1]), plan.And((same, inner), BOOL, span=SPAN))


def table(level: int, inner: plan.Expr) -> plan.Expr:
    """`(SELECT this FROM inner)` where the inner query is a source."""
    assert isinstance(inner, plan.Subquery)
    source = plan.QuerySource(1000 + level, "s", inner.query, ANY, None, span=SPAN)
    output = plan.Output("this", plan.Element(1000 + level, span=SPAN))
    return plan.Subquery(plan.Query(1000 + level, (source,), (output,), span=SPAN), span=SPAN)


def branches(level: int, inner: plan.Expr) -> plan.Expr:
    """The same value in several branches, further out in one alone."""
    if level < 5:
        return plan.If(constant(True), (inner, inner), (constant(1),), span=SPAN)
    return plan.If(constant(False), (constant(1),), (inner,), span=SPAN)


@pytest.mark.parametrize(
    ("start", "wrap", "expected"),
    [
        (0, lambda level, inner: call("add", inner, constant(1)), 300),
        (0, lambda level, inner: call("f", inner, builtin=False), 0),
        (0, lambda level, inner: plan.Not(inner, span=SPAN), False),
        (0, branches, 0),
        ([7, 8], listed, [7, 8]),
        (True, below, [1]),
    ],
    ids=["operators", "calls", "not", "if", "queries", "correlated"],
)
def test_plans_of_300_levels(start: Any, wrap: Any, expected: Any) -> None:
    limit = sys.getrecursionlimit()
    host = FakeHost({"f": lambda value: value})
    assert compile_statement(wrapped(300, constant(start), wrap))(host.start()) == expected
    assert sys.getrecursionlimit() == limit


def test_queries_in_from_of_200_levels() -> None:
    (value,) = compile_statement(wrapped(200, listed(1, constant([5])), table))(FakeHost().start())
    for _ in range(200):
        value = value["this"]
    assert value == 5


@pytest.mark.parametrize("number", [16, 17, 40, 70])
def test_more_sources_than_python_nests(number: int) -> None:
    sources = ", ".join(f"s{index} = [{index}, {index}]" if index < 3 else f"s{index} = [s{index - 1}.this + 1]"
                        for index in range(number))  # fmt: skip
    where = f"s1.this != 5 AND s{number - 1}.this + s0.this + s3.this > 0"
    script = f"SELECT s0.this, s2.this, s{number - 1}.this FROM {sources} WHERE {where} AS rows"
    assert FakeHost().run(script) == [[0, 2, number - 1]] * 8


@pytest.mark.parametrize("number", [17, 40])
def test_searches_and_groups_with_more_sources_than_python_nests(number: int) -> None:
    sources = ", ".join(f"s{index} = [{index}, n]" if index < 2 else f"s{index} = [n]" for index in range(number))
    script = (
        f"SELECT s0.this, s1.this, s{number - 1}.this FROM {sources} START WITH n = 3 CONNECT BY NO CYCLE n = n + 1"
    )
    assert FakeHost().run(f"{script} STOP WITH n == 4 OR s0.this == 3 OR s1.this == 3 AS list") == [[0, 1, 3]]
    pairs = ", ".join(f"s{index} = [1, 2]" if index > number - 4 else f"s{index} = [1]" for index in range(number))
    columns = f"s{number - 1}.this, count(*), sum(s{number - 2}.this)"
    found = FakeHost().run(f"SELECT {columns} FROM {pairs} GROUP BY s{number - 1}.this AS rows")
    assert found == [[1, 4, 6], [2, 4, 6]]
