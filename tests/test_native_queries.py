"""The native executor on flat queries: products, filters, sources, groups, order, limits, and counted calls."""

from __future__ import annotations

from typing import Any

import pytest
from native_host import FakeHost, place

from ss2sql import plan
from ss2sql.errors import Source, Span
from ss2sql.kinds import INT, STR


def twice(value: int) -> int:
    return 2 * value


def test_the_last_source_varies_fastest() -> None:
    assert FakeHost().run("SELECT a.this, b.this FROM a = [1, 2], b = ['x', 'y'] AS rows") == [
        [1, "x"],
        [1, "y"],
        [2, "x"],
        [2, "y"],
    ]


def test_an_earlier_source_in_a_later_one() -> None:
    host = FakeHost({"below": lambda n: list(range(n))})
    assert host.run("SELECT a.this, b.this FROM a = [2, 0, 3], b = below(a.this) AS rows") == [
        [2, 0],
        [2, 1],
        [3, 0],
        [3, 1],
        [3, 2],
    ]


def test_a_source_is_read_again_only_for_what_it_mentions() -> None:
    host = FakeHost({"below": lambda n: list(range(n))})
    run = host.start()
    host.run("SELECT 1 FROM a = [2, 3], b = [5, 6, 7], c = below(a.this), d = below(2)", run)
    # below(a.this) once for each of the two elements of a, below(2) once.
    assert run.stats.calls["below"] == 3


def test_a_volatile_source_that_mentions_nothing_is_read_once() -> None:
    host = FakeHost({"draw": lambda: [1, 2]}, {"draw": "volatile"})
    run = host.start()
    assert len(host.run("SELECT 1 FROM a = [1, 2, 3], b = draw()", run)) == 6
    assert run.stats.calls["draw"] == 1


# --- WHERE ---------------------------------------------------------------------------------------------


def test_conditions_are_tested_from_left_to_right() -> None:
    host = FakeHost(l=[0, 1, 2])
    assert host.run("SELECT this FROM l WHERE this != 0 AND 2 / this > 1 AS list") == [1]
    assert host.error("SELECT this FROM l WHERE 2 / this > 1 AND this != 0 AS list").code == "X002"


def test_an_empty_later_source_spares_the_conditions() -> None:
    host = FakeHost(l=[0], empty=[])
    assert host.run("SELECT 1 FROM l, empty WHERE 1 / l.this > 0") == []
    assert host.error("SELECT 1 FROM l, k = [1] WHERE 1 / l.this > 0").code == "X002"


def test_a_condition_that_cannot_fail_may_hide_no_error() -> None:
    host = FakeHost(l=[0, 1], k=[5])
    # Written first, so it is met before the other condition drops the element 0.
    assert host.error("SELECT 1 FROM l, k WHERE 1 / l.this > 0 AND l.this == 1").code == "X002"
    assert host.run("SELECT l.this FROM l, k WHERE l.this == 1 AND 1 / l.this > 0 AS list") == [1]


def test_early_conditions_save_calls() -> None:
    host = FakeHost({"twice": twice}, l=list(range(10)))
    run = host.start()
    host.run("SELECT 1 FROM a = l, b = l WHERE twice(a.this) == 4 AND twice(b.this) == 6", run)
    # Ten times for a, and ten times for b with the one a that passes.
    assert run.stats.calls["twice"] == 20


def test_volatile_conditions_are_called_for_every_combination() -> None:
    host = FakeHost({"twice": twice}, {"twice": "volatile"}, l=list(range(10)))
    run = host.start()
    host.run("SELECT 1 FROM a = l, b = l WHERE twice(a.this) == 4 AND twice(b.this) == 6", run)
    # 100 times the left one; the right one where a passes.
    assert run.stats.calls["twice"] == 110


def test_a_lateral_source_is_read_before_later_conditions() -> None:
    host = FakeHost({"near": lambda n: [1 / n]}, l=[0, 1])
    with pytest.raises(ZeroDivisionError):
        host.run("SELECT 1 FROM a = l, b = near(a.this) WHERE a.this == 1")


def test_nested_calls_run_once_for_each_of_their_elements() -> None:
    host = FakeHost({"add1": lambda a, b: [*b, a]}, l=[1, 2, 3])
    run = host.start()
    host.run("SELECT 1 FROM a = l, b = l, c = l WHERE add1(c.this, add1(b.this, add1(a.this, []))) == [3, 2, 1]", run)
    assert run.stats.calls["add1"] == 3 + 9 + 27


def test_a_repeated_call_runs_once_per_row() -> None:
    host = FakeHost({"twice": twice}, l=[1, 2])
    run = host.start()
    assert host.run("SELECT twice(this), twice(this) + 1 FROM l WHERE twice(this) > 2 AS rows", run) == [[4, 5]]
    assert run.stats.calls["twice"] == 2


def test_a_call_of_constants_runs_once_and_only_if_needed() -> None:
    host = FakeHost({"twice": twice}, l=[1, 2, 3], empty=[])
    run = host.start()
    assert host.run("SELECT this + twice(4) FROM l AS list", run) == [9, 10, 11]
    assert run.stats.calls["twice"] == 1
    host.run("SELECT this + twice(5) FROM empty AS list", run)
    assert run.stats.calls["twice"] == 1


def test_numbers_of_different_kinds_are_different_arguments() -> None:
    host = FakeHost({"show": lambda value: repr(value)})
    assert host.run("SELECT show(1), show(1.0), show(True), show(1) FROM [0] AS list") == ["1", "1.0", "True", "1"]


# --- nested queries ------------------------------------------------------------------------------------


def test_a_nested_query_sees_the_outer_row() -> None:
    host = FakeHost(l=[1, 2, 3])
    assert host.run("SELECT this, (SELECT b.this FROM b = l WHERE b.this < a.this AS list) FROM a = l AS rows") == [
        [1, []],
        [2, [1]],
        [3, [1, 2]],
    ]


def test_a_nested_query_that_sees_nothing_runs_once() -> None:
    host = FakeHost({"twice": twice}, l=[1, 2, 3])
    run = host.start()
    script = "SELECT this FROM l WHERE this IN (SELECT twice(b.this) FROM b = l AS list) AS list"
    assert host.run(script, run) == [2]
    assert run.stats.calls["twice"] == 3


def test_a_nested_query_with_volatile_calls_runs_every_time() -> None:
    host = FakeHost({"twice": twice}, {"twice": "volatile"}, l=[1, 2, 3])
    run = host.start()
    host.run("SELECT this FROM l WHERE this IN (SELECT twice(b.this) FROM b = l AS list) AS list", run)
    assert run.stats.calls["twice"] == 9


def test_a_nested_query_in_a_nested_query_runs_once_per_row_that_it_sees() -> None:
    host = FakeHost({"twice": twice}, l=[1, 2])
    run = host.start()
    script = """SELECT (SELECT b.this + max((SELECT twice(c.this) FROM c = [a.this] AS list)) FROM b = l AS list)
    FROM a = l AS list"""
    assert host.run(script, run) == [[3, 4], [5, 6]]
    assert run.stats.calls["twice"] == 2


def test_rows_of_a_query_in_from() -> None:
    host = FakeHost(l=[1, 2, 3])
    assert host.run("SELECT q.n, q.this FROM q = (SELECT to(this, n), this * this FROM l) WHERE q.n > 1 AS rows") == [
        [2, {"n": 2, "this * this": 4}],
        [3, {"n": 3, "this * this": 9}],
    ]
    assert host.run("SELECT this FROM (SELECT this FROM l AS list) AS list") == [1, 2, 3]
    assert host.run("SELECT this FROM (SELECT this, this FROM l LIMIT 1 AS rows) AS list") == [[1, 1]]


def test_a_late_list_is_read_for_each_row() -> None:
    host = FakeHost()
    script = "pairs = [[a.this, b.this]]; SELECT a.this, b.this FROM a = [1, 2], b = [2, 1] "
    script += "WHERE [] == (SELECT this FROM pairs WHERE this[0] == this[1] AS list) AS rows"
    assert host.run(script) == [[1, 2], [2, 1]]


# --- tables and lookups --------------------------------------------------------------------------------


def table(name: str, rows: list[tuple[Any, ...]]) -> dict[str, tuple[plan.TableSource, list[tuple[Any, ...]]]]:
    span = Span(Source(""), 0, 0)
    columns = (("id", INT), ("boss", INT), ("name", STR))
    return {name: (plan.TableSource(0, name, "main", name, columns, ("rowid",), span=span), rows)}


STAFF = [(1, 0, "Ada"), (2, 1, "Bob"), (3, 1, "Cyd"), (4, 2, "Dan"), (5, 4, "Eve")]


def test_a_table_gives_columns_and_rows() -> None:
    host = FakeHost(tables=table("staff", STAFF))
    assert host.run("SELECT name, this FROM staff WHERE boss == 1 LIMIT 1 AS rows") == [
        ["Bob", {"id": 2, "boss": 1, "name": "Bob"}]
    ]


def test_a_join_reads_the_table_once_and_looks_up() -> None:
    host = FakeHost({"note": twice}, tables=table("staff", STAFF))
    query = host.query("SELECT a.name, b.name FROM a = staff, b = staff WHERE b.boss == a.id AS rows")
    assert query.value(host.start()) == [["Ada", "Bob"], ["Ada", "Cyd"], ["Bob", "Dan"], ["Dan", "Eve"]]
    assert "index_of_plain(" in query.source_text


def test_a_hierarchy_costs_its_size() -> None:
    number = 3000
    rows = [(index + 1, (index + 1) // 2, str(index)) for index in range(number)]
    host = FakeHost(tables=table("staff", rows))
    in_source = "SELECT id FROM (SELECT * FROM staff WHERE boss == top) START WITH top = 1 CONNECT BY top = id"
    in_where = "SELECT id FROM staff WHERE boss == top START WITH top = 1 CONNECT BY top = id STOP WITH boss != top"
    # Below 1 are 2 and 3, below k are 2k and 2k + 1: everybody but 1.
    for script in (in_source, in_where):
        run = host.start()
        assert len(host.run(script, run)) == number - 1
        assert run.stats.generated == number - 1
    assert host.reads == 2


def test_equal_values_are_found_whatever_their_kind() -> None:
    host = FakeHost(rows=[{"k": 1}, {"k": 1.0}, {"k": True}, {"k": [1, 2]}, {"k": [1.0, 2]}, {}, {"k": "1"}])
    script = "SELECT (SELECT b.k FROM b = rows WHERE b.k == a.this AS list) FROM a = [1.0, [1, 2.0], None, 'x'] AS list"
    assert host.run(script) == [[1, 1.0, True], [[1, 2], [1.0, 2]], [None], []]


# --- order, limits, groups -----------------------------------------------------------------------------


def test_order_is_stable_and_puts_none_first() -> None:
    host = FakeHost(rows=[{"k": 2, "n": 1}, {"k": None, "n": 2}, {"k": 1, "n": 3}, {"k": 2, "n": 4}])
    assert host.run("SELECT n FROM rows ORDER BY k AS list") == [2, 3, 1, 4]
    assert host.run("SELECT n FROM rows ORDER BY k DESC AS list") == [1, 4, 3, 2]
    assert host.run("SELECT n FROM rows ORDER BY k DESC, n DESC LIMIT 2 AS list") == [4, 1]


def test_a_limit_without_order_stops_early() -> None:
    host = FakeHost({"twice": twice}, {"twice": "volatile"}, l=list(range(100)))
    run = host.start()
    assert host.run("SELECT twice(this) FROM l LIMIT 3 AS list", run) == [0, 2, 4]
    assert run.stats.calls["twice"] == 3
    assert host.run("SELECT this FROM l LIMIT 0 AS list") == []


@pytest.mark.parametrize("value", ["-1", "1.5", "'a'", "None", "True"])
def test_a_wrong_limit(value: str) -> None:
    error = FakeHost(l=[1], n=None).error(f"SELECT this FROM l LIMIT (0 + {value})".replace("0 + '", "'").replace(
        "0 + None", "n").replace("0 + True", "1 == 1"))  # fmt: skip
    assert error.code == "X006"
    assert place(error).startswith("1:2")


def test_groups_of_aggregates() -> None:
    host = FakeHost(rows=[{"k": "a", "n": 1}, {"k": "b", "n": 5}, {"k": "a", "n": None}, {"k": "a", "n": 3}])
    assert host.run("SELECT k, count(*), count(n), sum(n), max(n), average(n) FROM rows GROUP BY k AS rows") == [
        ["a", 3, 2, 4, 3, 2],
        ["b", 1, 1, 5, 5, 5],
    ]
    assert host.run("SELECT k FROM rows GROUP BY k HAVING count(*) == 1 AS list") == ["b"]
    assert host.run("SELECT k, sum(n) FROM rows GROUP BY k ORDER BY sum(n) DESC LIMIT 1 AS list") == ["b", 5]
    assert host.run("SELECT count(*) FROM [] GROUP BY this AS list") == []


def test_equal_keys_are_one_group_shown_by_the_first() -> None:
    assert FakeHost().run("SELECT this, count(*) FROM [1.0, 1, 2, True] GROUP BY this AS rows") == [[1.0, 3], [2, 1]]


def test_partitions() -> None:
    host = FakeHost(rows=[{"k": "a", "n": 1}, {"k": "b", "n": 5}, {"k": "a", "n": 3}])
    assert host.run("SELECT n FROM rows GROUP BY k AS list") == {"a": [1, 3], "b": [5]}
    assert host.run("SELECT n FROM rows GROUP BY k, n > 1 AS list") == {
        ("a", False): [1],
        ("b", True): [5],
        ("a", True): [3],
    }
    assert host.run("SELECT n FROM rows GROUP BY [k] AS list") == {("a",): [1, 3], ("b",): [5]}
    assert host.run("SELECT n FROM rows GROUP BY k HAVING count(*) > 1 AS list") == {"a": [1, 3]}
    assert host.run("SELECT n FROM rows GROUP BY k ORDER BY n DESC AS list") == {"b": [5], "a": [3, 1]}


def test_having_may_ask_a_nested_query() -> None:
    host = FakeHost(rows=[{"k": "a", "n": 1}, {"k": "b", "n": 5}], big=["b"])
    script = "SELECT k FROM rows GROUP BY k HAVING [] != (SELECT this FROM big WHERE this == rows.k AS list) AS list"
    assert host.run(script) == ["b"]


def test_computed_names_of_columns() -> None:
    host = FakeHost(l=[1])
    assert host.run("SELECT to(this, 'n' + 'x'), to(2, 'n' + 'x') FROM l") == [{"nx": 1, "nx_2": 2}]
    assert host.run("SELECT q.nx FROM q = (SELECT to(this, 'n' + 'x') FROM l) AS list") == [1]


def test_order_of_evaluation() -> None:
    seen: list[str] = []

    def note(word: str, value: Any) -> Any:
        seen.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    host.run("SELECT note('s', this) FROM [1] WHERE note('w', 1) GROUP BY note('g', 1) ORDER BY note('o', 1)")
    assert seen == ["w", "s", "g", "o"]
    seen.clear()
    script = "SELECT sum(note('s', a.this)) FROM a = [1, 2] GROUP BY note('g', 1) HAVING max(note('h', a.this)) == 2"
    host.run(script)
    assert seen == ["s", "h", "g", "s", "h", "g"]
