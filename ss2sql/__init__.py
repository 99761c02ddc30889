"""ss2sql: SelectScript, the SQL-like language for simulations and searches, compiled to SQLite.

`connect()` opens a session; `Session.run` runs a script and gives a `Result`. The folders, in the order in
which a script passes through them: `frontend` (text to plan), `lowering` (plan to SQL), `runtime` (the
session and the executors), `vtables` (Python objects as tables).
"""

from __future__ import annotations

from ss2sql.errors import (
    Cancelled,
    Error,
    ExecutionError,
    ParseError,
    RepresentationError,
    ResolveError,
    SessionError,
    Timeout,
    UnsupportedError,
)
from ss2sql.runtime.compiled import Query
from ss2sql.runtime.result import Result
from ss2sql.runtime.session import Session, connect

__version__ = "0.1.0"


def compile(script: str) -> Query:
    """A script compiled without a session: it runs in a fresh one, its unknown names are parameters."""
    return connect().compile(script)


__all__ = [
    "Cancelled",
    "Error",
    "ExecutionError",
    "ParseError",
    "Query",
    "RepresentationError",
    "ResolveError",
    "Result",
    "Session",
    "SessionError",
    "Timeout",
    "UnsupportedError",
    "compile",
    "connect",
]
