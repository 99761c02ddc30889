"""The reference against the language page: the maps, and the rules of sections 2 to 5 and 8 on small examples."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from reference import Failure, Reference

COLOURS = "colours = ['red', 'green', 'blue', 'yellow']; "
EIGHT = ["ab", "ac", "ad", "ae", "af", "bc", "bd", "bf", "bg", "cd", "cg", "ch", "de", "dh", "ef", "eh", "fg", "gh"]
FIVE = ["ab", "ac", "ad", "ae", "bc", "bd", "cd", "de"]


def run(script: str, **variables: Any) -> Any:
    return Reference(variables=variables).run(script)


# Maps


def sources(names: str) -> str:
    return ", ".join(f"{name} = colours" for name in names)


def columns(names: str) -> str:
    return ", ".join(f"{name}.this" for name in names)


def differ(borders: list[str]) -> str:
    return " AND ".join(f"{a}.this != {b}.this" for a, b in borders)


def test_eight_countries() -> None:
    found = run(f"{COLOURS} SELECT {columns('abcdefgh')} FROM {sources('abcdefgh')} WHERE {differ(EIGHT)} AS rows")
    assert len(found) == 48
    assert found[0] == ("red", "green", "blue", "yellow", "green", "blue", "yellow", "red")


LITERAL = "[" + ", ".join(f"[{a}.this, {b}.this]" for a, b in FIVE) + "]"
NAMES = "[" + ", ".join(f'["{a}", "{b}"]' for a, b in FIVE) + "]"
EVALUATED = 'eval(this[0] + ".this;") == eval(this[1] + ".this;")'


@pytest.mark.parametrize(
    ("before", "where"),
    [
        ("", differ(FIVE)),
        ("", f"[] == (SELECT this FROM {LITERAL} WHERE this[0] == this[1] AS list)"),
        (f"pairs = {LITERAL};", "[] == (SELECT this FROM pairs WHERE this[0] == this[1] AS list)"),
        (f"pairs = {NAMES};", f"[] == (SELECT this FROM pairs WHERE {EVALUATED} AS list)"),
    ],
    ids=["inequalities", "literal", "late", "eval"],
)
def test_five_countries_in_every_form(before: str, where: str) -> None:
    found = run(f"{COLOURS} {before} SELECT {columns('abcde')} FROM {sources('abcde')} WHERE {where} AS rows")
    expected = [
        colours
        for colours in itertools.product(["red", "green", "blue", "yellow"], repeat=5)
        if all(colours["abcde".index(a)] != colours["abcde".index(b)] for a, b in FIVE)
    ]
    assert found == expected
    assert len(found) == 48


def test_counting_and_logging_in_where() -> None:
    query = f"SELECT {columns('abcde')} FROM {sources('abcde')} WHERE"
    count = f"IF({differ(FIVE)}; positive = positive + 1, True; negative = negative + 1, False)"
    ref = Reference()
    ref.run(f"{COLOURS} positive = 0; negative = 0; {query} {count} AS void")
    assert (ref.variables["positive"], ref.variables["negative"]) == (48, 976)

    ref = Reference()
    ref.run(f'{COLOURS} n = 0; {query} print("log:", n = n + 1, {columns("abcde")}) != 0 AND {differ(FIVE)} AS void')
    assert len(ref.printed) == 1024
    assert ref.printed[1] == "log: 2 red red red red green"

    ref = Reference()
    ref.run(f'{COLOURS} {query} {differ(FIVE)} AND IF(a.this == "red"; print("red", b.this)) AS void')
    assert len(ref.printed) == 12


# Values and expressions


@pytest.mark.parametrize(
    ("script", "value"),
    [
        ("1 == 1.0", True),
        ("[10, 9] == [10.0, 9.0]", True),
        ("True == 1", True),
        ("[] != [[]]", True),
        ('"1" != 1', True),
        ("[2] IN [[1], [2.0]]", True),
        ('"an" IN "banana"', True),
        ("3 NOT IN [1, 2]", True),
        ("-2 ^ 2", -4),
        ("2 ^ 3 ^ 2", 512),
        ("2 ^ -1", 0.5),
        ("-7 % 3", 2),
        ("7 / 2", 3.5),
        ("[1] + [2]", [1, 2]),
        ('"a" + "b"', "ab"),
        ("True + True", 2),
        ("[1, [2, 3]][1, 0]", 2),
        ("[1, 2, 3][-1]", 3),
        ("[1, 2, 3][1:]", [2, 3]),
        ("[1, 2] < [1, 3]", True),
        ("0 OR [] OR 2", True),
        ("1 XOR 2", False),
        ("NOT []", True),
        ("False AND 1 / 0", False),
        ("IF(1; 2, 3; 4)", 3),
        ("IF(0; 2)", False),
        ("IF(1;; 4)", True),
        ("x = (y = 4) + 1; [x, y]", [5, 4]),
        ("average([1, 2])", 1.5),
        ("sum([0.1, 0.2, 0.3])", 0.6),
        ("max([])", None),
        ("uniq([1, 1.0, [1], [True], 2])", [1, [1], 2]),
        ("zip([1, 2], [3, 4])", [[1, 3], [2, 4]]),
        ("round(2.5)", 2),
        ("distance([0, 0], [3, 4])", 5.0),
        ("mod(7, 4) + neg(1)", 2),
        ('eval("1 + " + str(2))', 3),
    ],
)
def test_expression(script: str, value: object) -> None:
    result = run(script)
    assert result == value
    assert type(result) is type(value)


@pytest.mark.parametrize(
    ("code", "script"),
    [
        ("X001", '1 < "a"'),
        ("X001", "None < 1"),
        ("X001", "1 + None"),
        ("X001", "1 IN 1"),
        ("X002", "1 / 0"),
        ("X002", "1.5 % 0"),
        ("X003", "[1][1]"),
        ("X004", "9223372036854775807 + 1"),
        ("X004", "1e308 * 10"),
        ("X004", "(-1) ^ 0.5"),
        ("X004", "9 ^ 9 ^ 9"),
        ("X007", "sqrt(-1)"),
        ("X007", 'int("one")'),
        ("X007", "max(3)"),
        ("X006", "SELECT this FROM [1] LIMIT -1"),
        ("R001", "unknown"),
        ("R002", "unknown(1)"),
        ("R003", "SELECT this FROM unknown"),
        ("R004", "SELECT k FROM a = rows, b = rows"),
        ("R005", "len()"),
        ("R006", "SELECT this FROM [1] AS unknown"),
        ("R007", "SELECT this FROM [1] START WITH x = 1 CONNECT BY x = 2 STOP WITH (x = 2) > 1"),
        ("R008", "SELECT this FROM [1] WHERE count(*) > 1"),
        ("R010", "SELECT this FROM [1] START WITH x = 1 CONNECT BY DEPTH FIRST MEMORIZE x = 2"),
        ("R011", "late = [a.this]; SELECT this FROM late"),
        ("R012", "SELECT this FROM [1] STOP WITH True"),
        ("R013", "SELECT 1 FROM a = [1], a = [2]"),
    ],
)
def test_failure(code: str, script: str) -> None:
    with pytest.raises(Failure) as caught:
        run(script, rows=[{"k": 1}])
    assert caught.value.code == code


def test_functions_of_the_user() -> None:
    def spoil(values: list[int]) -> list[int]:
        values.append(9)
        return values

    functions = {
        "spoil": spoil,
        "pair": lambda x: (x, [x, x]),
        "bag": lambda: {3, 1, 2},
        "array": lambda: np.array([1.5, 2.0]),
        "nan": lambda: float("nan"),
        "huge": lambda: 2**63,
        "broken": lambda: [][1],
        "mass": lambda x: 2 * x,
        "add": lambda a, b: [a, b],
    }
    ref = Reference(functions)
    assert ref.run("x = [1]; [spoil(x), x, spoil(x)]") == [[1, 9], [1], [1, 9]]
    assert ref.run("[pair(1), bag(), array()]") == [[1, [1, 1]], [1, 2, 3], [1.5, 2.0]]
    assert ref.run("1 + 2") == [1, 2]
    assert ref.run("SELECT mass FROM [1, 2] ORDER BY mass DESC") == [{"mass": 4}, {"mass": 2}]
    assert ref.calls == {"spoil": 2, "pair": 1, "bag": 1, "array": 1, "add": 1, "mass": 4}
    for name in ("nan", "huge"):
        with pytest.raises(Failure, match="X004"):
            ref.run(f"{name}()")
    with pytest.raises(IndexError):
        ref.run("broken()")


# Queries

ROWS = [{"k": "a", "v": 3}, {"k": "b", "v": None}, {"v": 1, "w": 2.5}]


def test_product_names_and_star() -> None:
    assert run("SELECT a.this, b.this FROM a = [1, 2], b = [3, 4] AS list") == [1, 3, 1, 4, 2, 3, 2, 4]
    assert run("SELECT this, a.this + b.this FROM a = [1], b = [3]") == [{"this": 1, "a.this + b.this": 4}]
    assert run("SELECT len(this), to(this, n), this, this FROM ['x']") == [
        {"len": 1, "n": "x", "this": "x", "this_2": "x"}
    ]
    assert run("SELECT * FROM r, b = [7]", r=ROWS)[2] == {"k": None, "v": 1, "w": 2.5, "b": 7}
    assert run("SELECT * FROM [1]") == [{"this": 1}]
    assert run("SELECT k, r.v, this FROM r AS rows", r=ROWS[:1]) == [("a", 3, {"k": "a", "v": 3})]


def test_sources() -> None:
    assert run("SELECT x, y FROM c AS rows", c={"x": [1, 2], "y": ["p", "q"]}) == [(1, "p"), (2, "q")]
    assert run("SELECT x FROM c AS list", c={"x": [1, 2], "y": 5}) == [[1, 2]]
    assert run("SELECT this FROM c AS list", c=None) == [None]
    assert run("SELECT v FROM (SELECT v, k FROM r WHERE v) AS list", r=ROWS) == [3, 1]
    assert Reference(tables={"t": ROWS}).run("SELECT v FROM t WHERE k == 'a' AS value") == 3
    assert run("SELECT this, b.this FROM a = [1, 2], b = range(a.this) AS rows") == [(1, 0), (2, 0), (2, 1)]


def test_unrelated_sources_are_read_once() -> None:
    ticks = itertools.count()
    ref = Reference({"tick": lambda: [next(ticks)], "near": lambda x: [x, -x]})
    assert ref.run("SELECT b.this, c.this FROM a = [1, 2], b = tick(), c = near(a.this) AS list") == [
        0,
        1,
        0,
        -1,
        0,
        2,
        0,
        -2,
    ]
    assert ref.calls == {"tick": 1, "near": 2}


def test_nested_queries_see_the_outer_row() -> None:
    script = "SELECT this, (SELECT this FROM [1, 2, 3] WHERE this < a.this AS list) FROM a = [2, 3] AS list"
    assert run(script) == [2, [1], 3, [1, 2]]


def test_order_and_limit() -> None:
    values = [2, None, 1.0, 1, 3]
    assert run("SELECT this FROM x ORDER BY this AS list", x=values) == [None, 1.0, 1, 2, 3]
    assert run("SELECT this FROM x ORDER BY this DESC LIMIT 4 AS list", x=values) == [3, 2, 1.0, 1]
    assert run("SELECT 1 / this FROM [1, 0] LIMIT 1 AS list") == [1.0]
    with pytest.raises(Failure, match="X001"):
        run("SELECT this FROM [1, 'a'] ORDER BY this")


def test_groups() -> None:
    x = [1, 2, 3, 4, 5]
    script = "SELECT this % 2, sum(this), count(*) FROM x GROUP BY this % 2 {} AS rows"
    assert run(script.format(""), x=x) == [(1, 9, 3), (0, 6, 2)]
    assert run(script.format("HAVING count(*) < 3"), x=x) == [(0, 6, 2)]
    assert run(script.format("ORDER BY sum(this) LIMIT 1"), x=x) == [(0, 6, 2)]
    assert run("SELECT count(v), average(v), min(v) FROM r GROUP BY k == 'b' AS rows", r=ROWS) == [
        (2, 2.0, 1),
        (0, None, None),
    ]
    assert run("SELECT this FROM x GROUP BY this % 2 AS list", x=x) == {1: [1, 3, 5], 0: [2, 4]}
    assert run("SELECT this FROM x GROUP BY this % 2, [this > 2] ORDER BY this DESC LIMIT 3 AS list", x=x) == {
        (1, (True,)): [5, 3],
        (0, (True,)): [4],
    }
    assert run("SELECT this FROM x GROUP BY this % 2 HAVING sum(this) > 6 AS list", x=x) == {1: [1, 3, 5]}
    assert run("SELECT this FROM [1.0, True, 1] GROUP BY this AS list") == [1.0]


def test_representations() -> None:
    query = "SELECT this, [this] FROM [1, 2] AS "
    assert run(query + "dict") == [{"this": 1, "[this]": [1]}, {"this": 2, "[this]": [2]}]
    assert run(query + "LIST") == [1, [1], 2, [2]]
    assert run(query + "rows") == [(1, [1]), (2, [2])]
    assert run(query + "val") == run(query + "value") == 1
    assert run(query + "set") == {1, (1,), 2, (2,)}
    assert run(query + "void") is None
    assert run("SELECT this FROM [] AS value") is None


# Temporal variables


def test_temporal_variables() -> None:
    ref = Reference()
    now = 0.0
    ref.clock = lambda: now
    for now in (0.0, 1.0, 4.0):  # noqa: B007 - the clock reads it
        ref.run("v{5.0} = getTime()")
    assert ref.run("[v, v{}, v{-3.0}, v{-2.0}, v{0.5}, v{9.0}]") == [
        4.0,
        [0.0, 1.0, 4.0],
        [0.0, 1.0, 4.0],
        [1.0, 4.0],
        0.0,
        4.0,
    ]
    now = 7.0
    assert ref.run("[v{}, v{0.5}]") == [[1.0, 4.0], None]
    now = 99.0
    assert ref.run("[v, v{}]") == [4.0, [4.0]]
