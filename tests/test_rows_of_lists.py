"""`rows`: queries in FROM that give lists, read as rows."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import executor_outcome, is_allowed, reference_outcome
from programs import ProgramCase

import ss2sql

VARIABLES: dict[str, Any] = {
    "edges": [[0, 1, "a"], [1, 2, "b"], [2, 5, "a"], [0, 2, "c"], [5, 0, "b"]],
    "people": [{"name": "Ada", "age": 36, "this": 1}, {"name": "Bo", "age": None, "this": True}],
    "flags": [True, False, True],
    "lists": [[1], [2, 3], []],
}
SCRIPTS = [
    "SELECT this[2], this[0], this FROM (SELECT this FROM edges WHERE this[1] > 1 AS list) AS rows;",
    "SELECT e.this[2], p.name FROM e = (SELECT this FROM edges WHERE this[1] > 1 AS list), p = people AS rows;",
    "SELECT name, q.age FROM q = (SELECT this FROM people WHERE age != None AS list) AS rows;",
    "SELECT this['name'], this FROM (SELECT this FROM people AS list) AS rows;",
    "SELECT this, this['this'], q['this'] FROM (SELECT this FROM people AS list), q = [{'this': 3}] AS rows;",
    "SELECT * FROM (SELECT this FROM people WHERE name == 'Bo' AS list) AS rows;",
    "SELECT this + 1 FROM (SELECT this[0] FROM edges AS list) WHERE this > 0 AS list;",
    "SELECT this, NOT this FROM (SELECT this FROM flags AS list) WHERE this AS rows;",
    "SELECT this FROM (SELECT a.this == b.this FROM a = flags, b = flags AS list) AS list;",
    "SELECT this, count(*) FROM (SELECT this[2] FROM edges AS list) GROUP BY this AS rows;",
    "SELECT this[0] FROM (SELECT this FROM lists WHERE len(this) > 0 AS list) AS list;",
    "SELECT this[0] FROM (SELECT this FROM lists AS list) AS list;",
    "SELECT this FROM (SELECT this, 1 FROM flags AS list) AS list;",
    "SELECT 7 FROM (SELECT this FROM flags WHERE this AS list) AS list;",
    "SELECT this[1], here FROM (SELECT this FROM edges WHERE this[0] == here AS list)"
    " START WITH here = 0 CONNECT BY NO CYCLE here = this[1] AS rows;",
    "SELECT n.this, this FROM n = [0, 1, 2], (SELECT this[1] FROM edges WHERE this[0] == n.this AS list) AS rows;",
]  # fmt: skip


@pytest.mark.parametrize("script", SCRIPTS)
def test_lists_and_rows_come_to_the_same(script: str) -> None:
    case = ProgramCase(script, VARIABLES)
    expected = reference_outcome(case)
    for engine in ("native", "database", "auto"):
        for disable in ([], ["rows"]):
            assert is_allowed(executor_outcome(case, engine, disable=disable), expected, engine), (engine, disable)


@pytest.mark.parametrize("script", SCRIPTS[:3])
def test_rows_are_not_collected(script: str) -> None:
    with ss2sql.connect(engine="database") as ss:
        for name, value in VARIABLES.items():
            ss.set(name, value)
        assert "collect" not in str(ss.run(script).sql)
