"""What searches cost: time by their steps, whatever their paths and tables are, and memory by what they keep."""

from __future__ import annotations

import cProfile
import gc
import pstats
import tracemalloc
from collections.abc import Callable
from typing import Any

import apsw
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
        assert (result.stats.generated, result.stats.expanded) == (length, length - 1)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


def machine_steps(session: ss2sql.Session, script: str) -> tuple[int, int]:
    """The instructions that SQLite runs for a search, and the number of its paths."""
    steps: list[int] = []

    def note(event: dict[str, Any]) -> None:
        if "RECURSIVE" in event["sql"]:
            steps.append(event["stmt_status"]["SQLITE_STMTSTATUS_VM_STEP"])

    session.host.connection.trace_v2(apsw.SQLITE_TRACE_PROFILE, note)
    paths = session.run(script, engine="database").paths
    session.host.connection.trace_v2(0, None)
    return sum(steps), len(paths)


def check_growth(cost: Callable[[int], int], size: int, most: float) -> None:
    """What is twice as large costs so many times as much at most."""
    small, large = cost(size), cost(2 * size)
    assert small > size
    assert large < most * small


# --- long paths ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "engine"),
    [
        *[(option, engine) for option in OPTIONS for engine in ("database", "native")],
        *[(option, "native") for option in NATIVE_OPTIONS],
    ],
)
def test_a_chain_twice_as_long_calls_twice_as_many_functions(option: str, engine: str) -> None:
    check_growth(lambda length: python_calls(length, option, engine), 5_000, 2.05)


@pytest.mark.parametrize("option", OPTIONS)
def test_a_chain_twice_as_long_takes_sqlite_twice_as_many_steps(option: str) -> None:
    def cost(length: int) -> int:
        with ss2sql.connect() as ss:
            steps, paths = machine_steps(ss, CHAIN.format(length=length, option=option))
        assert paths == 1
        return steps

    check_growth(cost, 10_000, 2.05)


# --- large tables --------------------------------------------------------------------------------------

STAFF = "SELECT name FROM staff {} START WITH boss = 0 CONNECT BY {} boss = id STOP WITH manager != boss;"


@pytest.mark.parametrize("where", ["", "WHERE manager == boss AND id > 0"])
@pytest.mark.parametrize("option", [*OPTIONS, "NO CYCLE", "COST 1"])
@pytest.mark.parametrize("index", [False, True])
def test_a_hierarchy_costs_its_size(index: bool, option: str, where: str) -> None:
    """Each of the staff leads three others, so depths differ little between 1,000 and 2,000 of them."""

    def cost(size: int) -> int:
        session = ss2sql.connect()
        session.host.connection.execute("CREATE TABLE staff(id INTEGER, manager INTEGER, name TEXT)")
        if index:
            session.host.connection.execute("CREATE INDEX by_manager ON staff(manager)")
        rows = [(number, (number + 1) // 3, f"n{number}") for number in range(1, size + 1)]
        session.host.connection.executemany("INSERT INTO staff VALUES (?, ?, ?)", rows)
        steps, paths = machine_steps(session, STAFF.format(where, option))
        assert paths == size
        return steps

    check_growth(cost, 1_000, 2.3)


def test_a_search_over_cells_costs_its_steps_not_the_table() -> None:
    script = """SELECT px, py FROM moves, (SELECT * FROM cells WHERE px == x + dx AND py == y + dy)
        START WITH x = 1, y = 1 CONNECT BY COST 1 UNIQUE x = px, y = py;"""

    def cost(cells: int) -> int:
        session = ss2sql.connect()
        session.set("moves", [{"dx": dx, "dy": dy} for dx, dy in ((1, 0), (0, 1), (1, 1))])
        session.host.connection.execute("CREATE TABLE cells(px INTEGER, py INTEGER, PRIMARY KEY(px, py)) WITHOUT ROWID")
        rows = [(x + 1, y + 1) for x in range(20) for y in range(cells // 20)]
        session.host.connection.executemany("INSERT INTO cells VALUES (?, ?)", rows)
        return machine_steps(session, script)[0]

    check_growth(cost, 400, 2.2)


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


# --- memory --------------------------------------------------------------------------------------------


def test_searches_one_after_the_other_need_no_more_memory_than_one() -> None:
    query = ss2sql.connect().compile(CHAIN.format(length=5_000, option=""))

    def run() -> None:
        result = query.run(engine="database")
        assert result.stats.generated == 5_000
        assert len(result.paths[0]) == 5_000

    for _ in range(3):
        run()
    gc.collect()
    tracemalloc.start()
    try:
        run()
        gc.collect()
        first, most = tracemalloc.get_traced_memory()
        for _ in range(20):
            run()
        gc.collect()
        last, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert last - first < 0.05 * most  # of what one search takes
