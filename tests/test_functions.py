"""Python functions in scripts: registration, names, and functions in place of built-in ones."""

from __future__ import annotations

import math
from typing import Any

import pytest
from listings import ROBOT
from sessions import both

import ss2sql

# --- registration --------------------------------------------------------------------------------------


def test_the_forms_of_registration(ss: ss2sql.Session) -> None:
    @ss.function
    def one(x):
        return x + 1

    @ss.function()
    def two(x):
        return x + 2

    @ss.function("drei", volatility="immutable")
    def three(x):
        return x + 3

    @ss.function(volatility="stable")
    def four(x):
        return x + 4

    def five(x):
        return x + 5

    assert ss.function("fünf", five) is five
    assert ss.function(five) is five
    assert (one(1), two(1), three(1), four(1)) == (2, 3, 4, 5)
    ss.function("hyp", math.hypot)
    assert ss.eval("[one(1), two(1), drei(1), four(1), fünf(1), five(1), hyp(3, 4)];") == [2, 3, 4, 5, 6, 6, 5.0]
    assert [ss.host.functions[name].volatility for name in ("one", "drei", "four")] == [
        "immutable",
        "immutable",
        "stable",
    ]


def test_volatility_is_inferred_from_the_source(ss: ss2sql.Session) -> None:
    seen = []

    @ss.function
    def pure(x):
        return [y * 2 for y in x]

    @ss.function
    def changes_its_argument(x):
        x.append(1)
        return x

    @ss.function
    def remembers(x):
        seen.append(x)
        return x

    ss.function("unreadable", eval("lambda x: x"))
    words = {name: entry.volatility for name, entry in ss.host.functions.items()}
    assert words == {
        "pure": "immutable",
        "changes_its_argument": "immutable",
        "remembers": "volatile",
        "unreadable": "volatile",
    }
    assert all(entry.inferred and entry.reason for entry in ss.host.functions.values())


def test_the_number_of_arguments_is_that_of_the_signature(ss: ss2sql.Session) -> None:
    ss.function("two", lambda a, b=10, *, c=100: a + b + c)
    ss.function("many", lambda a, *rest: [a, *rest])
    assert ss.eval("[two(1), two(1, 2), many(1), many(1, 2, 3, 4, 5)];") == [111, 103, [1], [1, 2, 3, 4, 5]]
    for call, words in (("two()", "takes 1 to 2 arguments, not 0"), ("two(1, 2, 3)", "1 to 2 arguments, not 3"),
                        ("many()", "takes 1 or more arguments, not 0")):  # fmt: skip
        with pytest.raises(ss2sql.ResolveError, match=words) as caught:
            ss.run(f"SELECT {call} FROM [1];")
        assert caught.value.code == "R005"
        assert caught.value.span is not None
        assert caught.value.span.text == call


def test_what_cannot_be_registered(ss: ss2sql.Session) -> None:
    class Nameless:
        def __call__(self, x):
            return x

    for arguments, named in (
        (("1x", lambda x: x), {}),
        (("f", 3), {}),
        (("f", lambda x: x), {"volatility": "pure"}),
        (("f", lambda *, key: key), {}),
        ((Nameless(),), {}),
        ((lambda x: x,), {}),
    ):
        with pytest.raises(ss2sql.SessionError) as caught:
            ss.function(*arguments, **named)
        assert caught.value.code == "S002"
    ss.function("named", Nameless())
    assert ss.eval("named(3);") == 3


# --- in place of built-in ones -------------------------------------------------------------------------


@both
def test_operators_can_be_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
    ss.function("lt", lambda a, b: len(a) < len(b))
    ss.function("in", lambda a, b: a == b[-1])
    ss.function("neg", lambda a: a[::-1])
    script = "SELECT this + [10, 20], -this, this < [1, 2, 3], 5 IN this, 1 + 2 FROM [[1, 2], [3, 5]] AS rows;"
    assert ss.run(script, engine=engine).value == [
        ([11, 22], [2, 1], True, False, 3),
        ([13, 25], [5, 3], True, True, 3),
    ]
    assert ss.run("SELECT this NOT IN [5, 6] FROM [5, 6] AS list;", engine=engine).value in (
        [False, False],
        [True, False],
    )


@both
def test_equality_of_groups_and_searches_stays_the_languages(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("eq", lambda a, b: True)
    assert ss.run("SELECT this FROM [1, 2] WHERE this == 7 AS list;", engine=engine).value == [1, 2]
    assert ss.run("SELECT this, count(*) FROM [1, 2] GROUP BY this AS rows;", engine=engine).value == [(1, 1), (2, 1)]
    search = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this;"
    assert ss.run(search, engine=engine).paths == [[(1,)], [(2,)]]


@both
def test_built_in_functions_can_be_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("max", lambda x: ["mine", x])
    ss.function("len", lambda x: -1)
    assert ss.run("SELECT max(this), len(this) FROM ['ab'] AS rows;", engine=engine).value == [(["mine", "ab"], -1)]
    ss.function("max", lambda x: x * 100, volatility="immutable")
    script = "SELECT max(this), min(this) FROM [1, 2, 1] GROUP BY max(this) AS rows;"
    assert ss.run(script, engine="auto" if engine == "database" else engine).value == [(100, 1), (200, 2)]


def test_the_robot_listing_adds_vectors() -> None:
    with ss2sql.connect() as ss:
        walls = {(9, 8), (10, 8), (11, 8)}
        sounds: list[str] = []
        at = [10.0, 7.0]

        @ss.function("move", volatility="volatile")
        def move(robot, target):
            at[:] = target
            return target

        ss.function("position", lambda robot: [10.0, 7.0], volatility="stable")
        ss.function("checkCollision", lambda robot: tuple(at) in walls, volatility="volatile")
        ss.function("playSound", lambda file: sounds.append(file), volatility="volatile")
        ss.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
        result = ss.run(ROBOT.replace("MEMORIZE 20 MAXIMUM 1000", "MEMORIZE 6 MAXIMUM 10"))
        assert result.engine == "native"
        assert result.value[0][-1] == [10.0, 9.0]
        lengths = list(map(len, result.value))
        assert lengths == sorted(lengths)
        assert lengths[0] == 4  # two to the side of the wall and back again: 8.., 9..
        assert all(tuple(place) not in walls for path in result.value for place in path)
        assert set(sounds) == {"/usr/share/sounds/ubuntu/stereo/bell.ogg"}


# --- names ---------------------------------------------------------------------------------------------

WORDS_OF_SQL = ["table", "order", "where", "join", "null", "cast", "case", "match", "like", "glob", "abs", "round",
                "total", "coalesce", "iif", "likelihood", "row_number", "avg", "raise", "Values", "CURRENT_TIME",
                "default"]  # fmt: skip
HELPERS = ["list", "record", "truth", "in_turn", "field", "elements", "search", "next_step", "keep", "on_path", "reach",
           "reached", "collect", "collect_rows", "group_sum", "list_max", "count", "sum", "item", "slice"]  # fmt: skip


@both
@pytest.mark.parametrize("name", [*WORDS_OF_SQL, *HELPERS])
def test_functions_may_have_any_name(ss: ss2sql.Session, engine: Any, name: str) -> None:
    ss.function(name, lambda *arguments: 100 + sum(arguments), volatility="immutable")
    script = f"""SELECT {name}(this, 1), {name}(5) FROM [1, 2] WHERE {name}(this) > 101
    START WITH n = 1 CONNECT BY n = n + {name}(n) STOP WITH n > 1 AS rows;"""
    assert ss.run(script, engine=engine).value == [[(102, 105), (103, 105)], [(103, 105)], [(103, 105), (103, 105)]]


@both
def test_names_that_differ_in_case_are_different_functions(ss: ss2sql.Session, engine: Any) -> None:
    names = ("f", "F", "keep", "Keep", "KEEP", "keep_2", "count", "Count")
    for number, name in enumerate(names):
        ss.function(name, lambda x, number=number: x + 10**number, volatility="immutable")
    calls = ", ".join(f"{name}(this)" for name in names)
    assert ss.run(f"SELECT {calls} FROM [0] AS list;", engine=engine).value == [10**number for number in range(8)]
