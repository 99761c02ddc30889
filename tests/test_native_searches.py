"""The native executor on searches: when what is evaluated, what is counted, also of a search that ends early."""

from __future__ import annotations

from itertools import islice
from typing import Any

import pytest
from listings import MOVES, move
from native_host import FakeHost

import ss2sql
from ss2sql.runtime.native.pace import SHORT, Parts
from ss2sql.runtime.run import Run

ORDERS = ["DEPTH FIRST", "BREADTH FIRST", "COST 1", "COST 1 HEURISTIC 0", "PROBABILITY 0.5"]
REPEATS = ["", "NO CYCLE", "UNIQUE"]
MANY = 3 * SHORT + 5  # elements, so that they are walked in several parts
orders = pytest.mark.parametrize("order", ORDERS)
repeated = pytest.mark.parametrize("repeats", REPEATS)


def native(ss: ss2sql.Session, script: str, **variables: Any) -> ss2sql.Result:
    return ss.run(script, engine="native", **variables)


def counts(result: ss2sql.Result) -> tuple[int, int, int]:
    return result.stats.generated, result.stats.expanded, result.stats.pruned


# --- Towers of Hanoi -----------------------------------------------------------------------------------


def hanoi(options: str, level: int) -> tuple[list[Any], Run]:
    """The paths of a search that stops at a level, and its run."""
    host = FakeHost({"move": move}, moves=MOVES)
    run = host.start()
    paths = host.run(
        f"""SELECT this, tower FROM moves WHERE [[], [], [3, 2, 1]] == move(this, tower)
        START WITH tower = [[3, 2, 1], [], []], level = 1
        CONNECT BY {options} tower = move(this, tower), level = level + 1
        STOP WITH level == {level} OR [] == move(this, tower)""",
        run,
    )
    return paths, run


@pytest.mark.parametrize("options", ["", "BREADTH FIRST", "COST 1", "NO CYCLE", "COST 1 UNIQUE", "MEMORIZE 7"])
def test_the_shortest_plan_and_the_steps_to_it(options: str) -> None:
    [path], run = hanoi(options, 7)
    assert [row["this"] for row in path] == [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    assert path[0]["tower"] == [[3, 2, 1], [], []]
    if options in ("", "BREADTH FIRST", "COST 1"):
        # Without a memo the function is called once for each step, though it is written three times.
        assert (run.stats.generated, run.stats.calls["move"]) == (3462, 3462)
        # Each of the 576 steps that go on, and the start, generates six.
        assert run.stats.expanded == 3462 // 6 - 1


def test_unique_expands_each_state_once() -> None:
    _, run = hanoi("UNIQUE", 99)
    # 27 states; 3 of them, with all disks on one tower, have 2 moves, the others 3: so many rows are reached.
    assert run.stats.expanded == 3 * 2 + 24 * 3
    # Each row leads to a state, which then offers its six moves; so does the start.
    assert run.stats.generated == 6 * (run.stats.expanded + 1)


# --- counts --------------------------------------------------------------------------------------------


@repeated
@pytest.mark.parametrize("order", ["DEPTH FIRST", "BREADTH FIRST"])
def test_only_steps_up_to_the_last_result_are_counted(ss: ss2sql.Session, order: str, repeats: str) -> None:
    for place in (0, SHORT - 1, SHORT, MANY - 1):
        script = f"""SELECT this FROM numbers WHERE this == {place} START WITH n = 0
            CONNECT BY {order} {repeats} MAXIMUM 1 n = this STOP WITH True AS list;"""
        result = native(ss, script, numbers=list(range(MANY)))
        assert result.value == [[place]]
        assert counts(result) == (place + 1, 0, 0)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


@repeated
@pytest.mark.parametrize("order", ["COST this + 1", "PROBABILITY 1 / (this + 1)"])
def test_all_steps_of_a_state_come_before_the_best_of_them(ss: ss2sql.Session, order: str, repeats: str) -> None:
    script = f"SELECT this FROM numbers START WITH n = 0 CONNECT BY {order} {repeats} MAXIMUM 2 n = this AS list;"
    result = native(ss, script, numbers=list(range(MANY)))
    # After the first result its state is expanded.
    assert result.value[0] == [0]
    assert (result.stats.generated, result.stats.expanded) == (2 * MANY, 1)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


@repeated
@orders
def test_steps_are_counted_up_to_the_one_that_fails(order: str, repeats: str) -> None:
    place = SHORT + 3
    host = FakeHost({}, numbers=list(range(MANY)))
    run = host.start()
    script = f"""SELECT this FROM numbers WHERE 1 / ({place} - this) > 0 START WITH n = 0
        CONNECT BY {order} {repeats} n = this STOP WITH this >= 0"""
    error = host.error(script, run)
    assert error.span is not None
    assert error.span.text == "/"
    assert run.stats.generated == place + 1


def test_nested_searches_count_together(ss: ss2sql.Session) -> None:
    inner = "(SELECT this FROM [1, 2, 3] START WITH m = 0 CONNECT BY m = this STOP WITH m > 0 AS list)"
    outer = f"SELECT len({inner}) FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS list;"
    result = native(ss, outer)
    # Inside: 3 steps that go on, and 3 from each of them, which stop. Around it: 2 that go on, and 2 from each.
    # The inner search depends on nothing, so it is made once.
    assert result.value == [[3], [3]]
    assert counts(result) == (3 + 9 + 2 + 4, 3 + 2, 0)


def test_the_runs_maximum_counts_for_the_outermost_search(ss: ss2sql.Session) -> None:
    inner = "len((SELECT m.this FROM m = range(k) START WITH k = 2 CONNECT BY k = m.this AS list))"
    script = f"SELECT {inner} FROM n = range(node) START WITH node = 3 CONNECT BY MAXIMUM 3 node = n.this AS list"
    assert ss.run(script, engine="native", maximum=2).value == [[3], [3]]
    assert len(ss.run(script, engine="native", maximum=4).value) == 3


def test_parts_hold_all_items_in_order_and_know_how_many_are_left() -> None:
    for length in (0, 1, SHORT, SHORT + 1, MANY):
        run: Any = Run(None)  # type: ignore[arg-type]
        parts, walked = Parts(range(length), run), []
        for item in parts:
            walked.append(item)
            assert parts.__length_hint__() == length - len(walked)
        assert walked == list(range(length))


def test_an_interrupt_between_the_parts_of_a_long_list() -> None:
    run: Any = Run(None)  # type: ignore[arg-type]
    parts = iter(Parts(range(MANY), run))
    assert next(parts) == 0
    run.interrupted = True
    assert list(islice(parts, SHORT - 1)) == list(range(1, SHORT))
    with pytest.raises(ss2sql.Cancelled):
        next(parts)


# --- when what is evaluated ----------------------------------------------------------------------------


def trace(options: str, columns: str) -> list[str]:
    seen: list[str] = []

    def note(word: str, value: Any) -> Any:
        seen.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    host.run(f"""SELECT {columns} FROM [1] WHERE note('where', True) START WITH n = note('start', 0)
    CONNECT BY {options} n = note('connect', n + 1) STOP WITH note('stop', n == 1)""")
    return seen


@pytest.mark.parametrize(
    ("options", "columns", "expected"),
    [
        ("", "this", "start stop where select connect stop where select"),
        (
            "COST note('cost', 1) HEURISTIC note('heuristic', 0)",
            "this",
            "start stop where select cost heuristic connect stop where select cost",
        ),
        ("PROBABILITY note('p', 1)", "this", "start stop where select p connect stop where select p"),
        ("PROBABILITY note('p', 0)", "this", "start stop where select p"),  # an impossible step is not connected
        # A row that is compared comes first. One that is known is dropped before STOP WITH and WHERE are asked.
        *[(word, "n", "start select stop where connect select stop where") for word in (*REPEATS[1:], "MEMORIZE")],
        *[(word, "this", "start select stop where connect select") for word in (*REPEATS[1:], "MEMORIZE")],
    ],
)  # fmt: skip
def test_clauses_of_a_step(options: str, columns: str, expected: str) -> None:
    assert " ".join(trace(options, f"note('select', {columns})")) == expected


def logged(ss: ss2sql.Session, options: str) -> list[Any]:
    """The arguments of volatile functions: lists where sources call one, numbers where SELECT does."""
    log = list[Any]()

    def noted(*arguments: int) -> list[int]:
        log.append(list(arguments))
        return [1, 2]

    def shown(value: int) -> int:
        log.append(value)
        return value

    ss.function("noted", noted, volatility="volatile")
    ss.function("shown", shown, volatility="volatile")
    script = f"""SELECT shown(10 * a.this + b.this) FROM a = noted(1, 2), b = noted(a.this, x) START WITH x = 0
        CONNECT BY {options} x = x + 1 STOP WITH x == 1;"""
    native(ss, script)
    return log


def test_sources_are_read_where_their_steps_are_taken(ss: ss2sql.Session) -> None:
    # `a` is read once. Every value of it reads `b`; depth first a step is followed before the next is looked at.
    below = [[1, 1], [2, 1]]
    assert logged(ss, "DEPTH FIRST") == [[1, 2], [1, 0], 11, *below, 12, *below, [2, 0], 21, *below, 22, *below]
    assert logged(ss, "BREADTH FIRST") == [[1, 2], [1, 0], 11, 12, [2, 0], 21, 22, *4 * below]


def test_all_sources_see_the_state_and_those_that_do_not_are_read_once() -> None:
    host = FakeHost({"below": lambda n: list(range(n)), "fixed": lambda: [0]})
    run = host.start()
    script = """SELECT b.this FROM a = fixed(), b = below(n) START WITH n = 3 CONNECT BY n = b.this AS list"""
    # Descending sequences from below 3: 2, 21, 210, 20, 1, 10, 0.
    assert sorted(map(tuple, host.run(script, run))) == [(0,), (1,), (1, 0), (2,), (2, 0), (2, 1), (2, 1, 0)]
    assert run.stats.calls["fixed"] == 1


@repeated
@orders
def test_ten_sources_are_walked_in_any_order(ss: ss2sql.Session, order: str, repeats: str) -> None:
    names = "abcdefghij"
    sources = ", ".join(f"{name} = [0, 1]" if name in "ae" else f"{name} = [{at}]" for at, name in enumerate(names))
    columns = ", ".join(f"to({name}.this, {name})" for name in names)
    script = f"SELECT {columns} FROM {sources} START WITH n = 0 CONNECT BY {order} {repeats} n = n + 1"
    result = native(ss, f"{script} STOP WITH n == 1 AS list;")
    # Those of the states behind stop.
    assert result.value == [[a, 1, 2, 3, e, 5, 6, 7, 8, 9] for a in (0, 1) for e in (0, 1)]
    assert result.stats.generated == 4 + 4 * 4


@orders
def test_what_a_source_and_a_clause_share_is_computed_once(ss: ss2sql.Session, order: str) -> None:
    calls: list[int] = []

    def items(n: int) -> list[int]:
        calls.append(n)
        return [n, n + 1]

    ss.function("items", items, volatility="immutable")
    script = f"""SELECT a.this, len(items(3)), c.this FROM a = items(3), b = [x], c = items(x + 10)
        WHERE len(items(3)) == 2 START WITH x = 0 CONNECT BY {order} x = x + 1 STOP WITH x == 1 AS list;"""
    # Four steps from the first state, and from each of them four that stop and are goals.
    assert sorted(len(path) for path in native(ss, script).value) == 4 * [3] + 16 * [6]
    assert sorted(calls) == [3, 10, 11]


def test_a_call_that_sees_a_new_value_is_not_the_one_before() -> None:
    host = FakeHost({"double": lambda value: 2 * value})
    script = """SELECT x, y FROM [0] WHERE double(x) > 0 START WITH x = 1, y = 0
    CONNECT BY x = double(x), y = double(x) STOP WITH x == 4 AS list"""
    # Steps with x = 1, 2, 4; y is twice the new x.
    assert host.run(script) == [[1, 0], [1, 0, 2, 4], [1, 0, 2, 4, 4, 8]]


@pytest.mark.parametrize("options", ["DEPTH FIRST", "UNIQUE", "MEMORIZE 3"])
def test_an_argument_that_is_computed_once_is_there_for_every_state(options: str) -> None:
    # The key of `low(1)` is known when the second state comes; `plus` is called for each state nevertheless.
    host = FakeHost({"low": lambda n: n < 2, "plus": lambda low, n: [n, low]})
    script = "SELECT n + this FROM [1, 2] WHERE [3, True] == plus(low(1), n + this)"
    script += f" START WITH n = 0 CONNECT BY {options} n = n + this STOP WITH n + this > 3 AS list"
    assert host.run(script)[0][-1] == 3


@pytest.mark.parametrize(
    ("option", "argument"),
    [
        *[("MAXIMUM", "(0)"), ("MAXIMUM", "('a')"), ("MEMORIZE", "(1.5)"), ("COST", "-1"), ("COST", "'a'")],
        *[("COST 1 HEURISTIC", "-0.5"), ("PROBABILITY", "2"), ("PROBABILITY", "[]")],
    ],
)
def test_a_wrong_option_is_pointed_at(option: str, argument: str) -> None:
    error = FakeHost().error(f"SELECT this FROM [1]\nSTART WITH n = 1 CONNECT BY {option} {argument} n = 1")
    assert error.code == "X006"
    assert error.span is not None
    assert error.span.line == 2
    assert argument.strip("()") in error.span.text
