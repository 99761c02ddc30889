"""Bounds of the numbers in columns of tables: what they are, what SQLite computes with them; never stale."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sessions import both, write

import ss2sql


@pytest.fixture
def ss(file: Path) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(file) as session:
        yield session


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [
        ([1], 1, 1),
        ([0, 1], 0, 1),
        ([3, 100], 2, 128),
        ([-5, None], -8, -4),
        ([-1, 33], -1, 64),
        ([0.25, 7.5], 0, 8),
        ([-0.25, 2], -1, 2),
        ([2**62], 2**62, 2**62),
        ([-(2**63), 2**63 - 1], None, None),
        ([1e308], 2**1023, None),
        ([1, "one"], None, None),
        ([None], None, None),
        ([], None, None),
    ],
)
@pytest.mark.parametrize("index", ["", "CREATE INDEX i ON t(a)"])
def test_bounds_are_powers_of_two(index: str, values: list[Any], low: float | None, high: float | None) -> None:
    ss = ss2sql.connect()
    ss.host.connection.execute(f"CREATE TABLE t(a, b); {index}")
    ss.host.connection.executemany("INSERT INTO t VALUES (?, 1)", [(value,) for value in values])
    assert bounds(ss, "t", "a") == (low, high)


def bounds(ss: ss2sql.Session, table: str, column: str) -> tuple[float | None, float | None]:
    source = ss.host.tables.find(None, table)
    assert source is not None
    kind = dict(source.columns)[column]
    return kind.low, kind.high


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_every_number_lies_within_the_bounds(values: list[float]) -> None:
    ss = ss2sql.connect()
    ss.host.connection.execute("CREATE TABLE t(a)")
    ss.host.connection.executemany("INSERT INTO t VALUES (?)", [(value,) for value in values])
    low, high = bounds(ss, "t", "a")
    assert low is None or all(low <= value for value in values)
    assert high is None or all(value <= high for value in values)


def test_views_have_no_bounds(ss: ss2sql.Session, file: Path) -> None:
    """The values of this one are others at each look."""
    write(file, "CREATE VIEW v AS SELECT random() AS a")
    assert bounds(ss, "v", "a") == (None, None)


@both
def test_an_infinity_is_no_number_of_the_language(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a REAL); INSERT INTO t VALUES (1.5), (9e999)")
    assert ss.run("SELECT a FROM t WHERE a < 2 AS list;", engine=engine).value == [1.5]
    for script in ("SELECT a + 1 FROM t;", "SELECT a * 0 FROM t;", "SELECT abs(a) FROM t;"):
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run(script, engine=engine)
        assert caught.value.code == "X004"


def test_a_row_within_the_bounds_changes_no_plan(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (40), (60)")
    query = ss.compile("SELECT a + 1 FROM t AS list;")
    (statement,) = query.statements()
    assert query.run().value == [41, 61]
    for number, kept in ((50, True), (33, True), (64, True), (65, False)):
        plan = statement.statement
        write(file, f"INSERT INTO t VALUES ({number})")
        assert query.run().value[-1] == number + 1
        assert (statement.statement is plan) is kept


LARGE = 2**53 + 1  # no float; a third of it is one
THIRDS = "SELECT a / 3 FROM t AS list;"


@both
def test_bounds_are_never_stale(ss: ss2sql.Session, file: Path, tmp_path: Path, engine: Any) -> None:
    """SQLite divides floats, which is right for small integers only."""
    write(file, "CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (6)")
    write(tmp_path / "other.db", "CREATE TABLE u(a INTEGER); INSERT INTO u VALUES (6)")
    ss.attach("other", tmp_path / "other.db")
    own = ss.host.connection
    changes: list[tuple[str, Callable[[str], Any]]] = [
        ("t", lambda text: write(file, text)),
        ("t", own.execute),
        ("u", lambda text: write(tmp_path / "other.db", text)),
        ("u", own.execute),
    ]
    for table, change in changes:
        query = ss.compile(THIRDS.replace("FROM t", f"FROM {table}"))
        assert query.run(engine=engine).value == [2.0]
        change(f"INSERT INTO {table} VALUES ({LARGE})")
        assert query.run(engine=engine).value == [2.0, 3002399751580331.0]
        change(f"UPDATE {table} SET a = 9 WHERE a > 6")
        assert query.run(engine=engine).value == [2.0, 3.0]
        change(f"DELETE FROM {table} WHERE a == 9")


@both
def test_bounds_go_with_a_transaction(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, f"CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (6), ({LARGE})")
    connection = ss.host.connection
    connection.execute(f"BEGIN; DELETE FROM t WHERE a = {LARGE}")
    query = ss.compile(THIRDS)
    assert query.run(engine=engine).value == [2.0]
    connection.execute("ROLLBACK")
    assert query.run(engine=engine).value == [2.0, 3002399751580331.0]


@both
def test_a_number_that_grows_too_large_for_a_sum(engine: Any) -> None:
    ss = ss2sql.connect()
    connection = ss.host.connection
    connection.execute("CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (1), (-1)")
    query = ss.compile("SELECT a + a FROM t AS list;")
    assert query.run(engine=engine).value == [2, -2]
    connection.execute(f"INSERT INTO t VALUES ({2**62 - 1})")
    assert query.run(engine=engine).value == [2, -2, 2**63 - 2]
    connection.execute(f"INSERT INTO t VALUES ({2**62})")
    with pytest.raises(ss2sql.ExecutionError) as caught:
        query.run(engine=engine)
    assert caught.value.code == "X004"
    connection.execute(f"DELETE FROM t WHERE a > {2**61}")
    assert query.run(engine=engine).value == [2, -2]


def test_sqlite_computes_with_small_numbers_by_itself(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(a INTEGER, b REAL); INSERT INTO t VALUES (3, 0.5)")
    query = ss.compile("SELECT a + 1, a * b, a - b FROM t AS rows;", engine="database")
    assert query.run().value == [(4, 1.5, 2.5)]
    assert "CASE" not in query.sql
    write(file, f"INSERT INTO t VALUES ({2**62 + 1}, 1)")
    assert query.run().value[1] == (2**62 + 2, float(2**62), float(2**62))
    assert "CASE" in query.sql
