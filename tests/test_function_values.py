"""Python functions in scripts: what they get, which nobody else sees them change, and what comes back."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import pytest
from cases.functions import moved
from listings import MOVES, move
from random_values import Thing, Unhashable

import ss2sql

HANOI = """SELECT this, tower FROM moves WHERE [[], [], [3, 2, 1]] == move(this, tower)
START WITH tower = [[3, 2, 1], [], []], level = 1
CONNECT BY {option} tower = move(this, tower), level = level + 1
STOP WITH level == 8 OR [] == move(this, tower);"""
FLAT = """SELECT a.this, move(a.this, start), move(b.this, move(a.this, start)), start FROM a = moves, b = moves
WHERE [] != move(a.this, start) AND len(move(b.this, move(a.this, start))) == 3 AS rows;"""
START = "start = [[3, 2, 1], [], []]; "


@pytest.mark.parametrize("volatility", ["immutable", "volatile"])
@pytest.mark.parametrize("disable", [(), ("memo",)])
@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "MEMORIZE 8", "MAXIMUM 1"])
def test_a_function_that_changes_its_argument_and_its_pure_twin_agree(
    engine: Any, volatility: Any, disable: tuple[str, ...], option: str
) -> None:
    if engine == "database" and ("MEMORIZE" in option or volatility == "volatile"):
        engine = "auto"
    answers = []
    for function in (move, moved):
        with ss2sql.connect(disable=disable) as ss:
            ss.attach("moves", MOVES)
            ss.function("move", function, volatility=volatility)
            answers.append((ss.run(HANOI.format(option=option), engine=engine).value, ss.eval(START + FLAT)))
    assert answers[0] == answers[1]
    paths, rows = answers[0]
    lengths = [len(path) for path in paths]
    # With UNIQUE each of the two moves that end the game, with the towers before it, is reached once.
    expected = {"UNIQUE": {7: 1, 8: 1}, "MAXIMUM 1": {8: 1}}.get(option, {7: 1, 8: 4})
    assert {length: lengths.count(length) for length in lengths} == expected
    assert all(row[3] == [[3, 2, 1], [], []] for row in rows)


def test_what_a_function_does_to_its_arguments_is_seen_by_nobody(ss: ss2sql.Session, engine: Any) -> None:
    thing = Thing()
    items: list[Any] = [[1], {"a": [2]}, [thing]]
    ss.attach("items", items)

    @ss.function(volatility="stable")
    def spoil(x, y):
        x[0 if isinstance(x, list) else "a"] = 9
        y.clear()
        return x

    result = ss.run("SELECT this, spoil(this, this), this FROM items AS rows;", engine=engine)
    assert result.value == [([1], [9], [1]), ({"a": [2]}, {"a": 9}, {"a": [2]}), ([thing], [9], [thing])]
    assert items == [[1], {"a": [2]}, [thing]]


def test_a_function_that_changes_nothing_gets_the_value_itself(ss: ss2sql.Session, engine: Any) -> None:
    """`same` is proven to change nothing, so it gets the value itself and gives it back."""

    @ss.function
    def same(x):
        return x

    @ss.function
    def grow(x):
        x[0].append(1)
        return x

    assert (ss.host.functions["same"].changes, ss.host.functions["grow"].changes) == (False, True)
    result = ss.run("SELECT grow(same(this)), same(this), this FROM [[[]], [[2]]] AS rows;", engine=engine)
    assert result.value == [([[1]], [[]], [[]]), ([[2, 1]], [[2]], [[2]])]

    class Sized(Unhashable):
        def __len__(self) -> int:
            return 3

    ss.function("length", lambda x: len(x))
    ss.attach("things", [[Sized()], Sized()])
    assert ss.run("SELECT length(this) FROM things AS list;", engine=engine).value == [1, 3]


def test_a_function_may_keep_what_it_got_and_gave(ss: ss2sql.Session, engine: Any) -> None:
    kept: list[Any] = []

    @ss.function(volatility="stable")
    def keep(x):
        kept.append(x)
        return x

    value = ss.run("SELECT keep(this) FROM [[1], [2]] AS list;", engine=engine).value
    for item in kept:
        item.append("changed")
    assert value == [[1], [2]]
    value[0].append("mine")
    assert kept == [[1, "changed"], [2, "changed"]]
    log: list[int] = []
    ss.function("log", lambda x: log.append(x) or log, volatility="volatile")
    engine = "native" if engine == "native" else "auto"
    assert ss.run("SELECT log(this) FROM [1, 2, 3] AS list;", engine=engine).value == [[1], [1, 2], [1, 2, 3]]


def test_objects_come_back_identical(ss: ss2sql.Session, engine: Any) -> None:
    objects = [Thing(), Unhashable(), Unhashable(), Thing, len, PurePath("a"), PurePath("a")]
    ss.attach("objects", objects)
    ss.function("same", lambda x: x)
    ss.function("boxed", lambda x: [{"object": x}])
    ss.function("is_one", lambda x: type(x) is Unhashable)
    result = ss.run("SELECT this, same(this), boxed(this), [this, 1.0] FROM objects AS rows;", engine=engine)
    for given, row in zip(objects, result.value, strict=True):
        assert row[0] is row[1] is row[2][0]["object"] is row[3][0] is given
    found = ss.run("SELECT this FROM objects WHERE is_one(this) AS list;", engine=engine).value
    assert [item is given for item, given in zip(found, objects[1:3], strict=True)] == [True, True]
    script = (
        "SELECT o FROM objects WHERE n == 2 START WITH o = 0, n = 0 CONNECT BY o = this, n = n + 1 STOP WITH n == 2;"
    )
    paths = ss.run(script, engine=engine).paths
    assert paths[0][2][0] is objects[0]


@pytest.mark.parametrize(
    "value",
    [True, False, 1, 1.0, -0.0, 0.1 + 0.2, 1e308, 5e-324, 2**63 - 1, -(2**63), 2.0**53 + 2, "", "ä\u2028\0x", "\ud800",
     None, [], [[]], [True, 1, 1.0], {"a": True, "b": [1.0]}, {}],
)  # fmt: skip
def test_values_are_exact_on_every_way(ss: ss2sql.Session, engine: Any, value: Any) -> None:
    ss.attach("x", [value])
    ss.function("same", lambda x: x)
    ss.function("given", lambda: value, volatility="stable")
    ss.function("arrived", lambda x: repr(x) == repr(value), volatility="immutable")
    script = "SELECT this, same(this), given(), [this][0], IF(True; this), arrived(this) FROM x AS rows;"
    assert repr(ss.run(script, engine=engine).value) == repr([(value, value, value, value, value, True)])
    nested = "SELECT y.this, z.this FROM y = (SELECT this FROM x AS list), z = [(SELECT this FROM x AS value)] AS rows;"
    assert repr(ss.run(nested, engine=engine).value) == repr([(value, value)])
    search = "SELECT s FROM x WHERE n == 1 START WITH s = x[0], n = 0 CONNECT BY s = this, n = n + 1 STOP WITH n == 1;"
    assert repr(ss.run(search, engine=engine).paths) == repr([[(value,), (value,)]])
