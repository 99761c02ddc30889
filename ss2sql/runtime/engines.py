"""Where queries run: the names of the engines, and what opens the databases that search by levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from ss2sql.errors import SessionError
from ss2sql.results import package
from ss2sql.runtime.option_checks import check_known
from ss2sql.runtime.run import Run

if TYPE_CHECKING:
    from ss2sql.runtime.levels.query import Abilities, TableEngine

Engine: TypeAlias = Literal["auto", "database", "native", "duckdb", "spark"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


def abilities(name: str) -> Abilities | None:
    """What a database can that searches by levels; None for others. Only who asks for one loads what it needs."""
    from ss2sql.lowering.dialects import DUCKDB, SPARK
    from ss2sql.runtime.levels.level import DuckLevel, SparkLevel
    from ss2sql.runtime.levels.parcel import RULES
    from ss2sql.runtime.levels.query import Abilities

    match name:
        case "duckdb":
            return Abilities("duckdb", DUCKDB, DuckLevel)
        case "spark":
            return Abilities("spark", SPARK, SparkLevel, True, RULES)
        case _:
            return None


class NotHereError(Exception):
    """What only a run can tell: this time the query has to run elsewhere. Its text is the reason."""


def check_engine(engine: Any) -> None:
    check_known("engine", (engine,), ENGINES)


def table_engine(name: str, session: Any = None, begun: Sequence[Run] = ()) -> TableEngine | None:
    """The database behind an engine; None where SQLite or Python do the work.

    Args:
        name: the engine.
        session: a connection of that database, whose settings count; searches leave nothing behind in it.
        begun: the runs that are under way, the innermost last.
    """
    opener = _OPENERS.get(name)
    return None if opener is None else opener(session, begun)


def _duckdb(session: Any, begun: Sequence[Run]) -> TableEngine:
    duckdb = package("duckdb", "duckdb", "engine='duckdb'")
    package("pyarrow", "duckdb", "engine='duckdb'")
    from ss2sql.runtime.duck.tables import DuckSources
    from ss2sql.runtime.levels.duck import Duck
    from ss2sql.runtime.levels.query import TableEngine
    from ss2sql.runtime.levels.search import DuckSearch

    if session is not None and not isinstance(session, duckdb.DuckDBPyConnection):
        message = f"the session of engine='duckdb' is a connection of DuckDB, not {type(session).__name__}"
        raise SessionError("S002", message, hints=("give duckdb.connect(), or nothing",))
    duck = Duck(session)
    sources = DuckSources(lambda: duck.session.cursor(), (duckdb.Error,), begun)
    able = abilities("duckdb")
    assert able is not None
    return TableEngine(
        able, duck.open, duck.close, (duckdb.Error,), lambda *parts: DuckSearch(*parts).results(), sources=sources
    )


def _spark(session: Any, begun: Sequence[Run]) -> TableEngine:
    for name in ("pyspark", "pyarrow", "pandas"):
        package(name, "spark", "engine='spark'")
    from py4j.protocol import Py4JError  # type: ignore[import-untyped]
    from pyspark.errors import PySparkException

    from ss2sql.runtime.levels.query import TableEngine
    from ss2sql.runtime.levels.spark import Spark
    from ss2sql.runtime.levels.spark_frame import FramedSearch

    spark = Spark(session)
    able = abilities("spark")
    assert able is not None
    return TableEngine(
        able,
        spark.open,
        spark.close,
        (PySparkException, Py4JError),
        lambda *parts: FramedSearch(*parts).results(),
        lambda hunt, store, written, most: FramedSearch(hunt, store, written).frame(most),
    )


_OPENERS: dict[str, Callable[[Any, Sequence[Run]], TableEngine]] = {"duckdb": _duckdb, "spark": _spark}
