"""One run of a program: what both executors read and count while they work."""

from __future__ import annotations

import gc
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from math import inf
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, TypeAlias, TypeVar

from ss2sql.errors import Cancelled, OutOfMemory, OutOfSteps, Timeout
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Rows
from ss2sql.language.values import copy_deep
from ss2sql.runtime.run.value_sizes import ValueSizes
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


# --- one run of a program: what both executors read and count while they work
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

    calls: Counter[str] = field(
        default_factory=Counter
    )  # of user functions by name, without those answered from memory
    blocks: Counter[str] = field(default_factory=Counter)  # calls of functions that take arrays
    remembered: Counter[str] = field(default_factory=Counter)  # calls that were answered from memory
    generated: int = 0  # steps that were evaluated
    expanded: int = 0  # steps from which the search went on
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
    def read_temporal(self, name: str, when: float | None) -> Any: ...
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
            raise Timeout(
                "T001", f"{self.memory_owner} took longer than its timeout", hints=("raise timeout=, or ask for less",)
            )

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
