"""What Python code of the user raises keeps its type and traceback; a note names the place in the script."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
from balls import Balls, BallWorld, Box
from golden import each_row

import ss2sql
from ss2sql.vtables import function


class MishapError(Exception):
    """An exception of the user's own."""


class SlottedError(Exception):
    __slots__ = ()


def fail(*values: Any) -> Any:
    raise MishapError("no")


class Failing(Balls):
    def dynamics(self, key: int) -> Any:
        raise MishapError("no")


class FailingWorld(BallWorld):
    tables = (Failing,)
    representations = {"pile": "pile"}

    @function("stable")
    def weigh(self, ball: Any) -> float:
        raise MishapError("no")

    def pile(self, table: Any) -> Any:
        raise MishapError("no")


@pytest.fixture
def failing(ss: ss2sql.Session) -> ss2sql.Session:
    """A session in which `fail`, its forms, two representations, and much of a world raise an exception."""
    ss.attach("world", FailingWorld(Box.row(2)))
    ss.function("fail", fail, volatility="immutable")
    ss.function("arrays", fail, vectorized=True)
    ss.function("add", fail)
    ss.representation("heap")(fail)

    @ss.representation("odd")
    def odd(table: Any) -> Any:
        raise TypeError("no")

    return ss


def caught(action: Callable[[], object], kind: type[BaseException] = MishapError) -> tuple[list[str], str]:
    """The notes of the exception that the action raises, and the function in which it was raised."""
    with pytest.raises(kind) as found:
        action()
    assert type(found.value) is kind
    assert found.value.__cause__ is None
    return list(found.value.__notes__), found.traceback[-1].name


@each_row("errors/notes", "script", "told")
def test_a_note_names_the_place(failing: ss2sql.Session, engine: Any, script: str, told: str) -> None:
    name, at = told.split(", ")
    asked = "auto" if "MEMORIZE" in script or "(SELECT this" in script else engine
    kind = TypeError if name == "odd" else MishapError
    notes, raised_in = caught(lambda: failing.run(script, engine=asked), kind)
    what = "representation" if at.startswith("AS") else "function"
    before, _, _ = script.partition(at)
    line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
    called = f"raised by the {what} '{name}', called at <script>:{line}:{column}"
    assert notes == [f"{called}\n  {line} | {script.splitlines()[line - 1]}"]
    assert raised_in == (name if name in ("weigh", "pile", "odd") else "fail")
    assert failing.eval("1 - 1;") == 0


KINDS = [
    SlottedError("no"), KeyError("no"), StopIteration(4), ZeroDivisionError(), NameError("no x", name="x"),
    RuntimeError("generator raised StopIteration"),
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: type(kind).__name__)
def test_an_exception_stays_itself_and_gets_one_note(ss: ss2sql.Session, engine: Any, kind: Exception) -> None:
    error = copy.copy(kind)

    def broken(x):
        raise error

    ss.function("broken", broken, volatility="stable")
    with pytest.raises(type(error)) as found:
        ss.run("SELECT this,\n  broken(this) FROM [1, 2];", engine=engine)
    assert found.value is error
    assert error.__notes__ == [
        "raised by the function 'broken', called at <script>:2:3\n  2 |   broken(this) FROM [1, 2];"
    ]
    assert found.traceback[-1].name == "broken"


def test_one_note_for_several_places_two_scripts_and_a_text(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("broken", lambda x: fail() if x == 2 else x, volatility="stable")
    script = "SELECT broken(this)\nFROM [1, 2] WHERE broken(1) AND\nbroken(this);"
    (note,), _ = caught(lambda: ss.run(script, engine=engine))
    assert note.startswith("raised by the function 'broken', called at ")
    assert "<script>:3:1" in note
    assert "3 | broken(this);" in note
    if engine == "database":  # SQLite does not say which of the calls it was; all are named, in the order of the text
        assert "<script>:1:8, <script>:2:19, <script>:3:1" in note
    ss.function("fail", fail, volatility="stable")
    ss.function("outer", lambda x: ss.run("SELECT fail(this) FROM [7];", engine=engine), volatility="stable")
    (note,), _ = caught(lambda: ss.run("SELECT outer(this) FROM [1];", engine=engine))
    assert "'fail'" in note
    assert "FROM [7]" in note
    ss.function("fail", fail)
    notes, _ = caught(lambda: ss.run("x = 'fail(5)';\neval(x);", engine=engine))
    assert notes == [
        "raised by the function 'fail', called at <eval>:1:1\n  1 | fail(5)\n"
        "in the text that eval reads at <script>:2:1\n  2 | eval(x);"
    ]


@pytest.mark.parametrize("script", ["SELECT heavy\nFROM world;", "SELECT x\nFROM world WHERE heavy > 1;"])
def test_a_column_of_a_world(failing: ss2sql.Session, engine: Any, script: str) -> None:
    """The adapter stands between: its exception is the cause of an error that names the world and the place."""
    with pytest.raises(ss2sql.ExecutionError) as found:
        failing.run(script, engine=engine)
    error = found.value
    assert error.code == "X011"
    assert "MishapError: no" in error.message
    assert error.span is not None
    assert error.span.place == "<script>:2:6"
    assert type(error.__cause__) is MishapError
    frames = pytest.ExceptionInfo.from_exception(error.__cause__).traceback
    assert frames[-1].name == "dynamics"


@pytest.mark.parametrize(
    ("script", "called", "note"),
    [
        ("fragile(x);", print,
         "raised by the function 'fragile', called at <script>:1:1\n  1 | fragile(x);"),
        ("y = 1;\nx + y;", fail,
         "raised by the function 'fail', called because the value at <script>:2:1 has changed\n  2 | x + y;"),
    ],
    ids=["its script", "the function that it calls"],
)  # fmt: skip
def test_a_trigger(ss: ss2sql.Session, script: str, called: Callable[..., object], note: str) -> None:
    now = [0.0]
    ss.host.triggers.clock = lambda: now[0]
    ss.function("fragile", lambda x: fail() if x > 1 else x)
    ss.set("x", 1)
    ss.on_change(script, every=0.1)(called)
    ss.set("x", 2)
    now[0] = 1.0
    assert caught(ss.poll) == ([note], "fail")


@pytest.mark.parametrize("kind", [SystemExit, GeneratorExit])
def test_what_is_no_error_passes_untouched(ss: ss2sql.Session, engine: Any, kind: Any) -> None:
    def leave(x):
        raise kind

    ss.function("leave", leave)
    with pytest.raises(kind):
        ss.run("SELECT leave(this) FROM [1];", engine=engine)
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]
