"""`ss2sql bench`: times engines and search strategies on a script, and compares their answers."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ss2sql.cli.endings import SCRIPT, UserError, end, note, reports_errors
from ss2sql.cli.given import Given, script_options
from ss2sql.cli.output import check_folder, console, echo, not_written
from ss2sql.errors import Error

if TYPE_CHECKING:
    from ss2sql.race import Heat, Rules

ALL = "all"
ENGINES = {"all": ("database", "native"), "database": ("database",), "native": ("native",)}


def _checked_strategies(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    for text in value:
        if text.lower() != ALL:
            from ss2sql.race import strategy_of

            try:
                strategy_of(text, ())
            except Error as error:
                raise click.BadParameter(f"{text!r}: {error.message}") from error
    return tuple(ALL if text.lower() == ALL else text for text in value)


@click.command("bench")
@script_options
@click.option("--engine", type=click.Choice(list(ENGINES)), default="all", show_default=True)
@click.option(
    "--strategy",
    "strategies",
    multiple=True,
    default=(ALL,),
    show_default=True,
    metavar="OPTIONS",
    callback=_checked_strategies,
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
@click.option("--memory", is_flag=True, help="Also measures memory, in one more, slower run.")
@click.option("--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="A file for all figures.")
@click.option("-o", "--plot", "plot_file", type=click.Path(dir_okay=False, path_type=Path),
              help="A picture of the times, PNG, SVG or PDF by its name.")  # fmt: skip
@reports_errors
def command(
    given: Given,
    engine: str,
    strategies: tuple[str, ...],
    repeat: int,
    timeout: float,
    memory: bool,
    json_file: Path | None,
    plot_file: Path | None,
) -> None:
    """Races engines and search strategies on a script, and compares their answers."""
    from ss2sql.race import Rules, heats
    from ss2sql.runtime.session import source_of

    source = given.script
    for path in (json_file, plot_file):
        if path is not None:
            check_folder(path)
    rules = Rules(ENGINES[engine], strategies, repeat, timeout, memory)  # type: ignore[arg-type]
    run: list[Heat] = []
    with given.session(progress=False) as session:
        following = heats(session, source_of(source), rules)
        while True:
            with _of_the_user():
                heat = next(following, None)
            if heat is None:
                break
            if run:
                echo("")
            with _shown(heat, rules), _of_the_user():
                _watch(heat)
            run.append(heat)
    _write(run, rules, json_file, plot_file)
    _complain(run)


@contextmanager
def _of_the_user() -> Iterator[None]:
    """Marks exceptions in the block that are no errors of ours as the user's."""
    try:
        yield
    except (Error, UserError):
        raise
    except Exception as error:
        raise UserError(error) from None


@contextmanager
def _shown(heat: Heat, rules: Rules) -> Iterator[None]:
    """Prints the table of a statement at the end, also after an interruption."""
    from ss2sql.race import show

    try:
        yield
    finally:
        if heat.cells:
            show(heat, rules, console())


def _watch(heat: Heat) -> None:
    """Runs a statement; on a terminal a line shows the running strategy."""
    told = 0
    try:
        for cell in heat.run():
            if sys.stderr.isatty():
                line = f"{cell.strategy}, {cell.engine}"[:70]
                click.echo(f"\r{line.ljust(told)}", nl=False, err=True)
                told = len(line)
    finally:
        if told:
            click.echo(f"\r{' ' * told}\r", nl=False, err=True)


def _write(run: Sequence[Heat], rules: Rules, json_file: Path | None, plot_file: Path | None) -> None:
    """Writes the requested files."""
    from ss2sql.race import draw, outcome

    for path in (json_file, plot_file):
        if path is None:
            continue
        try:
            if path is json_file:
                path.write_text(json.dumps(outcome(run, rules), indent=2, default=repr) + "\n", encoding="utf-8")
            else:
                draw(run, path)
        except OSError as error:
            raise not_written(path, error) from error
        note(f"written to {path}")


def _complain(run: Sequence[Heat]) -> None:
    """Ends with exit code 1 where answers differ although the language forbids it."""
    wrong = [(heat.tree.span, cell) for heat in run for cell in heat.forbidden]
    if wrong:
        lines = [f"{place.place}: {cell.name}: {cell.answer}" for place, cell in wrong]
        lines.append("The language forbids these answers. Please report them, with the script.")
        found = [{"place": place.place, "cell": cell.name, "answer": cell.answer} for place, cell in wrong]
        end(
            "\n".join(lines), {"code": None, "title": "forbidden answers", "message": lines[-1], "found": found}, SCRIPT
        )
