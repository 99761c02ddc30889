"""The end of a command: errors as messages on stderr, and exit codes."""

from __future__ import annotations

import json
import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, NoReturn, TextIO, TypeVar

import click

from ss2sql.errors import Cancelled, Error, Stopped, Timeout, render_all, respell_hints
from ss2sql.errors.renderer import escape_controls

F = TypeVar("F", bound=Callable[..., Any])

SCRIPT, USAGE, TIMEOUT, CTRL_C = 1, 2, 124, 130
FORMATS = ("text", "json")
AS_JSON = "ss2sql.errors as JSON"  # a key of the context's `meta`
PLACE = ("file", "line", "column", "end_line", "end_column")


def _note_format(context: click.Context, parameter: click.Parameter, value: str) -> None:
    context.meta[AS_JSON] = value == "json"


def _store_color_option(context: click.Context, parameter: click.Parameter, value: bool | None) -> None:
    context.color = value


COMMON_OPTIONS = (
    click.option("--error-format", type=click.Choice(FORMATS), default="text", show_default=True, is_eager=True,
                 expose_value=False, callback=_note_format,
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
            end_after_interrupt()
        except Error as error:
            _end_with_error(error)
        except UserError as error:
            end_with_message(str(error), error.as_dict(), SCRIPT)

    for option in reversed(COMMON_OPTIONS):
        run_command = option(run_command)
    return run_command  # type: ignore[return-value]


class UserError(Exception):
    """An exception of the user's Python code as text, without the frames of ss2sql."""

    def __init__(self, error: Exception) -> None:
        shown = traceback.TracebackException.from_exception(error)
        own = (str(Path(__file__).parent.parent), "src/", "<frozen ")  # src/ is apsw
        frames = [frame for frame in shown.stack if not frame.filename.startswith(own)]
        shown.stack = traceback.StackSummary.from_list(frames)
        super().__init__(escape_controls("".join(shown.format()).rstrip()))
        self.error = error
        self.frame = frames[-1] if frames else None

    def as_dict(self) -> dict[str, Any]:
        """The same keys as for errors of scripts, with the place in the user's file."""
        place = dict.fromkeys(PLACE) if self.frame is None else _find_user_line(self.frame)
        message = f"{type(self.error).__name__}: {self.error}"
        return _make_error_json("exception", message, place, notes=getattr(self.error, "__notes__", []))


def _find_user_line(frame: traceback.FrameSummary) -> dict[str, Any]:
    columns = (frame.colno, frame.end_colno)
    column, end_column = (None if number is None else number + 1 for number in columns)
    line = frame.lineno
    return dict(zip(PLACE, (frame.filename, line, column, frame.end_lineno or line, end_column), strict=True))


def _make_error_json(title: str, message: str, place: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """Another error, with the same keys as for errors of scripts."""
    where = dict.fromkeys(PLACE) if place is None else place
    return {"code": None, "title": title, "message": message, **where, "hints": [], "related": [], **more}


# Hints are for users of Python; these are their forms for a command line.
SPELLINGS = (
    (
        re.compile(r"^register it with session\.function; help\(\) lists"),
        "name its file with --functions FILE.py; 'ss2sql list functions' lists",
    ),
    (re.compile(r"^raise timeout=, "), "raise --timeout, "),
    (re.compile(r"raise max_(rows|size|memory|steps|output)$"), r"raise --max-\1"),
    (re.compile(r"max_rows, max_size and max_memory do so$"), "--max-rows, --max-size and --max-memory do so"),
    (re.compile(r"engine='(\w+)'"), r"--engine \1"),
    (re.compile(r"from Python: run\(script, (\w+)=\.\.\.\)"), r"with -p \1 VALUE"),
    (re.compile(r"from Python: session\.attach\(name, list\)"), "with --world NAME=MODULE:OBJECT"),
)


def _end_with_error(error: Error) -> NoReturn:
    code = TIMEOUT if isinstance(error, Timeout) else CTRL_C if isinstance(error, Cancelled) else SCRIPT
    respell_hints(error, SPELLINGS)
    if writes_json():
        for one in error.errors:
            found = {"found": _describe_partial(error)} if isinstance(error, Stopped) else {}
            _print_to_stderr(json.dumps({**one.as_dict(), **found}, ensure_ascii=False))
        sys.exit(code)
    if isinstance(error, Cancelled):
        _print_to_stderr(f"cancelled{_count_found(error)}")
    else:
        _print_to_stderr(f"{render_all(error, wants_color(sys.stderr))}{describe_found(error)}")
    sys.exit(code)


def _describe_partial(stopped: Stopped) -> dict[str, int] | None:
    """The size of the partial result of a run that ended early; None where there is nothing to print."""
    if stopped.partial is None:
        return None
    paths = len(stopped.partial.answer.rows.paths or ())
    return {"paths": paths} if paths else {"rows": len(stopped.partial)}


def _count_found(stopped: Stopped) -> str:
    found = _describe_partial(stopped)
    if found is None:
        return ""
    ((unit, number),) = found.items()
    return f"; {number:,} {unit[:-1] if number == 1 else unit} had been found" if number else "; nothing had been found"


def describe_found(error: Error) -> str:
    """The line after the message of a run that ended early: the size of its partial result."""
    counted = _count_found(error) if isinstance(error, Stopped) else ""
    return counted and f"\nbroken off{counted}"


def end_after_interrupt() -> NoReturn:
    """Ends after Ctrl-C outside of a run."""
    end_with_message("cancelled", _make_error_json("cancelled", "cancelled"), CTRL_C)


def end_with_usage_error(error: click.ClickException, arguments: Sequence[str]) -> NoReturn:
    """Ends after wrong usage."""
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
    """Prints a note to stderr."""
    _print_to_stderr(
        json.dumps(_make_error_json("note", text), ensure_ascii=False) if writes_json() else escape_controls(text)
    )


def _print_to_stderr(text: str) -> None:
    with suppress(OSError):  # where stderr cannot be written, the exit code is enough
        click.echo(text, err=True, color=True if wants_color(sys.stderr) else None)


def writes_json() -> bool:
    """Whether errors are written as JSON."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(AS_JSON))


def wants_color(stream: TextIO) -> bool:
    """Whether a stream gets colors: by the option, else if it is a terminal and NO_COLOR is not set."""
    context = click.get_current_context(silent=True)
    if context is not None and context.color is not None:
        return context.color
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
