"""What makes another graph: a changed function, variable, table or world; and what makes none at all."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from threading import Lock
from types import FunctionType
from typing import Any, ClassVar

import pytest
from remembering import calls, session
from sessions import write

import ss2sql
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable, fingerprint_function
from ss2sql.vtables.contract import Column, Table, World, function

SCRIPT = "SELECT f(n) FROM [0] START WITH n = 1 CONNECT BY MEMORIZE 3 n = f(n) AS list"


def search(file: Path, function: Callable[..., Any], script: str = SCRIPT, **variables: Any) -> ss2sql.Result:
    """One search in a session of its own."""
    with session(file, f=function) as ss:
        return ss.run(script, **variables)


def is_new(file: Path, function: Callable[..., Any], script: str = SCRIPT, **variables: Any) -> bool:
    """Whether a search has to call the function; afterwards it need not."""
    first = search(file, function, script, **variables)
    again = search(file, function, script, **variables)
    assert again.value == first.value
    assert calls(again) == 0, again.stats.notes
    return calls(first) > 0


# --- functions -----------------------------------------------------------------------------------------

STEP = 1
TABLE = {"step": [1]}


class Way(Enum):
    UP = 1
    DOWN = -1

    def far(self) -> int:
        return self.value * STEP


def helper(n: int) -> int:
    return n + STEP


def of_body(n: int) -> int:
    return n + 1


def of_twice(n: int) -> int:
    return n + 2


def of_default(n: int, step: int = 1) -> int:
    return n + step


def of_global(n: int) -> int:
    return n + STEP


def of_data(n: int) -> int:
    return n + int(TABLE["step"][0])


def of_helper(n: int) -> int:
    return helper(n) + len([way.far() for way in (Way.UP, Way.DOWN)])


def of_itself(n: int) -> int:
    return 1 if n < 1 else 1 + of_itself(n - 1)


def of_closure(step: Any) -> Callable[[int], int]:
    def inner(n: int) -> int:
        return n + int(step[0] if isinstance(step, list) else step)

    return inner


class Counter:
    """An object with a state, and what Python makes of a class."""

    __slots__ = ("count", "seen")

    def __init__(self, count: int) -> None:
        self.count, self.seen = count, {"a", "b", "c"}

    @property
    def twice(self) -> int:
        return 2 * self.count

    @staticmethod
    def plus(n: int, count: int) -> int:
        return n + count

    def next(self, n: int) -> int:
        return self.plus(n, self.twice)


def of_other_text() -> Any:
    """`of_body` with a comment, in another place."""
    namespace: dict[str, Any] = {}
    exec("# elsewhere\n\n\ndef of_body(n):\n    # a comment\n    return n + 1\n", namespace)
    return namespace["of_body"]


@pytest.mark.parametrize(
    ("one", "other", "differs"),
    [(of_body, of_other_text(), False), (of_body, lambda n: n + 2, True), (of_body, lambda n: n * 2, True),
     (of_default, FunctionType(of_default.__code__, globals(), "of_default", (2,)), True),
     (of_closure(1), of_closure(1), False), (of_closure(1), of_closure(2), True),
     (of_closure(2), of_closure(2.0), True), (of_closure([1]), of_closure([2]), True),
     (lambda n: n in {"a", "b"}, lambda n: n in {"b", "a"}, False),
     (lambda n: n in {"a", "b"}, lambda n: n in {"a", "c"}, True),
     (functools.partial(of_default, step=3), functools.partial(of_default, step=3), False),
     (functools.partial(of_default, step=3), functools.partial(of_default, step=4), True),
     (functools.cache(of_body), functools.cache(of_body), False), (of_body, functools.cache(of_body), True),
     (math.sqrt, math.floor, True), (of_itself, of_helper, True),
     (Counter(1).next, Counter(1).next, False), (Counter(1).next, Counter(2).next, True)],
    ids=range(18),
)  # fmt: skip
def test_another_function(file: Path, one: Any, other: Any, differs: bool) -> None:
    assert is_new(file, one)
    assert is_new(file, other) == differs


@pytest.mark.parametrize(
    ("function", "name", "value"),
    [
        (of_global, "STEP", 2),
        (of_helper, "STEP", 2),
        (of_data, "TABLE", {"step": [2]}),
        (of_helper, "helper", of_twice),
    ],
    ids=["global", "global of a helper", "data", "helper"],
)
def test_another_global(file: Path, function: Any, name: str, value: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_new(file, function)
    with monkeypatch.context() as patch:
        patch.setitem(globals(), name, value)
        assert is_new(file, function)
    assert not is_new(file, function)


def test_of_a_module_what_is_read(tmp_path: Path, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ways_of_mine.py").write_text("STEP = 1\nOTHER = object()\ndef far(n):\n    return n + STEP\n")
    monkeypatch.syspath_prepend(tmp_path)
    import ways_of_mine

    def f(n: int) -> int:
        return int(ways_of_mine.far(n))

    assert is_new(file, f)
    monkeypatch.setattr(ways_of_mine, "STEP", 2)
    assert is_new(file, f)


LOCK = Lock()


def imports(n: int) -> int:
    import remembering

    return len(remembering.MODULE) + n


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (lambda n: n + LOCK.locked(), "reads 'LOCK', which cannot be compared: cannot pickle '_thread.lock' object"),
        (lambda n, lock=LOCK: n, "reads a default of '<lambda>', which cannot be compared"),
        (imports, "imports 'remembering'"),
    ],
)
def test_what_cannot_be_compared(file: Path, function: Any, reason: str) -> None:
    with pytest.raises(NotCacheable, match=reason):
        fingerprint_function(function)
    with session(file, f=function) as ss:
        (note,) = ss.run("SELECT n FROM [0] START WITH n = 1 CONNECT BY MEMORIZE 1 n = f(n)").stats.notes
        assert note.startswith(f"graph: not remembered: 'f' {reason}")
        assert len(ss.graphs()) == 0


def test_a_class_is_the_same_after_an_object_of_it_was_copied() -> None:
    class Plain:
        """Python notes its slots in it when an object is first copied or pickled."""

    before = fingerprint_function(of_closure(Plain))
    copy.copy(Plain())
    assert fingerprint_function(of_closure(Plain)) == before


# --- data ----------------------------------------------------------------------------------------------


def test_what_steps_read_beside_functions(file: Path) -> None:
    """Variables, tables and rows around a search make no other graph: only calls are remembered."""
    write(file, "CREATE TABLE ks(k INTEGER); INSERT INTO ks VALUES (1), (2)")
    script = """SELECT (SELECT f(n) + ks.k + x.this + a.this FROM ks, x = xs START WITH n = 1
    CONNECT BY MEMORIZE 2 n = f(n) + ks.k + x.this AS list) FROM a = [1, 2] AS rows"""
    for numbers in ([1, 2], [2, 1], [1, 2.0], [3]):
        for change in ("UPDATE ks SET k = 3 WHERE k = 2", "UPDATE ks SET k = 2 WHERE k = 3"):
            with session(None, f=of_body) as scratch, session(file, f=of_body) as ss:
                scratch.set("ks", ss.eval("SELECT * FROM ks AS dict"))
                expected = scratch.eval(script, xs=numbers)
                first, again = (ss.run(script, xs=numbers) for _ in range(2))
                assert repr(again.value) == repr(first.value) == repr(expected)
                assert calls(again) == 0
                assert len(ss.graphs()) == 1
            write(file, change)


def test_objects_as_arguments(file: Path) -> None:
    """A call of them is made again: what they consist of may have changed."""
    script = "SELECT f(n, box) FROM [0] START WITH n = 1 CONNECT BY MEMORIZE 3 n = f(n, box) AS list"
    with session(file, f=lambda n, box: n + len(box)) as ss:
        first, again = (ss.run(script, box=Box(size)) for size in (1, 2))
    assert first.value == [[2], [2, 3], [2, 3, 4]]
    assert again.value == [[3], [3, 5], [3, 5, 7]]


def test_objects_between_calls(file: Path) -> None:
    script = "SELECT f(g(n)) FROM [0] START WITH n = 1 CONNECT BY MEMORIZE 3 n = f(g(n)) AS list"
    with session(file, g=Box, f=lambda box: len(box) + 1) as ss:
        first, again = (ss.run(script) for _ in range(2))
        assert first.value == again.value == [[2], [2, 3], [2, 3, 4]]
        assert (first.stats.notes, again.stats.notes, again.stats.calls["g"]) == ([], [], 3)


class Box:
    def __init__(self, size: int) -> None:
        self.size = size

    def __len__(self) -> int:
        return self.size


# --- worlds --------------------------------------------------------------------------------------------


class Posts(Table):
    name = "posts"
    key = "id"
    columns: ClassVar = [Column("id", int), Column("x", float)]
    groups: ClassVar = {"place": "x"}

    def keys(self, where: Any) -> Iterator[int]:
        yield from self.world.source

    def place(self, key: int) -> float:
        return float(self.world.source[key])


class Field(World):
    tables: ClassVar = [Posts]
    asked: ClassVar[list[float]] = []

    @function
    def isFree(self, x: float) -> bool:  # noqa: N802
        self.asked.append(x)
        return all(abs(x - place) > 0.5 for place in self.source.values())


WALK = """SELECT d.this, x FROM d = [1, -1] START WITH x = 0 CONNECT BY MEMORIZE 4 x = x + d.this
STOP WITH NOT field.isFree(x + d.this) AS list"""


def walk(file: Path, posts: dict[int, float]) -> tuple[Any, int]:
    """The walks between posts, and how often the world was asked."""
    Field.asked.clear()
    with ss2sql.connect(file) as ss:
        ss.attach("field", Field(posts))
        return ss.eval(WALK), len(Field.asked)


def test_a_world_that_has_changed(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    near, asked = walk(file, {1: 2.0, 2: -2.0})
    assert asked > 0
    assert walk(file, {1: 2.0, 2: -2.0}) == (near, 0)
    far, asked = walk(file, {1: 3.0, 2: -2.0})
    assert asked > 0
    assert far != near
    assert walk(file, {1: 2.0, 2: -2.0}) == (near, 0)
    assert walk(file, {2: -2.0, 1: 2.0})[1] > 0  # the order of elements counts

    def isFree(self: Field, x: float) -> bool:  # noqa: N802
        self.asked.append(x)
        return all(abs(x - place) > 1.5 for place in self.source.values())

    monkeypatch.setattr(Field, "isFree", function(isFree))
    narrow, asked = walk(file, {1: 2.0, 2: -2.0})
    assert asked > 0
    assert narrow != near


def test_a_world_says_what_it_is(file: Path) -> None:
    class Silent(Field):
        def fingerprint(self) -> str:
            raise NotImplementedError("it never stays the same")

    with ss2sql.connect(file) as ss:
        ss.attach("field", Silent({1: 2.0, 2: -2.0}))
        (note,) = ss.run(WALK).stats.notes
        assert note == "graph: not remembered: Silent cannot be compared: it never stays the same"
