"""The types of START WITH variables: what is proved of them, and that every state of a search keeps to it."""

from __future__ import annotations

import re
from typing import Any

import pytest
from golden import each_row
from hypothesis import given
from hypothesis import strategies as st
from programs.drawn import amount, drawn

import ss2sql
from ss2sql.frontend.resolve.search_clauses import STEPS
from ss2sql.language.kinds import Kind, Type, is_supertype, type_of
from ss2sql.language.plan_traversal import format_type

MOVES = [[-1, 0, 1.5], [1, 0, 1], [2, -3, 0.5]]
STEPS_AS_DICTS = [{"dx": -1, "dy": 0, "c": 1.5}, {"dx": 1, "dy": 3, "c": 1}]


def session() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.attach("moves", MOVES)
    ss.attach("steps", STEPS_AS_DICTS)
    ss.attach("edges", [[0, 1], [1, 2], [2, 5]])
    ss.attach("names", [["a", "b"], ["b", "c"]])
    ss.attach("width", 300)
    ss.attach("wall", [0, 1, 2])
    ss.host.connection.execute("CREATE TABLE links(src, dst); INSERT INTO links VALUES (1, 2), (2, 3)")
    return ss


def states_of(ss: ss2sql.Session, script: str) -> dict[str, Type]:
    statement = ss.compile(script).plan.statements[-1].expr
    return dict(statement.query.search.states)  # type: ignore[union-attr]


def shown(kind: Type) -> str:
    """A type in words, of a short list one by one."""
    if kind.positions is None or kind.kinds != Kind.LIST:
        return format_type(kind)
    return f"[{', '.join(map(shown, kind.positions))}]"


@each_row("search/types-of-states", "script", "expected")
def test_types_of_states(script: str, expected: str) -> None:
    found = ", ".join(f"{name}: {shown(kind)}" for name, kind in states_of(session(), script).items())
    assert found == re.sub(r"\{(.*?)\}", lambda bound: str(eval(bound[1], {"FAR": STEPS})), expected)


def test_replaced_operators_prove_nothing() -> None:
    ss = session()
    ss.function("add", lambda a, b: "x")
    types = states_of(ss, "SELECT 1 FROM moves START WITH x = 0 CONNECT BY x = x + this[0] STOP WITH x + this[0] < 0;")
    assert shown(types["x"]) == "any"


NUMBERS = [
    "x", "y", "p[0]", "p[1]", "0", "7", "-2", "0.5", "this[0]", "this[1]", "this[2]", "x + this[0]", "this[1] + y",
    "y - this[0]", "x + 1", "y - 1", "x + y", "x * 2", "-x", "abs(y)", "max([x, y])", "min(x + 1, 5)",
    "max([y - 2, 0])", "(x + this[1]) % 5",
    "IF(x > 3; 0; x + 2)", "IF(this[0] > 0; y + this[2]; y)", "p[0] + this[0]", "p[1] - y",
    "x / 2", "IF(x > 1; True; x)", "int(y)", "sqrt(abs(x))", "x ^ 2",
]  # fmt: skip
NUMBER = st.sampled_from(NUMBERS)
POINT = st.one_of(
    st.builds("[{}, {}]".format, NUMBER, NUMBER),
    st.sampled_from(["p", "this", "[p[1], p[0]]", "IF(x > 2; p; [p[0] + 1, y])", "[x]", "p + [x]"]),
)
COMPARISON = st.builds("{} {} {}".format, NUMBER, st.sampled_from(["<", "<=", ">", ">="]), NUMBER)
CONDITION = st.recursive(
    COMPARISON,
    lambda inner: st.one_of(
        st.builds("NOT ({})".format, inner),
        st.builds("({} OR {})".format, inner, inner),
        st.builds("({} AND {})".format, inner, inner),
    ),
    max_leaves=4,
)
CONNECT = st.permutations(["x = {}", "y = {}", "p = {}"])


@pytest.mark.drawn
@drawn(amount(1 / 8))
@given(st.data())
def test_every_state_keeps_to_its_type(data: st.DataObject) -> None:
    parts = [part.format(data.draw(POINT if part[0] == "p" else NUMBER)) for part in data.draw(CONNECT)]
    if data.draw(st.integers(0, 4)) == 0:
        parts.append(f"x = {data.draw(NUMBER)}")
    first = data.draw(st.sampled_from(["x = 0, y = 0", "x = 0.5, y = 3", "x = -1, y = 2.5", "x = 2, y = True"]))
    point = data.draw(st.sampled_from(["[1, 0]", "[1, 2.5]", "[1, 0, 5]", "None", "[]"]))
    script = (
        f"SELECT x, y, p FROM moves START WITH {first}, p = {point} "
        f"CONNECT BY BREADTH FIRST MAXIMUM 50, {', '.join(parts)} STOP WITH {data.draw(CONDITION)};"
    )
    ss = session()
    types = states_of(ss, script)
    try:
        paths: list[list[dict[str, Any]]] = ss.run(script, engine="native").value
    except ss2sql.ExecutionError:
        return
    for row in (row for path in paths for row in path):
        for name, value in row.items():
            assert is_supertype(types[name], type_of(value)), (script, name, value, shown(types[name]))
