"""ss2sql: SelectScript, the SQL-like language for simulations and searches, compiled to SQLite.

`connect()` opens a session; `Session.run` runs a script and gives a `Result`. ARCHITECTURE.md shows the rooms and
follows one script through them.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ss2sql import scenes as scenes
    from ss2sql.conformance.check_world import BrokenRuleError, check_world
    from ss2sql.errors import (
        Cancelled,
        Error,
        ExecutionError,
        OutOfMemory,
        OutOfSteps,
        ParseError,
        RepresentationError,
        ResolveError,
        SessionError,
        Timeout,
        UnsupportedError,
        WorkersWarning,
    )
    from ss2sql.notebook import load_ipython_extension, unload_ipython_extension
    from ss2sql.results.result import Result
    from ss2sql.session.compiled_script import Query
    from ss2sql.session.session import Session, connect
    from ss2sql.session.triggers import Trigger
    from ss2sql.vtables.contract import World

__version__ = "0.1.0"

# Where each name is defined. Each is imported at its first use: importing all of them takes 0.3 s, also for
# `ss2sql --help`.
PLACES = {
    "BrokenRuleError": "ss2sql.conformance.check_world",
    "Cancelled": "ss2sql.errors",
    "Error": "ss2sql.errors",
    "ExecutionError": "ss2sql.errors",
    "OutOfMemory": "ss2sql.errors",
    "OutOfSteps": "ss2sql.errors",
    "ParseError": "ss2sql.errors",
    "Query": "ss2sql.session.compiled_script",
    "RepresentationError": "ss2sql.errors",
    "ResolveError": "ss2sql.errors",
    "Result": "ss2sql.results.result",
    "Session": "ss2sql.session.session",
    "SessionError": "ss2sql.errors",
    "Timeout": "ss2sql.errors",
    "Trigger": "ss2sql.session.triggers",
    "UnsupportedError": "ss2sql.errors",
    "WorkersWarning": "ss2sql.errors",
    "World": "ss2sql.vtables.contract",
    "check_world": "ss2sql.conformance.check_world",
    "connect": "ss2sql.session.session",
    "load_ipython_extension": "ss2sql.notebook",
    "unload_ipython_extension": "ss2sql.notebook",
}


def compile(script: str) -> Query:
    """A script compiled without a session: it runs in a fresh one, its unknown names are parameters."""
    from ss2sql.session.session import connect

    return connect().compile(script)


if not TYPE_CHECKING:

    def __getattr__(name):
        """A name of PLACES, or the package `ss2sql.scenes`, imported at its first use."""
        if name == "scenes":
            return import_module("ss2sql.scenes")
        if name not in PLACES:
            raise AttributeError(f"module 'ss2sql' has no attribute '{name}'", name=name, obj=sys.modules[__name__])
        value = getattr(import_module(PLACES[name]), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *__all__, "scenes"})


__all__ = [
    "BrokenRuleError",
    "Cancelled",
    "Error",
    "ExecutionError",
    "OutOfMemory",
    "OutOfSteps",
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
    "load_ipython_extension",
    "unload_ipython_extension",
]
