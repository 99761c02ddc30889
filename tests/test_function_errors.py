"""Python functions in scripts: their exceptions pass with a note that names the place in the script."""

from __future__ import annotations

import traceback
from typing import Any

import pytest
from sessions import both

import ss2sql


class CrashError(RuntimeError):
    pass


class SlottedError(Exception):
    __slots__ = ()


def notes_of(ss: ss2sql.Session, script: str, engine: Any, kind: type[BaseException]) -> list[str]:
    with pytest.raises(kind) as caught:
        ss.run(script, engine=engine)
    assert type(caught.value) is kind
    assert caught.value.__cause__ is None
    lines = traceback.format_exception(caught.value)
    assert any("in broken" in line for line in lines), "the user's own frame is in the traceback"
    assert ss.eval("1 + 1;") == 2
    return list(caught.value.__notes__)


@both
@pytest.mark.parametrize("kind", [CrashError, SlottedError, KeyError, StopIteration, ZeroDivisionError, AssertionError])
def test_an_exception_keeps_its_type_and_gets_one_note(ss: ss2sql.Session, engine: Any, kind: Any) -> None:
    def broken(x):
        raise kind("no")

    ss.function("broken", broken)
    notes = notes_of(ss, "SELECT this,\n  broken(this) FROM [1, 2];", engine, kind)
    assert notes == ["raised by the function 'broken', called at <script>:2:3\n  2 |   broken(this) FROM [1, 2];"]


@both
def test_a_note_names_the_place_among_several(ss: ss2sql.Session, engine: Any) -> None:
    def broken(x):
        if x == 2:
            raise CrashError("no")
        return x

    ss.function("broken", broken, volatility="volatile")
    (note,) = notes_of(ss, "SELECT broken(this)\nFROM [1, 2] WHERE broken(1) AND\nbroken(this);", engine, CrashError)
    assert note.startswith("raised by the function 'broken', called at ")
    assert "<script>:3:1" in note
    assert "3 | broken(this);" in note
    if engine == "database":  # SQLite does not say which of the calls it was; all are named, in the order of the text
        assert "<script>:1:8, <script>:2:19, <script>:3:1" in note


@both
@pytest.mark.parametrize(
    "script",
    ["broken(1);", "x = [1, broken(2)];", "SELECT this FROM broken(1);",
     "SELECT this FROM a = [1], b = broken(a.this);",
     "SELECT this FROM [1] ORDER BY broken(this);", "SELECT this FROM [1] GROUP BY broken(this);",
     "SELECT this FROM [1] LIMIT broken(1);", "SELECT (SELECT broken(a.this) FROM [1] AS value) FROM a = [1];",
     "SELECT this FROM [1] START WITH n = broken(1) CONNECT BY n = n;",
     "SELECT this FROM [1] START WITH n = 1 CONNECT BY n = broken(n);",
     "SELECT this FROM [1] START WITH n = 1 CONNECT BY n = n STOP WITH broken(n);",
     "SELECT broken(this) FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = n;"],
)  # fmt: skip
def test_exceptions_from_every_clause_get_their_note(ss: ss2sql.Session, engine: Any, script: str) -> None:
    def broken(x):
        raise CrashError("no")

    ss.function("broken", broken, volatility="immutable")
    (note,) = notes_of(ss, script, engine, CrashError)
    assert f"called at <script>:1:{script.index('broken') + 1}\n" in note
    assert script in note


@both
def test_an_exception_through_two_scripts_gets_one_note(ss: ss2sql.Session, engine: Any) -> None:
    def broken(x):
        raise CrashError("no")

    ss.function("broken", broken, volatility="volatile")
    ss.function("outer", lambda x: ss.run("SELECT broken(this) FROM [7];", engine=engine), volatility="volatile")
    (note,) = notes_of(ss, "SELECT outer(this) FROM [1];", engine, CrashError)
    assert "broken" in note
    assert "FROM [7]" in note


@both
@pytest.mark.parametrize("kind", [SystemExit, GeneratorExit])
def test_what_is_no_error_passes_untouched(ss: ss2sql.Session, engine: Any, kind: Any) -> None:
    def leave(x):
        raise kind

    ss.function("leave", leave)
    with pytest.raises(kind):
        ss.run("SELECT leave(this) FROM [1];", engine=engine)
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]
