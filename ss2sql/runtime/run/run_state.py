"""One run of a program: what both executors read and count while they work."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, TypeAlias, TypeVar

from ss2sql.errors import Cancelled, OutOfMemory, OutOfSteps, Timeout
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Rows
from ss2sql.language.values import deep_copy
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.vtables.frames.frame import Frame
from ss2sql.vtables.query_cache import QueryCaches

if TYPE_CHECKING:
    from ss2sql.lowering.sql_query import SqlQuery
    from ss2sql.runtime.graph_cache.cache_policy import CachePolicy

P = ParamSpec("P")
T = TypeVar("T")
LOOK_SECONDS = 0.002  # seconds between looks at the memory of the process, each of which takes 6 us
Places: TypeAlias = frozenset[tuple[int, int]]  # stretches of the script


@dataclass(frozen=True, slots=True)
class GraphLevel:
    """One level of the graph of MEMORIZE: the rows that are reached by so many steps and no fewer, and the steps from
    the level before it, which lead there or back to rows that were known. `pruned` are the steps that came to nothing:
    they stop and are no goals, or are impossible.
    """

    rows: int
    steps: int
    pruned: int = 0

    @property
    def repeated(self) -> int:
        """The number of steps to known rows."""
        return self.steps - self.rows


class ResultSink(NamedTuple):
    """Where the results of the query that runs are put, with its engine."""

    rows: Rows
    engine: str
    query: plan.Query | None = None


@dataclass(slots=True)
class Stats:
    """What a run has done so far.

    `calls` counts real calls of user functions by name (a remembered value is no call), `remembered` those
    answered from the memo; `generated` counts steps that were evaluated, `expanded` those that went on,
    `pruned` those dropped because their row was there before. `seconds` holds the time of each stage: `parse`,
    `resolve`, `lower`, `compile` (to Python), `run` and `shape`, which of a search grows when its value is first read.
    Of functions that take arrays `calls` counts rows that were computed, `blocks` how often the function was called.
    `levels` are those of the graph of the last search with MEMORIZE, `backward` those that it found from the goal.
    `notes` say what was not done as asked or hoped for, and why. `graph` is the number of its remembered graph, if it
    has one, and `remembered_steps` counts the steps that such graphs knew.
    """

    calls: Counter[str] = field(default_factory=Counter)
    blocks: Counter[str] = field(default_factory=Counter)
    remembered: Counter[str] = field(default_factory=Counter)
    generated: int = 0
    expanded: int = 0
    pruned: int = 0
    levels: list[GraphLevel] = field(default_factory=list)
    backward: list[GraphLevel] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    graph: int | None = None
    remembered_steps: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> tuple[int, int, int]:
        """What was generated, expanded and pruned."""
        return self.generated, self.expanded, self.pruned

    @steps.setter
    def steps(self, steps: tuple[int, int, int]) -> None:
        self.generated, self.expanded, self.pruned = steps

    def time_stage(self, stage: str, work: Callable[P, T]) -> Callable[P, T]:
        """The work, whose time counts for a stage whenever it is done."""

        def measured(*arguments: P.args, **named: P.kwargs) -> T:
            started = perf_counter()
            try:
                return work(*arguments, **named)
            finally:
                self.add_seconds(stage, started)

        return measured

    def add_seconds(self, stage: str, started: float) -> None:
        """Counts the time since then for a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + perf_counter() - started


class OtherEngineNeededError(Exception):
    """What only a run can tell: this time the query has to run elsewhere. Its text is the reason."""


class Host(Protocol):
    """The session, as a run sees it. `memories` is what worlds remember; `graphs` keeps graphs, in a file; so many
    calls of a function are remembered as `memo_limit`.
    """

    memories: QueryCaches
    memo_limit: int

    @property
    def graphs(self) -> CachePolicy | None: ...

    def variable(self, name: str, run: Run) -> Any: ...
    def assign(self, name: str, value: Any) -> None: ...
    def call(self, function: plan.Function, run: Run) -> Callable[..., Any]: ...
    def resolve_text(self, text: str, scope: Any) -> tuple[plan.Expr, ...]: ...
    def bind_late(self, name: str, literal: Any) -> None: ...
    def temporal(self, name: str, when: float | None) -> Any: ...
    def store_temporal(self, name: str, keep: Any, value: Any) -> None: ...
    def shape(
        self, query: plan.Query, rows: Rows, arguments: tuple[Any, ...], named: dict[str, Any], run: Run
    ) -> Any: ...
    def read_table_rows(self, source: plan.TableSource, run: Run | None = None) -> list[tuple[Any, ...]]: ...
    def integers(self, source: plan.TableSource, *places: int) -> list[Any] | None: ...


@dataclass(slots=True)
class RunBounds:
    """When somebody has to end, and the bytes of memory that the process may hold by then; None is no bound.

    `memory_owner` takes the time and the memory, in the words of a message. At `next_check_time` the memory is looked
    at again.
    """

    deadline: float | None = None
    ceiling: int | None = None
    memory_owner: str = "the run"
    next_check_time: float = 0.0

    def check(self) -> None:
        """Raises OutOfMemory or Timeout when it has to end."""
        if self.ceiling is not None and time.monotonic() >= self.next_check_time:
            if (measure_memory() or 0) > self.ceiling:
                message = f"{self.memory_owner} took more memory than max_memory allows"
                raise OutOfMemory("T003", message, hints=("bound the search or the result, or raise max_memory",))
            self.next_check_time = time.monotonic() + LOOK_SECONDS
        if self.deadline is not None and time.monotonic() >= self.deadline:
            raise Timeout(
                "T001",
                f"{self.memory_owner} took longer than its timeout",
                hints=("raise timeout=, or ask for less",),
            )

    def left(self) -> RemainingBounds:
        """What is left of them now."""
        seconds = None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0)
        size = None if self.ceiling is None else max(self.ceiling - (measure_memory() or 0), 0)
        return RemainingBounds(seconds, size, self.ceiling)


@dataclass(frozen=True, slots=True)
class RemainingBounds:
    """What a run has left of its time and its memory: each reading of its result may take as much."""

    seconds: float | None = None
    size: int | None = None
    ceiling: int | None = None

    def begin(self) -> Callable[[], None]:
        """The check of a reading that begins now."""
        deadline = None if self.seconds is None else time.monotonic() + self.seconds
        ceiling = None
        if self.size is not None and self.ceiling is not None:
            ceiling = max(self.ceiling, (measure_memory() or 0) + self.size)
        return RunBounds(deadline, ceiling, "the run with the reading of its result").check


@dataclass(slots=True)
class Run:
    """The state of one run. Executors call `check()` every few thousand steps at the latest.

    `host` answers what only the session knows, see Host:

    - `variable(name, run)`: the value of a script variable, or the data frame of that name; what lives outside is read
      once per run and kept in `snapshots`.
    - `call(function, run)`: the callable behind a plan.Function, built in or the user's, on language values;
      the user's gets fresh values, is remembered where immutable, counted, and its result made a language
      value. The run's memos live in `callables`; `calls_made` are those of a statement that gave up.
    - `resolve_eval(text, scope)`: the resolved statements of a text given to `eval`.
    - `shape(query, rows, arguments, named, run)`: the value that `AS` makes of rows, as a language value.
    - `read_table_rows(source, run)`: all rows of a table of the database, in its order, values of its columns in order.
      A text that is not UTF-8 is an UnreadableText, and `doubtful` says so; without a run it is an error.

    `notes` are what a person should know of the result, in order, see result_notes.py; `overestimated` says that A* has
    found a path which costs less than it expected. `framed` says that the paths of the search that runs are wanted as a
    DataFrame of the database that finds them. `bounds` are those of its time and its memory. `steps_left` bounds the
    steps of its searches, `inner_run_steps` are those of runs inside of this one; `printed` counts characters printed
    while it was the outermost. `readings` is what was read of another database, `cleanups` lets go of that, and
    `handed` are tables of it of which some rows are read, by the variables that stand for them. `sizes` measures what
    the script makes, see value_sizes.py. `sink` holds the rows found so far by the query that runs; `answer` what the
    last query gave. `statements` are those of the script; `lowered` is the SQL that each of their queries has run,
    `bound` are the values for its parameters or for those of another database. `ahead` holds for each native query that
    runs, the innermost last, what is coming for functions that take arrays (coming_arguments.py). `foreteller` has
    calls made by other processes (workers/), `progress` shows how far the run is (progress.py), where these are wanted;
    `graph` is the one that MEMORIZE works on; `call_places` is where the script calls functions of the user, as far as
    that is known; `by_level` counts the steps of its search, and `trace` hears of those of the last statement's, where
    that is wanted.
    """

    host: Host
    stats: Stats = field(default_factory=Stats)
    notes: dict[str, None] = field(default_factory=dict)
    overestimated: bool = False
    bounds: RunBounds = field(default_factory=RunBounds)
    steps_left: int | None = None
    inner_run_steps: int = 0
    printed: int = 0
    texts: int = 0  # how many texts of `eval` are being run, each inside of the one before
    interrupted: bool = False
    doubtful: bool = False
    max_rows: int | None = None
    maximum: int | None = None
    framed: bool = False
    sizes: ValueSizes = field(default_factory=ValueSizes)
    arguments: dict[str, Any] = field(default_factory=dict)
    sink: ResultSink | None = None
    answer: Any = None
    snapshots: dict[str, Any] = field(default_factory=dict)
    readings: dict[object, Any] = field(default_factory=dict)
    cleanups: list[Callable[[], object]] = field(default_factory=list)
    handed: dict[str, Callable[[], Any]] = field(default_factory=dict)
    callables: dict[str, Callable[..., Any]] = field(default_factory=dict)
    calls_made: Iterable[tuple[str, tuple[Any, ...], Any]] = ()
    ahead: list[Any] = field(default_factory=list)
    statements: list[Any] = field(default_factory=list)
    lowered: dict[object, SqlQuery] = field(default_factory=dict)
    bound: dict[object, dict[str, Any]] = field(default_factory=dict)
    foreteller: Any = None
    progress: Any = None
    graph: Any = None
    by_level: Any = None
    trace: Any = None
    call_places: Mapping[str, Places] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """The steps that have been tried so far, here and in runs inside of this one."""
        return self.stats.generated + self.inner_run_steps

    def check_steps(self, more: int = 0) -> None:
        """Raises OutOfSteps when too many steps have been tried; `more` of them are not in the statistics yet.

        It is asked now and then, and always at the end of a statement: so whether it is too many depends on the script
        alone. How many there were by then depends on when somebody asks.
        """
        if self.steps_left is not None and self.steps + more > self.steps_left:
            hint = "bound the search, for example with MAXIMUM, UNIQUE or STOP WITH, or raise max_steps"
            raise OutOfSteps("T004", "the searches of the run tried more steps than max_steps allows", hints=(hint,))

    def check(self) -> None:
        """Raises Cancelled, Timeout, OutOfMemory or OutOfSteps when the run has to end."""
        if self.interrupted:
            raise Cancelled("T002", "the run was interrupted")
        self.sizes.look()
        self.check_steps()
        if self.progress is not None:
            self.progress.show()
        self.bounds.check()

    def variable(self, name: str) -> Any:
        """The value of a script variable or of a parameter of this run."""
        value = self.source(name)
        return value.value() if isinstance(value, Frame) else value

    def source(self, name: str) -> Any:
        """The same as it stands in FROM: a data frame stays one."""
        if name in self.arguments:
            return self.arguments[name]
        if name in self.handed:
            return self.handed[name]()
        return self.host.variable(name, self)

    def assign(self, name: str, value: Any) -> Any:
        """Sets a script variable (or this run's parameter of that name) and gives the value back."""
        if name in self.arguments:
            self.arguments[name] = value
        else:
            self.host.assign(name, self.own(value))
        return value

    def own(self, value: Any) -> Any:
        """The value for after the run: a copy where parts of it may be those of a list that the user may change."""
        return deep_copy(value) if self.reads_user_objects else value

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
    """The error where Python had no memory; what a function of the user raises stays an exception of its own."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    if frame is None or not str(frame.tb_frame.f_globals.get("__name__", "")).startswith("ss2sql."):
        return error
    return build_memory_error()


def build_memory_error() -> OutOfMemory:
    """The error where there is no memory left."""
    hints = ("bound the search or the result, or the values in it: max_rows, max_size and max_memory do so",)
    return OutOfMemory("T003", "there is not enough memory", hints=hints)
