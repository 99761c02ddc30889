"""Names, types and options: what the resolver makes of a script, and what it refuses."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import pytest
from listings import HANOI, ROBOT

import ss2sql
from ss2sql import plan
from ss2sql.kinds import ANY, Kind, Type
from ss2sql.plan_tree import plan_tree, type_text

engines = pytest.mark.parametrize("engine", ["auto", "native"])
MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


@pytest.fixture
def ss():
    with ss2sql.connect() as session:
        session.attach("t", [{"a": 1, "b": 2}, {"a": 3, "b": 4}])
        session.attach("u", [{"b": 20, "c": 30}])
        yield session


def errors(ss: ss2sql.Session, script: str) -> list[tuple[str, str]]:
    """The codes of all errors of a script with the texts that they point at."""
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(script)
    assert caught.value is caught.value.errors[0]
    found = []
    for error in caught.value.errors:
        assert error.span is not None
        assert error.hints, error
        found.append((error.code, error.span.text))
    return found


def message(ss: ss2sql.Session, script: str) -> str:
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(script)
    return str(caught.value)


def query_of(ss: ss2sql.Session, script: str, number: int = -1) -> plan.Query:
    expr = ss.compile(script).plan.statements[number].expr
    if isinstance(expr, plan.Assign):
        expr = expr.value
    assert isinstance(expr, plan.Subquery)
    return expr.query


# --- what a bare name means ----------------------------------------------------------------------------


@engines
@pytest.mark.parametrize(
    ("script", "value"),
    [
        # a START WITH variable before a column, a column before a script variable, that before a function
        ("SELECT a FROM t START WITH a = 7 CONNECT BY a = a STOP WITH True AS list;", []),
        ("SELECT a FROM t WHERE True START WITH a = 7 CONNECT BY a = a STOP WITH True AS list;", [[7], [7]]),
        ("a = 9; SELECT a FROM t AS list;", [1, 3]),
        ("c = 9; SELECT c FROM t AS list;", [9, 9]),
        ("mass = 9; SELECT mass FROM t AS list;", [9, 9]),
        ("SELECT mass FROM t AS list;", ["m", "m"]),
        ("SELECT mass(this) FROM t AS list;", ["m", "m"]),
        # from the innermost query outwards
        ("SELECT (SELECT b FROM u AS value) FROM t AS list;", [20, 20]),
        ("SELECT (SELECT a FROM u AS value) FROM t AS list;", [1, 3]),
        ("SELECT (SELECT (SELECT a FROM u AS value) FROM u AS value) FROM t AS list;", [1, 3]),
        ("b = 9; SELECT (SELECT b FROM [0] AS value) FROM t AS list;", [2, 4]),
        ("SELECT (SELECT n FROM u AS value) FROM t WHERE True"
         " START WITH n = 5 CONNECT BY n = n STOP WITH True AS list;",
         [[5], [5]]),
        ("SELECT (SELECT c FROM u AS value) FROM t WHERE True"
         " START WITH c = 5 CONNECT BY c = c STOP WITH True AS list;",
         [[30], [30]]),
        # qualified names
        ("SELECT t.b, u.b FROM t, u AS rows;", [(2, 20), (4, 20)]),
        ("SELECT x.b, y.b FROM x = t, y = t WHERE x.a < y.a AS rows;", [(2, 4)]),
        ("SELECT (SELECT x.a + y.c FROM y = u AS value) FROM x = t AS list;", [31, 33]),
        ("SELECT (SELECT x.b FROM x = u AS value) FROM x = t AS list;", [20, 20]),
        # this
        ("SELECT this FROM x = [1], y = [2] AS list;", [1]),
        ("SELECT y.this, this FROM x = [1], y = [2] AS rows;", [(2, 1)]),
        ("SELECT (SELECT this FROM [5] AS value) FROM [1] AS list;", [5]),
        ("SELECT (SELECT x.this + y.this FROM y = [5] AS value) FROM x = [1] AS list;", [6]),
        ("SELECT this FROM u AS list;", [{"b": 20, "c": 30}]),
        # a later source sees an earlier one
        ("SELECT x.this, y.this FROM x = [[1, 2], [3]], y = x.this AS rows;", [([1, 2], 1), ([1, 2], 2), ([3], 3)]),
        ("SELECT y.this FROM t, y = [a, t.b] AS list;", [1, 2, 3, 4]),
        ("SELECT z FROM t, y = (SELECT to(this + a, z) FROM [b]) AS list;", [3, 7]),
        # keys of GROUP BY and ORDER BY
        ("SELECT mass, count(*) FROM t GROUP BY mass AS rows;", [("m", 2)]),
        ("SELECT a FROM t GROUP BY mass AS list;", {"m": [1, 3]}),
        ("SELECT a FROM t ORDER BY minus AS list;", [3, 1]),
        ("SELECT a FROM t ORDER BY b DESC AS list;", [3, 1]),
    ],
)  # fmt: skip
def test_the_first_match_wins(ss: ss2sql.Session, engine: Any, script: str, value: Any) -> None:
    ss.function("mass", lambda row: "m")
    ss.function("minus", lambda row: -row["a"])
    assert ss.run(script, engine=engine).value == value


@pytest.mark.parametrize(
    ("script", "found"),
    [
        ("SELECT b FROM t, u;", [("R004", "b")]),
        ("SELECT x.a FROM x = t, y = t WHERE b == 2;", [("R004", "b")]),
        ("SELECT (SELECT b FROM [1] AS value) FROM t, u;", [("R004", "b")]),
        ("SELECT this FROM t, u ORDER BY b;", [("R004", "b")]),
        ("SELECT b FROM b, t;", [("R003", "b"), ]),
        ("SELECT 1 FROM t GROUP BY z;", [("R001", "z")]),
        ("SELECT mass + 1 FROM t;", [("R001", "mass")]),
        ("SELECT a FROM t WHERE mass;", [("R001", "mass")]),
        ("mass;", [("R001", "mass")]),
        ("SELECT z.this FROM t;", [("R003", "z.this")]),
        ("SELECT z.a FROM t;", [("R003", "z.a")]),
        ("SELECT t.z FROM t;", [("R001", "t.z")]),
        ("SELECT x.z FROM x = [1];", [("R001", "x.z")]),
        ("this;", [("R014", "this")]),
        ("x.this;", [("R003", "x.this")]),
        ("SELECT 1 FROM a = [b.this], b = [1];", [("R003", "b.this")]),
        ("SELECT 1 FROM t, t;", [("R013", "t")]),
        ("SELECT 1 FROM x = t, x = u;", [("R013", "x = u")]),
        ("SELECT 1 FROM f;", [("R003", "f")]),
        ("SELECT 1 FROM t.a;", [("R003", "t.a")]),
        ("SELECT 1 FROM mass;", [("R003", "mass")]),
        ("SELECT to(a, b) + 1 FROM t;", [("R014", "to(a, b)")]),
        ("SELECT a FROM t WHERE to(a, b);", [("R014", "to(a, b)")]),
        ("SELECT a FROM t AS list(a);", [("R001", "a")]),
        ("SELECT a FROM t LIMIT a;", [("R001", "a")]),
        ("SELECT to(a, b + 'x') FROM t;", [("R001", "b")]),
        ("SELECT a FROM t AS lists;", [("R006", "AS lists")]),
        ("fun(1);", [("R002", "fun(1)")]),
        ("SELECT t.len() FROM t;", [("R002", "t.len()")]),
        ("SELECT t.nothing(3) FROM t;", [("R002", "t.nothing(3)")]),
        ("SELECT item(this, 0) FROM [[1]] AS list; slyce(1);", [("R002", "slyce(1)")]),
        ("len(1, 2);", [("R005", "len(1, 2)")]),
        ("v{};", [("R001", "v{}")]),
    ],
)  # fmt: skip
def test_names_that_mean_nothing(ss: ss2sql.Session, script: str, found: list[tuple[str, str]]) -> None:
    ss.function("mass", lambda row: "m")
    assert errors(ss, script) == found


@pytest.mark.parametrize(
    ("script", "hint"),
    [
        ("SELECT mov.this FROM moves;", "did you mean 'moves'?"),
        ("SELECT t.zzz FROM t;", "known here: a, b"),
        ("SELECT b FROM t, u;", "write t.b or u.b"),
        ("SELECT x.a FROM x = [1];", "its elements have no columns; write x.this"),
        ("SELECT levl FROM t START WITH level = 1 CONNECT BY level = 2;", "did you mean 'level'?"),
        ("SELECT this FROM mooves;", "did you mean 'moves'?"),
        ("SELECT this FROM len;", "'len' is a function: call it, len(...)"),
        ("SELECT a FROM t WHERE mass;", "'mass' is a function: write mass(this)"),
        ("lenn('a');", "did you mean 'len' or"),
        ("SELECT a FROM t AS lst;", "did you mean 'list' or"),
        ("SELECT 1 FROM t, t;", "name them: FROM a = t, b = t"),
        ("SELECT x FROM x = t;", "'x' is a source: write x.this"),
        ("SELECT null FROM t;", "write None"),
        ("SELECT zzz FROM t;", "known here: a, b, moves, t, u"),
        ("max(1);", "max(SELECT ... AS list)"),
        ("count(*);", "add GROUP BY"),
    ],
)
def test_hints_name_the_cure(ss: ss2sql.Session, script: str, hint: str) -> None:
    ss.function("mass", lambda row: "m")
    ss.attach("moves", MOVES)
    assert hint in message(ss, script)


def test_several_errors_are_found_at_once(ss: ss2sql.Session) -> None:
    script = """x = one + 1;
SELECT two, len() FROM t, three WHERE t.four == 5 AND six(7)
ORDER BY t.eight LIMIT nine AS ten;
SELECT (SELECT eleven FROM t) FROM u;"""
    expected = [
        ("R001", "one"), ("R005", "len()"), ("R003", "three"), ("R001", "t.four"), ("R002", "six(7)"), ("R001",
        "t.eight"),
        ("R001", "nine"), ("R006", "AS ten"), ("R001", "eleven"),
    ]  # fmt: skip
    # `two` may be a column of the unknown source, so it is no error of its own.
    assert errors(ss, script) == expected
    shown = message(ss, script)
    assert shown.count("error[") == len(expected)
    assert [line.rsplit(":", 2)[1] for line in shown.splitlines() if "-->" in line] == list("122223334")


# --- columns that are not known yet --------------------------------------------------------------------


@dataclass
class Body:
    mass: float


@engines
def test_columns_are_those_of_all_elements(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("mixed", [{"a": 1}, {"b": 2}, {"a": None, "b": 3}])
    assert ss.run("SELECT a, b FROM mixed AS rows;", engine=engine).value == [(1, None), (None, 2), (None, 3)]
    assert ss.run("SELECT * FROM mixed;", engine=engine).columns == ("a", "b")
    ss.attach("plain", [1, {"a": 1}])
    assert ss.run("SELECT * FROM plain;", engine=engine).columns == ("plain",)
    with pytest.raises(ss2sql.ResolveError):
        ss.run("SELECT a FROM plain;", engine=engine)
    ss.attach("bodies", [Body(1.5), Body(2.5)])
    assert ss.run("SELECT mass FROM bodies AS list;", engine=engine).value == [1.5, 2.5]
    ss.attach("empty", [])
    assert ss.run("SELECT this FROM empty AS list;", engine=engine).value == []


@engines
@pytest.mark.parametrize("forms", [("rows = f();", "rows"), ("rows = IF(True; f());", "rows"), ("r = [f()];", "r[0]")])
def test_columns_of_a_variable_that_the_script_assigns(ss: ss2sql.Session, engine: Any, forms: tuple[str, str]) -> None:
    before, source = forms
    ss.function("f", lambda: [{"a": 50, "mass": 70, "z": 90}], volatility="volatile")
    ss.function("mass", lambda row: "function")
    for script, value in (
        (f"{before} SELECT z FROM x = {source} AS list;", [90]),
        (f"{before} SELECT mass FROM x = {source} AS list;", [70]),
        (f"a = 1; {before} SELECT a FROM x = {source} AS list;", [50]),
        (f"{before} SELECT (SELECT a FROM x = {source} AS value) FROM t AS list;", [50, 50]),
        (f"{before} SELECT (SELECT b FROM x = {source} AS value) FROM t AS list;", [2, 4]),
        (f"{before} SELECT (SELECT z FROM [1] AS value) FROM x = {source} AS list;", [90]),
        (f"{before} SELECT a FROM x = {source}, [1] AS list;", [50]),
        (f"{before} y = [1]; SELECT a FROM x = {source}, y AS list;", [50]),
        (f"{before} SELECT * FROM x = {source};", [{"a": 50, "mass": 70, "z": 90}]),
        (f"{before} SELECT x.z FROM x = {source} WHERE z == 90 ORDER BY mass AS list;", [90]),
        (
            f"{before} SELECT a FROM x = {source} WHERE True START WITH a = 3 CONNECT BY a = a STOP WITH True AS list;",
            [[3]],
        ),
    ):
        assert ss.run(script, engine=engine).value == value, script
    for script in (f"{before} SELECT other FROM x = {source};", f"{before} SELECT x.other FROM x = {source};"):
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(script, engine=engine)
        assert caught.value.code in ("R001", "X008")
        assert caught.value.span is not None
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(f"{before} SELECT z FROM x = {source}, y = {source};", engine=engine)
    assert caught.value.code == "R004"


@engines
def test_columns_of_what_a_function_gives(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda: [{"z": 90}, {"z": 91}], volatility="immutable")
    ss.function("g", lambda: [{"z": 90}, {"y": 91}, 5, Body(1.0)], volatility="immutable")
    ss.function("empty", list, volatility="immutable")
    assert ss.run("SELECT z FROM f() WHERE f.z > 90 AS list;", engine=engine).value == [91]
    assert ss.run("SELECT x.z, y.z FROM x = f(), y = f() WHERE x.z != y.z AS rows;", engine=engine).value == [
        (90, 91), (91, 90)]  # fmt: skip
    assert ss.run("SELECT (SELECT z FROM [1] AS value) FROM f() AS list;", engine=engine).value == [90, 91]
    assert ss.run("SELECT * FROM f();", engine=engine).value == [{"z": 90}, {"z": 91}]
    assert ss.run("SELECT * FROM empty();", engine=engine).columns == ("empty",)
    assert ss.run("SELECT z FROM empty() AS list;", engine=engine).value == []
    for script in ("SELECT y FROM f();", "SELECT z FROM g();", "SELECT g.mass FROM g();"):
        with pytest.raises(ss2sql.ExecutionError, match="has no column") as caught:
            ss.run(script, engine=engine)
        assert caught.value.code == "X008"
        assert caught.value.span is not None
    assert errors(ss, "SELECT z FROM x = f(), y = f();") == [("R004", "z")]
    assert "write x.z or y.z" in message(ss, "SELECT z FROM x = f(), y = f();")


@engines
def test_star(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda: [{"p": 1}, {"q": 2}], volatility="immutable")
    ss.function("values", lambda: [{"p": 1}, 2], volatility="immutable")
    assert ss.run("SELECT * FROM t, u WHERE a == 1 AS dict;", engine=engine).value == [
        {"a": 1, "b": 2, "b_2": 20, "c": 30}
    ]
    assert ss.run("SELECT * FROM f(), n = [7];", engine=engine).value == [
        {"p": 1, "q": None, "n": 7}, {"p": None, "q": 2, "n": 7}]  # fmt: skip
    assert ss.run("SELECT * FROM values();", engine=engine).value == [{"values": {"p": 1}}, {"values": 2}]
    assert ss.run("SELECT * FROM (SELECT a, b FROM t WHERE a > 1);", engine=engine).value == [{"a": 3, "b": 4}]
    assert ss.run("SELECT * FROM x = (SELECT a FROM t AS list) AS rows;", engine=engine).value == [(1,), (3,)]


# --- late lists ----------------------------------------------------------------------------------------


@engines
def test_a_list_that_mentions_sources_is_read_for_each_row(ss: ss2sql.Session, engine: Any) -> None:
    before = "pairs = [[a.this, b.this], [b.this, a.this]]; "
    inner = "(SELECT this FROM pairs WHERE this[0] < this[1] AS list)"
    script = f"{before} SELECT {inner} FROM a = [1, 2], b = [1, 2] AS list;"
    assert ss.run(script, engine=engine).value == [[], [[1, 2]], [[1, 2]], []]
    assert ss.run(f"SELECT {inner} FROM a = [5], b = [6] AS list;", engine=engine).value == [[[5, 6]]]
    assert ss.run(f"pairs = [this + 1]; SELECT {inner.replace('this[0] < this[1]', 'True')} FROM [1, 2] AS list;",
                  engine=engine).value == [[2], [3]]  # fmt: skip
    assert ss.run("names = [t.a, len([t.b])]; SELECT (SELECT this FROM names AS list) FROM t AS rows;",
                  engine=engine).value == [([1, 1],), ([3, 1],)]  # fmt: skip


def test_a_list_that_mentions_sources_has_no_value_elsewhere(ss: ss2sql.Session) -> None:
    before = "pairs = [a.this, 1]; "
    for script, place in (
        ("pairs;", "pairs"),
        ("len(pairs);", "pairs"),
        ("SELECT this FROM pairs;", "pairs"),
        ("SELECT pairs FROM a = [1];", "pairs"),
        ("SELECT (SELECT this FROM pairs AS list) FROM b = [1];", "pairs"),
    ):
        assert errors(ss, before + script) == [("R011", place)]
        assert "the list stands here" in message(ss, before + script)
    assert ss.eval(before) is None
    assert errors(ss, "pairs;") == [("R011", "pairs")]
    assert ss.eval("pairs = 3; pairs;") == 3
    assert ss.eval(before + "pairs{5} = 4; pairs;") == 4
    assert ss.eval(before + "IF(True; pairs = [7]); SELECT this FROM pairs AS list;") == [7]


def test_only_a_list_alone_is_late(ss: ss2sql.Session) -> None:
    assert errors(ss, "x = [a.this] + [1];") == [("R003", "a.this")]
    assert ss.eval("x = [SELECT this FROM [1] AS list]; x;") == [[1]]
    assert errors(ss, "SELECT (x = [a.this]) FROM t;") == [("R003", "a.this")]


# --- searches ------------------------------------------------------------------------------------------

OPTIONS = [
    "DEPTH FIRST",
    "BREADTH FIRST",
    "COST 1",
    "PROBABILITY 1",
    "HEURISTIC 0",
    "NO CYCLE",
    "UNIQUE",
    "MEMORIZE 3",
    "MAXIMUM 2",
]
ORDERS, REPEATS = {"DEPTH", "BREADTH", "COST", "PROBABILITY"}, {"NO", "UNIQUE", "MEMORIZE"}


def allowed(one: str, other: str) -> bool:
    pair = {one.split()[0], other.split()[0]}
    if pair <= ORDERS:
        return False
    if pair <= REPEATS:
        return pair == {"NO", "UNIQUE"}
    if "HEURISTIC" in pair:
        return "COST" in pair
    return pair not in ({"MEMORIZE", "DEPTH"}, {"MEMORIZE", "BREADTH"})


@pytest.mark.parametrize(("one", "other"), list(combinations(OPTIONS, 2)))
def test_options_that_go_together(ss: ss2sql.Session, one: str, other: str) -> None:
    for words in (f"{one} {other}", f"{other} {one}"):
        script = (
            f"SELECT n FROM [1] WHERE n == 2 START WITH n = 1 CONNECT BY {words} n = n + 1 STOP WITH n == 2 AS list;"
        )
        if allowed(one, other):
            assert ss.eval(script) == [[1, 2]]
        else:
            assert {code for code, _ in errors(ss, script)} == {"R010"}


def test_contradictions_name_both_options(ss: ss2sql.Session) -> None:
    script = "SELECT 1 FROM [1] START WITH n = 1 CONNECT BY {} n = n;"
    assert errors(ss, script.format("UNIQUE UNIQUE")) == [("R010", "UNIQUE")]
    assert "UNIQUE is given twice" in message(ss, script.format("UNIQUE UNIQUE"))
    orders = script.format("DEPTH FIRST COST 1 BREADTH FIRST")
    assert errors(ss, orders) == [("R010", "COST 1"), ("R010", "BREADTH FIRST")]
    shown = message(ss, script.format("MEMORIZE 3 DEPTH FIRST"))
    assert "MEMORIZE yields its paths shortest first" in shown
    assert "the other one" in shown


def test_clauses_of_a_search_need_connect_by(ss: ss2sql.Session) -> None:
    assert errors(ss, "SELECT 1 FROM t START WITH n = 1;") == [("R012", "n = 1")]
    assert errors(ss, "SELECT 1 FROM t STOP WITH a == 1;") == [("R012", "a == 1")]
    assert errors(ss, "SELECT 1 FROM t START WITH n = 1 STOP WITH a == 1;") == [("R012", "n = 1"), ("R012", "a == 1")]


def test_assignments_of_a_search(ss: ss2sql.Session) -> None:
    script = "SELECT 1 FROM t START WITH n = 1 CONNECT BY n = n {};"
    assert errors(ss, "SELECT 1 FROM t START WITH n = 1, n = 2 CONNECT BY n = n;") == [("R013", "n")]
    assert errors(ss, "SELECT 1 FROM t START WITH n = 1 CONNECT BY m = n;") == [("R001", "m")]
    assert errors(ss, "SELECT 1 FROM t START WITH n = m, m = 1 CONNECT BY n = n;") == [("R001", "m")]
    assert errors(ss, "SELECT 1 FROM t WHERE (n = 1) == 1 START WITH n = 1 CONNECT BY n = n;") == [("R007", "n")]
    assert errors(ss, script.format("STOP WITH IF(True; n = 2)")) == [("R007", "n")]
    nested = "SELECT (SELECT (n = 2) FROM [1] AS value) FROM t START WITH n = 1 CONNECT BY n = n;"
    assert errors(ss, nested) == [("R007", "n")]
    search = "START WITH n = 1, m = n + 1 CONNECT BY n = m, m = n + 1, n = n * 10 STOP WITH n > 20"
    assert ss.eval(f"SELECT n, m FROM [1] WHERE True {search} AS rows;")[-1] == [(1, 2), (20, 3), (30, 4)]


def test_what_the_clauses_of_a_search_see(ss: ss2sql.Session) -> None:
    script = """SELECT n, k.this FROM k = [n + 1] WHERE k.this > n
    START WITH n = 1 CONNECT BY n = k.this STOP WITH n == 3 GROUP BY n ORDER BY k.this DESC LIMIT 2 AS rows;"""
    assert ss.eval(script) == {3: [[(1, 2), (2, 3), (3, 4)]], 2: [[(1, 2), (2, 3)]]}
    for clause in ("LIMIT n", "AS list(n)"):
        assert errors(ss, f"SELECT n FROM t START WITH n = 1 CONNECT BY n = n {clause};") == [("R001", "n")]
    for option in ("MAXIMUM (n)", "MEMORIZE (n)"):
        assert errors(ss, f"SELECT n FROM t START WITH n = 1 CONNECT BY {option} n = n;") == [("R001", "n")]
    assert ss.eval("SELECT n FROM [1] START WITH n = 1 CONNECT BY COST n n = n + 1 STOP WITH n == 3 AS list;") == [
        [1],
        [1, 2],
    ]


# --- GROUP BY ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("script", "found"),
    [
        ("SELECT a, sum(b) FROM t GROUP BY b;", [("R008", "a")]),
        ("SELECT a + sum(b) FROM t GROUP BY b;", [("R008", "a + sum(b)")]),
        ("SELECT sum(b) FROM t GROUP BY b HAVING a > 1;", [("R008", "a > 1")]),
        ("SELECT a FROM t GROUP BY b HAVING a > 1;", [("R008", "a > 1")]),
        ("SELECT sum(b) FROM t GROUP BY b ORDER BY a;", [("R008", "a")]),
        ("SELECT (SELECT sum(x.a + t.b) FROM x = t GROUP BY 1 AS value), count(*) FROM t GROUP BY 1;",
         [("R008", "SELECT sum(x.a + t.b) FROM x = t GROUP BY 1 AS value")]),
        ("SELECT count(*) FROM t;", [("R008", "count(*)")]),
        ("SELECT sum(*) FROM t GROUP BY a;", [("R008", "sum(*)")]),
        ("SELECT max(a) FROM t;", [("R008", "max(a)")]),
        ("SELECT n, count(*) FROM t START WITH n = 1 CONNECT BY UNIQUE n = n GROUP BY n;", [("R008", "n")]),
    ],
)  # fmt: skip
def test_aggregates_out_of_place(ss: ss2sql.Session, script: str, found: list[tuple[str, str]]) -> None:
    assert errors(ss, script) == found


@engines
@pytest.mark.parametrize(
    ("script", "value"),
    [
        ("SELECT a.this, (SELECT count(*) FROM b = [1, 1, 2] GROUP BY b.this HAVING b.this == a.this AS value) "
         "FROM a = [1, 2] GROUP BY a.this AS rows;", [(1, 2), (2, 1)]),
        ("SELECT a.this, (SELECT b.this + 10 * a.this FROM b = [1, 1, 2] GROUP BY b.this, 3 AS list) "
         "FROM a = [1, 2] GROUP BY a.this AS rows;", [(1, [11, 12]), (2, [21, 22])]),
        ("SELECT count(*), (SELECT max([a.this, 0]) FROM b = [1] AS value) FROM a = [1, 2] GROUP BY a.this AS rows;",
         [(1, 1), (1, 2)]),
        ("SELECT count(*), (SELECT sum(b.this) FROM b = [[1], [2, 3]] AS list)"
         " FROM a = [1, 2] GROUP BY a.this > 0 AS rows;",
         [(2, [1, 5])]),
        ("SELECT a.this, (SELECT count(*) FROM b = [1] GROUP BY 1 AS value) FROM a = [1, 2] GROUP BY 1 AS rows;",
         {1: [(1, 1), (2, 1)]}),
        ("SELECT a.this FROM a = [2, 1] GROUP BY a.this "
         "ORDER BY len(SELECT b.this FROM b = [a.this] WHERE b.this > 1 AS list) AS list;", [1, 2]),
        ("SELECT sum(sum(this)) FROM [[1, 2], [3]] GROUP BY 1 AS list;", [6]),
        ("SELECT max(this, 5) FROM [1, 7] GROUP BY this AS list;", [5, 7]),
        ("SELECT this % 2 + 1, sum(this) FROM [1, 2, 3] GROUP BY this % 2 HAVING this % 2 == 1 AS rows;", [(2, 4)]),
    ],
)  # fmt: skip
def test_groups_inside_of_groups(ss: ss2sql.Session, engine: Any, script: str, value: Any) -> None:
    assert ss.run(script, engine=engine).value == value


# --- types ---------------------------------------------------------------------------------------------


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
        "SELECT a FROM t AS rows": "list of list of int 1..3", "(x = a)": "int 1..3", "a XOR b": "bool",
        "SELECT a FROM t START WITH n = 1 CONNECT BY n = n AS list": "list of list of int 1..3", "eval('1')": "any",
    }  # fmt: skip
    ss.function("f", lambda x: x, volatility="stable")
    ss.function("g", lambda x: x + 1)
    for text, expected in kinds.items():
        column = query_of(ss, f"SELECT ({text}) FROM t;").columns[0].expr
        assert type_text(column.type) == expected, text


# --- the plan as text ----------------------------------------------------------------------------------

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
        "      expr: aggregate max [none or int 2..4]",
        "        argument: column b of source 2 [int 2..4]",
        "    where: eq() [bool]",
        "      arguments: column a of source 2 [int 1..3]",
        "      arguments: variable wanted [any]",
        "    group: f() immutable [int 1..3]",
        "      arguments: column a of source 2 [int 1..3]",
        "    order: descending",
        "      expr: aggregate max [none or int 2..4]",
        "        argument: column b of source 2 [int 2..4]",
    ]


@pytest.mark.parametrize(
    ("call", "function"), [("t.len()", "len(t)"), ("t.max(3)", "max(t, ...)"), ("t.nothing()", "nothing(t)")]
)
def test_methods_are_written_as_functions(ss: ss2sql.Session, call: str, function: str) -> None:
    with pytest.raises(ss2sql.ResolveError) as error:
        ss.run(f"SELECT {call} FROM t;")
    hint = f"there are no methods; write {function}, with a function that is known or registered"
    assert error.value.hints == (hint,)
