"""What searches cost: time by their steps, whatever their paths and tables are, and memory by what they keep."""

from __future__ import annotations

import cProfile
import pstats
from typing import Any

import pytest

import ss2sql

CHAIN = """SELECT n + this FROM [1] WHERE n + this == {length} START WITH n = 0
    CONNECT BY {option} n = n + this STOP WITH n + this == {length} AS list;"""
OPTIONS = ["", "BREADTH FIRST", "UNIQUE"]
NATIVE_OPTIONS = [
    *["NO CYCLE", "DEPTH FIRST UNIQUE", "BREADTH FIRST NO CYCLE", "COST 1", "COST 1 NO CYCLE", "COST 1 UNIQUE"],
    *["MEMORIZE", "MEMORIZE COST 1"],
]


def python_calls(length: int, option: str, engine: Any) -> int:
    """How many Python functions a search along a chain calls, C functions included."""
    with ss2sql.connect() as ss:
        profile = cProfile.Profile()
        result = profile.runcall(ss.run, CHAIN.format(length=length, option=option), engine=engine)
        assert result.engine == engine
        assert result.value == [list(range(1, length + 1))]
        assert (result.stats.generated, result.stats.expanded) == (length, length)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


# --- long paths ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "engine"),
    [
        *[(option, engine) for option in OPTIONS for engine in ("database", "native")],
        *[(option, "native") for option in NATIVE_OPTIONS],
    ],
)
def test_a_chain_twice_as_long_calls_twice_as_many_functions(option: str, engine: str) -> None:
    few, many = (python_calls(length, option, engine) for length in (2_000, 4_000))
    assert few > 2_000
    assert many < 2.05 * few


# --- what is evaluated and kept ----------------------------------------------------------------------------


def test_sqlite_asks_stop_with_only_of_steps_that_cost_less(ss: ss2sql.Session) -> None:
    asked = []

    def ends(step: int, n: int) -> bool:
        asked.append((step, n))
        return False

    ss.function("ends", ends, volatility="immutable")
    script = """SELECT (n + this) % 4 FROM [1, 2, 3] START WITH n = 0
        CONNECT BY COST this UNIQUE n = (n + this) % 4 STOP WITH ends(this, n) AS list"""
    assert ss.run(script, engine="database").value == [[1], [2], [3], [1, 0]]
    assert asked == [(1, 0), (2, 0), (3, 0), (3, 1)]  # 2 and 3 are reached again for no less


def test_sqlite_keeps_pages_and_copies_in_memory() -> None:
    with ss2sql.connect() as ss:
        assert ss.host.connection.execute("PRAGMA temp_store").get == 2
        assert ss.host.connection.execute("PRAGMA cache_size").get == -65536
