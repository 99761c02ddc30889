"""What the statement of a script may do in SQLite: read, and call the functions that are registered for it.

The text of such statements is made by lowering, which has no words for anything else. This is the second lock: SQLite
asks while it prepares a statement, and refuses it before it runs. A small query takes 2 us longer the first time that
SQLite sees its text (8 instead of 6) and less than 1 us after that (of 64); a search takes no longer, for SQLite asks
nothing while it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import apsw

from ss2sql.errors import Error, ExecutionError
from ss2sql.language.conversion import build_utf8_error
from ss2sql.runtime.run.run_state import Run, build_memory_error

# What reading a file may raise: a text in it may be no UTF-8.
READ_ERRORS = (apsw.Error, UnicodeDecodeError)


class TooLargeToBindError(apsw.TooBigError):
    """A value that Python gave is larger than SQLite takes. No row was evaluated, so the query can run natively."""


class Authorizer:
    """The authorizer of a connection. It looks at statements of scripts; ss2sql's own pass.

    What functions run while a statement runs (another script, a temporal variable that is written) is looked at by
    itself, for SQLite has prepared the outer statement by then.
    """

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection
        self.functions: set[str] = set()
        self._looks = False
        self._text = ""
        lock_down_connection(connection)
        connection.authorizer = self._authorize_action

    def add_scalar(self, name: str, function: Callable[..., Any], arguments: int = -1) -> None:
        self.connection.create_scalar_function(name, function, arguments)
        self.functions.add(name.lower())

    def add_aggregate(self, name: str, factory: Callable[[], Any]) -> None:
        self.connection.create_aggregate_function(name, factory)
        self.functions.add(name.lower())

    def execute_reading(self, text: str, values: Mapping[str, Any], cursor: apsw.Cursor | None = None) -> apsw.Cursor:
        """The cursor on the rows of one statement that only reads. Raises apsw.Error for anything else."""
        cursor = cursor or self.connection.cursor()
        cursor.exec_trace = self._check_prepared_statement
        self._looks, self._text = True, text
        try:
            return cursor.execute(text, values)
        except apsw.TooBigError as error:
            if self._looks:  # it has not begun
                raise TooLargeToBindError(str(error)) from None
            raise
        finally:
            self._looks = False

    def _check_prepared_statement(self, cursor: apsw.Cursor, text: str, values: Any) -> bool:
        """apsw asks this between preparing a statement and running it: one that only reads, and no other after it."""
        self._looks = False
        return cursor.is_readonly and len(text) == len(self._text)

    def _authorize_action(
        self, action: int, first: str | None, second: str | None, database: str | None, inside: str | None
    ) -> int:
        if not self._looks or action == apsw.SQLITE_SELECT or action == apsw.SQLITE_RECURSIVE:
            return apsw.SQLITE_OK
        if inside is not None and action in (apsw.SQLITE_READ, apsw.SQLITE_FUNCTION):
            return apsw.SQLITE_OK  # of a view, whose definition is the file's, see lock_down_connection
        if action == apsw.SQLITE_READ:
            return apsw.SQLITE_DENY if (first or "").lower().startswith("sqlite_") else apsw.SQLITE_OK
        if action == apsw.SQLITE_FUNCTION:
            name = (second or "").lower()
            return apsw.SQLITE_OK if name in self.functions or name in _list_allowed_functions() else apsw.SQLITE_DENY
        return apsw.SQLITE_DENY


@cache
def _list_allowed_functions() -> frozenset[str]:
    from ss2sql.lowering.sqlite_forms import list_form_functions  # loaded by now, if it has written a statement

    return list_form_functions() | {"char", "coalesce", "count", "glob", "instr", "row_number", "substr", "typeof"}


def lock_down_connection(connection: apsw.Connection) -> None:
    """Switches off what no script needs, and what a file that comes from a stranger could use.

    Views, indexes and generated columns of such a file call none of the functions that are registered here, and none of
    SQLite's that have effects.
    """
    connection.config(apsw.SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, 0)
    connection.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)
    connection.config(apsw.SQLITE_DBCONFIG_DEFENSIVE, 1)


def find_sqlite_run_error(error: apsw.Error | UnicodeDecodeError, run: Run) -> Error:
    """The error of a run whose statement SQLite broke off."""
    if isinstance(error, apsw.TooBigError) and not isinstance(error, TooLargeToBindError):
        return run.sizes.build_size_error("a text")
    if isinstance(error, apsw.NoMemError):
        return build_memory_error()
    return build_sqlite_error(error, "run it with engine='native'")


def build_sqlite_error(error: apsw.Error | UnicodeDecodeError, *hints: str) -> ExecutionError:
    """The error for what SQLite does not do, or for a text that it gives and Python cannot read."""
    if isinstance(error, UnicodeDecodeError):
        return build_utf8_error(error.object)
    return ExecutionError("X009", f"SQLite: {error}", hints=hints)
