"""Native searches whose calls are all new ones: nobody is asked twice, although nothing is remembered."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from native_host import generated_code

import ss2sql

STATES = 24
OPTIONS = ["UNIQUE", "BREADTH FIRST UNIQUE", "MEMORIZE 30"]


class Steps:
    """A machine of 24 states, `shown` as anything; each call is noted."""

    def __init__(self, shown: Any = lambda number: number) -> None:
        self.states = [shown(number) for number in range(STATES)]
        self.calls: Counter[str] = Counter()

    def session(self) -> ss2sql.Session:
        ss = ss2sql.connect()
        ss.function("go", self.go, volatility="immutable")
        ss.function("same", lambda value: value, volatility="immutable")
        ss.set("first", self.states[0])
        return ss

    def go(self, step: Any, state: Any) -> Any:
        self.calls[repr((step, state))] += 1
        number = self.states.index(state)
        return self.states[(number * 5 + (int(step[0]) if isinstance(step, list) else step)) % STATES]

    def reached(self, steps: list[Any]) -> set[int]:
        found, left = {0}, [0]
        while left:
            number = left.pop()
            for step in steps:
                after = (number * 5 + (int(step[0]) if isinstance(step, list) else step)) % STATES
                if after not in found:
                    found.add(after)
                    left.append(after)
        return found


def script(options: str, elements: str = "[1, 2, 7]", shown: str = "go(this, n)", more: str = "") -> str:
    return f"""SELECT {shown} FROM {elements} START WITH n = first
               CONNECT BY {options} MAXIMUM 1000 n = go(this, n) STOP WITH same(1) == 2{more} AS list;"""


SHOWN = {
    "numbers": lambda number: number,
    "text": lambda number: f"s{number}",
    "lists": lambda number: [[number], []],
    "floats": lambda number: [number / 2, 1],
    "dicts": lambda number: {"at": number},
}


@pytest.mark.parametrize("shown", SHOWN.values(), ids=SHOWN)
@pytest.mark.parametrize("options", OPTIONS)
def test_each_step_is_one_call(options: str, shown: Any) -> None:
    steps = Steps(shown)
    result = steps.session().run(script(options), engine="native")
    reached = steps.reached([1, 2, 7])
    assert set(steps.calls.values()) == {1}
    assert len(steps.calls) == 3 * len(reached) == result.stats.calls["go"]
    # The start is a row as well, so its steps are asked for twice.
    assert result.stats.remembered["go"] == 3


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("elements", ["[1, 2, 2, 7, 1]", "[[1], [2], [2]]", "[[1], [1.0]]"])
def test_elements_that_occur_twice(elements: str, options: str) -> None:
    steps = Steps()
    steps.session().run(script(options, elements), engine="native")
    assert set(steps.calls.values()) == {1}


@pytest.mark.parametrize("options", OPTIONS)
def test_objects_as_states(options: str) -> None:
    """Objects have no keys of their own: each call is a new one only by what it is given."""

    class Thing:
        pass

    things = [Thing() for _ in range(STATES)]
    steps = Steps(lambda number: things[number])
    result = steps.session().run(script(options), engine="native")
    assert len({id(thing) for path in result.value for thing in path}) == len(steps.reached([1, 2, 7]))


def test_a_function_that_is_called_elsewhere_too() -> None:
    for more in ("", "x = go(1, first);", "SELECT go(this, first) FROM [1, 2, 7] AS list;", "eval('go(1, first)');"):
        steps = Steps()
        result = steps.session().run(f"{more} {script('UNIQUE')} {more}", engine="native")
        assert set(steps.calls.values()) == {1}, more
        assert result.stats.calls["go"] == 3 * STATES


def test_a_search_inside_of_a_query_remembers() -> None:
    steps = Steps()
    inner = script("UNIQUE").replace("AS list;", "AS list")
    steps.session().run(
        f"SELECT a.this FROM a = [1, 2, 3] WHERE a.this < 3 AND [] != ({inner}) AS list;", engine="native"
    )
    assert set(steps.calls.values()) == {1}


def test_a_late_list_that_searches() -> None:
    steps = Steps()
    ss = steps.session()
    search = script("UNIQUE").replace("AS list;", "AS list")
    ss.run(
        f"late = [({search}), ({search})]; SELECT this FROM late AS list; SELECT this FROM late AS list;",
        engine="native",
    )
    assert set(steps.calls.values()) == {1}


@pytest.mark.parametrize(
    ("query", "new"),
    [
        (script("UNIQUE"), True),
        (script("MEMORIZE 9"), True),
        (script("UNIQUE", shown="this, go(this, n)"), False),  # two rows, one state
        (script("UNIQUE", shown="this"), False),
        (script("UNIQUE", shown="go(this, n), 0").replace(" STOP", ", n = 0 STOP"), False),  # one state, many rows
        (script("NO CYCLE"), False),
        (script("COST 1 UNIQUE"), False),  # reached again for less, a row is expanded again
        (script("UNIQUE", more=" OR go(1, n) == -1"), False),
        (script("UNIQUE").replace("FROM [1, 2, 7]", "FROM a = [1, 2], b = [3]").replace("this", "a.this"), False),
    ],
)
def test_which_searches_do_without_a_memory(query: str, new: bool) -> None:
    steps = Steps()
    ss = steps.session()
    (code,) = generated_code(lambda: ss.run(query, engine="native"))
    assert ("ways_of" in code) == new
    assert set(steps.calls.values()) == {1}


@pytest.mark.parametrize("options", OPTIONS)
def test_functions_that_change_what_they_get(options: str) -> None:
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
    (path,) = ss.run(query, engine="native").value
    assert path[-1] == [[], [], [3, 2, 1]]
    assert len(set(map(repr, path))) == len(path)
    assert ss.get("moves") == moves
    assert ss.run("SELECT this FROM moves AS list").value == moves
