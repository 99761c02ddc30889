"""What a command is given: the options for a script and what it may use, and the session made from them."""

from __future__ import annotations

import ast as python_ast
import importlib
import os
import runpy
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, TypeVar

import click

from ss2sql.cli.endings import UserError
from ss2sql.errors import SessionError
from ss2sql.runtime.session import Session, connect

F = TypeVar("F", bound=Callable[..., Any])

SCRIPT_OPTIONS = (
    click.argument("file", required=False, type=click.Path(dir_okay=False, allow_dash=True)),
    click.option("-e", "--execute", "text", help="The script itself, in place of a file."),
    click.option(
        "--functions",
        "function_files",
        multiple=True,
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="A Python file whose functions the script may call.",
    ),
    click.option("--world", "worlds", multiple=True, metavar="NAME=MODULE:OBJECT", help="A Python object to attach."),
    click.option("--database", type=click.Path(dir_okay=False), help="A SQLite file whose tables the script reads."),
    click.option("-p", "--parameter", "parameters", nargs=2, multiple=True, metavar="NAME VALUE",
                 help="A value for a name of the script, as a Python literal or else as text."),
)  # fmt: skip


def script_options(command: F) -> F:
    """Adds the options that say which script is meant and what it may use."""
    for option in reversed(SCRIPT_OPTIONS):
        command = option(command)
    return command


def script(file: str | None, text: str | None) -> str | Path:
    if (file is None) == (text is None):
        raise click.UsageError("give a script: a FILE, - for standard input, or -e TEXT")
    if text is not None:
        return text
    assert file is not None
    if file != "-":
        return Path(file)
    try:
        return sys.stdin.buffer.read().decode("utf-8")
    except UnicodeDecodeError as error:
        raise SessionError("S002", f"the script on standard input cannot be read: {error}") from error


def session_for(
    function_files: tuple[Path, ...],
    worlds: tuple[str, ...],
    database: str | None,
    parameters: tuple[tuple[str, str], ...],
) -> Session:
    session = connect(database, read_only=database is not None)
    for path in function_files:
        for name, value in _names_of(path).items():
            if callable(value) and getattr(value, "__module__", None) == "<run_path>" and not name.startswith("_"):
                session.function(name, value)
    for world in worlds:
        session.attach(*_world(world))
    for name, text in parameters:
        session.set(name, _value(text))
    return session


def _names_of(path: Path) -> dict[str, Any]:
    try:
        with redirect_stdout(sys.stderr):
            return runpy.run_path(str(path))
    except Exception as error:
        raise UserError(error) from None


def _world(text: str) -> tuple[str, Any]:
    name, _, place = text.partition("=")
    module, _, attribute = place.partition(":")
    if not (name and module and attribute):
        raise click.UsageError(f"--world takes NAME=MODULE:OBJECT, not {text}")
    sys.path.insert(0, os.getcwd())
    try:
        with redirect_stdout(sys.stderr):
            found = getattr(importlib.import_module(module), attribute)
            return name, found() if isinstance(found, type) else found
    except Exception as error:
        raise SessionError("S002", f"the world {text} cannot be found: {error}") from error


def _value(text: str) -> Any:
    """The value of a Python literal; any other text is itself."""
    try:
        return python_ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text
