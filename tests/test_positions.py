"""What is read of short lists becomes columns of their source; the values are those of a sheet of this name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sql_calls import python_calls

import ss2sql

EDGES = [[0, 1, "a"], [1, 2, "b"], [2, 5, "a"], [0, 2, "c"], [5, 0, "b"]]


def text_of(script: str, disable: Sequence[str] = (), **variables: Any) -> str:
    with ss2sql.connect(disable=disable) as ss:
        for name, value in variables.items():
            ss.attach(name, value)
        return str(ss.compile(script, engine="database").sql)


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
