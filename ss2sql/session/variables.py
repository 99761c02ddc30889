"""What scripts see of a session: variables, temporal ones among them, and its functions; and triggers.

The latest value is never lost by age. Older ones are kept while they were in force during the last `keep`
seconds, which means: until the value after them is older than that. Bounds are inclusive.

Time is that of `getTime()`: the clock of the simulation where one is attached, else that of the computer. Nothing runs
by itself: a scene looks after the triggers while it steps, whoever steps a simulation by other means calls `poll`.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import apsw

from ss2sql.errors import ExecutionError, SessionError, note_on_exception, suggest_names
from ss2sql.errors.exceptions import escape_controls
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Type, type_of
from ss2sql.language.values import UNSET, convert_value, copy_for_python, format_value, make_hashable
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.vtables.frames import Reader

if TYPE_CHECKING:
    from ss2sql.runtime.external.duckdb_sources import DuckSources
    from ss2sql.session.compiled_script import Query
    from ss2sql.session.host import SessionHost
    from ss2sql.vtables.attached_worlds import AttachedWorld


# --- the variables of a session: what scripts assign, what Python sets or attaches, and temporal variables
def convert_variable_seconds(value: Any, what: str) -> float:
    """A number of seconds; raises ExecutionError X007 for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = "write a number: v{5.0} = x, v{-2.0}, or v{} for all values"
        raise ExecutionError("X007", f"{what} is a number of seconds, not {format_value(value)}", hints=(hint,))
    return value


def convert_clock_time(value: Any, giver: str) -> float:
    """The seconds that a clock gives; raises ExecutionError X004 for what is no finite number."""
    try:
        moment = float(value)
    except Exception:  # the value is the user's own, and so is how it becomes a number
        moment = math.nan
    if not math.isfinite(moment):
        hint = "a clock gives a number of seconds"
        raise ExecutionError("X004", f"{giver} says {format_value(value)}, which is no time", hints=(hint,))
    return moment


History: TypeAlias = tuple[list[tuple[float, Any]], float]  # the kept values with their times, and the seconds to keep


def keep_in_force(values: list[tuple[float, Any]], seconds: float, now: float) -> list[tuple[float, Any]]:
    """The values that were in force during the last seconds; the latest in any case.

    A value is in force until the next one comes; at the very moment of the change both count.
    """
    first = next((i for i in range(len(values) - 1) if values[i + 1][0] >= now - seconds), len(values) - 1)
    return values[first:]


class TemporalFile:
    """Temporal variables in the session's database file, in the table `ss2sql_temporal`.

    The table has one row per kept value: the variable's name, the time in seconds, the value as JSON and the
    seconds to keep. A value that JSON has no form for, such as an object of Python, lives in memory only.
    """

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection

    def load_histories(self) -> dict[str, History]:
        """The histories in the file. Raises SessionError S002 if the file is damaged."""
        found: dict[str, History] = {}
        try:
            if not self.connection.execute("SELECT 1 FROM sqlite_schema WHERE name = 'ss2sql_temporal'").fetchall():
                return found
            rows: list[tuple[Any, ...]] = self.connection.execute(
                "SELECT name, time, value, keep FROM ss2sql_temporal ORDER BY rowid"
            ).fetchall()
            for row in rows:
                name, moment, value, keep = _decode_history_row(*row)
                values, _ = found.get(name, ([], keep))
                values.append((moment, value))
                found[name] = values, keep
            return found
        except (apsw.Error, ExecutionError, ValueError, TypeError, RecursionError) as error:
            hints = ("another program may be writing to the file, or it is damaged; the table can be dropped",)
            reason = error.message if isinstance(error, ExecutionError) else error
            message = f"the table ss2sql_temporal of the file cannot be read: {reason}"
            raise SessionError("S002", message, hints=hints) from error

    def save_history(self, name: str, history: History | None) -> None:
        values, keep = history or ((), 0.0)
        try:
            rows = [(name, moment, _encode_variable_as_json(value), keep) for moment, value in values]
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


def _encode_variable_as_json(value: Any) -> str:
    """The value as JSON. Raises TypeError if JSON would give back another one, as for a dict with numbers as keys."""
    text = json.dumps(value)
    if json.loads(text) != value:
        raise TypeError
    return text


class Variables:
    """Values of the language by name.

    An attached object is read anew by every run, which then keeps what it has read. `late` holds list
    literals that are resolved where they are used. `clock` gives the time in seconds of temporal variables, `histories`
    are theirs; with a `file` they outlive the session.
    """

    def __init__(
        self, clock: Callable[[], float], histories: dict[str, History], file: TemporalFile | None = None
    ) -> None:
        self.values: dict[str, Any] = {}
        self.attached: dict[str, Any] = {}
        self.worlds: dict[str, AttachedWorld] = {}  # those among what is attached
        self.frames: dict[str, Reader] = {}  # what reads the data frames among what is attached
        self.others: DuckSources | None = None  # what stands in FROM where nothing else has the name
        self.let_go: Callable[[AttachedWorld], None] = lambda world: None  # hears of worlds that make room
        self.late: dict[str, ast.ListLiteral] = {}
        self.clock = clock
        self.histories = histories
        self.file = file
        self.values.update((name, values[-1][1]) for name, (values, _) in histories.items())
        self._types: dict[str, tuple[Any, Type]] = {}  # of values that stand in `values`

    def __contains__(self, name: str) -> bool:
        return name in self.values or name in self.attached

    def __iter__(self) -> Iterator[str]:
        yield from self.values
        yield from self.attached

    def get_source(self, name: str) -> Any:
        """The present value, or the data frame, as it stands in FROM.

        Raises KeyError; ExecutionError X004 where an attached object holds no value.
        """
        if name in self.frames:
            return self.frames[name]()
        if name in self.attached:
            return convert_value(self.attached[name], f"the variable '{name}'", named=True)
        reader = None if self.others is None else self.others.find_reader(name)
        return self.values[name] if reader is None else reader()

    def get_type(self, name: str, value: Any) -> Type:
        """The type of `value`, which a script has for `name`; that of a list of 50,000 dicts takes 30 ms.

        Nobody changes the value of a script variable in place, so that it is looked at once. What is attached, or given
        to a run, the user may have changed.
        """
        if value is not self.values.get(name, UNSET):
            return type_of(value)
        looked_at, known = self._types.get(name, (UNSET, ANY))
        if looked_at is not value:
            known = type_of(value)
            self._types[name] = value, known
        return known

    def is_frame(self, name: str) -> bool:
        """Whether a name stands for a data frame, or a table that is read as one."""
        return name in self.frames or (self.others is not None and self.others.find_reader(name) is not None)

    def read_value(self, name: str, run: Run) -> Any:
        """The value, or the data frame, in a run; raises ExecutionError R001 before the first assignment."""
        if name in run.snapshots:
            return run.snapshots[name]
        if name not in self and (self.others is None or self.others.find_reader(name) is None):
            hints = ("assign it before it is read",)
            raise ExecutionError("R001", f"the variable '{name}' has no value yet", hints=hints)
        value = self.get_source(name)
        if name in self.attached:
            # A function that the run calls may lengthen the list; the run keeps what it has read.
            value = run.snapshots[name] = list(value) if type(value) is list else value
        return value

    def copy_values(self) -> dict[str, Any]:
        """All script variables with copies of their values, sorted by name."""
        return {name: copy_for_python(value) for name, value in sorted(self.values.items())}

    def assign_value(self, name: str, value: Any) -> None:
        known = self._types.get(name)
        self.forget_name(name)
        self.values[name] = value
        if known is not None and known[0] is value:  # a list that is written in the script, in its next run
            self._types[name] = known

    def attach_source(
        self, name: str, source: Any, world: AttachedWorld | None = None, reader: Reader | None = None
    ) -> None:
        """Attaches an object, perhaps a world, or a data frame with what reads it."""
        self.forget_name(name)
        self.attached[name] = source
        if world is not None:
            self.worlds[name] = world
        if reader is not None:
            self.frames[name] = reader

    def bind_late(self, name: str, literal: ast.ListLiteral) -> None:
        self.forget_name(name)
        self.late[name] = literal

    def forget_name(self, name: str) -> None:
        """Prepares a name for a new meaning. Raises ExecutionError X009, without a change, if the file fails."""
        if name in self.histories:
            self._set_history(name, None)
        self._drop_meaning(name)

    def _drop_meaning(self, name: str) -> None:
        """Forgets the meaning of the name, but not its history."""
        self.values.pop(name, None)
        self._types.pop(name, None)
        self.attached.pop(name, None)
        self.frames.pop(name, None)
        world = self.worlds.pop(name, None)
        if world is not None:
            self.let_go(world)
        self.late.pop(name, None)

    def clear_variables(self) -> None:
        for name in [*self.values, *self.late]:
            self.forget_name(name)

    # --- temporal variables ----------------------------------------------------------------------------

    def read_temporal(self, name: str, when: Any, times: bool = False) -> Any:
        """`name{}` (when is None) is the list of kept values; `name{-2.0}` those in force in the last two
        seconds, `name{22.2}` the one in force at that time, or None; with `times`, when these were stored.
        Raises ExecutionError X007 for another name."""
        if name not in self.histories:
            hint = f"store it with {name}{{5.0}} = ..."
            raise ExecutionError("X007", f"'{name}' is not a temporal variable", hints=(hint,))
        now = self.clock()
        values, keep = self.histories[name]
        values = keep_in_force(values, keep, now)
        self.histories[name] = values, keep
        part = 0 if times else 1
        if when is None:
            return [stored[part] for stored in values]
        moment = convert_variable_seconds(when, "the moment")
        if moment >= 0:
            index = bisect_right([time for time, _ in values], moment) - 1
            return values[index][part] if index >= 0 else None
        return [stored[part] for stored in keep_in_force(values, -moment, now)]

    def store_temporal(self, name: str, keep: Any, value: Any) -> None:
        """`name{keep} = value`. Raises as `forget_name` does, and X007 for a wrong time."""
        kept = convert_variable_seconds(keep, "the time to keep")
        if kept < 0:
            hint = "v{5.0} = x keeps the values of the last 5 seconds"
            message = f"the time to keep is at least 0 seconds, not {format_value(keep)}"
            raise ExecutionError("X007", message, hints=(hint,))
        now = self.clock()
        values, _ = self.histories.get(name, ([], kept))
        self._set_history(name, (keep_in_force([*values, (now, value)], kept, now), kept))
        self._drop_meaning(name)
        self.values[name] = value

    def _set_history(self, name: str, history: History | None) -> None:
        """Changes a history, first in the file: an error leaves it as it was."""
        if self.file is not None:
            self.file.save_history(name, history)
        self.histories.pop(name, None)
        if history is not None:
            self.histories[name] = history


def predict_variables(
    names: Variables, assigned: Mapping[str, plan.Constant | None], values: Mapping[str, Any]
) -> Callable[[str], Any]:
    """The values that variables will have after the statements before; KeyError if they are not known."""

    def get_variable(name: str) -> Any:
        if name in assigned:
            constant = assigned[name]
            if constant is None:
                raise KeyError(name)
            return constant.value
        return values[name] if name in values else names.get_source(name)

    return get_variable


# --- triggers: scripts that run every so often, and functions that are called when their values have changed
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


# --- what scripts see beside variables: print, help, var, clear, getTime
class SessionFunctions:
    """Methods named after the functions of the language."""

    def __init__(self, host: SessionHost) -> None:
        self.host = host

    def get_function(self, name: str) -> Callable[..., Any]:
        """The Python form of a built-in function that needs the session."""
        found: Callable[..., Any] = getattr(self, f"_{name}")
        return found

    def _print(self, *values: Any) -> Any:
        """Prints the values with blanks between them and gives the last one."""
        text = " ".join(escape_controls(str(copy_for_python(value))) for value in values)
        if self.host.limits.max_output is not None and self.host.active_runs:
            run = self.host.active_runs[0]  # the outermost
            run.printed += len(text) + 1
            if run.printed > self.host.limits.max_output:
                message = f"the script printed more than max_output={self.host.limits.max_output} characters"
                raise ExecutionError("X015", message, hints=("print less, or raise max_output",))
        print(text)
        return values[-1] if values else None

    def _help(self, name: Any = None) -> str:
        from ss2sql.session.descriptions import describe_functions, describe_world, write_about

        world = next((known for known in self.host.names.worlds.values() if name in (known.world, known.name)), None)
        if world is not None and name not in self.host.functions:
            return describe_world(world)
        known = describe_functions(self.host)
        if name is None:
            return "\n".join(f"{known[one].name:<12} {write_about(known[one])}" for one in sorted(known))
        if type(name) is not str or name not in known:  # a list could not even be looked up
            hints = suggest_names(str(name), known) or ("help() lists all of them",)
            raise ExecutionError("X007", f"there is no function '{name}'", hints=hints)
        return f"{known[name].call}: {write_about(known[name])}"

    def _var(self, name: str | None = None) -> Any:
        if name is None:
            ValueSizes(self.host.limits.max_size).check_value(self.host.names.values)
            return self.host.names.copy_values()
        variables = self.host.names.values
        if type(name) is not str or name not in variables:
            hints = suggest_names(str(name), variables) or ("var() gives all of them",)
            raise ExecutionError("X007", f"there is no variable '{name}'", hints=hints)
        return copy_for_python(variables[name])

    def _clear(self) -> None:
        self.host.names.clear_variables()

    def _getTime(self) -> float:  # noqa: N802 - the language's name
        return self.host.names.clock()
