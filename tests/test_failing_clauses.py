"""Queries in which several clauses fail: both engines and the reference hear of the same one, at the same place.

Every order and rule for repeats meets every clause that fails, alone and with others, for a goal and for what is none;
so does every clause of a query that is no search, each piece failing at the first row, a later one, or at none.
Of more than 64 scripts every seventh is tried, all of them where SS2SQL_PROGRAMS is above 1,000. Seven divides no
number of choices, so that every choice is among those that are tried.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from string import Formatter
from typing import Any

import pytest
from agreement import Outcome, exact, judged
from programs.drawn import PROGRAMS
from reference import Reference

import ss2sql

ALL = PROGRAMS > 1000
pytestmark = pytest.mark.slow
OPTIONS = (
    "", "BREADTH FIRST", "UNIQUE", "NO CYCLE", "DEPTH FIRST UNIQUE", "COST 1", "COST 1 UNIQUE", "COST 1 NO CYCLE",
    "COST 1 / (node - 2)", "COST 1 HEURISTIC 'a' + 1", "COST 1 HEURISTIC 'a' + 1 UNIQUE", "COST 1 HEURISTIC node - 3",
    "PROBABILITY 0.5", "PROBABILITY 0.5 UNIQUE", "PROBABILITY 3 - node", "PROBABILITY 0 NO CYCLE",
)  # fmt: skip
SHOWN = ("1 / (node - 2)", "[this, 1 + text[7]]", "node")
GOALS = ("", "WHERE node > 1", "WHERE node > 5", "WHERE text[9] == 'a'")
NEXT = ("node = this, text = this + 'y'", "node = this, text = text", "node = 1 / (node - 2), text = text")
LATER = ("node = this, text = text[this - 6]", "node = node + this, text = text")
ENDS = ("GROUP BY 1 / (this - 7)", "ORDER BY 1 / (this - 8)", "ORDER BY this LIMIT 1 - 3", "GROUP BY this")
STOPS = ("node >= 4", "node >= 1", "text[8] == 'x'")
QUERIES = {
    "plain": "SELECT {0} FROM [7, 8, 9] WHERE {1} > -5 ORDER BY {2} LIMIT 2 AS list",
    "cut": "SELECT {0}, {1} FROM [7, 8, 9] WHERE {2} > -5 LIMIT 1 AS list",
    "conditions": "SELECT {0} FROM [7, 8, 9] WHERE {1} > -5 AND {2} > 0 OR {3} > 1 AS list",
    "groups": "SELECT sum({0}), max({1}) FROM [7, 8, 9] WHERE {2} > -5 GROUP BY {3} AS rows",
    "having": "SELECT max({0}) FROM [7, 8, 9] GROUP BY {1} HAVING max({2}) > 0 ORDER BY min({3}) AS rows",
    "keys": "SELECT {0}, count(*) FROM [7, 8, 9] GROUP BY {0}, {1} HAVING min({2}) > 0 ORDER BY sum({3}) AS rows",
    "having of a key": "SELECT count(*) FROM [7, 8, 9] WHERE {0} > -5 GROUP BY this % 2, {1} HAVING this % 2 > 1 "
    "ORDER BY max({2}) LIMIT 2 AS rows",
    "having of keys": "SELECT {0}, count(*) FROM [7, 8, 9] GROUP BY {0}, this, {1} "
    "HAVING this > 8 AND {0} > 0 OR 1 > 2 ORDER BY {1} DESC, max({2}) AS rows",
    "having of nothing": "SELECT {0}, max({1}) FROM [7, 8, 9] GROUP BY {0} HAVING one > 2 AND min({2}) > 0 "
    "ORDER BY sum({3}) AS rows",
    "having of no row": "SELECT count(*) FROM [7, 8, 9] WHERE {0} > -5 GROUP BY this HAVING one > 2 "
    "ORDER BY max({1}) AS rows",
    "having of a constant": "SELECT IF(1 > 1; max({0}); 1) FROM [7, 8, 9] GROUP BY {1} "
    "HAVING 1 < 1 AND min({2}) > 0 AS rows",
    "having of two": "SELECT count(*) FROM a = [7, 8, 9], b = [1, {0.a}] GROUP BY {1.a}, {2.a}, b.this "
    "HAVING b.this > 1 AS rows",
    "partitions": "SELECT {0.a}, b.this FROM a = [7, 8, 9], b = [1, 2] WHERE {1.a} > -5 GROUP BY {2.a} "
    "ORDER BY {3.a} AS rows",
    "two sources": "SELECT {0.a} FROM a = [7, 8, 9], b = [1, {1.a}] WHERE {2.a} > b.this - 5 ORDER BY {3.a} AS rows",
    "groups of two": "SELECT sum({0.a}) FROM a = [7, 8, 9], b = [1, {1.a}] WHERE {2.a} > b.this - 5 "
    "GROUP BY {3.a}, b.this AS rows",
    "three sources": "SELECT {0.a} FROM a = [7, 8, 9], b = [8, {1.a}], c = [7, b.this] "
    "WHERE {2.a} > -9 AND {3.a} > -c.this AS list",
    "inside": "SELECT {0}, len(SELECT {1} FROM [7, 8] AS list) FROM [7, 8, 9] WHERE {2} > -5 ORDER BY {3} AS rows",
    "groups inside": "SELECT {0}, (SELECT sum({1}) FROM [8, 9] GROUP BY {2} AS list) FROM [7, 8, 9] AS rows",
    "in FROM": "SELECT u FROM (SELECT to({0}, u), to({1}, v) FROM [7, 8, 9] WHERE {2} > 0 LIMIT 2) WHERE v > 0 AS list",
    "groups in FROM": "SELECT u FROM (SELECT to(sum({0}), u) FROM [7, 8, 9] WHERE {2} > -5 GROUP BY {1}) AS list",
}

MENTIONING = {
    "list": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}] AS list",
    "columns": "SELECT a.this, b.this FROM a = {some}, b = [{fails}, {tie}] AS rows",
    "groups": "SELECT sum(b.this) FROM a = {some}, b = [{fails}, {tie}] GROUP BY a.this AS list",
    "a condition": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}] WHERE a.this > 5 AS list",
    "conditions": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}] WHERE a.this > 0 AND b.this > 0 AS list",
    "cut": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}] LIMIT 1 AS list",
    "sorted": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}] ORDER BY b.this LIMIT 1 AS list",
    "between": "SELECT 1 FROM a = {some}, b = [{fails}, {tie}], c = [] AS list",
    "last": "SELECT 1 FROM c = [], a = {some}, b = [{fails}, {tie}] AS list",
    "two": "SELECT c.this FROM a = {some}, b = [{fails}, {tie}], c = [{fails}, 4, {tie}] WHERE c.this > 3 AS list",
    "a query": "SELECT b.u FROM a = {some}, b = (SELECT to({fails}, u), to({tie}, v) FROM [1]) AS list",
    "inside": "SELECT len(SELECT 1 FROM a = {some}, b = [{fails}, {tie}] AS list) FROM [1, 2] AS list",
    "a search": "SELECT n FROM a = {some}, b = [{fails}, {tie}] START WITH n = 0 "
    "CONNECT BY UNIQUE n = n + a.this STOP WITH n > 3 AS list",
}
FAILING = (
    "1", "1 / 0", "[1][7]", "int('z')", "'a' + 1", "div(1, 0)", "1 / (1 - 1)", "IF(1 / 0 > 1; 1; 2)",
    "len(SELECT 1 / 0 FROM [1] AS list)",
)  # fmt: skip
TIES = ("1", "a.this", 'eval("1")', "IF(True; 0; a.this)", "a.this - a.this")


class Piece(str):
    """An expression of `this`, which is 7, 8 or 9."""

    @property
    def a(self) -> str:
        """The same of the source a."""
        return self.replace("this", "a.this")


PIECES = [Piece("this"), Piece("1 / (this - 8)"), Piece("int('12z'[this - 7])"), Piece("int('z12'[this - 7])")]


def engine_outcome(script: str, engine: Any, **variables: Any) -> tuple[Outcome | None, int | None]:
    """What an engine makes of it, None where it refuses it, and where in the script it fails."""
    with ss2sql.connect() as session:
        for name, value in variables.items():
            session.attach(name, value)
        try:
            return Outcome(exact(session.run(script, engine=engine, max_rows=1000).value)), 0
        except ss2sql.UnsupportedError:
            return None, 0
        except ss2sql.Error as error:
            return Outcome(error=error.code), error.span and error.span.start


def some(scripts: Iterable[str]) -> list[str]:
    """Every seventh, where there are many."""
    found = list(scripts)
    return found if ALL or len(found) <= 64 else found[::7]


def agree(scripts: list[str], **variables: Any) -> float:
    """Which part of them the database runs, too; all come to the same, those that fail at the same place."""
    in_database = 0
    for script in scripts:
        native, place = engine_outcome(script, "native", **variables)
        assert native == judged(Reference(variables=variables), script), script
        found, where = engine_outcome(script, "database", **variables)
        assert found is None or (found, where) == (native, place), script
        in_database += found is not None
    return in_database / len(scripts)


@pytest.mark.drawn
@pytest.mark.parametrize("most", ["", "MAXIMUM 1"])
@pytest.mark.parametrize("option", OPTIONS)
def test_the_first_clause_that_fails_shows(option: str, most: str) -> None:
    scripts = (
        f"SELECT {shown} FROM [7, 8] {goal} START WITH node = 2, text = 'x' "
        f"CONNECT BY {option} {most} {following} STOP WITH {stop} AS rows"
        for shown, goal, following, stop in product(SHOWN, GOALS, NEXT, STOPS)
    )
    assert agree(some(scripts)) > 0.46


@pytest.mark.drawn
@pytest.mark.parametrize("option", OPTIONS)
def test_what_is_done_with_results_fails_after_the_steps(option: str) -> None:
    scripts = (
        f"SELECT {shown} FROM [7, 8] {goal} START WITH node = 2, text = 'xy' "
        f"CONNECT BY {option} {following} STOP WITH node > 14 {end} AS list"
        for shown, goal, following, end in product(SHOWN, GOALS, LATER, ENDS)
    )
    assert agree(some(scripts)) > 0.52


@pytest.mark.drawn
@pytest.mark.parametrize("name", QUERIES)
def test_the_first_clause_of_a_query_that_fails_shows(name: str) -> None:
    slots = {field[0] for _, field, _, _ in Formatter().parse(QUERIES[name]) if field}
    scripts = (QUERIES[name].format(*chosen) for chosen in product(PIECES, repeat=len(slots)))
    assert agree(some(scripts), one=1) >= 0.2


@pytest.mark.drawn
@pytest.mark.parametrize("name", MENTIONING)
def test_a_source_that_mentions_an_earlier_one_fails_in_its_rows_only(name: str) -> None:
    """It does so as it is written: `tie` mentions a, in what the rewrites find to be the same for all of its rows."""
    scripts = (
        MENTIONING[name].format(some=some, fails=fails, tie=tie)
        for some, fails, tie in product(("[]", "[1, 2]", "[0, 3]"), FAILING, TIES)
    )
    assert agree(some(scripts)) > 0.37
