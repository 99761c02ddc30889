"""`ss2sql sql`: shows the stages of a script's compilation."""

from __future__ import annotations

from typing import Any

import click

from ss2sql.cli.output import exit_with_code_on_error, print_line
from ss2sql.cli.script_options import ScriptInputs, add_script_options

STAGES = ("ast", "plan", "sql")


def _check_dialect(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    if value is None:
        return None
    from ss2sql.lowering.sql_builder import DIALECTS

    if value not in DIALECTS:
        raise click.BadParameter(f"there is no dialect '{value}'; SQL can be written in: {', '.join(DIALECTS)}")
    return value


def _complete_dialect(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    from ss2sql.lowering.sql_builder import DIALECTS

    return [name for name in DIALECTS if name.startswith(incomplete)]


@click.command("sql")
@add_script_options
@click.option("--stage", type=click.Choice(STAGES), default="sql", show_default=True,
              help="The syntax tree, the plan, or SQL.")  # fmt: skip
@click.option(
    "--dialect",
    callback=_check_dialect,
    shell_complete=_complete_dialect,
    metavar="NAME",
    help="The dialect of the SQL.  [default: sqlite]",
)
@exit_with_code_on_error
def command(inputs: ScriptInputs, stage: str, dialect: str | None) -> None:
    """Shows what a script becomes: its syntax tree, its plan, or the SQL that runs."""
    source = inputs.script
    if dialect is not None and stage != "sql":
        raise click.UsageError("--dialect goes with --stage sql", click.get_current_context())
    if stage == "ast":
        from ss2sql.frontend.syntax.parser import parse
        from ss2sql.session.session import read_script_source

        for statement in parse(read_script_source(source)).statements:
            print_line(repr(statement))
        return
    from ss2sql.language.plan_traversal import format_plan
    from ss2sql.lowering.sql_builder import DIALECTS
    from ss2sql.session.translation import translate_script

    with inputs.open_session() as session:
        query = session.compile(source)
        if stage == "plan":
            print_line(format_plan(query.plan).rstrip())
        else:
            print_line(_format_sql_with_parameters(translate_script(query.statements(), DIALECTS[dialect or "sqlite"])))


def _format_sql_with_parameters(sql: Any) -> str:
    """The SQL with the values of its parameters as comments."""
    lines = [f"-- :{name} = {value!r}" for name, value in sql.parameters.items()]
    return "\n".join([str(sql), *lines])
