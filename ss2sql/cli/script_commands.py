"""The commands that run or show a script: `ss2sql run`, `explain`, `plot`, `play` and `sql`."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from functools import partial
from itertools import accumulate, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ss2sql.cli.output import (
    add_options,
    add_output_options,
    check_output_folder,
    describe_output_size,
    exit_with_code_on_error,
    make_output,
    mark_user_errors,
    print_line,
    print_note,
    report_unwritable,
    writes_json,
)
from ss2sql.cli.script_options import ScriptInputs, add_script_options, redirect_output
from ss2sql.errors import Source, Stopped, WorkersWarning, require_package
from ss2sql.language.plan import Representation
from ss2sql.language.plan_traversal import format_plan
from ss2sql.results.watching.search_trace import MOST_EVENTS
from ss2sql.runtime.run.search_paths import measure_path_lengths

if TYPE_CHECKING:
    from ss2sql.results.explain.explanation import Explanation
    from ss2sql.results.result import Result
    from ss2sql.session.session import Session


ENGINES = ("auto", "database", "native", "duckdb", "spark")
MOST_BROKEN_OFF = 1_000_000  # rows of a partial result: the search may have been endless

add_run_options = add_options(  # `run_script` takes their values
    click.option("--engine", type=click.Choice(ENGINES), default="auto", show_default=True, help="Where queries run."),
    click.option("--timeout", type=click.FloatRange(min=0), help="Seconds after which the run is broken off."),
    click.option("--maximum", type=click.IntRange(min=1), help="At most so many results of the last search."),
    click.option("--max-rows", type=click.IntRange(min=0), help="More results than that are an error."),
    click.option("--workers", type=click.IntRange(min=1), default=1, help="Processes for calls that MEMORIZE makes."),
    click.option("--progress/--no-progress", default=None,
                 help="Whether a long run says how far it is; else it does on a terminal."),
)  # fmt: skip


@click.command("run")
@add_script_options
@add_run_options
@add_output_options
@exit_with_code_on_error
def run_command(
    inputs: ScriptInputs, progress: bool | None, form: str | None, output: Path | None, shown: int, **options: Any
) -> None:
    """Runs a script: FILE, - for standard input, or -e TEXT."""
    source = inputs.script
    wanted = make_output(form, output, shown)
    with inputs.open_session(progress) as session:
        result, stopped = run_partly(session, source, **options)
        wanted.write_result(build_partial_output(session, result) if stopped and wanted.form != "table" else result)
        if stopped is not None:
            raise stopped


def run_script(session: Session, source: str | Path | Source, **options: Any) -> Result:
    """Runs a script with the options of `add_run_options`; what it prints goes to stderr."""
    with mark_user_errors(), redirect_output(), warnings.catch_warnings():  # the script's own output is no result
        warnings.simplefilter("ignore", WorkersWarning)  # printed below, without a place in Python code
        result = session.run(source, **options)
    for text in result.stats.notes:
        if text.startswith("workers: "):
            print_note(text)
    for text in result.notes:
        print_note(text if writes_json() else f"note: {text}")
    return result


def run_partly(session: Session, source: str | Path | Source, **options: Any) -> tuple[Result, Stopped | None]:
    """The result of a script; of a run that ended early the partial one, and the error, which is raised in the end."""
    try:
        return run_script(session, source, **options), None
    except Stopped as stopped:
        if stopped.partial is None:
            raise
        return stopped.partial, stopped


def build_partial_output(session: Session, found: Result) -> Result:
    """A partial result with the value that AS makes of it, limited in size.

    A representation that may fail, or that needs more than the rows, is replaced by the language's default.
    """
    from ss2sql.runtime.representations.shape import PATH_FORMS

    assert found.answer is not None
    answer, shapes = found.answer, session.host.shapes
    rows = replace(answer.rows, hidden=0)
    if rows.paths is not None:
        ends = accumulate(measure_path_lengths(rows.paths))
        most = sum(1 for _ in takewhile(lambda end: end <= MOST_BROKEN_OFF, ends))
        if most < len(rows.paths):
            print_note(f"the first {most:,} of {len(rows.paths):,} paths:")
            rows.paths = rows.paths[:most]
    form = answer.form
    if form is None or form.name not in PATH_FORMS or form.arguments or form.named or not shapes.is_built_in(form):
        form = Representation("dict")
    return replace(found, answer=replace(answer, rows=rows, make=partial(shapes.represent_rows, form, rows, (), {})))


# --- `ss2sql explain`: explains how a script is run, and with --analyze what a run of it did
EXPLAIN_FORMATS = ("text", "json")


@click.command("explain")
@add_script_options
@click.option("--analyze", is_flag=True, help="Run it, and tell what the run has done.")
@click.option("--format", "form", type=click.Choice(EXPLAIN_FORMATS), default="text", show_default=True,
              help="For people, or for programs.")  # fmt: skip
@add_run_options
@exit_with_code_on_error
def explain_command(inputs: ScriptInputs, analyze: bool, form: str, progress: bool | None, **options: Any) -> None:
    """Tells how a script is run: engines, rewrites, calls, SQLite's plan in words, the SQL."""
    source = inputs.script
    with inputs.open_session(progress) as session:
        if not analyze:
            with redirect_output():
                found = session.compile(source, options["engine"]).explain()
            _print_explanation(found, form)
            return
        result, stopped = run_partly(session, source, **options)
        if stopped is None:
            result.value  # noqa: B018 - the time that AS takes is to be told, too
        _print_explanation(result.explain(), form)
        if stopped is not None:
            raise stopped


def _print_explanation(found: Explanation, form: str) -> None:
    print_line(json.dumps(found.as_dict(), indent=2, ensure_ascii=False) if form == "json" else found)


# --- `ss2sql plot`: runs a script and draws its result
# Those of Result.plot.
KINDS = ("auto", "paths", "graph", "tree", "lengths", "search", "heat", "bars", "line", "points")
PICTURES = (".png", ".svg", ".pdf")


def _check_picture_path(context: click.Context, parameter: click.Parameter, value: Path) -> Path:
    if value.suffix.lower() not in PICTURES:
        raise click.BadParameter(f"{value} does not say what picture it is to be: end it in {', '.join(PICTURES)}")
    return value


@click.command("plot")
@add_script_options
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False, path_type=Path),
    callback=_check_picture_path,
              help="The file for the picture; it ends in .png, .svg or .pdf.")  # fmt: skip
@click.option("--kind", type=click.Choice(KINDS), default="auto", show_default=True, help="What is drawn.")
@click.option("--title", help="The title; else what was counted.")
@click.option("--most", type=click.IntRange(min=1), help="At most so many paths or bars.")
@add_run_options
@exit_with_code_on_error
def plot_command(
    inputs: ScriptInputs,
    progress: bool | None,
    output: Path,
    kind: str,
    title: str | None,
    most: int | None,
    **options: Any,
) -> None:
    """Runs a script and draws its result as a picture."""
    source = inputs.script
    check_output_folder(output)
    require_package("matplotlib", "plot", "plot").use("agg")  # no window, and no screen needed
    if kind == "search":
        options["trace"] = MOST_EVENTS
    with inputs.open_session(progress) as session:
        result, stopped = run_partly(session, source, **options)
        if stopped is not None and not (len(result) or result.traced):
            raise stopped
        figure = result.plot(kind=kind, title=title, most=most).figure
        with report_unwritable(output):
            figure.savefig(output)
    print_note(f"written to {output}: {describe_output_size(result)}")
    if stopped is not None:
        raise stopped


# --- `ss2sql play`: runs a script and writes a page that plays its search
@click.command("play")
@add_script_options
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path),
              help="The file for the page; else FILE with the ending .html, or search.html.")  # fmt: skip
@click.option("--beside", metavar="FILE", help="A second script, shown beside the first; with -e its text.")
@click.option("--trace", type=click.IntRange(min=1), default=MOST_EVENTS, show_default=True,
              help="The first so many events.")  # fmt: skip
@click.option("--title", help="The title; else the names of the strategies.")
@add_run_options
@exit_with_code_on_error
def play_command(
    inputs: ScriptInputs,
    progress: bool | None,
    output: Path | None,
    beside: str | None,
    title: str | None,
    **options: Any,
) -> None:
    """Runs a script and writes a page that plays its search, to be opened in a browser."""
    sources = [inputs.script]
    if beside is not None:
        sources.append(beside if inputs.texts else Path(beside))
    path = output or (Path(inputs.file).with_suffix(".html") if inputs.file not in (None, "-") else Path("search.html"))
    check_output_folder(path)
    stopped: Stopped | None = None
    results = []
    with inputs.open_session(progress) as session:
        for source in sources:
            result, ended = run_partly(session, source, **options)
            if ended is not None and result.traced is None:
                raise ended
            results.append(result)
            stopped = ended or stopped
    results[0].animate(path, results[1] if beside is not None else None, title)
    events = " and ".join(f"{len(result.trace):,}" for result in results)
    print_note(f"written to {path}: {events} events; open it in a browser")
    if stopped is not None:
        raise stopped


# --- `ss2sql sql`: shows the stages of a script's compilation
STAGES = ("ast", "plan", "sql")
DIALECTS = ("sqlite", "duckdb", "spark", "postgres")  # those of lowering/sql_builder.py, which loads sqlglot


@click.command("sql")
@add_script_options
@click.option("--stage", type=click.Choice(STAGES), default="sql", show_default=True,
              help="The syntax tree, the plan, or SQL.")  # fmt: skip
@click.option("--dialect", type=click.Choice(DIALECTS), help="The dialect of the SQL.  [default: sqlite]")
@exit_with_code_on_error
def sql_command(inputs: ScriptInputs, stage: str, dialect: str | None) -> None:
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
    from ss2sql.lowering import sql_builder
    from ss2sql.session.compiled_script import translate_script

    with inputs.open_session() as session:
        query = session.compile(source)
        if stage == "plan":
            print_line(format_plan(query.plan).rstrip())
        else:
            written = translate_script(query.statements(), sql_builder.DIALECTS[dialect or "sqlite"])
            print_line(format_sql_with_parameters(written))


def format_sql_with_parameters(sql: Any) -> str:
    """The SQL with the values of its parameters as comments."""
    lines = [f"-- :{name} = {value!r}" for name, value in sql.parameters.items()]
    return "\n".join([str(sql), *lines])
