"""Tables of DuckDB that are joined there for queries that run in SQLite or in Python."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import exact, outcome, reference_outcome, session_for
from hypothesis import given, seed
from programs import ProgramCase
from programs.drawn import amount, drawn
from programs.joins import joins
from sessions import code_of

import ss2sql
from ss2sql.runtime.duck import joining
from ss2sql.runtime.duck.tables import Reading

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 5)
TYPES = {"a": "BIGINT", "b": "BIGINT", "s": "VARCHAR", "w": "DOUBLE"}


@pytest.mark.parametrize("engine", ["duckdb", "native"])
def test_random_queries(engine: Any) -> None:
    own = duckdb.connect(config={"threads": 1})
    joined = failed = 0

    @seed(101)
    @drawn(COUNT, shrunk=False)
    @given(joins())
    def run(case: ProgramCase) -> None:
        nonlocal joined, failed
        columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
        for name, rows in case.tables.items():
            own.execute(f"CREATE OR REPLACE TABLE {name}({columns})")
            values = [tuple(row[column] for column in TYPES) for row in rows]
            own.executemany(f"INSERT INTO {name} VALUES (?, ?, ?, ?)", values)
        bare = ProgramCase(case.script, case.variables, case.uses)
        with session_for(bare, engine="duckdb", session=own) as ss:
            found, _ = outcome(ss, case.script, engine=engine)
            joined += "DuckDB hands over the rows of x, y" in str(ss.compile(case.script, engine=engine).explain())
        assert found == reference_outcome(case), case
        failed += found.error is not None

    run()
    assert joined > COUNT // 5
    assert failed > COUNT // 20


# --- what is read ------------------------------------------------------------------------------------------


@pytest.fixture
def roads(own: Any, ss: ss2sql.Session) -> ss2sql.Session:
    """A road from each number to the next three, and the names of some."""
    own.execute("CREATE TABLE roads AS SELECT i // 3 AS here, i // 3 + 1 + i % 3 AS there FROM range(90) AS r(i)")
    own.execute("CREATE TABLE towns AS SELECT 5 * i AS id, 'n' || i AS name, [i] AS list FROM range(6) AS r(i)")
    ss.function("turned", lambda n: "".join(reversed(str(n))), volatility="immutable")
    return ss


def handed(result: ss2sql.Result) -> list[str]:
    """The tables whose rows DuckDB hands over, and what it asks of them."""
    lines = str(result.explain()).splitlines()
    start = "DuckDB hands over the rows of "
    return [line.strip().removeprefix(start) for line in lines if line.strip().startswith(start)]


ROADS = [(i // 3, i // 3 + 1 + i % 3) for i in range(90)]
TOWNS = [(5 * i, f"n{i}") for i in range(6)]


@pytest.mark.parametrize("engine", ["database", "native", "duckdb"])
def test_the_rows_of_the_product_come_in_its_order(roads: ss2sql.Session, engine: Any) -> None:
    script = "SELECT here, name, turned(there) FROM towns, roads WHERE id == there AND here > 3 AND turned(id) != '51'"
    result = roads.run(f"{script} AS rows", engine=engine)
    expected = [(a, name, str(b)[::-1]) for id, name in TOWNS for a, b in ROADS if id == b and a > 3 and id != 15]
    assert result.value == expected
    assert handed(result) == ["towns, roads with id == there AND here > 3"]


def test_the_sql_has_one_source(roads: ss2sql.Session) -> None:
    result = roads.run("SELECT turned(name) FROM towns, roads WHERE id == here AND there > 20 AS list")
    assert result.value == ["4n"] * 3 + ["5n"] * 3
    assert "CROSS JOIN" not in str(result.sql)
    assert "towns_name" in str(result.sql)
    assert "walks the elements of towns, roads (as towns_roads)" in str(result.explain())


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        # Three tables, each of which must equal one before it.
        (
            "SELECT turned(a.here) FROM a = roads, b = roads, t = towns WHERE a.there == b.here AND b.there == t.id"
            " AND a.here == 0 AS list",
            ["a, b, t with a.there == b.here AND b.there == t.id AND a.here == 0"],
        ),
        # What stands between them keeps its place.
        (
            "SELECT turned(n.this) FROM a = roads, n = [1, 2], b = roads WHERE a.there == b.here AND a.here == 0"
            " AS list",
            ["a with a.here == 0"],
        ),
        # A product without an equality is larger than its tables.
        (
            "SELECT turned(a.here) FROM a = roads, t = towns WHERE a.there > t.id AND a.here == 0 AS list",
            ["a with a.here == 0"],
        ),
        # What may fail is asked in its place.
        (
            "SELECT turned(a.here) FROM a = roads, t = towns WHERE 1 / (a.here + a.there - 1.5) < 9 AND a.there == t.id"
            " AS list",
            [],
        ),
        ("SELECT turned(a.this) FROM a = roads, t = towns WHERE a.there == t.id AND a.here < 3 AS list", ["a"]),
        ("SELECT turned(t.list) FROM a = roads, t = towns WHERE a.there == t.id AND a.here < 3 AS list", ["a, t"]),
        ("SELECT turned(1) FROM a = roads, t = towns WHERE a.there == t.id AS list", ["a, t with a.there == t.id"]),
    ],
)
def test_what_is_joined(roads: ss2sql.Session, script: str, expected: list[str]) -> None:
    result = roads.run(script)
    found = handed(result)
    pairs = zip(found, expected, strict=True)
    assert all(text == wanted or text.startswith(f"{wanted} with") for text, wanted in pairs)
    roads.set("roads", [{"here": here, "there": there} for here, there in ROADS])
    roads.set("towns", [{"id": id, "name": name, "list": [id // 5]} for id, name in TOWNS])
    again = roads.run(script)
    assert handed(again) == []
    assert exact(again.value) == exact(result.value)


def test_more_rows_than_the_tables_have(roads: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    script = "SELECT turned(a.here) FROM a = roads, b = roads WHERE a.here == b.here AND a.there > 30 AS list"
    expected = [str(a)[::-1] for a, there in ROADS for b, _ in ROADS if a == b and there > 30]
    result = roads.run(script)
    assert result.value == expected
    assert handed(result) == ["a, b with a.here == b.here AND a.there > 30"]
    monkeypatch.setattr(joining, "FEW", 0)
    assert roads.run(script).value == expected  # few enough with both conditions
    result = roads.run("SELECT turned(a.here) FROM a = roads, b = roads WHERE a.here == b.here AS list")
    assert len(result.value) == 270
    assert handed(result) == []


def test_a_compiled_query_joins_what_is_there(own: Any, roads: ss2sql.Session) -> None:
    roads.set("wanted", "n1")
    query = roads.compile("SELECT turned(there) FROM towns, roads WHERE id == here AND name == wanted AS list")
    assert query.run().value == ["6", "7", "8"]
    assert handed(query.run()) == ["towns, roads with id == here AND name == wanted"]
    assert query.run(wanted="n2").value == ["11", "21", "31"]
    own.execute("INSERT INTO roads VALUES (5, 99)")
    assert query.run(wanted="n1").value == ["6", "7", "8", "99"]
    assert query.run(wanted=[1]).value == []  # DuckDB cannot ask that
    assert query.run(wanted="n1").value == ["6", "7", "8", "99"]
    own.execute("CREATE OR REPLACE TABLE towns AS SELECT '5' AS id, 'n1' AS name")
    assert query.run(wanted="n1").value == []
    own.execute("DROP TABLE towns")
    assert code_of(query.run, wanted="n1") == "R001"


def test_columns_with_strange_names(own: Any, roads: ss2sql.Session) -> None:
    own.execute('CREATE TABLE "Places" AS SELECT id AS "Name", name AS "this way" FROM towns')
    script = "SELECT turned(towns.name), x.Name FROM towns, x = Places WHERE towns.id == x.Name"
    found = roads.run(f"{script} AND towns.id > 9 AS rows")
    assert handed(found) == ["towns, x with towns.id == x.Name AND towns.id > 9"]
    assert found.value == [("2n", 10), ("3n", 15), ("4n", 20), ("5n", 25)]


def test_what_is_no_value_of_the_language(own: Any, roads: ss2sql.Session) -> None:
    own.execute("CREATE TABLE odd AS SELECT i AS id, i::VARCHAR::BIT AS m FROM range(2) AS r(i)")
    script = "SELECT turned({}) FROM towns, odd WHERE towns.id == odd.id AS list"
    assert roads.run(script.format("odd.id")).value == ["0"]
    assert code_of(roads.run, script.format("odd.m")) == "X004"


def test_a_connection_that_compares_texts_in_another_way(own: Any, roads: ss2sql.Session) -> None:
    script = "SELECT turned(a.id) FROM a = towns, b = towns WHERE a.name == b.name AS list"
    assert handed(roads.run(script)) == ["a, b with a.name == b.name"]
    own.execute("SET default_collation = 'nocase'")
    assert handed(roads.run(script)) == []


@pytest.mark.parametrize("script", ["a.id == b.id AND turned(a.id) != '3'", "a.id > 9 AND turned(b.id) != '3'"])
def test_what_duckdb_refuses(roads: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    query = roads.compile(f"SELECT a.id FROM a = towns, b = towns WHERE {script} AS list")
    expected = query.run().value
    rows = Reading.rows

    def full(reading: Reading, text: str, values: Any = None) -> Any:
        if "towns" in text and "COUNT(*)" in text and "WHERE" in text:
            raise duckdb.OutOfMemoryException("no room")
        return rows(reading, text, values)

    with monkeypatch.context() as patch:
        patch.setattr(Reading, "rows", full)
        patch.setattr(Reading, "arrow", full)
        with pytest.raises(ss2sql.ExecutionError, match="duckdb: no room") as caught:
            roads.run(f"SELECT b.id FROM a = towns, b = towns WHERE {script} AS list")
        assert caught.value.span is not None
        assert caught.value.span.text == "towns"
    assert query.run().value == expected
