"""Compiled scripts: their parameters, and what makes them resolve or compile their script anew."""

from __future__ import annotations

import itertools
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from balls import BallWorld, Box
from random_values import label
from sessions import code_of, write

import ss2sql
from ss2sql.session import variables


def test_a_parameter_that_may_be_a_wrong_name_has_its_place_and_the_right_one(ss: ss2sql.Session) -> None:
    ss.set("people", [{"name": "Ada"}])
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.compile("limit = 1; SELECT name FROM people WHERE nmae != None;").run()
    assert (caught.value.code, caught.value.span.text) == ("R009", "nmae")
    assert caught.value.hints == ("did you mean 'name'?", "run(..., nmae=...)")


def test_unknown_names_of_a_compiled_script_are_its_parameters(ss: ss2sql.Session, engine: Any) -> None:
    query = ss.compile("SELECT this FROM [1, 2, 3, 4] WHERE this > least AND this < most AS list;")
    assert query.parameters == ("least", "most")
    assert query.run(least=1, most=4, engine=engine).value == [2, 3]
    assert query.run(least=2, most=2.5, engine=engine).value == []
    with pytest.raises(ss2sql.ResolveError) as caught:
        query.run(leats=1, engine=engine)
    assert caught.value.code == "R009"
    assert caught.value.message == "the script needs a value for least, most"
    assert caught.value.hints == ("run(..., least=..., most=...)", "'leats' is no parameter of the script")
    ss.set("most", 3)
    assert query.run(least=1, engine=engine).value == [2]


def test_parameters_are_given_by_name_or_as_a_mapping(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM [1, 2, 3] WHERE this > least AND this < timeout AS list;"
    values = {"least": 1, "timeout": 3}
    query = ss.compile(script)
    for run in (query.run, lambda *given, **named: ss.run(script, *given, **named)):
        assert run(values).value == run(parameters=values).value == run(parameters={"timeout": 3}, least=1).value == [2]
        with pytest.raises(ss2sql.Error, match="parameters are values by their names"):
            run(parameters=[1])
    assert ss.eval(script, parameters=values) == [2]


def test_a_source_may_be_a_parameter(ss: ss2sql.Session, engine: Any) -> None:
    query = ss.compile("SELECT name FROM people WHERE age > least AS list;")
    assert query.parameters == ("people",)  # the other names may be columns of it
    people = [{"name": "Ada", "age": 36}, {"name": "Bob", "age": 7}]
    assert query.run(people=people, least=10, engine=engine).value == ["Ada"]
    assert query.run(people={"name": ["Cy"], "age": [9]}, least=8, engine=engine).value == ["Cy"]
    for _ in range(2):  # before a good run with these columns, and after it
        with pytest.raises(ss2sql.ResolveError, match="unknown name 'least', so the script needs a value") as caught:
            query.run(people=people, engine=engine)
        assert (caught.value.code, caught.value.hints[0]) == ("R009", "run(..., least=...)")
        assert query.run(people=people, least=10, engine=engine).value == ["Ada"]
    assert query.run(people=[{"name": "Di", "age": 9, "least": 8}], engine=engine).value == ["Di"]
    assert code_of(query.run, least=8, engine=engine) == "R009"


def test_compile_without_a_session() -> None:
    query = ss2sql.compile("SELECT this * factor FROM [1, 2] AS list;")
    assert query.parameters == ("factor",)
    assert code_of(query.run, factor=float("nan")) == "X004"
    assert query.run(factor=2.5).value == [2.5, 5.0]


def test_variables_of_a_search_do_not_leak(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("n", "mine")
    script = "SELECT this FROM [1] START WITH n = 0, m = n CONNECT BY n = n + 1 STOP WITH n == 2;"
    ss.run(script, engine=engine)
    assert ss.variables() == {"n": "mine"}
    assert code_of(ss.run, script + " m;") == "R001"


def test_a_query_is_resolved_again_when_the_columns_of_a_list_change(ss: ss2sql.Session) -> None:
    rows: list[dict[str, Any]] = [{"a": 1}]
    ss.attach("rows", rows)
    every, some = ss.compile("SELECT * FROM rows;"), ss.compile("SELECT a FROM rows AS list;")
    assert (every.run().value, some.run().value) == ([{"a": 1}], [1])
    rows[:] = [{"b": 2, "a": 3}]
    assert (every.run().value, some.run().value) == ([{"b": 2, "a": 3}], [3])
    rows[:] = [{"b": 2}]
    assert every.run().value == [{"b": 2}]
    with pytest.raises(ss2sql.ResolveError, match="unknown name 'a'"):
        some.run()
    rows[:] = [{"a": "text"}]
    assert some.run().value == ["text"]


def test_a_query_is_compiled_again_when_values_are_of_other_kinds(ss: ss2sql.Session, engine: Any) -> None:
    items: list[Any] = [1, 2]
    ss.attach("items", items)
    query = ss.compile("SELECT this + this FROM items AS list;")
    for value, doubled in ((3, 6), (1.5, 3.0), ("a", "aa"), ([1], [1, 1]), (2**62, None), (1, 2)):
        items[:] = [value]
        if doubled is None:
            assert code_of(query.run, engine=engine) == "X004"
        else:
            assert query.run(engine=engine).value == [doubled]


def test_a_query_that_the_database_refused_is_compiled_again(ss: ss2sql.Session) -> None:
    """When the values that it could not group have become others, and when it is told what a parameter holds."""
    script = "SELECT v, count(*) FROM items GROUP BY v AS list;"
    items: list[Any] = [{"v": 1}, {"v": "a"}]
    parameter = ss.compile(script, engine="database")
    assert code_of(lambda: parameter.sql) == "U001"
    assert code_of(parameter.run, items=items) == "U001"
    assert parameter.run(items=[{"v": 3}]).value == [3, 1]
    ss.attach("items", items)
    query = ss.compile(script, engine="database")
    for _ in range(2):
        assert code_of(query.run) == "U001"
        items[1]["v"] = 1
        assert query.run().value == [1, 2]
        items[1]["v"] = "a"
    items[:] = [{"w": 1}]
    assert code_of(query.run) == "R009"
    refused = ss.compile("SELECT w, count(*) FROM items GROUP BY w AS list;", engine="database")
    items[:] = [{"w": 1}, {"w": "a"}]
    assert code_of(refused.run) == "U001"
    items[:] = [{"v": 1}]
    assert code_of(refused.run) == "R009"


@pytest.mark.parametrize("home", ["", "db."])
def test_a_query_is_compiled_again_when_a_table_becomes_another_one(staff: Path, engine: Any, home: str) -> None:
    with ss2sql.connect(None if home else staff) as ss:
        if home:
            ss.attach("db", staff)
        query = ss.compile(f"SELECT id FROM {home}staff WHERE name + '!' == 'Bob!' AS list;")
        assert query.run(engine=engine).value == [2]
        write(staff, "UPDATE staff SET name = NULL WHERE id = 1")
        assert code_of(query.run, engine=engine) == "X001"
        write(staff, "DROP TABLE staff")
        with pytest.raises(ss2sql.ResolveError, match=f"unknown source '{home}staff'"):
            query.run(engine=engine)
        write(staff, "CREATE TABLE staff(name, id); INSERT INTO staff VALUES ('Bob', 7)")
        assert query.run(engine=engine).value == [7]


def test_a_query_is_compiled_again_when_what_it_calls_is_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.representation("form")(lambda table: table.columns)
    ss.function("f", lambda x: x + 1)
    query = ss.compile("SELECT f(this) FROM [1, 2] AS form;")
    assert query.run(engine=engine).value == ("f",)
    ss.representation("Form")(lambda table: [row[0] for row in table.rows])
    assert query.run(engine=engine).value == [2, 3]
    ss.function("f", lambda x: x * 10, volatility="stable")
    assert query.run(engine=engine).value == [10, 20]
    ss.function("f", lambda x, y: x + y)
    assert code_of(query.run, engine=engine) == "R005"
    ss.function("f", lambda x: x)
    assert query.run(engine=engine).value == [1, 2]


def test_names_of_all_statements_are_resolved_before_the_first_one_runs(ss: ss2sql.Session, engine: Any) -> None:
    calls: list[int] = []
    ss.function("noted", lambda: calls.append(1) or 1, volatility="volatile")
    rows = [{"a": 1}]
    ss.attach("rows", rows)
    query = ss.compile("x = noted(); y = SELECT a FROM rows AS list; SELECT this + 1 FROM y AS list;")
    assert (query.run(engine=engine).value, calls) == ([2], [1])
    rows[:] = [{"b": 1}]
    assert code_of(query.run, engine=engine) == "R009"
    assert calls == [1]
    rows[:] = [{"a": 2.5}]
    assert (query.run(engine=engine).value, calls) == ([3.5], [1, 1])
    ss.function("noted", lambda x: x)
    assert code_of(query.run, engine=engine) == "R005"
    ss.function("noted", lambda: calls.append(2) or 2)
    ss.detach("rows")
    assert code_of(query.run, engine=engine) == "R003"
    assert (calls, ss.get("x")) == ([1, 1], 1)


def test_what_is_refused_later_is_refused_before_anything_runs(ss: ss2sql.Session, engine: Any) -> None:
    query = ss.compile("x = 1; SELECT name FROM people WHERE age > x AS list;")
    assert query.parameters == ("people",)
    assert code_of(query.run, people=[{"age": 2}], engine=engine) == "R009"
    assert ss.variables() == {}
    assert query.run(people=[{"age": 2, "name": "Ada"}], engine=engine).value == ["Ada"]
    items: list[Any] = [{"v": 1}]
    ss.attach("items", items)
    query = ss.compile("y = 1; SELECT v, count(*) FROM items GROUP BY v AS list;", engine="database")
    items.append({"v": "a"})
    assert code_of(query.run) == "U001"
    assert ss.variables() == {"x": 1}
    items.pop()
    assert query.run().value == [1, 1]


def test_what_the_statements_before_assign_does_not_make_a_script_outdated(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The variable has another type when the script begins than when the statement runs that reads it."""
    query = ss.compile("x = [[1]]; y = len(x); x = y; IF(y > 0; z = x; z = y); SELECT z + this FROM [x, 2] AS list;")
    assert query.run().value == [2, 3]
    resolved: list[Any] = []
    monkeypatch.setattr("ss2sql.session.host.resolve", lambda tree, catalog: resolved.append(tree))
    assert (query.run().value, resolved) == ([2, 3], [])


# --- parameters of which nothing is known before the query runs -----------------------------------------


ROWS = [{"a": 1, "b": "x", "c": 1.5}, {"a": 2, "b": "1", "c": 2.0}, {"a": 2**53 + 1, "b": "", "c": 0.1}]
VALUES = [
    1, 2, 1.0, 1.5, 2.5, 0.1, 2**53 + 1, 2.0**53, True, False, None, "x", "1", "", "\ud800", b"1",
    Decimal(1), Decimal("1.5"), Decimal("0.1"), Fraction(3, 2), [1], [], {"a": 1}, {}, object(),
]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=label)
def test_values_equal_what_python_says_and_objects_nothing(ss: ss2sql.Session, engine: Any, value: Any) -> None:
    ss.attach("rows", ROWS)
    ss.host.connection.execute("CREATE TABLE t(a INTEGER, b TEXT, c REAL)")
    ss.host.connection.executemany("INSERT INTO t VALUES(:a, :b, :c)", ROWS)
    for source, column in itertools.product(("rows", "t"), "abc"):
        is_object = isinstance(value, Decimal | Fraction)  # objects equal objects only
        equal = [row["a"] for row in ROWS if row[column] == value and not is_object]
        other = [row["a"] for row in ROWS if row["a"] not in equal]
        for condition, expected in ((f"{column} == n", equal), (f"n == {column}", equal), (f"{column} != n", other)):
            query = ss.compile(f"SELECT a FROM {source} WHERE {condition} AS list;")
            assert query.run(engine=engine, n=value).value == expected, (source, condition)


def test_sqlite_compares_them_by_itself(ss: ss2sql.Session) -> None:
    ss.attach("things", ROWS)
    text = ss.compile("SELECT a FROM things WHERE a == n AND b != n;").sql
    assert "things.a IS :n AND things.b IS NOT :n_2" in " ".join(text.split())


def test_a_world_is_asked_for_the_one_that_is_wanted(ss: ss2sql.Session, engine: Any) -> None:
    box = Box.row(50)
    ss.attach("space", BallWorld(box))
    query = ss.compile("SELECT name FROM space WHERE id == n AS list;")
    assert query.run(engine=engine, n=7).value == ["ball7"]
    assert box.calls["given"] == 1
    assert query.run(engine=engine, n="7").value == []
    assert query.run(engine=engine, n=Decimal(8)).value == []


def test_the_value_of_a_variable_is_looked_at_once(
    ss: ss2sql.Session, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at: list[Any] = []
    type_of = variables.type_of
    monkeypatch.setattr(variables, "type_of", lambda value: (looked_at.append(value), type_of(value))[1])
    ss.set("rows", [{"a": 1}, {"a": 2}])
    for least in range(3):  # three texts, of which each is compiled
        assert ss.run(f"SELECT a FROM rows WHERE a > {least} AS list;", engine=engine).value == [1, 2][least:]
    assert len(looked_at) == 1
    ss.set("rows", [{"a": "x"}])
    assert ss.run("SELECT a + 'y' AS a FROM rows AS list;", engine=engine).value == ["xy"]
    assert len(looked_at) == 2
    query = ss.compile("list = [3, 4]; SELECT this FROM list WHERE this > 3 AS list;", engine=engine)
    assert query.run().value == [4]
    looked_at.clear()
    assert query.run().value == [4]  # the script assigns the same list
    assert not looked_at
