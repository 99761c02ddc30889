"""check_world: it passes for a good adapter, and names the broken rule of each bad one."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import numpy as np
import pytest
from balls import Balls, BallWorld, Box, Gaps, Near

import ss2sql
from ss2sql.errors import SessionError
from ss2sql.vtables import Column, Table, TableFunction, Where, World, conformance, function
from ss2sql.vtables.questions import Questions

QUERIES = int(os.environ.get("SS2SQL_WORLD_QUERIES", "60"))
ARGUMENTS = {"gaps": [(1,), (1, 3.0)], "near": [(0.0, 0.0, 0.0), (1, 1, 0, 4.0)]}


def test_a_good_adapter_passes() -> None:
    box = Box.random(1, 25)
    report = ss2sql.check_world(BallWorld(box), seed=1, queries=QUERIES, change=box.change)
    assert report.queries == QUERIES
    assert report.elements == {"balls": 25}
    assert report.skipped == []


def test_an_empty_world_passes() -> None:
    assert ss2sql.check_world(BallWorld(Box()), queries=10).elements == {"balls": 0}


def test_arguments_can_be_given() -> None:
    class Odd(TableFunction):
        name, columns = "odd", (Column("n", int),)

        def rows(self, what: str) -> list[tuple[int]]:
            return [(len(what),)]

    class OddWorld(World):
        tables = (Balls, Odd)

    box = Box.row(3)
    assert ss2sql.check_world(OddWorld(box), queries=5).skipped == ["odd"]
    assert ss2sql.check_world(OddWorld(box), queries=5, arguments={"odd": [("abc",)]}).skipped == []


def test_arrays_pass() -> None:
    ss2sql.check_world(ArrayWorld(), queries=QUERIES // 2)


class Points(Table):
    """Everything in arrays, as MuJoCo has it."""

    name, key = "points", "id"
    columns = (Column("id", int, filter="="), Column("x", float), Column("y", float), Column("kind", int))
    arrays = {"place": "x y", "kind": "kind"}

    def keys(self, where: Where) -> range:
        return range(12)

    def place(self, keys: list[int]) -> Any:
        self.world.calls += 1
        return self.world.points[keys].T

    def kind(self, keys: list[int]) -> Any:
        return self.world.kinds[keys]


class ArrayWorld(World):
    tables = (Points,)

    def __init__(self) -> None:
        super().__init__()
        self.points = np.arange(24, dtype=np.float32).reshape(12, 2)
        self.kinds = np.arange(12, dtype=np.int32) % 3
        self.calls = 0


@pytest.mark.parametrize("engine", ["database", "native"])
def test_arrays_are_asked_for_once(engine: Any) -> None:
    world = ArrayWorld()
    ss = ss2sql.connect()
    ss.attach("space", world)
    found = ss.run(
        "SELECT a.x, b.y FROM a = space, b = space WHERE a.id == b.id AND a.kind == 1 AS rows;", engine=engine
    )
    assert found.value == [(2.0 * n, 2.0 * n + 1) for n in (1, 4, 7, 10)]
    assert {type(part) for row in found.value for part in row} == {float}
    assert world.calls == 1


# --- adapters that break a rule ------------------------------------------------------------------------


class TooFew(Balls):
    def keys(self, where: Any) -> list[int]:
        return [key for key in super().keys(where) if where.low("x") < self.world.source.balls[key].x]


class Disorder(Balls):
    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return found[::-1] if where else found


class Twice(Balls):
    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return found + found[:1]


class Unhashable(Balls):
    def keys(self, where: Any) -> Any:
        return [[key] for key in super().keys(where)]


class Restless(Balls):
    def keys(self, where: Any) -> list[int]:
        self.world.source.balls[min(self.world.source.balls) - 1] = self.world.source.ball(Random(1), 0)
        return super().keys(where)


class Failing(Balls):
    def keys(self, where: Any) -> list[int]:
        raise RuntimeError("no connection")


class NotANumber(Balls):
    def place(self, key: int) -> Any:
        return float("nan"), 0.0, 0.0


class AnArray(Balls):
    def place(self, key: int) -> Any:
        return np.zeros(3), 0.0, 0.0


class TooManyValues(Balls):
    def place(self, key: int) -> Any:
        return 1.0, 2.0, 3.0, 4.0


class WrongType(Balls):
    def label(self, key: int) -> Any:
        return 7, None


class NotThere(Balls):
    def label(self, key: int) -> Any:
        return None, None


class Moving(Balls):
    def place(self, key: int) -> Any:
        self.world.source.balls[key].x += 0.5
        return super().place(key)


class Undead(Balls):
    def place(self, key: int) -> Any:
        return super().place(key) if key in self.world.source.balls else (0.0, 0.0, 0.0)


class KeyErrors(Balls):
    def place(self, key: int) -> Any:
        ball = self.world.source.balls[key]
        return ball.x, ball.y, ball.z


class Careless(Balls):
    def keys(self, where: Any) -> list[int]:
        one = where.equal("name")
        return [key for key in super().keys(where) if one is None or self.world.source.balls[key].name is one]


class WrongOrder(Points):
    def place(self, keys: list[int]) -> Any:
        return self.world.points[sorted(keys)].T


class NoGroup(Balls):
    groups = {"label": "name colour", "place": "x y z", "dynamics": "mass heavy"}


class NoMethod(Balls):
    groups = {**Balls.groups, "nothing": "pos"}


class Stranger(Near):
    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> list[int]:
        return [*super().rows(x, y, z, radius), 12345]


class Raising(Gaps):
    def rows(self, id: int, most: float = 1e9) -> Any:
        raise RuntimeError("no contact")


class Twins(Near):
    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> list[int]:
        return super().rows(x, y, z, radius) * 2


class Growing(Gaps):
    def rows(self, id: int, most: float = 1e9) -> Any:
        self.world.source.balls[id].x += 1.0
        return super().rows(id, most)


class Placed(Balls):
    places = {"this": "x y z"}


class Crooked(BallWorld):
    """It measures the wrong way."""

    tables = (Placed,)

    @function
    def distance(self, one: Any, other: Any) -> float:
        return 1.5


class Forgetting(Balls):
    """After a while one ball is not there any more, though nobody has removed it."""

    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return (
            found
            if self.world.source.calls["keys"] < 300
            else [key for key in found if key != min(self.world.source.balls)]
        )


class Dying(BallWorld):
    tables = (Forgetting,)


class Counting(BallWorld):
    count = 0

    @function
    def ticks(self, ball: int) -> int:
        self.count += 1
        return self.count


NOT_MISSED = "missing arguments are an error"


class Generator(Near):
    """Its rows come one by one, which is allowed."""

    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> Iterator[int]:  # type: ignore[override]
        yield from super().rows(x, y, z, radius)


BROKEN_TABLES: list[tuple[type[Table], str]] = [
    (TooFew, "keys are never too few"),
    (Disorder, "keys keep one order"),
    (Twice, "keys are unique"),
    (Unhashable, "keys are hashable"),
    (Restless, "keys are the same each time"),
    (Failing, "keys can be listed"),
    (NotANumber, "values fit their columns"),
    (AnArray, "values fit their columns"),
    (TooManyValues, "values fit their columns"),
    (WrongType, "values fit their columns"),
    (NotThere, "values fit their columns"),
    (Moving, "reading changes nothing"),
    (Undead, "the dead raise Gone"),
    (KeyErrors, "the dead raise Gone"),
    (NoGroup, "declarations hold together"),
    (NoMethod, "declarations hold together"),
]
BROKEN_FUNCTIONS: list[tuple[type[TableFunction], str]] = [
    (Stranger, "table functions give keys of their table"),
    (Twins, "keys are unique"),
    (Raising, "table functions give rows that fit"),
    (Growing, "reading changes nothing"),
]
BROKEN_WORLDS: list[tuple[Callable[[], Any], str]] = [
    (object, "there is an adapter"),
    (lambda: type("Broken", (ArrayWorld,), {"tables": (WrongOrder,)})(), "arrays are in the order of their keys"),
    (lambda: Counting(Box.row(2)), "functions keep what they declare"),
    (lambda: Crooked(Box.random(4, 9)), "places are true"),
    (lambda: Dying(Box.random(4, 9)), "queries see what is there"),
]


@pytest.mark.parametrize(("table", "rule"), BROKEN_TABLES)
def test_a_broken_rule_is_named(table: type[Table], rule: str) -> None:
    box = Box.random(2, 12)
    world = type("Broken", (BallWorld,), {"tables": (table, Near)})(box)
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(world, queries=8, change=box.change)
    assert caught.value.rule == rule
    assert str(caught.value).startswith(f"{rule}: ")


@pytest.mark.parametrize(("table", "rule"), BROKEN_FUNCTIONS)
def test_a_broken_table_function_is_named(table: type[TableFunction], rule: str) -> None:
    world = type("Broken", (BallWorld,), {"tables": (Balls, table)})(Box.row(4))
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(world, queries=8)
    assert caught.value.rule == rule


def test_rows_may_be_generated() -> None:
    world = type("Lazy", (BallWorld,), {"tables": (Balls, Generator)})(Box.row(4))
    ss2sql.check_world(world, queries=8)


@pytest.mark.parametrize(("make", "rule"), BROKEN_WORLDS)
def test_a_broken_world_is_named(make: Callable[[], Any], rule: str) -> None:
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(make(), queries=200)
    assert caught.value.rule == rule


def test_arguments_that_nobody_missed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The session itself asks for them; no adapter can talk it out of that."""
    monkeypatch.setattr(Questions, "missing_arguments", lambda *_: "missing")
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(BallWorld(Box.row(2)), queries=1)
    assert caught.value.rule == NOT_MISSED


def test_every_rule_has_something_that_breaks_it() -> None:
    """The rules are those that the judge names in its own text."""
    with open(conformance.__file__, encoding="utf-8") as file:
        calls = [node for node in ast.walk(ast.parse(file.read())) if isinstance(node, ast.Call)]
    judged = [
        call for call in calls if isinstance(call.func, ast.Name) and call.func.id in ("BrokenRuleError", "_refused")
    ]
    rules = {str(call.args[0].value) for call in judged if isinstance(call.args[0], ast.Constant)}
    broken = {rule for _, rule in (*BROKEN_TABLES, *BROKEN_FUNCTIONS, *BROKEN_WORLDS)} | {NOT_MISSED}
    assert broken == rules
    assert len(rules) > 15


def test_filters_that_go_wrong_only_together_are_found() -> None:
    class Forgetful(Balls):
        def keys(self, where: Any) -> list[int]:
            both = where.equal("id") is not None and where.low("x") > float("-inf")
            return [] if both else super().keys(where)

    world = type("Broken", (BallWorld,), {"tables": (Forgetful,)})(Box.random(3, 10))
    with pytest.raises(ss2sql.BrokenRuleError, match="keys are never too few"):
        ss2sql.check_world(world, queries=200)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"columns": (Column("id", int), Column("id", int))}, "two columns are called 'id'"),
        ({"columns": (Column("id", int), Column("no name", int))}, "no name"),
        ({"columns": (Column("id", int), Column("x", complex))}, "is no type of a column"),
        ({"columns": (Column("id", int, filter="=="),)}, "cannot be filtered by '=='"),
        ({"key": "number"}, "its key 'number' is no column"),
        ({"groups": {"x": "y"}}, "has no method of this name"),
    ],
)
def test_declarations_that_cannot_be_are_refused_when_attached(changes: dict[str, Any], text: str) -> None:
    plain = {"name": "things", "key": "id", "columns": (Column("id", int),), "keys": lambda self, where: [1]}
    world = type("Odd", (World,), {"tables": (type("Things", (Table,), plain | changes),)})
    ss = ss2sql.connect()
    with pytest.raises(SessionError, match=text) as caught:
        ss.attach("space", world())
    assert caught.value.code == "S002"
    assert ss.eval("1 + 1;") == 2


# --- values on their way out ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("declared", "given", "value"),
    [
        (float, np.float32(1.5), 1.5),
        (float, 3, 3.0),
        (int, np.int64(7), 7),
        (bool, np.bool_(True), True),
        (str, np.str_("a"), "a"),
        (int | None, None, None),
        (int | None, np.int8(3), 3),
        (float | None, 2, 2.0),
        (list, np.arange(3), [0, 1, 2]),
        (list, (1, (2, 3)), [1, [2, 3]]),
        ((float, float), np.array([1, 2]), [1.0, 2.0]),
        ((int, str), (1, "a"), [1, "a"]),
        (dict, {"a": np.int32(1)}, {"a": 1}),
        (object, [None, 1.5], [None, 1.5]),
        (int | str, "x", "x"),
    ],
)
@pytest.mark.parametrize("engine", ["database", "native"])
def test_values_fit_their_declaration(declared: Any, given: Any, value: Any, engine: Any) -> None:
    found = one_value(declared, given, engine)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("declared", "given"),
    [
        (float, np.array([1.0])),
        (float, "1"),
        (float, True),
        (float, None),
        (float, float("inf")),
        (float, 1e101),
        (int, 1.0),
        (int, 2**63),
        (bool, 1),
        (str, 1),
        (str, "\ud800"),
        (list, "text"),
        ((float, float), (1.0,)),
        ((float, float), 1.0),
        (int | None, "1"),
        (int | str, 1.5),
    ],
)
@pytest.mark.parametrize("engine", ["database", "native"])
def test_values_that_do_not_fit_are_refused_by_name(declared: Any, given: Any, engine: Any) -> None:
    with pytest.raises(ss2sql.ExecutionError, match="the column 'value' of things holds") as caught:
        one_value(declared, given, engine)
    assert caught.value.code == "X004"


def one_value(declared: Any, given: Any, engine: Any) -> Any:
    class Things(Table):
        name = "things"
        columns = (Column("value", declared),)
        groups = {"value": "value"}

        def keys(self, where: Any) -> list[Any]:
            return [("a", 1)]

        def value(self, key: Any) -> Any:
            assert key == ("a", 1)
            return given

    class One(World):
        tables = (Things,)

    ss = ss2sql.connect()
    ss.attach("things", One())
    return ss.run("SELECT value FROM things AS value;", engine=engine).value
