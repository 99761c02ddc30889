"""`ss2sql bench`: times engines and search strategies on a script, and compares their answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ss2sql.cli.output import (
    SCRIPT,
    check_output_folder,
    end_with_message,
    exit_with_code_on_error,
    make_output_console,
    mark_user_errors,
    print_line,
    print_note,
    report_unwritable,
)
from ss2sql.cli.script_options import ScriptInputs, add_script_options
from ss2sql.errors import Error

if TYPE_CHECKING:
    from ss2sql.bench import StatementRuns

ALL = "all"
ENGINES = {"all": ("database", "native"), "database": ("database",), "native": ("native",)}


def _read_strategy(text: str) -> str:
    """Options of CONNECT BY, or `all`. Raises click.BadParameter."""
    if text.lower() == ALL:
        return ALL
    from ss2sql.bench import parse_strategy

    try:
        parse_strategy(text, ())
    except Error as error:
        raise click.BadParameter(f"{text!r}: {error.message}") from error
    return text


@click.command("bench")
@add_script_options
@click.option("--engine", type=click.Choice(list(ENGINES)), default="all", show_default=True)
@click.option(
    "--strategy",
    "strategies",
    multiple=True,
    default=(ALL,),
    show_default=True,
    metavar="OPTIONS",
    type=_read_strategy,
    help="Options of CONNECT BY in place of the script's: 'UNIQUE', 'COST km'. As often as you like.",
)
@click.option("--repeat", type=click.IntRange(min=1), default=5, show_default=True, help="Runs after a first one.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=10.0,
    show_default=True,
    help="Seconds after which one strategy on one engine is broken off.",
)
@click.option("--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="A file for all figures.")
@exit_with_code_on_error
def bench_command(
    inputs: ScriptInputs,
    engine: str,
    strategies: tuple[str, ...],
    repeat: int,
    timeout: float,
    json_file: Path | None,
) -> None:
    """Races engines and search strategies on a script, and compares their answers."""
    from ss2sql.bench import BenchRules, collect_race_report, make_runs, print_runs
    from ss2sql.session.session import read_script_source

    source = inputs.script
    if json_file is not None:
        check_output_folder(json_file)
    settings = BenchRules(ENGINES[engine], strategies, repeat, timeout)  # type: ignore[arg-type]
    run: list[StatementRuns] = []
    with inputs.open_session(progress=False) as session:
        following = make_runs(session, read_script_source(source), settings)
        while True:
            with mark_user_errors():
                runs = next(following, None)
            if runs is None:
                break
            if run:
                print_line("")
            try:
                with mark_user_errors():
                    runs.run_strategies()
            finally:  # also after an interruption
                if runs.cells:
                    print_runs(runs, make_output_console())
            run.append(runs)
    if json_file is not None:
        figures = json.dumps(collect_race_report(run, settings), indent=2, default=repr)
        with report_unwritable(json_file):
            json_file.write_text(f"{figures}\n", encoding="utf-8")
        print_note(f"written to {json_file}")
    _exit_on_contradictions(run)


def _exit_on_contradictions(run: Sequence[StatementRuns]) -> None:
    """Ends with exit code 1 where answers differ although the language forbids it."""
    wrong = [(runs.tree.span, result) for runs in run for result in runs.forbidden]
    if wrong:
        lines = [f"{place.place}: {result.name}: {result.answer}" for place, result in wrong]
        lines.append("The language forbids these answers. Please report them, with the script.")
        found = [{"place": place.place, "cell": result.name, "answer": result.answer} for place, result in wrong]
        end_with_message(
            "\n".join(lines), {"code": None, "title": "forbidden answers", "message": lines[-1], "found": found}, SCRIPT
        )
