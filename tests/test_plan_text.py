"""The plan as text."""

from __future__ import annotations

import pytest
from listings import HANOI, MOVES, ROBOT
from resolving import fixture_tables as fixture_tables

import ss2sql
from ss2sql.plan_tree import plan_tree

SCRIPTS = [
    *(text.replace("mov.this", "this") for text in HANOI.values()),
    ROBOT,
    "SELECT a, to(t.b, 'x' + 'y') FROM t, u WHERE a < 1 OR NOT t.b == 2 XOR c"
    " GROUP BY a, t.b HAVING count(*) > 1 ORDER BY a DESC;",
    "x{5.0} = 1; x{}; x{-1}; y = [a.this]; IF(x; print(1), 2; 3); eval('1'); [x, 2][0:1];",
    "SELECT * FROM (SELECT a FROM t), n = f() START WITH k = 1 CONNECT BY COST 1 HEURISTIC 0 MAXIMUM 3 k = k "
    "GROUP BY k ORDER BY k LIMIT 2 AS grid(1, offset = 2);",
    "SELECT a FROM t WHERE a == wanted;",
]  # fmt: skip


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_plan_can_be_printed(ss: ss2sql.Session, script: str) -> None:
    ss.attach("moves", MOVES)
    for name in ("move", "position", "checkCollision", "playSound", "f"):
        ss.function(name, lambda *arguments: arguments)
    ss.representation("grid")(lambda table, *arguments, **named: table.rows)
    query = ss.compile(script)
    text = plan_tree(query.plan)
    assert text == plan_tree(ss.compile(script).plan)
    assert text.endswith("\n")
    assert "Span(" not in text
    assert " at 0x" not in text
    for line in text.splitlines():
        assert line.strip()
        assert (len(line) - len(line.lstrip())) % 2 == 0


def test_what_a_plan_says(ss: ss2sql.Session) -> None:
    ss.function("f", lambda x: x, volatility="immutable")
    text = plan_tree(
        ss.compile("SELECT f(a), max(b) FROM t WHERE a == wanted GROUP BY f(a) ORDER BY max(b) DESC;").plan
    )
    assert text.splitlines() == [
        "parameters wanted",
        "subquery",
        "  query: query 1 as dict",
        "    sources: source 2 t [dict]",
        "      value: variable t [list of dict]",
        "    columns: column f",
        "      expr: group value 1 [int 1..3]",
        "    columns: column max",
        "      expr: aggregate max [int 2..4]",
        "        argument: column b of source 2 [int 2..4]",
        "    where: eq() [bool]",
        "      arguments: column a of source 2 [int 1..3]",
        "      arguments: variable wanted [any]",
        "    group: f() immutable [int 1..3]",
        "      arguments: column a of source 2 [int 1..3]",
        "    order: descending",
        "      expr: aggregate max [int 2..4]",
        "        argument: column b of source 2 [int 2..4]",
    ]
