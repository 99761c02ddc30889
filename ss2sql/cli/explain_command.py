"""`ss2sql explain`: explains how a script is run, and with --analyze what a run of it did."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ss2sql.cli.output import exit_with_code_on_error, print_line
from ss2sql.cli.run_command import add_run_options, run_script
from ss2sql.cli.script_options import ScriptInputs, add_script_options, redirect_output
from ss2sql.errors import Stopped

if TYPE_CHECKING:
    from ss2sql.results.explain.explanation import Explanation

FORMATS = ("text", "json")


@click.command("explain")
@add_script_options
@click.option("--analyze", is_flag=True, help="Run it, and tell what the run has done.")
@click.option("--format", "form", type=click.Choice(FORMATS), default="text", show_default=True,
              help="For people, or for programs.")  # fmt: skip
@add_run_options
@exit_with_code_on_error
def command(inputs: ScriptInputs, analyze: bool, form: str, progress: bool | None, **options: Any) -> None:
    """Tells how a script is run: engines, rewrites, calls, SQLite's plan in words, the SQL."""
    source = inputs.script
    if not analyze:
        _refuse_options_of_runs()
    with inputs.open_session(progress) as session:
        if not analyze:
            with redirect_output():
                found = session.compile(source, options["engine"]).explain()
            _print_explanation(found, form)
            return
        try:
            result = run_script(session, source, **options)
        except Stopped as stopped:
            if stopped.partial is not None:
                _print_explanation(stopped.partial.explain(), form)
            raise
        result.value  # noqa: B018 - the time that AS takes is to be told, too
        with redirect_output():  # functions may print when they are called again
            found = result.explain(levels=True)
        _print_explanation(found, form)


def _refuse_options_of_runs() -> None:
    context = click.get_current_context()
    for name in ("timeout", "maximum", "max_rows", "workers", "progress"):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name.replace('_', '-')} is about a run: give --analyze, too", context)


def _print_explanation(found: Explanation, form: str) -> None:
    print_line(json.dumps(found.as_dict(), indent=2, ensure_ascii=False) if form == "json" else found)
