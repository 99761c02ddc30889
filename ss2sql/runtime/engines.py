"""Where queries run: the names of the engines, and what opens the databases that search by levels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

from ss2sql.lowering.dialects import DUCKDB, SPARK
from ss2sql.results import package
from ss2sql.runtime.levels.kinds import BY_LENGTH
from ss2sql.runtime.levels.parcel import RULES
from ss2sql.runtime.levels.query import Abilities, TableEngine
from ss2sql.runtime.opening import check_known

Engine: TypeAlias = Literal["auto", "database", "native", "duckdb", "spark"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


ABILITIES: dict[str, Abilities] = {
    abilities.name: abilities
    for abilities in (
        Abilities("duckdb", DUCKDB),
        Abilities("spark", SPARK, RULES, lambda search: (BY_LENGTH,), recursive=False),
    )
}


def check_engine(engine: Any) -> None:
    check_known("engine", (engine,), ENGINES)


def table_engine(name: str, session: Any = None) -> TableEngine | None:
    """The database behind an engine; None where SQLite or Python do the work.

    Args:
        name: the engine.
        session: a connection of that database, whose settings count; searches leave nothing behind in it.
    """
    opener = _OPENERS.get(name)
    return None if opener is None else opener(session)


def _duckdb(session: Any) -> TableEngine:
    duckdb = package("duckdb", "duckdb", "engine='duckdb'")
    package("pyarrow", "duckdb", "engine='duckdb'")
    from ss2sql.runtime.levels.duck import Duck

    duck = Duck(session)
    return TableEngine(ABILITIES["duckdb"], duck.open, duck.close, (duckdb.Error,))


def _spark(session: Any) -> TableEngine:
    for name in ("pyspark", "pyarrow", "pandas"):
        package(name, "spark", "engine='spark'")
    from py4j.protocol import Py4JError  # type: ignore[import-untyped]
    from pyspark.errors import PySparkException

    from ss2sql.runtime.levels.spark import Spark

    spark = Spark(session)
    return TableEngine(ABILITIES["spark"], spark.open, spark.close, (PySparkException, Py4JError))


_OPENERS: dict[str, Callable[[Any], TableEngine]] = {"duckdb": _duckdb, "spark": _spark}
