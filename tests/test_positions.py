"""What is read of short lists becomes columns of their source."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from agreement import differences, executor_outcome
from programs import ProgramCase
from sql_calls import python_calls

import ss2sql

EDGES = [[0, 1, "a"], [1, 2, "b"], [2, 5, "a"], [0, 2, "c"], [5, 0, "b"]]
LISTS = {
    "edges": EDGES,
    "mixed": [[1, 2.5, None, True], [0.0, -0.0, "x", False], [3, 1, [1], True]],
    "values": [[1, 2.5, None, True], [0.0, -0.0, "x", False], [True, 1, "y", False]],
}


def text_of(script: str, disable: Sequence[str] = (), **variables: Any) -> str:
    with ss2sql.connect(disable=disable) as ss:
        for name, value in variables.items():
            ss.attach(name, value)
        return str(ss.compile(script, engine="database").sql)


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this[0], this[2] FROM edges WHERE this[1] == 2 OR this[-1] == 'a' AS list;",
        "SELECT this, this[0], this[True] FROM edges AS rows;",
        "SELECT * FROM edges WHERE this[0] > 0;",
        "SELECT this[0], count(*) FROM edges GROUP BY this[0] HAVING count(*) > 1 AS rows;",
        "SELECT this[2] FROM edges ORDER BY this[1] DESC, this[0] LIMIT 3 AS list;",
        "SELECT this[0] FROM edges GROUP BY [this[2]] AS list;",
        "SELECT a.this, (SELECT this[1] FROM edges WHERE this[0] == a.this AS list) FROM a = [0, 1, 7] AS rows;",
        "SELECT this[1] FROM (SELECT this[1], this[0] FROM edges AS rows) WHERE this[0] > 1 AS list;",
        "SELECT this[0] + 1, x.this[1][0] FROM x = [[1, [2]], [3, [4]]] AS rows;",
        "SELECT this[3] FROM edges AS list;",
        "SELECT this[3] FROM edges WHERE this[0] > 7 AS list;",
        "SELECT this[0][0] FROM edges AS list;",
        "SELECT a.this[1], b.this[0] FROM a = edges, b = edges WHERE a.this[1] == b.this[0] AS rows;",
        "SELECT this[0], this[1], this[2], this[3], this[0] == this[1], NOT this[3] FROM values AS rows;",
        "SELECT this[0], this[3] FROM mixed WHERE this[3] AS rows;",
        "SELECT this[0] FROM [[1], [2]] AS list;",
        "SELECT this[0] FROM [[1], [2, 3]] AS list;",
        "SELECT this[0] FROM zip([1, 2], ['a', 'b']) WHERE this[1] == 'b' AS list;",
        "SELECT this[1] FROM edges START WITH node = 0 CONNECT BY node = this[1] "
        "STOP WITH this[0] != node OR node == 5 AS list;",
        "SELECT this[1] FROM edges WHERE this[0] == node START WITH node = 0 CONNECT BY UNIQUE node = this[1] "
        "STOP WITH this[0] != node AS list;",
        "SELECT this[1], n FROM [[n, 1], [n + 1, 2]] WHERE this[0] > 2 START WITH n = 0 CONNECT BY n = this[0] + 1 "
        "STOP WITH n > 3 AS rows;",
        "SELECT a.this[0], b.this[1] FROM a = edges, b = edges WHERE b.this[1] == 5 START WITH node = 0 "
        "CONNECT BY MAXIMUM 5 node = b.this[1] STOP WITH a.this[0] != node OR a.this[1] != b.this[0] AS rows;",
    ],
)  # fmt: skip
def test_all_evaluators_agree(script: str) -> None:
    case = ProgramCase(script, {name: value for name, value in LISTS.items() if name in script})
    assert differences(case) == []
    assert executor_outcome(case, "database", disable=["positions"]) == executor_outcome(case, "database")


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
