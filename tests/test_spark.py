"""Searches by levels in tables of Spark find what the native search finds; their steps are tried by other processes."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import golden
import pytest
from agreement import exact
from hypothesis import HealthCheck, Phase, given, seed, settings
from programs import ProgramCase, programs
from sessions import code_of
from test_levels import FORMS, ROADS, outcome, variants

import ss2sql
from ss2sql.frontend import ast
from ss2sql.runtime.levels import spark as engine
from ss2sql.runtime.levels import spark_store

pytest.importorskip("pyspark")
if shutil.which("java") is None:
    pytest.skip("Spark needs Java, which is not installed", allow_module_level=True)

# What pyspark 4 does with packages that are newer than itself, and sockets that it leaves to Python to close.
pytestmark = [
    pytest.mark.filterwarnings("ignore:PySpark does not yet fully support pandas:FutureWarning"),
    pytest.mark.filterwarnings("ignore:unclosed <socket:ResourceWarning"),
]
SETTINGS = {
    "spark.ui.enabled": "false",
    "spark.ui.showConsoleProgress": "false",
    "spark.sql.shuffle.partitions": "2",
    "spark.sql.adaptive.enabled": "false",  # each of its stages is a job, which takes longer than the work
    "spark.sql.codegen.wholeStage": "false",  # so does compiling
    "spark.sql.codegen.factoryMode": "NO_CODEGEN",
    "spark.driver.extraJavaOptions": "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC",
    "spark.driver.memory": "1g",
    "spark.log.level": "OFF",
}
COUNT = max(10, int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 100)
LOCK = threading.Lock()
LONG = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this AS list;"
SHORT = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 2 AS list;"


@pytest.fixture(scope="module")
def spark() -> Iterator[Any]:
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    builder = SparkSession.builder.appName("tests").master("local[2,4]")  # a task may be begun four times
    for name, value in SETTINGS.items():
        builder = builder.config(name, value)
    session = builder.getOrCreate()
    yield session
    session.stop()
    del os.environ["PYSPARK_PYTHON"]


@pytest.fixture
def ss(spark: Any) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="spark", session=spark) as session:
        roads = ROADS
        session.function("near", lambda n: roads[int(n)], volatility="immutable")
        yield session


@pytest.fixture(autouse=True)
def nothing_is_left_behind(spark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield
    assert spark.catalog.listTables() == []
    assert spark.sparkContext._jsc.getPersistentRDDs().isEmpty()
    assert list(tmp_path.glob("ss2sql*")) == []


def agree(ss: ss2sql.Session, script: str, **options: Any) -> None:
    found = ss.run(script, **options)
    wanted = ss.run(script, engine="native", **options)
    assert found.engine == "spark"
    assert exact(found.value) == exact(wanted.value)
    assert (found.status, found.columns, list(found)) == (wanted.status, wanted.columns, list(wanted))


# --- the same answers ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 7", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 9"])
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    agree(ss, form.format(strategy))


@pytest.mark.parametrize("strategy", ["UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST"])
@pytest.mark.parametrize("bad", [0, 3, 5])
def test_a_step_that_fails_counts_where_it_would_have_been_taken(ss: ss2sql.Session, strategy: str, bad: int) -> None:
    def fail(n: int, level: int) -> bool:
        if (n * 3 + level) % 7 == bad:
            raise ValueError(n)
        return n > 3

    ss.function("fail", fail, volatility="immutable")
    ss.set("roads", [[0], [2, 3], [1, 3, 4], [2, 4], [1, 2]])
    script = (
        "SELECT x.this FROM x = roads[n] WHERE fail(x.this, level) START WITH n = 1, level = 0"
        f" CONNECT BY {strategy} MAXIMUM 3 n = x.this, level = level + 1 AS list;"
    )
    assert ended(ss, script, "spark") == ended(ss, script, "native")


def ended(ss: ss2sql.Session, script: str, where: Any) -> tuple[Any, ...]:
    try:
        return ("value", ss.run(script, engine=where).value)
    except ss2sql.Error as error:
        return (error.code, str(error))
    except Exception as error:
        return (type(error).__name__, str(error), *getattr(error, "__notes__", ()))


@pytest.mark.parametrize("most", [1, 4, 9])
def test_rows_and_sources_that_fail(ss: ss2sql.Session, most: int) -> None:
    ss.set("roads", [[0], [2, 3], [3, 1, 5], [2, 7], []])  # there are no roads from 5 and 7
    ss.set("most", most)
    script = "SELECT 10 / (4 - x.this) FROM x = roads[n] START WITH n = 1 CONNECT BY UNIQUE MAXIMUM (most) n = x.this;"
    assert ended(ss, script, "spark") == ended(ss, script, "native")


def test_random_searches(spark: Any) -> None:
    """Those that end soon: a level takes long."""
    compared = 0

    @seed(8)
    @settings(
        max_examples=30 * COUNT,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(programs())
    def run(case: ProgramCase) -> None:
        nonlocal compared
        for statement in variants(case.script)[compared % 3 : compared % 3 + 1]:  # one strategy of each
            wanted = outcome(case, statement, "native", 0.2)
            if wanted is None or compared >= COUNT:
                continue
            statement = replace(statement, options=(*statement.options, *at_most(statement)))
            wanted = outcome(case, statement, "native", 0.2)
            found = outcome(case, statement, "spark", 60, spark)
            if found is not None:
                compared += 1
                assert found == wanted, statement.options

    run()
    assert compared == COUNT


def at_most(query: ast.Query) -> list[ast.Option]:
    """MAXIMUM 9, where the query has none."""
    if any(option.keyword == "MAXIMUM" for option in query.options):
        return []
    nine = ast.Literal(9, span=query.span)
    return [ast.Option("MAXIMUM", nine, span=query.span)]


@pytest.mark.parametrize("case", golden.level_searches(), ids=lambda case: case.name)
def test_golden_cases(spark: Any, case: golden.Case) -> None:
    found = golden.run(case, "spark")  # in the session that is active
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.parametrize("few", [0, 1])
def test_large_levels_are_numbered_in_parts(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, few: int) -> None:
    """And ways to many goals are walked by joins, and file sets become one."""
    monkeypatch.setattr(engine, "FEW", few)
    monkeypatch.setattr(engine, "GOALS", few)
    monkeypatch.setattr(spark_store, "PARTS", 2)
    agree(ss, "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this STOP WITH n == 4 AS list;")


def test_numbering_leaves_rows_where_they_are(spark: Any, ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps are numbered without an exchange that brings all rows into one partition."""
    monkeypatch.setattr(engine, "FEW", 0)
    plans: list[str] = []
    number = engine.SparkTables._numbered

    def look(self: engine.SparkTables, unnumbered: engine.Part) -> engine.Part:
        part = number(self, unnumbered)
        plans.append(part.frame._jdf.queryExecution().executedPlan().toString())  # type: ignore[operator]
        return part

    monkeypatch.setattr(engine.SparkTables, "_numbered", look)
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]
    assert plans
    for text in plans:
        assert "rangepartitioning(place" in text
        assert "SinglePartition" not in text


def test_other_settings_of_spark(spark: Any, ss: ss2sql.Session) -> None:
    """Stages that are planned while they run, three partitions, a folder of one's own, small batches."""
    own = {"spark.sql.adaptive.enabled": "true", "spark.sql.shuffle.partitions": "3"}
    own["spark.sql.execution.arrow.maxRecordsPerBatch"] = "1"
    before = {name: spark.conf.get(name) for name in own}
    for name, value in own.items():
        spark.conf.set(name, value)
    agree(ss, FORMS[1].format("BREADTH FIRST NO CYCLE"))
    for name, value in before.items():
        spark.conf.set(name, value)


# --- what is sent --------------------------------------------------------------------------------------------


def test_each_step_is_tried_once(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function has a file with a line for each call, in whichever process."""
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{n} {more}\n")
        return min(n + more, 9)

    ss.function("noted", noted, volatility="immutable")
    script = "SELECT noted(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = noted(n, this) AS list;"
    result = ss.run(script)
    assert sorted(path[-1] for path in result.value) == list(range(1, 10))
    edges = Counter(f"{n} {more}" for n in range(10) for more in (1, 2))
    assert Counter(calls.read_text().splitlines()) == edges
    assert result.stats.calls["noted"] == 20
    assert sum(level.steps + level.pruned for level in result.stats.levels) == 20


def test_tables_variables_frames_and_nested_queries_are_sent(ss: ss2sql.Session) -> None:
    pandas = pytest.importorskip("pandas")
    ss.host.connection.execute("CREATE TABLE edges(src, dst); INSERT INTO edges VALUES (1, 2), (2, 3), (3, 4), (2, 1)")
    ss.set("closed", [4, {"a": 1}])
    ss.attach("weights", pandas.DataFrame({"node": [1, 2, 3], "more": [0.5, 1.5, 2.5]}))
    agree(
        ss,
        "SELECT e.dst, w.more FROM e = (SELECT dst FROM edges WHERE src == n), w = weights"
        " WHERE NOT (e.dst IN closed) START WITH n = 1 CONNECT BY UNIQUE n = e.dst STOP WITH w.node != n;",
    )


@pytest.mark.parametrize(
    ("function", "options", "reason"),
    [
        (lambda n: n + 1, {"volatility": "stable"}, "'step' is stable: it may depend on what only this process knows"),
        (lambda n, lock=LOCK: n + 1, {"volatility": "immutable"}, "'step' cannot be pickled"),
    ],
    ids=["stable", "lock"],
)
def test_functions_that_cannot_be_sent_are_refused_by_name(
    ss: ss2sql.Session, function: Any, options: Any, reason: str
) -> None:
    ss.function("step", function, **options)
    with pytest.raises(ss2sql.UnsupportedError, match=reason) as caught:
        ss.run("SELECT step(n) FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = step(n) STOP WITH n > 3;")
    assert caught.value.code == "U001"
    assert caught.value.hints


def test_worlds_and_objects_are_refused(ss: ss2sql.Session) -> None:
    from cases.shelf import Shelf

    ss.attach("shelf", Shelf())
    with pytest.raises(ss2sql.UnsupportedError, match="a world is in this process only"):
        ss.run("SELECT s.weight FROM s = shelf START WITH n = 1 CONNECT BY UNIQUE n = s.weight;")
    ss.attach("things", [object()])
    script = "SELECT 1 FROM x = things START WITH n = None CONNECT BY BREADTH FIRST MAXIMUM 3 n = x.this;"
    assert code_of(ss.run, script) == "U001"
    ss.function("thing", lambda n: object(), volatility="immutable")
    with pytest.raises(ss2sql.UnsupportedError, match="a row or state has an object"):
        ss.run("SELECT n FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = thing(n);")


@pytest.mark.parametrize("options", ["COST 1", "MEMORIZE 3", "DEPTH FIRST"])
def test_other_orders_are_refused_by_name(ss: ss2sql.Session, options: str) -> None:
    with pytest.raises(ss2sql.UnsupportedError, match=f"{options.partition(' ')[0]}.*the tables of spark cannot do"):
        ss.run(f"SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {options} n = x.this;")


def test_a_function_that_fails_on_executors_only(ss: ss2sql.Session) -> None:
    here = os.getpid()

    def fails_elsewhere(n: int) -> int:
        if os.getpid() != here:
            raise ValueError
        return n

    ss.function("fails_elsewhere", fails_elsewhere, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="did not fail again"):
        ss.run("SELECT fails_elsewhere(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")


# --- what goes wrong -----------------------------------------------------------------------------------------


def test_a_python_process_that_is_lost(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The first process that meets 5 ends itself; Spark has another one begin the task anew."""
    marker = tmp_path / "marker"

    def deadly(n: int, more: int) -> int:
        if n == 5 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), 9)
        return min(n + more, 9)

    ss.function("deadly", deadly, volatility="immutable")
    script = "SELECT deadly(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = deadly(n, this) AS list;"
    found = ss.run(script)
    assert marker.exists()
    wanted = ss.run(script, engine="native")
    assert found.value == wanted.value
    assert sum(level.steps + level.pruned for level in found.stats.levels) == 20


def test_a_function_that_ends_its_process(ss: ss2sql.Session) -> None:
    here = os.getpid()
    ss.function("deadly", lambda n: os._exit(3) if os.getpid() != here else n, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="spark: ") as caught:
        ss.run("SELECT deadly(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")
    assert caught.value.code == "X009"
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_a_run_that_is_late(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(LONG, timeout=6)
    partial = caught.value.partial
    assert partial is not None
    assert [list(path) for path in partial.paths[:3]] in ([], [[(1,)], [(2,)], [(1,), (1,)]], [[(1,)], [(2,)]])
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_interrupt_ends_the_job_that_runs(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function sleeps on the executors for longer than anybody waits."""
    marker = tmp_path / "marker"

    def sleepy(n: int) -> int:
        marker.touch()
        time.sleep(30)
        return n

    def interrupt() -> None:
        while not marker.exists():
            time.sleep(0.01)
        ss.interrupt()

    ss.function("sleepy", sleepy, volatility="immutable")
    thread = threading.Thread(target=interrupt)
    thread.start()
    before = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        ss.run("SELECT sleepy(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")
    thread.join()
    assert time.monotonic() - before < 25


# --- sessions ------------------------------------------------------------------------------------------------


def test_views_of_the_user_stay(spark: Any, ss: ss2sql.Session) -> None:
    spark.sql("SELECT 1 AS a").createOrReplaceTempView("steps")
    assert ss.run(SHORT).engine == "spark"
    assert [tuple(row) for row in spark.table("steps").collect()] == [(1,)]
    spark.catalog.dropTempView("steps")


def test_explain_and_sql(ss: ss2sql.Session) -> None:
    result = ss.run(SHORT)
    assert "engine: spark: engine='spark' was asked for" in str(result.explain())
    assert "GROUP BY\n    row_key" in result.sql
    assert "as long as this gives rows" in result.sql
    assert "RECURSIVE" not in result.sql


def test_what_is_no_session_is_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="is a SparkSession, not int"):
        ss2sql.connect(engine="spark", session=3)


def test_missing_java_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("JAVA_HOME", str(tmp_path))
    with pytest.raises(ss2sql.SessionError, match="needs Java 17 or newer") as caught:
        ss2sql.connect(engine="spark")
    assert caught.value.code == "S003"


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyspark", None)
    with pytest.raises(ss2sql.SessionError, match=r"ss2sql\[spark\]"):
        ss2sql.connect(engine="spark")
