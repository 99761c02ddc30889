"""The paths of a search as a DataFrame of Spark: the rows of a result, none of which passes through this process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from agreement import exact
from level_searches import SHORT, ended, may_fail

import ss2sql
from ss2sql.runtime.external import level_steps, spark_dataframe, spark_search

pytestmark = pytest.mark.slow

STRATEGIES = ["UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST MAXIMUM 9"]
GROWING = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST {} n = n + this {}"


@pytest.fixture(autouse=True)
def let_go(nothing_is_left_behind: None, spark: Any) -> Iterator[None]:
    """What frames keep goes with them, some time; here at once."""
    yield
    for rows in dict(spark.sparkContext._jsc.getPersistentRDDs()).values():
        rows.unpersist()


def agree(ss: ss2sql.Session, script: str, **options: Any) -> None:
    frame = ss.compile(script).spark(**options)
    wanted = ss.run(script, engine="native", **options)
    assert tuple(frame.columns) == wanted.columns
    found = [tuple(row.asDict(recursive=True).values()) for row in frame.orderBy("path", "step").collect()]
    assert exact(found) == exact([tuple(row) for row in wanted])


@pytest.mark.parametrize("states", [0, 3, 2000])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_rows_are_those_of_the_list(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, strategy: str, states: int
) -> None:
    """Whatever is searched here, in Python and in SQL; with goals in several levels, which are numbered in parts."""
    monkeypatch.setattr(level_steps, "MAX_STATES", states)
    if states == 0:
        for module, name, number in (
            (spark_search, "MAX_IN_ONE_PARTITION", 0),
            (spark_dataframe, "MAX_IN_ONE_PARTITION", 0),
            (spark_dataframe, "MAX_JOINS", 1),
        ):
            monkeypatch.setattr(module, name, number)
    ss.function("step", lambda n, more: [(n + more) % 9, str(n)], volatility="immutable")
    for row, n in (
        ("this, step(n, this)[0], to(step(n, this)[1], text)", "step(n, this)[0]"),
        ("(n + this) % 9, n % 2 == 0", "(n + this) % 9"),
    ):
        search = f"START WITH n = 0 CONNECT BY {strategy} n = {n} STOP WITH n > 5"
        agree(ss, f"SELECT {row} FROM [1, 2] WHERE {n} % 3 == 1 {search}")


@pytest.mark.parametrize(
    ("maximum", "limit", "given"),
    [("MAXIMUM 3", "", None), ("MAXIMUM 3", "LIMIT 2", None), ("", "LIMIT 0", None), ("", "LIMIT 90", None),
     ("", "", 5)],
)  # fmt: skip
@pytest.mark.parametrize("states", [0, 2000])
def test_the_first_paths(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, maximum: str, limit: str, given: Any, states: int
) -> None:
    monkeypatch.setattr(level_steps, "MAX_STATES", states)
    agree(ss, GROWING.format(maximum, f"STOP WITH n > 4 {limit}" if given is None else ""), maximum=given)


@pytest.mark.parametrize(("maximum", "limit"), [("(most())", "9"), ("9", "most()")])
def test_limits_are_evaluated_once(ss: ss2sql.Session, maximum: str, limit: str) -> None:
    calls: list[None] = []
    ss.function("most", lambda: calls.append(None) or 2, volatility="volatile")
    frame = ss.compile(GROWING.format(f"MAXIMUM {maximum}", f"STOP WITH n > 4 LIMIT {limit} AS list")).spark()
    assert len({row[0] for row in frame.collect()}) == 2
    assert len(calls) == 1


def test_types_are_those_of_other_frames(ss: ss2sql.Session) -> None:
    from pyspark.sql.pandas.types import from_arrow_schema

    ss.function("part", lambda n: [[[n], [1.5]], None, 1 if n % 2 else 1.5, n == 2, "x", n][:6], volatility="immutable")
    parts = ", ".join(f"to(part(n)[{number}], p{number})" for number in range(6))
    script = f"SELECT {parts} FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this STOP WITH n > 2"
    frame = ss.compile(script).spark()
    wanted = ss.run(script, engine="native").arrow()
    assert frame.schema == from_arrow_schema(wanted.schema)
    found = [list(row.asDict().values()) for row in frame.orderBy("path", "step").collect()]
    assert exact(found) == exact([list(row.values()) for row in wanted.to_pylist()])


@pytest.mark.parametrize(
    ("script", "error", "code", "reason"),
    [
        ("1 + 1", ss2sql.UnsupportedError, "U001", "only a search has paths"),
        ("SELECT this FROM [1]", ss2sql.UnsupportedError, "U001", "only a search has paths"),
        (SHORT.replace(" AS list", " GROUP BY n"), ss2sql.UnsupportedError, "U001", "GROUP BY makes no DataFrame"),
        (SHORT.replace(" AS list", " ORDER BY n"), ss2sql.UnsupportedError, "U001", "ORDER BY makes no DataFrame"),
        (SHORT.replace("n + this FROM", "to(odd(n), mixed) FROM"), ss2sql.RepresentationError, "V001",
         "the column 'mixed' has values of several kinds"),
    ],
    ids=["value", "flat", "groups", "order", "kinds"],
)  # fmt: skip
def test_what_has_no_frame_is_refused(ss: ss2sql.Session, script: str, error: Any, code: str, reason: str) -> None:
    ss.function("odd", lambda n: "a" if n == 2 else n, volatility="immutable")
    with pytest.raises(error, match=reason) as caught:
        ss.compile(script).spark()
    assert caught.value.code == code


@pytest.mark.parametrize("bad", range(6))
def test_steps_that_fail(ss: ss2sql.Session, bad: int) -> None:
    """As in a run, also where MAXIMUM ends the search."""
    script = may_fail(ss, "UNIQUE MAXIMUM 2", bad, least=3)
    wanted = ended(ss, script)
    if wanted[0] == "value":
        agree(ss, script)
    else:
        with pytest.raises(ValueError, match=wanted[1]) as caught:
            ss.compile(script).spark()
        assert tuple(caught.value.__notes__) == wanted[2:]


def test_parameters_and_the_session(ss: ss2sql.Session, spark: Any) -> None:
    """The frame is of the user's session; it stays when that of ss2sql is closed, and can be queried."""
    query = ss.compile("SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > most")
    with pytest.raises(ss2sql.ResolveError):
        query.spark()
    frame = query.spark(most=2)
    ss.close()
    frame.createOrReplaceTempView("found")
    found = spark.sql("SELECT MAX(path), COUNT(*) FROM found").collect()
    spark.catalog.dropTempView("found")
    assert [tuple(row) for row in found] == [(4, 6)]  # to 1, 2, 3, 4 by 1, 1, 2, 2 steps


@pytest.mark.parametrize("written", ["n * 2 + this", "twice(n, this)"])
def test_no_rows_pass_through_this_process(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, written: str) -> None:
    """Of 252 goals with 1,524 steps on their ways there come only counts: a row for each level or task."""
    from pyspark.sql.classic.dataframe import DataFrame

    fetched: list[Any] = []
    collect = DataFrame.collect
    ss.function("twice", lambda n, more: [n * 2, more][0] + more, volatility="immutable")
    monkeypatch.setattr(DataFrame, "collect", lambda self: fetched.append(collect(self)) or fetched[-1])
    for name in ("toLocalIterator", "toArrow", "toPandas", "take", "head", "tail", "foreach"):
        monkeypatch.setattr(DataFrame, name, None)
    search = f"START WITH n = 0 CONNECT BY UNIQUE n = {written} STOP WITH n >= 126"
    frame = ss.compile(f"SELECT {written} FROM [1, 2] {search}").spark()
    monkeypatch.undo()
    assert frame.count() == 1524  # 1 * 2 + 2 * 4 + ... + 6 * 64, and 7 * 126
    assert len(fetched) <= 12
    assert max(map(len, fetched)) <= 2
