"""Types: what the resolver knows of states, variables and expressions."""

from __future__ import annotations

from typing import Any

import pytest
from listings import MOVES
from resolving import engines, query_of
from resolving import fixture_tables as fixture_tables

import ss2sql
from ss2sql.kinds import ANY, Kind, Type
from ss2sql.plan_tree import type_text


def states(ss: ss2sql.Session, search: str) -> dict[str, Type]:
    query = query_of(ss, f"SELECT 1 FROM moves {search};")
    assert query.search is not None
    return dict(query.search.states)


def test_types_of_states_cover_what_connect_by_gives(ss: ss2sql.Session) -> None:
    ss.attach("moves", MOVES)
    ss.function("f", lambda x: x, volatility="stable")
    ss.function("g", lambda x: -x)
    found = states(ss, "START WITH n = 1 CONNECT BY n = n + 1")
    assert found["n"].kinds == Kind.INT
    assert found["n"].bounded(2**62)  # a counter stays within 64 bits on any path that fits into memory
    assert states(ss, "START WITH n = 1 CONNECT BY n = n * 2")["n"] == Type(Kind.INT)
    assert states(ss, "START WITH n = 1 CONNECT BY n = n / 2")["n"].kinds == Kind.INT | Kind.FLOAT
    assert states(ss, "START WITH n = 'a' CONNECT BY n = n + 'b'")["n"].kinds == Kind.STR
    assert states(ss, "START WITH n = None CONNECT BY n = this")["n"].kinds == Kind.NONE | Kind.LIST
    assert states(ss, "START WITH n = 1 CONNECT BY n = f(n)")["n"] == ANY
    assert states(ss, "START WITH n = 1 CONNECT BY n = g(n)")["n"].kinds == Kind.INT  # its body says so
    assert states(ss, "START WITH n = 1, m = 1.5 CONNECT BY n = m, m = n")["n"].kinds == Kind.INT | Kind.FLOAT
    assert states(ss, "START WITH a = 1, b = 'x', c = None CONNECT BY a = b, b = c, c = a")["a"].may(Kind.NONE)
    flag = states(ss, "START WITH n = True CONNECT BY n = NOT n")["n"]
    assert flag.kinds == Kind.BOOL
    grown = states(ss, "START WITH path = [] CONNECT BY path = path + [this]")["path"]
    assert grown.may(Kind.LIST)
    assert states(ss, "START WITH n = [1] CONNECT BY n = [n]")["n"].may(Kind.LIST)


@engines
@pytest.mark.parametrize(
    ("search", "last"),
    [
        ("START WITH n = 1 CONNECT BY n = [n]", "[[[1]]]"),
        ("START WITH n = 1 CONNECT BY n = n / 2", "0.125"),
        ("START WITH n = [] CONNECT BY n = n + [len(n)]", "[0, 1, 2]"),
        ("START WITH n = None CONNECT BY n = IF(n == None; 1; str(n))", "'1'"),
        ("START WITH n = 1, m = 'x', k = 0.5 CONNECT BY n = m, m = k, k = n", "'x'"),
        ("START WITH n = True CONNECT BY n = IF(n == True; 0; [n])", "[[0]]"),
    ],
)
def test_states_of_changing_kinds(ss: ss2sql.Session, engine: Any, search: str, last: str) -> None:
    others = ", level = 0", ", level = level + 1"
    start, connect = search.split(" CONNECT BY ")
    script = (
        f"SELECT n FROM [1] WHERE level == 3 {start}{others[0]} CONNECT BY {connect}{others[1]} STOP WITH level == 3;"
    )
    (path,) = ss.run(script, engine=engine).paths
    assert repr(path[-1][0]) == last


@engines
def test_a_replaced_operator_promises_nothing(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", lambda a, b: f"{a}{b}")
    script = "SELECT level FROM [1] START WITH level = 1 CONNECT BY level = level + 1 STOP WITH level == '111' AS list;"
    assert ss.run(script, engine=engine).value == [[1], [1, "11"]]


@engines
def test_types_of_variables_that_a_function_changes(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("change", lambda x: ss.set("x", x), volatility="volatile")
    script = "x = 1; change(y); SELECT x + x FROM [1] AS list;"
    assert ss.run(script, engine=engine, y="a").value == ["aa"]
    assert ss.run(script, engine=engine, y=[1]).value == [[1, 1]]
    assert ss.run(script, engine=engine, y=2).value == [4]
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("x = 1; clear(); SELECT x FROM [1];", engine=engine)
    assert (caught.value.code, caught.value.span and caught.value.span.text) == ("R001", "x")


def test_types_of_expressions(ss: ss2sql.Session) -> None:
    kinds = {
        "1": "int 1..1", "1.5": "float 1.5..1.5", "'a'": "str", "None": "none", "True": "bool",
        "[1, 'a']": "list of int or str 1..1",
        "[]": "list of nothing", "[a, 2]": "list of int 1..3", "a": "int 1..3", "a + b": "int 3..7",
        "a / b": "float 0.25..1.5",
        "a == b": "bool", "NOT a": "bool", "a AND b": "bool", "IF(a; 1; 'x')": "int or str 1..1",
        "IF(a; 1)": "bool or int 0..1",
        "[1, 2][0]": "int 1..1", "len('ab')": "int 0..9007199254740992", "f(a)": "any",
        "g(a)": "int 2..4", "this": "dict", "str(a)": "str",
        "SELECT a FROM t AS list": "list of int 1..3", "SELECT a FROM t AS value": "none or int 1..3",
        "SELECT a FROM t": "list of dict", "SELECT a FROM t GROUP BY b": "dict", "SELECT a FROM t AS void": "none",
        "SELECT a FROM t AS rows": "list of list of int 1..3",
        "SELECT a FROM t AS set": "list of int 1..3", "(x = a)": "int 1..3", "a XOR b": "bool",
        "SELECT a FROM t START WITH n = 1 CONNECT BY n = n AS list": "list of list of int 1..3", "eval('1')": "any",
    }  # fmt: skip
    ss.function("f", lambda x: x, volatility="stable")
    ss.function("g", lambda x: x + 1)
    for text, expected in kinds.items():
        column = query_of(ss, f"SELECT ({text}) FROM t;").columns[0].expr
        assert type_text(column.type) == expected, text
