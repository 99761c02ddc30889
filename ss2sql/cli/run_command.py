"""`ss2sql run`: runs a script and prints its result."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial
from itertools import accumulate, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ss2sql.cli.output import (
    UserError,
    add_output_options,
    exit_with_code_on_error,
    make_output,
    print_note,
    writes_json,
)
from ss2sql.cli.script_options import ScriptInputs, add_script_options, redirect_output
from ss2sql.errors import Error, Source, Stopped, WorkersWarning

if TYPE_CHECKING:
    from ss2sql.results.result import Result
    from ss2sql.session.session import Session

ENGINES = ("auto", "database", "native", "duckdb", "spark")
MOST_BROKEN_OFF = 1_000_000  # rows of a partial result: the search may have been endless

RUN_OPTIONS = (
    click.option("--engine", type=click.Choice(ENGINES), default="auto", show_default=True, help="Where queries run."),
    click.option("--timeout", type=click.FloatRange(min=0), help="Seconds after which the run is broken off."),
    click.option("--maximum", type=click.IntRange(min=1), help="At most so many results of the last search."),
    click.option("--max-rows", type=click.IntRange(min=0), help="More results than that are an error."),
    click.option("--workers", type=click.IntRange(min=1), default=1, help="Processes for calls that MEMORIZE makes."),
    click.option("--progress/--no-progress", default=None,
                 help="Whether a long run says how far it is; else it does on a terminal."),
)  # fmt: skip


def add_run_options(command: Any) -> Any:
    """Adds the options of a run; `run_script` takes their values."""
    for option in reversed(RUN_OPTIONS):
        command = option(command)
    return command


@click.command("run")
@add_script_options
@add_run_options
@add_output_options
@exit_with_code_on_error
def command(
    inputs: ScriptInputs, progress: bool | None, form: str | None, output: Path | None, shown: int, **options: Any
) -> None:
    """Runs a script: FILE, - for standard input, or -e TEXT."""
    source = inputs.script
    wanted = make_output(form, output, shown)
    with inputs.open_session(progress) as session:
        try:
            result = run_script(session, source, **options)
        except Stopped as stopped:
            if stopped.partial is not None:
                wanted.write_result(
                    stopped.partial if wanted.form == "table" else build_partial_output(session, stopped.partial)
                )
            raise
        wanted.write_result(result)


def run_script(session: Session, source: str | Path | Source, **options: Any) -> Result:
    """Runs a script with the options of `add_run_options`; what it prints goes to stderr."""
    try:
        with redirect_output(), warnings.catch_warnings():  # the script's own output is no result
            warnings.simplefilter("ignore", WorkersWarning)  # printed below, without a place in Python code
            result = session.run(source, **options)
    except Error:
        raise
    except Exception as error:
        raise UserError(error) from None
    for text in result.stats.notes:
        if text.startswith("workers: "):
            print_note(text)
    for text in result.notes:
        print_note(text if writes_json() else f"note: {text}")
    return result


def build_partial_output(session: Session, found: Result) -> Result:
    """A partial result with the value that AS makes of it, limited in size.

    A representation that may fail, or that needs more than the rows, is replaced by the language's default.
    """
    from ss2sql.language.plan import Representation
    from ss2sql.runtime.representations.shape import PATH_FORMS
    from ss2sql.runtime.run.search_paths import measure_lengths

    assert found.answer is not None
    answer, shapes = found.answer, session.host.shapes
    rows = replace(answer.rows, hidden=0)
    if rows.paths is not None:
        ends = accumulate(measure_lengths(rows.paths))
        most = sum(1 for _ in takewhile(lambda end: end <= MOST_BROKEN_OFF, ends))
        if most < len(rows.paths):
            print_note(f"the first {most:,} of {len(rows.paths):,} paths:")
            rows.paths = rows.paths[:most]
    form = answer.form
    if form is None or form.name not in PATH_FORMS or form.arguments or form.named or not shapes.is_built_in(form):
        form = Representation("dict")
    return replace(found, answer=replace(answer, rows=rows, make=partial(shapes.represent_rows, form, rows, (), {})))
