"""Sums and averages of floats for DuckDB, which would round after every row, in any order."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.portable.here import EXACT

if TYPE_CHECKING:
    import duckdb

AT_ONCE = 65_536  # values that become floats of Python, where a group has more


def _average(values: Any) -> float:
    return math.fsum(_floats(values)) / len(values)


_FUNCTIONS: dict[str, Callable[[Any], float]] = {
    EXACT["sum"]: lambda values: math.fsum(_floats(values)),
    EXACT["average"]: _average,
}


def _floats(values: Any) -> Iterator[float]:
    return chain.from_iterable(values[n : n + AT_ONCE].tolist() for n in range(0, len(values), AT_ONCE))


def give(cursor: duckdb.DuckDBPyConnection, names: Iterable[str]) -> list[OverflowError]:
    """Makes the functions known to the transaction of a cursor. Gives a list of what they will have failed with.

    Raises an error of DuckDB where another transaction has them just now.
    """
    failed: list[OverflowError] = []
    for name in names:
        function = _of_lists(_FUNCTIONS[name], failed)
        cursor.create_function(name, function, ["DOUBLE[]"], "DOUBLE", type="arrow")  # type: ignore[call-overload]
    return failed


def _of_lists(function: Callable[[Any], float], failed: list[OverflowError]) -> Callable[[Any], Any]:
    """The function for an array of lists, none of which is empty. What failed has any value."""

    def compute(given: Any) -> Any:
        import pyarrow as pa  # type: ignore[import-untyped]

        lists = given.combine_chunks() if isinstance(given, pa.ChunkedArray) else given
        values, ends = lists.values.to_numpy(), lists.offsets.to_pylist()
        found = []
        for start, end in pairwise(ends):
            try:
                found.append(function(values[start:end]))
            except OverflowError as error:
                failed.append(error)
                found.append(0.0)
        return pa.array(found, pa.float64())

    return compute
