"""Temporal variables: values with the time when they were stored.

The latest value is never lost by age. Older ones are kept while they were in force during the last `keep`
seconds, which means: until the value after them is older than that. Bounds are inclusive.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Callable
from math import isfinite
from typing import Any

import apsw

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.language.values import convert_value, format_value


def convert_seconds(value: Any, what: str) -> float:
    """A number of seconds; raises ExecutionError X007 for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = "write a number: v{5.0} = x, v{-2.0}, or v{} for all values"
        raise ExecutionError("X007", f"{what} is a number of seconds, not {format_value(value)}", hints=(hint,))
    return value


def convert_moment(value: Any, giver: str) -> float:
    """The seconds that a clock gives; raises ExecutionError X004 for what is no finite number."""
    try:
        moment = float(value)
    except Exception as error:  # the value is the user's own, and so is how it becomes a number
        raise _build_time_error(value, giver) from error
    if not isfinite(moment):
        raise _build_time_error(value, giver)
    return moment


def _build_time_error(value: Any, giver: str) -> ExecutionError:
    hint = "a clock gives a number of seconds"
    return ExecutionError("X004", f"{giver} says {format_value(value)}, which is no time", hints=(hint,))


class TemporalStore:
    """The histories of all temporal variables of a session; `clock` gives the time in seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.histories: dict[str, list[tuple[float, Any]]] = {}
        self.keeps: dict[str, float] = {}

    def store_value(self, name: str, keep: Any, value: Any) -> None:
        """`name{keep} = value`."""
        kept = convert_seconds(keep, "the time to keep")
        if kept < 0:
            hint = "v{5.0} = x keeps the values of the last 5 seconds"
            raise ExecutionError(
                "X007", f"the time to keep is at least 0 seconds, not {format_value(keep)}", hints=(hint,)
            )
        now = self.clock()
        history = self.histories.setdefault(name, [])
        history.append((now, value))
        self.keeps[name] = kept
        self._forget_old(name, now)

    def _forget_old(self, name: str, now: float) -> None:
        history, oldest = self.histories[name], now - self.keeps[name]
        while len(history) > 1 and history[1][0] < oldest:
            del history[0]

    def read_values(self, name: str, when: Any) -> Any:
        """`name{}` (when is None) is the list of kept values; `name{-2.0}` those in force in the last two
        seconds, `name{22.2}` the one in force at that time, or None. Raises KeyError for an unknown name."""
        history = self.histories[name]
        now = self.clock()
        self._forget_old(name, now)
        if when is None:
            return [value for _, value in history]
        moment = convert_seconds(when, "the moment")
        times = [time for time, _ in history]
        if moment >= 0:
            index = bisect_right(times, moment) - 1
            return history[index][1] if index >= 0 else None
        start = now + moment
        first = next((i for i in range(len(times) - 1) if times[i + 1] >= start), len(times) - 1)
        # A value is in force until the next one comes; at the very moment of the change both count.
        return [value for _, value in history[first:]]

    def get_latest(self, name: str) -> Any:
        """The value that `name` alone means."""
        return self.histories[name][-1][1]

    def get_history(self, name: str) -> tuple[list[tuple[float, Any]], float] | None:
        """The history of a variable and its `keep`, for `restore_history`; None if it has none."""
        history = self.histories.get(name)
        return None if history is None else (list(history), self.keeps[name])

    def restore_history(self, name: str, before: tuple[list[tuple[float, Any]], float] | None) -> None:
        """Restores a history that `get_history` gave."""
        self.drop_history(name)
        if before is not None:
            self.histories[name], self.keeps[name] = before

    def drop_history(self, name: str) -> None:
        self.histories.pop(name, None)
        self.keeps.pop(name, None)


class TemporalFile:
    """Temporal variables in the session's database file, in the table `ss2sql_temporal`.

    The table has one row per kept value: the variable's name, the time in seconds, the value as JSON and the
    seconds to keep. A value that JSON has no form for, such as an object of Python, lives in memory only.
    """

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection

    def load_store(self, store: TemporalStore) -> None:
        """Fills the store from the file. Raises SessionError S002 if the file is damaged."""
        try:
            if not self.connection.execute("SELECT 1 FROM sqlite_schema WHERE name = 'ss2sql_temporal'").fetchall():
                return
            rows: list[tuple[Any, ...]] = self.connection.execute(
                "SELECT name, time, value, keep FROM ss2sql_temporal ORDER BY rowid"
            ).fetchall()
            for row in rows:
                name, moment, value, keep = _decode_history_row(*row)
                store.histories.setdefault(name, []).append((moment, value))
                store.keeps[name] = keep
        except (apsw.Error, ExecutionError, ValueError, TypeError, RecursionError) as error:
            hints = ("another program may be writing to the file, or it is damaged; the table can be dropped",)
            message = f"the table ss2sql_temporal of the file cannot be read: {error}"
            if isinstance(error, ExecutionError):
                message = f"the table ss2sql_temporal of the file cannot be read: {error.message}"
            raise SessionError("S002", message, hints=hints) from error

    def save_history(self, store: TemporalStore, name: str) -> None:
        """Writes the history of one variable to the file, or deletes it there."""
        try:
            rows = [
                (name, moment, _encode_json(value), store.keeps[name])
                for moment, value in store.histories.get(name, ())
            ]
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


def _decode_history_row(name: Any, moment: Any, value: Any, keep: Any) -> tuple[str, float, Any, float]:
    """A row of the table. Raises ValueError, TypeError or ExecutionError for a row that was not written here."""
    if not (type(name) is str and type(value) is str and type(moment) is float and type(keep) is float):
        raise ValueError("a row has values of other types")
    return name, moment, convert_value(json.loads(value), f"the variable '{name}'"), keep


def _encode_json(value: Any) -> str:
    """The value as JSON. Raises TypeError if JSON would give back another one, as for a dict with numbers as keys."""
    text = json.dumps(value)
    if json.loads(text) != value:
        raise TypeError
    return text
