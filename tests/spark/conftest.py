"""The session of Spark for all files of this folder, which are left out where it cannot be had."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from level_searches import ROADS

import ss2sql
from ss2sql.runtime.external import level_steps

FOLDER = Path(__file__).parent
# What pyspark 4 does with packages that are newer than itself, and sockets that it leaves to Python to close.
WARNINGS = (
    "ignore:PySpark does not yet fully support pandas:FutureWarning",
    "ignore:unclosed <socket:ResourceWarning",
)
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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if FOLDER in item.path.parents:
            for warning in WARNINGS:
                item.add_marker(pytest.mark.filterwarnings(warning))


@pytest.fixture(scope="package")
def spark() -> Iterator[Any]:
    sql = pytest.importorskip("pyspark.sql")
    if shutil.which("java") is None:
        pytest.skip("Spark needs Java, which is not installed")
    os.environ["PYSPARK_PYTHON"] = sys.executable
    builder = sql.SparkSession.builder.appName("tests").master("local[2,4]")  # a task may be begun four times
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
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spark does all levels, also small ones."""
    monkeypatch.setattr(level_steps, "MAX_STATES", 0)


@pytest.fixture(autouse=True)
def nothing_is_left_behind(spark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield
    assert spark.catalog.listTables() == []
    assert spark.sparkContext._jsc.getPersistentRDDs().isEmpty()
    assert list(tmp_path.glob("ss2sql*")) == []
