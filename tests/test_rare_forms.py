"""Rare forms of queries: what their values do not tell. The values stand in `cases/*/rare-forms.sheet`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sessions import both

import ss2sql

DISABLE: tuple[tuple[str, ...], ...] = ((), ("fold",), ("split", "unnest", "fold"))


@pytest.fixture(params=DISABLE, ids=["", "not folded", "as written"])
def ss(request: pytest.FixtureRequest) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(disable=request.param) as session:
        session.attach("n", [0, 1, 2])
        session.attach("grid", [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
        yield session


@both
@pytest.mark.parametrize("expression", ["(1 / this > 0) XOR (1 / 0 > 0)", "min(1 / this, 2 / (this + 0))"])
def test_errors_stand_where_the_written_order_meets_them(ss: ss2sql.Session, engine: Any, expression: str) -> None:
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(f"SELECT {expression} FROM n AS list", engine=engine)
    assert caught.value.span is not None
    assert caught.value.span.text == "/"
    assert caught.value.span.column == 8 + expression.index("/")


@both
def test_an_index_is_computed_once(ss: ss2sql.Session, engine: Any) -> None:
    calls = []
    ss.function("place", lambda n: calls.append(n) or 2 - n)
    assert ss.eval("SELECT grid[place(this)][1] FROM n AS list", engine=engine) == [8, 5, 2]
    assert calls == [0, 1, 2]


@both
def test_connect_by_is_not_asked_of_a_step_that_stops(ss: ss2sql.Session, engine: Any) -> None:
    calls = []
    ss.function("next", lambda n: calls.append(n) or n, volatility="immutable")
    script = "SELECT this FROM n WHERE this == 2 START WITH x = 0 CONNECT BY NO CYCLE x = next(this) STOP WITH this > 0"
    assert ss.run(f"{script} AS list", engine=engine).value == [[0, 2], [2]]
    assert calls == [0]


def test_a_text_that_was_read_early_is_read_again_without_its_variable(ss: ss2sql.Session) -> None:
    ss.run("k = 1;")
    query = ss.compile("SELECT this FROM [1, 2] WHERE eval('k + 1 == 2') AS list")
    assert query.run().value == [1, 2]
    ss.run("clear();")
    with pytest.raises(ss2sql.ResolveError, match="'k'"):
        query.run()


def test_sqlite_tests_types_and_bounds_once_and_by_itself(ss: ss2sql.Session) -> None:
    ss.attach("far", [0, 1, 5])
    search = "SELECT (x + 1) * 2 - 1 FROM n START WITH x = 1 CONNECT BY x = x * 2 AS list"
    assert str(ss.compile(search).sql).count("typeof") == 1
    assert "WHEN far.this BETWEEN 0 AND 2" in str(ss.compile("SELECT grid[this][1] FROM far AS list").sql)
