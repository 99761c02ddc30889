"""Where queries run: the names of the engines, and what opens the databases that search by levels."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

from ss2sql.lowering.dialects import DUCKDB
from ss2sql.results import package
from ss2sql.runtime.levels.query import TableEngine
from ss2sql.runtime.opening import check_known

Engine: TypeAlias = Literal["auto", "database", "native", "duckdb"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


def check_engine(engine: Any) -> None:
    check_known("engine", (engine,), ENGINES)


def table_engine(name: str, session: Any = None) -> TableEngine | None:
    """The database behind an engine; None where SQLite or Python do the work.

    Args:
        name: the engine.
        session: a connection of that database, whose settings count; searches leave nothing behind in it.
    """
    if name != "duckdb":
        return None
    duckdb = package("duckdb", "duckdb", "engine='duckdb'")
    package("pyarrow", "duckdb", "engine='duckdb'")
    from ss2sql.runtime.levels.duck import Duck

    duck = Duck(session)
    return TableEngine(name, DUCKDB, duck.open, duck.close, duckdb.Error)
