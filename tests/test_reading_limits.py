"""The limits of a run hold while its value is built, whoever asks for it; paths cost what they have of their own."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import pytest
from sessions import both

import ss2sql
from ss2sql.runtime.run.search_paths import KeptSteps, SearchPaths

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


@both
@pytest.mark.parametrize("name", READERS)
def test_a_timeout_ends_the_building_of_a_value(engine: Any, name: str) -> None:
    script, read = READERS[name]
    with session() as ss:
        started = time.process_time()
        with pytest.raises(ss2sql.Timeout) as caught:
            read(ss.run(script, engine=engine, timeout=0.2))
        assert time.process_time() - started < 10
        assert caught.value.code == "T001"
        assert caught.value.partial.status == "timeout"
        assert caught.value.partial.value is None
        assert ss.eval("1 + 1") == 2


@both
@pytest.mark.parametrize("name", ["AS dict", "AS list", "groups", "paths", "inside"])  # which fill memory soon
def test_max_memory_bounds_the_value(engine: Any, name: str) -> None:
    script, read = READERS[name]
    with session(max_memory=20_000_000) as ss, pytest.raises(ss2sql.OutOfMemory) as caught:
        read(ss.run(script, engine=engine))
    assert caught.value.code == "T003"


def test_a_list_of_paths_in_a_script_is_measured_before_it_is_made() -> None:
    with session() as ss, pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(f"x = ({chain('AS list')}); len(x)", engine="database")
    assert caught.value.code == "X014"


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


@pytest.mark.xfail(strict=True, reason="the rewrite of the step function keeps steps in place of paths")
def test_a_native_search_keeps_steps_and_no_paths() -> None:
    """The paths of 2,000 steps in a row have 16 MB."""
    with session() as ss:
        query = ss.compile(chain("AS list", steps=2000).replace("CONNECT BY", "CONNECT BY UNIQUE"), engine="native")
        tracemalloc.start()
        try:
            result = query.run()
            assert len(result) == 1999 * 2000 // 2
            assert tracemalloc.get_traced_memory()[1] < 4_000_000
        finally:
            tracemalloc.stop()
