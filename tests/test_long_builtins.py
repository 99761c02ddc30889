"""Built-in functions and representations that work through many values end with the run, or have a bound."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import Any

import pytest
from sessions import both

import ss2sql
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.run.value_sizes import CELL_SIZE, ValueSizes

LISTS = "zip(range({count}, 0, -1))"  # of one number each; Python compares them one by one
FUNCTIONS = {
    "zip": "zip(range({count}), range({count}))[0]", "uniq": f"uniq({LISTS})[0]", "sorted": f"sorted({LISTS})[0]",
    "min": f"min({LISTS})", "max": f"max({LISTS})", "in a query": f"SELECT len(uniq({LISTS})) FROM [1, 2]",
    "order": f"SELECT this FROM {LISTS} ORDER BY this LIMIT 1", "compared": f"uniq([{LISTS}])[0][0]",
}  # fmt: skip


@both
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_timeout_ends_a_built_in_function(engine: Any, name: str) -> None:
    script = FUNCTIONS[name].format(count=9_000_000)
    with ss2sql.connect() as ss:
        started = time.process_time()
        with pytest.raises(ss2sql.Timeout):
            ss.run(script, engine=engine, timeout=0.3)
        assert time.process_time() - started < 8
        assert ss.eval("1 + 1") == 2


@both
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_built_in_function_asks_every_few_thousand_values(
    engine: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Run] = []
    check = Run.check
    monkeypatch.setattr(Run, "check", lambda run: (asked.append(run), check(run)))
    with ss2sql.connect() as ss:
        ss.run(FUNCTIONS[name].format(count=200_000), engine=engine)
    assert len(asked) >= 2 * 200_000 // 4096 - (name == "zip") * 200_000 // 4096


@both
@pytest.mark.parametrize("name", FUNCTIONS)
def test_with_time_enough_they_have_their_values(engine: Any, name: str) -> None:
    values = {"zip": [0, 0], "uniq": [9000], "max": [9000], "in a query": 9000, "compared": [9000]}
    with ss2sql.connect() as ss:
        script = FUNCTIONS[name].format(count=9000)
        found = ss.eval(script + (" AS value" if "SELECT" in script else ""), engine=engine)
        assert found == values.get(name, [1])


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


@both
@pytest.mark.parametrize("blur", ["-1", "10001", "100000", "1e308", "-1e308", "10 ^ 18"])
def test_a_blur_has_a_bound(ss: ss2sql.Session, engine: Any, blur: str) -> None:
    ss.set("points", points(1.0))
    with pytest.raises(ss2sql.RepresentationError, match="a blur of 0 to 10,000 cells") as caught:
        ss.run(PLANE.format(cells=100, blur=blur), engine=engine)
    assert caught.value.code == "V001"


@both
@pytest.mark.parametrize("blur", ["0", "1e-300", "0.001", "3", "10000"])
def test_a_blur_within_it_gives_numbers(ss: ss2sql.Session, engine: Any, blur: str) -> None:
    ss.set("points", points(1.0))
    grid = ss.eval(PLANE.format(cells=20, blur=blur), engine=engine)
    assert 0 <= grid.min() <= grid.max() <= 2
    assert grid.sum() == pytest.approx(2) or float(blur) > 1


@both
@pytest.mark.parametrize(("value", "blur"), [(1e308, 0), (-1e308, 0), (1e308, 1)])
def test_values_that_add_up_to_no_number_are_an_error(ss: ss2sql.Session, engine: Any, value: float, blur: int) -> None:
    ss.set("points", points(value))
    with pytest.raises(ss2sql.RepresentationError, match="more than a float holds"):
        ss.run(PLANE.format(cells=3, blur=blur), engine=engine)


@both
def test_a_timeout_ends_a_blur(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("points", points(1.0))
    started = time.process_time()
    with pytest.raises(ss2sql.Timeout):
        ss.run(PLANE.format(cells=2000, blur=10000), engine=engine, timeout=0.3)
    assert time.process_time() - started < 8
