"""COST and PROBABILITY by levels in the tables of DuckDB find what the native search finds, in its order."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from agreement import exact
from level_searches import compare_random, kept, options
from programs.drawn import amount
from test_levels import COUNT, OWN

import ss2sql
from ss2sql.frontend import ast
from ss2sql.runtime.levels import duck

TRIALS = amount(1 / 25)
GUARDS = ("", "UNIQUE", "NO CYCLE")
GIVEN = ("COST 1", "COST 0", "COST 0.1", "PROBABILITY 0.5", "PROBABILITY 1")


def variants(query: ast.Query) -> list[ast.Query]:
    """A search with each guard, by its own COST or PROBABILITY or by a given one."""
    own = kept(query, "MAXIMUM", "COST", "PROBABILITY")
    if own == kept(query, "MAXIMUM"):
        own += options(GIVEN[len(query.span.text) % len(GIVEN)])
    return [replace(query, options=(*own, *options(guard))) for guard in GUARDS]


def test_random_searches() -> None:
    assert compare_random(variants, "duckdb", OWN, 9, COUNT // 2) > COUNT // 16


def either(script: str, functions: dict[str, Callable[..., Any]]) -> list[tuple[Any, ...]]:
    """What a script comes to natively and in tables: its value, or its error."""
    outcomes: list[tuple[Any, ...]] = []
    for engine in ("native", "duckdb"):
        with ss2sql.connect(session=OWN) as ss:
            for name, function in functions.items():
                ss.function(name, function, volatility="immutable")
            try:
                result = ss.run(script, engine=engine, timeout=60)  # type: ignore[arg-type]
                assert result.engine == engine
                outcomes.append(("value", exact(result.value), result.status))
            except ss2sql.Error as error:
                outcomes.append((error.code, error.span))
            except ValueError as error:
                outcomes.append(("ValueError", error.args))
    return outcomes


# What a step weighs, for each kind of totals: ties, zeros, sums that are rounded, all different, great differences.
COSTS: tuple[Callable[[random.Random], Any], ...] = (
    lambda some: 1,
    lambda some: some.choice([0, 1, 2]),
    lambda some: some.choice([0.1, 0.2, 0.3, 0.4, 0]),
    lambda some: some.random(),
    lambda some: some.choice([0, 0.5, 3, 10**6, 1e-9]),
)
CHANCES: tuple[Callable[[random.Random], Any], ...] = (
    lambda some: 1,
    lambda some: some.choice([0, 0.5, 1]),
    lambda some: some.choice([0.1, 0.3, 0.9]),
    lambda some: some.random(),
    lambda some: some.choice([1e-200, 0.5, 1]),
)
ENDINGS = ("AS list", "GROUP BY n AS list", "ORDER BY n DESC AS list", "LIMIT 2 AS list", "AS rows")
CLAUSES = ("roads", "row", "goal", "stops", "weigh", "follow")


class World:
    """A random graph, a weight for each of its roads, and one clause that may fail on one of them.

    Its searches end after six steps, because some lead around in circles and never to a goal.
    """

    def __init__(self, number: int) -> None:
        some = self.some = random.Random(number)
        size = some.randint(2, 7)
        self.word, weights = some.choice([("COST", COSTS), ("PROBABILITY", CHANCES)])
        weight = some.choice(weights)
        self.roads = [[some.randrange(size) for _ in range(some.randint(0, 3))] for _ in range(size)]
        self.weights = {(a, b): weight(some) for a in range(size) for b in range(size)}
        self.goals = {some.randrange(size) for _ in range(2)}
        self.ends = {some.randrange(size) for _ in range(some.randint(0, 2))}
        self.clause = some.choice((*CLAUSES, None))
        self.bad = (some.randrange(size), some.randrange(size))

    def script(self, guard: str, maximum: str) -> str:
        where = self.some.choice(["WHERE goal(n, x.this)", ""])
        stop = self.some.choice(["STOP WITH stops(n, x.this) OR nth > 5", "STOP WITH nth > 5"])
        return (
            f"SELECT row(n, x.this) FROM x = roads(n) {where} START WITH n = 0, nth = 1"
            f" CONNECT BY {self.word} weigh(n, x.this) {guard} {maximum} n = follow(n, x.this), nth = nth + 1"
            f" {stop} {self.some.choice(ENDINGS)};"
        )

    def functions(self) -> dict[str, Callable[..., Any]]:
        def guarded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
            def asked(*arguments: int) -> Any:
                if self.clause == name and arguments == self.bad[: len(arguments)]:
                    raise ValueError(name, arguments)
                return function(*arguments)

            return asked

        made: dict[str, Callable[..., Any]] = {
            "roads": lambda n: self.roads[n],
            "row": lambda n, to: to,
            "goal": lambda n, to: to in self.goals,
            "stops": lambda n, to: to in self.ends,
            "weigh": lambda n, to: self.weights[n, to],
            "follow": lambda n, to: to,
        }
        return {name: guarded(name, function) for name, function in made.items()}


@pytest.mark.parametrize("number", range(TRIALS))
def test_ties_totals_and_failing_steps(number: int) -> None:
    world = World(number)
    guard = GUARDS[number % 3]
    maximum = world.some.choice(["MAXIMUM 3", "MAXIMUM 20"] if guard != "UNIQUE" else ["", "MAXIMUM 2"])
    wanted, found = either(world.script(guard, maximum), world.functions())
    assert found == wanted


# --- what the language says ----------------------------------------------------------------------------------

ROADS = {1: [2, 3, 4], 2: [4, 5], 3: [4], 4: [5], 5: []}


def paths(options: str, weights: dict[tuple[int, int], Any], goal: int, clauses: str = "") -> Any:
    """The paths from 1 to a goal by roads that weigh what is said, others 1."""
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("near", lambda n: ROADS[n], volatility="immutable")
        ss.function("weigh", lambda a, b: weights.get((a, b), 1), volatility="immutable")
        return ss.run(
            f"SELECT x.this FROM x = near(n) WHERE x.this == {goal} START WITH n = 1"
            f" CONNECT BY {options} weigh(n, x.this) n = x.this {clauses} AS list;"
        ).value


def test_among_equals_the_first_generated_comes_first() -> None:
    # All ways to 4 cost 2. The step from 1 to 4 is generated first, then that over 2.
    assert paths("NO CYCLE COST", {(1, 4): 2}, 4) == [[4], [2, 4], [3, 4]]


def test_a_step_that_costs_nothing_comes_after_those_that_wait_at_its_total() -> None:
    # 2, 3 and 4 wait at 1; the free step from 2 to 4 enters behind them.
    assert paths("NO CYCLE COST", {(2, 4): 0}, 4) == [[4], [2, 4], [3, 4]]


def test_costs_are_added_along_the_path() -> None:
    # 0.1 + 0.2 is more than 0.3, and 0.2 + 0.1 is as much.
    weights = {(1, 2): 0.2, (2, 4): 0.1, (1, 3): 0.1, (3, 4): 0.2, (1, 4): 0.3}
    assert paths("NO CYCLE COST", weights, 4) == [[4], [3, 4], [2, 4]]


def test_unique_reaches_a_row_by_the_cheapest_way() -> None:
    assert paths("UNIQUE COST", {(1, 4): 9, (2, 4): 2}, 4) == [[3, 4]]
    assert paths("UNIQUE COST", {(1, 4): 9, (2, 4): 0.5, (4, 5): 7, (2, 5): 9}, 5) == [[2, 4, 5]]


def test_the_likeliest_come_first_and_the_impossible_never() -> None:
    weights = {(1, 2): 0.5, (1, 3): 0.9, (1, 4): 0, (2, 4): 0.9, (3, 4): 0.5}
    # 0.9 * 0.5 is 0.5 * 0.9, and the step to 3 is taken before that to 2.
    assert paths("NO CYCLE PROBABILITY", weights, 4) == [[3, 4], [2, 4]]


def test_no_step_and_no_goal() -> None:
    assert paths("UNIQUE COST", {}, 9) == []
    assert paths("UNIQUE COST", {}, 9, "STOP WITH True") == []


# --- what it takes ---------------------------------------------------------------------------------------------


def grid(cost: Callable[[int, int], float]) -> ss2sql.Result:
    """The cheapest way over a grid of 10 by 10 fields."""

    def near(field: int) -> list[int]:
        x, y = divmod(field, 10)
        steps = ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1))
        return [10 * a + b for a, b in steps if 0 <= a < 10 and 0 <= b < 10]

    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("near", near, volatility="immutable")
        ss.function("cost", cost, volatility="immutable")
        return ss.run(
            "SELECT x.this FROM x = near(n) WHERE x.this == 99 START WITH n = 0"
            " CONNECT BY UNIQUE COST cost(n, x.this) n = x.this AS list;"
        )


def test_equal_costs_make_a_level_of_each_total() -> None:
    result = grid(lambda a, b: 1)
    assert len(result.value[0]) == 18
    assert len(result.stats.levels) <= 21  # the start is reached again at 2; the farthest rows lead nowhere
    assert result.stats.expanded == 100  # every field


def test_costs_that_all_differ_are_taken_many_at_a_time() -> None:
    result = grid(lambda a, b: 1 + (a * 31 + b * 17) % 101 / 101)
    assert len(result.stats.levels) < 50  # for 100 rows
    assert result.stats.expanded < 140  # some are chosen too early and tried again


def test_a_level_is_a_few_statements(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {"run": 0, "rows": 0}
    for name in counts:
        known = getattr(duck.DuckTables, name)

        def counted(self: Any, *arguments: Any, known: Any = known, name: str = name, **values: Any) -> Any:
            counts[name] += 1
            return known(self, *arguments, **values)

        monkeypatch.setattr(duck.DuckTables, name, counted)
    levels = len(grid(lambda a, b: 1).stats.levels)
    assert counts["run"] <= 16 * (levels + 1)
    assert counts["rows"] <= 5 * (levels + 1)


# --- what is refused, and what is told --------------------------------------------------------------------------


def refusal(options: str) -> ss2sql.UnsupportedError:
    script = f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {options} MAXIMUM 9 n = this;"
    with ss2sql.connect(engine="duckdb", session=OWN) as ss, pytest.raises(ss2sql.UnsupportedError) as caught:
        ss.run(script)
    return caught.value


def test_a_heuristic_is_refused() -> None:
    error = refusal("COST 1 HEURISTIC 1")
    assert "HEURISTIC goes on from one path at a time" in error.message
    assert error.hints == ("leave HEURISTIC out, the costs are the same",)


def test_costs_beyond_exact_floats_are_refused() -> None:
    assert "costs add up to more than 2^53" in refusal("COST 9007199254740992").message


@pytest.mark.parametrize(
    ("options", "first", "rows"),
    [
        ("UNIQUE COST n", "searches the cheapest steps first", "keeps those to rows that were not taken before"),
        ("NO CYCLE PROBABILITY 0.5", "searches the likeliest steps first", "not met on the way back to the start"),
    ],
)
def test_explain_tells_how(options: str, first: str, rows: str) -> None:
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        result = ss.run(f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {options} n = this AS list;")
    text = str(result.explain())
    assert first in text
    assert rows in text
    assert "ORDER BY total, place" in result.sql
    levels = result.stats.levels
    told = [line.split() for line in text.splitlines()]
    assert ["1", str(levels[0].steps), str(levels[0].pruned)] in told
