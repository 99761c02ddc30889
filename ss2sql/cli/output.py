"""Results on stdout, or in a file."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from ss2sql.cli.exit_codes import print_note, wants_color
from ss2sql.errors import SessionError
from ss2sql.errors.renderer import escape_controls
from ss2sql.fast_dataclasses import dataclass

if TYPE_CHECKING:
    from rich.console import Console

    from ss2sql.results.result import Result

    _OfRows = click.ParamType[int]
else:
    _OfRows = click.ParamType  # which takes no parameter before click 8.4

F = TypeVar("F", bound=Callable[..., Any])

FORMATS = ("table", "json", "csv", "arrow", "parquet")
BINARY = ("arrow", "parquet")
# The format of a file by the end of its name. `.arrow` is a file of Arrow, `.arrows` a stream of it.
FILE_ENDINGS = {
    ".txt": "table", ".json": "json", ".csv": "csv", ".arrow": "arrow", ".feather": "arrow", ".arrows": "arrow",
    ".parquet": "parquet",
}  # fmt: skip
SHOWN = 20  # rows of a table
FILE_WIDE = 120  # characters of a table in a file


class Count(_OfRows):
    """A number of rows, or `all`."""

    name = "rows"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        if str(value).lower() == "all":
            return sys.maxsize
        try:
            number = int(value)
        except ValueError:
            number = -1
        if number < 0:
            self.fail(f"{value!r} is neither a number of rows nor 'all'.", param, ctx)
        return number


def add_output_options(command: F) -> F:
    """Adds the options that say how a result is printed."""
    options = (
        click.option("--format", "form", type=click.Choice(FORMATS),
                     help="How the result is printed.  [default: table]"),
        click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path),
                     help="A file for the result; the end of its name says the format: .csv, .json, .parquet ..."),
        click.option("--show", "shown", type=Count(), default=SHOWN, show_default=True, metavar="N|all",
                     help="So many rows or paths of a table are shown."),
    )  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


@dataclass(frozen=True, slots=True)
class Output:
    """The destination and the format of results."""

    form: str
    path: Path | None
    shown: int

    def write_result(self, result: Result) -> None:
        """Prints a result, or writes the file and says so."""
        if self.path is None:
            _print_result(result, self.form, self.shown)
            return
        try:
            _write_file(result, self.form, self.path, self.shown)
        except OSError as error:
            raise make_write_error(self.path, error) from error
        print_note(f"written to {self.path}: {describe_size(result)}")


def make_output(form: str | None, path: Path | None, shown: int = SHOWN) -> Output:
    """The output that the options request, checked before anything runs."""
    if path is not None:
        check_folder(path)
    if form is None:
        if path is not None and path.suffix.lower() not in FILE_ENDINGS:
            suffixes = ", ".join(FILE_ENDINGS)
            _refuse_usage(
                f"{path} does not say which format it is to have: name it with --format, or end it in {suffixes}"
            )
        form = "table" if path is None else FILE_ENDINGS[path.suffix.lower()]
    if form == "table":
        import rich.console
        import rich.table  # noqa: F401 - 0.1 s that nobody should wait for after Ctrl-C
    if form in BINARY:
        from ss2sql.results import require_package

        if path is None and sys.stdout.isatty():
            _refuse_usage(
                f"{form} is not for terminals: write it to a file, --output FILE.{form}, or on into another program"
            )
        require_package("pyarrow", "df", f"--format {form}")  # raises before the script runs
    return Output(form, path, shown)


def _refuse_usage(message: str) -> NoReturn:
    raise click.UsageError(message, click.get_current_context(silent=True))


def check_folder(path: Path) -> None:
    """Raises SessionError S002 for a file that cannot be written."""
    if not path.parent.is_dir():
        raise SessionError("S002", f"{path} cannot be written: there is no folder {path.parent}")


def make_write_error(path: Path, error: OSError) -> SessionError:
    return SessionError("S002", f"{path} cannot be written: {error.strerror or error}")


def describe_size(result: Result) -> str:
    """The numbers of rows and paths of a result."""
    rows = f"{len(result):,} row{'' if len(result) == 1 else 's'}"
    if result.answer is None or result.answer.rows.paths is None:
        return rows
    paths = len(result.answer.rows.paths)
    return f"{paths:,} path{'' if paths == 1 else 's'}, {rows}"


def print_line(text: str) -> None:
    """Prints a line of a result."""
    click.echo(escape_controls(text))


def make_console() -> Console:
    """The console for tables on stdout, with colors where these are wanted."""
    from rich.console import Console

    if not wants_color(sys.stdout):
        return Console(color_system=None)
    return Console(force_terminal=True, color_system="auto" if sys.stdout.isatty() else "standard")


def _print_result(result: Result, form: str, shown: int) -> None:
    if form == "table":
        _print_table(result, shown, make_console())
        return
    sys.stdout.flush()
    left = memoryview(_encode_result(result, form, stream=True))
    while left:  # a stream without a buffer, as under PYTHONUNBUFFERED, may take a part only
        left = left[sys.stdout.buffer.write(left) :]
    sys.stdout.buffer.flush()


def _print_table(result: Result, shown: int, target: Console) -> None:
    """Prints a table, or the value of a script that does not end with a query."""
    if result.answer is None:
        target.file.write(escape_controls(f"{result.value}\n"))
    else:
        from ss2sql.results.show import print_result

        print_result(result, shown, target, noted=False)  # notes go to stderr


def _encode_result(result: Result, form: str, stream: bool) -> bytes:
    """Writes a result in a data format for other programs, always in UTF-8."""
    if form == "json":
        return _encode_for_stdout(f"{result.json()}\n")
    if form == "csv":
        return _encode_for_stdout(str(result.csv()))
    from ss2sql.results import require_package

    file = io.BytesIO()
    if form == "parquet":
        require_package("pyarrow.parquet", "df", "--format parquet").write_table(result.arrow(), file)
    else:
        table = result.arrow()
        ipc = require_package("pyarrow.ipc", "df", "--format arrow")
        make = ipc.new_stream if stream else ipc.new_file
        with make(file, table.schema) as writer:
            writer.write_table(table)
    return file.getvalue()


def _encode_for_stdout(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


def _write_file(result: Result, form: str, path: Path, shown: int) -> None:
    if form != "table":
        path.write_bytes(_encode_result(result, form, stream=path.suffix.lower() == ".arrows"))
        return
    from rich.console import Console

    with path.open("w", encoding="utf-8", errors="backslashreplace") as file, redirect_stdout(file):
        _print_table(result, shown, Console(file=file, width=FILE_WIDE, color_system=None))
