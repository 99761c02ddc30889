"""A search over a list literal has a SELECT for each item; what it finds and counts is what a loop over lists finds."""

from __future__ import annotations

from typing import Any

import pytest
from golden import each_row

import ss2sql

JUGS = """SELECT this FROM [[A, b], [a, B], [0, b], [a, 0],
                            [max([0, a + b - B]), min([B, a + b])], [min([A, a + b]), max([0, a + b - A])]]
    WHERE this[0] == want OR this[1] == want START WITH a = 0, b = 0
    CONNECT BY {} a = this[0], b = this[1] AS list;"""


def both(script: str, **variables: Any) -> list[ss2sql.Result]:
    """What the script gives on both engines, with a SELECT for each item and without."""
    found = []
    for engine, disable in (("native", []), ("database", []), ("database", ["arms"])):
        with ss2sql.connect(disable=disable) as ss:
            for name, value in variables.items():
                ss.set(name, value)
            found.append(ss.run(script, engine=engine))
            assert found[-1].value is not None
    return found


def same(script: str, counted: bool = True, **variables: Any) -> ss2sql.Result:
    """`counted`: also what the run counts; steps without the condition of CONNECT BY count in some plans only."""
    native, arms, plain = both(script, **variables)
    assert arms.sql.count("SELECT") > plain.sql.count("SELECT")
    assert repr(native.value) == repr(arms.value) == repr(plain.value)
    assert native.paths == arms.paths
    assert list(arms) == list(native)
    for name in ("generated", "expanded", "pruned") if arms.status == "complete" and counted else ():
        assert getattr(arms.stats, name) == getattr(native.stats, name) == getattr(plain.stats, name), name
    return arms


@pytest.mark.parametrize(
    "option", ["UNIQUE MAXIMUM 1", "UNIQUE", "UNIQUE DEPTH FIRST", "BREADTH FIRST MAXIMUM 3", "NO CYCLE MAXIMUM 9"]
)
def test_water_jugs(option: str) -> None:
    result = same(JUGS.format(option), A=3, B=5, want=4)
    assert result.value[0][-1] in ([4, 5], [3, 4], [0, 4], [4, 0])
    if option == "UNIQUE MAXIMUM 1":  # no jug holds more than it does, so no sum leaves 64 bits
        assert "CASE" not in result.sql


@each_row("search/lists-made-anew", "script", "told")
def test_other_lists(script: str, told: str) -> None:
    assert same(script, counted=told == "the value and the counts").value


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this FROM [[n], [n, 1]] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;",
        "SELECT this FROM [[[n]], [[1]]] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;",
        "SELECT this FROM [n, n + 1] START WITH n = 0 CONNECT BY COST 1 n = n + 1 STOP WITH n == 2;",
        "SELECT x.this FROM x = [n, n + 1], y = [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;",
        "SELECT this FROM [n, 1, 2, 3, 4, 5, 6, 7, 8] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;",
        "SELECT this FROM [down(n), n] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;",
    ],
)
def test_lists_that_are_made_all_the_same(script: str) -> None:
    with ss2sql.connect() as ss:
        ss.function("down", lambda n: [n], volatility="immutable")
        result = ss.run(script, engine="database")
        assert "elements" in result.sql
        assert result.paths == ss.run(script, engine="native").paths


def test_max_steps_counts_each_item(engine: Any) -> None:
    script = "SELECT this FROM [n + 1, n + 2, n + 3] START WITH n = 0 CONNECT BY UNIQUE n = this STOP WITH n > 9000;"
    with ss2sql.connect(max_steps=5_000) as ss, pytest.raises(ss2sql.Error, match="T004"):
        ss.run(script, engine=engine)
