"""Triggers: scripts that run every so often, and functions that are called when their values have changed.

Time is that of `getTime()`: the clock of the simulation where one is attached, else that of the computer. Nothing runs
by itself: a scene looks after the triggers while it steps, whoever steps a simulation by other means calls `poll`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError, note_on_exception
from ss2sql.language.values import convert_value, make_hashable

if TYPE_CHECKING:
    from ss2sql.session.compiled_script import Query


SLACK = 1e-6  # seconds: clocks add up steps, and what should be 0.1 s is often a little less


class Trigger:
    """A script and the function that hears of its changes; calling the trigger calls the function.

    - `value`: what the script gave last
    - `time`: when that was, in seconds of `getTime()`
    - `runs`, `changes`: how often the script ran, and how often its value had changed
    - `active`: False once it was stopped
    """

    def __init__(self, query: Query, every: float, callback: Callable[[Any], Any], now: float) -> None:
        self.query = query
        self.every = every
        self.callback = callback
        self.active = True
        self.runs = self.changes = 0
        self._running = False
        self._read_value(now)

    def __call__(self, value: Any) -> Any:
        return self.callback(value)

    def __repr__(self) -> str:
        name = getattr(self.callback, "__name__", repr(self.callback))
        state = f"{self.changes} changes in {self.runs} runs" if self.active else "stopped"
        return f"<trigger {name} every {self.every:g} s: {state}>"

    def stop(self) -> None:
        """Ends the trigger. Stopping twice does no harm."""
        self.active = False

    def run_if_due(self, now: float) -> bool:
        """Runs the script if it is time to, and the function if the value has changed; gives whether it has.

        It is time also after the clock was set back, as by a new simulation.
        """
        due = now - self.time >= self.every - SLACK or now < self.time
        if not self.active or self._running or not due:
            return False
        self._running = True  # the function may step the simulation, which looks after its triggers
        try:
            known = self._known
            self._read_value(now)
            if self._known == known:
                return False
            self.changes += 1
            try:
                self.callback(self.value)
            except Exception as error:
                name = getattr(self.callback, "__name__", repr(self.callback))
                span = self.query.plan.statements[-1].span
                place = f"{span.place} has changed\n  {span.line} | {span.source.get_line(span.line)}"
                note_on_exception(error, f"raised by the function '{name}', called because the value at {place}")
                raise
            return True
        finally:
            self._running = False

    def _read_value(self, now: float) -> None:
        self.time = now
        self.value = self.query.run().value
        self.runs += 1
        self._known = make_hashable(convert_value(self.value, "the script"))


class Triggers:
    """The triggers of a session, looked at in the order of their registration."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.all: list[Trigger] = []

    def add_trigger(self, query: Query, every: float, callback: Callable[[Any], Any]) -> Trigger:
        """A new trigger; its script runs now, to know the first value."""
        if isinstance(every, bool) or not isinstance(every, (int, float)) or not (0 < every < math.inf):
            raise SessionError("S002", f"every={every!r} is no time to wait", hints=("give seconds, more than 0",))
        if not callable(callback):
            hint = "give a function of one argument, the new value"
            raise SessionError("S002", f"a {type(callback).__name__} cannot be called back", hints=(hint,))
        trigger = Trigger(query, float(every), callback, self.clock())
        self.all.append(trigger)
        return trigger

    def run_due(self) -> int:
        """Runs what is due; gives the number of changes."""
        self.all = [trigger for trigger in self.all if trigger.active]
        now = self.clock() if self.all else 0.0
        return sum(trigger.run_if_due(now) for trigger in list(self.all))
