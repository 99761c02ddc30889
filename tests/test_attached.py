"""What is attached to a session: values of Python, and SQLite files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sessions import code_of, write

import ss2sql
from ss2sql.frontend.resolve.from_clause import READ_IN_PYTHON

# --- values --------------------------------------------------------------------------------------------


@dataclass
class Body:
    name: str
    mass: float


def test_a_list_is_read_when_the_script_runs_and_kept_until_it_ends(ss: ss2sql.Session, engine: Any) -> None:
    numbers: list[Any] = [3, 1]
    ss.attach("numbers", numbers)
    query = ss.compile("SELECT this FROM numbers ORDER BY this AS list;")
    assert query.run(engine=engine).value == [1, 3]
    numbers.append(2)
    assert query.run(engine=engine).value == [1, 2, 3]
    assert ss.run("SELECT this FROM numbers AS list;", engine=engine).value == [3, 1, 2]
    ss.function("log", lambda x: numbers.append(str(x)), volatility="stable")
    script = "SELECT log(this) FROM numbers; SELECT this + 1 FROM numbers AS list;"
    assert ss.run(script, engine=engine).value == [4, 2, 3]
    assert numbers == [3, 1, 2, "3", "1", "2"]
    del numbers[:]
    assert query.run(engine=engine).value == []


@pytest.mark.parametrize(
    "script", ["x = xs", "x = [xs]", "x = xs[0]", "x = (SELECT this FROM xs AS list)", "x = (SELECT this FROM xs)"]
)
@pytest.mark.parametrize("given", [False, True], ids=["attached", "given to the run"])
@pytest.mark.parametrize("thing", [2.5, object()], ids=["a number", "an object"])
def test_a_variable_stays_as_assigned(ss: ss2sql.Session, engine: Any, script: str, given: bool, thing: Any) -> None:
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


@pytest.mark.parametrize(
    "script",
    ["SELECT this FROM xs", "SELECT this FROM xs START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1",
     "SELECT this, count(*) FROM xs GROUP BY this HAVING True", "SELECT 1 FROM xs GROUP BY this",
     "x = (SELECT this FROM xs)", "seen{60.0} = xs; seen"],
)  # fmt: skip
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
        remembered = ss.eval("seen") if "seen" in script else None
        results.append((str(result.value), list(result), remembered))
        assert numbers == ([[1, 3], [4]] if change else [[1], [2]])
    assert results[0] == results[1]


def test_fields_of_objects_are_columns_as_they_are_now(ss: ss2sql.Session, engine: Any) -> None:
    bodies = [Body("ball", 1.5), Body("box", 80.0)]
    ss.attach("bodies", bodies)
    assert ss.run("SELECT name FROM bodies WHERE mass > 50 AS list;", engine=engine).value == ["box"]
    (found,) = ss.run("SELECT this FROM bodies WHERE mass > 50 AS list;", engine=engine).value
    assert found is bodies[1]
    bodies[0].mass = 60.0
    assert ss.run("SELECT name FROM bodies WHERE mass > 50 AS list;", engine=engine).value == ["ball", "box"]


@pytest.mark.parametrize(
    ("value", "elements"),
    [(7, [7]), ("text", ["text"]), (None, [None]), (True, [True]), ((1, 2), [1, 2]), (np.array([1.5]), [1.5]), ([], []),
     ({"a": [1], "b": [2.0]}, [{"a": 1, "b": 2.0}])],
)  # fmt: skip
def test_the_elements_of_a_value(ss: ss2sql.Session, engine: Any, value: Any, elements: list[Any]) -> None:
    """A dict of columns is a table; what is no list is a list of one."""
    ss.attach("x", value)
    assert repr(ss.run("SELECT this FROM x AS list;", engine=engine).value) == repr(elements)


# --- files ---------------------------------------------------------------------------------------------

SCRIPT = """
    CREATE TABLE t(x, y); INSERT INTO t VALUES (1, 'a'), (2, 'b');
    CREATE VIEW doubled AS SELECT x * 2 AS d FROM t;
    CREATE TABLE keyed(k TEXT PRIMARY KEY, n) WITHOUT ROWID; INSERT INTO keyed VALUES ('b', 1), ('a', 2);
    CREATE TABLE "odd name"("b c", d); INSERT INTO "odd name" VALUES (5, 6);
    CREATE TABLE "select"(z); INSERT INTO "select" VALUES (9);
    CREATE VIEW broken AS SELECT nope FROM nowhere;
"""
ROWS = {
    "SELECT * FROM db.t;": [{"x": 1, "y": "a"}, {"x": 2, "y": "b"}],
    "SELECT x FROM db.t WHERE y == 'b' AS list;": [2],
    "SELECT a.x, b.x FROM a = db.t, b = db.t WHERE a.x < b.x AS rows;": [(1, 2)],
    "SELECT d FROM db.doubled AS list;": [2, 4],
    "SELECT doubled.d FROM doubled AS list;": [2, 4],
    "SELECT k, n FROM db.keyed AS rows;": [("a", 2), ("b", 1)],  # by its key, as it has no rowid
    'SELECT d, this["b c"] FROM db["odd name"] AS list;': [6, 5],
    'SELECT s.z FROM s = db["select"], db["t"] AS list;': [9, 9],
}


@pytest.fixture
def file(file: Path) -> Path:
    write(file, SCRIPT)
    return file


@pytest.fixture
def db(ss: ss2sql.Session, file: Path) -> ss2sql.Session:
    ss.attach("db", file)
    return ss


def test_tables_and_views(db: ss2sql.Session, engine: Any) -> None:
    assert {script: db.run(script, engine=engine).value for script in ROWS} == ROWS
    with pytest.raises(ss2sql.ResolveError, match=r"unknown source 'db\.nothing'"):
        db.run('SELECT this FROM db["nothing"];', engine=engine)
    assert code_of(db.describe, "broken") == "X009"


def test_the_text_of_a_path_and_a_file_that_may_only_be_read(ss: ss2sql.Session, file: Path) -> None:
    ss.attach("text", str(file))
    assert ss.eval("SELECT x FROM text.t AS list;") == [1, 2]
    ss.attach("word", "data")
    assert ss.eval("SELECT this FROM word AS list;") == ["data"]
    file.chmod(0o444)
    ss.attach("db", file)
    assert ss.eval("SELECT x FROM db.t AS list;") == [1, 2]


def test_a_file_that_cannot_be_attached_leaves_the_one_before(db: ss2sql.Session, tmp_path: Path) -> None:
    text = tmp_path / "text.db"
    text.write_text("no database at all, only some words")
    for source, words in (
        (tmp_path / "missing.db", "there is no file"),
        (str(tmp_path / "missing.sqlite"), "there is no file"),
        (tmp_path, "is a folder"),
        (text, "is not a SQLite file"),
    ):
        with pytest.raises(ss2sql.Error, match=f"S002.*{words}"):
            db.attach("db", source)
    assert not (tmp_path / "missing.db").exists()
    assert db.eval("SELECT x FROM db.t AS list;") == [1, 2]


@pytest.mark.parametrize("name", ["main", "Temp"])
def test_names_of_the_session(ss: ss2sql.Session, file: Path, name: str) -> None:
    with pytest.raises(ss2sql.Error, match=r"S002.*own database"):
        ss.attach(name, file)


def test_a_name_has_one_meaning(db: ss2sql.Session, file: Path, tmp_path: Path) -> None:
    query = db.compile("SELECT this FROM db.t LIMIT 1 AS value;")
    assert query.run().value == {"x": 1, "y": "a"}
    write(tmp_path / "other.db", "CREATE TABLE t(id, nick TEXT); INSERT INTO t VALUES (9, 'Zed')")
    db.attach("db", tmp_path / "other.db")
    assert query.run().value == {"id": 9, "nick": "Zed"}
    db.attach("db", [1])
    assert db.eval("SELECT this FROM db AS list;") == [1]
    assert code_of(query.run) == "R003"
    db.attach("db", file)
    with pytest.raises(ss2sql.ResolveError, match="unknown source 'db'") as caught:
        db.eval("SELECT this FROM db;")
    assert "FROM db.table" in str(caught.value)
    db.detach("db")
    with pytest.raises(ss2sql.ResolveError, match=r"unknown source 'db\.t'"):
        query.run()
    with pytest.raises(KeyError):
        db.detach("db")


# --- what is no list of one ----------------------------------------------------------------------------


@pytest.mark.parametrize("iterator", [lambda: (n for n in range(3)), lambda: iter([0, 1, 2]), lambda: map(int, "012")])
def test_an_iterator_is_read_once_into_a_list(ss: ss2sql.Session, engine: Any, iterator: Any) -> None:
    ss.attach("g", iterator())
    ss.set("v", iterator())
    for _ in range(2):
        assert ss.run("SELECT this FROM g AS list", engine=engine).value == [0, 1, 2]
        assert ss.run("SELECT this FROM v AS list", engine=engine).value == [0, 1, 2]
    assert ss.run("SELECT this FROM p AS list", engine=engine, p=iterator()).value == [0, 1, 2]


@pytest.mark.parametrize("ending", [*READ_IN_PYTHON, ".CSV"])
def test_a_path_that_cannot_be_attached_is_no_value(ss: ss2sql.Session, ending: str) -> None:
    for path in (f"data{ending}", Path(f"data{ending}")):
        assert code_of(ss.attach, "t", path) == "S002"
    assert code_of(ss.run, f"SELECT * FROM 'data{ending}'") == "R003"
    assert ss.eval("SELECT this FROM t AS list", t=f"data{ending}") == [f"data{ending}"]  # a value of the script


def test_a_client_of_pybullet_by_its_number_and_by_the_module(ss: ss2sql.Session, engine: Any) -> None:
    pybullet = pytest.importorskip("pybullet")
    ss.attach("seven", 7)
    for beyond in (-1, 2**31, 2**62):
        ss.attach("number", beyond)
        assert ss.eval("SELECT this FROM number AS list") == [beyond]
    number = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.createMultiBody(2.5, physicsClientId=number)
        ss.attach("space", number)
        assert ss.run("SELECT mass FROM space AS list", engine=engine).value == [2.5]
        assert ss.run("SELECT this FROM seven AS list", engine=engine).value == [7]
        if number == 0:
            ss.attach("space", pybullet)
            assert ss.run("SELECT mass FROM space AS list", engine=engine).value == [2.5]
    finally:
        pybullet.disconnect(number)


def test_a_world_in_a_variable_is_no_source(ss: ss2sql.Session, engine: Any, client: Any) -> None:
    ss.set("space", client)
    assert code_of(ss.run, "SELECT this FROM space AS list", engine=engine) == "X005"
    assert code_of(ss.run, "SELECT this FROM given AS list", engine=engine, given=client) == "X005"
    assert ss.run("SELECT this FROM [space] AS list", engine=engine).value == [client]
