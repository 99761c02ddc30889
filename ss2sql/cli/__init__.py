"""The command line: commands are imported when they are run.

Results go to stdout, everything else to stderr. Exit codes: 0 for success, 1 for an error of the script, 2 for wrong
usage, 124 for a timeout, 130 for Ctrl-C. script_options says which script is meant and makes the session for it, output
prints results, and errors with their exit codes.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NoReturn

import click

# The line of each command in `ss2sql --help`, where importing the commands would take half a second. A test compares
# the lines with those of the commands.
COMMANDS = {
    "run": "Runs a script: FILE, - for standard input, or -e TEXT.",
    "sql": "Shows what a script becomes: its syntax tree, its plan, or the SQL that runs.",
    "explain": "Tells how a script is run: engines, rewrites, calls, SQLite's plan in words, the SQL.",
    "repl": "Runs statements as they are typed. Without a terminal it reads them from standard input.",
    "plot": "Runs a script and draws its result as a picture.",
    "play": "Runs a script and writes a page that plays its search, to be opened in a browser.",
    "bench": "Races engines and search strategies on a script, and compares their answers.",
    "list": "Lists functions, representations, strategies, worlds, errors, rewrites.",
    "completion": "Prints what makes bash, zsh or fish complete commands of ss2sql.",
}
MODULES = {
    "repl": "ss2sql.shell.shell",
    "bench": "ss2sql.cli.bench_command",
    "list": "ss2sql.cli.list_command",
    "completion": "ss2sql.cli.list_command",
}


class Commands(click.Group):
    """A group whose commands are imported on demand; each is `NAME_command` in its module."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = import_module(MODULES.get(cmd_name, "ss2sql.cli.script_commands"))
        command: click.Command = getattr(module, f"{cmd_name}_command")
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name not in COMMANDS and not ctx.resilient_parsing and not name.startswith("-"):
            from difflib import get_close_matches

            close = get_close_matches(name, COMMANDS, n=1)
            hint = f"Did you mean '{close[0]}'?" if close else f"The commands are {', '.join(COMMANDS)}."
            ctx.fail(f"No such command '{name}'. {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """The names of commands, without importing them."""
        from click.shell_completion import CompletionItem

        if not incomplete.startswith("-"):
            return [CompletionItem(name, help=t) for name, t in COMMANDS.items() if name.startswith(incomplete)]
        return click.Command.shell_complete(self, ctx, incomplete)

    def main(self, args: Sequence[str] | None = None, *others: Any, **named: Any) -> Any:
        """Runs a command line and ends the process, with the exit codes and the messages of `exit_codes`."""
        arguments = list(sys.argv[1:] if args is None else args)
        _open_standard_streams()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # what an encoding lacks is written as an escape
        try:
            try:
                self._run_command(arguments, *others, **named)
            finally:
                sys.stdout.flush()  # at the end of the process errors could not be reported
        except OSError as error:
            from ss2sql.cli import output

            output.end_with_output_error(error, arguments)

    def _run_command(self, arguments: list[str], *others: Any, **named: Any) -> NoReturn:
        try:
            code = super().main(arguments, *others, **{**named, "standalone_mode": False})
        except (click.Abort, click.ClickException) as error:
            from ss2sql.cli import output

            if isinstance(error, click.ClickException):
                output.end_with_usage_error(error, arguments)
            output.exit_after_interrupt()
        sys.exit(code if isinstance(code, int) else 0)


def _open_standard_streams() -> None:
    """Replaces each standard stream that is closed, by `<&-` or `>&-`.

    Reading from it and writing to it fails, as with any broken stream, and no file that is opened later gets its
    number. Messages for a closed stderr are discarded.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            nothing = os.open(os.devnull, os.O_RDONLY if number == 1 else os.O_WRONLY)
            if nothing != number:
                os.dup2(nothing, number)
                os.close(nothing)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.command("ss2sql", cls=Commands, context_settings=SETTINGS)
@click.version_option(package_name="ss2sql")
def main() -> None:
    """SelectScript, the SQL-like language for simulations and searches, compiled to SQLite.

    "ss2sql COMMAND --help" tells the options of a command.
    """
