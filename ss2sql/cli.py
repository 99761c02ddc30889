"""The command line: `ss2sql run` runs a script, `ss2sql sql` shows what it becomes.

Results go to stdout, everything else to stderr. Exit codes: 0 for success, 1 for an error of the script, 2
for wrong usage, 124 for a timeout, 130 for Ctrl-C.
"""

from __future__ import annotations

import ast as python_ast
import importlib
import os
import runpy
import sys
import traceback
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from ss2sql.errors import Cancelled, Error, SessionError, Timeout, WorkersWarning
from ss2sql.frontend.parser import parse
from ss2sql.plan_tree import plan_tree
from ss2sql.runtime.result import Result
from ss2sql.runtime.session import Session, connect, source_of

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


def reports_errors(command: F) -> F:
    """Prints errors to stderr and ends with the exit code that belongs to them."""

    @wraps(command)
    def run(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except Timeout as error:
            _fail(str(error), 124)
        except (Cancelled, KeyboardInterrupt):
            _fail("cancelled", 130)
        except Error as error:
            _fail(str(error), 1)
        except UserError as error:
            _fail(str(error), 1)

    return run  # type: ignore[return-value]


class UserError(Exception):
    """What Python code of the user raised, as text; without the frames of ss2sql."""

    def __init__(self, error: Exception) -> None:
        shown = traceback.TracebackException.from_exception(error)
        own = (str(Path(__file__).parent), "src/", "<frozen runpy>")  # src/ is apsw
        frames = [frame for frame in shown.stack if not frame.filename.startswith(own)]
        shown.stack = traceback.StackSummary.from_list(frames)
        super().__init__("".join(shown.format()).rstrip())


def _fail(message: str, code: int) -> None:
    click.echo(message, err=True)
    sys.exit(code)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="ss2sql")
def main() -> None:
    """SelectScript, the SQL-like language for simulations and searches, compiled to SQLite."""


@main.command()
@script_options
@click.option("--engine", type=click.Choice(["auto", "database", "native"]), default="auto", show_default=True)
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), default="table", show_default=True)
@click.option("--timeout", type=click.FloatRange(min=0), help="Seconds after which the run is broken off.")
@click.option("--maximum", type=click.IntRange(min=1), help="At most so many results of the last search.")
@click.option("--workers", type=click.IntRange(min=1), default=1, help="Processes for calls that MEMORIZE makes.")
@reports_errors
def run(
    file: str | None,
    text: str | None,
    function_files: tuple[Path, ...],
    worlds: tuple[str, ...],
    database: str | None,
    parameters: tuple[tuple[str, str], ...],
    engine: Any,
    form: str,
    timeout: float | None,
    maximum: int | None,
    workers: int,
) -> None:
    """Runs a script: FILE, - for standard input, or -e TEXT."""
    source = _script(file, text)
    with _session(function_files, worlds, database, parameters) as session:
        try:
            with redirect_stdout(sys.stderr), warnings.catch_warnings():  # what the script prints is not its result
                warnings.simplefilter("ignore", WorkersWarning)  # told below, without a place in Python code
                result = session.run(source, engine=engine, timeout=timeout, maximum=maximum, workers=workers)
        except Error:
            raise
        except Exception as error:
            raise UserError(error) from None
        for note in result.stats.notes:
            if note.startswith("workers: "):
                click.echo(note, err=True)
        _print(result, form)


@main.command()
@script_options
@click.option("--stage", type=click.Choice(["ast", "plan", "sql"]), default="sql", show_default=True)
@reports_errors
def sql(
    file: str | None,
    text: str | None,
    function_files: tuple[Path, ...],
    worlds: tuple[str, ...],
    database: str | None,
    parameters: tuple[tuple[str, str], ...],
    stage: str,
) -> None:
    """Shows what a script becomes: its syntax tree, its plan, or the SQL that runs."""
    source = _script(file, text)
    if stage == "ast":
        for statement in parse(source_of(source)).statements:
            _echo(repr(statement))
        return
    with _session(function_files, worlds, database, parameters) as session:
        query = session.compile(source)
        _echo(plan_tree(query.plan).rstrip() if stage == "plan" else _sql_text(query.sql))


def _sql_text(sql: Any) -> str:
    """The SQL with the values of its parameters as comments."""
    lines = [f"-- :{name} = {value!r}" for name, value in sql.parameters.items()]
    return "\n".join([str(sql), *lines])


def _script(file: str | None, text: str | None) -> str | Path:
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


def _session(
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


def _echo(text: str) -> None:
    """Prints a result; what no terminal can show is written as an escape."""
    click.echo(text.encode("utf-8", "backslashreplace").decode("utf-8"))


def _print(result: Result, form: str) -> None:
    if form == "json":
        _echo(str(result.json()))
    elif form == "csv":
        _echo(str(result.csv()).rstrip("\n"))
    elif result.answer is None:
        _echo(str(result.value))
    else:
        result.show()


if __name__ == "__main__":
    main()
