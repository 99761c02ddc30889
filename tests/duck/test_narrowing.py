"""Tables of DuckDB for queries that run in SQLite or in Python: rows that WHERE cannot keep stay in DuckDB."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from agreement import exact, outcome, reference_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs.drawn import amount, drawn
from second_opinion import DECISIONS, TYPES, Twin, twin
from sessions import code_of

import ss2sql
from ss2sql.vtables.frames.frame import Column

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 10)
SALES = """
    CREATE TABLE sales AS
    SELECT i AS id, i % 7 AS kind, 'n' || i % 3 AS name, i / 2.0::DOUBLE AS price FROM range(100) AS r(i)
"""


@pytest.fixture
def sales(own: Any, ss: ss2sql.Session) -> ss2sql.Session:
    own.execute(SALES)
    ss.function("last", lambda n: int(str(n)[-1]), volatility="immutable")
    return ss


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many values come out of DuckDB, column by column."""
    lengths: list[int] = []
    values = Column.values.fget
    assert values is not None

    def look(column: Column) -> Any:
        found = values(column)
        lengths.append(len(found))
        return found

    monkeypatch.setattr(Column, "values", property(look))
    return lengths


@pytest.mark.parametrize("engine", ["database", "native"])
def test_random_queries(engine: Any) -> None:
    own = duckdb.connect(config={"threads": 1})
    narrowed = 0

    @seed(97)
    @drawn(COUNT, shrunk=False)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(twin))
    def run(made: Twin) -> None:
        nonlocal narrowed
        columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
        for name, rows in made.case.tables.items():
            own.execute(f"CREATE OR REPLACE TABLE {name}({columns})")
            own.executemany(f"INSERT INTO {name} VALUES (?, ?, ?, ?)", [tuple(row.values()) for row in rows])
        with ss2sql.connect(engine="duckdb", session=own) as ss:
            found, _ = outcome(ss, made.case.script, engine=engine)
            if found is None:  # the database alone cannot run it
                return
            narrowed += "DuckDB hands over" in str(ss.compile(made.case.script, engine=engine).explain())
        assert found == reference_outcome(made.case)

    run()
    assert narrowed > COUNT // 10


@pytest.mark.parametrize("engine", ["database", "native", "duckdb"])
def test_functions_of_python_are_asked_of_few_rows(sales: ss2sql.Session, read: list[int], engine: Any) -> None:
    script = "SELECT id, last(id) FROM sales WHERE kind == most AND price > 20 AND last(id) > 4 AS rows"
    sales.set("most", 3)
    result = sales.run(script, engine=engine)
    assert result.value == [(n, n % 10) for n in range(100) if n % 7 == 3 and n > 40 and n % 10 > 4]
    assert read
    assert set(read) == {len([n for n in range(41, 100) if n % 7 == 3])}
    assert "DuckDB hands over the rows of sales with kind == most AND price > 20" in str(result.explain())


def test_what_may_fail_comes_before_what_stands_behind_it(sales: ss2sql.Session, read: list[int]) -> None:
    """The row with the id 3 fails, although DuckDB could tell that it is not kept."""
    for first in ("10 / (id - 3) > 1", "last(id) / (id - 3) > 1"):
        assert code_of(sales.run, f"SELECT id FROM sales WHERE {first} AND kind == 5 AS list") == "X002"
    assert max(read) == 100
    del read[:]
    found = sales.run("SELECT id FROM sales WHERE kind == 5 AND 10 / (id - 3) > 1 AS list").value
    assert found == [5, 12]
    assert set(read) <= {14}


@pytest.mark.parametrize(
    ("script", "count"),
    [
        (
            "SELECT a.id, b.id FROM a = sales, b = sales WHERE a.id < 2 AND b.price > 49 AND last(a.id) < b.id AS rows",
            [2, 1],
        ),
        (
            "SELECT id, n.this FROM n = [1, 2], s = sales WHERE s.id < n.this AND s.id < 3 AND last(id) >= 0 AS rows",
            [3],
        ),
        # A function in FROM is asked for every row, so all have to be there.
        ("SELECT id FROM s = sales, x = last(s.id) WHERE s.id < 2 AS list", [100]),
        # What is asked may also be None, and groups are made of what is kept.
        ("SELECT name, count(*) FROM sales WHERE NOT name == 'n1' AND last(id) != 3 GROUP BY name AS rows", [67]),
        ("SELECT id FROM sales WHERE last(id) == 3 AND id < 20 AS list", [100]),
        ("SELECT last(id) FROM sales WHERE id < 50 OR name == 'n2' ORDER BY id DESC LIMIT 3 AS list", [67]),
    ],
)
def test_which_rows_are_read(sales: ss2sql.Session, read: list[int], script: str, count: list[int]) -> None:
    value = sales.run(script).value
    assert set(read) == set(count)
    sales.set("sales", [dict(zip(("id", "kind", "name", "price"), row, strict=True)) for row in _rows()])
    assert exact(sales.run(script, engine="native").value) == exact(value)


def _rows() -> list[tuple[Any, ...]]:
    return [(n, n % 7, f"n{n % 3}", n / 2) for n in range(100)]


def test_a_compiled_query_reads_what_is_there(own: Any, sales: ss2sql.Session) -> None:
    query = sales.compile("SELECT last(id) FROM sales WHERE id > most AS list")
    assert query.run(most=96).value == [7, 8, 9]
    assert query.run(most=97).value == [8, 9]
    own.execute("INSERT INTO sales VALUES (100, 1, NULL, NULL)")
    assert query.run(most=98).value == [9, 0]
    own.execute("INSERT INTO sales VALUES (NULL, 1, NULL, NULL)")
    assert code_of(query.run, most=98) == "X001"  # None has no order
    own.execute("CREATE OR REPLACE TABLE sales AS SELECT 99.5::DOUBLE AS id")
    assert query.run(most=98).value == [5]


@pytest.mark.parametrize("engine", ["native", "duckdb"])
def test_a_query_in_a_text_reads_rows_of_its_own(sales: ss2sql.Session, engine: Any) -> None:
    """It has a source of the same name, which the query around it goes on reading."""
    inner = "SELECT b.id FROM b = sales WHERE b.kind == 2 AND last(b.id) < 5 AND b.id < 30 AS list"
    found = sales.run(
        "SELECT a.id, b.id FROM a = sales, b = sales WHERE a.kind == 1 AND a.id < 9 AND b.kind == 3"
        f' AND eval("{inner}") == [2, 23] AND last(b.id) == 0 AS rows',
        engine=engine,
    )
    assert found.value == [(1, 10), (1, 80), (8, 10), (8, 80)]


def test_a_condition_that_a_text_changes(sales: ss2sql.Session) -> None:
    script = "SELECT eval('most = ' + str(id)) FROM sales WHERE kind < most AND last(id) > 0 AS list;"
    found = []
    for _ in range(2):
        sales.set("most", 3)
        found.append(sales.run(script, engine="native").value)
        sales.set("sales", [dict(zip(("id", "kind", "name", "price"), row, strict=True)) for row in _rows()])
    assert found[0] == found[1]
    assert len(found[0]) > 50


def test_statements_that_differ_in_a_variable(sales: ss2sql.Session) -> None:
    query = "SELECT last(id) FROM sales WHERE id > most AS list"
    assert sales.run(f"most = 97; a = ({query}); most = 98; [a, ({query})];").value == [[8, 9], [9]]


def test_a_variable_of_another_kind_leaves_the_table_whole(sales: ss2sql.Session) -> None:
    query = sales.compile("SELECT last(id) FROM sales WHERE name == wanted AND id < 5 AS list")
    assert query.run(wanted="n1").value == [1, 4]
    assert query.run(wanted=[1]).value == []
    assert query.run(wanted=None).value == []


def test_a_connection_that_compares_texts_in_another_way(own: Any, sales: ss2sql.Session) -> None:
    own.execute("SET default_collation = 'nocase'")
    assert sales.run("SELECT last(id) FROM sales WHERE name == 'N1' AS list").value == []


def test_a_file(own: Any, ss: ss2sql.Session, read: list[int], tmp_path: Path) -> None:
    own.sql("SELECT i AS id, i % 7 AS nth FROM range(100) AS r(i)").write_parquet(str(tmp_path / "sales.parquet"))
    ss.attach("sales", tmp_path / "sales.parquet")
    ss.function("last", lambda n: int(str(n)[-1]), volatility="immutable")
    assert ss.run("SELECT last(id), nth FROM sales WHERE nth == 6 AND id > 80 AS rows").value == [
        (3, 6),
        (0, 6),
        (7, 6),
    ]
    assert set(read) == {3}
