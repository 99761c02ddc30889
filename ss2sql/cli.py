"""The command line: `ss2sql run` runs a script, `ss2sql sql` shows what it becomes.

Results go to stdout, everything else to stderr. Exit codes: 0 for success, 1 for an error of the script, 2
for wrong usage, 124 for a timeout, 130 for Ctrl-C.
"""

from __future__ import annotations

import ast as python_ast
import csv
import importlib
import io
import json
import runpy
import sys
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from ss2sql.errors import Cancelled, Error, SessionError, Source, Timeout
from ss2sql.frontend.parser import parse
from ss2sql.plan_tree import plan_tree
from ss2sql.runtime.result import Result
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

    return run  # type: ignore[return-value]


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
) -> None:
    """Runs a script: FILE, - for standard input, or -e TEXT."""
    source = _script(file, text)
    with _session(function_files, worlds, database) as session:
        try:
            result = session.run(source, engine=engine, timeout=timeout, maximum=maximum, **_values(parameters))
        except Error:
            raise
        except Exception as error:
            _fail("".join(_user_error(error)), 1)
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
    with _session(function_files, worlds, database) as session:
        for name, value in _values(parameters).items():
            session.set(name, value)
        if stage == "ast":
            for statement in parse(
                Source(source.read_text("utf-8") if isinstance(source, Path) else source)
            ).statements:
                click.echo(statement)
            return
        query = session.compile(source)
        click.echo(plan_tree(query.plan).rstrip() if stage == "plan" else _sql_text(query.sql))


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
    return sys.stdin.read() if file == "-" else Path(file)


def _session(function_files: tuple[Path, ...], worlds: tuple[str, ...], database: str | None) -> Session:
    session = connect(database, read_only=database is not None)
    for path in function_files:
        for name, value in runpy.run_path(str(path)).items():
            if callable(value) and getattr(value, "__module__", None) == "<run_path>" and not name.startswith("_"):
                session.function(name, value)
    for world in worlds:
        session.attach(*_world(world))
    return session


def _world(text: str) -> tuple[str, Any]:
    name, _, place = text.partition("=")
    module, _, attribute = place.partition(":")
    if not (name and module and attribute):
        raise click.UsageError(f"--world takes NAME=MODULE:OBJECT, not {text}")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise SessionError("S002", f"the world {text} cannot be found: {error}") from error
    return name, found() if isinstance(found, type) else found


def _values(parameters: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, text in parameters:
        try:
            values[name] = python_ast.literal_eval(text)
        except (ValueError, SyntaxError):
            values[name] = text
    return values


def _user_error(error: Exception) -> list[str]:
    """A user's exception as Python prints it, without the frames of ss2sql."""
    import traceback

    return traceback.format_exception_only(error)


def _print(result: Result, form: str) -> None:
    if form == "json":
        click.echo(json.dumps(result.value, default=_plain, ensure_ascii=False))
    elif form == "csv":
        file = io.StringIO()
        writer = csv.writer(file)
        writer.writerow(result.columns)
        writer.writerows(result)
        click.echo(file.getvalue(), nl=False)
    elif result.answer is None:
        click.echo(result.value)
    else:
        result.show()


def _plain(value: Any) -> Any:
    """What JSON has no form for: sets as lists, keys of groups and objects as text."""
    if isinstance(value, (set, frozenset)):
        return sorted(value, key=repr)
    if isinstance(value, Mapping):
        return dict(value)
    return repr(value)


if __name__ == "__main__":
    main()
