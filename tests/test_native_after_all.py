"""What SQLite evaluates in another order than the language shows once something fails; then it runs natively.

A search has made all elements of a step before the first is taken; a join reads nothing if a later table is empty.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest
from balls import BallWorld, Box

import ss2sql

SCRIPT = """SELECT n + b.this FROM a = [1, 2], b = [1 / (top - a.this)] START WITH n = 0
CONNECT BY n = n + 1 STOP WITH n > 0 LIMIT 1 AS list;"""


@pytest.fixture
def session() -> ss2sql.Session:
    return ss2sql.connect()


def test_it_runs_in_the_database_as_long_as_nothing_fails(session: ss2sql.Session) -> None:
    session.set("top", 3)
    result = session.run(SCRIPT, engine="database")
    assert (result.value, result.engine) == ([[0.5]], "database")


def test_it_runs_natively_once_something_fails(session: ss2sql.Session) -> None:
    session.set("top", 2)
    result = session.run(SCRIPT)
    assert (result.value, result.engine) == ([[1.0]], "native")
    assert "SQLite makes all elements of a step before it takes the first of them" in str(result.explain())


def test_the_database_refuses_what_failed(session: ss2sql.Session) -> None:
    session.set("top", 2)
    with pytest.raises(ss2sql.UnsupportedError, match="division by zero: 1 / 0; SQLite makes all elements") as caught:
        session.run(SCRIPT, engine="database")
    assert caught.value.code == "U001"
    assert caught.value.span is not None
    assert SCRIPT[caught.value.span.start :].startswith("b = [1 / (top - a.this)]")
    assert caught.value.__cause__ is not None


def test_the_first_error_shows(session: ss2sql.Session) -> None:
    session.set("top", 2)
    script = (
        "SELECT int('z') FROM a = [1, 2], b = [1 / (top - a.this)] START WITH n = 0 CONNECT BY n = 1 STOP WITH n > 0;"
    )
    with pytest.raises(ss2sql.ExecutionError) as caught:
        session.run(script)
    assert caught.value.span is not None
    assert script[caught.value.span.start :].startswith("int('z')")


TABLE = "SELECT u FROM a = [1, 2], b = [1 / (a.this - 2)], c = places AS list;"
SEARCH = """SELECT u FROM a = near(n), c = places START WITH n = 0
CONNECT BY n = a.this STOP WITH n > 0 AS list;"""


@pytest.mark.parametrize("script", [TABLE, f"SELECT len({TABLE[:-1]}) FROM [1] AS list;", SEARCH])
def test_an_empty_table_behind_what_fails_hides_nothing(session: ss2sql.Session, script: str) -> None:
    session.host.connection.execute("CREATE TABLE places(u)")
    session.function("near", lambda n: [1 // n])
    with pytest.raises(ss2sql.UnsupportedError, match="the table is empty") as refused:
        session.run(script, engine="database")
    assert refused.value.span is not None
    assert script[refused.value.span.start :].startswith("places")
    with pytest.raises((ss2sql.ExecutionError, ZeroDivisionError), match="division"):
        session.run(script)


def test_a_table_with_rows_is_joined_in_the_database(session: ss2sql.Session) -> None:
    session.host.connection.execute("CREATE TABLE places(u)")
    session.host.connection.execute("INSERT INTO places VALUES (5)")
    session.function("near", lambda n: [n + 1])
    result = session.run(SEARCH, engine="database")
    assert (result.value, result.engine) == ([[5]], "database")


@pytest.mark.parametrize("engine", ["auto", "native"])
def test_an_empty_world_behind_what_fails_hides_nothing_of_a_search(session: ss2sql.Session, engine: Any) -> None:
    session.attach("scene", BallWorld(Box.row(0)))
    script = """SELECT n FROM a = [1, 2], b = [1 / (a.this - 2)], c = scene.balls START WITH n = 0
CONNECT BY n = n + 1 STOP WITH n > 0 AS list;"""
    with pytest.raises(ss2sql.ExecutionError, match="division by zero"):
        session.run(script, engine=engine)


@pytest.mark.parametrize("last", ["scene.balls", "(SELECT this FROM some AS list)"])
def test_the_database_reads_these_after_what_fails(session: ss2sql.Session, last: str) -> None:
    session.attach("scene", BallWorld(Box.row(0)))
    session.set("some", [])
    with pytest.raises(ss2sql.ExecutionError, match="division by zero"):
        session.run(f"SELECT 1 FROM a = [1, 2], b = [1 / (a.this - 2)], c = {last};", engine="database")


def test_the_next_run_asks_sqlite_again(session: ss2sql.Session) -> None:
    """Whether a table is empty and a step fails is a matter of one run."""
    session.host.connection.execute("CREATE TABLE places(u)")
    session.function("near", lambda n: [n // n])
    session.set("first", 0)
    query = session.compile(SEARCH.replace("n = 0", "n = first"))
    with pytest.raises(ZeroDivisionError):
        query.run()
    assert "the table is empty" in query.explain()
    session.host.connection.execute("INSERT INTO places VALUES (5)")
    with pytest.raises(ZeroDivisionError):
        query.run()
    assert "WITH RECURSIVE" in query.explain()
    session.set("first", -1)
    result = query.run()
    assert (result.value, result.engine) == ([[5]], "database")
    session.host.connection.execute("DELETE FROM places")
    result = query.run()
    assert (result.value, result.engine) == ([], "native")


def test_the_next_run_tries_the_steps_in_sqlite_again(session: ss2sql.Session) -> None:
    session.set("top", 2)
    query = session.compile(SCRIPT)
    engines = [query.run().engine]
    session.set("top", 3)
    engines += [query.run().engine, query.run().engine]
    session.set("top", 2)
    engines += [query.run().engine, query.run().engine]
    assert engines == ["native", "database", "database", "native", "native"]


# --- values that SQLite has to have before a row is read ------------------------------------------------

LATE = "IF(1 == 2; late = 1);"


@pytest.mark.parametrize(
    ("query", "value"),
    [
        ("SELECT this FROM [1, 2] WHERE this == 3 AND late > 1 AS list", []),
        ("SELECT this FROM [1, 2] WHERE this < 3 OR late > 1 AS list", [1, 2]),
        ("SELECT IF(this == 3; late; 0) FROM [1, 2] AS list", [0, 0]),
        ("SELECT this + late FROM [1, 2] WHERE this == 3 AS list", []),
        ("SELECT this FROM [] ORDER BY this + late AS list", []),
        ("SELECT n FROM [1] WHERE n == 2 START WITH n = 1 CONNECT BY n = n + late STOP WITH this == 1 AS list", []),
        ("SELECT this FROM [1, 2] WHERE this == 3 AND this IN (SELECT late FROM [1] AS list) AS list", []),
        ("SELECT (SELECT late FROM [1] WHERE this == 3 AS list) FROM [1] AS list", [[]]),
    ],
)
def test_a_value_that_nobody_needs(session: ss2sql.Session, query: str, value: Any) -> None:
    assert session.eval(f"{LATE} {query}", engine="native") == value
    assert session.eval(f"{LATE} {query}") == value
    compiled = session.compile(f"{LATE} {query}")
    assert [compiled.run().value for _ in range(3)] == [value] * 3
    with suppress(ss2sql.ResolveError, ss2sql.UnsupportedError, ss2sql.ExecutionError):  # SQLite may give up
        assert session.eval(f"{LATE} {query}", engine="database") == value


def test_a_value_that_is_needed_fails_as_it_does_natively(session: ss2sql.Session) -> None:
    script = f"{LATE} SELECT this FROM [1, 2] WHERE this == 1 AND late > 1;"
    for engine in ("native", "database", "auto"):
        with pytest.raises(ss2sql.Error, match="'late' has no value yet") as caught:
            session.run(script, engine=engine)  # type: ignore[arg-type]
        assert caught.value.code == "R001"


def test_queries_too_deep_for_sqlite(session: ss2sql.Session) -> None:
    query = "SELECT this FROM [1] WHERE this == 1 AS list"
    for _ in range(60):
        query = f"SELECT this FROM [1] WHERE this IN ({query}) AS list"
    result = session.run(f"{query};")
    assert (result.value, result.engine) == ([1], "native")
    with pytest.raises(ss2sql.UnsupportedError, match="too much for SQLite") as caught:
        session.run(f"{query};", engine="database")
    assert caught.value.code == "U001"
    assert "leave the engine to ss2sql" in caught.value.hints[0]
