"""Where queries run: the names of the engines, and what opens the databases that search by levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from ss2sql.errors import SessionError, require_package
from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.run.option_checks import check_option_word, check_run_limit
from ss2sql.runtime.run.run_state import Run

if TYPE_CHECKING:
    from ss2sql.runtime.external.level_query import TableEngine

Engine: TypeAlias = Literal["auto", "database", "native", "duckdb", "spark"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


def check_engine(engine: Any) -> None:
    check_option_word("engine", (engine,), ENGINES)


def check_engine_session(engine: Engine, session: Any) -> None:
    """Raises SessionError S002 for the connection of an engine that is not the session's."""
    if session is not None and engine not in _OPENERS:
        message = f"session is the connection of the engine 'duckdb' or 'spark', not of {engine!r}"
        raise SessionError("S002", message, hints=("write connect(engine='duckdb', session=...)",))


OPTIONS = ("engine", "timeout", "maximum", "workers", "max_rows")  # of `run`, which a misspelt name may mean


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of one run, see `Session.run`."""

    engine: Engine | None
    timeout: float | None
    maximum: int | None
    workers: int = 1
    max_rows: int | None = None
    trace: int | None = None

    def check_options(self) -> None:
        if self.engine is not None:
            check_engine(self.engine)
        check_run_limit("maximum", self.maximum, 1)
        check_run_limit("workers", self.workers, 1)
        check_run_limit("max_rows", self.max_rows, 0)
        check_run_limit("trace", self.trace, 1)


def open_session_engine(name: str, session: Any = None, begun: Sequence[Run] = ()) -> TableEngine | None:
    """The database of an engine; None if SQLite or Python do the work.

    `session` is the user's connection of that database, whose settings count; `begun` are the active runs in order.
    """
    opener = _OPENERS.get(name)
    return None if opener is None else opener(session, begun)


def _open_duckdb_engine(session: Any, begun: Sequence[Run]) -> TableEngine:
    duckdb = require_package("duckdb", "duckdb", "engine='duckdb'")
    require_package("pyarrow", "duckdb", "engine='duckdb'")
    from ss2sql.runtime.external.duckdb_search import DuckEngine, DuckSearch
    from ss2sql.runtime.external.duckdb_sources import DuckSources
    from ss2sql.runtime.external.level_query import TableEngine

    if session is not None and not isinstance(session, duckdb.DuckDBPyConnection):
        message = f"the session of engine='duckdb' is a connection of DuckDB, not {type(session).__name__}"
        raise SessionError("S002", message, hints=("give duckdb.connect(), or nothing",))
    duck = DuckEngine(session)
    sources = DuckSources(lambda: duck.session.cursor(), (duckdb.Error,), begun)
    return TableEngine(
        "duckdb",
        duck.open_tables,
        duck.close_engine,
        (duckdb.Error,),
        lambda *parts: DuckSearch(sources, *parts).find_results(),
        sources=sources,
    )


def _open_spark_engine(session: Any, begun: Sequence[Run]) -> TableEngine:
    for name in ("pyspark", "pyarrow", "pandas"):
        require_package(name, "spark", "engine='spark'")
    from py4j.protocol import Py4JError  # type: ignore[import-untyped]
    from pyspark.errors import PySparkException

    from ss2sql.runtime.external.level_query import TableEngine
    from ss2sql.runtime.external.spark_search import SparkSearch
    from ss2sql.runtime.external.spark_session import SparkEngine

    spark = SparkEngine(session)
    return TableEngine(
        "spark",
        spark.open_store,
        spark.close_engine,
        (PySparkException, Py4JError),
        lambda *parts: SparkSearch(*parts).find_results(),
        spark.load_table,
    )


_OPENERS: dict[str, Callable[[Any, Sequence[Run]], TableEngine]] = {
    "duckdb": _open_duckdb_engine,
    "spark": _open_spark_engine,
}
