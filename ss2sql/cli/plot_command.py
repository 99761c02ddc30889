"""`ss2sql plot`: runs a script and draws its result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ss2sql.cli.output import (
    check_output_folder,
    describe_output_size,
    exit_with_code_on_error,
    make_output_error,
    print_note,
)
from ss2sql.cli.run_command import add_run_options, run_script
from ss2sql.cli.script_options import ScriptInputs, add_script_options
from ss2sql.errors import Stopped
from ss2sql.results.watching.search_trace import MOST_EVENTS

# Those of Result.plot.
KINDS = ("auto", "paths", "graph", "tree", "costs", "lengths", "search", "heat", "bars", "line", "points")
PICTURES = (".png", ".svg", ".pdf")


def _check_picture_path(context: click.Context, parameter: click.Parameter, value: Path) -> Path:
    if value.suffix.lower() not in PICTURES:
        raise click.BadParameter(f"{value} does not say what picture it is to be: end it in {', '.join(PICTURES)}")
    return value


def _check_picture_size(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        width, height = map(float, value.lower().split("x"))
    except ValueError:
        width = height = 0.0
    if not (0 < width <= 100 and 0 < height <= 100):
        raise click.BadParameter(f"{value!r} is no size in inches, such as 8x5")
    return width, height


@click.command("plot")
@add_script_options
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False, path_type=Path),
    callback=_check_picture_path,
              help="The file for the picture; it ends in .png, .svg or .pdf.")  # fmt: skip
@click.option("--kind", type=click.Choice(KINDS), default="auto", show_default=True, help="What is drawn.")
@click.option("--title", help="The title; else what was counted.")
@click.option("--most", type=click.IntRange(min=1), help="At most so many paths or bars.")
@click.option("--size", callback=_check_picture_size, metavar="WIDTHxHEIGHT", help="The size in inches, such as 8x5.")
@add_run_options
@exit_with_code_on_error
def command(
    inputs: ScriptInputs,
    progress: bool | None,
    output: Path,
    kind: str,
    title: str | None,
    most: int | None,
    size: tuple[float, float] | None,
    **options: Any,
) -> None:
    """Runs a script and draws its result as a picture."""
    source = inputs.script
    check_output_folder(output)
    from ss2sql.results import require_package

    require_package("matplotlib", "plot", "plot").use("agg")  # no window, and no screen needed
    if kind == "search":
        options["trace"] = MOST_EVENTS
    stopped: Stopped | None = None
    with inputs.open_session(progress) as session:
        try:
            result = run_script(session, source, **options)
        except Stopped as error:
            if error.partial is None or not (len(error.partial) or error.partial.traced):
                raise
            result, stopped = error.partial, error
        figure = result.plot(kind=kind, title=title, most=most).figure
        if size is not None:
            figure.set_size_inches(size)
        try:
            figure.savefig(output)
        except OSError as error:
            raise make_output_error(output, error) from error
    print_note(f"written to {output}: {describe_output_size(result)}")
    if stopped is not None:
        raise stopped
