"""The rows of a result as a DataFrame of Spark."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import exact
from level_searches import ended, may_fail

import ss2sql

pytestmark = pytest.mark.slow

GROWING = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST {} n = n + this {}"


def agree(ss: ss2sql.Session, script: str, **options: Any) -> None:
    frame = ss.compile(script).spark(**options)
    wanted = ss.run(script, engine="native", **options)
    assert tuple(frame.columns) == wanted.columns
    found = [tuple(row.asDict(recursive=True).values()) for row in frame.orderBy("path", "step").collect()]
    assert exact(found) == exact([tuple(row) for row in wanted])


@pytest.mark.parametrize(
    ("maximum", "limit", "given"),
    [("MAXIMUM 3", "STOP WITH n > 4 LIMIT 2", None), ("", "STOP WITH n > 4 LIMIT 0", None), ("", "", 5)],
)
def test_the_first_paths(ss: ss2sql.Session, maximum: str, limit: str, given: Any) -> None:
    agree(ss, GROWING.format(maximum, limit), maximum=given)


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
