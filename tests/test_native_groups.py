"""GROUP BY, ORDER BY and queries in FROM in generated code: what is found, in which order, and what is asked when."""

from __future__ import annotations

import random
from typing import Any

import pytest
from native_host import FakeHost

import ss2sql
from ss2sql.runtime.values import places_in_order


def rows(script: str, **variables: Any) -> Any:
    return FakeHost(**variables).run(script)


def test_a_group_has_the_values_of_its_first_row() -> None:
    script = "SELECT this, count(*) FROM list GROUP BY this AS rows"
    assert repr(rows(script, list=[1.0, True, 1, None, "1", None])) == "[[1.0, 3], [None, 2], ['1', 1]]"
    assert repr(rows(script, list=[[1.0], [True], [2]])) == "[[[1.0], 2], [[2], 1]]"


def test_aggregates_skip_none_wherever_it_is() -> None:
    script = (
        "SELECT count(*), count(this), sum(this), min(this), max(this), average(this) FROM list GROUP BY True AS rows"
    )
    assert rows(script, list=[None, 3, None, 1]) == [[4, 2, 4, 1, 3, 2.0]]
    assert rows(script, list=[None]) == [[1, 0, 0, None, None, None]]
    assert rows(script, list=[]) == []
    assert rows(script, list=[2, 4]) == [[2, 2, 6, 2, 4, 3.0]]


@pytest.mark.parametrize(
    ("values", "total"),
    [([0.1] * 10, 1.0), ([1e308, 1e308, -1e308], 1e308), ([True, True], 2), ([2**62, -1], 2**62 - 1)],
)
def test_sums_are_exact(values: list[Any], total: Any) -> None:
    assert repr(rows("SELECT sum(this) FROM list GROUP BY 1 AS list", list=values)) == repr([total])


def test_groups_without_aggregates() -> None:
    host = FakeHost(list=[3, 1, 3, 2])
    assert host.run("SELECT this FROM list GROUP BY this AS list") == [3, 1, 2]
    assert host.run("SELECT 5 FROM list GROUP BY True AS list") == [5]
    assert host.run("SELECT this FROM list GROUP BY this HAVING count(*) > 1 ORDER BY this AS list") == [3]


def test_more_sources_than_loops_fit_into_a_function() -> None:
    sources = ", ".join(f"s{number} = [1, 2]" if number > 16 else f"s{number} = [1]" for number in range(20))
    script = f"SELECT s19.this, count(*), sum(s18.this) FROM {sources} GROUP BY s19.this AS rows"
    assert rows(script) == [[1, 4, 6], [2, 4, 6]]
    assert rows(f"SELECT count(*) FROM {sources} GROUP BY True AS rows") == [[8]]


def test_arguments_are_evaluated_before_values_and_all_rows_before_any_group() -> None:
    log: list[Any] = []

    def seen(value: Any, mark: Any) -> Any:
        log.append((mark, value))
        return value

    host = FakeHost({"seen": seen}, {"seen": "volatile"})
    script = "SELECT sum(seen(this, 'sum')) FROM [1, 2] GROUP BY seen(0, 'key') HAVING seen(count(*), 'having') AS list"
    assert host.run(script) == [3]
    assert log == [("sum", 1), ("key", 0), ("sum", 2), ("key", 0), ("having", 2)]


def test_an_error_of_an_aggregate_has_its_place() -> None:
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss2sql.connect().run("SELECT count(*), sum(this) FROM ['a'] GROUP BY True AS rows;", engine="native")
    assert caught.value.span is not None
    assert (caught.value.code, caught.value.span.text) == ("X007", "sum(this)")


@pytest.mark.parametrize("falling", [False, True])
@pytest.mark.parametrize("kinds", [(1, 2.5, True, 3), ("a", "b"), (None, 1, 2), ([1], [2], [1, 0])])
def test_the_first_ones_are_those_of_the_whole_order(falling: bool, kinds: tuple[Any, ...]) -> None:
    chance = random.Random(5)
    for count in (0, 1, 7, 8, 9, 50):
        column = [chance.choice(kinds) for _ in range(count)]
        order = places_in_order(count, [column], [falling])
        for limit in (0, 1, 2, 6):
            assert places_in_order(count, [column], [falling], limit)[:limit] == order[:limit]


def test_a_limit_does_not_hide_that_there_is_no_order() -> None:
    for limit in ("", "LIMIT 1"):
        with pytest.raises(ss2sql.ExecutionError) as caught:
            rows(f"SELECT this FROM list ORDER BY this {limit} AS list", list=[*range(20), "a"])
        assert caught.value.code == "X001"
    assert rows("SELECT this, -this FROM list ORDER BY -this LIMIT 2 AS rows", list=[1, 3, 2]) == [[3, -3], [2, -2]]


def test_too_many_rows_are_too_many_in_any_order() -> None:
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss2sql.connect().run("SELECT this FROM [1, 3, 2] ORDER BY -this AS list;", engine="native", max_rows=2)
    assert caught.value.code == "X010"


# --- loops inside of others ----------------------------------------------------------------------------


def test_the_loop_of_a_query_in_from_stands_inside() -> None:
    host = FakeHost(pairs=[{"a": 1, "b": 2}, {"a": 1, "b": 3}, {"a": 2, "b": 3}, {"a": 3, "b": 1}])
    query = host.query("SELECT n.this, p.b FROM n = [1, 2], p = (SELECT b FROM pairs WHERE a == n.this) AS rows")
    assert query.value(host.start()) == [[1, 2], [1, 3], [2, 3]]
    assert "list(" not in query.source_text


@pytest.mark.parametrize("order", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "COST 1", "UNIQUE DEPTH FIRST"])
@pytest.mark.parametrize("column", ["SELECT b", "SELECT a, b", "SELECT b, a", "SELECT *", "SELECT to(a + b - a, b)"])
def test_searches_over_such_loops(order: str, column: str) -> None:
    edges = [(1, 2), (1, 3), (2, 4), (3, 4), (4, 5), (2, 5)]
    ss = ss2sql.connect()
    ss.set("edges", [{"a": a, "b": b} for a, b in edges])
    ss.set("after", {"of": [[b for a, b in edges if a == node] for node in range(6)]})
    search = f"START WITH n = 1 CONNECT BY {order} n = @ STOP WITH n == 5 AS list;"
    read = ss.run(f"SELECT b FROM ({column} FROM edges WHERE a == n) {search.replace('@', 'b')}", engine="native")
    given = ss.run(f"SELECT m.this FROM m = after['of'][n] {search.replace('@', 'm.this')}", engine="native")
    assert read.value == given.value
    assert read.stats.generated == given.stats.generated


def test_a_query_that_can_fail_is_read_before_its_rows_are_used() -> None:
    printed: list[Any] = []
    host = FakeHost({"log": lambda value: printed.append(value) or value}, {"log": "volatile"})
    with pytest.raises(ss2sql.ExecutionError):
        host.run("SELECT log(p.c) FROM n = [6], p = (SELECT to(n.this / m.this, c) FROM m = [1, 2, 0]) AS list")
    assert printed == []
