"""`ss2sql sql`: shows what a script becomes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ss2sql.cli.endings import reports_errors
from ss2sql.cli.given import script, script_options, session_for
from ss2sql.cli.output import echo
from ss2sql.frontend.parser import parse
from ss2sql.plan_tree import plan_tree
from ss2sql.runtime.session import source_of


@click.command("sql")
@script_options
@click.option("--stage", type=click.Choice(["ast", "plan", "sql"]), default="sql", show_default=True)
@reports_errors
def command(
    file: str | None,
    text: str | None,
    function_files: tuple[Path, ...],
    worlds: tuple[str, ...],
    database: str | None,
    parameters: tuple[tuple[str, str], ...],
    stage: str,
) -> None:
    """Shows what a script becomes: its syntax tree, its plan, or the SQL that runs."""
    source = script(file, text)
    if stage == "ast":
        for statement in parse(source_of(source)).statements:
            echo(repr(statement))
        return
    with session_for(function_files, worlds, database, parameters) as session:
        query = session.compile(source)
        echo(plan_tree(query.plan).rstrip() if stage == "plan" else _sql_text(query.sql))


def _sql_text(sql: Any) -> str:
    """The SQL with the values of its parameters as comments."""
    lines = [f"-- :{name} = {value!r}" for name, value in sql.parameters.items()]
    return "\n".join([str(sql), *lines])
