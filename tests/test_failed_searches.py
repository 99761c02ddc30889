"""A search whose elements are made one after another, where a later one fails: SQLite has made it before it was due."""

from __future__ import annotations

import pytest

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
    with pytest.raises(ss2sql.UnsupportedError, match="something failed") as caught:
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
