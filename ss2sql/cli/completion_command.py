"""`ss2sql completion`: prints the script that makes a shell complete commands of ss2sql."""

from __future__ import annotations

import click

from ss2sql.cli.output import exit_with_code_on_error, print_line

SHELLS = ("bash", "zsh", "fish")


@click.command("completion", epilog='For bash, put this line into ~/.bashrc: eval "$(ss2sql completion bash)"')
@click.argument("shell", type=click.Choice(SHELLS))
@exit_with_code_on_error
def completion_command(shell: str) -> None:
    """Prints what makes bash, zsh or fish complete commands of ss2sql."""
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    print_line(kind(click.get_current_context().find_root().command, {}, "ss2sql", "_SS2SQL_COMPLETE").source())
