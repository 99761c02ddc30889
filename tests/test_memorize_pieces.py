"""A search taken apart gives the same steps as in one piece."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from listings import move
from test_native_memorize import problem

import ss2sql
from ss2sql.runtime.memorize import growing

HANOI = """SELECT this, tower FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
WHERE [[], [], [3, 2, 1]] == move(this, tower)
START WITH tower = [[3, 2, 1], [], []]
CONNECT BY MEMORIZE 9 tower = move(this, tower)
STOP WITH [] == move(this, tower)"""


@contextmanager
def apart(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """For as long as it lasts, searches that can be taken apart are; gives their pieces."""
    met: list[Any] = []
    grown = growing._grown

    def from_pieces(hunt: Any, grow: Any, frozen: bool, way: Any, memory: Any) -> Any:
        met.append(hunt.pieces)
        if hunt.pieces is None:
            return grown(hunt, grow, frozen, way, memory)
        return grown(hunt, growing.growth(hunt.pieces.steps), False, way, memory)

    with monkeypatch.context() as patch:
        patch.setattr(growing, "_grown", from_pieces)
        yield met


@pytest.mark.parametrize("options", ["", "COST e.this[1]", "PROBABILITY e.this[1] / 4.0"])
@pytest.mark.parametrize("seed", range(40))
def test_same_paths_of_random_graphs(seed: int, options: str, monkeypatch: pytest.MonkeyPatch) -> None:
    graph = problem(seed, [0, 1, 2] if options.startswith("PROB") else [0, 1, 2, 3])
    expected = graph.host().run(graph.script(options))
    with apart(monkeypatch) as met:
        assert graph.host().run(graph.script(options)) == expected
    assert met[0] is not None


def test_same_paths_and_counts_of_hanoi(monkeypatch: pytest.MonkeyPatch) -> None:
    with ss2sql.connect() as ss:
        ss.function(move)
        whole = ss.run(HANOI)
        with apart(monkeypatch):
            taken_apart = ss.run(HANOI)
    assert [len(path) for path in whole.value] == [7, *[8] * 4, *[9] * 16]
    assert taken_apart.value == whole.value
    for name in ("calls", "generated", "expanded", "levels"):
        assert getattr(taken_apart.stats, name) == getattr(whole.stats, name), name


def test_what_select_and_connect_by_say_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def double(number: int) -> int:
        asked.append(number)
        return 2 * number

    with ss2sql.connect() as ss:
        ss.function("double", double, volatility="immutable")
        with apart(monkeypatch) as met:
            ss.run("""SELECT double(n + this) FROM [1, 2] WHERE triple == double(n + 1 + this)
                      START WITH n = 0 CONNECT BY MEMORIZE 1 n = double(n + 1 + this)""", triple=6)  # fmt: skip
            asked.clear()
            assert met[0].is_goal((2, 0), (4,), (6,)) is True
            assert asked == []
            assert met[0].is_goal((2, 0), (4,), None) is True
            assert asked == []  # remembered within the run
            assert met[0].is_goal((5, 0), (4,), None) is False
            assert asked == [6]


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this, n FROM [1, 2] START WITH n = 0 CONNECT BY MEMORIZE 2 n = roll(n)",
        "SELECT this, n FROM [1, 2] WHERE (seen = seen + 1) > 0 START WITH n = 0 CONNECT BY MEMORIZE 2 n = n + this",
    ],
)
def test_what_can_be_noticed_stays_in_one_piece(script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with ss2sql.connect() as ss:
        ss.function("roll", lambda n: n + 1, volatility="volatile")
        ss.set("seen", 0)
        with apart(monkeypatch) as met:
            ss.run(script)
        assert met == [None]
