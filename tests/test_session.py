"""The session: what it opens, what it holds, how scripts are compiled and run in it, and how runs are ended."""

from __future__ import annotations

import sqlite3
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import apsw
import numpy as np
import pytest

import ss2sql

both = pytest.mark.parametrize("engine", ["database", "native"])
ENDLESS = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;"
PRODUCT = "SELECT a.this FROM a = range(2000), b = range(2000), c = range(2000) WHERE a.this + b.this + c.this < 0;"


@pytest.fixture
def ss():
    with ss2sql.connect() as session:
        yield session


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "staff.db"
    with sqlite3.connect(path) as connection:
        connection.executescript(
            "CREATE TABLE staff(id INTEGER PRIMARY KEY, boss INTEGER, name TEXT);"
            "INSERT INTO staff VALUES (1, NULL, 'Ada'), (2, 1, 'Bob'), (3, 1, 'Cy'), (4, 2, 'Di');"
            "CREATE VIEW chiefs AS SELECT name FROM staff WHERE boss IS NULL;"
        )
    connection.close()
    return path


def code_of(call: Any, *arguments: Any, **named: Any) -> str:
    with pytest.raises(ss2sql.Error) as caught:
        call(*arguments, **named)
    return caught.value.code


# --- opening and closing -------------------------------------------------------------------------------


def test_a_session_on_a_file_reads_its_tables_and_views(file: Path) -> None:
    with ss2sql.connect(file) as ss:
        assert ss.eval("SELECT name FROM staff WHERE boss == 1 AS list;") == ["Bob", "Cy"]
        assert ss.eval("SELECT name FROM chiefs AS value;") == "Ada"
    with ss2sql.connect(str(file), read_only=True) as ss:
        assert ss.eval("SELECT this FROM staff LIMIT 1 AS value;") == {"id": 1, "boss": None, "name": "Ada"}


def test_a_session_that_may_only_read_changes_nothing(file: Path) -> None:
    before = file.read_bytes()
    with ss2sql.connect(file, read_only=True) as ss:
        assert ss.eval("v{5.0} = 3; v;") == 3
        assert ss.eval("v{};") == [3]
    assert file.read_bytes() == before


@pytest.mark.parametrize("read_only", [False, True])
def test_what_is_no_database_is_refused(tmp_path: Path, read_only: bool) -> None:
    (tmp_path / "text").write_text("these are words, and no database" * 100)
    for path in (tmp_path / "text", tmp_path, tmp_path / "missing" / "file.db"):
        with pytest.raises(ss2sql.SessionError) as caught:
            ss2sql.connect(path, read_only=read_only)
        assert caught.value.code == "S002"
        assert str(path) in str(caught.value)


def test_a_file_that_does_not_exist_is_made_unless_only_read(tmp_path: Path) -> None:
    assert code_of(ss2sql.connect, tmp_path / "new.db", read_only=True) == "S002"
    with ss2sql.connect(tmp_path / "new.db") as ss:
        ss.eval("v{5.0} = 1;")
    assert (tmp_path / "new.db").exists()


def test_unknown_optimisations_are_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="did you mean 'memo'"):
        ss2sql.connect(disable=["memory"])


def test_a_closed_session_says_so(ss: ss2sql.Session) -> None:
    query = ss.compile("1 + 1;")
    ss.close()
    ss.close()
    for call in (
        lambda: ss.run("1;"),
        lambda: ss.eval("1;"),
        lambda: ss.compile("1;"),
        lambda: query.run(),
        lambda: ss.set("x", 1),
        lambda: ss.attach("x", [1]),
        lambda: ss.function("f", lambda x: x),
        lambda: ss.representation("form"),
    ):
        with pytest.raises(ss2sql.SessionError, match="closed") as caught:
            call()
        assert caught.value.code == "S001"
        assert "ss2sql.connect()" in caught.value.hints[0]


def test_the_end_of_the_with_block_closes() -> None:
    with ss2sql.connect() as ss:
        assert ss.eval("1;") == 1
    assert code_of(ss.run, "1;") == "S001"


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
def test_a_file_is_attached_by_its_path(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    ss.attach("firm", file)
    assert ss.run("SELECT name FROM firm.staff WHERE id > 2 AS list;", engine=engine).value == ["Cy", "Di"]
    script = "SELECT a.name, b.name FROM a = firm.staff, b = firm.staff WHERE a.id == b.boss AS rows;"
    assert ss.run(script, engine=engine).value == [("Ada", "Bob"), ("Ada", "Cy"), ("Bob", "Di")]
    assert ss.run("SELECT staff.name FROM staff LIMIT 1 AS value;", engine=engine).value == "Ada"


def test_attaching_under_the_same_name_replaces(ss: ss2sql.Session, file: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as connection:
        connection.executescript("CREATE TABLE staff(id, nick TEXT); INSERT INTO staff VALUES (9, 'Zed')")
    connection.close()
    ss.attach("firm", file)
    query = ss.compile("SELECT this FROM firm.staff LIMIT 1 AS value;")
    assert query.run().value["name"] == "Ada"
    ss.attach("firm", other)
    assert query.run().value == {"id": 9, "nick": "Zed"}
    ss.attach("firm", [1])
    assert ss.eval("SELECT this FROM firm AS list;") == [1]


def test_files_that_cannot_be_attached(ss: ss2sql.Session, file: Path, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no database" * 100)
    for name, path in (("a", tmp_path / "text"), ("a", tmp_path / "missing"), ("a", tmp_path), ("main", file)):
        assert code_of(ss.attach, name, path) == "S002"
        assert ss.eval("SELECT this FROM [1] AS list;") == [1]
    ss.attach("a", file)
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


# --- running -------------------------------------------------------------------------------------------


@both
def test_values_given_to_one_run_end_with_it(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("x", 1)
    assert ss.run("SELECT this + x FROM [0] AS list;", engine=engine, x=10).value == [10]
    assert ss.run("x = x + 1; x;", engine=engine, x=10).value == 11
    assert ss.get("x") == 1
    assert ss.run("SELECT this + x FROM [0] AS list;", engine=engine).value == [1]
    assert ss.variables() == {"x": 1}


def test_a_script_may_be_a_file(ss: ss2sql.Session, tmp_path: Path) -> None:
    path = tmp_path / "query.ss"
    path.write_text("# größer\nx = 3;\nSELECT this FROM [1, x]\nAS list;\n", encoding="utf-8")
    assert ss.run(path).value == [1, 3]
    path.write_text("SELECT this\nFROM nowhere;", encoding="utf-8")
    with pytest.raises(ss2sql.ResolveError, match=r"query\.ss:2:6"):
        ss.run(path)


def test_scripts_that_cannot_be_read(ss: ss2sql.Session, tmp_path: Path) -> None:
    (tmp_path / "binary.ss").write_bytes(b"\xff\xfe\x00")
    for script in (tmp_path / "missing.ss", tmp_path / "binary.ss", tmp_path, 7, None):
        assert code_of(ss.run, script) == "S002"
        assert code_of(ss.compile, script) == "S002"


def test_the_value_of_a_script_is_that_of_its_last_statement(ss: ss2sql.Session) -> None:
    assert ss.eval("1; 2; 3") == 3
    assert ss.eval("x = SELECT this FROM [1, 2] AS list;") == [1, 2]
    assert ss.eval("SELECT this FROM [1] AS list; y = 5;") == 5


def test_the_engine_can_be_chosen(ss: ss2sql.Session) -> None:
    flat, memorize = (
        "SELECT this FROM [1, 2];",
        "SELECT this FROM [1] START WITH n = 0 CONNECT BY MEMORIZE 2 n = n + 1;",
    )
    assert ss.run(flat).engine == "database"
    assert ss.run(flat, engine="native").engine == "native"
    assert ss.run(memorize).engine == "native"
    with pytest.raises(ss2sql.UnsupportedError, match="MEMORIZE") as caught:
        ss.run(memorize, engine="database")
    assert caught.value.code == "U001"
    query = ss.compile(flat, engine="native")
    assert query.run().engine == "native"
    assert query.run(engine="database").engine == "database"
    assert query.run().engine == "native"
    for call in (ss.run, ss.compile):
        with pytest.raises(ss2sql.SessionError, match="did you mean 'database'"):
            call(flat, engine="databas")
    assert code_of(query.run, engine="sqlite") == "S002"


# --- compiled scripts ----------------------------------------------------------------------------------


@both
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


@both
def test_a_source_may_be_a_parameter(ss: ss2sql.Session, engine: Any) -> None:
    query = ss.compile("SELECT name FROM people WHERE age > least AS list;")
    assert query.parameters == ("people",)  # the other names may be columns of it
    people = [{"name": "Ada", "age": 36}, {"name": "Bob", "age": 7}]
    assert query.run(people=people, least=10, engine=engine).value == ["Ada"]
    assert query.run(people={"name": ["Cy"], "age": [9]}, least=8, engine=engine).value == ["Cy"]
    with pytest.raises(ss2sql.ResolveError, match="unknown name 'least'"):
        query.run(people=people, engine=engine)
    assert code_of(query.run, least=8, engine=engine) == "R009"


def test_what_python_may_not_give(ss: ss2sql.Session) -> None:
    query = ss.compile("n + 1;")
    assert code_of(query.run, n=float("nan")) == "X004"
    assert query.run(n=1).value == 2


def test_compile_without_a_session() -> None:
    query = ss2sql.compile("SELECT this * factor FROM [1, 2] AS list;")
    assert query.parameters == ("factor",)
    assert query.run(factor=2.5).value == [2.5, 5.0]


@both
def test_a_compiled_query_gives_the_same_answer_every_time(ss: ss2sql.Session, engine: Any) -> None:
    @ss.function
    def grown(items):
        items.append(len(items))
        return items

    query = ss.compile("SELECT n, grown(n) FROM [1] START WITH n = [] CONNECT BY n = grown(n) STOP WITH len(n) == 3;")
    first = query.run(engine=engine)
    assert [len(path) for path in first.value] == [1, 2, 3]
    assert first.value[2][2] == {"n": [0, 1], "grown": [0, 1, 2]}
    for _ in range(2):
        again = query.run(engine=engine)
        assert again.value == first.value
        assert again.stats.generated == first.stats.generated


@both
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


@both
def test_a_query_is_compiled_again_when_values_are_of_other_kinds(ss: ss2sql.Session, engine: Any) -> None:
    items: list[Any] = [1, 2]
    ss.attach("items", items)
    query = ss.compile("SELECT this + this FROM items AS list;")
    for values, doubled in (
        ([3], [6]),
        ([1.5], [3.0]),
        (["a"], ["aa"]),
        ([[1]], [[1, 1]]),
        ([2**62], None),
        ([1], [2]),
    ):
        items[:] = values
        if doubled is None:
            assert code_of(query.run, engine=engine) == "X004"
        else:
            assert query.run(engine=engine).value == doubled


@both
def test_a_query_is_compiled_again_when_a_table_gets_other_values(file: Path, engine: Any) -> None:
    with ss2sql.connect(file) as ss:
        query = ss.compile("SELECT id FROM staff WHERE name + '!' == 'Bob!' AS list;")
        assert query.run(engine=engine).value == [2]
        with apsw.Connection(str(file)) as writer:
            writer.execute("UPDATE staff SET name = NULL WHERE id = 1")
        writer.close()
        assert code_of(query.run, engine=engine) == "X001"
        with apsw.Connection(str(file)) as writer:
            writer.execute("DROP TABLE staff; CREATE TABLE staff(id, name); INSERT INTO staff VALUES (7, 'Bob')")
        writer.close()
        assert query.run(engine=engine).value == [7]
        with apsw.Connection(str(file)) as writer:
            writer.execute("DROP TABLE staff")
        writer.close()
        assert code_of(query.run, engine=engine) == "R003"


@both
def test_a_query_is_compiled_again_when_a_function_is_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda x: x + 1)
    query = ss.compile("SELECT f(this) FROM [1, 2] AS list;")
    assert query.run(engine=engine).value == [2, 3]
    ss.function("f", lambda x: x * 10, volatility="volatile")
    assert query.run(engine=engine).value == [10, 20]
    ss.function("f", lambda x, y: x + y)
    assert code_of(query.run, engine=engine) == "R005"
    ss.function("f", lambda x: x)
    assert query.run(engine=engine).value == [1, 2]


def test_a_query_is_compiled_again_when_a_representation_is_replaced(ss: ss2sql.Session) -> None:
    ss.representation("form")(lambda table: len(table.rows))
    query = ss.compile("SELECT this FROM [1, 2] AS form;")
    assert query.run().value == 2
    ss.representation("Form")(lambda table: table.columns)
    assert query.run().value == ("this",)


# --- functions that run scripts ------------------------------------------------------------------------


@both
@pytest.mark.parametrize("inner", ["database", "native"])
def test_a_function_may_run_a_script_of_the_same_session(ss: ss2sql.Session, engine: Any, inner: Any) -> None:
    @ss.function(volatility="volatile")
    def neighbours(node):
        return ss.run("SELECT b FROM edges WHERE a == node AS list;", engine=inner, node=node).value

    ss.attach("edges", [{"a": 1, "b": 2}, {"a": 1, "b": 3}, {"a": 2, "b": 4}])
    result = ss.run("SELECT this, neighbours(this) FROM [1, 2, 4] AS rows;", engine=engine)
    assert result.value == [(1, [2, 3]), (2, [4]), (4, [])]
    assert result.stats.calls == {"neighbours": 3}


@both
def test_an_error_of_an_inner_script_leaves_both_usable(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("inner", lambda x: ss.run("SELECT 1 / this FROM [x];", engine=engine, x=x).value, volatility="volatile")
    script = "SELECT inner(this) FROM [1, 0, 2] AS list;"
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == "X002"
    assert caught.value.span is not None
    assert caught.value.span.source.text == "SELECT 1 / this FROM [x];"
    assert ss.run("SELECT inner(this) FROM [1] AS list;", engine=engine).value == [[{"1 / this": 1.0}]]


@both
def test_an_inner_run_ends_with_the_outer_one(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("inner", lambda x: ss.run(ENDLESS, engine=engine).value, volatility="volatile")
    started = time.monotonic()
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run("SELECT inner(this) FROM [1, 2];", engine=engine, timeout=0.1)
    assert time.monotonic() - started < 5
    assert caught.value.partial.columns == ("inner",)
    assert ss.eval("1 + 1;") == 2


# --- ending a run --------------------------------------------------------------------------------------


def elapsed(call: Any, kind: type[ss2sql.Error]) -> tuple[float, Any]:
    started = time.monotonic()
    with pytest.raises(kind) as caught:
        call()
    return time.monotonic() - started, caught.value


SLOW = {
    "search": ENDLESS,
    "breadth": "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + 1;",
    "search without results": "SELECT this FROM [1, 2] WHERE n < 0 START WITH n = 0 CONNECT BY n = n + 1;",
    "product": PRODUCT,
    "sorting": "SELECT a.this FROM a = range(2000), b = range(2000) ORDER BY b.this;",
    "groups": "SELECT a.this, sum(b.this) FROM a = range(3000), b = range(3000) GROUP BY a.this;",
    "partition": "SELECT a.this FROM a = range(2000), b = range(2000) GROUP BY b.this;",
    "python": "SELECT slow(this) FROM range(1000);",
    "python in a search": "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = slow(n) + 1;",
}


@both
@pytest.mark.parametrize("script", SLOW.values(), ids=SLOW)
def test_a_timeout_ends_every_kind_of_run(ss: ss2sql.Session, engine: Any, script: str) -> None:
    ss.function("slow", lambda x: (time.sleep(0.005), x)[1], volatility="immutable")
    seconds, error = elapsed(lambda: ss.run(script, engine=engine, timeout=0.1), ss2sql.Timeout)
    assert error.code == "T001"
    assert 0.1 <= seconds < 5
    assert error.partial.status == "timeout"
    assert error.partial.engine == engine
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


@both
def test_the_partial_result_has_what_was_found(ss: ss2sql.Session, engine: Any) -> None:
    _, error = elapsed(lambda: ss.run(ENDLESS, engine=engine, timeout=0.1), ss2sql.Timeout)
    partial = error.partial
    assert partial.value is None
    assert partial.columns == ("path", "step", "this")
    assert len(partial.paths) > 100
    assert partial.paths[:3] == [[(1,)], [(1,), (1,)], [(1,), (1,), (1,)]]  # depth first, a result at every step
    assert partial.stats.generated > 100
    script = "SELECT slow(this) FROM range(100);"
    ss.function("slow", lambda x: (time.sleep(0.01), x)[1], volatility="volatile")
    _, error = elapsed(lambda: ss.run(script, engine=engine, timeout=0.1), ss2sql.Timeout)
    assert list(error.partial)[:2] == [(0,), (1,)]
    assert error.partial.stats.calls["slow"] >= len(error.partial)


@both
def test_a_timeout_of_the_session_holds_for_every_run(engine: Any) -> None:
    with ss2sql.connect(timeout=0.05) as ss:
        assert elapsed(lambda: ss.run(ENDLESS, engine=engine), ss2sql.Timeout)[0] < 5
        query = ss.compile(ENDLESS, engine=engine)
        assert elapsed(query.run, ss2sql.Timeout)[0] < 5
        assert 0.1 < elapsed(lambda: query.run(timeout=0.15), ss2sql.Timeout)[0] < 5
        assert ss.run("1 + 1;").value == 2


@both
@pytest.mark.parametrize("script", [ENDLESS, PRODUCT])
def test_a_run_can_be_interrupted_from_another_thread(ss: ss2sql.Session, engine: Any, script: str) -> None:
    ss.interrupt()  # nothing runs, nothing happens
    timer = threading.Timer(0.1, ss.interrupt)
    timer.start()
    seconds, error = elapsed(lambda: ss.run(script, engine=engine, timeout=5), ss2sql.Cancelled)
    timer.join()
    assert error.code == "T002"
    assert seconds < 5
    assert error.partial.status == "cancelled"
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


@both
def test_ctrl_c_ends_a_run(ss: ss2sql.Session, engine: Any) -> None:
    def press(x):
        raise KeyboardInterrupt

    ss.function("press", press)
    with pytest.raises(ss2sql.Cancelled) as caught:
        ss.run("SELECT press(this) FROM [1];", engine=engine)
    assert caught.value.partial.status == "cancelled"
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


def test_a_run_that_ends_before_any_query_has_no_partial_result(ss: ss2sql.Session) -> None:
    ss.function("slow", lambda x: (time.sleep(0.02), x)[1], volatility="volatile")
    _, error = elapsed(lambda: ss.run("slow(1) + slow(2);", timeout=0.01), ss2sql.Timeout)
    assert error.partial is None


@both
def test_maximum_bounds_the_results_of_a_search(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run(ENDLESS, engine=engine, maximum=3)
    assert (len(result.paths), result.status) == (3, "maximum")
    assert result.value == ss.run(ENDLESS.replace("BY n", "BY MAXIMUM 3 n"), engine=engine).value
    assert len(ss.run(ENDLESS.replace("BY n", "BY MAXIMUM 2 n"), engine=engine, maximum=3).paths) == 2
    query = ss.compile("x = SELECT this FROM [1, 2, 3] AS list; " + ENDLESS)
    assert len(query.run(engine=engine, maximum=4).paths) == 4
    flat = ss.run("SELECT this FROM [1, 2, 3];", engine=engine, maximum=1)
    assert (len(flat), flat.status) == (3, "complete")
    for wrong in (0, -1, 1.5, True):
        assert code_of(ss.run, ENDLESS, engine=engine, maximum=wrong) == "S002"


@both
def test_max_rows_is_a_limit_that_must_not_be_passed(ss: ss2sql.Session, engine: Any) -> None:
    assert len(ss.run("SELECT this FROM [1, 2];", engine=engine, max_rows=2)) == 2
    assert len(ss.run("SELECT this FROM [1, 2, 3] LIMIT 2;", engine=engine, max_rows=2)) == 2
    for script in ("SELECT this FROM [1, 2, 3];", ENDLESS, "SELECT this FROM [3, 1, 2] ORDER BY this;"):
        with pytest.raises(ss2sql.ExecutionError, match="max_rows=2") as caught:
            ss.run(script, engine=engine, max_rows=2)
        assert caught.value.code == "X010"
        assert caught.value.span is not None
    assert len(ss.run("SELECT this FROM [];", engine=engine, max_rows=0)) == 0
    assert code_of(ss.run, "1;", max_rows=-1) == "S002"


# --- after an error ------------------------------------------------------------------------------------

ERRORS = {
    "SELECT this FROM": "P002",
    "SELECT x FROM [1] WHERE x = 1;": "P006",
    "": "P008",
    "SELECT nme FROM [1];": "R001",
    "SELECT f(1) FROM [1];": "R002",
    "SELECT this FROM nowhere;": "R003",
    "SELECT this FROM [1] AS form;": "R006",
    "SELECT len() FROM [1];": "R005",
    "SELECT this FROM [1] STOP WITH True;": "R012",
    "SELECT 1 / this FROM [1, 0];": "X002",
    "SELECT this[3] FROM [[1]];": "X003",
    "SELECT 1 < this FROM ['a'];": "X001",
    "SELECT this * 9223372036854775807 FROM [2];": "X004",
    "SELECT this FROM [1, 'a'] ORDER BY this;": "X001",
    "SELECT this FROM [1] LIMIT -1;": "X006",
    "SELECT this FROM [1] START WITH n = 1 CONNECT BY MAXIMUM (n) n = n;": "R001",
    "SELECT this FROM [{'a': 1}];": "P001",
    "eval('1 +');": "P002",
    "eval('1 + x');": "R001",
    "SELECT rows FROM (SELECT this FROM [1] AS form);": "R006",
    "SELECT [this] FROM [1] AS set; SELECT [print] FROM [1];": "R001",
    "int('x');": "X007",
    "x{5.0} = 1; x{'a'};": "X007",
    "SELECT this FROM [1] AS list(5);": "V001",
}


@pytest.mark.parametrize(("script", "code"), ERRORS.items())
@pytest.mark.parametrize("engine", ["auto", "native"])
def test_every_kind_of_error_leaves_a_usable_session(ss: ss2sql.Session, script: str, code: str, engine: Any) -> None:
    with pytest.raises(ss2sql.Error) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == code
    assert caught.value.span is not None
    assert ss.run("SELECT this FROM [1, 2] WHERE this > 1 AS list;", engine=engine).value == [2]
    assert ss.run("SELECT n FROM [1] START WITH n = 1 CONNECT BY n = 2 STOP WITH n == 2 AS list;").value == [[1]]


@both
def test_an_error_that_is_kept_does_not_lock_the_file(file: Path, engine: Any) -> None:
    with ss2sql.connect(file) as ss:
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run("SELECT id FROM staff;", engine=engine, max_rows=1)
        writer = apsw.Connection(str(file))  # the locks of two copies of SQLite in one process do not see each other
        writer.execute("DELETE FROM staff")
        writer.close()
        assert caught.value.code == "X010"
        assert ss.eval("SELECT id FROM staff AS list;") == []
