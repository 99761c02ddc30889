"""A search as other machines get it, and what the executors of Spark call to try its steps.

There the clauses are compiled once more, so what is sent is small, and nothing of a session goes along. Functions
travel as they are here and now, with what they mention; a process of another machine has no other way to them.

Each task gives the rows of `tries`, and at its end its account: a row with a place below 0 that says what it has
counted. So what is counted belongs to the rows, however often Spark begins a task anew.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import field, replace
from functools import partial
from marshal import dumps
from operator import add
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Error, ExecutionError, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.cancellation import MAX_LEVELS, deepen_stack
from ss2sql.language.kinds import ANY, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import list_plan_functions, walk
from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.runtime.external.level_steps import StepEvaluation, Try, pickle_values
from ss2sql.runtime.external.table_statements import batch_of_rows
from ss2sql.runtime.graph_cache.function_fingerprint import is_of_user
from ss2sql.runtime.python.native_query import NativeQuery
from ss2sql.runtime.representations.shape import Representations
from ss2sql.runtime.run.calls import bind_function, report_memo_counts
from ss2sql.runtime.run.run_state import Run, Stats
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.vtables.contract import QueryCaches
from ss2sql.vtables.frames import Frame

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyspark import Broadcast

    from ss2sql.errors import Span
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy


_TOP = "write it so that it needs nothing but its arguments"


@dataclass(slots=True)
class TaskHost:
    """What the session is to a run, where there is no session. `tables` are the columns and rows of those in FROM."""

    functions: dict[str, UserFunction]
    values: dict[str, Any]
    tables: dict[int, tuple[tuple[tuple[str, Type], ...], list[tuple[Any, ...]]]]
    shapes: Representations
    memo_limit: int
    graphs: CachePolicy | None = None
    memories: QueryCaches = field(default_factory=QueryCaches)

    def get_variable(self, name: str, run: Run) -> Any:
        if name not in self.values:
            hints = ("assign it before it is read",)
            raise ExecutionError("R001", f"the variable '{name}' has no value yet", hints=hints)
        return self.values[name]

    def get_callable(self, function: plan.Function, run: Run) -> Callable[..., Any]:
        if function.builtin:
            python = OPERATIONS[function.name].value
            assert python is not None  # those of the session are volatile
            return run.sizes.wrap_function(function.name, python)
        return bind_function(function, run, self.functions.__getitem__, self.memo_limit)

    def read_table_rows(self, source: plan.TableSource, *_: Any) -> list[tuple[Any, ...]]:
        columns, rows = self.tables[source.id]
        places = [columns.index(column) for column in source.columns]
        return [tuple([row[place] for place in places]) for row in rows]

    def read_integer_columns(self, source: plan.TableSource, *columns: str) -> None:
        return None

    def _refuse_call(self, *arguments: Any) -> Any:
        raise AssertionError("a search that keeps the written order does not go by levels")

    assign_variable = resolve_text = bind_late = read_temporal = store_temporal = _refuse_call


@dataclass(frozen=True, slots=True)
class SearchTask:
    """What the steps of a search ask for."""

    query: plan.Query
    host: TaskHost
    keyed: bool


# --- packing -------------------------------------------------------------------------------------------


def pickle_search(search_run: SearchRun) -> bytes:
    """The search as bytes. Raises UnsupportedError where something of it belongs to this process."""
    host: Any = search_run.run.host  # that of a session, which has more than a run sees
    query = _select_step_query(search_run.query)
    sent: dict[str, UserFunction] = {}
    with deepen_stack(MAX_LEVELS):  # a plan is as deep as its script
        for name in sorted(
            {known.inverse_of or known.name for known in list_plan_functions(query) if not known.builtin}
        ):
            sent[name] = _pickle_function_code(host.planned[name], search_run.query.span)
        sources = [node for node in walk(query) if isinstance(node, plan.TableSource)]
        tables = {node.id: (node.columns, host.read_table_rows(node)) for node in sources}
        shapes = Representations(host.limits.max_size)
        forms = {node.representation.name for node in walk(query) if isinstance(node, plan.Query) and node is not query}
        shapes.functions |= {name: host.shapes.functions[name] for name in forms & host.shapes.functions.keys()}
        values = _collect_pickled_values(query, search_run.run)
        task = SearchTask(query, TaskHost(sent, values, tables, shapes, host.memo_limit), search_run.keyed)
        return _pickle_task(task, sent.values())


def _select_step_query(query: plan.Query) -> plan.Query:
    """The query without what is evaluated once, in this process: LIMIT, MAXIMUM, and START WITH, which states have."""
    assert query.search is not None
    start = tuple((name, plan.Constant(None, ANY, span=expr.span)) for name, expr in query.search.start)
    return replace(query, limit=None, search=replace(query.search, start=start, maximum=None))


def _pickle_function_code(entry: UserFunction, span: Span) -> UserFunction:
    """A function without what is known of its text. Raises UnsupportedError where it cannot be had elsewhere."""
    sent = replace(entry, body="")
    if entry.of_world:
        raise _build_spark_refusal(
            f"'{entry.name}' belongs to a world, which is in this process only", "take values from it", span
        )
    if entry.volatility != "immutable":
        reason = f"'{entry.name}' is {entry.volatility}: it may depend on what only this process knows"
        raise _build_spark_refusal(
            reason, "register it with volatility='immutable' if it depends on nothing but its arguments", span
        )
    try:
        _pickle_task(sent, [entry])
    except Exception as error:
        raise _build_spark_refusal(f"'{entry.name}' cannot be pickled: {error}", _TOP, span) from error
    return sent


def _build_spark_refusal(reason: str, cure: str, span: Span) -> UnsupportedError:
    return UnsupportedError("U001", f"{reason}, so Spark cannot have it", span, (cure,))


def _collect_pickled_values(query: plan.Query, run: Run) -> dict[str, Any]:
    """The variables that the query reads; one without a value is missed where it is read."""
    values: dict[str, Any] = {}
    for node in walk(query):
        if not isinstance(node, plan.Variable) or node.name in values:
            continue
        try:
            value = run.get_source(node.name)
        except Error as error:
            if error.code != "R001":
                raise
            continue
        values[node.name] = value = value.make_value() if isinstance(value, Frame) else value
        try:
            pickle_values((value,))
        except UnsupportedError:
            cure = "give numbers, texts and lists"
            raise _build_spark_refusal(f"the variable '{node.name}' holds objects", cure, node.span) from None
    return values


def _pickle_task(value: Any, entries: Iterable[UserFunction]) -> bytes:
    """A value as bytes. The modules of the user that functions are from go along; those of packages are imported."""
    from pyspark import cloudpickle

    pickler: Any = cloudpickle
    modules = {module for entry in entries if (module := _find_pickled_module(entry.function)) is not None}
    added = [module for module in modules if module.__name__ not in pickler.list_registry_pickle_by_value()]
    for module in added:
        pickler.register_pickle_by_value(module)
    try:
        made: bytes = pickler.dumps(value)
    finally:
        for module in added:
            pickler.unregister_pickle_by_value(module)
    return made


def _find_pickled_module(function: Callable[..., Any]) -> ModuleType | None:
    """The module that a function is from, if that is a file of the user's."""
    module = sys.modules.get(getattr(function, "__module__", None) or "")
    if module is None or module.__name__ == "__main__":  # which is sent in any case
        return None
    return module if getattr(module, "__file__", None) and is_of_user(module.__name__) else None


# --- unpacking -----------------------------------------------------------------------------------------


class UnpickledSearch:
    """A search in the process that tries its steps."""

    def __init__(self, task: bytes) -> None:
        with deepen_stack(MAX_LEVELS):
            content: SearchTask = pickle.loads(task)
        self.run = Run(content.host, sizes=ValueSizes(content.host.shapes.most))
        native = NativeQuery(content.query, find=lambda search_run: iter(()))
        self.evaluation = StepEvaluation(*native.make_step_function(self.run), content.keyed)
        self.room = partial(deepen_stack, native.levels)  # on the stack, for the time of trying steps

    def take_counts(self) -> dict[str, Any]:
        """What was counted since the last call, see Stats."""
        self.evaluation.flush()
        report_memo_counts(self.run)
        stats = self.run.stats
        told = {"steps": stats.steps, "calls": dict(stats.calls), "remembered": dict(stats.remembered)}
        stats.steps = 0, 0, 0
        stats.calls.clear()
        stats.remembered.clear()
        return told


def add_executor_counts(stats: Stats, told: dict[str, Any]) -> None:
    generated, expanded, pruned = map(add, stats.steps, told["steps"])
    stats.steps = generated, expanded, pruned
    stats.calls.update(told["calls"])
    stats.remembered.update(told["remembered"])


# --- what the executors of Spark call: steps are tried in a Python process there
Task: TypeAlias = Callable[[Iterator[Any]], Iterator[Any]]


def make_task(function: Callable[..., Iterator[Any]], *arguments: Any) -> Task:
    """What Spark calls with batches: a function of a module here, with more arguments.

    It is sent by value, because ss2sql can be imported there only after it has told where modules are found here; on
    other machines such folders may be missing. So the arguments are nothing of ss2sql.
    """
    module, name = function.__module__, function.__name__
    paths = [os.path.abspath(path) for path in sys.path]

    def run_task(batches: Iterator[Any]) -> Iterator[Any]:
        import sys
        from importlib import import_module

        sys.path.extend(path for path in paths if path not in sys.path)
        found: Iterator[Any] = getattr(import_module(module), name)(batches, *arguments)
        return found

    return run_task


# --- trying steps in a Python process of an executor of Spark
ROWS_PER_BLOCK = 5_000  # of a batch
BYTES_PER_BLOCK = 1 << 22  # of its rows and states, at about which a batch ends
# By the names of runs; a process serves one after the other, seldom two.
_unpacked_tasks: dict[str, UnpickledSearch] = {}


def expand_spark_batches(
    batches: Iterable[pa.RecordBatch], name: str, task: Broadcast[bytes], typed: list[tuple[str, str]]
) -> Iterator[pa.RecordBatch]:
    """The steps from the states of a task, as rows of `tries`, and what was counted."""
    from pyspark import TaskContext

    here, columns = TaskContext.get(), [TypedColumn(*column) for column in typed]
    number = here.partitionId() if here else 0
    told: dict[str, Any] = {"refused": None, "trouble": ""}
    try:
        unpacked = _get_unpacked_task(name, task)
    except Exception as error:
        told["trouble"] = f"{type(error).__name__}: {error}"
    else:
        unpacked.take_counts()  # of a task that was broken off
        with unpacked.room():
            for rows in _iterate_tries(batches, unpacked, told):
                yield batch_of_rows(columns, rows)
        told |= unpacked.take_counts()
    # The row without a row of the search; no key of one begins like its key.
    values: dict[str, Any] = {"place": -1 - number, "row_key": b"\xff%d" % number, "state": dumps(told)}
    values |= {"goal": False, "goes_on": False}
    yield batch_of_rows(columns, [[values.get(column.name) for column in columns]])


def _get_unpacked_task(name: str, task: Broadcast[bytes]) -> UnpickledSearch:
    if name not in _unpacked_tasks:
        made = UnpickledSearch(task.value)
        while len(_unpacked_tasks) > 1:
            del _unpacked_tasks[next(iter(_unpacked_tasks))]
        _unpacked_tasks[name] = made
    return _unpacked_tasks[name]


def _iterate_tries(
    batches: Iterable[pa.RecordBatch], unpacked: UnpickledSearch, told: dict[str, Any]
) -> Iterator[list[Try]]:
    """The rows of `tries`, in blocks. Ends at the first state with a step that fails: it is taken again where the
    search runs, and raises what it raises there.
    """
    rows: list[Try] = []
    size, steps = 0, unpacked.evaluation.evaluate_steps
    for block in batches:
        for step, state in zip(block.column(0).to_pylist(), block.column(1).to_pylist(), strict=True):
            try:
                for made in steps(step, state):
                    rows.append(made)
                    size += len(made[4]) + len(made[6] or b"")
            except BaseException:
                told["refused"] = step
                return
            if len(rows) >= ROWS_PER_BLOCK or size >= BYTES_PER_BLOCK:
                yield rows
                rows, size = [], 0
    if rows:
        yield rows
