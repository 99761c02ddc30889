"""Functions of Python for DuckDB: aggregates of floats, which it would round after every row, and built-in functions
that it has not, or has with another meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from inspect import Parameter, Signature
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.language import plan
from ss2sql.language.operations import GROUPS
from ss2sql.lowering.portable.pushdown import EXACT_AGGREGATES
from ss2sql.lowering.portable.sql_types import get_column_type
from ss2sql.runtime.run.run_state import Run

if TYPE_CHECKING:
    import duckdb

VALUES_PER_CHECK = 65_536  # values that become floats of Python, where a group has more


_FUNCTIONS = {function: GROUPS[name].of_floats for name, function in EXACT_AGGREGATES.items()}


def _iterate_floats(values: Any) -> Iterator[float]:
    return chain.from_iterable(
        values[n : n + VALUES_PER_CHECK].tolist() for n in range(0, len(values), VALUES_PER_CHECK)
    )


def register_in_duckdb(
    cursor: duckdb.DuckDBPyConnection, functions: Mapping[str, plan.Call | None], run: Run
) -> list[str]:
    """Makes the functions known to the transaction of a cursor. Gives a list of why their values will be no good.

    Raises an error of DuckDB where another transaction has them just now.
    """
    failed: list[str] = []
    for name, call in functions.items():
        if call is None:
            function, kinds, result, function_type = _wrap_aggregate(name, failed), ["DOUBLE[]"], "DOUBLE", "arrow"
        else:
            function, function_type = _wrap_function(call, run, failed), "native"
            result, *kinds = (str(get_column_type(part.type)) for part in (call, *call.arguments))
        cursor.create_function(  # type: ignore[call-overload]
            name, function, kinds, result, type=function_type, null_handling="special"
        )
    return failed


def _wrap_function(call: plan.Call, run: Run, failed: list[str]) -> Callable[..., Any]:
    """The built-in function, which fails where its value becomes larger than one may be."""
    function = run.host.get_callable(call.function, run)

    def call_function(*values: Any) -> Any:
        try:
            return None if failed else function(*values)
        except Exception as error:
            failed.append(getattr(error, "message", str(error)))
            return None

    # DuckDB looks how many arguments there are
    parameters = [Parameter(f"_{n}", Parameter.POSITIONAL_ONLY) for n in range(len(call.arguments))]
    call_function.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return call_function


def _wrap_aggregate(name: str, failed: list[str]) -> Callable[[Any], Any]:
    """The function for an array of lists; None stands for an empty one."""
    function = _FUNCTIONS[name]
    assert function is not None

    def call_aggregate(array: Any) -> Any:
        import pyarrow as pa  # type: ignore[import-untyped]

        lists = array.combine_chunks() if isinstance(array, pa.ChunkedArray) else array
        values, ends = lists.values.to_numpy(), lists.offsets.to_pylist()
        if name == EXACT_AGGREGATES["sum"] and lists.null_count:
            failed.append("a sum of nothing is a whole number among floats")
        found: list[float | None] = []
        for known, (start, end) in zip(lists.is_valid().to_pylist(), pairwise(ends), strict=True):
            try:
                found.append(function(_iterate_floats(values[start:end]), end - start) if known else None)
            except (OverflowError, ExecutionError):
                failed.append("a sum of floats becomes too large on its way")
                found.append(None)
        return pa.array(found, pa.float64())

    return call_aggregate
