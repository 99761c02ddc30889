"""Python functions in scripts: how often they are called, which is what their volatility says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sessions import both

import ss2sql


class Counted:
    """A function that notes its arguments."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def __call__(self, *arguments: Any) -> Any:
        self.seen.append(arguments[0] if len(arguments) == 1 else arguments)
        return arguments[0]


@both
def test_an_immutable_function_is_called_once_for_each_different_argument(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    values = [1, 1.0, True, 0, False, 0.0, -0.0, "1", None, [1], [1.0], [True], {"a": 1}, {"a": 1.0}]
    ss.attach("items", values * 3)
    result = ss.run("SELECT f(this), f(this) FROM items WHERE f(this) == this AS list;", engine=engine)
    assert repr(result.value) == repr([value for value in values * 3 for _ in range(2)])
    assert repr(f.seen) == repr(values)
    assert result.stats.calls == {"f": len(values)}


@both
@pytest.mark.parametrize("arguments", [(1, 1.0), (1.0, 1), ("a", 0.0), (-0.0, "a"), (None, True), ([1], 2)])
def test_all_arguments_count(ss: ss2sql.Session, engine: Any, arguments: tuple[Any, ...]) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("a", [arguments[0]])
    ss.attach("b", [arguments[1]])
    script = "SELECT f(a.this, b.this), f(b.this, a.this), f(a.this, b.this) FROM a, b, c = [1, 2] AS list;"
    result = ss.run(script, engine=engine)
    assert repr(f.seen) == repr([arguments, arguments[::-1]])
    assert result.stats.calls == {"f": 2}


@both
def test_a_stable_function_is_called_once_in_a_run(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="stable")
    query = ss.compile("SELECT f(1) FROM [1, 2, 3] AS list;")
    query.run(engine=engine)
    query.run(engine=engine)
    assert f.seen == [1, 1]


@both
def test_a_stable_function_is_asked_anew_by_the_next_statement(ss: ss2sql.Session, engine: Any) -> None:
    """What it looks at may have been moved in between."""
    places = {"robot": 1}
    f = ss.function("place", Counted(), volatility="stable")
    ss.function("where", lambda name: f(name) and places[name], volatility="stable")
    ss.function("move", lambda name, place: places.update({name: place}) or place, volatility="volatile")
    script = """before = SELECT where("robot") + this FROM [0, 1] AS list;
                move("robot", 5);
                after = SELECT where("robot") + this FROM [0, 1] AS list;
                alone = where("robot");
                move("robot", 7);
                [before, after, alone, where("robot")];"""
    assert ss.run(script, engine=engine if engine == "native" else "auto").value == [[1, 2], [5, 6], 5, 7]
    assert len(f.seen) == 4


@both
def test_a_volatile_function_is_called_for_every_occurrence_in_written_order(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="volatile")
    g = ss.function("g", Counted(), volatility="volatile")
    result = ss.run("SELECT f(this), g(0), f(this) FROM [1, 2, 3] WHERE f(this) > 1 AND g(5) AS list;", engine=engine)
    assert result.value == [2, 0, 2, 3, 0, 3]
    assert f.seen == [1, 2, 2, 2, 3, 3, 3]
    assert g.seen == [5, 0, 5, 0]
    assert result.stats.calls == {"f": 7, "g": 4}


@both
def test_what_the_left_side_decides_is_not_called(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="volatile")
    ss.run("SELECT this FROM [1, 2, 3] WHERE this > 1 AND f(this) > 2 OR this == 1 OR f(10);", engine=engine)
    assert f.seen == [2, 10, 3]
    f.seen.clear()
    ss.run("SELECT IF(this > 1; f(this); f(-this)) FROM [1, 2];", engine=engine)
    assert f.seen == [-1, 2]


@both
@pytest.mark.parametrize("volatility", ["immutable", "volatile"])
def test_without_a_memo_results_are_the_same(engine: Any, volatility: Any) -> None:
    with ss2sql.connect(disable=["memo"]) as ss:
        f = ss.function("f", Counted(), volatility=volatility)
        result = ss.run("SELECT f(this) FROM [1, 1, 2, 1] AS list;", engine=engine)
        assert result.value == f.seen == [1, 1, 2, 1]
        assert result.stats.calls == {"f": 4}


def test_old_entries_leave_a_full_memo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.runtime.host.MEMO_LIMIT", 2)
    with ss2sql.connect() as ss:
        for engine in ("database", "native"):
            f = ss.function("f", Counted(), volatility="immutable")
            result = ss.run("SELECT f(this) FROM [1, 2, 1, 3, 1, 2.0, 2] AS list;", engine=engine)  # type: ignore[arg-type]
            assert repr(result.value) == "[1, 2, 1, 3, 1, 2.0, 2]"
            assert repr(f.seen) == "[1, 2, 3, 1, 2.0, 2]"
            assert result.stats.remembered == {"f": 1}


@both
def test_calls_are_counted_for_each_run(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", Counted(), volatility="immutable")
    query = ss.compile("SELECT f(this) FROM [1, 2] AS list;")
    assert [query.run(engine=engine).stats.calls["f"] for _ in range(2)] == [2, 2]


@both
def test_objects_are_told_apart_by_identity(ss: ss2sql.Session, engine: Any) -> None:
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("items", [first, second, first, [first], [second], [first]])
    result = ss.run("SELECT f(this) FROM items AS list;", engine=engine)
    assert f.seen == [first, second, [first], [second]]
    assert result.value[5][0] is first


@both
def test_what_was_proved_of_plain_data_is_not_trusted_with_objects(ss: ss2sql.Session, engine: Any) -> None:
    class Dice:
        value = 0

        def __add__(self, other):
            self.value += 1
            return self.value

    dice = Dice()
    ss.function("roll", lambda x: x + 1)
    ss.function("roll_first", lambda x: x[0] + 1)
    assert ss.host.functions["roll"].volatility == ss.host.functions["roll_first"].volatility == "immutable"
    ss.attach("items", [dice, dice, dice])
    assert ss.run("SELECT roll(this) FROM items AS list;", engine=engine).value == [1, 2, 3]
    ss.attach("items", [[dice], [dice]])
    assert ss.run("SELECT roll_first(this) FROM items AS list;", engine=engine).value == [4, 5]


@pytest.mark.parametrize(
    "script",
    [
        "SELECT tick() FROM [2, 1] ORDER BY this;",
        "SELECT this, max(tick()) FROM [2, 1] GROUP BY this;",
        "SELECT len(SELECT tick() FROM [1] AS list) FROM [2, 1];",
        "SELECT tick() FROM [2, 1] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 0;",
    ],
)
def test_the_database_refuses_volatile_calls_out_of_the_written_order(script: str) -> None:
    with ss2sql.connect() as ss:
        ss.function("tick", lambda: 1, volatility="volatile")
        with pytest.raises(ss2sql.UnsupportedError, match="volatile function must be called in written order"):
            ss.run(script, engine="database")
        assert ss.run(script).engine == "native"
