"""The command line, one module per command, imported when the command is run.

Results go to stdout, everything else to stderr. Exit codes: 0 for success, 1 for an error of the script, 2 for wrong
usage, 124 for a timeout, 130 for Ctrl-C. `given` has the options that say which script is meant and makes the session
for it, `endings` turns errors into messages and exit codes, `output` prints results.
"""

from __future__ import annotations

from importlib import import_module

import click

# One row per command: its name, its module, and what `ss2sql --help` says of it without importing the module, which
# would take half a second. A test compares the texts with those of the commands.
COMMANDS = {
    "run": ("ss2sql.cli.run", "Runs a script: FILE, - for standard input, or -e TEXT."),
    "sql": ("ss2sql.cli.sql", "Shows what a script becomes: its syntax tree, its plan, or the SQL that runs."),
}


class Commands(click.Group):
    """A group whose commands are imported when they are asked for; each module has one, `command`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(COMMANDS[cmd_name][0]).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="ss2sql")
def main() -> None:
    """SelectScript, the SQL-like language for simulations and searches, compiled to SQLite."""
