"""The native executor on searches: counts of the language page, every order, options, the cost of long paths."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from listings import MOVES, move
from native_host import FakeHost

from ss2sql.runtime.native.searches import SEARCHES
from ss2sql.runtime.run import Run


def hanoi(options: str, level: int | None, disks: int = 3) -> tuple[FakeHost, Run, str]:
    """A host, a run and the script of the Towers of Hanoi, which stops at a level."""
    tower = list(range(disks, 0, -1))
    script = f"""SELECT this, tower FROM moves WHERE [[], [], {tower}] == move(this, tower)
    START WITH tower = [{tower}, [], []], level = 1
    CONNECT BY {options} tower = move(this, tower), level = level + 1
    STOP WITH {"" if level is None else f"level == {level} OR "} [] == move(this, tower)"""
    host = FakeHost({"move": move}, moves=MOVES)
    return host, host.start(), script


def lengths(options: str, level: int | None, disks: int = 3) -> dict[int, int]:
    host, run, script = hanoi(options, level, disks)
    return dict(Counter(map(len, host.run(script, run))))


@pytest.mark.parametrize("options", ["", "DEPTH FIRST", "BREADTH FIRST", "COST 1", "PROBABILITY 0.5"])
def test_all_plans(options: str) -> None:
    assert lengths(options, 7) == {7: 1}
    assert lengths(options, 8) == {7: 1, 8: 4}
    assert lengths(options, 9) == {7: 1, 8: 4, 9: 23}


@pytest.mark.parametrize("order", ["", "BREADTH FIRST", "COST 1", "PROBABILITY 0.5"])
def test_plans_without_a_cycle(order: str) -> None:
    assert lengths(f"{order} NO CYCLE", 8) == {7: 1, 8: 4}
    assert lengths(f"{order} NO CYCLE", 9) == {7: 1, 8: 4, 9: 16}


@pytest.mark.parametrize("order", ["", "COST 1", "PROBABILITY 0.5"])
def test_plans_of_the_graph(order: str) -> None:
    assert lengths(f"MEMORIZE 12 {order}", None) == {7: 1, 8: 4, 9: 16, 10: 50, 11: 147, 12: 382}


def test_plans_of_larger_graphs() -> None:
    assert lengths("MEMORIZE 18", None, 4) == {15: 1, 16: 8, 17: 48, 18: 228}
    assert lengths("MEMORIZE 33", None, 5) == {31: 1, 32: 16, 33: 160}


@pytest.mark.parametrize("options", ["", "BREADTH FIRST", "COST 1"])
def test_counted_steps(options: str) -> None:
    host, run, script = hanoi(options, 7)
    host.run(script, run)
    # Without a memo the function is called once for each step, though it is written three times.
    assert (run.stats.generated, run.stats.calls["move"]) == (3462, 3462)
    # Each of the 576 steps that go on, and the start, generates six.
    assert run.stats.expanded == 3462 // 6 - 1


@pytest.mark.parametrize("options", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1 UNIQUE", "MEMORIZE 7"])
def test_the_shortest_plan(options: str) -> None:
    host, run, script = hanoi(options, 7)
    paths = host.run(script, run)
    assert [[row["this"] for row in path] for path in paths] == [
        [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    ]
    assert paths[0][0]["tower"] == [[3, 2, 1], [], []]


def test_unique_expands_each_state_once() -> None:
    host, run, script = hanoi("UNIQUE", None)
    host.run(script, run)
    # 27 states; 3 of them, with all disks on one tower, have 2 moves, the others 3: so many rows are reached.
    assert run.stats.expanded == 3 * 2 + 24 * 3
    # Each row leads to a state, which then offers its six moves; so does the start.
    assert run.stats.generated == 6 * (run.stats.expanded + 1)


def test_every_combination_has_a_search() -> None:
    orders = {"depth first", "breadth first", "cost", "probability"}
    repeats = {"allowed", "no cycle", "unique", "memorize"}
    assert set(SEARCHES) == {(o, r) for o in orders for r in repeats} - {("breadth first", "memorize")}


# --- a small graph: S-B, S-C, B-C, C-D -----------------------------------------------------------------

GRAPH = {"S": ["B", "C"], "B": ["C"], "C": ["D"], "D": []}
COSTS = {"SB": 1, "SC": 5, "BC": 1, "CD": 1}


def small(options: str, rest: str = "", where: str = "", columns: str = "n.this", **kept: Any) -> Any:
    host = FakeHost(
        {
            "near": lambda node: GRAPH[node],
            "cost": lambda a, b: COSTS[a + b],
            "guess": lambda node: {"B": 6}.get(node, 0),
        },
        **kept,
    )
    script = f"SELECT {columns} FROM n = near(node) {where} START WITH node = 'S' "
    return host.run(script + f"CONNECT BY {options} node = n.this {rest} AS list")


def words(paths: list[list[str]]) -> str:
    return " ".join("".join(path) for path in paths)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", "B BC BCD C CD"),
        ("BREADTH FIRST", "B C BC CD BCD"),
        ("NO CYCLE", "B BC BCD C CD"),
        ("UNIQUE", "B C CD"),
        ("DEPTH FIRST UNIQUE", "B BC BCD"),
        ("COST cost(node, n.this)", "B BC BCD C CD"),
        ("COST 1", "B C BC CD BCD"),
        ("COST cost(node, n.this) UNIQUE", "B BC BCD"),
        # B waits for its expansion at 1 + 6, so C is taken at 5; the cheaper way to C is found later.
        ("COST cost(node, n.this) HEURISTIC guess(n.this)", "B C CD BC BCD"),
        ("COST cost(node, n.this) HEURISTIC guess(n.this) UNIQUE", "B C CD"),
        ("PROBABILITY 1 / cost(node, n.this)", "B BC BCD C CD"),
        # 5 % 5 is 0: the step to C is dropped.
        ("PROBABILITY cost(node, n.this) % 5", "B BC BCD"),
        ("PROBABILITY cost(node, n.this) % 5 MEMORIZE", "B BC BCD"),
        ("MEMORIZE", "B C BC CD BCD"),
        ("MEMORIZE 2", "B C BC CD"),
        ("MEMORIZE COST cost(node, n.this)", "B BC BCD C CD"),
        ("MEMORIZE 2 MAXIMUM 3", "B C BC"),
        ("MAXIMUM (1 + 1)", "B BC"),
    ],
)
def test_order_of_results(options: str, expected: str) -> None:
    assert words(small(options)) == expected


def test_goals_and_stops() -> None:
    assert words(small("", where="WHERE n.this == 'C'")) == "BC C"
    assert words(small("", where="WHERE True", rest="STOP WITH n.this == 'C'")) == "B BC C"
    assert words(small("", rest="STOP WITH n.this == 'C'")) == "B"


@pytest.mark.parametrize("order", ["", "DEPTH FIRST", "COST 1", "PROBABILITY 1"])
def test_a_step_that_stops_without_a_goal_leaves_no_trace(order: str) -> None:
    # The way from S to C stops, so C is reached by way of B all the same.
    where, rest = "WHERE n.this == 'D'", "STOP WITH node == 'S' AND n.this == 'C'"
    assert words(small(f"{order} UNIQUE", rest, where)) == "BCD"
    if order in ("", "COST 1", "PROBABILITY 1"):
        assert words(small(f"{order} MEMORIZE", rest, where)) == "BCD"


def test_memorize_does_not_pass_a_goal_that_stops() -> None:
    assert words(small("MEMORIZE", "STOP WITH n.this == 'C'", "WHERE n.this == 'C' OR n.this == 'D'")) == "C BC"


def test_group_order_and_limit_see_the_last_step() -> None:
    assert words(small("", "ORDER BY n.this DESC LIMIT 3")) == "BCD CD BC"
    assert words(small("", "LIMIT 2")) == "B BC"
    assert small("MEMORIZE", "GROUP BY [n.this][0] HAVING count(*) > 1") == {
        "C": [["C"], ["B", "C"]],
        "D": [["C", "D"], ["B", "C", "D"]],
    }
    assert small("COST cost(node, n.this)", "GROUP BY n.this", columns="n.this, count(*)") == [
        "B", 1, "C", 2, "D", 2,
    ]  # fmt: skip
    # The state before the last step of a path.
    assert words(small("BREADTH FIRST", "ORDER BY node")) == "BC CD BCD B C"
    # A column that is a key of the group: one row per group, and still the row that the search compares.
    assert small("MEMORIZE", "GROUP BY n.this HAVING count(*) > 1") == ["C", "D"]


def test_the_step_behind_a_known_row_has_its_own_element() -> None:
    # Both ways to C end there, but their last steps start from S and from B.
    host = FakeHost({"near": lambda node: GRAPH[node]})
    script = """SELECT n.this FROM n = near(node) WHERE n.this == 'C' START WITH node = 'S'
    CONNECT BY MEMORIZE node = n.this GROUP BY node AS list"""
    assert host.run(script) == {"S": [["C"]], "B": [["B", "C"]]}


# --- the state -----------------------------------------------------------------------------------------


def test_later_assignments_see_earlier_ones() -> None:
    script = """SELECT x, y FROM [1, 2] START WITH x = 1, y = x + 1
    CONNECT BY x = x * 3, y = x STOP WITH x > 1 AS list"""
    host = FakeHost(x=7)
    assert host.run(script) == [[1, 2], [1, 2]]
    assert host.variables == {"x": 7}


def test_a_call_that_sees_a_new_value_is_not_the_one_before() -> None:
    host = FakeHost({"double": lambda value: 2 * value})
    script = """SELECT x, y FROM [0] WHERE double(x) > 0 START WITH x = 1, y = 0
    CONNECT BY x = double(x), y = double(x) STOP WITH x == 4 AS list"""
    # Steps with x = 1, 2, 4; y is twice the new x.
    assert host.run(script) == [[1, 0], [1, 0, 2, 4], [1, 0, 2, 4, 4, 8]]


def test_all_sources_see_the_state_and_those_that_do_not_are_read_once() -> None:
    host = FakeHost({"below": lambda n: list(range(n)), "fixed": lambda: [0]})
    run = host.start()
    script = """SELECT b.this FROM a = fixed(), b = below(n) START WITH n = 3 CONNECT BY n = b.this AS list"""
    # Descending sequences from below 3: 2, 21, 210, 20, 1, 10, 0.
    assert sorted(map(tuple, host.run(script, run))) == [(0,), (1,), (1, 0), (2,), (2, 0), (2, 1), (2, 1, 0)]
    assert run.stats.calls["fixed"] == 1


def test_a_search_in_a_query() -> None:
    host = FakeHost({"near": lambda node: GRAPH[node]})
    script = """SELECT a.this, len((SELECT n.this FROM n = near(node) START WITH node = a.this
    CONNECT BY node = n.this AS list)) FROM a = ['S', 'B', 'C', 'D'] AS list"""
    assert host.run(script) == ["S", 5, "B", 2, "C", 1, "D", 0]


def test_a_compiled_search_gives_the_same_answer_twice() -> None:
    host, _, script = hanoi("UNIQUE", None)
    query = host.query(script)
    first, second = (query.rows(host.start()).paths for _ in range(2))
    assert first == second != []


# --- order of evaluation -------------------------------------------------------------------------------


def trace(options: str, columns: str = "note('select', this)") -> list[str]:
    seen: list[str] = []

    def note(word: str, value: Any) -> Any:
        seen.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    host.run(f"""SELECT {columns} FROM [1] WHERE note('where', True) START WITH n = note('start', 0)
    CONNECT BY {options} n = note('connect', n + 1) STOP WITH note('stop', n == 1)""")
    return seen


FIRST_STEP = ["start", "stop", "where", "select"]


def test_clauses_of_a_step() -> None:
    last = ["stop", "where", "select"]
    assert trace("") == [*FIRST_STEP, "connect", *last]
    weighted = [*FIRST_STEP, "cost", "heuristic", "connect", *last, "cost"]
    assert trace("COST note('cost', 1) HEURISTIC note('heuristic', 0)") == weighted
    assert trace("PROBABILITY note('p', 1)") == [*FIRST_STEP, "p", "connect", *last, "p"]


@pytest.mark.parametrize("option", ["NO CYCLE", "UNIQUE", "MEMORIZE"])
def test_a_row_that_is_compared_comes_first(option: str) -> None:
    columns = "note('select', n)"
    first = ["start", "select", "stop", "where", "connect"]
    assert trace(option, columns) == [*first, "select", "stop", "where"]
    # A constant row is known at the second step: it is dropped before STOP WITH and WHERE are asked.
    assert trace(option) == [*first, "select"]


def test_an_impossible_step_is_not_connected() -> None:
    assert trace("PROBABILITY note('p', 0)") == [*FIRST_STEP, "p"]


@pytest.mark.parametrize("options", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE"])
def test_a_maximum_evaluates_no_further_step(options: str) -> None:
    host = FakeHost()
    run = host.start()
    script = f"""SELECT this FROM [1, 2, 0] WHERE 1 / this START WITH n = 1
    CONNECT BY {options} MAXIMUM 2 n = n + 1 STOP WITH True AS list"""
    assert host.run(script, run) == [[1], [2]]
    assert run.stats.generated == 2


def test_the_runs_maximum_counts_for_the_outermost_search() -> None:
    host = FakeHost({"near": lambda node: GRAPH[node]})
    inner = "len((SELECT m.this FROM m = near(k) START WITH k = 'S' CONNECT BY k = m.this AS list))"
    script = f"SELECT {inner} FROM n = near(node) START WITH node = 'S' CONNECT BY MAXIMUM 3 node = n.this AS list"
    assert host.run(script, host.start(maximum=2)) == [[5], [5, 5]]
    assert len(host.run(script, host.start(maximum=4))) == 3


# --- wrong options -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "argument"),
    [
        ("MAXIMUM", "(0)"),
        ("MAXIMUM", "('a')"),
        ("MEMORIZE", "(1.5)"),
        ("COST", "-1"),
        ("COST", "'a'"),
        ("COST", "None"),
        ("COST 1 HEURISTIC", "-0.5"),
        ("PROBABILITY", "2"),
        ("PROBABILITY", "-0.1"),
        ("PROBABILITY", "[]"),
    ],
)
def test_wrong_values_of_options(option: str, argument: str) -> None:
    error = FakeHost().error(f"SELECT this FROM [1]\nSTART WITH n = 1 CONNECT BY {option} {argument} n = 1")
    assert error.code == "X006"
    assert error.span is not None
    assert error.span.line == 2
    assert argument.strip("()") in error.span.text


# --- long paths ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        "",
        "NO CYCLE",
        "DEPTH FIRST UNIQUE",
        "BREADTH FIRST",
        "BREADTH FIRST NO CYCLE",
        "UNIQUE",
        "COST 1",
        "COST 1 NO CYCLE",
        "COST 1 UNIQUE",
        "MEMORIZE",
        "MEMORIZE COST 1",
    ],
)
def test_a_long_chain(options: str) -> None:
    number = 20_000
    host = FakeHost()
    run = host.start()
    script = f"SELECT n + this FROM [1] WHERE n == {number - 1} START WITH n = 0 CONNECT BY {options} n = n + this"
    (path,) = host.run(script + f" STOP WITH n == {number - 1} AS list", run)
    assert path == list(range(1, number + 1))
    assert (run.stats.generated, run.stats.expanded) == (number, number - 1)


def test_no_cycle_costs_little_where_the_search_stays_near() -> None:
    # Two chains from one start, in breadth-first order: NO CYCLE walks from one to the other all the time.
    host = FakeHost()
    script = """SELECT side, n FROM s = [0, 1] WHERE n == 300 AND side == s.this START WITH side = None, n = 0
    CONNECT BY BREADTH FIRST NO CYCLE side = s.this, n = n + 1
    STOP WITH n == 300 OR (side != None AND side != s.this) AS list"""
    run = host.start()
    assert [len(path) // 2 for path in host.run(script, run)] == [301, 301]
    assert run.stats.generated == 2 + 2 * 2 * 300


@pytest.mark.parametrize("options", ["DEPTH FIRST", "UNIQUE", "MEMORIZE 3"])
def test_an_argument_that_is_computed_once_is_there_for_every_state(options: str) -> None:
    # The key of `low(1)` is known when the second state comes; `plus` is called for each state nevertheless.
    functions = {"low": lambda n: n < 2, "plus": lambda low, n: [n, low]}
    host = FakeHost(functions)
    script = "SELECT n + this FROM [1, 2] WHERE [3, True] == plus(low(1), n + this)"
    script += f" START WITH n = 0 CONNECT BY {options} n = n + this STOP WITH n + this > 3 AS list"
    assert host.run(script)[0][-1] == 3
