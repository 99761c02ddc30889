"""`ss2sql run`: runs a script and prints its result."""

from __future__ import annotations

import sys
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import click

from ss2sql.cli.endings import UserError, reports_errors
from ss2sql.cli.given import script, script_options, session_for
from ss2sql.cli.output import print_result
from ss2sql.errors import Error, WorkersWarning


@click.command("run")
@script_options
@click.option("--engine", type=click.Choice(["auto", "database", "native"]), default="auto", show_default=True)
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), default="table", show_default=True)
@click.option("--timeout", type=click.FloatRange(min=0), help="Seconds after which the run is broken off.")
@click.option("--maximum", type=click.IntRange(min=1), help="At most so many results of the last search.")
@click.option("--workers", type=click.IntRange(min=1), default=1, help="Processes for calls that MEMORIZE makes.")
@reports_errors
def command(
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
    source = script(file, text)
    with session_for(function_files, worlds, database, parameters) as session:
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
        print_result(result, form)
