"""The reference against the language page where no sheet or golden case runs it: Hanoi and failures."""

from __future__ import annotations

from collections import Counter

import pytest
from listings import MOVES, move
from reference import Failure, Reference

# Towers of Hanoi


def hanoi(option: str, level: int) -> Reference:
    """Three disks; the reference that ran keeps the result in its variable `found`."""
    ref = Reference({"move": move}, {"moves": MOVES})
    ref.run(
        "found = SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower) "
        "START WITH tower = [[3,2,1],[],[]], level = 1 "
        f"CONNECT BY {option} tower = move(this, tower), level = level + 1 "
        f"STOP WITH level == {level} OR [] == move(this, tower)"
    )
    return ref


@pytest.mark.parametrize(
    ("option", "level", "expected"),
    [
        ("", 9, {7: 1, 8: 4, 9: 23}),
        ("NO CYCLE", 9, {7: 1, 8: 4, 9: 16}),
        ("MEMORIZE 8", 99, {7: 1, 8: 4}),
        ("MEMORIZE 12", 99, {7: 1, 8: 4, 9: 16, 10: 50, 11: 147, 12: 382}),
    ],
)
def test_paths_of_hanoi(option: str, level: int, expected: dict[int, int]) -> None:
    assert Counter(map(len, hanoi(option, level).variables["found"])) == expected


@pytest.mark.parametrize(
    ("option", "steps"),
    [
        *[("", 3462), ("BREADTH FIRST", 3462), ("COST 1", 3462), ("NO CYCLE", None), ("UNIQUE", None)],
        *[("MEMORIZE 7", None), ("NO CYCLE UNIQUE", None)],
    ],
)
def test_the_shortest_plan_and_the_steps_of_the_page(option: str, steps: int | None) -> None:
    ref = hanoi(option, 7)
    [path] = ref.variables["found"]
    assert [step["this"] for step in path] == [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    assert path[0]["tower"] == [[3, 2, 1], [], []]  # the state before CONNECT BY
    assert steps in (None, ref.steps)


# What fails

SEARCH = "SELECT this FROM [1] START WITH x = 1 CONNECT BY"
FAILURES = {
    "X001": ['1 < "a"', "None < 1", "1 + None", "1 IN 1", "SELECT this FROM [1, 'a'] ORDER BY this"],
    "X002": ["1 / 0", "1.5 % 0"],
    "X003": ["[1][1]"],
    "X004": ["9223372036854775807 + 1", "1e308 * 10", "(-1) ^ 0.5", "9 ^ 9 ^ 9", "nan()", "huge()"],
    "X006": [
        "SELECT this FROM [1] LIMIT -1",
        *(f"{SEARCH} {option} x = 1" for option in ("MAXIMUM (0)", "MEMORIZE (1.5)", "COST -1", "COST 'a'")),
        f"{SEARCH} PROBABILITY 2 x = 1",
    ],
    "X007": ["sqrt(-1)", 'int("one")', "max(3)"],
    "R001": ["unknown"],
    "R002": ["unknown(1)"],
    "R003": ["SELECT this FROM unknown"],
    "R004": ["SELECT k FROM a = rows, b = rows"],
    "R005": ["len()"],
    "R006": ["SELECT this FROM [1] AS unknown"],
    "R007": [f"{SEARCH} x = 2 STOP WITH (x = 2) > 1"],
    "R008": ["SELECT this FROM [1] WHERE count(*) > 1"],
    "R010": [f"{SEARCH} DEPTH FIRST MEMORIZE x = 2"],
    "R011": ["late = [a.this]; SELECT this FROM late"],
    "R012": ["SELECT this FROM [1] STOP WITH True"],
    "R013": ["SELECT 1 FROM a = [1], a = [2]"],
}


@pytest.mark.parametrize(("code", "script"), [(code, script) for code in FAILURES for script in FAILURES[code]])
def test_failure(code: str, script: str) -> None:
    functions = {"nan": lambda: float("nan"), "huge": lambda: 2**63}
    with pytest.raises(Failure) as caught:
        Reference(functions, {"rows": [{"k": 1}]}).run(script)
    assert caught.value.code == code
