"""Queries inside of others, in every clause: both engines and the reference evaluator come to the same.

A query inside is evaluated in one way where it stands in a row, in another where its value is bound to the statement
before that runs: in START WITH, LIMIT and MAXIMUM, and in FROM where it may fail. Each one here is a small number, so
that it may stand anywhere.
"""

from __future__ import annotations

from typing import Any

import pytest
from agreement import executor_outcome, is_allowed, reference_outcome
from programs import ProgramCase
from sessions import both

import ss2sql

VARIABLES: dict[str, Any] = {
    "people": [{"age": 7, "home": 1}, {"age": 8, "home": 2}, {"age": 9, "home": 1}],
    "pairs": [[1, 2], [2, 3], [2, 2]],
    "n": 1,
}
NUMBERS = (
    "n",
    "len(pairs)",
    "len(SELECT this FROM [[1, 2], [3, 3]] WHERE this[0] == this[1] AS list)",
    "max(SELECT this[1] FROM [[1, 2], [3, 3]] ORDER BY this[0] DESC LIMIT 1 AS list)",
    "(SELECT sum(this) FROM [1, 2, 2] GROUP BY this AS list)[0]",
    "len(SELECT a.this FROM a = [1, 2], b = [1, a.this] WHERE a.this == b.this LIMIT 2 AS list)",
    "IF(1 IN (SELECT this FROM [1, 2] AS list); 1; 2)",
    "(SELECT count(*) FROM people GROUP BY home HAVING count(*) > 1 AS list)[0]",
    "len(SELECT a.age, b.home FROM a = people, b = people WHERE a.home == b.home AND b.age == 9 AS rows)",
    "(SELECT u FROM (SELECT to(this[0], u) FROM [[2, 1], [1, 1]] WHERE 1 / this[1] > 0 LIMIT 1) AS list)[0]",
    "len(SELECT this FROM [1, 2] START WITH k = 0 CONNECT BY k = k + 1 STOP WITH k > 0 AS list)",
    "len(SELECT a.this FROM a = [1, 2, 3], b = [[1, 1], [2, 1]] WHERE b.this[0] == a.this AS list)",
    "(SELECT this[0] FROM pairs WHERE this[1] == 2 AS value)",
    "len(SELECT this FROM [n, 2, 3] WHERE this IN (SELECT this[1] FROM pairs AS list) AS list)",
)
QUERIES = (
    "SELECT this + {0} FROM [1, 2, 3] WHERE this >= {1} AS list",
    "SELECT this FROM [3, 1, 2] ORDER BY this % {0} LIMIT {1} AS list",
    "SELECT min(this % {0}), count(*) FROM [1, 2, 3] GROUP BY this % {0} HAVING count(*) >= {1} AS rows",
    "SELECT max(this + {0}) FROM [1, 2, 3] GROUP BY {1} AS list",
    "SELECT this, {0} FROM [1, 2, 3] GROUP BY this, {1} HAVING max(this) > {0} LIMIT {1} AS list",
    "SELECT [this, m] FROM [1, 2] START WITH m = {0} CONNECT BY m = m + {1} STOP WITH m > 3 AS list",
    "SELECT this FROM [1, 2] START WITH m = 0 CONNECT BY MAXIMUM ({0}) m = m + this STOP WITH m > {1} AS list",
    "SELECT this FROM [1, 2] WHERE m == {0} START WITH m = 0 CONNECT BY COST {1} m = m + this STOP WITH m > 2 AS list",
    "SELECT this FROM [1, 2] WHERE m >= {0} START WITH m = 0 CONNECT BY UNIQUE m = {1} STOP WITH m > 3 AS list",
    "SELECT this FROM [1, 2] START WITH m = 0 CONNECT BY MEMORIZE ({0}) m = m + {1} STOP WITH m > 3 AS list",
    "SELECT this FROM range({0}, 3 + {1}) AS list",
    "SELECT a.this, b.this FROM a = [1, 2], b = [{0}, a.this + {1}] AS rows",
    "SELECT a.this, b.this FROM a = [1, 2], b = [{0}, 1 / (3 - {1})] AS rows",
    "SELECT a.this, u FROM a = [1, 2], (SELECT to(this + {0}, u) FROM [1, 2] WHERE this >= {1} LIMIT 1) AS rows",
    "SELECT a.this, u FROM a = [1, 2], (SELECT to({0} / this, u) FROM [1, 2] WHERE 1 / (this - 3) < {1}) AS rows",
    "SELECT a.this FROM a = [1, 2, 3] WHERE a.this IN (SELECT this + {0} FROM [0, 1] WHERE this < {1} AS list) AS list",
    "SELECT (SELECT this FROM [1, 2, 3] LIMIT {0} AS list) FROM [1, 2] GROUP BY this, {1} AS list",
    "found = {0}; SELECT this + found FROM [1, 2] WHERE this > {1} - 1 AS list",
    "SELECT age FROM people START WITH p = {0} CONNECT BY NO CYCLE p = age - 6 STOP WITH p > {1} AS list",
    "SELECT age, sum(home) FROM people GROUP BY age HAVING sum(home) <= {0} ORDER BY age % ({1} + 1), age AS rows",
    "SELECT b.this[1] FROM a = pairs, b = pairs WHERE a.this[0] == b.this[1] AND b.this[0] >= {0} LIMIT {1} AS list",
)


@pytest.mark.parametrize("query", QUERIES)
def test_a_query_inside_means_the_same_in_every_clause(query: str) -> None:
    others = NUMBERS[5:] + NUMBERS[:5]
    for pair in zip(NUMBERS, others, strict=True):
        case = ProgramCase(query.format(*pair), VARIABLES)
        expected = reference_outcome(case)
        for engine in ("native", "database", "auto"):
            assert is_allowed(executor_outcome(case, engine), expected, engine), (case.script, engine)


@both
def test_two_rows_are_enough_to_see_that_a_value_has_several(ss: ss2sql.Session, engine: Any) -> None:
    called: list[int] = []
    ss.function("noted", lambda x: called.append(x) or x, volatility="stable")
    with pytest.raises(ss2sql.ExecutionError, match="several rows"):
        ss.run("1 + (SELECT noted(this) FROM range(100))", engine=engine)
    assert called == [0, 1]
