"""Searches and GROUP BY: which options and names go where, and what the resolver refuses."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import pytest
from resolving import engines, errors, message
from resolving import fixture_tables as fixture_tables

import ss2sql

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
def test_a_query_inside_a_group_value_is_known_again(ss: ss2sql.Session, engine: str) -> None:
    ss.host.connection.execute("CREATE TABLE ages(a); INSERT INTO ages VALUES (1), (3)")
    size = "len(SELECT ages.a FROM ages WHERE ages.a {} k.this AS list)"
    script = f"SELECT {size}, count(*) FROM k = [0, 5, 0] GROUP BY {size} AS rows"
    assert ss.run(script.format(">", ">"), engine=engine).value == [(2, 2), (0, 1)]
    assert errors(ss, script.format(">", ">=")) == [("R008", size.format(">"))]
    other = "len(SELECT k.this FROM ages)"  # has as many numbers inside
    assert errors(ss, script.format(">", ">").replace(size.format(">"), other, 1)) == [("R008", other)]


def test_a_users_function_called_count_takes_no_star(ss: ss2sql.Session) -> None:
    ss.function("count", lambda value: 7)
    assert ss.eval("SELECT count(a) FROM t GROUP BY a AS list") == [7, 7]
    assert errors(ss, "SELECT count(*) FROM t GROUP BY a") == [("R008", "count(*)")]


@pytest.mark.parametrize(
    ("script", "cure"),
    [
        ("SELECT count(*) FROM t", "add GROUP BY, or count the rows of a query"),
        ("SELECT sum(*) FROM t GROUP BY a", r"write count\(\*\), or name what sum is to take"),
        ("SELECT mine(*) FROM t GROUP BY a", "give arguments to mine, which is a function of yours"),
    ],
)
def test_a_star_in_the_wrong_place_has_a_cure(ss: ss2sql.Session, script: str, cure: str) -> None:
    ss.function("mine", lambda value: 7)
    with pytest.raises(ss2sql.ResolveError, match=cure) as caught:
        ss.compile(script)
    assert caught.value.code == "R008"


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


@engines
def test_of_equal_sums_the_one_that_is_asked_first_fails(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("large", [{"x": 2**62}, {"x": 2**62}])
    for script in (
        "SELECT sum(x) FROM large GROUP BY 1 HAVING (sum(x) > 0);",
        "SELECT (sum(x)) + sum(x) FROM large GROUP BY 1;",
    ):
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run(script, engine=engine)
        assert caught.value.span is not None
        assert script[caught.value.span.start - 1 : caught.value.span.end] == "(sum(x)"


@engines
def test_a_search_may_aggregate_where_rows_are_not_compared(ss: ss2sql.Session, engine: Any) -> None:
    script = """
        SELECT n, count(*) FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this STOP WITH n > 2
        GROUP BY n AS rows
    """
    # Two steps from 0 lead to 1 and 2, two from 1 to 2 and 3; so 2 is come to by two paths, and each goes two steps on.
    assert ss.run(script, engine=engine).value == [(0, 2), (1, 2), (2, 4)]


@engines
@pytest.mark.parametrize(
    ("inner", "value"),
    [
        ("SELECT a FROM n WHERE a > 0", [2, 3]),
        ("SELECT a FROM n WHERE a > 0 LIMIT 2", [2]),
        ("SELECT a FROM n ORDER BY a DESC LIMIT 2", [3, 2]),
        ("SELECT a FROM n ORDER BY a DESC", [3, 2]),
        ("SELECT a FROM n GROUP BY a HAVING a > 2", [3]),
    ],
)
def test_a_query_in_from_keeps_its_clauses(ss: ss2sql.Session, engine: Any, inner: str, value: list[int]) -> None:
    ss.attach("n", [{"a": 0}, {"a": 1}, {"a": 2}, {"a": 3}])
    assert ss.run(f"SELECT q.a FROM q = ({inner}) WHERE q.a > 1 AS list;", engine=engine).value == value
