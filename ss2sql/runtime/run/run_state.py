"""One run of a program: what both executors read and count while they work, its options and limits, and Ctrl-C."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from _signal import SIGINT, default_int_handler, getsignal  # type: ignore[import-not-found]
from _signal import signal as set_handler
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from inspect import CO_GENERATOR
from itertools import islice
from math import inf
from time import perf_counter
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, TypeAlias, TypeVar

from ss2sql.errors import Cancelled, ExecutionError, OutOfMemory, OutOfSteps, SessionError, Timeout, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.rows import Rows
from ss2sql.language.values import NUMBERS, copy_deep, format_value
from ss2sql.runtime.run.value_sizes import MAX_SIZE, MIN_REMEMBERED_LIMIT, ValueSizes
from ss2sql.vtables.contract import QueryCaches
from ss2sql.vtables.frames import Frame

if TYPE_CHECKING:
    from ss2sql.lowering.flat import TableFilter
    from ss2sql.lowering.sql_query import SqlQuery
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy
    from ss2sql.runtime.representations.shape import Representations


@contextmanager
def pause_collector() -> Iterator[None]:
    """Pauses it; to find nothing among a million new lists takes three quarters of the time that they take."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


# --- what a run reads and counts
P = ParamSpec("P")
T = TypeVar("T")
LOOK_SECONDS = 0.002  # seconds between looks at the memory of the process, each of which takes 6 us
Places: TypeAlias = frozenset[tuple[int, int]]  # stretches of the script


@dataclass(frozen=True, slots=True)
class GraphLevel:
    """One level of the graph of MEMORIZE: the rows that are first reached by so many steps.

    `steps` lead from the level before it, also back to known rows; `pruned` steps are dropped as stopped or impossible.
    """

    rows: int
    steps: int
    pruned: int = 0

    @property
    def repeated(self) -> int:
        return self.steps - self.rows


class ResultSink(NamedTuple):
    """Where the results of the query that runs are put, with its engine."""

    rows: Rows
    engine: str
    query: plan.Query | None = None


@dataclass(slots=True)
class Stats:
    """What a run has done so far. Of functions that take arrays, `calls` counts the rows that were computed."""

    calls: Counter[str] = field(default_factory=Counter)  # of user functions, without those answered from memory
    blocks: Counter[str] = field(default_factory=Counter)  # calls of functions that take arrays
    remembered: Counter[str] = field(default_factory=Counter)  # calls that were answered from memory
    generated: int = 0  # steps that were evaluated
    expanded: int = 0  # states whose steps were evaluated, the start among them
    pruned: int = 0  # steps that were dropped because their row had been reached before
    levels: list[GraphLevel] = field(default_factory=list)  # of the graph of the last search with MEMORIZE
    backward: list[GraphLevel] = field(default_factory=list)  # of these, the levels that were found from the goal
    notes: list[str] = field(default_factory=list)  # what was not done as requested, and why
    graph: int | None = None  # the number of the remembered graph
    remembered_steps: int = 0  # steps that remembered graphs knew
    seconds: dict[str, float] = field(default_factory=dict)  # by stage: parse, resolve, lower, compile, run, shape

    @property
    def steps(self) -> tuple[int, int, int]:
        return self.generated, self.expanded, self.pruned

    @steps.setter
    def steps(self, steps: tuple[int, int, int]) -> None:
        self.generated, self.expanded, self.pruned = steps

    def time_stage(self, stage: str, work: Callable[P, T]) -> Callable[P, T]:
        """Wraps a function so that the time of each call counts for a stage."""

        def call_timed(*arguments: P.args, **named: P.kwargs) -> T:
            started = perf_counter()
            try:
                return work(*arguments, **named)
            finally:
                self.add_seconds(stage, started)

        return call_timed

    def add_seconds(self, stage: str, started: float) -> None:
        """Adds the time since `started` to a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + perf_counter() - started


class Host(Protocol):
    """What a run asks of its session. Values are those of the language, tables are read in their own order."""

    memories: QueryCaches  # of worlds
    memo_limit: int  # calls of one function that are remembered
    shapes: Representations

    @property
    def graphs(self) -> CachePolicy | None: ...

    def get_variable(self, name: str, run: Run) -> Any: ...
    def assign_variable(self, name: str, value: Any) -> None: ...
    def get_callable(self, function: plan.Function, run: Run) -> Callable[..., Any]: ...
    def resolve_text(self, text: str, scope: Any) -> tuple[plan.Expr, ...]: ...
    def bind_late(self, name: str, literal: Any) -> None: ...
    def read_temporal(self, name: str, when: float | None, times: bool) -> Any: ...
    def store_temporal(self, name: str, keep: Any, value: Any) -> None: ...
    def read_table_rows(
        self, source: plan.TableSource, run: Run | None = None, wanted: TableFilter | None = None
    ) -> list[tuple[Any, ...]]: ...
    def read_integer_columns(self, source: plan.TableSource, *columns: str) -> list[Any] | None: ...


@dataclass(slots=True)
class RunBounds:
    """When a run has to end, and how many bytes of memory the process may hold until then; None is no bound."""

    deadline: float | None = None
    ceiling: int | None = None
    memory_owner: str = "the run"  # what takes time and memory, in messages
    next_check_time: float = 0.0  # when to measure the memory again

    def check_bounds(self) -> None:
        """Raises OutOfMemory or Timeout when it has to end."""
        if self.ceiling is not None and time.monotonic() >= self.next_check_time:
            if (measure_memory() or 0) > self.ceiling:
                message = f"{self.memory_owner} took more memory than max_memory allows"
                raise OutOfMemory("T003", message, hints=("bound the search or the result, or raise max_memory",))
            self.next_check_time = time.monotonic() + LOOK_SECONDS
        if self.deadline is not None and time.monotonic() >= self.deadline:
            message = f"{self.memory_owner} took longer than its timeout"
            raise Timeout("T001", message, hints=("raise the timeout, or ask for less",))

    def get_remaining(self) -> RemainingBounds:
        seconds = None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0)
        size = None if self.ceiling is None else max(self.ceiling - (measure_memory() or 0), 0)
        return RemainingBounds(seconds, size, self.ceiling)


@dataclass(frozen=True, slots=True)
class RemainingBounds:
    """The time and memory that a run has left: each reading of its result may take as much."""

    seconds: float | None = None
    size: int | None = None
    ceiling: int | None = None

    def begin_reading(self) -> Callable[[], None]:
        """The check of a reading that begins now."""
        deadline = None if self.seconds is None else time.monotonic() + self.seconds
        ceiling = None
        if self.size is not None and self.ceiling is not None:
            ceiling = max(self.ceiling, (measure_memory() or 0) + self.size)
        return RunBounds(deadline, ceiling, "the run with the reading of its result").check_bounds


@dataclass(slots=True)
class Run:
    """The state of one run. Executors call `check()` every few thousand steps at the latest."""

    host: Host
    stats: Stats = field(default_factory=Stats)
    notes: dict[str, None] = field(default_factory=dict)  # for a reader of the result, in order, see results/notes.py
    overestimated: bool = False  # A* has found a path that costs less than HEURISTIC expected
    bounds: RunBounds = field(default_factory=RunBounds)
    steps_left: int | None = None  # bounds the steps of all searches
    inner_run_steps: int = 0  # the steps of runs inside of this one
    printed: int = 0  # characters printed while this was the outermost run
    texts: int = 0  # how many texts of `eval` are being run, each inside of the one before
    interrupted: bool = False
    doubtful: bool = False  # a table has given a text that is not UTF-8
    max_rows: int | None = None
    maximum: int | None = None
    sizes: ValueSizes = field(default_factory=ValueSizes)
    arguments: dict[str, Any] = field(default_factory=dict)  # values of names of the script for this run only
    sink: ResultSink | None = None  # the rows found so far by the query that runs
    answer: Any = None  # of the last query
    snapshots: dict[str, Any] = field(default_factory=dict)  # values of attached objects, each read once
    readings: dict[object, Any] = field(default_factory=dict)  # what was read of another database
    cleanups: list[Callable[[], object]] = field(default_factory=list)  # release the readings
    reads: Callable[[], frozenset[str] | None] = frozenset  # the columns that its script may read; None: all
    handed: dict[str, Callable[[], Any]] = field(default_factory=dict)  # tables of another database, by their variables
    callables: dict[str, Callable[..., Any]] = field(default_factory=dict)  # functions by name, with their memos
    calls_made: Iterable[tuple[str, tuple[Any, ...], Any]] = ()  # by a statement that failed in SQL
    statements: list[Any] = field(default_factory=list)  # of the script, compiled
    lowered: dict[object, SqlQuery] = field(default_factory=dict)  # the SQL that each query has run
    bound: dict[object, dict[str, Any]] = field(default_factory=dict)  # the values of its parameters
    foreteller: Any = None  # has calls made by other processes, see runtime/parallel
    progress: Any = None
    graph: Any = None  # that MEMORIZE works on
    cached_steps: Any = None  # what a file remembers of its calls, see graph_cache/cached_steps.py
    collects_at: float = inf  # when the garbage collector, which pauses, has to go on
    trace: Any = None  # receives the events of the last statement's search
    call_places: Mapping[str, Places] = field(default_factory=dict)  # where the script calls functions of the user

    @property
    def steps(self) -> int:
        """The steps that have been tried so far, here and in runs inside of this one."""
        return self.stats.generated + self.inner_run_steps

    def check_steps(self, more: int = 0) -> None:
        """Raises OutOfSteps when too many steps have been tried; `more` of them are not in the statistics yet.

        The end of a statement always calls it, so the script alone decides whether it raises.
        """
        if self.steps_left is not None and self.steps + more > self.steps_left:
            hint = "bound the search, for example with MAXIMUM, UNIQUE or STOP WITH, or raise max_steps"
            raise OutOfSteps("T004", "the searches of the run tried more steps than max_steps allows", hints=(hint,))

    def check(self) -> None:
        """Raises Cancelled, Timeout, OutOfMemory or OutOfSteps when the run has to end."""
        if self.interrupted:
            raise Cancelled("T002", "the run was interrupted")
        self.sizes.raise_found()
        self.check_steps()
        if self.progress is not None:
            self.progress.show_line()
        if self.collects_at < time.monotonic():
            gc.enable()
        self.bounds.check_bounds()

    @contextmanager
    def pause_collector(self) -> Iterator[None]:
        """Pauses the garbage collector while nothing runs that could make cycles, but no longer than a second.

        Other threads may need it. A full collection among the modules of ss2sql alone takes 15 ms.
        """
        if not gc.isenabled():  # whoever paused it ends the pause
            yield
            return
        self.collects_at = time.monotonic() + 1.0
        try:
            with pause_collector():
                yield
        finally:
            self.collects_at = inf

    def get_variable(self, name: str) -> Any:
        """The value of a script variable or of a parameter of this run."""
        value = self.get_source(name)
        return value.make_value() if isinstance(value, Frame) else value

    def get_source(self, name: str) -> Any:
        """The same as it stands in FROM: a data frame stays one."""
        if name in self.arguments:
            return self.arguments[name]
        if name in self.handed:
            return self.handed[name]()
        return self.host.get_variable(name, self)

    def assign_variable(self, name: str, value: Any) -> Any:
        """Sets a script variable (or this run's parameter of that name) and gives the value back."""
        if name in self.arguments:
            self.arguments[name] = value
        else:
            self.host.assign_variable(name, self.copy_for_keeping(value))
        return value

    def copy_for_keeping(self, value: Any) -> Any:
        """The value for after the run: a copy where parts of it may be those of a list that the user may change."""
        return copy_deep(value) if self.reads_user_objects else value

    @property
    def reads_user_objects(self) -> bool:
        """Whether the run reads lists or dicts of the user, attached or given to it, as they are."""
        read = (*self.snapshots.values(), *self.arguments.values())
        return any(type(value) is list or type(value) is dict for value in read)


def measure_memory() -> int | None:
    """The bytes of memory that the process holds now; None where the system does not say so."""
    try:
        with open("/proc/self/statm", "rb", buffering=0) as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None


def translate_memory_error(error: MemoryError) -> Exception:
    """The error for a MemoryError of Python; one that a function of the user has raised stays what it is."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    if frame is None or not str(frame.tb_frame.f_globals.get("__name__", "")).startswith("ss2sql."):
        return error
    return build_memory_error()


def build_memory_error() -> OutOfMemory:
    hints = ("bound the search or the result, or the values in it: max_rows, max_size and max_memory do so",)
    return OutOfMemory("T003", "there is not enough memory", hints=hints)


# --- the results of calls that a run remembers
MEMO_LIMIT = 100_000  # calls of one function


class FailedCall:
    """In a memory of calls: the error with which the call ended."""

    __slots__ = ("error",)

    def __init__(self, error: Exception) -> None:
        self.error = error


class CarriedStopError(Exception):
    """A StopIteration of a function on its way through SQLite: by itself it would only end the walk over the rows."""


def keep_bounded(memory: dict[Any, Any], key: Any, value: Any, limit: int = MEMO_LIMIT) -> Any:
    """Gives the value, and keeps it unless the limit is 0. Where there are too many, the older half is forgotten.

    One by one, each would cost a walk over those that went before it, which takes 14 us in a dict of 100,000.
    """
    if len(memory) >= limit:
        if not limit:
            return value
        for old in list(islice(memory, (len(memory) + 1) // 2)):
            del memory[old]
    memory[key] = value
    return value


# --- options and limits of a session, a run or a query, as users give them
def check_run_limit(name: str, value: Any, least: int) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
        raise SessionError("S002", f"{name} is a whole number of at least {least}, not {value!r}")


def check_seconds(timeout: Any) -> None:
    """Raises SessionError S002 for what is no time to wait."""
    if timeout is not None and (isinstance(timeout, bool) or not isinstance(timeout, int | float)):
        raise SessionError("S002", f"timeout is a number of seconds, not {timeout!r}", hints=("write timeout=5.0",))


def check_option_word(what: str, words: Iterable[Any], known: Collection[str]) -> None:
    """Raises SessionError S002 for a word that is not known."""
    if not isinstance(words, Iterable):
        raise SessionError("S002", f"{what}s are named in a list, not {words!r}", hints=('write ["name", ...]',))
    for word in words:
        if word not in known:
            raise SessionError("S002", f"there is no {what} {word!r}", hints=suggest_names(str(word), known))


@dataclass(frozen=True, slots=True)
class Limits:
    """See `connect`, which documents each of them. None is no limit."""

    max_size: int = MAX_SIZE
    max_memory: int | None = None
    max_steps: int | None = None
    max_output: int | None = None

    def check_limits(self) -> None:
        """Raises SessionError S002 for limits that make no sense, or that cannot be kept here."""
        check_run_limit("max_size", self.max_size, MIN_REMEMBERED_LIMIT)
        if self.max_size is None or self.max_size > MAX_SIZE:
            raise SessionError("S002", f"max_size is at most {MAX_SIZE}, not {self.max_size!r}")
        check_run_limit("max_memory", self.max_memory, 1)
        check_run_limit("max_steps", self.max_steps, 0)
        check_run_limit("max_output", self.max_output, 0)
        if self.max_memory is not None and measure_memory() is None:
            hint = "bound the process from outside"
            message = "max_memory needs /proc/self/statm, which this system does not have"
            raise SessionError("S002", message, hints=(hint,))


NO_LIMITS = Limits()


# --- the values of options and limits, checked when they are known
_AT_LEAST = {
    "COST": "a negative cost would make longer paths ever cheaper",
    "HEURISTIC": "what is left of the path costs at least 0, and HEURISTIC says no more than that",
}


def find_lowest_run_limit(*counts: int | None) -> int | None:
    """The lowest of the counts that there are."""
    return min((count for count in counts if count is not None), default=None)


def check_count_value(value: Any, least: int, word: str) -> int:
    """The value of LIMIT, MAXIMUM or MEMORIZE; raises ExecutionError X006 if it is not a number of at least `least`."""
    if type(value) is not int or value < least:
        message = f"{word} needs a whole number of at least {least}, not {format_value(value)}"
        hint = "int(...) makes a whole number" if type(value) in (str, float) else f"for example {word} 10"
        raise ExecutionError("X006", message, hints=(hint,))
    return value


def check_cost(value: Any) -> Any:
    """The COST of a step; raises ExecutionError X006 if it is not a number of at least 0."""
    return _check_step_number(value, "COST")


def check_heuristic(value: Any) -> Any:
    """The HEURISTIC of a step; raises ExecutionError X006 if it is not a number of at least 0."""
    return _check_step_number(value, "HEURISTIC")


def check_probability(value: Any) -> Any:
    """The PROBABILITY of a step; raises ExecutionError X006 if it is not a number from 0 to 1."""
    if type(value) not in NUMBERS or not 0 <= value <= 1:
        message = f"PROBABILITY needs a number from 0 to 1, not {format_value(value)}"
        raise ExecutionError("X006", message, hints=("divide by the sum of all weights to get probabilities",))
    return value


def is_proven(promised: Type, check: Callable[[Any], Any]) -> bool:
    """Whether the type of a value already says what the check would find."""
    if not promised.is_only(Kind.NUMBER) or promised.low is None or promised.low < 0:
        return False
    return check is not check_probability or (promised.high is not None and promised.high <= 1)


def _check_step_number(value: Any, word: str) -> Any:
    if type(value) not in NUMBERS or value < 0:
        message = f"{word} needs a number of at least 0, not {format_value(value)}"
        reason = _AT_LEAST[word] if type(value) in NUMBERS else f"a cost is a number, for example {word} 1"
        raise ExecutionError("X006", message, hints=(reason,))
    return value


# --- Ctrl-C while a script runs
# Python raises KeyboardInterrupt wherever its main thread happens to be. In the middle of ss2sql that could be between
# two halves of something: a table that is registered on one side only, a transaction that nobody ends. So while
# something of a session is under way, Ctrl-C is noted, and the run ends the next time that it looks, which it does
# every few milliseconds (`Run.check`). Where nothing can be left half done it ends at once: in a function of the user,
# which may take long, and in the stages that only compute a value from others.

PATIENCE_SECONDS = 1.0  # after them a second Ctrl-C ends the run wherever it is: the first one has had no effect

_OWN = "ss2sql."
# What computes a value from others, and keeps nothing that could be left half done.
_PURE = tuple(_OWN + name for name in ("frontend.", "lowering.", "results.", "runtime.run.post_processing",
                                       "runtime.representations."))  # fmt: skip
# What others call for a moment: whether it may be broken off depends on who calls it.
_HELPERS = tuple(_OWN + name for name in ("errors", "language", "runtime.run.search_paths"))
_LIBRARIES = sys.stdlib_module_names | {"sqlglot"}


class _CtrlC:
    """What Ctrl-C does while something is under way in the main thread."""

    def __init__(self) -> None:
        self.under_way: list[Run | None] = []  # the innermost last; None is no run
        self.pressed: float | None = None  # when it was pressed first

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        impatient = self.pressed is not None and now - self.pressed > PATIENCE_SECONDS
        if self.pressed is None:
            self.pressed = now
        for run in self.under_way:
            if run is not None:
                run.interrupted = True
        innermost = self.under_way[-1] if self.under_way else None
        if impatient or (innermost is not None and can_interrupt(frame)):
            raise KeyboardInterrupt


_ctrl_c = _CtrlC()


def can_interrupt(frame: FrameType | None) -> bool:
    """Whether a run may end at once where it is: in code of the user, and in stages that only compute."""
    if any(map(_does_lose_interrupt, _iterate_interrupted_code(frame))):
        return False
    while frame is not None:
        name = frame.f_globals.get("__name__") or ""
        own = not name or name.startswith(_OWN)  # what is generated has no name
        if own and frame.f_code.co_flags & CO_GENERATOR:  # it is closed when it is dropped: an error would be lost
            return False
        if own:
            if name and not name.startswith(_HELPERS):
                return name.startswith(_PURE)
        elif name.partition(".")[0] not in _LIBRARIES:
            return True
        frame = frame.f_back
    return True


def _iterate_interrupted_code(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _does_lose_interrupt(frame: FrameType) -> bool:
    """Whether Python prints and forgets an error that leaves this frame."""
    code = frame.f_code
    return (
        code.co_name == "__del__"
        or frame.f_globals.get("__name__") == "weakref"
        or any(getattr(callback, "__code__", None) is code for callback in gc.callbacks)
    )


@contextmanager
def defer_keyboard_interrupt(run: Run | None = None) -> Iterator[None]:
    """Has Ctrl-C noted for as long as something is under way, in the main thread.

    A run notices by itself. What is no run is finished first: KeyboardInterrupt is raised after it. Only Python's own
    way to handle Ctrl-C is replaced; whoever has set another one decides what it means.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _ctrl_c.under_way and getsignal(SIGINT) is not default_int_handler:
        yield
        return
    # While Python's own way is in force, KeyboardInterrupt may come anywhere, so nothing is changed then.
    if not _ctrl_c.under_way:
        _ctrl_c.pressed = None
        set_handler(SIGINT, _ctrl_c)
    _ctrl_c.under_way.append(run)
    if run is not None:
        run.interrupted = _ctrl_c.pressed is not None
    try:
        yield
    finally:
        _ctrl_c.under_way.pop()
        if not _ctrl_c.under_way:
            if getsignal(SIGINT) is _ctrl_c:  # else a function of the user has set another one
                set_handler(SIGINT, default_int_handler)
            if _ctrl_c.pressed is not None:
                if run is None:
                    raise KeyboardInterrupt
                run.interrupted = True


def close_frames(error: BaseException) -> None:
    """Closes what the frames of an interrupted run hold, while Ctrl-C is noted.

    A traceback keeps the generators of a search. Closed later, with the traceback, they would lose another Ctrl-C.
    """
    from traceback import clear_frames

    raised: BaseException | None = error
    while raised is not None:
        clear_frames(raised.__traceback__)
        raised = raised.__context__
