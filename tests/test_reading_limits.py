"""The limits of a run hold in what works through many values: in built-in functions, and where a value is built."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import Any

import pytest

import ss2sql
from ss2sql.runtime.run.run_state import Run, pause_collector
from ss2sql.runtime.run.search_paths import KeptSteps, SearchPaths
from ss2sql.runtime.run.value_sizes import CELL_SIZE, ValueSizes

# A chain of n steps, each of which is a result, has n * n / 2 rows: no computer has room for those of 100,000 steps.
CHAIN = "SELECT {select} FROM {source} START WITH i = 1 CONNECT BY i = i + 1 STOP WITH i == {steps} {end}"
STEPS = 100_000


def chain(end: str, select: str = "i", source: str = "[1]", steps: int = STEPS) -> str:
    return CHAIN.format(select=select, source=source, steps=steps, end=end)


# Scripts, and who reads their rows.
READERS: dict[str, tuple[str, Callable[[ss2sql.Result], Any]]] = {
    **{f"AS {form}": (chain(f"AS {form}"), lambda result: result.value) for form in ("dict", "list", "rows", "set")},
    "own": (chain("AS own"), lambda result: result.value),
    "lists": (chain("AS list", "[i]"), lambda result: result.value),
    "groups": (chain("GROUP BY i % 2 AS list"), lambda result: result.value),
    "order": (chain("ORDER BY -i AS list"), lambda result: result.value),
    "paths": (chain("AS list"), lambda result: result.paths),
    "paths of lists": (chain("AS list", "[i]"), lambda result: result.paths),
    "frame": (chain("AS list"), lambda result: result.df()),
    "csv": (chain("AS list"), lambda result: result.csv()),
    "inside": (f"x = ({chain('AS dict', steps=12_000)}); len(x)", lambda result: result.value),
    "stars": (chain("AS dict", "*", "many()"), lambda result: result.value),
}


def session(**limits: Any) -> ss2sql.Session:
    ss = ss2sql.connect(**limits)
    ss.function("many", lambda: [{"a": 1}], volatility="immutable")
    ss.representation("own")(lambda table: len(table))
    return ss


@pytest.mark.parametrize("name", READERS)
def test_a_timeout_ends_the_building_of_a_value(engine: Any, name: str) -> None:
    script, read = READERS[name]
    with pause_collector(), session() as ss:  # to collect among what all tests have left takes longer than the timeout
        started = time.process_time()
        with pytest.raises(ss2sql.Timeout) as caught:
            read(ss.run(script, engine=engine, timeout=0.2))
        assert time.process_time() - started < 10
        assert caught.value.code == "T001"
        assert caught.value.partial.status == "timeout"
        assert caught.value.partial.value is None
        assert ss.eval("1 + 1") == 2


@pytest.mark.parametrize("name", ["AS dict", "AS list", "groups", "paths", "inside"])  # which fill memory soon
def test_max_memory_bounds_the_value(engine: Any, name: str) -> None:
    script, read = READERS[name]
    with session(max_memory=20_000_000) as ss, pytest.raises(ss2sql.OutOfMemory, match="T003"):
        read(ss.run(script, engine=engine))


def test_a_list_of_paths_in_a_script_is_measured_before_it_is_made() -> None:
    with session() as ss, pytest.raises(ss2sql.ExecutionError, match="X014"):
        ss.run(f"x = ({chain('AS list')}); len(x)", engine="database")


def test_what_a_run_has_left_is_for_each_reading() -> None:
    """The clock stands still between the run and who reads its value."""
    with session() as ss:
        result = ss.run(chain("AS list", steps=50), timeout=5)
        assert result.answer is not None
        result.answer.begin = ss2sql.runtime.run.run_state.RemainingBounds(0.0).begin_reading
        long = ss.run(chain("AS list", steps=500), timeout=5)
        assert long.answer is not None
        long.answer.begin = ss2sql.runtime.run.run_state.RemainingBounds(0.0).begin_reading
        assert len(result.value) == 49  # so little is looked at never
        for _ in range(2):
            with pytest.raises(ss2sql.Timeout, match="the run with the reading of its result") as caught:
                long.value  # noqa: B018
        assert caught.value.partial.engine == "database"
        assert sum(1 for _ in caught.value.partial) == 499 * 500 // 2  # one after the other they can be had


class Counted(list[int]):
    """The parents of steps, and how often somebody has looked one up."""

    looks = 0

    def __getitem__(self, number: Any) -> Any:
        self.looks += 1
        return super().__getitem__(number)


@pytest.mark.parametrize("all_results", [False, True])
@pytest.mark.parametrize("order", [1, -1])
def test_paths_read_one_by_one_cost_their_differences(all_results: bool, order: int) -> None:
    steps = 2000
    parents = Counted([0, *range(steps)])
    ends = [(number, number - 1, number) for number in range(1, steps + 1)]
    kept = None if all_results else KeptSteps(parents, [(number,) for number in range(steps + 1)])
    paths = SearchPaths(kept, tuple, ends)
    looked = paths._get_end

    def count(step: int) -> Any:
        parents.looks += 1
        return looked(step)

    paths._get_end = count  # type: ignore[method-assign]
    for position in range(steps)[::order]:
        assert paths[position][-1] == (position + 1,)
        assert len(paths[position]) == position + 1
    assert parents.looks <= 5 * steps
    assert [paths[position] for position in (3, 1999, 3, 0)] == [list(paths)[p] for p in (3, 1999, 3, 0)]


# --- built-in functions that work through many values ---------------------------------------------------


LISTS = "zip(range({count}, 0, -1))"  # of one number each; Python compares them one by one
FUNCTIONS = {
    "zip": "zip(range({count}), range({count}))[0]", "uniq": f"uniq({LISTS})[0]", "sorted": f"sorted({LISTS})[0]",
    "min": f"min({LISTS})", "max": f"max({LISTS})", "in a query": f"SELECT len(uniq({LISTS})) FROM [1, 2]",
    "order": f"SELECT this FROM {LISTS} ORDER BY this LIMIT 1", "compared": f"uniq([{LISTS}])[0][0]",
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_built_in_function_asks_every_few_thousand_values(
    engine: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the run has to end; and it has its value where that goes on."""
    count = 200_000
    values = {"zip": [0, 0], "uniq": [count], "max": [count], "in a query": count, "compared": [count]}
    asked: list[Run] = []
    check = Run.check
    monkeypatch.setattr(Run, "check", lambda run: (asked.append(run), check(run)))
    script = FUNCTIONS[name].format(count=count) + (" AS value" if name in ("in a query", "order") else "")
    with ss2sql.connect() as ss:
        assert ss.eval(script, engine=engine) == values.get(name, [1])
    assert len(asked) >= 2 * count // 4096 - (name == "zip") * count // 4096


@pytest.mark.parametrize("seed", range(20))
def test_zip_measures_what_it_makes(seed: int) -> None:
    """As if the lists that it makes were measured themselves."""
    dice = random.Random(seed)
    make = [lambda: dice.randint(0, 9), lambda: "x" * dice.randint(0, 9), lambda: [1, [2]], lambda: {"a": [3]}]
    lists = [[dice.choice(make)() for _ in range(dice.randint(0, 30))] for _ in range(dice.randint(1, 3))]
    made = ValueSizes().zip_lists(*lists)
    assert made == [list(row) for row in zip(*lists, strict=False)]
    size = ValueSizes()._measure_value([made])[0]
    for limit in (size + 1, size, size - 1):
        assert _refused(ValueSizes(limit), lambda sizes: sizes.zip_lists(*lists)) == _refused(
            ValueSizes(limit),
            lambda sizes: (sizes.check_room(CELL_SIZE * (len(lists) + 1) * len(made)), sizes.check_value(made)),
        )


def _refused(sizes: ValueSizes, make: Callable[[ValueSizes], object]) -> str | None:
    try:
        make(sizes)
    except ss2sql.ExecutionError as error:
        return error.code
    return None


# --- a map of values ---------------------------------------------------------------------------------------

PLANE = 'SELECT p, v FROM points AS plane("XY", [0, 0], [{cells}, {cells}, 1], {blur})'


def points(value: float) -> list[dict[str, Any]]:
    return [{"p": [1.5, 1.5], "v": value} for _ in range(2)]


@pytest.mark.parametrize("blur", ["-1", "10001", "100000", "1e308", "-1e308", "10 ^ 18"])
def test_a_blur_has_a_bound(ss: ss2sql.Session, engine: Any, blur: str) -> None:
    ss.set("points", points(1.0))
    with pytest.raises(ss2sql.RepresentationError, match=r"V001.*a blur of 0 to 10,000 cells"):
        ss.run(PLANE.format(cells=100, blur=blur), engine=engine)


@pytest.mark.parametrize("blur", ["0", "1e-300", "0.001", "3", "10000"])
def test_a_blur_within_it_gives_numbers(ss: ss2sql.Session, engine: Any, blur: str) -> None:
    ss.set("points", points(1.0))
    grid = ss.eval(PLANE.format(cells=20, blur=blur), engine=engine)
    assert 0 <= grid.min() <= grid.max() <= 2
    assert grid.sum() == pytest.approx(2) or float(blur) > 1


@pytest.mark.parametrize(("value", "blur"), [(1e308, 0), (-1e308, 0), (1e308, 1)])
def test_values_that_add_up_to_no_number_are_an_error(ss: ss2sql.Session, engine: Any, value: float, blur: int) -> None:
    ss.set("points", points(value))
    with pytest.raises(ss2sql.RepresentationError, match="more than a float holds"):
        ss.run(PLANE.format(cells=3, blur=blur), engine=engine)


def test_a_timeout_ends_a_blur(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("points", points(1.0))
    started = time.process_time()
    with pytest.raises(ss2sql.Timeout):
        ss.run(PLANE.format(cells=2000, blur=10000), engine=engine, timeout=0.3)
    assert time.process_time() - started < 8
