"""Indexes into lists, and membership in them, that SQLite answers from a BLOB."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import apsw
import pytest
from agreement import differences, executor_outcome
from hypothesis import given
from hypothesis import strategies as st
from programs import ProgramCase
from programs.drawn import amount, drawn
from sql_calls import python_calls, run_shown_sql

import ss2sql

GRID = [[0, 1, 0], [5, 0, 2]]
LONG = [[(7 * x + y) % 3 for x in range(40)] for y in range(30)]
BOOLS = [[True, False], [False, True], [True, True]]


def text_of(query: str, disable: Sequence[str] = (), **variables: Any) -> str:
    with ss2sql.connect(disable=disable) as ss:
        for name, value in variables.items():
            ss.attach(name, value)
        return str(ss.compile(query, engine="database").sql)


def check(query: str, **variables: Any) -> None:
    """All evaluators agree."""
    assert differences(ProgramCase(query, variables)) == [], (query, variables)


def check_in_sql(query: str, **variables: Any) -> None:
    """All evaluators agree, and SQLite needs no Python."""
    assert python_calls(text_of(query, **variables)) == set(), query
    check(query, **variables)


# --- indexes -------------------------------------------------------------------------------------------


def numbers_between(least: int, greatest: int) -> list[int]:
    return [least, least + 1, (least + greatest) // 2, greatest - 1, greatest]


IN_RANGE = "a.this >= 0 AND a.this < {} AND b.this >= 0 AND b.this < {}"


@pytest.mark.parametrize(
    ("grid", "height", "width"),
    [(GRID, 2, 3), (LONG, 30, 40), (BOOLS, 3, 2), ([[3]], 1, 1), ([[-5, 250]], 1, 2),
     ([numbers_between(-(2**53), -(2**53) + 255)], 1, 5), ([numbers_between(2**53 - 255, 2**53)], 1, 5)],
)  # fmt: skip
def test_an_index_that_is_tested_before(grid: list[list[int]], height: int, width: int) -> None:
    places = [-2, -1, 0, 1, 2, 3, 29, 30, 39, 40]
    inside = IN_RANGE.format(height, width)
    outside = f"a.this < 0 OR a.this >= {height} OR b.this < 0 OR {width} <= b.this"
    for expression in (
        f"IF({inside}; grid[a.this][b.this]; None)",
        f"IF({outside}; 'out'; grid[a.this][b.this])",
        f"({outside} OR grid[a.this][b.this] == 1)",
        f"({inside} AND grid[a.this][b.this] > 0)",
        f"NOT ({outside}) AND grid[a.this, b.this] != 1",
    ):
        check(f"SELECT {expression} FROM a = places, b = places AS list;", grid=grid, places=places)


def test_the_type_of_an_index_or_a_literal_may_say_that_it_is_in_range() -> None:
    check_in_sql("SELECT grid[a.this][b.this % 3] FROM a = [0, 1], b = [0, 1, 2, 3, 4, -5] AS list;", grid=GRID)
    check_in_sql("SELECT values[a.this] FROM a = [0, 1] AS list;", values=[5, 7, 9])
    assert " - 0" not in text_of("SELECT values[a.this] FROM a = [0, 1] AS list;", values=[1, 2])
    check_in_sql("SELECT [a.this, 1] IN [[0, 1], [1, 2]], [[4, 7], [9, 2]][a.this][1] FROM a = [0, 1] AS list;")


@pytest.mark.parametrize(
    "places", [[0, 1], [0, 1, -1, -2], [0, 5], [-7], [True, False], [0.0], [0, True], ["a"], [None], [99], [1.0, "b"]]
)
@pytest.mark.parametrize(
    "grid",
    [GRID, BOOLS, [[1, 2], [3]], [], [[]], [[1.5]], [["a", "b"]], [[0, 2000]], [[1, None]],
     [[-(2**63), -(2**63) + 1]], [[2**63 - 1, 2**63 - 2]], [5, 7, 9], [5, 700, 9], [5, 7.5], ["a", "b"], [*range(100)]],
)  # fmt: skip
def test_whatever_the_index_and_the_list_are(grid: list[Any], places: list[Any]) -> None:
    for query in (
        "SELECT grid[a.this][b.this] FROM a = places, b = places AS list;",
        "SELECT grid[a.this] FROM a = places AS list;",
        "SELECT grid[0][a.this] FROM a = places AS list;",
        "SELECT IF(a.this >= 0 AND a.this < 2; grid[a.this][a.this]; 0) FROM a = places AS list;",
    ):
        check(query, grid=grid, places=places)


def test_what_is_true_of_other_expressions_says_nothing_of_the_index() -> None:
    for condition in (
        "a.this >= 0 OR a.this < 2", "b.this >= 0 AND b.this < 2", "NOT (a.this >= 0 AND a.this < 2)",
        "a.this + 1 >= 0 AND a.this < 2", "a.this > -1 AND a.this < 3", "a.this >= 0.5 AND a.this <= 1.5",
    ):  # fmt: skip
        query = f"SELECT IF({condition}; values[a.this]; 0) FROM a = places, b = places AS list;"
        check(query, values=[5, 7], places=[-1, 0, 1, 2])


def test_a_search_over_a_grid() -> None:
    """Python evaluates only an item that lies outside, and keeps the rows and the paths."""
    query = """SELECT to(x + dx, x), to(y + dy, y) FROM moves WHERE x + dx == 4 AND y + dy == 3
        START WITH x = 0, y = 0 CONNECT BY BREADTH FIRST UNIQUE x = x + dx, y = y + dy
        STOP WITH x + dx < 0 OR x + dx > 4 OR y + dy < 0 OR y + dy >= 4 OR grid[y + dy][x + dx] == 1;"""
    grid = [[0, 0, 1, 0, 0], [1, 0, 1, 0, 1], [0, 0, 0, 0, 1], [0, 1, 1, 0, 0]]
    moves = [{"dx": dx, "dy": dy} for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    assert not python_calls(text_of(query, grid=grid, moves=moves)) & {"add", "lt", "gt", "eq", "truth"}
    check(query, grid=grid, moves=moves)
    assert executor_outcome(ProgramCase(query, {"grid": grid, "moves": moves}), "database") is not None


# --- membership ----------------------------------------------------------------------------------------


def test_points_of_a_list() -> None:
    points = [[0, 0], [2, 1], [2, 1], [-3, 4], [5, 5]]
    places = [-4, -3, 0, 1, 2, 4, 5, 6, 2**62]
    for word in ("IN", "NOT IN"):
        query = f"SELECT [a.this, b.this] {word} points FROM a = places, b = places AS list;"
        check_in_sql(query, points=points, places=places)


@pytest.mark.parametrize(
    "points",
    [[[1]], [[0, 1], [1, 0]], [[1, 2, 3]], [], [[]], [[1], [2, 3]], [[0, 10**9], [10**9, 0]], [[0.0, 1.0]], [[1, 0.0]],
     [["a", "b"]], [[True, False]], [[0, True], [1, 1]], [[None, 1]], [1, 0], [[[0, 1]]], [["a", 1]],
     [True], [1, None], [1, "a"], {"a": 1}, "abc", 5, [1, True]],
)  # fmt: skip
@pytest.mark.parametrize("places", [[0, 1], [0.0, 1], [True, False], [0, None], ["a", 1], [0, True], ["a", "b"]])
def test_whatever_the_points_are(points: list[Any], places: list[Any]) -> None:
    for item in ("[a.this, b.this]", "[a.this]", "a.this", "[a.this, 1]", "[a.this, b.this, 3]"):
        query = f"SELECT {item} IN points FROM a = places, b = places AS list;"
        check(query, points=points, places=places)


@pytest.mark.parametrize(
    ("values", "places"),
    [([1, 3, 5], [0, 1, 3.0, 2**53 + 1]), (["a", "b\0", "ä"], ["a", "b", "b\0", "ä", ""]),
     ([1, 2.5, 2**53], [1.0, 2.5, 2.0**53]),
     ([1, 3], [True, False]), (list(range(0, 200, 2)), [0, 1, 198, 200]), ([0.0], [-0.0, 0, 1])],
)  # fmt: skip
def test_membership_in_a_list_of_numbers_or_strings(values: list[Any], places: list[Any]) -> None:
    for query in (
        "SELECT a.this IN known FROM a = places AS list;",
        "SELECT a.this FROM a = places WHERE a.this NOT IN known;",
        "SELECT IF(a.this IN known; 1; 2), a.this IN other FROM a = places AS list;",
        f"SELECT a.this IN {values!r} FROM a = places AS list;",
    ):
        check_in_sql(query, known=values, places=places, other=values[:1])


# --- how lists are packed ------------------------------------------------------------------------------


def test_the_packed_list_is_explained_and_can_be_pasted(ss: ss2sql.Session) -> None:
    ss.attach("grid", GRID)
    result = ss.run("SELECT grid[a.this][0] FROM a = [0, 1] AS list;", engine="database")
    assert result.sql.parameters["grid_cells"] == bytes([0, 1, 0, 5, 0, 2])
    assert [row[0] for row in run_shown_sql(ss, result.sql)] == [0, 5]
    assert "cells: indexes into lists of numbers became places in a block of bytes" in str(result.explain())


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le", "UTF-16be"])
def test_in_a_database_of_any_encoding(file: Path, encoding: str) -> None:
    apsw.Connection(str(file)).execute(f"PRAGMA encoding = '{encoding}'; CREATE TABLE t(a)")
    columns = "grid[a.this][b.this], far[a.this][b.this], [a.this, b.this] IN grid"
    script = f"SELECT {columns} FROM a = [0, 1], b = [0, 1] AS rows;"
    with ss2sql.connect(file) as ss:
        ss.attach("grid", [[0, 100], [7, 1]])
        ss.attach("far", [[0, 1000], [7, 1]])
        expected = [(0, 0, False), (100, 1000, False), (7, 7, False), (1, 1, False)]
        assert ss.run(script, engine="native").value == ss.run(script, engine="database").value == expected


def test_the_list_may_change_between_runs(ss: ss2sql.Session) -> None:
    ss.attach("grid", GRID)
    query = ss.compile("SELECT grid[a.this][1] FROM a = [0, 1] AS list;", engine="database")
    assert query.run().value == [1, 0]
    for grid in ([[4, 5], [6, 7]], [[4, 500], [6, 7]], [[1, 2.5], [0, "a"]]):
        ss.attach("grid", grid)
        assert query.run().value == [row[1] for row in grid]
    ss.attach("grid", [[1, 2]])
    with pytest.raises(ss2sql.ExecutionError, match="out of range"):
        query.run()


INTS = st.one_of(st.integers(0, 3), st.integers(-5, 200), st.integers(-3000, 3000))
ROWS = st.integers(1, 4).flatmap(
    lambda width: st.lists(st.lists(INTS, min_size=width, max_size=width), min_size=1, max_size=4)
)
PARTS = st.lists(st.sampled_from(["a.this", "a.this - 1", "1", "b.this"]), min_size=1, max_size=4)
LIMITS = st.builds(
    "a.this >= {} AND a.this {} {}".format, st.integers(-1, 2), st.sampled_from(["<", "<="]), st.integers(-1, 5)
)


@pytest.mark.drawn
@drawn(amount(1 / 5))
@given(ROWS, st.lists(st.integers(-5, 5), min_size=1, max_size=5), LIMITS, PARTS)
def test_random_grids_and_indexes(rows: list[list[int]], places: list[int], condition: str, parts: list[str]) -> None:
    point = f"[{', '.join(parts)}]"
    for expression in (
        f"IF({condition}; rows[a.this][0]; None)", f"{condition} AND rows[a.this][a.this] > 1", f"{point} IN rows",
        f"NOT ({condition}) OR b.this < 0 OR rows[a.this, b.this]", f"{point} NOT IN rows AND {condition}",
    ):  # fmt: skip
        check(f"SELECT {expression} FROM a = places, b = places AS list;", rows=rows, places=places)


# --- what is read of short lists as columns; the values are those of a sheet of this name ---------------


EDGES = [[0, 1, "a"], [1, 2, "b"], [2, 5, "a"], [0, 2, "c"], [5, 0, "b"]]


def test_no_python_is_called_where_all_lists_have_one_length() -> None:
    script = "SELECT this[0] + 1, this[2] FROM edges WHERE this[1] == 2 OR this[-1] == 'a' AS list;"
    assert python_calls(text_of(script, edges=EDGES)) == set()
    assert "item" in python_calls(text_of(script, ["positions"], edges=EDGES))
    assert "item" in python_calls(text_of("SELECT this[0] FROM rows AS list;", rows=[[1], [2, 3]]))
    search = "SELECT a.this[1], b.this FROM a = edges, b = [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = a.this[1]"
    assert "item" not in text_of(f"{search} STOP WITH a.this[0] != n AS list;", edges=EDGES)


def test_a_search_over_edges_looks_its_steps_up(ss: ss2sql.Session) -> None:
    """A step costs its neighbours, not the list: SQLite asks for the rows whose first element is the node."""
    ss.attach("edges", [[n, n + 1] for n in range(300)])
    search = "START WITH node = 0 CONNECT BY UNIQUE node = this[1] STOP WITH this[0] != node"
    result = ss.run(f"SELECT this[1] FROM edges {search} AS list;", engine="database")
    assert len(result.paths) == 300
    plan = ss.host.connection.execute(f"EXPLAIN QUERY PLAN {result.sql}", {"edges": None}).fetchall()
    assert any("AUTOMATIC" in str(line) for line in plan)
