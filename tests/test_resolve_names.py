"""What the resolver says of names, options and groups that mean nothing: code, place, reason, cure; and what it knows.

What names mean is told by `cases/queries/*.sheet`; most of the scripts here are in `cases/errors/names.errors`.
"""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any

import pytest
from golden import each_row
from listings import MOVES
from sessions import wrong_scripts

import ss2sql
from ss2sql.language import plan
from ss2sql.language.plan_traversal import format_type


@pytest.fixture(name="ss")
def fixture_tables(ss: ss2sql.Session) -> ss2sql.Session:
    """A session with the tables t and u, which share a column."""
    ss.attach("t", [{"a": 1, "b": 2}, {"a": 3, "b": 4}])
    ss.attach("u", [{"b": 20, "c": 30}])
    return ss


@pytest.fixture
def more(ss: ss2sql.Session) -> ss2sql.Session:
    """The same with more names."""
    ss.attach("moves", MOVES)
    ss.attach("v", [{"len": 1}])
    ss.attach("w", [{"len": 2}])
    ss.function("mass", lambda row: "m")
    ss.function("mine", lambda value: 7)
    ss.function("late", lambda: [{"z": 90}, {"z": 91}], volatility="immutable")
    ss.function("f", lambda first, second=0: [first, second])
    ss.function("g", lambda: [1])
    return ss


def refused(ss: ss2sql.Session, script: str) -> ss2sql.Error:
    """The error of a script; each of its errors has a place and a cure."""
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(script)
    assert caught.value is caught.value.errors[0]
    for error in caught.value.errors:
        assert error.span is not None
        assert error.hints, error
    return caught.value


def errors(ss: ss2sql.Session, script: str) -> list[tuple[str, str]]:
    """The codes of all errors of a script with the texts that they point at."""
    return [(error.code, error.span.text) for error in refused(ss, script).errors if error.span]


PAIRS = "x = [a.this, 1]; "


@pytest.mark.parametrize(("code", "words", "marked"), [*wrong_scripts("names")])
def test_errors_have_code_place_reason_and_cure(more: ss2sql.Session, marked: str, code: str, words: list[str]) -> None:
    """The places of the errors stand between « and »."""
    error = refused(more, re.sub("[«»]", "", marked))
    places = [(one.code, one.span.text) for one in error.errors if one.span]
    assert places == [(code, place) for place in re.findall("«(.*?)»", marked)]
    assert error.errors[0].span is not None
    assert error.errors[0].span.start == marked.index("«")
    for part in words:
        assert part in str(error)


def test_several_errors_are_found_at_once(ss: ss2sql.Session) -> None:
    script = """x = one + 1;
SELECT two, len() FROM t, three WHERE t.four == 5 AND six(7)
ORDER BY t.eight LIMIT nine AS ten;
SELECT (SELECT eleven FROM t) FROM u;"""
    expected = [
        ("R001", "one"), ("R005", "len()"), ("R003", "three"), ("R001", "t.four"), ("R002", "six"),
        ("R001", "t.eight"), ("R001", "nine"), ("R006", "AS ten"), ("R001", "eleven"),
    ]  # fmt: skip
    # `two` may be a column of the unknown source, so it is no error of its own.
    assert errors(ss, script) == expected
    shown = str(refused(ss, script))
    assert shown.count("error[") == len(expected)
    assert [line.rsplit(":", 2)[1] for line in shown.splitlines() if "-->" in line] == list("122223334")


def test_named_arguments_of_a_table_function(more: ss2sql.Session) -> None:
    assert more.eval("SELECT this FROM f(1, second = 2) AS list;") == [1, 2]


def test_a_late_list_stays_late_until_it_is_assigned(ss: ss2sql.Session) -> None:
    assert ss.eval(PAIRS) is None
    assert errors(ss, "x;") == [("R011", "x")]
    assert ss.eval("x = 3; x;") == 3


# --- searches and groups ---------------------------------------------------------------------------------

OPTIONS = ["DEPTH FIRST", "BREADTH FIRST", "COST 1", "PROBABILITY 1", "HEURISTIC 0", "NO CYCLE", "UNIQUE",
           "MEMORIZE 3", "MAXIMUM 2"]  # fmt: skip
ORDERS, REPEATS = {"DEPTH", "BREADTH", "COST", "PROBABILITY"}, {"NO", "UNIQUE", "MEMORIZE"}


def allowed(one: str, other: str) -> bool:
    pair = {one.split()[0], other.split()[0]}
    if pair <= ORDERS:
        return False
    if pair <= REPEATS:
        return pair == {"NO", "UNIQUE"}
    if "HEURISTIC" in pair:
        return "COST" in pair or pair <= {"HEURISTIC", "NO", "UNIQUE", "MAXIMUM"}
    return pair not in ({"MEMORIZE", "DEPTH"}, {"MEMORIZE", "BREADTH"})


@pytest.mark.parametrize(("one", "other"), list(combinations(OPTIONS, 2)))
def test_options_that_go_together(ss: ss2sql.Session, one: str, other: str) -> None:
    search = "SELECT n FROM [1] WHERE n == 2 START WITH n = 1 CONNECT BY {} n = n + 1 STOP WITH n == 2 AS list;"
    for words in (f"{one} {other}", f"{other} {one}"):
        if allowed(one, other):
            assert ss.eval(search.format(words)) == [[1, 2]]
        else:
            assert {code for code, _ in errors(ss, search.format(words))} == {"R010"}


def test_a_users_function_called_count_takes_no_star(ss: ss2sql.Session) -> None:
    ss.function("count", lambda value: 7)
    assert ss.eval("SELECT count(a) FROM t GROUP BY a AS list") == [7, 7]
    assert errors(ss, "SELECT count(*) FROM t GROUP BY a") == [("R008", "count(*)")]


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


# --- types -----------------------------------------------------------------------------------------------


def query_of(ss: ss2sql.Session, script: str) -> plan.Query:
    expr = ss.compile(script).plan.statements[-1].expr
    assert isinstance(expr, plan.Subquery)
    return expr.query


@each_row("expressions/types", "text", "told")
def test_types_of_expressions(ss: ss2sql.Session, text: str, told: str) -> None:
    """Those of operators and functions: `test_builtin_types`; of variables of a search: `test_states`."""
    ss.function("f", lambda x: x, volatility="stable")
    ss.function("g", lambda x: x + 1)
    assert format_type(query_of(ss, f"SELECT ({text}) FROM t;").columns[0].expr.type) == told


def test_a_replaced_operator_promises_nothing(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", lambda a, b: f"{a}{b}")
    script = "SELECT level FROM [1] START WITH level = 1 CONNECT BY level = level + 1 STOP WITH level == '111' AS list;"
    assert ss.run(script, engine=engine).value == [[1], [1, "11"]]


def test_types_of_variables_that_a_function_changes(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("change", lambda x: ss.set("x", x), volatility="volatile")
    script = "x = 1; change(y); SELECT x + x FROM [1] AS list;"
    for value, doubled in (("a", "aa"), ([1], [1, 1]), (2, 4)):
        assert ss.run(script, engine=engine, y=value).value == [doubled]
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("x = 1; clear(); SELECT x FROM [1];", engine=engine)
    assert (caught.value.code, caught.value.span and caught.value.span.text) == ("R001", "x")


def test_a_data_frame_is_not_read_whole(ss: ss2sql.Session) -> None:
    pandas = pytest.importorskip("pandas")
    ss.attach("people", pandas.DataFrame({"a": [1]}))
    for script, frame in (("SELECT a FROM people", True), ("people = [2]; SELECT this FROM people", False)):
        source = query_of(ss, script).sources[0]
        assert isinstance(source, plan.ValueSource)
        assert isinstance(source.value, plan.Variable)
        assert source.value.frame is frame
