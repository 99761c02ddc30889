"""Temporal variables: values with the time when they were stored.

The latest value is never lost by age. Older ones are kept while they were in force during the last `keep`
seconds, which means: until the value after them is older than that. Bounds are inclusive.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import apsw

from ss2sql.errors import ExecutionError
from ss2sql.runtime.values import show


def seconds(value: Any, what: str) -> float:
    """A number of seconds; raises ExecutionError X007 for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = "write a number: v{5.0} = x, v{-2.0}, or v{} for all values"
        raise ExecutionError("X007", f"{what} is a number of seconds, not {show(value)}", hints=(hint,))
    return value


class TemporalStore:
    """The histories of all temporal variables of a session; `clock` gives the time in seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.histories: dict[str, list[tuple[float, Any]]] = {}
        self.keeps: dict[str, float] = {}

    def store(self, name: str, keep: Any, value: Any) -> None:
        """`name{keep} = value`."""
        kept = seconds(keep, "the time to keep")
        if kept < 0:
            hint = "v{5.0} = x keeps the values of the last 5 seconds"
            raise ExecutionError("X007", f"the time to keep is at least 0 seconds, not {show(keep)}", hints=(hint,))
        now = self.clock()
        history = self.histories.setdefault(name, [])
        history.append((now, value))
        self.keeps[name] = kept
        self._forget(name, now)

    def _forget(self, name: str, now: float) -> None:
        history, oldest = self.histories[name], now - self.keeps[name]
        while len(history) > 1 and history[1][0] < oldest:
            del history[0]

    def read(self, name: str, when: Any) -> Any:
        """`name{}` (when is None) is the list of kept values; `name{-2.0}` those in force in the last two
        seconds, `name{22.2}` the one in force at that time, or None. Raises KeyError for an unknown name."""
        history = self.histories[name]
        now = self.clock()
        self._forget(name, now)
        if when is None:
            return [value for _, value in history]
        moment = seconds(when, "the moment")
        times = [time for time, _ in history]
        if moment >= 0:
            index = bisect_right(times, moment) - 1
            return history[index][1] if index >= 0 else None
        start = now + moment
        first = next((i for i in range(len(times) - 1) if times[i + 1] >= start), len(times) - 1)
        # A value is in force until the next one comes; at the very moment of the change both count.
        return [value for _, value in history[first:]]

    def latest(self, name: str) -> Any:
        """The value that `name` alone means."""
        return self.histories[name][-1][1]

    def drop(self, name: str) -> None:
        self.histories.pop(name, None)
        self.keeps.pop(name, None)


class TemporalFile:
    """Temporal variables in the session's database file, in the table `ss2sql_temporal`.

    The table has one row per kept value: the variable's name, the time in seconds, the value as JSON and the
    seconds to keep. A value that JSON has no form for, such as an object of Python, lives in memory only.
    """

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection

    def load(self, store: TemporalStore) -> None:
        """Fills the store with what an earlier session has kept."""
        if not self.connection.execute("SELECT 1 FROM sqlite_schema WHERE name = 'ss2sql_temporal'").fetchall():
            return
        rows: list[tuple[Any, ...]] = self.connection.execute(
            "SELECT name, time, value, keep FROM ss2sql_temporal ORDER BY rowid"
        ).fetchall()
        for name, moment, value, keep in rows:
            store.histories.setdefault(name, []).append((moment, json.loads(value)))
            store.keeps[name] = keep

    def save(self, store: TemporalStore, name: str) -> None:
        """Puts the history of one variable, or its end, into the file."""
        try:
            rows = [(name, moment, _json(value), store.keeps[name]) for moment, value in store.histories.get(name, ())]
        except TypeError:
            rows = []
        try:
            with self.connection:
                self.connection.execute(
                    "CREATE TABLE IF NOT EXISTS ss2sql_temporal(name TEXT, time REAL, value TEXT, keep REAL)"
                )
                self.connection.execute("DELETE FROM ss2sql_temporal WHERE name = ?", (name,))
                self.connection.executemany("INSERT INTO ss2sql_temporal VALUES (?, ?, ?, ?)", rows)
        except apsw.Error as error:
            hints = ("open the session with read_only=True to keep temporal variables in memory",)
            raise ExecutionError("X009", f"'{name}' cannot be kept in the file: {error}", hints=hints) from error


def _json(value: Any) -> str:
    """The value as JSON. Raises TypeError where JSON would give back another one, as of a dict with numbers as keys."""
    text = json.dumps(value)
    if json.loads(text) != value:
        raise TypeError
    return text
