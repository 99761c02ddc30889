"""Trying steps in a Python process of an executor of Spark.

Each task gives the rows of `tries`, and at its end its account: a row with a place below 0 that says what it has
counted. So what is counted belongs to the rows, however often Spark begins a task anew.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any

from ss2sql.runtime.levels.arrow import batch
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.parcel import Unpacked
from ss2sql.runtime.levels.trial import FAILED, Try

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]

ROWS = 5_000  # of a batch
BYTES = 1 << 22  # of its rows and states, at about which a batch ends
_known: dict[str, Unpacked] = {}  # by the names of runs; a process serves one after the other, seldom two


def task(name: str, parcel: Any, paths: list[str]) -> Callable[[Iterator[Any]], Iterator[Any]]:
    """What Spark calls with batches of the frontier. It is sent by value, before ss2sql can be imported there."""

    def steps(batches: Iterator[Any]) -> Iterator[Any]:
        import sys

        sys.path.extend(path for path in paths if path not in sys.path)
        from pyspark import TaskContext

        from ss2sql.runtime.levels.executor import tried

        here = TaskContext.get()
        return tried(batches, name, lambda: parcel.value, here.partitionId() if here else 0)

    return steps


def paths_here() -> list[str]:
    """Where modules are found here; on other machines such folders may be missing."""
    return [os.path.abspath(path) for path in sys.path]


def tried(
    batches: Iterable[pa.RecordBatch], name: str, parcel: Callable[[], bytes], number: int
) -> Iterator[pa.RecordBatch]:
    """The steps from the states of a task, which has a number, and what was counted."""
    told: dict[str, Any] = {"tried": 0, "failed": 0, "refused": None, "trouble": ""}
    try:
        unpacked = _unpacked(name, parcel)
    except Exception as error:
        told["trouble"] = f"{type(error).__name__}: {error}"
        yield _batch([_account(number, told)])
        return
    unpacked.counted()  # of a task that was broken off
    with unpacked.room:
        yield from _tried(batches, unpacked, told)
    told |= unpacked.counted()
    yield _batch([_account(number, told)])


def _unpacked(name: str, parcel: Callable[[], bytes]) -> Unpacked:
    if name not in _known:
        made = Unpacked(parcel())
        while len(_known) > 1:
            del _known[next(iter(_known))]
        _known[name] = made
    return _known[name]


def _tried(batches: Iterable[pa.RecordBatch], unpacked: Unpacked, told: dict[str, Any]) -> Iterator[pa.RecordBatch]:
    """The rows of `tries`. Ends at the first state with a step that no row can tell of: it is taken again where the
    search runs, and raises what it raises there.
    """
    rows: list[Try] = []
    size, steps = 0, unpacked.trial.steps
    for block in batches:
        for step, state in zip(block.column(0).to_pylist(), block.column(1).to_pylist(), strict=True):
            try:
                for made in steps(step, state):
                    told["tried"] += 1
                    if made is not None:
                        rows.append(made)
                        size += len(made[3] or b"") + len(made[7] or b"")
                        told["failed"] += made[FAILED]
            except BaseException:
                told["refused"] = step
                return
            if len(rows) >= ROWS or size >= BYTES:
                yield _batch(rows)
                rows, size = [], 0
    if rows:
        yield _batch(rows)


def _account(number: int, told: dict[str, Any]) -> Try:
    """The row without a row of the search; no key of one begins like its key, see `Trial`."""
    place = -1 - number
    return place, None, b"\xff%d" % place, None, None, False, False, dumps(told), False


def account(state: bytes) -> dict[str, Any]:
    """What a task has counted, from its last row."""
    told: dict[str, Any] = loads(state)
    return told


def _batch(rows: list[Try]) -> pa.RecordBatch:
    return batch(TABLES["tries"], list(zip(*rows, strict=True)))
