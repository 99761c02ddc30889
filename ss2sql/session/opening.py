"""What a session checks of its arguments, and how it opens files."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import apsw

from ss2sql.errors import SessionError, Source
from ss2sql.frontend.syntax.tokenizer import read_script
from ss2sql.runtime.sqlite.database_tables import CACHE_SIZE
from ss2sql.runtime.sqlite.file_locks import close_file, open_file

BUSY_MILLISECONDS = 1000  # how long to wait for a file that somebody else is writing
# Pages are looked at when they are read, so that more damage is noticed: 2 of the 40 ms that a million rows take.
CHECK_CELLS = "PRAGMA cell_size_check = ON"
# How SQLite uses memory. Copies of tables stay there: searching a million edges without an index takes 1.9 s, not 3.4.
MEMORY_PRAGMAS = (f"PRAGMA cache_size = {CACHE_SIZE}", "PRAGMA temp_store = MEMORY")


def get_function_name(function: Any) -> str:
    name = getattr(function, "__name__", "")
    if not name.isidentifier():
        raise SessionError("S002", f"{function!r} has no name of its own", hints=('give one: function("name", f)',))
    return str(name)


def open_connection(path: str | os.PathLike[str] | None, read_only: bool) -> apsw.Connection:
    flags = apsw.SQLITE_OPEN_READONLY if read_only else apsw.SQLITE_OPEN_READWRITE | apsw.SQLITE_OPEN_CREATE
    connection: apsw.Connection | None = None
    try:
        connection = apsw.Connection(":memory:") if path is None else open_file(os.fspath(path), flags)
        connection.set_busy_timeout(BUSY_MILLISECONDS)
        connection.execute("SELECT count(*) FROM sqlite_schema").fetchall()
        for pragma in (CHECK_CELLS, *MEMORY_PRAGMAS):
            connection.execute(pragma)
    except (apsw.Error, ValueError, TypeError) as error:  # a path may be none at all
        if connection is not None:
            close_file(connection)  # else it would hold the file for as long as somebody holds the error
        hint = "the folder has to exist, and the file has to be a SQLite database"
        if isinstance(error, (apsw.BusyError, apsw.LockedError)):
            hint = "another program is writing to it: try again when that has ended"
        raise SessionError("S002", f"{path} cannot be opened as a SQLite database: {error}", hints=(hint,)) from error
    return connection


def read_script_source(script: str | Path | Source) -> Source:
    """The text of a script with its name.

    Raises SessionError S002 for an unreadable file, ParseError P004 for one that is too large.
    """
    if isinstance(script, Path):
        try:
            with script.open("rb") as file:
                source = read_script(file, str(script))
            return replace(source, text=source.text.replace("\r\n", "\n").replace("\r", "\n"))
        except OSError as error:
            message = f"the script {script} cannot be read: {error.strerror}"
            raise SessionError("S002", message, hints=("look for the file and its name",)) from error
        except UnicodeDecodeError as error:
            message = f"the script {script} cannot be read: {error}"
            raise SessionError("S002", message, hints=("a script is text in UTF-8",)) from error
    if isinstance(script, Source):
        return script
    if not isinstance(script, str):
        hint = "bytes become text with decode()" if isinstance(script, bytes) else "put the script into quotes"
        raise SessionError("S002", f"a script is text or a pathlib.Path, not {type(script).__name__}", hints=(hint,))
    return Source(script)
