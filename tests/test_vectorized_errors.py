"""Functions that take arrays: failures, and results that do not fit, where their row is evaluated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from agreement import exact
from array_functions import blocks, outcome, run
from sessions import both

import ss2sql


def inverse(n: Any) -> Any:
    if n == 0:
        raise ZeroDivisionError("no inverse of 0")
    return 1 / n


@both
@pytest.mark.parametrize(
    "script",
    [
        "SELECT f(this) FROM numbers AS list;",
        "SELECT f(this) FROM numbers WHERE this != 0 AS list;",
        "SELECT f(this) FROM numbers LIMIT 3 AS list;",
        "SELECT f(this) FROM numbers WHERE this > 4 OR f(this) > 0.4 AS list;",
        """SELECT this FROM numbers WHERE n == 6 START WITH n = 1
        CONNECT BY n = n + this STOP WITH n > 6 OR f(this) < 0;""",
        """SELECT this FROM numbers WHERE n == 9 START WITH n = 1
        CONNECT BY UNIQUE n = n + this STOP WITH n > 6 OR f(this) < 0;""",
        """SELECT this FROM numbers WHERE n == 9 START WITH n = 1
        CONNECT BY UNIQUE n = n + this STOP WITH this == 0 OR n > 20 OR f(this) < 0.2;""",
    ],
)
def test_a_failure_is_an_error_where_its_row_is_evaluated(engine: Any, script: str) -> None:
    numbers = {"numbers": [5, 4, 3, 2, 1, 0, 9, 8, 7]}
    f = blocks(inverse)
    assert outcome(engine, script, numbers, f=f) == outcome(engine, script, numbers, f=inverse)


@both
def test_blocks_around_failing_rows_stay_large(engine: Any) -> None:
    f = blocks(inverse)
    numbers = [n if n % 1000 else 0 for n in range(1, 5001)]
    result = run(engine, "SELECT f(this) FROM numbers WHERE this != 0 OR f(this) > 0 LIMIT 999 AS list;",
                 {"numbers": numbers}, f=f)  # fmt: skip
    assert result.value == [1 / n for n in range(1, 1000)]
    assert len(f.made.sizes) < 30


@both
@pytest.mark.parametrize(
    ("returned", "got"),
    [
        (lambda x: x[:1], "1 element"),
        (lambda x: [1.5] * 4, "4 elements"),
        (lambda x: [], "0 elements"),
        (lambda x: 5.5, "5.5"),
        (lambda x: None, "None"),
        (lambda x: x.sum(), "6"),
        (lambda x: np.array(7), "7"),
        (lambda x: "abc", "'abc'"),
        (lambda x: {"a": 1}, "{'a': 1}"),
    ],
)
def test_a_block_of_another_length(engine: Any, returned: Any, got: str) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", returned, volatility="immutable", vectorized=True)
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run("SELECT this,\n  f(this) FROM [1, 2, 3];", engine=engine)
        assert caught.value.code == "X012"
        assert caught.value.message == f"the function 'f' takes arrays; for 3 rows it returned {got}"
        assert caught.value.span is not None
        assert caught.value.span.place == "<script>:2:3"
        assert ss.eval("SELECT this FROM [1] AS list;") == [1]


@both
def test_an_element_that_is_no_value_is_refused_where_its_row_comes(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", lambda x: np.where(x == 3, np.nan, x * 1.0), volatility="immutable", vectorized=True)
        assert ss.run("SELECT f(this) FROM [1, 2, 3] LIMIT 2 AS list;", engine=engine).value == [1.0, 2.0]
        assert ss.run("SELECT f(this) FROM [1, 3, 2] WHERE this != 3 AS list;", engine=engine).value == [1.0, 2.0]
        with pytest.raises(ss2sql.ExecutionError, match="the function 'f' returned NaN") as caught:
            ss.run("SELECT f(this) FROM [1, 2, 3] AS list;", engine=engine)
        assert caught.value.code == "X004"
        assert caught.value.span.place == "<script>:1:8"


@pytest.mark.parametrize("returned", [np.float32(2), np.int16(2), np.bool_(True), np.str_("a"), (1, 2), {3}, None])
@both
def test_elements_pass_the_border(engine: Any, returned: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", lambda x: [returned] * len(x), volatility="immutable", vectorized=True)
        ss.function("g", lambda x: returned, volatility="immutable")
        made = ss.run("SELECT f(this), g(this) FROM [1, 2] AS rows;", engine=engine).value
        assert exact(made) == exact([(b, b) for _, b in made])


@both
def test_rows_of_a_table_of_results_are_lists(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", lambda x: np.stack([x, 2 * x], axis=1), volatility="immutable", vectorized=True)
        assert ss.run("SELECT f(this) FROM [1, 2] AS list;", engine=engine).value == [[1, 2], [2, 4]]
