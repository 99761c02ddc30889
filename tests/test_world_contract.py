"""check_world: it passes for a good adapter, and names the broken rule of each bad one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from adapters import BROKEN_TABLES, BROKEN_WORLDS, ArrayWorld
from balls import Balls, BallWorld, Box, Near
from programs.drawn import amount

import ss2sql
from ss2sql.errors import SessionError
from ss2sql.vtables import Column, Table, TableFunction, World

QUERIES = amount(0.1)


@pytest.mark.drawn
def test_a_good_adapter_passes() -> None:
    box = Box.random(1, 25)
    arguments = {"gaps": [(min(box.balls),)], "near": [(0.0, 0.0, 0.0), (1, 1, 0, 4.0)]}
    for given in (None, arguments):
        report = ss2sql.check_world(BallWorld(box), seed=1, queries=QUERIES, change=box.change, arguments=given)
        assert (report.queries, report.elements, report.skipped) == (QUERIES, {"balls": 25}, [])
    assert ss2sql.check_world(BallWorld(Box()), queries=10).elements == {"balls": 0}


def test_a_world_of_many_elements_is_judged_with_a_warning() -> None:
    """The rules look at each element a few times; random queries join tables with each other."""
    with pytest.warns(UserWarning, match=r"5,000 elements.* at most 200 .* queries=0"):
        report = ss2sql.check_world(BallWorld(Box.row(5000)), queries=0)
    assert report.elements == {"balls": 5000}


def test_arguments_can_be_given_and_rows_generated() -> None:
    class Odd(TableFunction):
        name, columns = "odd", (Column("n", int),)

        def rows(self, what: str) -> Iterator[tuple[int]]:
            yield (len(what),)

    class Generator(Near):
        def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> Iterator[int]:  # type: ignore[override]
            yield from super().rows(x, y, z, radius)

    world = type("OddWorld", (BallWorld,), {"tables": (Balls, Odd, Generator)})(Box.row(3))
    assert ss2sql.check_world(world, queries=5).skipped == ["odd"]
    assert ss2sql.check_world(world, queries=5, arguments={"odd": [("abc",)]}).skipped == []


def test_arrays_pass_and_are_asked_for_once(ss: ss2sql.Session, engine: Any) -> None:
    ss2sql.check_world(ArrayWorld(), queries=20)
    world = ArrayWorld()
    ss.attach("space", world)
    script = "SELECT a.x, b.y FROM a = space, b = space WHERE a.id == b.id AND a.kind == 1 AS rows;"
    found = ss.run(script, engine=engine).value
    assert found == [(2.0 * n, 2.0 * n + 1) for n in (1, 4, 7, 10)]
    assert {type(part) for row in found for part in row} == {float}
    assert world.calls == 1


# --- adapters that break a rule ------------------------------------------------------------------------


def broken(table: type[Any], methods: dict[str, Any]) -> World:
    """Balls with a table that breaks a rule."""
    changed = type("Broken", (table,), methods)
    tables = (changed, Near) if issubclass(table, Balls) else (Balls, changed)
    world: World = type("Broken", (BallWorld,), {"tables": tables})(Box.random(2, 12))
    return world


@pytest.mark.parametrize(
    ("table", "methods", "rule"), [found[1:] for found in BROKEN_TABLES], ids=[found[0] for found in BROKEN_TABLES]
)
def test_a_broken_rule_is_named(table: type[Any], methods: dict[str, Any], rule: str) -> None:
    world = broken(table, methods)
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(world, queries=200, change=world.source.change)
    assert caught.value.rule == rule
    assert str(caught.value).startswith(f"{rule}: ")


@pytest.mark.parametrize(
    ("make", "rule"), [found[1:] for found in BROKEN_WORLDS], ids=[found[0] for found in BROKEN_WORLDS]
)
def test_a_broken_world_is_named(make: Callable[[], Any], rule: str) -> None:
    with pytest.raises(ss2sql.BrokenRuleError) as caught:
        ss2sql.check_world(make(), queries=200)
    assert caught.value.rule == rule


@pytest.mark.parametrize(
    ("changes", "text"),
    [({"columns": (Column("id", int), Column("id", int))}, "two columns are called 'id'"),
     ({"columns": (Column("id", int), Column("no name", int))}, "no name"),
     ({"columns": (Column("id", int), Column("x", complex))}, "is no type of a column"),
     ({"columns": (Column("id", int, filter="=="),)}, "cannot be filtered by '=='"),
     ({"key": "number"}, "its key 'number' is no column"), ({"groups": {"x": "y"}}, "has no method of this name"),
     ({"blocks": {"place": "pos(x y) name"}}, "'pos' is no list of 2 plain values"),
     ({"blocks": {"place": "pos(x=name y z)"}}, "x and name are the same value, and of different types"),
     ({"blocks": {"place": "pos(x y z=y)"}}, "the column 'y' is given twice"),
     ({"blocks": {"place": "pos(x y z"}}, "does not name columns"),
     ({"blocks": {"place": "pos(x(y) z)"}}, "does not name columns")],
)  # fmt: skip
def test_declarations_that_cannot_be_are_refused_when_attached(changes: dict[str, Any], text: str) -> None:
    columns = Column("name", str), Column("pos", (float, float, float)), *(Column(axis, float) for axis in "xyz")
    plain = {"name": "things", "key": "id", "columns": (Column("id", int),), "keys": lambda self, where: [1]}
    if "blocks" in changes:
        plain |= {"columns": (*plain["columns"], *columns), "place": lambda self, keys: []}
    world = type("Odd", (World,), {"tables": (type("Things", (Table,), plain | changes),)})
    ss = ss2sql.connect()
    with pytest.raises(SessionError, match=text) as caught:
        ss.attach("space", world())
    assert caught.value.code == "S002"
    assert ss.eval("1 + 1;") == 2
