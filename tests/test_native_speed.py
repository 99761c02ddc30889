"""Calls that are remembered, and searches whose calls are all new ones: nobody is asked twice."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

import ss2sql
from ss2sql.runtime.run.run_state import Run


def test_the_garbage_collector_pauses_for_a_second_where_no_foreign_code_runs(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, engine: Any
) -> None:
    seen: list[bool] = []
    check = Run.check

    def note_collector(run: Run) -> None:
        seen.append(gc.isenabled())
        check(run)

    monkeypatch.setattr(Run, "check", note_collector)
    search = "SELECT n FROM [1] WHERE n == 9999 START WITH n = 0 CONNECT BY n = {} STOP WITH n == 9999"
    ss.function("after", lambda n: (seen.append(gc.isenabled()), n + 1)[1], volatility="immutable")
    assert len(ss.run(search.format("n + 1"), engine=engine).value) == 1
    assert False in seen
    seen.clear()
    ss.run(search.format("after(n)"), engine=engine)
    assert set(seen) == {True}
    run = Run(ss.host)
    with run.pause_collector():
        run.collects_at -= 1.0
        run.check()
        assert gc.isenabled()
    assert gc.isenabled()


STATES = 24
OPTIONS = ["UNIQUE", "BREADTH FIRST UNIQUE", "MEMORIZE 30"]
THINGS = [object() for _ in range(STATES)]


class Steps:
    """A machine of 24 states, `shown` as anything; each call is noted."""

    def __init__(self, shown: Any = lambda number: number) -> None:
        self.states = [shown(number) for number in range(STATES)]
        self.calls: Counter[str] = Counter()

    def run(self, script: str) -> ss2sql.Result:
        """What a script gives natively; no step is asked for twice."""
        with ss2sql.connect() as ss:
            ss.function("go", self.go, volatility="immutable")
            ss.function("same", lambda value: value, volatility="immutable")
            ss.set("first", self.states[0])
            result = ss.run(script, engine="native")
        assert set(self.calls.values()) == {1}
        return result

    def go(self, step: Any, state: Any) -> Any:
        self.calls[repr((step, state))] += 1
        return self.states[self.after(self.states.index(state), step)]

    def after(self, number: int, step: Any) -> int:
        return (number * 5 + (int(step[0]) if isinstance(step, list) else step)) % STATES

    def reached(self, steps: list[Any]) -> set[int]:
        found, left = {0}, [0]
        while left:
            number = left.pop()
            new = {self.after(number, step) for step in steps} - found
            found |= new
            left += new
        return found


def script(options: str, elements: str = "[1, 2, 7]", shown: str = "go(this, n)", more: str = "") -> str:
    return f"""SELECT {shown} FROM {elements} START WITH n = first
               CONNECT BY {options} MAXIMUM 1000 n = go(this, n) STOP WITH same(1) == 2{more} AS list"""


SHOWN: dict[str, Callable[[int], Any]] = {
    "numbers": lambda number: number, "text": lambda number: f"s{number}", "lists": lambda number: [[number], []],
    "floats": lambda number: [number / 2, 1], "dicts": lambda number: {"at": number},
    "deep": lambda number: [[[number]] if number % 2 else [number]],
    "objects": lambda number: THINGS[number],  # each call is a new one only by what it is given
}  # fmt: skip


@pytest.mark.parametrize("shown", SHOWN.values(), ids=SHOWN)
@pytest.mark.parametrize("options", OPTIONS)
def test_each_step_is_one_call(options: str, shown: Any) -> None:
    steps = Steps(shown)
    result = steps.run(script(options))
    reached = steps.reached([1, 2, 7])
    assert len(steps.calls) == 3 * len(reached) == result.stats.calls["go"]
    # The start is a row as well, so its steps are asked for twice.
    assert result.stats.remembered["go"] == 3
    assert len({repr(state) for path in result.value for state in path}) == len(reached)


@pytest.mark.parametrize("kind", [list, tuple])
@pytest.mark.parametrize("shown", SHOWN.values(), ids=SHOWN)
@pytest.mark.parametrize("options", OPTIONS)
def test_each_list_of_successors_is_one_call(options: str, shown: Any, kind: Any, engine: Any) -> None:
    steps = Steps(shown)

    def onward(state: Any) -> Any:
        steps.calls[repr(state)] += 1
        number = steps.states.index(state)
        if isinstance(state, list):
            state.append("what a function does to its argument is seen by nobody")
        return kind(steps.states[steps.after(number, step)] for step in (1, 2, 7))

    with ss2sql.connect() as ss:
        ss.function("onward", onward, volatility="immutable")
        ss.set("first", steps.states[0])
        text = f"SELECT this FROM onward(n) START WITH n = first CONNECT BY {options} MAXIMUM 1000 n = this AS list"
        result = ss.run(text, engine="native" if "MEMORIZE" in options else engine)
    reached = steps.reached([1, 2, 7])
    assert {repr(state) for path in result.value for state in path} == {repr(steps.states[n]) for n in reached}
    assert all(steps.states.index(path[0]) in {1, 2, 7} for path in result.value)
    assert steps.calls == Counter(repr(steps.states[n]) for n in reached)


SEARCH = script("UNIQUE")


@pytest.mark.parametrize(
    "query",
    [
        f"SELECT a.this FROM a = [1, 2, 3] WHERE a.this < 3 AND [] != ({SEARCH}) AS list",
        f"late = [({SEARCH}), ({SEARCH})]; SELECT this FROM late AS list; SELECT this FROM late AS list",
        script("UNIQUE", shown="this, go(this, n)"),  # two rows, one state
        script("UNIQUE", shown="this"),
        script("UNIQUE", shown="go(this, n), 0").replace(" STOP", ", n = 0 STOP"),  # one state, many rows
        script("NO CYCLE"),
        script("COST this HEURISTIC (n % 5) * 20 UNIQUE"),  # reached again for less, a row is expanded again
        script("UNIQUE", more=" OR go(1, n) == -1"),
        SEARCH.replace("FROM [1, 2, 7]", "FROM a = [1, 2], b = [3]").replace("this", "a.this"),
        *(f"{more} {SEARCH}; {more}" for more in (
            "x = go(1, first);", "SELECT go(this, first) FROM [1, 2, 7] AS list;", "eval('go(1, first)');")),
        *(script(options, elements) for options in OPTIONS
          for elements in ("[1, 2, 2, 7, 1]", "[[1], [2], [2]]", "[[1], [1.0]]")),
    ],
)  # fmt: skip
def test_searches_whose_calls_are_not_all_new_ones(query: str) -> None:
    """Elements that occur twice, and functions that are called elsewhere, too."""
    Steps().run(query)


@pytest.mark.parametrize("options", OPTIONS)
def test_functions_that_change_what_they_get(options: str, engine: Any) -> None:
    def go(step: list[int], towers: list[list[int]]) -> list[list[int]]:
        if not towers[step[0]] or (towers[step[1]] and towers[step[1]][-1] < towers[step[0]][-1]):
            step.clear()
            return []
        towers[step[1]].append(towers[step[0]].pop())
        step.append(9)
        return towers

    ss = ss2sql.connect()
    ss.function("go", go, volatility="immutable")
    moves = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
    ss.set("moves", moves)
    ss.set("first", [[3, 2, 1], [], []])
    query = f"""SELECT go(this, t) FROM moves WHERE [[], [], [3, 2, 1]] == go(this, t) START WITH t = first
                CONNECT BY {options} MAXIMUM 1 t = go(this, t) STOP WITH [] == go(this, t) AS list;"""
    (path,) = ss.run(query, engine="native" if "MEMORIZE" in options else engine).value
    assert path[-1] == [[], [], [3, 2, 1]]
    assert len(set(map(repr, path))) == len(path)
    assert ss.get("moves") == moves
    assert ss.run("SELECT this FROM moves AS list").value == moves
