"""`fold`, `split` and `unnest`: what becomes of constants, of conditions, and of queries over known lists.

That the values stay the same is shown by sheets, which run with these rewrites and without.
"""

from __future__ import annotations

from typing import Any

import pytest
from golden import each_row

import ss2sql

SOURCES = "FROM x = [1, 2, 3], y = [1, 2, 3], t = ['a']"


def test_many_parts_are_not_too_deep_for_sqlite() -> None:
    parts = [f"x.this != {number} + y.this" for number in range(5, 1105)]
    for joined, expected in ((" AND ".join(parts), 9), (" OR ".join(f"NOT ({part})" for part in parts), 0)):
        result = ss2sql.connect().run(f"SELECT x.this {SOURCES} WHERE {joined} AS list", engine="database")
        assert len(result.value) == expected


@pytest.mark.parametrize("disable", [[], ["split"], ["unnest"]])
@pytest.mark.parametrize("where", ["NOT (a.this == 1)", "[] == (SELECT this FROM [a.this] WHERE this == 1 AS list)"])
def test_a_replaced_operator_keeps_its_meaning(disable: list[str], where: str) -> None:
    with ss2sql.connect(disable=disable) as ss:
        ss.function("ne", lambda a, b: True, volatility="immutable")
        assert ss.eval(f"SELECT a.this FROM a = [1, 2] WHERE {where} AS list") == [2]


# --- unnest --------------------------------------------------------------------------------------------


@each_row("rewrites/conditions", "written", "where")
def test_what_the_sql_asks(written: str, where: str) -> None:
    *before, condition = written.splitlines()
    lists = "a = [1, 2, 3], b = [1, 2, 3], c = [1, 2, 3]"
    script = f"{' '.join(before)} SELECT a.this FROM {lists} WHERE {condition} AS list;"
    with ss2sql.connect() as ss:
        assert ss.run(script, engine="database").sql.statements[-1].endswith(f"WHERE\n  {where}")
    with ss2sql.connect(disable=["unnest", "split"]) as ss:
        changed = any(sign in condition for sign in ("SELECT", "(", "] == [", "] IN ["))
        assert (where in str(ss.compile(script).sql)) != changed


@each_row("rewrites/failing", "expression", "code")
def test_what_fails_fails_as_without_and_when_it_runs(engine: Any, expression: str, code: str) -> None:
    messages = set()
    for disable in ([], ["fold"], ["split"], ["unnest"]):
        for script in ("SELECT {} FROM a = given AS list", "SELECT a.this FROM a = given WHERE {} AS list"):
            with ss2sql.connect(disable=disable) as ss:
                assert ss.eval(script.format(expression), given=[]) == []
                with pytest.raises(ss2sql.Error) as caught:
                    ss.run(script.format(expression), engine="auto" if engine == "database" else engine, given=[1])
            assert caught.value.span is not None
            assert caught.value.code == code
            messages.add((caught.value.message, caught.value.span.text))
    assert len(messages) == 1


def test_functions_are_not_run_before_the_run(ss: ss2sql.Session, capsys: pytest.CaptureFixture[str]) -> None:
    ss.function("shout", lambda x: print(x) or x, volatility="immutable")
    query = ss.compile("SELECT shout('a') FROM [1] AS list")
    assert "shout" in str(query.sql)
    assert capsys.readouterr().out == ""
    assert query.run().value == ["a"]
    assert capsys.readouterr().out == "a\n"


# --- lists in variables --------------------------------------------------------------------------------

WITHOUT = "SELECT a.this FROM a = [1, 2, 3] WHERE [] == (SELECT this FROM banned WHERE this < a.this AS list) AS list"


def test_a_constant_list_in_a_variable_is_known_before_the_run(ss: ss2sql.Session) -> None:
    assert "2 >= a.this" in str(ss.compile(f"banned = [2]; {WITHOUT}").sql)
    ss.attach("banned", [2])
    assert "2 >= a.this" in str(ss.compile(WITHOUT).sql)
    assert "collect(" in str(ss.compile(f"banned = sorted(banned); {WITHOUT}").sql)
    computed = ss.run(f"banned = [3]; banned = sorted([9] + banned); {WITHOUT}", engine="database")
    assert "3 >= a.this" in str(computed.sql)


CHANGES: list[tuple[list[Any], list[int]]] = [
    ([2], [1, 2]), ([2, 1], [1]), ([], [1, 2, 3]), ([1.0], [1]),
    (list(range(2000, 4000)), [1, 2, 3]),  # too long to be taken apart
]  # fmt: skip


def test_the_query_is_made_anew_when_the_list_has_changed(ss: ss2sql.Session, engine: Any) -> None:
    parameter = ss.compile(WITHOUT)
    assert parameter.parameters == ("banned",)
    banned: list[Any] = [2]
    ss.attach("banned", banned)
    query = ss.compile(WITHOUT)
    for values, expected in CHANGES:
        banned[:] = values
        assert query.run(engine=engine).value == expected
        assert parameter.run(engine=engine, banned=values).value == expected


def test_pairs_of_names_that_are_a_parameter_run_in_the_database(ss: ss2sql.Session) -> None:
    script = """SELECT a.this, b.this FROM a = [1, 2], b = [1, 2] WHERE [] == (SELECT this FROM pairs
    WHERE eval(this[0] + ".this;") == eval(this[1] + ".this;") AS list) AS list"""
    assert ss.run(script, engine="database", pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    query = ss.compile(script, engine="database")
    assert "no SQL" in str(query.sql)
    assert query.run(pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    assert query.run(pairs=[["a", "a"]]).value == []
    with pytest.raises(ss2sql.UnsupportedError, match="eval"):
        query.run(pairs=[["a", "c"]])
    with pytest.raises(ss2sql.ResolveError, match="no source named 'c'"):
        ss.run(script, pairs=[["a", "c"]])


def test_a_function_that_changes_the_list_before_the_query_is_noticed(ss: ss2sql.Session) -> None:
    @ss.function(volatility="volatile")
    def ban(x: int) -> int:
        ss.run(f"banned = [{x}];")
        return x

    assert ss.run(f"banned = [3]; ban(1); {WITHOUT}").value == [1]


def test_a_text_relies_on_the_types_of_its_variables(ss: ss2sql.Session) -> None:
    ss.set("n", 1)
    query = ss.compile("SELECT this FROM [1, 2, 3] WHERE this > eval('n') AS list")
    assert "eval" not in str(query.sql)
    for value, expected in ((1, [2, 3]), (2.5, [3]), (0, [1, 2, 3])):
        ss.set("n", value)
        assert query.run().value == expected
    ss.set("n", "x")
    with pytest.raises(ss2sql.ExecutionError):
        query.run()


# --- none ----------------------------------------------------------------------------------------------

PEOPLE = [{"id": 1, "age": 30, "name": "Ada"}, {"id": 2, "age": None, "name": None}, {"id": 3, "age": 50, "name": "Bo"}]


@pytest.mark.parametrize(
    ("clauses", "sql", "expected"),
    [
        ("p.id WHERE age != None AND age + 1 > 31", "p.age + 1 > 31", [3]),
        ("p.id WHERE NOT (age == None OR age > 40)", "AND NOT (p.age > 40)", [1]),
        ("p.id WHERE age == None OR age > 40", "OR p.age > 40", [2, 3]),
        ("p.id WHERE age == 30 AND age < 40", "AND p.age < 40", [1]),
        ("age - 1 WHERE age != None", "SELECT\n  p.age - 1", [29, 49]),
        ("IF(age == None; 0; age * 2)", "ELSE p.age * 2", [60, 0, 100]),
        ("IF(age != None; age * 2; 0)", "THEN p.age * 2 ELSE 0", [60, 0, 100]),
        ("p.id WHERE age == max(SELECT age FROM people WHERE age != None AS list)", "MAX(people.age)", [3]),
        ("p.id WHERE name != None AND name + '!' < 'B'", "p.name || '!' < 'B'", [1]),
    ],
)
def test_what_was_found_not_to_be_none_is_computed_by_sqlite(clauses: str, sql: str, expected: list[Any]) -> None:
    shown, _, where = clauses.partition(" WHERE ")
    script = f"SELECT {shown} FROM p = people{' WHERE ' + where if where else ''} AS list;"
    for disable in ([], ["none"]):
        with ss2sql.connect(disable=disable) as ss:
            ss.set("people", PEOPLE)
            text = str(ss.run(script, engine="database").sql)
            assert (sql in text) is (not disable), text
            for engine in ("database", "native"):
                assert ss.run(script, engine=engine).value == expected


def test_functions_of_python_wait_for_a_test_of_none() -> None:
    with ss2sql.connect() as ss:
        ss.set("people", PEOPLE)
        script = "SELECT id FROM people WHERE name != None AND len(replace(name, 'a', 'bb')) > 2 AS list;"
        assert ss.run(script, engine="database").value == [1]
        ss.function("half", lambda age: age / 2, volatility="immutable")
        assert ss.run("SELECT half(age) FROM people WHERE age != None AS list", engine="database").value == [15.0, 25.0]
