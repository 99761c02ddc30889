"""Trying steps in a Python process of an executor of Spark.

Each task gives the rows of `tries`, and at its end its account: a row with a place below 0 that says what it has
counted. So what is counted belongs to the rows, however often Spark begins a task anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.portable.steps import Typed
from ss2sql.runtime.levels.arrow import batch_of_rows
from ss2sql.runtime.levels.parcel import Unpacked
from ss2sql.runtime.levels.trial import Try

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyspark import Broadcast

ROWS = 5_000  # of a batch
BYTES = 1 << 22  # of its rows and states, at about which a batch ends
_known: dict[str, Unpacked] = {}  # by the names of runs; a process serves one after the other, seldom two


def tried(
    batches: Iterable[pa.RecordBatch], name: str, parcel: Broadcast[bytes], typed: list[tuple[str, str]]
) -> Iterator[pa.RecordBatch]:
    """The steps from the states of a task, as rows of `tries`, and what was counted."""
    from pyspark import TaskContext

    here, columns = TaskContext.get(), [Typed(*column) for column in typed]
    number = here.partitionId() if here else 0
    told: dict[str, Any] = {"refused": None, "trouble": ""}
    try:
        unpacked = _unpacked(name, parcel)
    except Exception as error:
        told["trouble"] = f"{type(error).__name__}: {error}"
    else:
        unpacked.counted()  # of a task that was broken off
        with unpacked.room():
            for rows in _tried(batches, unpacked, told):
                yield batch_of_rows(columns, rows)
        told |= unpacked.counted()
    # The row without a row of the search; no key of one begins like its key.
    values: dict[str, Any] = {"place": -1 - number, "row_key": b"\xff%d" % number, "state": dumps(told)}
    values |= {"goal": False, "goes_on": False}
    yield batch_of_rows(columns, [[values.get(column.name) for column in columns]])


def _unpacked(name: str, parcel: Broadcast[bytes]) -> Unpacked:
    if name not in _known:
        made = Unpacked(parcel.value)
        while len(_known) > 1:
            del _known[next(iter(_known))]
        _known[name] = made
    return _known[name]


def _tried(batches: Iterable[pa.RecordBatch], unpacked: Unpacked, told: dict[str, Any]) -> Iterator[list[Try]]:
    """The rows of `tries`, in blocks. Ends at the first state with a step that fails: it is taken again where the
    search runs, and raises what it raises there.
    """
    rows: list[Try] = []
    size, steps = 0, unpacked.trial.steps
    for block in batches:
        for step, state in zip(block.column(0).to_pylist(), block.column(1).to_pylist(), strict=True):
            try:
                for made in steps(step, state):
                    rows.append(made)
                    size += len(made[4]) + len(made[6] or b"")
            except BaseException:
                told["refused"] = step
                return
            if len(rows) >= ROWS or size >= BYTES:
                yield rows
                rows, size = [], 0
    if rows:
        yield rows


def account(state: bytes) -> dict[str, Any]:
    """What a task has counted, from its last row."""
    told: dict[str, Any] = loads(state)
    return told
