"""Apache Spark as an engine: its session, what one run keeps in it, and whether searches can run there."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from os import environ
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.lowering.sql_builder import SPARK
from ss2sql.runtime.external.table_statements import Value, table_of_rows, translate_duckdb_sql
from ss2sql.runtime.search.search_run import Found, SearchRun

if TYPE_CHECKING:
    from pyspark import SparkContext
    from pyspark.sql import DataFrame, SparkSession

    from ss2sql.runtime.external.duckdb_sources import DuckSources


SETTINGS = {  # of the run's own session: planning a level is no job, and one level is one
    "spark.sql.adaptive.enabled": "false",
    "spark.sql.autoBroadcastJoinThreshold": "-1",
}


class SparkStore:
    """What one run keeps in Spark.

    Its views are in a session of the run's own, which has the settings of the user's and runs with its executors. On
    one machine the executors keep what is computed. On others it also goes to files in the folder for checkpoints, from
    where Spark goes on when it loses an executor.
    """

    def __init__(self, session: SparkSession) -> None:
        self.session, self.context = _clone_spark_session(session), session.sparkContext
        for name, value in SETTINGS.items():
            self.session.conf.set(name, value)
        self.name = f"ss2sql-{uuid4().hex[:12]}"
        self.is_stopping = False
        self._kept: list[tuple[DataFrame, DataFrame]] = []  # what was kept, and how it is read
        self.context.addJobTag(self.name)

    def interrupt_statement(self) -> None:
        self.is_stopping = True
        self.context.cancelJobsWithTag(self.name)

    def close_tables(self) -> None:
        self.context.removeJobTag(self.name)
        for kept in self._kept:
            self._release_frame(*kept)
        self._kept.clear()

    # --- rows --------------------------------------------------------------------------------------------

    def query_rows(self, select: str, values: Mapping[str, Value] | None = None) -> DataFrame:
        """The rows of a query, not computed yet."""
        if self.is_stopping:
            raise ExecutionError("X009", "the run has ended")
        text = translate_duckdb_sql(SPARK, select)
        arguments = {name: _convert_argument(value) for name, value in (values or {}).items() if f":{name}" in text}
        return self.session.sql(text, arguments)

    def load_rows(self, columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]]) -> DataFrame:
        return self.session.createDataFrame(table_of_rows(columns, rows))

    def persist_frame(self, frame: DataFrame) -> DataFrame:
        """The same rows, computed when they are first read, and kept from then on.

        Queries over them know nothing of how they are computed, so they are planned as quickly as any.
        """
        from pyspark import StorageLevel

        if is_spark_local(self.context):
            leaf = frame.localCheckpoint(eager=False)
        else:
            leaf = frame.persist(StorageLevel.MEMORY_AND_DISK).checkpoint(eager=False)
        self._kept.append((frame, leaf))
        return leaf

    def _release_frame(self, frame: DataFrame, leaf: DataFrame) -> None:
        """Lets go of what was kept, wherever that is."""
        rows: Any = leaf._jdf.queryExecution().logical().rdd()
        rows.unpersist(False)
        if not is_spark_local(self.context):
            frame.unpersist()
            file = rows.getCheckpointFile()
            if file.isDefined():
                context: Any = self.context
                path = context._jvm.org.apache.hadoop.fs.Path(file.get())
                path.getFileSystem(context._jsc.hadoopConfiguration()).delete(path, True)


def is_spark_local(context: SparkContext) -> bool:
    """Whether the executors are threads of the driver, so that none can be lost without it."""
    return re.match(r"local(\[|$)", context.master or "") is not None


def _convert_argument(value: Value) -> Any:
    """A value for a query; Spark wants arrays to be made by a function."""
    from pyspark.sql import functions

    return functions.array(*map(_convert_argument, value)) if isinstance(value, list) else functions.lit(value)


def _clone_spark_session(session: SparkSession) -> SparkSession:
    """A new session with the settings of another one, and the same executors."""
    own = session.newSession()
    before = own.conf.getAll
    for name, value in session.conf.getAll.items():
        if before.get(name) != value and own.conf.isModifiable(name):
            own.conf.set(name, value)
    return own


class SparkEngine:
    """A session of Spark: the user's, or one of its own, which is started by the first search."""

    name = "spark"
    sources: DuckSources | None = None

    def __init__(self, session: SparkSession | None) -> None:
        from py4j.protocol import Py4JError  # type: ignore[import-untyped]
        from pyspark.errors import PySparkException

        self.errors: tuple[type[Exception], ...] = (PySparkException, Py4JError)
        self.session = session
        self.own = False
        if session is None:
            _check_java()
        else:
            _check_spark_session(session)

    def open_tables(self) -> SparkStore:
        from pyspark.sql import SparkSession

        if self.session is None:
            self.session = SparkSession.getActiveSession()
        if self.session is None:
            builder = SparkSession.builder.appName("ss2sql").config("spark.ui.enabled", "false")
            self.session = builder.getOrCreate()
            self.own = True
            if "PYSPARK_PYTHON" not in environ:
                self.session.sparkContext.pythonExec = sys.executable  # else any that is called python3
        return SparkStore(self.session)

    def load_table(self, rows: Any) -> DataFrame:
        """A table of Arrow in the session of the user, which the first search has opened."""
        assert self.session is not None
        return self.session.createDataFrame(rows)

    def find_results(self, search_run: SearchRun, opened: SparkStore, written: Any) -> Iterator[Found]:
        from ss2sql.runtime.external.spark_search import SparkSearch

        return SparkSearch(search_run, opened, written).find_results()

    def close(self) -> None:
        if self.own and self.session is not None:
            self.session.stop()
        self.session = None


def _check_java() -> None:
    home = environ.get("JAVA_HOME")
    if shutil.which(f"{home}/bin/java" if home else "java") is None:
        hint = "install it, for example with apt install openjdk-17-jre-headless; JAVA_HOME says where it is"
        raise SessionError("S003", "engine='spark' needs Java 17 or newer, which was not found", hints=(hint,))


def _check_spark_session(session: Any) -> None:
    from pyspark.errors import PySparkException
    from pyspark.sql import SparkSession

    hint = "give spark = SparkSession.builder.getOrCreate(), or nothing"
    if not isinstance(session, SparkSession):
        message = f"the session of engine='spark' is a SparkSession, not {type(session).__name__}"
        raise SessionError("S002", message, hints=(hint,))
    try:
        context = session.sparkContext
    except PySparkException as error:
        message = "engine='spark' needs the driver's own session, not one of Spark Connect"
        raise SessionError("S002", message, hints=(hint,)) from error
    if not is_spark_local(context) and context.getCheckpointDir() is None:
        message = "the session has no folder that all executors can reach"
        raise SessionError("S002", message, hints=('spark.sparkContext.setCheckpointDir("hdfs://...")',))
