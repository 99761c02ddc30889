"""`unnest`: nested queries over known lists become conditions; constant texts for `eval` are read early."""

from __future__ import annotations

from typing import Any

import pytest
from sessions import ENGINES

import ss2sql

MANY = [*range(99)]  # more than a sum of conditions would be made of
BOTH: tuple[list[str], ...] = ([], ["unnest"])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("[] == (SELECT this FROM [a.this, b.this] WHERE this == 2 AS list)", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("[] != (SELECT this FROM [a.this, b.this] WHERE this == 2 AS list)", [1, 2, 2, 1, 2, 2, 2, 3, 3, 2]),
        ("len(SELECT this FROM [a.this, b.this] WHERE this == 2 AS list) == 0", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("0 != len(SELECT this, 1 FROM [a.this] WHERE this == 2 AS rows)", [2, 1, 2, 2, 2, 3]),
        ("(SELECT this FROM [a.this] WHERE this == 1 OR this == 3 AS list) == [] AND b.this == 1", [2, 1]),
        ("NOT (SELECT this FROM [a.this, b.this] WHERE this > 1 AS list)", [1, 1]),
        ("(SELECT this FROM [a.this, b.this] WHERE this > 2 AS list) AND b.this == 1", [3, 1]),
        ("len(SELECT this FROM [a.this, b.this] WHERE this == 2 AS list) == 2", [2, 2]),
        ("len(SELECT this, 1 FROM [a.this, b.this] WHERE this == 2 AS list) >= 3", [2, 2]),
        (
            "len(SELECT this, 1 FROM [a.this, b.this] WHERE this == 2 AS list) > 1 AND b.this < 3",
            [1, 2, 2, 1, 2, 2, 3, 2],
        ),
        ("len(SELECT this, 1 FROM [a.this, b.this] WHERE this == 2 AS list) < 2", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("len(SELECT this, 1 FROM [a.this, b.this] WHERE this == 2 AS list) == 3", []),
        (f"len(SELECT this FROM {MANY} WHERE this < a.this AS list) > 2 AND b.this == 1", [3, 1]),
        ("b.this == 1 AND 2 / a.this IN (SELECT this FROM [a.this, 9] WHERE this < 2 AS list)", []),
        (
            "a.this IN (SELECT (SELECT c.this FROM c = [d.this + 2] AS value) FROM d = [0, 1] AS list) AND b.this == 2",
            [2, 2, 3, 2],
        ),
        ("[] == (SELECT c.this FROM c = zip([1], [2])[0] WHERE c.this == a.this AS list)", [3, 1, 3, 2, 3, 3]),
        ("count(SELECT this FROM [a.this, b.this, 2] WHERE this == 2 AS list) < 2", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("len(SELECT this FROM [a.this, b.this] WHERE this > 0 AS list) > 2", []),
        ("a.this IN (SELECT this + 1 FROM [b.this] AS list)", [2, 1, 3, 2]),
        ("a.this NOT IN (SELECT this FROM [b.this, 3] WHERE this != 1 AS list)", [1, 1, 1, 2, 1, 3, 2, 1, 2, 3]),
        ("max(SELECT this FROM [a.this, b.this] AS list) == 1", [1, 1]),
        ("max(SELECT this FROM [a.this, b.this] WHERE this < 3 AS list) == 2 AND a.this == 3", [3, 2]),
        ("min(SELECT this FROM [a.this, b.this] AS list) >= 3", [3, 3]),
        ("2 < max(SELECT this FROM [a.this, b.this] AS list) AND a.this == 1", [1, 3]),
        ("max(SELECT this FROM [a.this, b.this] WHERE this > 1 AS list) != 2 AND b.this == 1", [1, 1, 3, 1]),
        ("IF((SELECT this FROM [a.this] WHERE this == 2 AS list); b.this == 2; b.this == 1)", [1, 1, 2, 2, 3, 1]),
        ("[] == (SELECT this FROM [2, 3] WHERE this == a.this AS list)", [1, 1, 1, 2, 1, 3]),
    ],
)
def test_the_same_rows_as_without(engine: Any, condition: str, expected: list[int]) -> None:
    script = f"SELECT a.this, b.this FROM a = [1, 2, 3], b = [1, 2, 3] WHERE {condition} AS list;"
    for disable in BOTH:
        assert ss2sql.connect(disable=disable).run(script, engine=engine).value == expected


@pytest.mark.parametrize(
    ("condition", "where"),
    [
        ("NOT (SELECT this FROM [a.this, b.this] WHERE this > 1 AS list)", "a.this <= 1 AND b.this <= 1"),
        ("a.this IN (SELECT this + 1 FROM [b.this] AS list)", "a.this = b.this + 1"),
        ("[] == (SELECT this FROM [2, 3] WHERE this == a.this AS list)", "NOT (a.this IN (2, 3))"),
        ("min(SELECT this FROM [a.this, b.this] AS list) >= 3", "a.this >= 3 AND b.this >= 3"),
        ("eval('a' + '.this;') == 1", "a.this = 1"),
    ],
)
def test_what_the_sql_asks(condition: str, where: str) -> None:
    script = f"SELECT a.this FROM a = [1, 2, 3], b = [1, 2, 3] WHERE {condition} AS list;"
    assert str(ss2sql.connect().compile(script).sql).endswith(f"WHERE\n  {where}")
    assert where not in str(ss2sql.connect(disable=["unnest"]).compile(script).sql)


@pytest.mark.parametrize(
    "condition",
    [
        "[] == (SELECT this FROM [a.this, 'x'] WHERE this < 2 AS list)",  # fails for the second element
        "[] == (SELECT 1 / this FROM [a.this, 0] WHERE this < 2 AS list)",  # so does its column
        "[] == (SELECT this FROM [a.this, 1 / (a.this - 1)] WHERE True AS list)",  # and this element
        "max(SELECT this FROM [a.this] WHERE this > 9 AS list) > 1",  # None has no order
        "max(SELECT this FROM [a.this, 'x'] AS list) == 1",  # the elements have none among each other
        "eval('a.that;') == 1",  # no such column
        "eval('a.this') AND eval('1 / 0') == 1",
        "eval('SELECT') == 1",
    ],
)
@pytest.mark.parametrize("engine", ["auto", "native"])
def test_what_can_fail_fails_as_without(engine: Any, condition: str) -> None:
    script = f"SELECT this FROM a = [1, 2] WHERE {condition} AS list;"
    messages = set()
    for disable in BOTH:
        with pytest.raises(ss2sql.Error) as caught:
            ss2sql.connect(disable=disable).run(script, engine=engine)
        messages.add(str(caught.value))
    assert len(messages) == 1


def test_a_text_with_effects_stays() -> None:
    script = "n = 0; SELECT this FROM [1, 2] WHERE eval('n = n + this') > 0 AS list;"
    assert ss2sql.connect().eval(script + " n;") == 3
    query = ss2sql.connect().compile("SELECT this FROM [1, 2] WHERE eval('this > 0; this > 1') AS list")
    assert "eval reads its text" in str(query.sql)
    assert query.run().value == [2]


def test_a_text_sees_the_state_of_a_search() -> None:
    script = "SELECT this FROM [1, 2] WHERE True START WITH x = 1 CONNECT BY x = eval('x + 1') STOP WITH eval('x') > 2"
    for disable in BOTH:
        assert len(ss2sql.connect(disable=disable).eval(script)) == 14  # 2 + 4 + 8 paths


# --- lists in variables --------------------------------------------------------------------------------

WITHOUT = "SELECT a.this FROM a = [1, 2, 3] WHERE [] == (SELECT this FROM banned WHERE this < a.this AS list) AS list"


def sql_of(query: ss2sql.Query) -> str:
    return str(query.sql)


def test_a_constant_list_in_a_variable_is_known_before_the_run() -> None:
    assert "2 >= a.this" in sql_of(ss2sql.connect().compile(f"banned = [2]; {WITHOUT}"))
    ss = ss2sql.connect()
    ss.attach("banned", [2])
    assert "2 >= a.this" in sql_of(ss.compile(WITHOUT))
    assert "collect(" in sql_of(ss.compile(f"banned = sorted(banned); {WITHOUT}"))


@pytest.mark.parametrize("engine", ENGINES)
def test_the_query_is_made_anew_when_the_list_has_changed(engine: Any) -> None:
    ss = ss2sql.connect()
    banned: list[Any] = [2]
    ss.attach("banned", banned)
    query = ss.compile(WITHOUT)
    assert query.run(engine=engine).value == [1, 2]
    banned.append(1)
    assert query.run(engine=engine).value == [1]
    banned[:] = []
    assert query.run(engine=engine).value == [1, 2, 3]
    banned[:] = [1.0]
    assert query.run(engine=engine).value == [1]
    banned[:] = list(range(2000, 4000))  # too long to be taken apart
    assert query.run(engine=engine).value == [1, 2, 3]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_list_that_an_earlier_statement_computes_counts_as_it_is_then(engine: Any) -> None:
    script = f"banned = [3]; banned = sorted([9] + banned); {WITHOUT}"
    ss = ss2sql.connect()
    ss.set("banned", [1])
    assert ss.run(script, engine=engine).value == [1, 2, 3]
    assert ss.get("banned") == [3, 9]
    assert "3 >= a.this" in str(ss.run(script, engine="database").sql)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_parameter_may_be_such_a_list(engine: Any) -> None:
    query = ss2sql.connect().compile(WITHOUT)
    assert query.parameters == ("banned",)
    for banned, expected in (([2], [1, 2]), ([1, 9], [1]), ([], [1, 2, 3])):
        assert query.run(engine=engine, banned=banned).value == expected


def test_pairs_of_names_that_are_a_parameter_run_in_the_database() -> None:
    script = """SELECT a.this, b.this FROM a = [1, 2], b = [1, 2] WHERE [] == (SELECT this FROM pairs
    WHERE eval(this[0] + ".this;") == eval(this[1] + ".this;") AS list) AS list"""
    ss = ss2sql.connect()
    assert ss.run(script, engine="database", pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    query = ss.compile(script, engine="database")
    assert "no SQL" in sql_of(query)
    assert query.run(pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    assert query.run(pairs=[["a", "a"]]).value == []
    with pytest.raises(ss2sql.UnsupportedError, match="eval"):
        query.run(pairs=[["a", "c"]])
    with pytest.raises(ss2sql.ResolveError, match="no source named 'c'"):
        ss.run(script, pairs=[["a", "c"]])


@pytest.mark.parametrize("engine", ["auto", "native"])
def test_a_query_that_changes_the_list_reads_it_each_time(engine: Any) -> None:
    script = """banned = [2]; found = SELECT a.this FROM a = [1, 2, 3] WHERE
    [] == (SELECT this FROM banned WHERE this == a.this AS list) AND (banned = banned + [a.this + 2]) AS list; found;"""
    assert ss2sql.connect().run(script, engine=engine).value == [1]


def test_a_function_that_changes_the_list_before_the_query_is_noticed() -> None:
    ss = ss2sql.connect()

    @ss.function(volatility="volatile")
    def ban(x: int) -> int:
        ss.run(f"banned = [{x}];")
        return x

    assert ss.run(f"banned = [3]; ban(1); {WITHOUT}").value == [1]


def test_a_text_relies_on_the_types_of_its_variables() -> None:
    ss = ss2sql.connect()
    ss.set("n", 1)
    query = ss.compile("SELECT this FROM [1, 2, 3] WHERE this > eval('n') AS list")
    assert "eval" not in sql_of(query)
    for value, expected in ((1, [2, 3]), (2.5, [3]), (0, [1, 2, 3])):
        ss.set("n", value)
        assert query.run().value == expected
    ss.set("n", "x")
    with pytest.raises(ss2sql.ExecutionError):
        query.run()


def test_a_replaced_operator_keeps_its_meaning() -> None:
    for disable in BOTH:
        ss = ss2sql.connect(disable=disable)
        ss.function("ne", lambda a, b: True, volatility="immutable")
        script = "SELECT a.this FROM a = [1, 2] WHERE [] == (SELECT this FROM [a.this] WHERE this == 1 AS list) AS list"
        assert ss.eval(script) == [2]


@pytest.mark.parametrize("disabled", BOTH)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("word", ["IN", "NOT IN"])
def test_what_is_looked_for_is_computed_even_if_nothing_is_in_the_list(engine: Any, disabled: Any, word: str) -> None:
    script = f"SELECT a.this FROM a = [0] WHERE 1 / a.this {word} (SELECT this FROM [a.this, 2] WHERE this > 5 AS list)"
    with ss2sql.connect(disable=disabled) as ss, pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == "X002"
