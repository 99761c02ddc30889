"""Triggers: scripts that run every so often, and functions that hear of changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from balls import BallWorld, Box
from sessions import Clock, code_of

import ss2sql


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def ss(ss: ss2sql.Session, clock: Clock) -> ss2sql.Session:
    ss.function("getTime", clock, volatility="volatile")
    ss.set("x", 1)
    return ss


@pytest.fixture
def after(ss: ss2sql.Session, clock: Clock) -> Callable[..., int]:
    """Lets time pass: polls every 0.05 seconds, and gives the number of changes."""

    def wait(seconds: float) -> int:
        changes = 0
        for _ in range(round(seconds / 0.05)):
            clock.now = round(clock.now + 0.05, 6)
            changes += ss.poll()
        return changes

    return wait


def test_the_function_hears_of_every_change_and_of_nothing_else(ss: ss2sql.Session, clock: Clock, after: Any) -> None:
    heard: list[tuple[float, Any]] = []
    numbers = [1, 5]
    ss.attach("numbers", numbers)

    @ss.on_change("SELECT this FROM numbers WHERE this > 3 AS list;", every=0.1)
    def changed(value: Any) -> None:
        heard.append((clock.now, value))

    assert changed.value == [5]
    assert after(1) == 0
    assert (heard, changed.runs, changed.changes) == ([], 11, 0)
    numbers.append(2)  # no change of the value
    assert after(0.1) == 0
    numbers.append(7)
    assert after(0.3) == 1
    assert heard == [(1.2, [5, 7])]
    assert (changed.value, changed.changes) == ([5, 7], 1)
    numbers.remove(7)
    assert after(0.1) == 1
    assert heard[1:] == [(1.5, [5])]
    changed.stop()
    changed.stop()
    numbers.append(9)
    assert after(1) == 0
    assert (changed.value, changed.active) == ([5], False)
    assert "stopped" in repr(changed)


def test_it_looks_no_more_often_than_asked(ss: ss2sql.Session, clock: Clock, after: Any) -> None:
    calls: list[float] = []
    ss.function("look", lambda: calls.append(clock.now) or 1, volatility="volatile")
    ss.on_change("look();", every=0.5)(print)
    after(2)
    assert calls == [0, 0.5, 1.0, 1.5, 2.0]
    clock.now = 10.0  # what was missed is not made up for
    assert ss.poll() == 0
    assert ss.poll() == 0
    assert calls[5:] == [10.0]
    clock.now = 0.0  # a clock that is set back does not silence it
    assert ss.poll() == 0
    assert calls[6:] == [0.0]


@pytest.mark.parametrize(
    ("before", "after", "changes"),
    [(1, 1.0, 0), (True, 1, 0), ([1, 2], [1.0, 2], 0), ([1, 2], [2, 1], 1), (None, 0, 1), ({"a": 1}, {"a": 2}, 1),
     ("a", "a", 0)],
)  # fmt: skip
def test_a_change_is_what_the_language_finds_different(
    ss: ss2sql.Session, clock: Clock, before: Any, after: Any, changes: int
) -> None:
    ss.set("x", before)
    ss.on_change("x;", every=1)(lambda value: None)
    ss.set("x", after)
    clock.now = 1.0
    assert ss.poll() == changes


def test_a_function_may_poll_stop_and_add_triggers(ss: ss2sql.Session, clock: Clock) -> None:
    heard: list[Any] = []

    @ss.on_change("x;", every=1)
    def first(value: Any) -> None:
        heard.append(("first", value))
        ss.poll()  # it is running, so it is not run inside of itself
        first.stop()
        ss.on_change("x;", every=1)(lambda value: heard.append(("later", value)))

    ss.on_change("x;", every=1)(lambda value: heard.append(("second", value)))
    ss.set("x", 2)
    clock.now = 1.0
    ss.poll()
    ss.set("x", 3)
    clock.now = 2.0
    ss.poll()
    assert heard == [("first", 2), ("second", 2), ("second", 3), ("later", 3)]


def test_errors(ss: ss2sql.Session, clock: Clock) -> None:
    with pytest.raises(ss2sql.ParseError):
        ss.on_change("SELECT;")
    with pytest.raises(ss2sql.ResolveError):
        ss.on_change("nothing;")(print)
    for every in (0, -1, float("nan"), float("inf"), "1", True):
        assert code_of(lambda every=every: ss.on_change("1;", every=every)(print)) == "S002"
    with pytest.raises(ss2sql.Error, match="cannot be called"):
        ss.on_change("1;")(5)  # type: ignore[arg-type]
    trigger = ss.on_change("1 / x;", every=1)(print)
    ss.set("x", 0)
    clock.now = 1.0
    assert code_of(ss.poll) == "X002"
    ss.set("x", 1)
    clock.now = 3.0
    assert ss.poll() == 0  # it goes on, and the value is what it was before
    assert trigger.active

    @ss.on_change("x;", every=1)
    def fails(value: Any) -> None:
        raise ZeroDivisionError

    ss.set("x", 2)
    clock.now = 4.0
    with pytest.raises(ZeroDivisionError):  # it is not hidden
        ss.poll()
    assert fails.value == 2


class Stepper(Box):
    """A simulation that tells of its steps, as a scene does; a ball is born every 0.1 s."""

    def step(self, n: int) -> None:
        for _ in range(n):
            self.time = round(self.time + 0.01, 6)
            self.balls = Box.row(int(self.time * 10 + 1e-9)).balls
            for listener in list(self.listeners):
                listener()


def test_a_scene_that_steps_looks_after_triggers_by_its_own_clock() -> None:
    stepper = Stepper(time=0.0)
    stepper.listeners = []
    heard: list[Any] = []
    with ss2sql.connect() as ss:
        ss.attach("space", BallWorld(stepper))
        trigger = ss.on_change("len(SELECT id FROM space AS list);", every=0.1)(heard.append)
        ss.run("since{0.2} = getTime();")
        stepper.step(50)
        assert heard == [1, 2, 3, 4, 5]
        assert (trigger.time, trigger.runs) == (0.5, 6)
        ss.run("since{0.2} = getTime();")
        assert ss.eval("since{};") == [0.0, 0.5]  # 0.0 was in force until now
        stepper.step(30)
        ss.run("since{0.2} = getTime();")
        assert ss.eval("since{};") == [0.5, 0.8]  # by the clock of the simulation 0.0 is too old
    stepper.step(50)
    assert heard == [1, 2, 3, 4, 5, 6, 7, 8]
    assert stepper.listeners == []


def test_a_detached_scene_runs_no_triggers_and_the_next_one_of_its_name_goes_on_with_them() -> None:
    old, new = Stepper(time=0.0), Stepper(time=0.0)
    old.listeners, new.listeners = [], []
    heard: list[Any] = []
    with ss2sql.connect() as ss:
        for name in ("space", "same"):
            ss.attach(name, BallWorld(old))
        ss.on_change("len(SELECT id FROM space AS list);", every=0.1)(heard.append)
        ss.detach("same")
        old.step(20)
        ss.detach("space")
        old.step(20)
        assert (heard, old.listeners) == ([1, 2], [])
        assert code_of(ss.poll) == "R003"
        ss.attach("space", BallWorld(new))
        new.step(30)
        assert heard == [1, 2, 0, 1, 2]  # at 0.01, 0.11 and 0.21 s
        ss.attach("space", BallWorld(old))
        assert new.listeners == []
        assert len(old.listeners) == 1
