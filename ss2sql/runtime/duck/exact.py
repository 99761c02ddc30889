"""Sums and averages of floats for DuckDB, which would round after every row, in any order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.language.operations import GROUPS
from ss2sql.lowering.portable.here import EXACT

if TYPE_CHECKING:
    import duckdb

AT_ONCE = 65_536  # values that become floats of Python, where a group has more


_FUNCTIONS = {function: GROUPS[name].of_floats for name, function in EXACT.items()}


def _floats(values: Any) -> Iterator[float]:
    return chain.from_iterable(values[n : n + AT_ONCE].tolist() for n in range(0, len(values), AT_ONCE))


def give(cursor: duckdb.DuckDBPyConnection, names: Iterable[str]) -> list[str]:
    """Makes the functions known to the transaction of a cursor. Gives a list of why their values will be no good.

    Raises an error of DuckDB where another transaction has them just now.
    """
    failed: list[str] = []
    for name in names:
        function = _of_lists(name, failed)
        cursor.create_function(  # type: ignore[call-overload]
            name, function, ["DOUBLE[]"], "DOUBLE", type="arrow", null_handling="special"
        )
    return failed


def _of_lists(name: str, failed: list[str]) -> Callable[[Any], Any]:
    """The function for an array of lists; None stands for an empty one."""
    function = _FUNCTIONS[name]
    assert function is not None

    def compute(given: Any) -> Any:
        import pyarrow as pa  # type: ignore[import-untyped]

        lists = given.combine_chunks() if isinstance(given, pa.ChunkedArray) else given
        values, ends = lists.values.to_numpy(), lists.offsets.to_pylist()
        if name == EXACT["sum"] and lists.null_count:
            failed.append("a sum of nothing is a whole number among floats")
        found: list[float | None] = []
        for known, (start, end) in zip(lists.is_valid().to_pylist(), pairwise(ends), strict=True):
            try:
                found.append(function(_floats(values[start:end]), end - start) if known else None)
            except (OverflowError, ExecutionError):
                failed.append("a sum of floats becomes too large on its way")
                found.append(None)
        return pa.array(found, pa.float64())

    return compute
