"""ss2sql: SelectScript, the SQL-like language for simulations and searches, compiled to SQLite.

`connect()` opens a session; `Session.run` runs a script and gives a `Result`. The folders, in the order in
which a script passes through them: `frontend` (text to plan), `lowering` (plan to SQL), `runtime` (the
session and the executors), `vtables` (Python objects as tables); `scenes` holds simulations to try it on.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

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
    WorkersWarning,
)
from ss2sql.runtime.compiled import Query
from ss2sql.runtime.result import Result
from ss2sql.runtime.session import Session, connect
from ss2sql.runtime.triggers import Trigger
from ss2sql.vtables.base import World
from ss2sql.vtables.conformance import BrokenRuleError, check_world

__version__ = "0.1.0"


def compile(script: str) -> Query:
    """A script compiled without a session: it runs in a fresh one, its unknown names are parameters."""
    return connect().compile(script)


if TYPE_CHECKING:
    from ss2sql import scenes as scenes
else:

    def __getattr__(name):
        """`ss2sql.scenes`, which is imported when it is first asked for."""
        if name == "scenes":
            return import_module("ss2sql.scenes")
        raise AttributeError(f"module 'ss2sql' has no attribute '{name}'", name=name, obj=sys.modules[__name__])


__all__ = [
    "BrokenRuleError",
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
    "Trigger",
    "UnsupportedError",
    "WorkersWarning",
    "World",
    "check_world",
    "compile",
    "connect",
]
