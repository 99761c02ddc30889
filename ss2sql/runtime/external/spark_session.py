"""Apache Spark as an engine: its session, and whether searches can run there."""

from __future__ import annotations

import shutil
import sys
from os import environ
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError
from ss2sql.runtime.external.spark_store import SparkStore, is_local
from ss2sql.runtime.search.search_run import SearchRun

if TYPE_CHECKING:
    from pyspark.sql import SparkSession


class SparkEngine:
    """A session of Spark: the user's, or one of its own, which is started by the first search."""

    def __init__(self, session: SparkSession | None) -> None:
        self.session = session
        self.own = False
        if session is None:
            _check_java()
        else:
            _check_session(session)

    def open_store(self, search_run: SearchRun) -> SparkStore:
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

    def close_engine(self) -> None:
        if self.own and self.session is not None:
            self.session.stop()
        self.session = None


def _check_java() -> None:
    home = environ.get("JAVA_HOME")
    if shutil.which(f"{home}/bin/java" if home else "java") is None:
        hint = "install it, for example with apt install openjdk-17-jre-headless; JAVA_HOME says where it is"
        raise SessionError("S003", "engine='spark' needs Java 17 or newer, which was not found", hints=(hint,))


def _check_session(session: Any) -> None:
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
    if not is_local(context) and context.getCheckpointDir() is None:
        message = "the session has no folder that all executors can reach"
        raise SessionError("S002", message, hints=('spark.sparkContext.setCheckpointDir("hdfs://...")',))
