"""Queries that are no searches in DuckDB: what the other engines give, in their order."""

from __future__ import annotations

from collections import Counter
from typing import Any

import golden
import pytest
from agreement import exact, outcome, reference_outcome, session_for
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn
from second_opinion import DECISIONS, TYPES, Twin, twin
from sessions import code_of

import ss2sql

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 10)
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms


@pytest.mark.parametrize("case", golden.flat_queries(), ids=lambda case: case.name)
def test_golden_cases(case: golden.Case) -> None:
    assert golden.run(case, "duckdb").verdict == golden.run(case, "native").verdict


def test_random_programs() -> None:
    engines: Counter[str] = Counter()

    @seed(SEED)
    @drawn(COUNT, shrunk=False)
    @given(programs())
    def run(case: ProgramCase) -> None:
        with session_for(case, engine="duckdb", session=OWN) as ss:
            found, engine = outcome(ss, case.script)
        engines[engine] += 1
        # A list function on what is certainly no list is refused before the run; the reference notices it later.
        assert found is None or found.error == "R008" or found == reference_outcome(case)

    run()
    assert engines["duckdb"] > COUNT // 10


@pytest.mark.parametrize("kept", ["variables", "tables", "views"])
def test_random_queries(kept: str) -> None:
    engines: Counter[str] = Counter()

    @seed(SEED)
    @drawn(COUNT, shrunk=False)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(twin))
    def run(made: Twin) -> None:
        case = made.case
        with duckdb.connect() if kept == "variables" else OWN.cursor() as own:
            for name, rows in case.tables.items():
                columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
                stored = name if kept == "tables" else f"stored_{name}"
                own.execute(f"DROP VIEW IF EXISTS {name}" if kept == "views" else f"DROP TABLE IF EXISTS {name}")
                own.execute(f"CREATE OR REPLACE TABLE {stored}({columns})")
                own.executemany(f"INSERT INTO {stored} VALUES (?, ?, ?, ?)", [tuple(row.values()) for row in rows])
                if kept == "views":
                    own.execute(f"CREATE VIEW {name} AS FROM {stored}")
            with ss2sql.connect(engine="duckdb", session=own) as ss:
                for name, rows in case.tables.items() if kept == "variables" else ():
                    ss.set(name, rows)
                found, engine = outcome(ss, case.script)
            engines[engine] += 1
            assert found == reference_outcome(case)
            for name in case.tables:
                own.execute(f"DROP VIEW IF EXISTS {name}" if kept == "views" else f"DROP TABLE IF EXISTS {name}")

    run()
    assert engines["duckdb"] > COUNT // 4


@pytest.mark.parametrize(
    ("script", "value"),
    [
        # ORDER BY is stable, None comes first and with DESC last.
        ("SELECT n FROM rows ORDER BY k AS list", [4, 1, 3, 2]),
        ("SELECT n FROM rows ORDER BY k DESC AS list", [2, 1, 3, 4]),
        (
            "SELECT a.n, b.n FROM a = rows, b = rows WHERE a.k == b.k ORDER BY a.k LIMIT 3 AS rows",
            [(4, 4), (1, 1), (1, 3)],
        ),
        # Groups come as they first appear, also of several sources.
        ("SELECT k, count(*) FROM rows GROUP BY k AS rows", [("a", 2), ("b", 1), (None, 1)]),
        ("SELECT b.n % 2 FROM a = [1, 2], b = rows GROUP BY b.n % 2 AS list", [1, 0]),
        # Of equal numbers the first is shown, and the least is the first of the least.
        ("SELECT x, count(*) FROM zeros GROUP BY x AS rows", [(-0.0, 2), (1.5, 1)]),
        ("SELECT min(x), max(x) FROM zeros GROUP BY 1 AS rows", [(-0.0, 1.5)]),
        ("SELECT max(-x) FROM zeros WHERE x < 1 GROUP BY 1 AS list", [0.0]),
        ("SELECT count(k), sum(n), min(k) FROM rows WHERE n > 3 GROUP BY n AS rows", [(0, 4, None)]),
        ("SELECT this FROM range(10) LIMIT 0 AS list", []),
        ("SELECT this * 2 FROM range(5) WHERE this > least LIMIT most AS list", [4, 6]),
    ],
)
def test_order_and_equal_values(ss: ss2sql.Session, script: str, value: Any) -> None:
    ss.set("rows", [{"n": 1, "k": "a"}, {"n": 2, "k": "b"}, {"n": 3, "k": "a"}, {"n": 4, "k": None}])
    ss.set("zeros", [{"x": -0.0}, {"x": 1.5}, {"x": 0.0}])
    result = ss.run(script, least=1, most=2)
    assert result.engine == "duckdb"
    assert exact(result.value) == exact(value)


@pytest.mark.parametrize(
    "text", ["it's", '"', "\\", "a\\'b", "$least", "?", "-- x", "/*", "ä", "\U0001f600", "\n", "\0", "%", "x'; DROP"]
)
def test_texts_are_texts(ss: ss2sql.Session, text: str) -> None:
    written = ss.run("SELECT this FROM [t] WHERE this == t AS list", t=text)
    assert (written.engine, written.value) == ("duckdb", [text])
    literal = repr(text)
    assert ss.eval(f"SELECT this + {literal} FROM [{literal}, 'b'] WHERE this == {literal} AS list") == [text + text]


@pytest.mark.parametrize("threads", [1, 2])
def test_sums_of_floats_are_rounded_once(own: Any, threads: int) -> None:
    own.execute(f"SET threads = {threads}")
    own.execute("""
        CREATE TABLE t AS
        SELECT i % 3 AS k, (i * 7919 % 100003) / 10.0::DOUBLE * 10 ** (i % 17) AS x, i / 7::DOUBLE AS y, i % 1000 AS n
        FROM range(200000) AS r(i)
    """)
    script = """
        SELECT k, sum(x), average(y), average(n), average(IF(n > 990; y; None)) FROM t
        GROUP BY k HAVING average(y) > 1 ORDER BY sum(y) DESC AS rows
    """
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        found = ss.run(script)
        assert found.engine == "duckdb"
        assert exact(found.value) == exact(ss.run(script, engine="native").value)
        assert own.execute("SELECT count(*) FROM duckdb_functions() WHERE function_name LIKE 'ss2sql%'").fetchall() == [
            (0,)
        ]


def test_a_sum_that_is_too_large_on_its_way(ss: ss2sql.Session) -> None:
    ss.set("t", [{"x": 1.5e308}, {"x": 1.5e308}, {"x": -1.5e308}])
    result = ss.run("SELECT sum(x) FROM t GROUP BY 1 AS list")
    assert (result.engine, result.value) == ("native", [1.5e308])
    assert "a sum of floats becomes too large on its way" in str(result.explain())
    assert code_of(ss.run, "SELECT sum(x) FROM t WHERE x > 0 GROUP BY 1 AS list") == "X004"


def test_a_sum_of_nothing_is_a_whole_number(ss: ss2sql.Session) -> None:
    ss.set("t", [{"k": 1, "x": 0.5}, {"k": 2, "x": None}, {"k": 1, "x": None}])
    whole = ss.run("SELECT k, sum(x) FROM t GROUP BY k AS rows")
    assert (whole.engine, exact(whole.value)) == ("native", exact([(1, 0.5), (2, 0)]))
    floats = ss.run("SELECT k, sum(x), average(x) FROM t WHERE k == 1 GROUP BY k AS rows")
    assert (floats.engine, exact(floats.value)) == ("duckdb", exact([(1, 0.5, 0.5)]))


@pytest.mark.parametrize("written", ["min(abs(this) + 1)", "max(-abs(this) - 1)"])
def test_the_least_of_numbers_beyond_zero(ss: ss2sql.Session, written: str) -> None:
    result = ss.run(f"SELECT {written} FROM [-0.5, 0.0, -2.5] GROUP BY 1 AS list")
    assert (result.engine, result.value) == ("duckdb", [1.0 if written[:3] == "min" else -1.0])
    assert "FILTER" not in result.sql  # no zero has a sign to keep


@pytest.mark.parametrize(
    ("script", "value"),
    [
        ("SELECT q.k, n FROM q = (SELECT k, to(count(*), n) FROM rows GROUP BY k) WHERE n < 2 AS rows",
         [("b", 1), (None, 1)]),
        ("SELECT this * 2 FROM (SELECT n FROM rows ORDER BY n DESC LIMIT 2 AS list) AS list", [8, 6]),
        ("SELECT a, b FROM (SELECT to(x.n, a), to(y.n, b) FROM x = rows, y = rows WHERE x.n > y.n + 1) LIMIT 2 AS rows",
         [(3, 1), (4, 1)]),
        ("SELECT s FROM (SELECT to(sum(n), s) FROM (SELECT n, k FROM rows WHERE n > 1) GROUP BY k) AS list", [2, 3, 4]),
        # A number that is written has 64 bits, and None a column like any other.
        ("SELECT big * 3000000000 FROM (SELECT to(3000000000, big) FROM [1]) AS list", [9 * 10**18]),
        ("SELECT nothing == None FROM (SELECT to(None, nothing) FROM [1]) AS list", [True]),
        ("SELECT nth, step FROM (SELECT to(n, nth), to(n, step) FROM rows LIMIT 1) AS rows", [(1, 1)]),
    ],
)  # fmt: skip
def test_queries_in_from(ss: ss2sql.Session, script: str, value: Any) -> None:
    ss.set("rows", [{"n": 1, "k": "a"}, {"n": 2, "k": "b"}, {"n": 3, "k": "a"}, {"n": 4, "k": None}])
    result = ss.run(script)
    assert (result.engine, exact(result.value)) == ("duckdb", exact(value))
    assert result.value == ss.run(script, engine="native").value
