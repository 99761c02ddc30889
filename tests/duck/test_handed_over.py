"""Tables of DuckDB for queries that run in SQLite or in Python: what WHERE cannot keep stays in DuckDB."""

from __future__ import annotations

import ast
from functools import cached_property
from typing import Any

import pytest
from agreement import exact
from golden import each_row
from sessions import code_of

import ss2sql
from ss2sql.vtables.frames import Column

duckdb = pytest.importorskip("duckdb")

SALES = [{"id": i, "kind": i % 7, "name": f"n{i % 3}", "price": i / 2} for i in range(100)]
# A road from each number to the next three, and the names of some.
ROADS = [{"here": i // 3, "there": i // 3 + 1 + i % 3} for i in range(90)]
TOWNS = [{"id": 5 * i, "name": f"n{i}", "list": [i]} for i in range(6)]


@pytest.fixture
def ss(own: Any, ss: ss2sql.Session) -> ss2sql.Session:
    own.execute("""
        CREATE TABLE sales AS
        SELECT i AS id, i % 7 AS kind, 'n' || i % 3 AS name, i / 2.0::DOUBLE AS price FROM range(100) AS r(i);
        CREATE TABLE roads AS SELECT i // 3 AS here, i // 3 + 1 + i % 3 AS there FROM range(90) AS r(i);
        CREATE TABLE towns AS SELECT 5 * i AS id, 'n' || i AS name, [i] AS list FROM range(6) AS r(i);
    """)
    ss.engine = "auto"
    ss.function("last", lambda n: int(str(n)[-1]), volatility="immutable")
    ss.function("turned", lambda n: "".join(reversed(str(n))), volatility="immutable")
    return ss


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many values come out of DuckDB, column by column."""
    lengths: list[int] = []
    values = Column.values.func

    def look(column: Column) -> Any:
        found = values(column)
        lengths.append(len(found))
        return found

    watched = cached_property(look)
    watched.__set_name__(Column, "values")
    monkeypatch.setattr(Column, "values", watched)
    return lengths


def handed(result: ss2sql.Result) -> list[str]:
    """The tables whose rows DuckDB hands over, and what it asks of them."""
    start = "DuckDB hands over the rows of "
    lines = [line.strip() for line in str(result.explain()).splitlines()]
    return [line.removeprefix(start) for line in lines if line.startswith(start)]


def as_without_tables(ss: ss2sql.Session, script: str, value: Any) -> None:
    """Where the tables are lists, the query gives the same natively."""
    for name, rows in {"sales": SALES, "roads": ROADS, "towns": TOWNS}.items():
        ss.set(name, rows)
    again = ss.run(script, engine="native")
    assert handed(again) == []
    assert exact(again.value) == exact(value)


# --- which rows are read -----------------------------------------------------------------------------------


def test_functions_of_python_are_asked_of_few_rows(ss: ss2sql.Session, read: list[int], engine: Any) -> None:
    script = "SELECT id, last(id) FROM sales WHERE kind == most AND price > 20 AND last(id) > 4 AS rows"
    result = ss.run(script, engine=engine, most=3)
    assert result.value == [(n, n % 10) for n in range(100) if n % 7 == 3 and n > 40 and n % 10 > 4]
    assert read
    assert set(read) == {len([n for n in range(41, 100) if n % 7 == 3])}
    assert handed(result) == ["sales with kind == most AND price > 20"]


def test_what_may_fail_is_spared_by_what_stands_before_it(ss: ss2sql.Session, read: list[int]) -> None:
    assert ss.eval("SELECT id FROM sales WHERE kind == 5 AND 10 / (id - 3) > 1 AS list") == [5, 12]
    assert set(read) <= {14}


@each_row("tables/handed-over", "script", "told")
def test_which_rows_are_read(ss: ss2sql.Session, read: list[int], script: str, told: str) -> None:
    count = ast.literal_eval(told)
    value = ss.eval(f"SELECT {script}")
    assert set(read) == count
    as_without_tables(ss, f"SELECT {script}", value)


@pytest.mark.parametrize("engine", ["native", "auto"])
def test_a_query_in_a_text_reads_rows_of_its_own(ss: ss2sql.Session, engine: Any) -> None:
    """It has a source of the same name, which the query around it goes on reading."""
    inner = "SELECT b.id FROM b = sales WHERE b.kind == 2 AND last(b.id) < 5 AND b.id < 30 AS list"
    found = ss.run(
        "SELECT a.id, b.id FROM a = sales, b = sales WHERE a.kind == 1 AND a.id < 9 AND b.kind == 3"
        f' AND eval("{inner}") == [2, 23] AND last(b.id) == 0 AS rows',
        engine=engine,
    )
    assert found.value == [(1, 10), (1, 80), (8, 10), (8, 80)]


# --- joins -------------------------------------------------------------------------------------------------


def test_the_rows_of_the_product_come_in_its_order(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT here, name, turned(there) FROM towns, roads WHERE id == there AND here > 3 AND turned(id) != '51'"
    result = ss.run(f"{script} AS rows", engine=engine)
    assert result.value == [
        (road["here"], town["name"], str(road["there"])[::-1])
        for town in TOWNS
        for road in ROADS
        if town["id"] == road["there"] and road["here"] > 3 and town["id"] != 15
    ]
    assert handed(result) == ["roads with here > 3"]


def test_columns_with_strange_names(own: Any, ss: ss2sql.Session) -> None:
    own.execute('CREATE TABLE "Places" AS SELECT id AS "Name", name AS "this way" FROM towns')
    script = "SELECT turned(towns.name), x.Name FROM towns, x = Places WHERE towns.id == x.Name"
    found = ss.run(f"{script} AND x.Name > 9 AS rows")
    assert handed(found) == ["x with x.Name > 9"]
    assert found.value == [("2n", 10), ("3n", 15), ("4n", 20), ("5n", 25)]


def test_what_is_no_value_of_the_language(own: Any, ss: ss2sql.Session) -> None:
    own.execute("CREATE TABLE odd AS SELECT i AS id, i::VARCHAR::BIT AS m FROM range(2) AS r(i)")
    script = "SELECT turned({}) FROM towns, odd WHERE towns.id == odd.id AS list"
    assert ss.eval(script.format("odd.id")) == ["0"]
    assert code_of(ss.run, script.format("odd.m")) == "X004"


# --- what changes ------------------------------------------------------------------------------------------


def test_a_compiled_query_reads_what_is_there(own: Any, ss: ss2sql.Session) -> None:
    ss.set("wanted", "n1")
    query = ss.compile("SELECT turned(there) FROM towns, roads WHERE id == here AND name == wanted AS list")
    assert query.run().value == ["6", "7", "8"]
    assert handed(query.run()) == ["towns with name == wanted"]
    assert query.run(wanted="n2").value == ["11", "21", "31"]
    own.execute("INSERT INTO roads VALUES (5, 99)")
    assert query.run(wanted="n1").value == ["6", "7", "8", "99"]
    for wanted in ([1], None):  # DuckDB cannot ask that
        assert query.run(wanted=wanted).value == []
    assert query.run(wanted="n1").value == ["6", "7", "8", "99"]
    own.execute("INSERT INTO roads VALUES (NULL, 7)")
    assert code_of(ss.run, "SELECT turned(there) FROM roads WHERE here > 28 AS list") == "X001"  # None has no order
    own.execute("CREATE OR REPLACE TABLE towns AS SELECT '5' AS id, 'n1' AS name")
    assert query.run(wanted="n1").value == []
    own.execute("DROP TABLE towns")
    assert code_of(query.run, wanted="n1") == "R003"


def test_a_connection_that_compares_texts_in_another_way(own: Any, ss: ss2sql.Session) -> None:
    script = "SELECT last(id) FROM sales WHERE name == 'N1' AS list"
    assert handed(ss.run(script)) == ["sales with name == 'N1'"]
    own.execute("SET default_collation = 'nocase'")
    assert ss.eval(script) == []
