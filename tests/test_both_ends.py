"""MEMORIZE from both ends gives the same paths in the same order as from the start alone, with fewer calls."""

from __future__ import annotations

import random
from typing import Any

import pytest
from golden import each_row
from listings import MOVES, move
from programs.drawn import SEED, amount

import ss2sql
from ss2sql.runtime.search import memorize

COUNT = 2 * amount(1 / 2)


class Maze:
    """A random machine over the states 0 to 11: each element takes some states to others, no two to the same one."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.ways = [self._way() for _ in range(self.dice.randint(1, 4))]
        self.back = [{after: before for before, after in way.items()} for way in self.ways]

    def _way(self) -> dict[int, int]:
        befores = [state for state in range(12) if self.dice.random() < 0.7]
        return dict(zip(befores, self.dice.sample(range(12), len(befores)), strict=True))

    def session(self, inverse: bool) -> ss2sql.Session:
        ss = ss2sql.connect()
        undo = (lambda e, s: self.back[e].get(s)) if inverse else None
        ss.function("go", lambda e, s: self.ways[e].get(s), volatility="immutable", inverse=undo)
        return ss


SHOWN = ["this, s", "go(this, s)", "s, go(this, s), this"]
GOALS = [
    "go(this, s) == goal", "goal == go(this, s) AND this != 1", "go(this, s) IN [1, 5, 7]",
    "go(this, s) == goal OR 3 == go(this, s)",
]  # fmt: skip
STOPS = ["go(this, s) == None", "go(this, s) == None OR go(this, s) == goal", "go(this, s) IN [None, 2, 6] OR s == 4"]
WEIGHTS = ["", "", "COST this + 1", "COST s / 2.0", "PROBABILITY 1.0 / (this + 2)"]


def script(dice: random.Random) -> str:
    parts = [dice.choice(choices) for choices in (SHOWN, GOALS, STOPS, WEIGHTS)]
    most = dice.choice(["", "", "MAXIMUM 3"])
    return f"""SELECT {parts[0]} FROM elements WHERE {parts[1]} START WITH s = start
               CONNECT BY MEMORIZE {dice.randint(1, 7)} {most} {parts[3]} s = go(this, s)
               STOP WITH {parts[2]} AS list"""


@pytest.mark.drawn
def test_same_paths_in_the_same_order() -> None:
    went_back = 0
    for seed in range(SEED, SEED + COUNT):
        maze = Maze(seed)
        text = script(maze.dice)
        elements = [maze.dice.randrange(len(maze.ways)) for _ in range(maze.dice.randint(1, 5))]  # some of them twice
        values = {"elements": elements, "start": maze.dice.randrange(12), "goal": maze.dice.randrange(12)}
        with maze.session(inverse=False) as one, maze.session(inverse=True) as both:
            expected = one.run(text, **values)
            found = both.run(text, **values)
        assert found.value == expected.value, (seed, text, values)
        assert found.stats.notes == []
        assert not expected.stats.backward
        went_back += bool(found.stats.backward)
    assert went_back >= COUNT / 3


GRIDS = [
    "WHERE [6, 4] == [p[0] + this[0], p[1] + this[1]] START WITH p = [0, 0]"
    " CONNECT BY MEMORIZE {} MAXIMUM 50 p = [p[0] + this[0], p[1] + this[1]] STOP WITH wall(p[0], p[1])",
    "WHERE x + this[0] == 6 AND 4 == this[1] + y START WITH x = 0, y = 0, k = 1"
    " CONNECT BY MEMORIZE {} MAXIMUM 50 x = x + this[0], y = this[1] + y STOP WITH wall(x, y)",
    "WHERE 6 - x + this[0] == 0 START WITH x = 0 CONNECT BY MEMORIZE {} MAXIMUM 50 x = 6 - x + this[0]",
]


@pytest.mark.parametrize("bound", [3, 8, 11])
@pytest.mark.parametrize("grid", GRIDS)
def test_whole_sums_can_be_undone(ss: ss2sql.Session, grid: str, bound: int, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = "p, this" if "p =" in grid else "x, y, this" if "y =" in grid else "x, this"
    text = f"SELECT {shown} FROM [[-1, 0], [0, -1], [0, 1], [1, 0], [1, 1]] {grid.format(bound)} AS list"
    ss.function("wall", lambda x, y: x == 3 and y != 2, volatility="immutable")
    both = ss.run(text)
    monkeypatch.setattr(memorize, "start_backward_search", lambda hunt: None)
    one = ss.run(text)
    assert both.value == one.value
    assert both.stats.backward
    assert not one.stats.backward
    if bound > 3:
        assert one.value


def hanoi(disks: int, bound: int) -> str:
    start = list(range(disks, 0, -1))
    return f"""SELECT this, tower FROM {MOVES}
    WHERE [[], [], {start}] == move(this, tower) START WITH tower = [{start}, [], []]
    CONNECT BY MEMORIZE {bound} tower = move(this, tower) STOP WITH [] == move(this, tower)"""


def undo(this: list[int], tower: list[list[int]]) -> list[list[int]] | None:
    return move([this[1], this[0]], tower) or None


def test_each_side_goes_half_as_deep_and_each_search_has_its_levels(ss: ss2sql.Session) -> None:
    ss.function("move", move)
    one = ss.run(hanoi(4, 18))
    ss.function("move", move, inverse=undo)
    both = ss.run(hanoi(4, 18))
    lengths = [len(path) for path in both.value]
    assert {length: lengths.count(length) for length in lengths} == {15: 1, 16: 8, 17: 48, 18: 228}
    assert both.value == one.value
    for stats in (one.stats, both.stats):
        assert stats.generated == sum(level.steps + level.pruned for level in stats.levels)
        # The start and every row but those of the last level go on.
        assert stats.expanded == 1 + sum(level.rows for level in stats.levels[:-1])
    levels = len(both.stats.backward)
    assert 8 <= levels <= 11  # of 18, for a row names the state before its step
    # The start and the goal are two corners of a triangle of 81 states, 15 steps apart; 9 steps reach 33 of them.
    assert both.stats.calls["move"] < one.stats.calls["move"] / 2
    assert both.stats.calls["inverse of move"] < one.stats.calls["move"] / 2
    line = f"searched from both ends: {levels} levels back from the goal by the inverse of move"
    assert line in map(str.strip, both.explain().splitlines())
    ss.function("move", move, inverse=undo)
    search = hanoi(3, 8)
    alone = ss.run(search)
    assert ss.run(f"{search};{search}").stats.backward == alone.stats.backward
    other = ss.run(f"{search}; SELECT this FROM [1] START WITH n = 1 CONNECT BY MEMORIZE 2 n = 2")
    assert other.stats.backward == []


def test_the_way_back_keeps_to_max_rows(ss: ss2sql.Session) -> None:
    """From the start three states can be reached, but a thousand lead to the goal."""
    text = """SELECT this, s FROM [1] WHERE step(this, s) == 1000 START WITH s = 0
              CONNECT BY MEMORIZE 500 s = step(this, s) STOP WITH s == 2"""
    ss.function("step", lambda this, s: s + this, volatility="immutable", inverse=lambda this, s: s - this)
    free = ss.run(text)
    assert len(free.stats.backward) > 100
    bounded = ss.run(text, max_rows=100)
    assert bounded.value == free.value == []
    assert bounded.stats.backward == []
    assert bounded.stats.notes == ["searched from the start only: more than max_rows=100 states lead to the goal"]


# --- what fails ----------------------------------------------------------------------------------------


def test_only_what_fails_on_the_way_there_is_raised(ss: ss2sql.Session) -> None:
    def undo_all(this: list[int], tower: list[list[int]]) -> list[list[int]]:
        # [], where None is expected, is then taken for a state, of which the first index fails.
        return move([this[1], this[0]], tower) if tower[this[1]] else []

    ss.function("move", move, inverse=undo_all)
    result = ss.run(hanoi(3, 8))
    assert [len(path) for path in result.value] == [7, 8, 8, 8, 8]
    [note] = result.stats.notes
    assert note.startswith("searched from the start only: going back from the goal failed: IndexError")

    def fragile(this: int, n: int) -> int:
        if n == 2:
            raise ZeroDivisionError("two")
        return n + this

    ss.function("step", fragile, volatility="immutable", inverse=lambda this, n: n - this)
    search = "WHERE step(this, n) == 9 START WITH n = 0 CONNECT BY MEMORIZE 6 n = step(this, n)"
    with pytest.raises(ZeroDivisionError, match="two"):
        ss.run(f"SELECT this, n FROM [1, 2] {search}")


def test_a_goal_that_fails_is_raised_only_where_it_is_asked(ss: ss2sql.Session) -> None:
    def lost(n: int) -> int:
        raise ZeroDivisionError("no goal")

    text = """SELECT this, s FROM elements WHERE lost(1) == go(this, s) START WITH s = 0
              CONNECT BY MEMORIZE 3 s = go(this, s)"""
    reason = "what is known of the goal failed: ZeroDivisionError: no goal"
    ss.function("lost", lost, volatility="immutable")
    ss.function("go", lambda e, s: s + e, volatility="immutable", inverse=lambda e, s: s - e)
    result = ss.run(text, elements=[])
    assert (result.value, result.stats.generated) == ([], 0)
    assert result.stats.notes == [f"searched from the start only: {reason}"]
    with pytest.raises(ZeroDivisionError, match="no goal"):
        ss.run(text, elements=[1])


@each_row("search/from-the-start-only", "script", "reason")
def test_a_search_from_the_start_alone_says_why(ss: ss2sql.Session, script: str, reason: str) -> None:
    ss.function("go", lambda e, s: s + e + 1, volatility="immutable", inverse=lambda e, s: s - e - 1)
    ss.function("stay", lambda e, s: sorted([s, e])[1], volatility="immutable")
    ss.function("roll", lambda n: n, volatility="volatile")
    result = ss.run(script)
    assert not result.stats.backward
    [line] = [line for line in result.explain().splitlines() if "from the start only" in line]
    assert reason in line


def test_values_stay_as_exact_as_they_are(ss: ss2sql.Session) -> None:
    """Equal values may differ, 1 from 1.0: what is found backwards decides nothing about rows."""
    ss.function("go", lambda e, s: s + e, volatility="immutable", inverse=lambda e, s: s - e)
    text = """SELECT go(this, s) FROM [1] WHERE go(this, s) == 4.0 START WITH s = {}
              CONNECT BY MEMORIZE 4 s = go(this, s) AS list"""
    whole: Any = ss.run(text.format(0))
    assert whole.stats.backward
    assert [repr(value) for value in whole.value[0]] == ["1", "2", "3", "4"]
    assert [repr(value) for value in ss.eval(text.format(0.0))[0]] == ["1.0", "2.0", "3.0", "4.0"]
