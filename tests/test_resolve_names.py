"""Names: what they mean where they stand, and what the resolver says of those that mean nothing."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from listings import MOVES
from resolving import engines, errors, message
from resolving import fixture_tables as fixture_tables

import ss2sql
from ss2sql.frontend.suggestions import OF_PYTHON


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
        ("SELECT 1 FROM t START WITH x = 1, x = 2 CONNECT BY x = 3;", [("R013", "x")]),
        ("SELECT 1 FROM t LIMIT len(1, 2);", [("R005", "len(1, 2)")]),
        ("round(1, 2, 3);", [("R005", "round(1, 2, 3)")]),
        ("eval('1', 2);", [("R005", "eval('1', 2)")]),
        ("eval();", [("R005", "eval()")]),
        ("SELECT 1 FROM x = t, x = u;", [("R013", "x = u")]),
        ("SELECT 1 FROM x = [1], x = [2];", [("R013", "x = [2]")]),
        ("SELECT 1 FROM x = t, x = (SELECT a FROM t);", [("R013", "x = (SELECT a FROM t)")]),
        ("SELECT 1 FROM f;", [("R003", "f")]),
        ("SELECT 1 FROM t.a;", [("R003", "t.a")]),
        ("SELECT 1 FROM mass;", [("R003", "mass")]),
        ("SELECT to(a, b) + 1 FROM t;", [("R014", "to(a, b)")]),
        ("SELECT a FROM t WHERE to(a, b);", [("R014", "to(a, b)")]),
        ("SELECT a FROM t AS list(a);", [("R001", "a")]),
        ("SELECT a FROM t LIMIT a;", [("R001", "a")]),
        ("SELECT to(a, b + 'x') FROM t;", [("R001", "b")]),
        ("SELECT a FROM t AS lists;", [("R006", "AS lists")]),
        ("fun(1);", [("R002", "fun")]),
        ("SELECT t.len() FROM t;", [("R002", "t.len")]),
        ("SELECT t.nothing(3) FROM t;", [("R002", "t.nothing")]),
        ("SELECT item(this, 0) FROM [[1]] AS list; slyce(1);", [("R002", "slyce")]),
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
        ("SELECT 1 FROM x = t, x = [2];", "give this one another name: x_2 = [2]"),
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
        ("R001", "one"), ("R005", "len()"), ("R003", "three"), ("R001", "t.four"), ("R002", "six"), ("R001",
        "t.eight"),
        ("R001", "nine"), ("R006", "AS ten"), ("R001", "eleven"),
    ]  # fmt: skip
    # `two` may be a column of the unknown source, so it is no error of its own.
    assert errors(ss, script) == expected
    shown = message(ss, script)
    assert shown.count("error[") == len(expected)
    assert [line.rsplit(":", 2)[1] for line in shown.splitlines() if "-->" in line] == list("122223334")


@pytest.mark.parametrize(
    ("script", "hints"),
    [
        ("SELECT t.len() FROM t;", ["write len(t)"]),
        ("SELECT t.max(3) FROM t;", ["write max(t, ...)"]),
        ("SELECT t.nothing() FROM t;", ["write nothing(t), with a function that is registered"]),
        ("x = [1]; x.append(2);", ["a list is not changed, a new one is made: x + [2]"]),
        ("SELECT a.upper() FROM t;", ["write upper(a), with a function that is registered",
                                      "session.function('upper', str.upper) registers Python's"]),
        ("math.sqrt(4);", ["'sqrt' is a function by itself: write sqrt(...)"]),
        ("math.sin(4);", ["session.function('sin', math.sin) registers Python's"]),
    ],
)  # fmt: skip
def test_methods_are_written_as_functions(ss: ss2sql.Session, script: str, hints: list[str]) -> None:
    with pytest.raises(ss2sql.ResolveError) as error:
        ss.run(script)
    assert list(error.value.hints) == hints


def test_python_functions_that_hints_name_can_be_registered(ss: ss2sql.Session) -> None:
    names = {"str": str, "math": math, "random": random}
    for name, path in OF_PYTHON.items():
        owner, function = path.split(".")
        ss.function(name, getattr(names[owner], function))
    assert ss.eval("upper('a') + trim(' b ') + str(floor(1.5));") == "Ab1"


@pytest.mark.parametrize(
    ("script", "hint"),
    [
        ("SELECT COUNT(a) FROM t;", "did you mean 'count'?"),
        ("avg([1]);", "write average([1])"),
        ("SELECT coalesce(a, 0) FROM t;", "write IF(a != None; a; 0)"),
        ("SELECT EXISTS (SELECT * FROM u) FROM t;", "write [] != (SELECT * FROM u)"),
        ("SELECT substr(a, 1, 2) FROM t;", "a part of a string is a[from:to], counted from 0"),
        ("SELECT concat(a, b) FROM t;", "strings are joined with +: a + b"),
        ("SELECT coalesce() FROM t;", "write IF(... != None; ...; ...)"),
        ("x = [1]; x();", "'x' is a variable: write it without parentheses"),
        ("SELECT a FROM t WHERE a == Ann;", "a text stands in quotes: 'Ann'"),
        ("SELECT a FROM t WHERE Ann IN [a];", "a text stands in quotes: 'Ann'"),
        ("print(hello);", "a text stands in quotes: 'hello'"),
        ("x = 5 -- five;", "-- does not start a comment"),
        ("SELECT max(a) FROM t;", "max(SELECT a FROM t AS list)"),
        ("SELECT a.first FROM t;", "'a' is a column: write a[\"key\"] to read a key of it"),
        ("SELECT a FROM 'people';", "a source in quotes is a text; write FROM people"),
        ("SELECT a FROM 'people.csv';", "a file is read in Python and attached"),
        ("x = [1]; x.a;", "write SELECT a FROM x AS list"),
        ("x = [1]; SELECT a FROM x.csv;", "'x' is a source without tables of its own: write FROM x"),
        ("v{3};", "store a value with v{5.0} = ..."),
        ("SELECT count() FROM t GROUP BY a;", "or count(*) for the rows of a group"),
        ("SELECT a FROM t AS p;", "to name a source write FROM p = ..."),
        ("SELECT a FROM t LIMIT this;", "LIMIT is read once, before there is an element"),
        ("SELECT to(a, this) FROM t;", "the name of a column is read once, before there is an element"),
        ("SELECT a FROM t START WITH n = 1 CONNECT BY MAXIMUM (this) n = 2;", "MAXIMUM is read once"),
    ],
)
def test_hints_for_habits_from_elsewhere(ss: ss2sql.Session, script: str, hint: str) -> None:
    assert hint in message(ss, script)


def test_a_text_is_not_offered_where_a_name_is_nearly_right(ss: ss2sql.Session) -> None:
    assert "quotes" not in message(ss, "word = 1; print(wrd);")


def test_lists_and_queries_in_from_need_no_name(ss: ss2sql.Session) -> None:
    assert ss.eval("SELECT 1 FROM [1, 2], [3, 4], (SELECT a FROM t), (SELECT a FROM t) AS list") == [1] * 16


def test_a_variable_that_start_with_lacks_is_one_error(ss: ss2sql.Session) -> None:
    assert errors(ss, "SELECT a, n FROM t CONNECT BY n = n + 1 STOP WITH n == 3;") == [("R001", "n")]


def test_a_function_and_a_column_of_two_sources_share_a_name(ss: ss2sql.Session) -> None:
    ss.attach("v", [{"len": 1}])
    ss.attach("w", [{"len": 2}])
    assert errors(ss, "SELECT len, v.len FROM v, w;") == [("R004", "len")]


def test_an_argument_is_given_twice(ss: ss2sql.Session) -> None:
    ss.function("f", lambda a, b=0: [a, b])
    assert ss.eval("SELECT this FROM f(1, b = 2) AS list;") == [1, 2]
    found = message(ss, "SELECT this FROM f(1, a = 2);")
    assert "'f' gets the argument 'a' twice" in found
    assert "keep one of them: argument 1 is 'a'" in found


def test_an_argument_that_is_none(ss: ss2sql.Session) -> None:
    ss.function("f", lambda first, second=0: [first, second])
    assert "= help: did you mean 'second'?" in message(ss, "SELECT this FROM f(1, secnd = 2);")
    assert "= help: known here: first, second" in message(ss, "SELECT this FROM f(1, depth = 2);")
    ss.function("g", lambda: [1])
    assert "= help: help('g') shows how it is called" in message(ss, "SELECT this FROM g(depth = 2);")


def test_numbers_of_arguments_in_words(ss: ss2sql.Session) -> None:
    assert "'round' takes 1 to 2 arguments, not 3" in message(ss, "round(1, 2, 3);")
    assert "'print' takes 1 or more arguments, not 0" in message(ss, "print();")
    assert "'len' takes 1 argument, not 2" in message(ss, "len(1, 2);")


@engines
def test_a_column_as_a_source(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("rooms", [{"doors": [1, 2]}, {"doors": []}, {"doors": [3]}])
    assert ss.run("SELECT d.this FROM r = rooms, d = r.doors AS list;", engine=engine).value == [1, 2, 3]
    assert ss.run("SELECT d.this FROM r = t, d = r.a AS list;", engine=engine).value == [1, 3]
    ss.attach("record", {"a": 1, "b": [2]})
    assert ss.run("SELECT a, b FROM record AS rows;", engine=engine).value == [(1, [2])]
