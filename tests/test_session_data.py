"""What a session holds: what Python attaches to it, and its variables."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sessions import both, code_of

import ss2sql

# --- what is attached ----------------------------------------------------------------------------------


@dataclass
class Body:
    name: str
    mass: float


@both
def test_an_attached_list_is_read_when_the_script_runs(ss: ss2sql.Session, engine: Any) -> None:
    numbers = [3, 1]
    ss.attach("numbers", numbers)
    query = ss.compile("SELECT this FROM numbers ORDER BY this AS list;")
    assert query.run(engine=engine).value == [1, 3]
    numbers.append(2)
    assert query.run(engine=engine).value == [1, 2, 3]
    assert ss.run("SELECT this FROM numbers AS list;", engine=engine).value == [3, 1, 2]
    del numbers[:]
    assert query.run(engine=engine).value == []


@both
def test_a_run_keeps_what_it_has_read(ss: ss2sql.Session, engine: Any) -> None:
    numbers: list[Any] = [1, 2]
    ss.attach("numbers", numbers)
    ss.function("log", lambda x: numbers.append(str(x)), volatility="volatile")
    script = "SELECT log(this) FROM numbers; SELECT this + 1 FROM numbers AS list;"
    assert ss.run(script, engine=engine).value == [2, 3]
    assert ss.run("SELECT this FROM numbers AS list;", engine=engine).value == numbers == [1, 2, "1", "2"]


@both
@pytest.mark.parametrize(
    "script", ["x = xs", "x = [xs]", "x = xs[0]", "x = (SELECT this FROM xs AS list)", "x = (SELECT this FROM xs)"]
)
@pytest.mark.parametrize("given", [False, True], ids=["attached", "given to the run"])
@pytest.mark.parametrize("thing", [2.5, object()], ids=["a number", "an object"])
def test_a_variable_stays_as_it_was_assigned(
    ss: ss2sql.Session, engine: Any, script: str, given: bool, thing: Any
) -> None:
    """Whatever becomes of the list that it was read from; an object in it is the same one."""
    numbers: list[Any] = [[1], [2, thing]]
    if given:
        result = ss.run(script, engine=engine, xs=numbers)
    else:
        ss.attach("xs", numbers)
        result = ss.run(script, engine=engine)
    before, kept = str(result.value), ss.compile("SELECT this FROM x AS rows", engine="native")
    first = str(kept.run().value)
    numbers[0].append(3)
    numbers.append([4])
    assert str(ss.get("x")) == str(result.value) == before
    assert str(kept.run().value) == first


def test_what_a_variable_remembers_stays_as_it_was(ss: ss2sql.Session) -> None:
    numbers = [[1]]
    ss.attach("xs", numbers)
    ss.run("seen{60.0} = xs")
    numbers[0].append(2)
    assert ss.eval("seen") == [[1]]


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this FROM xs",
        "SELECT this FROM xs START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1",
        "SELECT this, count(*) FROM xs GROUP BY this HAVING True",
        "SELECT 1 FROM xs GROUP BY this",
        "x = (SELECT this FROM xs)",
    ],
)
def test_a_result_stays_as_it_was(ss: ss2sql.Session, script: str) -> None:
    """Its value and its rows, whenever they are read, and whatever becomes of what it was read from."""
    results = []
    for change in (False, True):
        numbers = [[1], [2]]
        ss.attach("xs", numbers)
        result = ss.run(script, engine="native")
        if change:
            numbers[0].append(3)
            numbers[1][0] = 4
        results.append((str(result.value), list(result)))
        assert numbers == ([[1, 3], [4]] if change else [[1], [2]])
    assert results[0] == results[1]


@both
def test_a_dict_of_columns_is_a_table(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("cities", {"name": ["Ulm", "Bonn"], "size": [1, 2]})
    assert ss.run("SELECT name FROM cities WHERE size > 1 AS list;", engine=engine).value == ["Bonn"]
    assert ss.run("SELECT * FROM cities;", engine=engine).value == [
        {"name": "Ulm", "size": 1},
        {"name": "Bonn", "size": 2},
    ]
    assert ss.run("SELECT this FROM cities AS value;", engine=engine).value == {"name": "Ulm", "size": 1}


@both
def test_columns_of_unequal_length_are_an_error(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("odd", {"a": [1, 2], "b": [1]})
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("SELECT a FROM odd;", engine=engine)
    assert caught.value.code == "X005"
    assert caught.value.span is not None
    assert ss.eval("1 + 1;") == 2


@both
def test_fields_of_dataclass_objects_are_columns(ss: ss2sql.Session, engine: Any) -> None:
    bodies = [Body("ball", 1.5), Body("box", 80.0)]
    ss.attach("bodies", bodies)
    assert ss.run("SELECT name FROM bodies WHERE mass > 50 AS list;", engine=engine).value == ["box"]
    (found,) = ss.run("SELECT this FROM bodies WHERE mass > 50 AS list;", engine=engine).value
    assert found is bodies[1]
    bodies[0].mass = 60.0
    assert ss.run("SELECT name FROM bodies WHERE mass > 50 AS list;", engine=engine).value == ["ball", "box"]


@both
@pytest.mark.parametrize(
    ("value", "elements"),
    [
        (7, [7]),
        ("text", ["text"]),
        (None, [None]),
        (True, [True]),
        ((1, 2), [1, 2]),
        (np.array([1.5]), [1.5]),
        ([], []),
    ],
)
def test_any_other_value_is_a_list_of_one(ss: ss2sql.Session, engine: Any, value: Any, elements: list[Any]) -> None:
    ss.attach("x", value)
    found = ss.run("SELECT this FROM x AS list;", engine=engine).value
    assert found == elements
    assert list(map(type, found)) == list(map(type, elements))


@both
def test_a_file_is_attached_by_its_path(ss: ss2sql.Session, staff: Path, engine: Any) -> None:
    ss.attach("firm", staff)
    assert ss.run("SELECT name FROM firm.staff WHERE id > 2 AS list;", engine=engine).value == ["Cy", "Di"]
    script = "SELECT a.name, b.name FROM a = firm.staff, b = firm.staff WHERE a.id == b.boss AS rows;"
    assert ss.run(script, engine=engine).value == [("Ada", "Bob"), ("Ada", "Cy"), ("Bob", "Di")]
    assert ss.run("SELECT staff.name FROM staff LIMIT 1 AS value;", engine=engine).value == "Ada"


def test_attaching_under_the_same_name_replaces(ss: ss2sql.Session, staff: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.db"
    with closing(sqlite3.connect(other)) as connection, connection:
        connection.executescript("CREATE TABLE staff(id, nick TEXT); INSERT INTO staff VALUES (9, 'Zed')")
    connection.close()
    ss.attach("firm", staff)
    query = ss.compile("SELECT this FROM firm.staff LIMIT 1 AS value;")
    assert query.run().value["name"] == "Ada"
    ss.attach("firm", other)
    assert query.run().value == {"id": 9, "nick": "Zed"}
    ss.attach("firm", [1])
    assert ss.eval("SELECT this FROM firm AS list;") == [1]


def test_files_that_cannot_be_attached(ss: ss2sql.Session, staff: Path, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no database" * 100)
    for name, path in (("a", tmp_path / "text"), ("a", tmp_path / "missing"), ("a", tmp_path), ("main", staff)):
        assert code_of(ss.attach, name, path) == "S002"
        assert ss.eval("SELECT this FROM [1] AS list;") == [1]
    ss.attach("a", staff)
    assert ss.eval("SELECT count(*) FROM a.staff GROUP BY 1 AS value;") == 4


@pytest.mark.parametrize("name", ["", "1x", "a b", "x;", "select", "From", "THIS", "none"])
def test_names_that_no_script_can_use_are_refused(ss: ss2sql.Session, name: str) -> None:
    for call in (ss.set, ss.attach):
        assert code_of(call, name, 1) == "S002"
    assert code_of(ss.function, name, lambda x: x) == "S002"
    assert code_of(ss.representation, name) == "S002"


@pytest.mark.parametrize("name", ["start", "value", "list", "level", "größe", "_x", "group"])
def test_words_that_are_names_elsewhere_are_names_here(ss: ss2sql.Session, name: str) -> None:
    ss.set(name, 5)
    assert ss.eval(f"{name} + 1;") == 6


# --- variables -----------------------------------------------------------------------------------------


def test_variables_are_copies(ss: ss2sql.Session) -> None:
    given = [[1], 2.0]
    ss.set("x", given)
    given[0].append(9)
    assert ss.get("x") == [[1], 2.0]
    ss.get("x")[0].append(9)
    ss.variables()["x"][0].append(9)
    assert ss.eval("x;") == [[1], 2.0]
    ss.eval("x;")[0].append(9)
    assert ss.eval("x;") == [[1], 2.0]


def test_variables_of_scripts_are_those_of_python(ss: ss2sql.Session) -> None:
    ss.eval("b = 2; a = [b, b];")
    assert ss.variables() == {"a": [2, 2], "b": 2}
    assert list(ss.variables()) == ["a", "b"]
    assert ss.get("a") == [2, 2]
    with pytest.raises(KeyError):
        ss.get("c")
    assert ss.eval("clear(); var();") == {}
    assert ss.variables() == {}


def test_values_are_exact(ss: ss2sql.Session) -> None:
    ss.set("x", [1, 1.0, True, None, "s", -0.0, {"k": [1.5]}])
    assert repr(ss.get("x")) == "[1, 1.0, True, None, 's', -0.0, {'k': [1.5]}]"


def test_numpy_and_tuples_become_plain_values(ss: ss2sql.Session) -> None:
    ss.set("x", [np.float64(1.5), np.arange(3), (1, np.int64(2))])
    found = ss.get("x")
    assert found == [1.5, [0, 1, 2], [1, 2]]
    assert [type(found[0]), type(found[1][0]), type(found[2][1])] == [float, int, int]
    ss.set("y", {"a": np.arange(2)})
    assert ss.get("y") == {"a": [0, 1]}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 2**63, 1j, [float("nan")], np.array([np.nan])])
def test_what_is_no_value_is_refused_by_name(ss: ss2sql.Session, value: Any) -> None:
    with pytest.raises(ss2sql.ExecutionError, match="the variable 'x'") as caught:
        ss.set("x", value)
    assert caught.value.code == "X004"
    ss.attach("x", value)
    assert code_of(ss.run, "SELECT this FROM x;") == "X004"
    assert code_of(ss.run, "x;", x=value) == "X004"
    assert ss.eval("1 + 1;") == 2


def test_an_object_that_cannot_be_hashed_comes_back_from_a_variable(ss: ss2sql.Session) -> None:
    class Sensor:
        __hash__ = None  # type: ignore[assignment]

    sensor = Sensor()
    ss.set("sensor", sensor)
    assert ss.get("sensor") is sensor
    assert ss.eval("sensor;") is sensor
    assert ss.eval("SELECT this FROM sensor AS value;") is sensor
    ss.attach("others", [sensor])
    assert ss.get("others") == [sensor]
    assert ss.eval("SELECT this FROM others AS value;") is sensor
