"""The steps of a search level by level, as `explain(levels=True)` and `ss2sql explain --analyze` count them."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql

OPTIONS = [
    "", "BREADTH FIRST", "NO CYCLE", "BREADTH FIRST NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE", "COST w",
    "COST w UNIQUE", "COST w HEURISTIC 1", "COST w UNIQUE HEURISTIC 1", "PROBABILITY 1.0 / w", "COST w NO CYCLE",
]  # fmt: skip
# A machine of 30 numbers: up to three ways on from each, of different weight.
SCRIPT = """SELECT go(this, n) FROM [1, 2, 5] WHERE go(this, n) % 7 == 3
            START WITH n = 0, w = 1, level = 1
            CONNECT BY OPTIONS n = go(this, n), w = go(this, n) % 3 + 1, level = level + 1
            STOP WITH level == 6 OR go(this, n) > 27;"""


def table(explanation: Any) -> list[dict[str, int]]:
    levels = explanation.as_dict()["run"]["levels"]
    return [dict(zip(levels["columns"], row, strict=True)) for row in levels["rows"]]


@pytest.mark.parametrize("options", OPTIONS)
def test_levels_add_up_to_what_the_run_has_counted(ss: ss2sql.Session, options: str, engine: Any) -> None:
    ss.function("go", lambda step, n: (3 * n + step) % 30, volatility="immutable")
    result = ss.run(SCRIPT.replace("OPTIONS", options), engine=engine)
    found = table(result.explain(levels=True))
    assert [row["level"] for row in found] == list(range(1, len(found) + 1))
    assert sum(row["results"] for row in found) == len(result.paths) > 0
    for name in ("generated", "expanded", "pruned"):
        assert sum(row[name] for row in found) == getattr(result.stats, name), name
    # What is tried on a level are the elements for each that went on from the level before.
    going = [1, *(row["expanded"] for row in found)]
    assert [row["generated"] for row in found] == [3 * count for count in going[:-1]]


def test_a_search_that_has_its_maximum_ends_early_here_too(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT this FROM [1, 2] START WITH n = 1 CONNECT BY BREADTH FIRST MAXIMUM 5 n = n + 1;"
    result = ss.run(script, engine=engine)
    assert [row["results"] for row in table(result.explain(levels=True))] == [2, 3]
    limited = ss.run(script.replace("MAXIMUM 5", ""), engine=engine, maximum=4)
    assert [row["results"] for row in table(limited.explain(levels=True))] == [2, 2]


def test_parameters_and_the_values_of_variables_are_those_of_the_run(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT this FROM xs START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == depth;")
    result = query.run(xs=[1, 2, 3], depth=1)
    assert [row["generated"] for row in table(result.explain(levels=True))] == [3, 9]


@pytest.fixture
def calls(ss: ss2sql.Session) -> list[int]:
    """The calls of `go`, n + 1, which is immutable, and of `went`, which is volatile."""
    made: list[int] = []
    for name, volatility in (("go", "immutable"), ("went", "volatile")):
        ss.function(name, lambda n: made.append(n) or n + 1, volatility=volatility)  # type: ignore[arg-type]
    return made


def test_nothing_runs_again_unasked_or_where_it_cannot_be_done_twice(ss: ss2sql.Session, calls: list[int]) -> None:
    result = ss.run("SELECT go(n) FROM [1] START WITH n = 0 CONNECT BY n = go(n) STOP WITH n == 3;", engine="native")
    before = len(calls)
    result.explain()
    assert len(calls) == before
    result.explain(levels=True)
    assert len(calls) == 2 * before
    result = ss.run("SELECT this FROM [1] START WITH n = 0 CONNECT BY n = went(n) STOP WITH n == 3;")
    before = len(calls)
    found = result.explain(levels=True)
    assert "steps are not counted by level: what it calls or assigns is not to be done twice" in found.splitlines()
    assert len(calls) == before


def test_the_graph_of_memorize_needs_no_second_run(ss: ss2sql.Session, calls: list[int]) -> None:
    result = ss.run("SELECT go(n) FROM [1] START WITH n = 0 CONNECT BY MEMORIZE 4 n = go(n);")
    assert "the graph of MEMORIZE:" in result.explain(levels=True).splitlines()
    assert calls == [0, 1, 2, 3]


def test_a_result_that_is_no_search_says_nothing_of_levels(ss: ss2sql.Session) -> None:
    for script in ("1 + 1;", "SELECT this FROM [1];", "x = SELECT this FROM [1] AS list; x;"):
        result = ss.run(script)
        assert "level" not in result.explain(levels=True)
        assert "by level" not in result.explain()
        assert result.explain().as_dict()["run"]["levels"] is None
