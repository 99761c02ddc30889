"""`explain`: SQLite's plan in words, and searches that nothing bounds."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import ss2sql
from ss2sql.explained.endless import ADVICE
from ss2sql.explained.sqlite_plan import SENTENCES


@pytest.fixture(scope="module")
def ss(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ss2sql.Session]:
    path = tmp_path_factory.mktemp("data") / "map.db"
    with closing(sqlite3.connect(path)) as file, file:
        file.executescript(
            """CREATE TABLE edge(src, dst, len); CREATE INDEX start_index ON edge(src);
               CREATE TABLE town(id INTEGER PRIMARY KEY, name); INSERT INTO edge VALUES (1, 2, 5), (2, 3, 5);
               INSERT INTO town VALUES (2, 'Ulm');"""
        )
    file.close()
    with ss2sql.connect(path) as session:
        session.attach("moves", [{"src": 1, "dst": 2}])
        yield session


def plan(ss: ss2sql.Session, script: str) -> list[str]:
    (query,) = ss.compile(script).explain().as_dict()["statements"][0]["queries"]
    return ["  " * line["depth"] + line["words"] for line in query["plan"]]


def test_tables(ss: ss2sql.Session) -> None:
    assert plan(ss, "SELECT src FROM edge;") == ["reads every row of edge"]
    assert plan(ss, "SELECT src FROM e = edge ORDER BY src;") == [
        "reads every row of edge (as e) in the order of its index start_index",
    ]
    sorts = ["reads every row of edge", "sorts the rows for ORDER BY"]
    assert plan(ss, "SELECT src FROM edge ORDER BY len, src;") == sorts
    assert plan(ss, "SELECT dst FROM edge WHERE src == 1;") == [
        "looks up the rows of edge with src = … in its index start_index"
    ]
    assert plan(ss, "SELECT t.name FROM e = edge, t = town WHERE t.id == e.dst;") == [
        "reads every row of edge (as e)",
        "for each of them, looks up the row of town (as t) by its number",
    ]


def test_values(ss: ss2sql.Session) -> None:
    assert plan(ss, "SELECT a.this, m.dst FROM a = range(3), m = moves;") == [
        "walks the elements of range(3) (as a)",
        "for each of them, walks the elements of moves (as m)",
    ]


def test_a_search(ss: ss2sql.Session) -> None:
    script = """SELECT e.dst, e.len FROM e = (SELECT * FROM edge WHERE src == at) START WITH at = 1
        CONNECT BY COST e.len UNIQUE at = e.dst;"""
    assert plan(ss, script) == [
        "searches step by step:",
        "  the first steps:",
        "    looks up the rows of edge with src = … in its index start_index",
        "  the steps after them:",
        "    takes the steps that wait in a queue one by one, the cheapest first",
        "    for each of them, looks up the rows of edge with src = … in its index start_index",
        "gives the results as the search finds them",
    ]


@pytest.mark.parametrize(
    ("options", "queue"),
    [
        ("", "the deepest first"),
        ("BREADTH FIRST", "the oldest first"),
        ("COST 1 HEURISTIC 0", "the one with the least cost and estimate together first"),
        ("PROBABILITY 0.5", "the likeliest first"),
    ],
)
def test_the_queue(ss: ss2sql.Session, options: str, queue: str) -> None:
    found = plan(ss, f"SELECT this FROM [1] START WITH n = 1 CONNECT BY {options} n = n + 1 STOP WITH n >= 3;")
    assert f"takes the steps that wait in a queue one by one, {queue}" in map(str.strip, found)
    assert not any("SQLite says" in line for line in found)


def test_worlds() -> None:
    with ss2sql.connect() as ss:
        ss.attach("space", ss2sql.scenes.chaos(seed=1, bodies=3))
        assert plan(ss, "SELECT mass FROM space;") == ["reads every element of space.bodies (as space)"]
        assert plan(ss, "SELECT mass FROM space WHERE x >= 0 AND x < 2 AND y > 1;") == [
            "asks for the elements of space.bodies (as space) with x from … to … and y > …; "
            "the adapter uses these conditions"
        ]
        assert plan(ss, "SELECT id FROM space.near([0, 0, 0], 1);") == [
            "asks for the elements of space.near for a given point and radius"
        ]


@pytest.mark.parametrize(
    ("query", "lines"),
    [
        ("SELECT this, n.this FROM [1, 2], n = moves ORDER BY n.dst LIMIT 2",
         ["walks the elements of [1, 2]", "for each of them, walks the elements of moves (as n)",
          "sorts them for ORDER BY", "keeps as many as LIMIT says"]),
        ("SELECT dst FROM (SELECT * FROM edge WHERE src == at) START WITH at = 1 CONNECT BY COST len UNIQUE at = dst",
         ["searches step by step:", "  takes the steps that wait one by one, the cheapest first",
          "  for each of them, finds the rows of (SELECT * FROM edge WHERE src == at)",
          "gives the results as the search finds them"]),
        ("SELECT src, dst FROM edge START WITH at = 1 CONNECT BY MEMORIZE 3 at = dst GROUP BY dst",
         ["makes the graph of rows level by level; for each row that is new:", "  reads every row of edge",
          "gives the paths of the graph, the shortest first", "puts them into groups"]),
    ],
)  # fmt: skip
def test_python_tells_it_in_the_same_words(ss: ss2sql.Session, query: str, lines: list[str]) -> None:
    (found,) = ss.compile(f"{query};", engine="native").explain().as_dict()["statements"][0]["queries"]
    assert ["  " * line["depth"] + line["words"] for line in found["plan"]] == lines
    assert {line["sqlite"] for line in found["plan"]} == {None}


# What SQLite may say of other queries than the tests have.
@pytest.mark.parametrize(
    "line",
    ["MATERIALIZE a b", "CO-ROUTINE (subquery-3)", "SCAN 3 CONSTANT ROWS", "USE TEMP B-TREE FOR DISTINCT",
     "USE TEMP B-TREE FOR LAST 2 TERMS OF ORDER BY", "SEARCH t USING COVERING INDEX i (a=? AND b>?)",
     "SEARCH t USING INTEGER PRIMARY KEY (rowid>?)", "LIST SUBQUERY 2", "CORRELATED SCALAR SUBQUERY 4",
     "BLOOM FILTER ON t (a=?)", "COMPOUND QUERY", "LEFT-MOST SUBQUERY", "UNION ALL"],
)  # fmt: skip
def test_every_kind_of_line_has_one_sentence(line: str) -> None:
    found = [re.fullmatch(pattern, line) for pattern, _ in SENTENCES]
    assert any(found)


def test_other_lines_are_shown_as_they_are() -> None:
    assert not any(re.fullmatch(pattern, "MULTI-INDEX OR") for pattern, _ in SENTENCES)


def test_what_is_left_for_python(ss: ss2sql.Session) -> None:
    found = ss.compile("SELECT dst FROM edge GROUP BY src;").explain().as_dict()["statements"][0]["queries"][0]
    assert found["afterwards"] == ["puts the results into groups"]


def test_a_plan_that_cannot_be_told_any_more(tmp_path: Path) -> None:
    with ss2sql.connect() as ss:
        result = ss.run("SELECT this FROM [1];")
    text = result.explain()
    assert "how SQLite does it cannot be told: the session is closed" in text
    assert "FROM elements" in text


# --- searches without an end ---------------------------------------------------------------------------


SEARCH = "SELECT {select} FROM {source} START WITH n = 1 CONNECT BY {options} n = {next} {stop};"
ENDS: dict[str, dict[str, Any]] = {
    "maximum": {"options": "MAXIMUM 3"},
    "a bound of MEMORIZE": {"options": "MEMORIZE 3"},
    "a level at least": {"stop": "STOP WITH n >= 3"},
    "a level compared the other way round": {"stop": "STOP WITH 3 <= n"},
    "a level that is met": {"stop": "STOP WITH this == 7 OR n == 3"},
    "a level that is met in twos": {"stop": "STOP WITH n == 5", "next": "n + 2"},
    "always": {"stop": "STOP WITH True"},
    "each row once": {"options": "UNIQUE", "select": "this"},
    "no row twice": {"options": "NO CYCLE", "select": "this * 2, 'x'"},
    "rows of a table": {"options": "UNIQUE", "source": "(SELECT * FROM edge WHERE src == n)", "select": "dst"},
}
ENDLESS: dict[str, dict[str, Any]] = {
    "nothing": {},
    "a level that is missed": {"stop": "STOP WITH n == 4", "next": "n + 2"},
    "a level that is behind": {"stop": "STOP WITH n == 0"},
    "a level that falls": {"stop": "STOP WITH n >= 3", "next": "n + -1"},
    "a level that is set back": {"options": "n = 0,", "stop": "STOP WITH n >= 3"},
    "one condition of two": {"stop": "STOP WITH n >= 3 AND this == 2"},
    "a limit that moves": {"stop": "STOP WITH n > this"},
    "rows that count": {"options": "UNIQUE", "select": "this, n"},
    "a source that counts": {"options": "UNIQUE", "source": "[n]", "select": "this"},
    "a query that counts": {"options": "UNIQUE", "source": "(SELECT to(dst + n, d) FROM edge)", "select": "d"},
    "MEMORIZE alone": {"options": "MEMORIZE", "select": "n"},
}


def warned(ss: ss2sql.Session, parts: dict[str, str]) -> bool:
    text = {"select": "n", "source": "[1, 2]", "options": "", "next": "n + 1", "stop": "", **parts}
    return f"warning: {ADVICE}" in ss.compile(SEARCH.format(**text)).explain()


@pytest.mark.parametrize("name", ENDS)
def test_searches_that_end(ss: ss2sql.Session, name: str) -> None:
    assert not warned(ss, ENDS[name])


@pytest.mark.parametrize("name", ENDLESS)
def test_searches_that_nothing_ends(ss: ss2sql.Session, name: str) -> None:
    assert warned(ss, ENDLESS[name])
