"""The reference against section 6 of the language page: the counts of Hanoi, and every order on a small graph."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from listings import move
from reference import Failure, Reference

MOVES = "moves = [[0,1], [0,2], [1,0], [1,2], [2,0], [2,1]]; "

# Towers of Hanoi


def hanoi(option: str, level: int) -> Reference:
    """Three disks; the reference that ran keeps the result in its variable `found`."""
    ref = Reference({"move": move})
    ref.run(
        MOVES + "found = SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower) "
        "START WITH tower = [[3,2,1],[],[]], level = 1 "
        f"CONNECT BY {option} tower = move(this, tower), level = level + 1 "
        f"STOP WITH level == {level} OR [] == move(this, tower)"
    )
    return ref


def lengths(ref: Reference) -> dict[int, int]:
    return dict(Counter(len(path) for path in ref.variables["found"]))


@pytest.mark.parametrize(
    ("option", "level", "expected"),
    [
        ("", 7, {7: 1}),
        ("", 8, {7: 1, 8: 4}),
        ("", 9, {7: 1, 8: 4, 9: 23}),
        ("NO CYCLE", 7, {7: 1}),
        ("NO CYCLE", 8, {7: 1, 8: 4}),
        ("NO CYCLE", 9, {7: 1, 8: 4, 9: 16}),
        ("MEMORIZE 7", 99, {7: 1}),
        ("MEMORIZE 8", 99, {7: 1, 8: 4}),
        ("MEMORIZE 9", 99, {7: 1, 8: 4, 9: 16}),
        ("MEMORIZE 12", 99, {7: 1, 8: 4, 9: 16, 10: 50, 11: 147, 12: 382}),
    ],
)
def test_hanoi_counts(option: str, level: int, expected: dict[int, int]) -> None:
    assert lengths(hanoi(option, level)) == expected


def test_hanoi_generates_the_steps_of_the_page() -> None:
    assert hanoi("", 7).steps == 3462
    assert hanoi("BREADTH FIRST", 7).steps == 3462


@pytest.mark.parametrize(
    "option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1", "MEMORIZE 7", "NO CYCLE UNIQUE"]
)
def test_every_order_finds_the_shortest_plan(option: str) -> None:
    found = hanoi(option, 7).variables["found"]
    assert [[step["this"] for step in path] for path in found] == [
        [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    ]
    assert found[0][0]["tower"] == [[3, 2, 1], [], []]  # the state before CONNECT BY


# Searches on a small graph: S-B, S-C, B-C, C-D, as rows of their target

GRAPH = {"S": ["B", "C"], "B": ["C"], "C": ["D"], "D": []}
COSTS = {"SB": 1, "SC": 5, "BC": 1, "CD": 1}


def search(options: str, rest: str = "", columns: str = "n.this", where: str = "") -> Any:
    functions = {
        "near": lambda node: GRAPH[node],
        "cost": lambda a, b: COSTS[a + b],
        "guess": lambda node: {"B": 6}.get(node, 0),
    }
    return Reference(functions).run(
        f"SELECT {columns} FROM n = near(node) {where} START WITH node = 'S' "
        f"CONNECT BY {options} node = n.this {rest} AS list"
    )


def words(paths: list[list[str]]) -> str:
    return " ".join("".join(path) for path in paths)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", "B BC BCD C CD"),
        ("BREADTH FIRST", "B C BC CD BCD"),
        ("UNIQUE", "B C CD"),
        ("DEPTH FIRST UNIQUE", "B BC BCD"),
        ("COST cost(node, n.this)", "B BC BCD C CD"),
        ("COST 1", "B C BC CD BCD"),
        ("COST cost(node, n.this) UNIQUE", "B BC BCD"),
        ("COST cost(node, n.this) HEURISTIC guess(n.this)", "B C CD BC BCD"),
        ("COST cost(node, n.this) HEURISTIC guess(n.this) UNIQUE", "B C CD"),
        ("PROBABILITY 1 / cost(node, n.this)", "B BC BCD C CD"),
        ("PROBABILITY cost(node, n.this) % 5", "B BC BCD"),
        ("MEMORIZE", "B C BC CD BCD"),
        ("MEMORIZE 2", "B C BC CD"),
        ("MEMORIZE COST cost(node, n.this)", "B BC BCD C CD"),
        ("MEMORIZE 2 MAXIMUM 3", "B C BC"),
        ("MAXIMUM (1 + 1)", "B BC"),
    ],
)
def test_order_of_results(options: str, expected: str) -> None:
    assert words(search(options)) == expected


def test_goals_and_stops() -> None:
    assert words(search("", where="WHERE n.this == 'C'")) == "BC C"
    assert words(search("", where="WHERE n.this == 'D'", rest="STOP WITH n.this == 'B'")) == "CD"
    assert words(search("", where="WHERE True", rest="STOP WITH n.this == 'C'")) == "B BC C"
    assert words(search("", rest="STOP WITH n.this == 'C'")) == "B"
    # C stops without being a goal: it is not reached, and another way to it is asked again.
    assert (
        words(
            search("UNIQUE", where="WHERE n.this == 'D' OR node == 'B'", rest="STOP WITH node == 'S' AND n.this == 'C'")
        )
        == "BC BCD"
    )


def test_endings_of_a_search_see_the_last_step() -> None:
    assert words(search("", rest="ORDER BY n.this DESC LIMIT 3")) == "BCD CD BC"
    assert search("", rest="GROUP BY [n.this][0] HAVING count(*) > 1") == {
        "C": [["B", "C"], ["C"]],
        "D": [["B", "C", "D"], ["C", "D"]],
    }
    assert search("", columns="n.this, count(*)", rest="GROUP BY n.this") == ["B", 1, "C", 2, "D", 2]
    assert search("NO CYCLE", rest="GROUP BY n.this") == ["B", "C", "D"]
    assert words(search("", rest="LIMIT 2")) == "B BC"


def test_options_out_of_range() -> None:
    for options in ("MAXIMUM (0)", "MEMORIZE (1.5)", "COST -1", "COST 'a'", "PROBABILITY 2"):
        with pytest.raises(Failure, match="X006"):
            search(options)


def test_start_variables_are_local() -> None:
    ref = Reference(variables={"x": 7})
    paths = ref.run(
        "SELECT x, y FROM [1, 2] START WITH x = 1, y = x + 1 CONNECT BY x = x * 3, y = x STOP WITH x > 1 AS list; "
    )
    assert paths == [[1, 2], [1, 2]]
    assert ref.variables == {"x": 7}


def test_maximum_evaluates_no_further_step() -> None:
    ref = Reference()
    assert ref.run(
        "SELECT this FROM [1, 2, 0] WHERE 1 / this START WITH l = 1 CONNECT BY MAXIMUM 2 l = l + 1 STOP WITH True"
    ) == [
        [{"this": 1}],
        [{"this": 2}],
    ]
    assert ref.steps == 2
