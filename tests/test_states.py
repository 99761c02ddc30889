"""The types of START WITH variables: what is proved of them, and that every state of a search keeps to it."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs.drawn import amount, drawn

import ss2sql
from ss2sql.frontend.resolve.widening import STEPS
from ss2sql.language.kinds import Kind, Type, is_covering, type_of
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


FAR = STEPS  # how far a number gets that changes by 1 with every step


@pytest.mark.parametrize(
    ("source", "start", "connect", "stop", "expected"),
    [
        # A number that changes a little with every step stays far from 64 bits.
        ("moves", "x = 5", "x = x + this[0]", "", f"x: int {5 - FAR}..{5 + 2 * FAR}"),
        ("moves", "x = 5", "x = this[0] + x", "", f"x: int {5 - FAR}..{5 + 2 * FAR}"),
        ("moves", "x = 5", "x = x - this[1]", "", f"x: int 5..{5 + 3 * FAR}"),
        ("moves", "x = 5", "x = x", "", "x: int 5..5"),
        ("moves", "x = 5", "x = 1 - x", "", "x: int -4..5"),
        ("moves", "x = 5", "x = x + x", "", "x: int"),
        ("moves", "x = 5", "x = x * 2", "", "x: int"),
        ("steps", "x = 5, n = 0", "n = n + 1, x = x + dx", "", f"x: int {5 - FAR}..{5 + FAR}, n: int 0..{FAR}"),
        ("steps", "x = 5", "x = IF(dx > 0; x + dx; IF(dy > 7; 0; x))", "", f"x: int {-FAR}..{5 + FAR}"),
        ("steps", "x = 5", "x = IF(dx > 0; x - dy - 1; 7)", "", f"x: int {5 - 4 * FAR}..7"),
        ("steps", "x = 5", "x = max([x - 1, 0])", "", "x: int 0..5"),
        ("steps", "x = 5", "x = min(x + dy, 9)", "", "x: int 5..9"),
        ("steps", "x = 1.5", "x = x + c", "", f"x: float 1.5..{1.5 + 6 * FAR}"),
        ("steps", "x = 1", "x = x + c", "", f"x: int or float 1..{1 + 6.0 * FAR}"),
        ("links", "x = 1", "x = x + dst", "", f"x: int 1..{1 + 4 * FAR}"),
        ("moves", "x = 1", f"x = x + {2**25}", "", f"x: int 1..{1 + 2**61}"),
        ("moves", "x = 1", f"x = x + {2**27}", "", "x: int"),
        ("moves", f"x = {2**62}", "x = x + 1", "", "x: int"),
        ("moves", "x = 1, y = 1", "x = x + y, y = x", "", "x: int, y: int"),
        ("moves", "x = True", "x = x + 1", "", "x: bool or int"),
        # What replaces a value gives its own type.
        ("edges", "x = 7", "x = this[1]", "", "x: int 1..7"),
        ("edges", "x = None", "x = this[0]", "", "x: none or int 0..2"),
        ("edges", "x = None", "x = this", "", "x: none or list"),
        ("names", "x = 'a'", "x = this[1]", "", "x: str"),
        ("links", "x = 1", "x = dst", "", "x: int 1..4"),
        ("moves", "x = 0", "x = (x + this[0]) % 10", "", "x: int 0..9"),
        ("moves", "x = False", "x = NOT x", "", "x: bool"),
        ("moves", "x = []", "x = x + [this[0]]", "", "x: list of int"),
        ("moves", "x = []", "x = [x]", "", "x: list of any"),
        # Bounds that no step leaves.
        ("moves", "a = 0, b = 0", "a = max([0, a + b - 3]), b = min([3, a + b + 9])", "", "a: int 0..0, b: int 0..3"),
        ("moves", "a = 0, n = 0", "a = 1 - a, n = n + 1", "", f"a: int 0..1, n: int 0..{FAR}"),
        ("moves", "a = 1, b = 3", "a = IF(b > a; b - a; a), b = b * 2", "", "a: int, b: int"),
        # Short lists, one by one.
        ("moves", "p = [0, 7]", "p = [p[0] + this[0], p[1]]", "", f"p: [int {-FAR}..{2 * FAR}, int 7..7]"),
        ("moves", "p = ['a', 7]", "p = ['b', p[1] + 1]", "", f"p: [str, int 7..{7 + FAR}]"),
        ("edges", "p = [7, 7]", "p = this", "", "p: [int 0..7, int 1..7]"),
        ("edges", "p = [7, 7]", "p = IF(p[0]; this; p)", "", "p: [int 0..7, int 1..7]"),
        ("edges", "p = [7, 7]", "p = [p[1], p[0]]", "", "p: [int 7..7, int 7..7]"),
        ("edges", "p = [7, 7]", "p = [p[0]]", "", "p: list of int"),
        # STOP WITH speaks of every step that goes on.
        ("moves", "x = 5", "x = x + this[0]", "x + this[0] < 0 OR x + this[0] > 299", "x: int 0..299"),
        ("moves", "x = 5", "x = x + this[0]", "0 > x + this[0] OR width <= x + this[0]", "x: int 0..299"),
        ("moves", "x = 5", "x = x + this[0]", "NOT (x + this[0] >= 0 AND x + this[0] < 9.5)", "x: int 0..9"),
        ("moves", "x = 5", "x = x + this[0]", "x + this[0] < 0 AND x > 9", f"x: int {5 - FAR}..{5 + 2 * FAR}"),
        ("moves", "x = 5", "x = x + this[0]", "x < 0 OR x > 9", "x: int -1..11"),
        ("moves", "n = 1", "n = n + 1", "n >= 8", "n: int 1..8"),
        ("moves", "n = 1", "n = n + 1", "n == 8", f"n: int 1..{1 + FAR}"),
        ("moves", "x = 5", "x = x + 1", "x + 1 > 2", "x: int 5..5"),
        ("moves", "x = 5", "x = x * 2", "x * 2 > 99 OR x * 2 < 0", "x: int 0..99"),
        ("moves", "x = 0.5", "x = x * 2", "x > 99 OR x < 0", "x: float 0.0..198.0"),
        ("moves", "p = [5]", "p = [p[0] + this[0]]", "p[0] + this[0] < 0 OR p[0] > 7", "p: [int 0..9]"),
        ("moves", "x = 1", "x = x + this[0]", "width > 0 OR wall[x + this[0]] == 1", "x: int -3..2"),
        ("moves", "x = 1", "x = x + this[0]", "[x + this[0], 0] NOT IN edges", "x: int 0..2"),
        ("moves", "x = 1", "x = x + this[0]", "NOT (x + this[0]) IN wall", "x: int 0..2"),
        ("moves", "x = 1", "x = x + this[0]", "x > 9 AND wall[x + this[0]] == 1", f"x: int {1 - FAR}..{1 + 2 * FAR}"),
        ("moves", "x = 1", "x = x + this[0]", "[x + this[0], 0] IN edges", f"x: int {1 - FAR}..{1 + 2 * FAR}"),
        ("moves", "x = 1", "x = x + this[0]", "coalesce(1, wall[x + this[0]])", f"x: int {1 - FAR}..{1 + 2 * FAR}"),
        # A later assignment sees an earlier one, so what STOP WITH says of the name is about another value.
        ("moves", "x = 0, y = 0", "x = x + 1, y = x + 1", "x + 1 > 5", "x: int 0..5, y: int 0..6"),
        ("moves", "x = 0, y = 0", "x = x + 1, y = x", "x > 5", "x: int 0..6, y: int 0..6"),
        ("edges", "x = 0, y = 9", "y = x, x = this[1]", "", "x: int 0..5, y: int 0..9"),
        # The last assignment of several counts, and those between see the others.
        ("moves", "x = 0, y = 0", "x = 'a', y = x, x = 1", "", "x: int or str 0..1, y: int or str 0..1"),
    ],
)  # fmt: skip
def test_types_of_states(source: str, start: str, connect: str, stop: str, expected: str) -> None:
    script = f"SELECT 1 FROM {source} START WITH {start} CONNECT BY {connect}{' STOP WITH ' + stop if stop else ''};"
    types = states_of(session(), script)
    assert ", ".join(f"{name}: {shown(kind)}" for name, kind in types.items()) == expected


def test_replaced_operators_prove_nothing() -> None:
    ss = session()
    ss.function("add", lambda a, b: "x")
    ss.function("lt", lambda a, b: False)
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
        f"CONNECT BY BREADTH FIRST MAXIMUM 50 {', '.join(parts)} STOP WITH {data.draw(CONDITION)};"
    )
    ss = session()
    types = states_of(ss, script)
    try:
        paths: list[list[dict[str, Any]]] = ss.run(script, engine="native").value
    except ss2sql.ExecutionError:
        return
    for row in (row for path in paths for row in path):
        for name, value in row.items():
            assert is_covering(types[name], type_of(value)), (script, name, value, shown(types[name]))
