"""What tests of Spark compare: an answer with that of the native engine, or how a script ends."""

from __future__ import annotations

from typing import Any

from agreement import exact

import ss2sql

SHORT = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 2 AS list;"


def agree(ss: ss2sql.Session, script: str, **options: Any) -> None:
    found = ss.run(script, **options)
    wanted = ss.run(script, engine="native", **options)
    assert found.engine == "spark"
    assert exact(found.value) == exact(wanted.value)
    assert (found.status, found.columns, list(found)) == (wanted.status, wanted.columns, list(wanted))


def ended(ss: ss2sql.Session, script: str, where: Any) -> tuple[Any, ...]:
    try:
        return ("value", ss.run(script, engine=where).value)
    except ss2sql.Error as error:
        return (error.code, str(error))
    except Exception as error:
        return (type(error).__name__, str(error), *getattr(error, "__notes__", ()))
