"""`ss2sql repl`: the shell."""

from __future__ import annotations

import sys
from typing import Any

import click

from ss2sql.cli.output import CTRL_C, SCRIPT, SHOWN, Count, exit_with_code_on_error
from ss2sql.cli.run_command import add_run_options
from ss2sql.cli.script_options import ScriptInputs, add_session_options


@click.command("repl")
@add_session_options
@add_run_options
@click.option(
    "--format",
    "form",
    type=click.Choice(["table", "json", "csv"]),
    default="table",
    show_default=True,
    help="How results are printed.",
)
@click.option(
    "--show",
    type=Count(),
    default=SHOWN,
    show_default=True,
    metavar="N|all",
    help="So many rows or paths of a table are shown.",
)
@click.option("--history/--no-history", default=True, help="Whether what is typed is remembered for the next time.")
@exit_with_code_on_error
def command(inputs: ScriptInputs, progress: bool | None, form: str, history: bool, **options: Any) -> None:
    """Runs statements as they are typed. Without a terminal it reads them from standard input."""
    typed = sys.stdin.isatty()
    if typed:
        from ss2sql.results import require_package

        require_package("prompt_toolkit", "repl", "the shell")
    from ss2sql.shell.dot_commands import Settings
    from ss2sql.shell.shell import Shell

    with inputs.open_session(progress) as session:
        shell = Shell(session, Settings(format=form, **options))
        if typed:
            from ss2sql.shell.terminal import Terminal

            Terminal(shell, history).run_until_exit()
            return
        from ss2sql.shell.shell import run_piped

        run_piped(shell, sys.stdin.buffer)
    if shell.failed:
        sys.exit(CTRL_C if shell.cancelled else SCRIPT)
