"""What the executors of Spark call: steps are tried in a Python process there.

Each task gives the rows of `tries`, and at its end its account: a row with a place below 0 that says what it has
counted. So what is counted belongs to the rows, however often Spark begins a task anew.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.runtime.external.level_steps import Try
from ss2sql.runtime.external.table_statements import batch_of_rows
from ss2sql.runtime.external.task_pickle import UnpickledSearch

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyspark import Broadcast


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
_unpacked_tasks: dict[
    str, UnpickledSearch
] = {}  # by the names of runs; a process serves one after the other, seldom two


def expand_batches(
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
    size, steps = 0, unpacked.trial.evaluate_steps
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


def read_account(state: bytes) -> dict[str, Any]:
    """What a task has counted, from its last row."""
    told: dict[str, Any] = loads(state)
    return told
