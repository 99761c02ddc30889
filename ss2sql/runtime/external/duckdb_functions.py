"""Functions of Python in DuckDB, and aggregates of floats, whose sum is rounded once and takes no list of the values.

A float below 2^63 is a whole number, a multiple of 2^-60 below 1, and one of 2^-120 below 2^-60; DuckDB adds these
three as integers, exactly. What is left of a value, mostly nothing, is collected. A macro makes the parts of a value:

    ss2sql_sum(x) = ss2sql_sum_of_run_1(SUM(whole), SUM(fraction), SUM(rest), LIST(remainder), COUNT(x))

The average of 5 million floats in 1,000 groups took 260 ms as lists and takes 60.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.language.operations import GROUPS
from ss2sql.lowering.portable.pushdown import LISTED_AGGREGATES, SUMMED_AGGREGATES

if TYPE_CHECKING:
    import duckdb

_numbers = count(1)

UNIT = 60  # bits of each part but the first
_SCALE = 2.0**UNIT
_FRACTION = f"((x - TRUNC(x)) * {_SCALE!r})"
_REST = f"(({_FRACTION} - TRUNC({_FRACTION})) * {_SCALE!r})"
_WHOLE = "TRY_CAST(TRUNC(x) AS BIGINT)"  # NULL where it is too large
_REMAINDER = f"CASE WHEN {_WHOLE} IS NULL THEN x ELSE ({_REST} - TRUNC({_REST})) / {_SCALE**2!r} END"
_PARTS = f"""
    SUM({_WHOLE}),
    SUM(TRY_CAST(TRUNC({_FRACTION}) AS BIGINT)),
    SUM(TRY_CAST(TRUNC({_REST}) AS BIGINT)),
    LIST({_REMAINDER}) FILTER ({_REMAINDER} <> 0),
    COUNT(x)
"""
_KINDS = ["HUGEINT", "HUGEINT", "HUGEINT", "DOUBLE[]", "BIGINT"]

SUMMED = {function: GROUPS[name].of_float_sum for name, function in SUMMED_AGGREGATES.items()}
LISTED = {function: GROUPS[name].value for name, function in LISTED_AGGREGATES.items()}


def register_aggregate(cursor: duckdb.DuckDBPyConnection, function: str, failed: list[str]) -> str:
    """Makes one of SUMMED or LISTED known, see `create_function`; `failed` gets why its values are no good."""
    if function in LISTED:
        return create_function(cursor, function, _wrap_listed(function, failed), ["DOUBLE[]"], "DOUBLE")
    return create_function(cursor, function, _wrap_summed(function, failed), _KINDS, "DOUBLE", ["x"], _PARTS)


def create_function(
    cursor: duckdb.DuckDBPyConnection,
    name: str,
    function: Callable[..., Any],
    kinds: list[str],
    result: str,
    parameters: list[str] | None = None,
    arguments: str = "",
) -> str:
    """Makes a Python function known to a cursor by a macro, which calls it under a name that nobody else has.

    All connections of a database share their functions: two transactions cannot make one of the same name at once.

    Args:
        cursor: the connection.
        name: the macro, which statements call.
        function: takes values of these `kinds`, types of DuckDB, and gives one of the type `result`.
        parameters: those of the macro, where they are not the arguments of the function.
        arguments: what the function is called with, then.

    Returns:
        the other name of the function.
    """
    shared = f"{name}_of_run_{next(_numbers)}"  # names of macros end in a number, too
    cursor.create_function(shared, function, kinds, result, null_handling="special")  # type: ignore[call-overload]
    names = parameters or [f"x{n}" for n in range(len(kinds))]
    cursor.execute(f"CREATE TEMPORARY MACRO {name}({', '.join(names)}) AS {shared}({arguments or ', '.join(names)})")
    return shared


def remove_function(cursor: duckdb.DuckDBPyConnection, name: str, shared: str) -> None:
    """Takes away the macro, and the function that it calls."""
    cursor.execute(f"DROP MACRO {name}")
    cursor.remove_function(shared)


def _wrap_listed(function: str, failed: list[str]) -> Callable[[list[float] | None], float | None]:
    compute = LISTED[function]

    def compute_listed(values: list[float] | None) -> float | None:
        try:
            return None if values is None else compute(values)
        except ExecutionError:
            failed.append("an aggregate of floats becomes too large on its way")
            return None

    return compute_listed


def _wrap_summed(function: str, failed: list[str]) -> Callable[..., float | None]:
    of_sum = SUMMED[function]
    assert of_sum is not None

    def compute_from_parts(
        whole: int | None, fraction: int | None, rest: int | None, remainders: list[float] | None, count: int
    ) -> float | None:
        if not count:
            if function == SUMMED_AGGREGATES["sum"]:
                failed.append("a sum of nothing is a whole number among floats")
            return None
        exact = ((((whole or 0) << UNIT) + (fraction or 0)) << UNIT) + (rest or 0)
        try:
            return of_sum(_add_remainders(exact, remainders), count)
        except OverflowError:
            failed.append("a sum of floats becomes too large on its way")
            return None

    return compute_from_parts


def _add_remainders(exact: int, remainders: list[float] | None) -> float:
    """The sum of a multiple of 2^-120 and floats, rounded once."""
    if not remainders:
        return exact / (1 << 2 * UNIT)
    parts = list(remainders)
    while exact:  # as floats without a remainder: two to four
        part = float(exact)
        parts.append(math.ldexp(part, -2 * UNIT))
        exact -= int(part)
    return math.fsum(parts)
