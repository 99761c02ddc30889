"""check_world: it passes for a good adapter, and names the broken rule of each bad one."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable
from typing import Any

import pytest
from adapters import BROKEN_FUNCTIONS, BROKEN_TABLES, BROKEN_WORLDS, NOT_MISSED, ArrayWorld, Generator
from balls import Balls, BallWorld, Box, Near
from sessions import both

import ss2sql
from ss2sql.errors import SessionError
from ss2sql.vtables import Column, Table, TableFunction, World, conformance
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


@both
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
