"""SQLite files that are attached to a session: `session.attach("db", path)`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sessions import both, write

import ss2sql

SCRIPT = """
    CREATE TABLE t(x, y); INSERT INTO t VALUES (1, 'a'), (2, 'b');
    CREATE VIEW doubled AS SELECT x * 2 AS d FROM t;
    CREATE TABLE keyed(k TEXT PRIMARY KEY, n) WITHOUT ROWID; INSERT INTO keyed VALUES ('b', 1), ('a', 2);
    CREATE TABLE "odd name"("b c", d); INSERT INTO "odd name" VALUES (5, 6);
    CREATE TABLE "select"(z); INSERT INTO "select" VALUES (9);
    CREATE VIEW broken AS SELECT nope FROM nowhere;
"""


@pytest.fixture
def file(file: Path) -> Path:
    write(file, SCRIPT)
    return file


@pytest.fixture
def ss(ss: ss2sql.Session, file: Path) -> ss2sql.Session:
    ss.attach("db", file)
    return ss


@both
def test_tables_and_views(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT * FROM db.t;", engine=engine).value == [{"x": 1, "y": "a"}, {"x": 2, "y": "b"}]
    assert ss.run("SELECT d FROM db.doubled AS list;", engine=engine).value == [2, 4]
    assert ss.run("SELECT d FROM doubled AS list;", engine=engine).value == [2, 4]


@both
def test_a_table_without_rowid_is_walked_by_its_key(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT k, n FROM db.keyed AS rows;", engine=engine).value == [("a", 2), ("b", 1)]


@both
def test_tables_whose_names_are_no_names(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run('SELECT d, this["b c"] FROM db["odd name"] AS list;', engine=engine).value == [6, 5]
    assert ss.run('SELECT s.z FROM s = db["select"], db["t"] AS list;', engine=engine).value == [9, 9]
    with pytest.raises(ss2sql.ResolveError, match=r"unknown source 'db\.nothing'"):
        ss.run('SELECT this FROM db["nothing"];', engine=engine)


def test_the_text_of_a_path_that_ends_like_one(ss: ss2sql.Session, file: Path) -> None:
    ss.attach("text", str(file))
    assert ss.eval("SELECT x FROM text.t AS list;") == [1, 2]
    ss.attach("word", "data")
    assert ss.eval("SELECT this FROM word AS list;") == ["data"]


def test_a_file_that_cannot_be_attached_leaves_the_one_before(ss: ss2sql.Session, tmp_path: Path) -> None:
    text = tmp_path / "text.db"
    text.write_text("no database at all, only some words")
    for source, words in (
        (tmp_path / "missing.db", "there is no file"),
        (str(tmp_path / "missing.sqlite"), "there is no file"),
        (tmp_path, "is a folder"),
        (text, "is not a SQLite file"),
    ):
        with pytest.raises(ss2sql.Error, match=words) as caught:
            ss.attach("db", source)
        assert caught.value.code == "S002"
    assert not (tmp_path / "missing.db").exists()
    assert ss.eval("SELECT x FROM db.t AS list;") == [1, 2]


@pytest.mark.parametrize("name", ["main", "Temp"])
def test_names_of_the_session(ss: ss2sql.Session, file: Path, name: str) -> None:
    with pytest.raises(ss2sql.Error, match="own database"):
        ss.attach(name, file)


def test_a_name_has_one_meaning(ss: ss2sql.Session, file: Path) -> None:
    ss.attach("db", [1])
    assert ss.eval("SELECT this FROM db AS list;") == [1]
    with pytest.raises(ss2sql.ResolveError):
        ss.eval("SELECT x FROM db.t;")
    ss.attach("db", file)
    with pytest.raises(ss2sql.ResolveError, match="unknown source 'db'") as caught:
        ss.eval("SELECT this FROM db;")
    assert "FROM db.table" in str(caught.value)


def test_a_file_can_be_let_go(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT x FROM db.t;")
    ss.detach("db")
    with pytest.raises(ss2sql.ResolveError, match=r"unknown source 'db\.t'"):
        query.run()
    with pytest.raises(KeyError):
        ss.detach("db")


@both
def test_a_table_that_vanishes_or_changes_after_compiling(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    query = ss.compile("SELECT x FROM db.t AS list;", engine=engine)
    assert query.run().value == [1, 2]
    write(file, "DROP TABLE t")
    with pytest.raises(ss2sql.ResolveError, match=r"unknown source 'db\.t'"):
        query.run()
    write(file, "CREATE TABLE t(z, x); INSERT INTO t VALUES (7, 'x')")
    assert query.run().value == ["x"]


def test_a_view_that_cannot_be_read(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.ExecutionError, match="the view 'broken' cannot be read"):
        ss.eval("SELECT nope FROM db.broken;")


def test_a_file_that_may_only_be_read(file: Path) -> None:
    file.chmod(0o444)
    with ss2sql.connect() as ss:
        ss.attach("db", file)
        assert ss.eval("SELECT x FROM db.t AS list;") == [1, 2]
