"""Numbers and strings that are compared with a parameter of which nothing is known before the query runs."""

from __future__ import annotations

import itertools
from decimal import Decimal
from fractions import Fraction
from typing import Any

import pytest
from balls import BallWorld, Box
from random_values import label

import ss2sql

ROWS = [{"a": 1, "b": "x", "c": 1.5}, {"a": 2, "b": "1", "c": 2.0}, {"a": 2**53 + 1, "b": "", "c": 0.1}]
VALUES = [
    1, 2, 1.0, 1.5, 2.5, 0.1, 2**53 + 1, 2.0**53, True, False, None, "x", "1", "", "\ud800", b"1",
    Decimal(1), Decimal("1.5"), Decimal("0.1"), Fraction(3, 2), [1], [], {"a": 1}, {}, object(),
]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=label)
def test_values_equal_what_python_says_and_objects_nothing(ss: ss2sql.Session, engine: Any, value: Any) -> None:
    ss.attach("rows", ROWS)
    ss.host.connection.execute("CREATE TABLE t(a INTEGER, b TEXT, c REAL)")
    ss.host.connection.executemany("INSERT INTO t VALUES(:a, :b, :c)", ROWS)
    for source, column in itertools.product(("rows", "t"), "abc"):
        is_object = isinstance(value, Decimal | Fraction)  # objects equal objects only
        equal = [row["a"] for row in ROWS if row[column] == value and not is_object]
        other = [row["a"] for row in ROWS if row["a"] not in equal]
        for condition, expected in ((f"{column} == n", equal), (f"n == {column}", equal), (f"{column} != n", other)):
            query = ss.compile(f"SELECT a FROM {source} WHERE {condition} AS list;")
            assert query.run(engine=engine, n=value).value == expected, (source, condition)


def test_sqlite_compares_them_by_itself(ss: ss2sql.Session) -> None:
    ss.attach("things", ROWS)
    text = ss.compile("SELECT a FROM things WHERE a == n AND b != n;").sql
    assert "things.a IS :n AND things.b IS NOT :n_2" in " ".join(text.split())


def test_a_world_is_asked_for_the_one_that_is_wanted(ss: ss2sql.Session, engine: Any) -> None:
    box = Box.row(50)
    ss.attach("space", BallWorld(box))
    query = ss.compile("SELECT name FROM space WHERE id == n AS list;")
    assert query.run(engine=engine, n=7).value == ["ball7"]
    assert box.calls["given"] == 1
    assert query.run(engine=engine, n="7").value == []
    assert query.run(engine=engine, n=Decimal(8)).value == []
