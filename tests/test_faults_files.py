"""Files that are full, broken, locked, damaged, read-only or none of SQLite, under `connect` and `attach`."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import apsw
import faulty_files
import pytest
from faulty import ALL, WANTED, amounts
from faulty_files import DAMAGES, FAULTS, HISTORY, LOOKS, PLAIN, READS, VALUE, WALK, WRITES, handles, outcome
from remembering import connect
from sessions import code_of, write

import ss2sql

WORKS = {**READS, **LOOKS, **WRITES}
MOST = 40  # operations of one piece of work that are made to fail, one in each try
PLUS = "SELECT this + 1 FROM [1, 2] AS list;"


@pytest.fixture(scope="module")
def right() -> dict[str, Any]:
    return faulty_files.right()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a database with a table, a temporal variable and a remembered graph."""
    file = tmp_path_factory.mktemp("whole") / "data.db"
    faulty_files.prepare(file)
    return file.read_bytes()


def opened(file: Path) -> ss2sql.Session:
    ss = connect(file)
    ss.function("getTime", lambda: 6.0)
    return ss


# --- a disk that breaks --------------------------------------------------------------------------------


@amounts(3, 26)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_disk_that_breaks(file: Path, whole: bytes, right: dict[str, Any], fault: str, amount: int | None) -> None:
    dice = Random(f"{WANTED} {fault}")
    works = [(name, stays) for name in WORKS for stays in (False, True)]
    for name, stays in dice.sample(works, amount or len(works)):
        for n in range(1, MOST) if ALL else [dice.choice((1, 1, 2, 3, 5, 12))]:
            if not break_once(file, whole, right, fault, name, n, stays):
                break


def break_once(file: Path, whole: bytes, right: dict[str, Any], fault: str, name: str, n: int, stays: bool) -> bool:
    """Does a piece of work while the n-th operation on the file fails; whether it came to that."""
    for old in file.parent.glob(f"{file.name}*"):
        old.unlink()
    file.write_bytes(whole)
    with faulty_files.failing() as vfs:
        ss = opened(file)
        vfs.operations, vfs.error = FAULTS[fault]
        vfs.left, vfs.stays = n, stays
        value, error = outcome(lambda: WORKS[name](ss))
        reached, vfs.operations = vfs.left <= 0, frozenset()
        assert error is None or reached, str(error)
        if name == "farther" and error is None:
            assert value.value == right["farther"]
        assert error is not None or name not in READS or value == right[name]
        assert not ss.host.connection.in_transaction
        changed = name in ("store", "forget") and error is None
        check(ss, right, changed)
        kept = None if changed else ss.eval(HISTORY)
        assert ss.eval(PLUS) == [2, 3]
        ss.close()
    assert faulty_files.is_whole(file)
    with opened(file) as ss:
        check(ss, right, changed)
        assert changed or ss.eval(HISTORY) == kept
    return reached


def check(ss: ss2sql.Session, right: dict[str, Any], changed: bool) -> None:
    """Whether a session reads what is in its file."""
    for name, read in READS.items():
        assert (changed and name == "history") or read(ss) == right[name]


@pytest.mark.parametrize("fault", ["read", "open", "lock"])
def test_opening_on_a_disk_that_breaks(file: Path, whole: bytes, fault: str) -> None:
    file.write_bytes(whole)
    before = handles()
    with faulty_files.failing() as vfs:
        for n in range(1, MOST):
            vfs.operations, vfs.error = FAULTS[fault]
            vfs.left = n
            session, error = outcome(lambda: connect(file))
            if session is None:
                assert error is not None
                assert error.code == "S002"
                assert handles() == before
                continue
            reached, vfs.operations = vfs.left <= 0, frozenset()
            assert session.eval(HISTORY) == [VALUE]
            session.close()
            if not reached:
                break
        else:
            raise AssertionError("opening never comes to an end")


# --- damage --------------------------------------------------------------------------------------------


@amounts(8, 30)
def test_damaged_files(file: Path, whole: bytes, right: dict[str, Any], amount: int | None) -> None:
    """An error of ours, or what SQLite reads there without noticing anything."""
    seen: set[bool] = set()
    for seed in range(7000, 7000 + (amount or 300)):
        dice, data = Random(f"{WANTED} {seed}"), bytearray(whole)
        dice.choice(DAMAGES)(data, dice, dice.randrange(len(data) // 4096) * 4096)
        file.write_bytes(data)
        before = handles()
        try:
            seen.add(look_at_damage(file, right))
            file.write_bytes(data)
            look_at_damage_from_outside(file, right)
        except Exception as failure:
            failure.add_note(f"damage {seed}")
            raise
        assert handles() == before
        for old in file.parent.glob(f"{file.name}*"):
            old.unlink()
    assert seen == {True, False}


def test_damage_is_found_each_time(file: Path, whole: bytes) -> None:
    """SQLite checks a page when it reads it, and no more as long as it keeps it."""
    for place in range(8, 40):  # where the cells of a page of the table are
        data = bytearray(whole)
        data[3 * 4096 + place] ^= 0xC5
        file.write_bytes(data)
        with opened(file) as ss:
            found = {code_or_none(ss, engine) for engine in ("native", "auto", "native", "database", "auto")}
        assert found == {"X009"}, place


def code_or_none(ss: ss2sql.Session, engine: Any) -> str | None:
    _, error = outcome(lambda: ss.run(WALK, engine=engine).value)
    return None if error is None else error.code


def look_at_damage(file: Path, right: dict[str, Any]) -> bool:
    """Does everything with a damaged file; whether it could be opened."""
    ss, _ = outcome(lambda: opened(file))
    if ss is None:
        return False
    for name, work in WORKS.items():
        if name == "history" and "v" not in ss.variables():
            continue  # the page that says that there is such a table has lost it
        value, error = outcome(lambda work=work: work(ss))  # type: ignore[misc]
        if error is None and name in READS and value != right[name]:
            assert name in PLAIN, name
            assert value == faulty_files.as_sqlite_reads(file, name)
    assert ss.eval(PLUS) == [2, 3]
    ss.close()
    return True


def look_at_damage_from_outside(file: Path, right: dict[str, Any]) -> None:
    with ss2sql.connect() as ss:
        _, refused = outcome(lambda: ss.attach("f", file))
        if refused is None and "f.t" in (outcome(ss.tables)[0] or ()):
            for name, script in (("walk", "SELECT a, b FROM f.t AS rows;"),
                                 ("lookup", "SELECT a FROM f.t WHERE c == 3 AS list;")):  # fmt: skip
                value, error = outcome(lambda script=script: ss.eval(script))  # type: ignore[misc]
                assert error is not None or value == right[name] or value == faulty_files.as_sqlite_reads(file, name)
        assert ss.eval(PLUS) == [2, 3]


def test_texts_that_are_no_utf_8(file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a, b); INSERT INTO t VALUES (1, CAST(x'61ff' AS TEXT))")
    with ss2sql.connect(file) as ss:
        assert code_of(ss.run, "SELECT b FROM t AS list;", engine=engine) == "X009"
        assert ss.run("SELECT a FROM t AS list;", engine="database").value == [1]
        ss.function("f", lambda x: b"\xff".decode(), volatility="stable")
        with pytest.raises(UnicodeDecodeError) as caught:  # that of a function stays its own
            ss.run("SELECT f(this) FROM [1] AS list;", engine=engine)
        assert "by the function 'f'" in caught.value.__notes__[0]


@pytest.mark.parametrize(
    "row",
    ["NULL, 5.0, '1', 1.0", "'v', 'noon', '1', 1.0", "'v', 5.0, '[1', 1.0",
     "'v', 5.0, 'NaN', 1.0", "'v', 5.0, '1e999', 1.0", "'v', 5.0, '[99999999999999999999]', 1.0", "'v', 5.0, '1', NULL",
     "'v', 5.0, CAST(x'22ff22' AS TEXT), 1.0"],
)  # fmt: skip
def test_histories_that_were_not_written_here(file: Path, row: str) -> None:
    with ss2sql.connect(file) as ss:
        ss.run("v{1000.0} = 1;")
    write(file, f"INSERT INTO ss2sql_temporal VALUES ({row})")
    before = handles()
    with pytest.raises(ss2sql.SessionError, match=r"S002.*ss2sql_temporal"):
        ss2sql.connect(file)
    assert handles() == before


# --- files that cannot be written, or are none ---------------------------------------------------------


def test_what_cannot_be_written_changes_nothing(file: Path, engine: Any) -> None:
    with ss2sql.connect(file) as ss:
        ss.run("v{1000.0} = 1; plain = 2;")
        ss.attach("data", [1, 2])
        connection = ss.host.connection
        connection.execute(f"PRAGMA max_page_count = {connection.execute('PRAGMA page_count').get}")
        for name in ("v", "plain", "data", "new"):
            assert code_of(ss.run, f"{name}{{5.0}} = text;", engine=engine, text="x" * 90_000) == "X009"
        assert ss.eval("v{};") == [1]
        assert ss.eval("[plain, len(data)];") == [2, 2]
        assert "new" not in ss.variables()
        assert code_of(ss.run, "plain{0 - 1} = 3;", engine=engine) == "X007"
        assert ss.eval("plain;") == 2
        with connection:
            connection.execute("PRAGMA query_only = ON")
        assert code_of(ss.set, "v", 7) == "X009"
        assert ss.eval("v{};") == [1]


@pytest.fixture
def ordinary() -> Iterator[Path]:
    """A folder, while the process has no more rights than anybody, so that they count."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o777)
    root = os.geteuid() == 0
    if root:
        os.chown(folder, 65534, 65534)
        os.seteuid(65534)
    try:
        yield folder
    finally:
        if root:
            os.seteuid(0)
        folder.chmod(0o777)
        shutil.rmtree(folder)


@pytest.mark.skipif(os.name != "posix", reason="rights of files are those of POSIX")
@pytest.mark.parametrize("what", ["file", "folder"])
def test_without_the_right_to_write(ordinary: Path, right: dict[str, Any], what: str) -> None:
    file = ordinary / "data.db"
    faulty_files.prepare(file)
    file.chmod(0o444 if what == "file" else 0o666)
    ordinary.chmod(0o777 if what == "file" else 0o555)
    before = file.read_bytes()
    with opened(file) as ss:
        check(ss, right, changed=False)
        for name in ("store", "long", "drop", "forget"):
            assert code_of(WRITES[name], ss) == "X009"
        assert WRITES["farther"](ss).value == right["farther"]  # a graph that cannot be kept is no error
        check(ss, right, changed=False)
    assert file.read_bytes() == before
    if what == "folder":
        assert code_of(ss2sql.connect, ordinary / "new.db") == "S002"


def test_what_is_no_database(tmp_path: Path) -> None:
    text, folder, missing = tmp_path / "text.db", tmp_path / "folder.db", tmp_path / "missing" / "data.db"
    text.write_text("This is no database, though it is long enough for one. " * 40)
    folder.mkdir()
    before = handles()
    with ss2sql.connect() as ss:
        for path in (text, folder, missing, "\0", "a\0b.db", "\ud800.db", "x" * 5000 + ".db"):
            for read_only in (False, True):
                with pytest.raises(ss2sql.SessionError) as caught:
                    ss2sql.connect(path, read_only=read_only)
                assert caught.value.code == "S002"
                assert isinstance(path, str) or str(path) in str(caught.value)
            assert code_of(ss.attach, "f", Path(path)) == "S002"
            assert ss.eval("1 + 1;") == 2
    assert code_of(ss2sql.connect, 5) == "S002"
    assert handles() == before
    assert text.read_text().startswith("This is no database")
    (tmp_path / "empty.db").touch()
    with ss2sql.connect(tmp_path / "empty.db") as ss:  # SQLite takes it for a new one
        ss.run("v{5.0} = 1;")


@pytest.mark.parametrize("lock", ["EXCLUSIVE", "IMMEDIATE"])
def test_locked_files(
    file: Path, whole: bytes, right: dict[str, Any], monkeypatch: pytest.MonkeyPatch, lock: str
) -> None:
    monkeypatch.setattr("ss2sql.session.session.BUSY_MILLISECONDS", 5)
    file.write_bytes(whole)
    ss = opened(file)
    other = apsw.Connection(str(file))
    other.execute(f"BEGIN {lock}")
    for name in ("store", "forget", "drop"):
        assert code_of(WRITES[name], ss) == "X009"
    if lock == "IMMEDIATE":  # that lets others read
        with pytest.raises(ss2sql.ExecutionError, match="'v' cannot be kept in the file: database is locked") as told:
            WRITES["store"](ss)
        assert told.value.span is not None
        check(ss, right, changed=False)
        assert WRITES["farther"](ss).value == right["farther"]
    else:
        assert code_of(READS["walk"], ss) == code_of(READS["walk natively"], ss) == "X009"
        with pytest.raises(ss2sql.SessionError, match="locked") as caught:
            ss2sql.connect(file)
        assert "another program is writing" in caught.value.hints[0]
    other.execute("ROLLBACK")
    other.close()
    check(ss, right, changed=False)
    WRITES["store"](ss)
    ss.close()
    with opened(file) as ss:
        assert ss.eval(HISTORY) == [VALUE, 7]
