"""The session: what it opens, how it runs scripts, also from within functions, and what errors leave of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sessions import both, code_of, write

import ss2sql

# --- opening and closing -------------------------------------------------------------------------------


def test_a_session_on_a_file_reads_its_tables_and_views(staff: Path) -> None:
    with ss2sql.connect(staff) as ss:
        assert ss.eval("SELECT name FROM staff WHERE boss == 1 AS list;") == ["Bob", "Cy"]
        assert ss.eval("SELECT name FROM chiefs AS value;") == "Ada"
    with ss2sql.connect(str(staff), read_only=True) as ss:
        assert ss.eval("SELECT this FROM staff LIMIT 1 AS value;") == {"id": 1, "boss": None, "name": "Ada"}


def test_a_session_that_may_only_read_changes_nothing(staff: Path) -> None:
    before = staff.read_bytes()
    with ss2sql.connect(staff, read_only=True) as ss:
        assert ss.eval("v{5.0} = 3; v;") == 3
        assert ss.eval("v{};") == [3]
    assert staff.read_bytes() == before


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
def test_an_error_that_is_kept_does_not_lock_the_file(staff: Path, engine: Any) -> None:
    with ss2sql.connect(staff) as ss:
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run("SELECT id FROM staff;", engine=engine, max_rows=1)
        write(staff, "DELETE FROM staff")
        assert caught.value.code == "X010"
        assert ss.eval("SELECT id FROM staff AS list;") == []
