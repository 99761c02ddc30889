"""What a command prints: results on stdout or in a file, errors on stderr, and exit codes."""

from __future__ import annotations

import io
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, TypeAlias, TypeVar

import click

from ss2sql.errors import Cancelled, Error, SessionError, Stopped, Timeout, render_all, require_package
from ss2sql.errors.exceptions import PLACE, escape_controls
from ss2sql.fast_dataclasses import dataclass

SCRIPT, USAGE, TIMEOUT, CTRL_C = 1, 2, 124, 130
F = TypeVar("F", bound=Callable[..., Any])
Option: TypeAlias = Callable[[Any], Any]  # a decorator of click
ERROR_FORMATS = ("text", "json")
AS_JSON = "ss2sql.errors as JSON"  # a key of the context's `meta`


def _store_format_option(context: click.Context, parameter: click.Parameter, value: str) -> None:
    context.meta[AS_JSON] = value == "json"


def _store_color_option(context: click.Context, parameter: click.Parameter, value: bool | None) -> None:
    context.color = value


def add_options(*options: Option) -> Callable[[F], F]:
    """A decorator that adds options to a command, in this order."""

    def add_all(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add_all


_add_common_options = add_options(
    click.option("--error-format", type=click.Choice(ERROR_FORMATS), default="text", show_default=True, is_eager=True,
                 expose_value=False, callback=_store_format_option,
                 help="Errors as text, or as JSON with one object on each line."),
    click.option("--color/--no-color", default=None, is_eager=True, expose_value=False, callback=_store_color_option,
                 help="Whether there are colors; else they are for terminals, unless NO_COLOR is set."),
)  # fmt: skip


def exit_with_code_on_error(command: F) -> F:
    """Prints errors to stderr and ends with their exit code.

    It also adds the options that all commands have, which are read here and in cli/output.py.
    """

    @wraps(command)
    def run_command(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt:
            exit_after_interrupt()
        except Error as error:
            _print_to_stderr(format_printed_error(error))
            sys.exit(TIMEOUT if isinstance(error, Timeout) else CTRL_C if isinstance(error, Cancelled) else SCRIPT)
        except UserError as error:
            end_with_message(str(error), error.as_dict(), SCRIPT)

    return _add_common_options(run_command)  # type: ignore[return-value]


class UserError(Exception):
    """An exception of the user's Python code as text, without the frames of ss2sql."""

    def __init__(self, error: Exception) -> None:
        shown = traceback.TracebackException.from_exception(error)
        _drop_own_frames(shown)
        super().__init__(escape_controls("".join(shown.format()).rstrip()))
        self.error = error
        self.frame = shown.stack[-1] if shown.stack else None

    def as_dict(self) -> dict[str, Any]:
        """The same keys as for errors of scripts, with the place in the user's file."""
        place = dict.fromkeys(PLACE) if self.frame is None else _locate_printed_error(self.frame)
        message = f"{type(self.error).__name__}: {self.error}"
        return _make_error_json("exception", message, place, notes=getattr(self.error, "__notes__", []))


def _drop_own_frames(shown: traceback.TracebackException) -> None:
    """Leaves out the frames of ss2sql, also those of the exceptions before this one."""
    own = (str(Path(__file__).parent.parent), "src/", "<frozen ")  # src/ is apsw
    shown.stack = traceback.StackSummary.from_list(f for f in shown.stack if not f.filename.startswith(own))
    for before in (shown.__cause__, shown.__context__):
        if before is not None:
            _drop_own_frames(before)


@contextmanager
def mark_user_errors() -> Iterator[None]:
    """Marks exceptions in the block that are no errors of ours as the user's."""
    try:
        yield
    except (Error, UserError):
        raise
    except Exception as error:
        raise UserError(error) from None


def _locate_printed_error(frame: traceback.FrameSummary) -> dict[str, Any]:
    columns = (frame.colno, frame.end_colno)
    column, end_column = (None if number is None else number + 1 for number in columns)
    line = frame.lineno
    return dict(zip(PLACE, (frame.filename, line, column, frame.end_lineno or line, end_column), strict=True))


def _make_error_json(title: str, message: str, place: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """Another error, with the same keys as for errors of scripts."""
    where = dict.fromkeys(PLACE) if place is None else place
    return {"code": None, "title": title, "message": message, **where, "hints": [], "related": [], **more}


def format_printed_error(error: Error) -> str:
    """An error as text, or as JSON with a line for each, with the size of the partial result of its run."""
    if writes_json():
        found = {"found": _measure_partial_output(error)} if isinstance(error, Stopped) else {}
        return "\n".join(json.dumps({**one.as_dict(), **found}, ensure_ascii=False) for one in error.errors)
    counted = _format_partial_output(error) if isinstance(error, Stopped) else ""
    if isinstance(error, Cancelled):
        return f"cancelled{counted}"
    return render_all(error, wants_color(sys.stderr)) + (f"\nbroken off{counted}" if counted else "")


def _measure_partial_output(stopped: Stopped) -> dict[str, int] | None:
    """The size of the partial result of a run that ended early; None where there is nothing to print."""
    if stopped.partial is None:
        return None
    paths = len(stopped.partial.answer.rows.paths or ())
    return {"paths": paths} if paths else {"rows": len(stopped.partial)}


def _format_partial_output(stopped: Stopped) -> str:
    found = _measure_partial_output(stopped)
    if found is None:
        return ""
    ((unit, number),) = found.items()
    return f"; {number:,} {unit[:-1] if number == 1 else unit} had been found" if number else "; nothing had been found"


def exit_after_interrupt() -> NoReturn:
    """Ends after Ctrl-C outside of a run."""
    end_with_message("cancelled", _make_error_json("cancelled", "cancelled"), CTRL_C)


def end_with_usage_error(error: click.ClickException, arguments: Sequence[str]) -> NoReturn:
    if not _wants_json(arguments):
        error.show()
    else:
        _print_to_stderr(json.dumps(_make_error_json("wrong usage", error.format_message()), ensure_ascii=False))
    sys.exit(error.exit_code)


def _wants_json(arguments: Sequence[str]) -> bool:
    """Whether errors are written as JSON, by `arguments`, where the options have not been parsed."""
    return writes_json() or "--error-format json" in " ".join(arguments).replace("=", " ")


def end_with_output_error(error: OSError, arguments: Sequence[str]) -> NoReturn:
    """Ends where a result cannot be written: a full disk, a closed stream. One line says so."""
    if error.filename is not None:
        raise error  # a file that is no stream
    # Buffered output would fail once more at the end of the process.
    with suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    message = f"the result cannot be written: {error.strerror or error}"
    _print_to_stderr(json.dumps(_make_error_json("cannot be written", message)) if _wants_json(arguments) else message)
    sys.exit(SCRIPT)


def end_with_message(text: str, entry: dict[str, Any], code: int) -> NoReturn:
    """Ends with an error as text or as JSON."""
    _print_to_stderr(json.dumps(entry, ensure_ascii=False) if writes_json() else text)
    sys.exit(code)


def print_note(text: str) -> None:
    _print_to_stderr(
        json.dumps(_make_error_json("note", text), ensure_ascii=False) if writes_json() else escape_controls(text)
    )


def _print_to_stderr(text: str) -> None:
    with suppress(OSError):  # where stderr cannot be written, the exit code is enough
        click.echo(text, err=True, color=True if wants_color(sys.stderr) else None)


def writes_json() -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(AS_JSON))


def wants_color(stream: TextIO) -> bool:
    """Whether a stream gets colors: by the option, else if it is a terminal and NO_COLOR is not set."""
    context = click.get_current_context(silent=True)
    if context is not None and context.color is not None:
        return context.color
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


if TYPE_CHECKING:
    from rich.console import Console

    from ss2sql.results.result import Result


FORMATS = ("table", "json", "csv", "arrow", "parquet")
BINARY = ("arrow", "parquet")
# The format of a file by the end of its name. `.arrow` is a file of Arrow, `.arrows` a stream of it.
FILE_ENDINGS = {
    ".txt": "table", ".json": "json", ".csv": "csv", ".arrow": "arrow", ".feather": "arrow", ".arrows": "arrow",
    ".parquet": "parquet",
}  # fmt: skip
SHOWN = 20  # rows of a table
FILE_WIDE = 120  # characters of a table in a file


def read_count(value: Any) -> int:
    """A number of rows, or `all`. Raises click.BadParameter."""
    text = str(value).lower()
    if text != "all" and not text.isdecimal():
        raise click.BadParameter(f"{value!r} is neither a number of rows nor 'all'.")
    return sys.maxsize if text == "all" else int(text)


SHOW_OPTION = click.option("--show", "shown", type=read_count, default=SHOWN, show_default=True, metavar="N|all",
                           help="So many rows or paths of a table are shown.")  # fmt: skip
add_output_options = add_options(
    click.option("--format", "form", type=click.Choice(FORMATS),
                 help="How the result is printed.  [default: table]"),
    click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path),
                 help="A file for the result; the end of its name says the format: .csv, .json, .parquet ..."),
    SHOW_OPTION,
)  # fmt: skip


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
        with report_unwritable(self.path):
            _write_file(result, self.form, self.path, self.shown)
        print_note(f"written to {self.path}: {describe_output_size(result)}")


def make_output(form: str | None, path: Path | None, shown: int = SHOWN) -> Output:
    """The output that the options request, checked before anything runs."""
    if path is not None:
        check_output_folder(path)
    if form is None:
        if path is not None and path.suffix.lower() not in FILE_ENDINGS:
            suffixes = ", ".join(FILE_ENDINGS)
            _raise_usage_error(
                f"{path} does not say which format it is to have: name it with --format, or end it in {suffixes}"
            )
        form = "table" if path is None else FILE_ENDINGS[path.suffix.lower()]
    if form == "table":
        import rich.console
        import rich.table  # noqa: F401 - 0.1 s that nobody should wait for after Ctrl-C
    if form in BINARY:
        if path is None and sys.stdout.isatty():
            _raise_usage_error(
                f"{form} is not for terminals: write it to a file, --output FILE.{form}, or on into another program"
            )
        require_package("pyarrow", "df", f"--format {form}")  # raises before the script runs
    return Output(form, path, shown)


def _raise_usage_error(message: str) -> NoReturn:
    raise click.UsageError(message, click.get_current_context(silent=True))


def check_output_folder(path: Path) -> None:
    """Raises SessionError S002 for a file that cannot be written."""
    if not path.parent.is_dir():
        raise SessionError("S002", f"{path} cannot be written: there is no folder {path.parent}")


@contextmanager
def report_unwritable(path: Path) -> Iterator[None]:
    """Raises SessionError S002 where the block cannot write the file."""
    try:
        yield
    except OSError as error:
        raise SessionError("S002", f"{path} cannot be written: {error.strerror or error}") from error


def describe_output_size(result: Result) -> str:
    from ss2sql.results import count_words, get_result_paths

    paths, rows = get_result_paths(result), count_words(len(result), "row")
    return rows if paths is None else f"{count_words(len(paths), 'path')}, {rows}"


def print_line(text: str) -> None:
    click.echo(escape_controls(text))


def make_output_console() -> Console:
    """The console for tables on stdout, with colors where these are wanted."""
    from rich.console import Console

    if not wants_color(sys.stdout):
        return Console(color_system=None)
    return Console(force_terminal=True, color_system="auto" if sys.stdout.isatty() else "standard")


def _print_result(result: Result, form: str, shown: int) -> None:
    if form == "table":
        _print_table(result, shown, make_output_console())
        return
    sys.stdout.flush()
    left = memoryview(_encode_output(result, form, stream=True))
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


def _encode_output(result: Result, form: str, stream: bool) -> bytes:
    """Writes a result in a data format for other programs, always in UTF-8."""
    if form == "json":
        return _encode_for_stdout(f"{result.json()}\n")
    if form == "csv":
        return _encode_for_stdout(str(result.csv()))
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
        path.write_bytes(_encode_output(result, form, stream=path.suffix.lower() == ".arrows"))
        return
    from rich.console import Console

    with path.open("w", encoding="utf-8", errors="backslashreplace") as file, redirect_stdout(file):
        _print_table(result, shown, Console(file=file, width=FILE_WIDE, color_system=None))
