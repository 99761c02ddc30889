"""The loops of native searches: when what is evaluated, what is counted when a search ends early, what is written."""

from __future__ import annotations

from itertools import islice
from typing import Any

import pytest
from native_host import FakeHost, generated_code

import ss2sql
from ss2sql.runtime.native.pace import SHORT, Parts
from ss2sql.runtime.native.searches import SEARCHES
from ss2sql.runtime.run import Run

ORDERS = ["DEPTH FIRST", "BREADTH FIRST", "COST 1", "COST 1 HEURISTIC 0", "PROBABILITY 0.5"]
REPEATS = ["", "NO CYCLE", "UNIQUE"]
MANY = 3 * SHORT + 5  # elements, so that they are walked in several parts


def session(**variables: Any) -> ss2sql.Session:
    ss = ss2sql.connect()
    for name, value in variables.items():
        ss.set(name, value)
    return ss


def native(script: str, ss: ss2sql.Session | None = None) -> ss2sql.Result:
    return (ss or session()).run(script, engine="native")


def counts(result: ss2sql.Result) -> tuple[int, int, int]:
    return result.stats.generated, result.stats.expanded, result.stats.pruned


# --- counts --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [0, SHORT - 1, SHORT, MANY - 1])
@pytest.mark.parametrize("repeats", REPEATS)
@pytest.mark.parametrize("order", ["DEPTH FIRST", "BREADTH FIRST"])
def test_only_steps_up_to_the_last_result_are_counted(order: str, repeats: str, place: int) -> None:
    result = native(
        f"""SELECT this FROM numbers WHERE this == {place} START WITH n = 0
            CONNECT BY {order} {repeats} MAXIMUM 1 n = this STOP WITH True AS list;""",
        session(numbers=list(range(MANY))),
    )
    assert result.value == [[place]]
    assert counts(result) == (place + 1, 0, 0)


@pytest.mark.parametrize("repeats", REPEATS)
@pytest.mark.parametrize("order", ["COST this + 1", "PROBABILITY 1 / (this + 1)"])
def test_all_steps_of_a_state_come_before_the_best_of_them(order: str, repeats: str) -> None:
    result = native(
        f"SELECT this FROM numbers START WITH n = 0 CONNECT BY {order} {repeats} MAXIMUM 2 n = this AS list;",
        session(numbers=list(range(MANY))),
    )
    # After the first result its state is expanded.
    assert result.value[0] == [0]
    assert (result.stats.generated, result.stats.expanded) == (2 * MANY, 1)


@pytest.mark.parametrize("repeats", REPEATS)
@pytest.mark.parametrize("order", ORDERS)
def test_steps_are_counted_up_to_the_one_that_fails(order: str, repeats: str) -> None:
    place = SHORT + 3
    host = FakeHost({}, numbers=list(range(MANY)))
    run = host.start()
    with pytest.raises(ss2sql.ExecutionError) as caught:
        host.run(
            f"""SELECT this FROM numbers WHERE 1 / ({place} - this) > 0 START WITH n = 0
                CONNECT BY {order} {repeats} n = this STOP WITH this >= 0""",
            run,
        )
    assert caught.value.span is not None
    assert caught.value.span.text == "/"
    assert run.stats.generated == place + 1


@pytest.mark.parametrize("order", ORDERS)
def test_a_search_that_is_not_begun_counts_nothing(order: str) -> None:
    result = native(f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {order} n = this LIMIT 0;")
    assert counts(result) == (0, 0, 0)


def test_nested_searches_count_together() -> None:
    inner = "(SELECT this FROM [1, 2, 3] START WITH m = 0 CONNECT BY m = this STOP WITH m > 0 AS list)"
    result = native(f"SELECT len({inner}) FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS list;")
    # Inside: 3 steps that go on, and 3 from each of them, which stop. Around it: 2 that go on, and 2 from each.
    # The inner search depends on nothing, so it is made once.
    assert result.value == [[3], [3]]
    assert counts(result) == (3 + 9 + 2 + 4, 3 + 2, 0)


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


def logged(options: str) -> list[Any]:
    """The arguments of volatile functions: lists where sources call one, numbers where SELECT does."""
    ss, log = session(), list[Any]()

    def noted(*arguments: int) -> list[int]:
        log.append(list(arguments))
        return [1, 2]

    def shown(value: int) -> int:
        log.append(value)
        return value

    ss.function("noted", noted, volatility="volatile")
    ss.function("shown", shown, volatility="volatile")
    native(
        f"""SELECT shown(10 * a.this + b.this) FROM a = noted(1, 2), b = noted(a.this, x) START WITH x = 0
            CONNECT BY {options} x = x + 1 STOP WITH x == 1;""",
        ss,
    )
    return log


def test_sources_are_read_between_steps_that_are_followed_at_once() -> None:
    # `a` is read once. Every value of it reads `b`; the first step is followed before the second is looked at.
    below = [[1, 1], [2, 1]]
    assert logged("DEPTH FIRST") == [[1, 2], [1, 0], 11, *below, 12, *below, [2, 0], 21, *below, 22, *below]


def test_sources_are_read_state_by_state() -> None:
    assert logged("BREADTH FIRST") == [[1, 2], [1, 0], 11, 12, [2, 0], 21, 22] + 4 * [[1, 1], [2, 1]]


def test_ten_sources_are_walked_in_any_order() -> None:
    names = "abcdefghij"
    sources = ", ".join(f"{name} = [0, 1]" if name in "ae" else f"{name} = [{at}]" for at, name in enumerate(names))
    columns = ", ".join(f"to({name}.this, {name})" for name in names)
    for order in ORDERS:
        for repeats in REPEATS:
            result = native(
                f"SELECT {columns} FROM {sources} START WITH n = 0 CONNECT BY {order} {repeats} n = n + 1 "
                "STOP WITH n == 1 AS list;"
            )
            # Those of the states behind stop.
            assert result.value == [[a, 1, 2, 3, e, 5, 6, 7, 8, 9] for a in (0, 1) for e in (0, 1)]
            assert result.stats.generated == 4 + 4 * 4


@pytest.mark.parametrize("order", ORDERS)
def test_what_a_source_and_a_clause_share_is_computed_once(order: str) -> None:
    calls: list[int] = []

    def items(n: int) -> list[int]:
        calls.append(n)
        return [n, n + 1]

    ss = session()
    ss.function("items", items, volatility="immutable")
    result = native(
        f"""SELECT a.this, len(items(3)), c.this FROM a = items(3), b = [x], c = items(x + 10)
            WHERE len(items(3)) == 2 START WITH x = 0 CONNECT BY {order} x = x + 1 STOP WITH x == 1 AS list;""",
        ss,
    )
    # Four steps from the first state, and from each of them four that stop and are goals.
    assert sorted(len(path) for path in result.value) == 4 * [3] + 16 * [6]
    assert sorted(calls) == [3, 10, 11]


@pytest.mark.parametrize("order", ORDERS)
def test_keys_see_the_step_of_their_result(order: str) -> None:
    result = native(
        f"""SELECT this FROM [3, 1, 2] START WITH x = 5 CONNECT BY {order} x = 10 * this STOP WITH x > 5
            ORDER BY x + this DESC LIMIT 2 AS list;"""
    )
    assert result.value == [[3], [2]]


# --- what is written -----------------------------------------------------------------------------------


def code_of(script: str, **variables: Any) -> str:
    """The generated code of the only query of a script."""
    [text] = generated_code(lambda: native(script, session(**variables)))
    return text


def test_a_loop_carries_nothing_that_the_script_does_not_ask_for() -> None:
    search = "SELECT n + this FROM moves START WITH n = 0 CONNECT BY {} MAXIMUM 3 n = n + this;"
    plain = code_of(search.format("BREADTH FIRST"), moves=[1])
    assert not any(word in plain for word in ("goal", "stop", "key", "weight", "estimate", "pruned += 1", "seen"))
    # The next state is the row, so the queue holds the way alone.
    assert "queue.append(new)" in code_of(search.format("UNIQUE"), moves=[1])


@pytest.mark.parametrize(
    ("heuristic", "late"), [("sqrt((goal - (x + this)) ^ 2)", True), ("sqrt((goal - y) ^ 2)", False)]
)
def test_a_heuristic_is_asked_of_rows_that_get_better_where_nobody_can_notice(heuristic: str, late: bool) -> None:
    text = code_of(
        f"""SELECT to(x + this, at) FROM moves WHERE x + this == goal START WITH x = 0, y = 0
            CONNECT BY COST 1 HEURISTIC {heuristic} UNIQUE MAXIMUM 1 x = x + this, y = y + 1;""",
        moves=[1, 2],
        goal=9,
    )
    assert (text.index("estimate = ") > text.index("= rank\n")) is late


def test_every_order_is_a_text_but_memorize_is_none() -> None:
    assert all(isinstance(order, str) is (repeats != "memorize") for (_, repeats), order in SEARCHES.items())
