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
    from ss2sql.conformance.check_world import BrokenRuleError as BrokenRuleError
    from ss2sql.conformance.check_world import check_world as check_world
    from ss2sql.errors import Cancelled as Cancelled
    from ss2sql.errors import Error as Error
    from ss2sql.errors import ExecutionError as ExecutionError
    from ss2sql.errors import OutOfMemory as OutOfMemory
    from ss2sql.errors import OutOfSteps as OutOfSteps
    from ss2sql.errors import ParseError as ParseError
    from ss2sql.errors import RepresentationError as RepresentationError
    from ss2sql.errors import ResolveError as ResolveError
    from ss2sql.errors import SessionError as SessionError
    from ss2sql.errors import Timeout as Timeout
    from ss2sql.errors import UnsupportedError as UnsupportedError
    from ss2sql.errors import WorkersWarning as WorkersWarning
    from ss2sql.notebook import load_ipython_extension as load_ipython_extension
    from ss2sql.notebook import unload_ipython_extension as unload_ipython_extension
    from ss2sql.results.result import Result as Result
    from ss2sql.session.compiled_script import Query as Query
    from ss2sql.session.session import Session as Session
    from ss2sql.session.session import connect as connect
    from ss2sql.session.variables import Trigger as Trigger
    from ss2sql.vtables.contract import World as World

__version__ = "0.1.0"

# The modules with their public names. Each is imported at its first use: importing all of them takes 0.3 s, also for
# `ss2sql --help`.
_NAMES = {
    "ss2sql.conformance.check_world": "BrokenRuleError check_world",
    "ss2sql.errors": "Cancelled Error ExecutionError OutOfMemory OutOfSteps ParseError RepresentationError ResolveError"
    " SessionError Timeout UnsupportedError WorkersWarning",
    "ss2sql.notebook": "load_ipython_extension unload_ipython_extension",
    "ss2sql.results.result": "Result",
    "ss2sql.session.compiled_script": "Query",
    "ss2sql.session.session": "Session connect",
    "ss2sql.session.variables": "Trigger",
    "ss2sql.vtables.contract": "World",
}
PLACES = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted([*PLACES, "compile"])


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
