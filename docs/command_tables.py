"""The commands of the command line with their options, as click knows them."""

from __future__ import annotations

import click
from writing import first, sentence, table

from ss2sql.cli import COMMANDS, main


def commands() -> str:
    """Every command with its arguments and options, those that many commands have in a section of their own."""
    known = {name: _options_of(name) for name in COMMANDS}
    everywhere = [row for row in known["run"] if sum(row in rows for rows in known.values()) > 2]
    parts = []
    for name, rows in known.items():
        parts.append(_heading(name))
        own = [row for row in rows if row not in everywhere]
        if own:
            parts.append(table("option | effect", own))
        common = ", ".join(f"`{_long(row[0])}`" for row in rows if row in everywhere)
        if common:
            parts.append(f"Also {common}: see [below](#options-of-many-commands).")
    parts.append(f"## Options of many commands\n\n{table('option | effect', everywhere)}")
    return "\n\n".join(parts)


def _heading(name: str) -> str:
    command = main.get_command(click.Context(main), name)
    assert command is not None
    usage = " ".join(command.collect_usage_pieces(click.Context(command, info_name=name)))
    return f"## `ss2sql {name}`\n\n{sentence(first(command.help or ''))}\n\n```none\nss2sql {name} {usage}\n```"


def _long(option: str) -> str:
    """`--execute` of `-e, --execute TEXT`."""
    return next(word for word in option.strip("`").split() if word.startswith("--"))


def _options_of(name: str) -> list[tuple[str, str]]:
    command = main.get_command(click.Context(main), name)
    assert command is not None
    found = []
    for option in command.params:
        if isinstance(option, click.Option) and not option.hidden:
            record = option.get_help_record(click.Context(command))
            if record is not None:
                found.append((f"`{' '.join(record[0].split())}`", " ".join(record[1].split())))
    return found
