"""What the native executor saves, told by counted calls and by its generated code; and that nothing else changes."""

from __future__ import annotations

import re
from typing import Any

import pytest
from native_host import generated_code

import ss2sql
from ss2sql import plan
from ss2sql.runtime.functions import user_function
from ss2sql.runtime.native.calls import RememberedCalls, exact_key
from ss2sql.runtime.run import Run


def calls_of(function: Any, limit: int = 100, volatility: plan.Volatility | None = "immutable") -> tuple[Run, Any]:
    run: Any = Run(None)  # type: ignore[arg-type]
    return run, RememberedCalls(user_function("f", function, volatility), run, limit)


def test_all_ways_of_calling_share_what_is_remembered() -> None:
    run, calls = calls_of(lambda *arguments: len(arguments))
    for arguments in ((1, "a"), (1, None), ([1], 2), ([[1]], "a")):
        keys = tuple(map(exact_key, arguments))
        assert [calls.of_any(*arguments)[0], calls.of_keys(keys, *arguments)[0]] == [2, 2]
    assert calls.of_plain(1, "a")[0] == 2
    calls.settle()
    assert (run.stats.calls["f"], run.stats.remembered["f"]) == (4, 5)


def test_equal_arguments_of_other_kinds_are_other_arguments() -> None:
    run, calls = calls_of(lambda value: str(value))
    given: list[Any] = [1, 1.0, True, [1], [1.0], [True], 0.0, -0.0, None, "1"]
    assert [calls.of_any(value)[0] for value in given] == list(map(str, given))
    calls.settle()
    assert run.stats.calls["f"] == len(given)


def test_a_function_may_change_what_it_gets_however_it_is_called() -> None:
    def grown(values: list[int]) -> list[int]:
        values.append(9)
        return values

    _, calls = calls_of(grown)
    value = [1]
    assert calls.of_keys((exact_key(value),), value)[0] == [1, 9]
    assert calls.of_any([2])[0] == [2, 9]
    assert (value, calls.of_any(value)[0]) == ([1], [1, 9])


def test_the_memory_of_calls_is_bounded() -> None:
    run, calls = calls_of(lambda value: [value], limit=10)
    for value in range(100):
        assert calls.of_plain(value)[0] == [value]
    assert calls.of_plain(99)[0] == [99]
    calls.settle()
    assert (run.stats.calls["f"], run.stats.remembered["f"]) == (100, 1)


def test_objects_inside_of_arguments_are_told_apart() -> None:
    class Thing:
        __slots__ = ("name",)

        def __init__(self, name: str) -> None:
            self.name = name

    one, other = Thing("one"), Thing("other")
    run, calls = calls_of(lambda values: values[0].name)
    assert [calls.of_any([thing])[0] for thing in (one, other, one)] == ["one", "other", "one"]
    calls.settle()
    assert run.stats.calls["f"] == 2


@pytest.mark.parametrize(
    "value",
    [[1.5, 2], [True], [(1, 2)], [2**40], ["text with ({<"], [[1, [2, [3]]]], {"a": 1}, [None, "x"], [[], []], (1, 2)],
)
def test_results_are_values_with_their_frozen_forms(value: Any) -> None:
    from ss2sql.runtime.values import freeze, normalise

    _, calls = calls_of(lambda: value)
    found, frozen = calls.of_any()
    assert found == normalise(value, "the function 'f'")
    assert frozen is None or frozen == freeze(found)


def test_a_result_that_contains_itself_is_refused() -> None:
    def endless() -> list[Any]:
        inner: list[Any] = []
        inner += [inner, inner]
        return [[inner, inner]]

    _, calls = calls_of(endless)
    with pytest.raises(ss2sql.ExecutionError) as caught:
        calls.of_any()
    assert caught.value.code == "X004"


def session() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.set("moves", [{"dx": 1, "cost": 2}, {"dx": -1, "cost": 1}])
    ss.set("row", [0, 0, 0, 0, 1])
    return ss


@pytest.mark.parametrize("engine", ["database", "native"])
def test_an_index_that_is_out_of_range_says_so(engine: Any) -> None:
    script = "SELECT x, dx FROM moves START WITH x = 0 CONNECT BY UNIQUE x = x + dx STOP WITH row[x + dx + 3] == 2;"
    with pytest.raises(ss2sql.ExecutionError) as caught:
        session().run(script, engine=engine)
    assert caught.value.code == "X003"
    assert "index 5 is out of range" in str(caught.value)


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize(
    ("known", "value", "is_in"),
    [([1, [2, 3]], 1.0, True), ([1, [2, 3]], [2.0, True + 2], True), (["a"], "b", False), ([], 1, False)],
)
def test_membership_is_asked_by_equality(engine: Any, known: list[Any], value: Any, is_in: bool) -> None:
    ss = ss2sql.connect()
    ss.set("known", known)
    ss.set("value", value)
    script = "SELECT value IN known, value NOT IN known FROM [1, 2] AS list;"
    assert ss.run(script, engine=engine).value == [is_in, not is_in] * 2


def test_an_expression_that_is_certain_to_be_computed_is_written_once() -> None:
    ss = session()
    query = ss.compile(
        """SELECT to(x + dx, at) FROM moves WHERE x + dx == 4 START WITH x = 0
           CONNECT BY COST cost UNIQUE x = x + dx STOP WITH row[x + dx] == 1 AS list;""",
        engine="native",
    )
    values: list[Any] = []
    texts = generated_code(lambda: values.append(query.run().value))
    assert values == [[[1, 2, 3, 4]]]
    assert [len(re.findall(r"x_\d+ \+ ", text)) for text in texts] == [1]
