"""`ss2sql play`: runs a script and writes a page that plays its search."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ss2sql.cli.output import check_output_folder, exit_with_code_on_error, print_note
from ss2sql.cli.run_command import add_run_options, run_script
from ss2sql.cli.script_options import ScriptInputs, add_script_options
from ss2sql.errors import Stopped
from ss2sql.results.watching.search_trace import MOST_EVENTS


@click.command("play")
@add_script_options
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path),
              help="The file for the page; else FILE with the ending .html, or search.html.")  # fmt: skip
@click.option("--beside", metavar="FILE", help="A second script, shown beside the first; with -e its text.")
@click.option("--trace", type=click.IntRange(min=1), default=MOST_EVENTS, show_default=True,
              help="The first so many events.")  # fmt: skip
@click.option("--title", help="The title; else the names of the strategies.")
@add_run_options
@exit_with_code_on_error
def command(
    inputs: ScriptInputs,
    progress: bool | None,
    output: Path | None,
    beside: str | None,
    title: str | None,
    **options: Any,
) -> None:
    """Runs a script and writes a page that plays its search, to be opened in a browser."""
    sources = [inputs.script]
    if beside is not None:
        sources.append(beside if inputs.text is not None else Path(beside))
    path = output or (Path(inputs.file).with_suffix(".html") if inputs.file not in (None, "-") else Path("search.html"))
    check_output_folder(path)
    stopped: Stopped | None = None
    results = []
    with inputs.open_session(progress) as session:
        for source in sources:
            try:
                results.append(run_script(session, source, **options))
            except Stopped as error:
                if error.partial is None or error.partial.traced is None:
                    raise
                results.append(error.partial)
                stopped = error
    results[0].animate(path, results[1] if beside is not None else None, title)
    events = " and ".join(f"{len(result.trace):,}" for result in results)
    print_note(f"written to {path}: {events} events; open it in a browser")
    if stopped is not None:
        raise stopped
