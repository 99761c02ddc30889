"""What Python code of the user raises keeps its type and traceback, wherever the script comes to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from sessions import both

import ss2sql
from ss2sql.vtables import Column, Table, World, function


class MishapError(Exception):
    """An exception of the user's own."""


def caught(action: Callable[[], object]) -> tuple[list[str], str]:
    """The notes of the exception that the action raises, and the function in which it was raised."""
    with pytest.raises(MishapError, match="no") as found:
        action()
    assert type(found.value) is MishapError
    return list(found.value.__notes__), found.traceback[-1].name


class Balls(Table):
    name = "balls"
    columns = (Column("x", float), Column("heavy", float))
    groups = {"place": "x", "weight": "heavy"}

    def keys(self, where: Any) -> list[int]:
        return [1, 2]

    def place(self, key: int) -> float:
        return float(key)

    def weight(self, key: int) -> float:
        raise MishapError("no")


class BallWorld(World):
    tables = (Balls,)

    @function("volatile")
    def weigh(self, ball: Any) -> float:
        raise MishapError("no")

    representations = {"pile": "pile"}

    def pile(self, table: Any) -> Any:
        raise MishapError("no")


@both
def test_a_function_of_a_world(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("world", BallWorld())
    script = "SELECT x\nFROM world WHERE weigh(this) > 1;"
    notes, name = caught(lambda: ss.run(script, engine=engine))
    assert notes == ["raised by the function 'weigh', called at <script>:2:18\n  2 | FROM world WHERE weigh(this) > 1;"]
    assert name == "weigh"


@both
@pytest.mark.parametrize("script", ["SELECT heavy\nFROM world;", "SELECT x\nFROM world WHERE heavy > 1;"])
def test_a_column_of_a_world(ss: ss2sql.Session, engine: Any, script: str) -> None:
    """The adapter stands between: its exception is the cause of an error that names the world and the place."""
    ss.attach("world", BallWorld())
    with pytest.raises(ss2sql.ExecutionError) as found:
        ss.run(script, engine=engine)
    error = found.value
    assert error.code == "X011"
    assert "MishapError: no" in error.message
    assert error.span is not None
    assert error.span.place == "<script>:2:6"
    assert type(error.__cause__) is MishapError
    traceback = error.__cause__.__traceback__
    while traceback is not None and traceback.tb_next is not None:
        traceback = traceback.tb_next
    assert traceback is not None
    assert traceback.tb_frame.f_code.co_name == "weight"


@both
@pytest.mark.parametrize("kind", ["own", "world's"])
def test_a_representation(ss: ss2sql.Session, engine: Any, kind: str) -> None:
    ss.attach("world", BallWorld())
    if kind == "own":

        @ss.representation("pile")
        def pile(table: Any) -> Any:
            raise MishapError("no")

    notes, name = caught(lambda: ss.run("x = 1;\nSELECT x FROM world AS pile;", engine=engine))
    assert notes == ["raised by the representation 'pile', called at <script>:2:21\n  2 | SELECT x FROM world AS pile;"]
    assert name == "pile"


def test_a_representation_inside_of_a_query(ss: ss2sql.Session) -> None:
    @ss.representation("pile")
    def pile(table: Any) -> Any:
        raise TypeError("no")

    with pytest.raises(TypeError) as found:
        ss.run("SELECT (SELECT this FROM [1] AS pile)\nFROM [1];")
    (note,) = found.value.__notes__
    assert note.startswith("raised by the representation 'pile', called at <script>:1:30\n")


def fail(*values: Any) -> Any:
    raise MishapError("no")


@both
def test_a_function_that_takes_arrays(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("fail", fail, vectorized=True)
    notes, name = caught(lambda: ss.run("SELECT\nfail(this) FROM [1, 2];", engine=engine))
    assert notes == ["raised by the function 'fail', called at <script>:2:1\n  2 | fail(this) FROM [1, 2];"]
    assert name == "fail"


@both
def test_an_operator(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", fail)
    notes, name = caught(lambda: ss.run("SELECT this + 1 FROM [1, 2];", engine=engine))
    assert notes == ["raised by the function 'add', called at <script>:1:13\n  1 | SELECT this + 1 FROM [1, 2];"]
    assert name == "fail"


def test_memorize(ss: ss2sql.Session) -> None:
    ss.function("fail", fail)
    script = "SELECT n FROM [1] START WITH n = 0\nCONNECT BY MEMORIZE 9 n = fail(n)\nSTOP WITH n == 3;"
    notes, name = caught(lambda: ss.run(script))
    assert notes == ["raised by the function 'fail', called at <script>:2:27\n  2 | CONNECT BY MEMORIZE 9 n = fail(n)"]
    assert name == "fail"


@both
def test_the_text_of_an_eval(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("fail", fail)
    notes, _ = caught(lambda: ss.run("x = 'fail(5)';\neval(x);", engine=engine))
    assert notes == [
        "raised by the function 'fail', called at <eval>:1:1\n  1 | fail(5)\n"
        "in the text that eval reads at <script>:2:1\n  2 | eval(x);"
    ]


@pytest.fixture
def clock(ss: ss2sql.Session) -> list[float]:
    now = [0.0]
    ss.host.triggers.clock = lambda: now[0]
    return now


def test_the_script_of_a_trigger(ss: ss2sql.Session, clock: list[float]) -> None:
    def fragile(x: int) -> int:
        if x > 1:
            raise MishapError("no")
        return x

    ss.function("fragile", fragile)
    ss.set("x", 1)
    ss.on_change("fragile(x);", every=0.1)(print)
    ss.set("x", 2)
    clock[0] = 1.0
    notes, name = caught(ss.poll)
    assert notes == ["raised by the function 'fragile', called at <script>:1:1\n  1 | fragile(x);"]
    assert name == "fragile"


def test_the_function_that_a_trigger_calls(ss: ss2sql.Session, clock: list[float]) -> None:
    ss.set("x", 1)
    ss.on_change("y = 1;\nx + y;", every=0.1)(fail)
    ss.set("x", 2)
    clock[0] = 1.0
    notes, name = caught(ss.poll)
    assert notes == [
        "raised by the function 'fail', called because the value at <script>:2:1 has changed\n  2 | x + y;"
    ]
    assert name == "fail"


def test_a_line_of_another_text_is_shown_from_that_text() -> None:
    """The places of one function may lie in two texts: each line comes from its own."""
    from ss2sql.errors import Source, Span, note_place

    error = MishapError("no")
    first, second = Source("a;\nb;", "one.ss"), Source("c;\nd;", "two.ss")
    note_place(error, "f", [Span(first, 0, 1), Span(second, 3, 4)])
    assert error.__notes__ == ["raised by the function 'f', called at one.ss:1:1, two.ss:2:1\n  1 | a;\n  2 | d;"]
