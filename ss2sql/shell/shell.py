"""The shell without its terminal: runs the input of a terminal or a pipe piece by piece, and prints the results."""

from __future__ import annotations

import json
import sys
from codecs import getincrementaldecoder
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from ss2sql.cli.output import (
    CTRL_C,
    SCRIPT,
    SHOW_OPTION,
    UserError,
    exit_with_code_on_error,
    format_printed_error,
    make_output,
    print_line,
    print_note,
    wants_color,
    writes_json,
)
from ss2sql.cli.script_commands import add_run_options, build_partial_output, run_script
from ss2sql.cli.script_options import ScriptInputs, add_session_options
from ss2sql.errors import Cancelled, Error, SessionError, Source, Stopped, require_package
from ss2sql.errors.exceptions import escape_controls
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.frontend.syntax.tokenizer import MAX_BYTES, make_script_size_error
from ss2sql.language.conversion import format_value as written
from ss2sql.shell.dot_commands import FORMS, CommandError, ExitRequest, FileFailed, Settings, run_dot_command
from ss2sql.shell.statement_splitter import TypedPiece, split_statements

if TYPE_CHECKING:
    from ss2sql.results.result import Result
    from ss2sql.session.session import Session


TYPED = "<script>"  # the name of the input in errors
MOST_ASSIGNED = 100  # characters of a value that was assigned
MOST_VALUE = 4000  # characters of any other


class Shell:
    """A session with its settings, and the statement that ran last, `source`, with its `result` if it has one."""

    def __init__(self, session: Session, settings: Settings | None = None) -> None:
        self.session = session
        self.settings = settings or Settings()
        self.source: Source | None = None
        self.result: Result | None = None
        self.failed = False  # whether any statement has
        self.cancelled = False  # whether Ctrl-C has ended a statement
        self.reading = 0  # the depth of files that read each other

    def run_text(self, text: str, name: str = TYPED) -> bool:
        """Runs the statements and commands of a text up to the first that fails; says whether none did.

        Raises Leave where one of them is `.exit`.
        """
        return all(self.run_piece(piece, text, name) for piece in split_statements(text))

    def run_piece(self, piece: TypedPiece, text: str, name: str = TYPED, lines_before: int = 0) -> bool:
        """Runs one of them, and prints its result or its error."""
        try:
            if piece.is_command:
                run_dot_command(self, piece.text)
            else:
                self._run_statement(piece.make_source(text, name, lines_before))
        except FileFailed:  # which has been printed
            return False
        except (Error, UserError, CommandError, click.ClickException, KeyboardInterrupt) as error:
            self.print_error(error)
            return False
        return True

    def _run_statement(self, source: Source) -> None:
        self.source, self.result = source, None
        try:
            result = run_script(self.session, source, **self.settings.make_run_options())
        except Stopped as stopped:
            self.print_error(stopped)  # first, because printing the partial result may take a while
            if stopped.partial is not None and len(stopped.partial):
                table = self.settings.format == "table"
                self.print_result(stopped.partial if table else build_partial_output(self.session, stopped.partial))
            raise FileFailed from None
        self.result = result
        self.print_result(result, _find_typed_assignment(source) if result.answer is None else None)
        if self.settings.timer:
            parts: dict[str, Any] = result.stats.seconds
            stages = ", ".join(f"{name} {seconds:.3f}" for name, seconds in parts.items())
            print_line(f"{sum(parts.values()):.3f} s: {stages}")

    def print_result(self, result: Result, assigned: str | None = None) -> None:
        """Prints a result; for an assignment a note, since its value is in the variable."""
        settings = self.settings
        if assigned is not None:
            print_note(f"{assigned} = {written(result.value, MOST_ASSIGNED)}")
        elif settings.format != "table" or result.answer is not None:
            make_output(settings.format, None, settings.show).write_result(result)
        elif result.value is not None:
            text = str(result.value)
            if len(text) > MOST_VALUE:
                shown = f"the first {MOST_VALUE:,} shown; `.format json` shows all"
                text = f"{text[:MOST_VALUE]}...\n{len(text):,} characters, {shown}"
            print_line(text)

    def print_error(self, error: BaseException) -> None:
        self.failed = True
        self.cancelled |= isinstance(error, (Cancelled, KeyboardInterrupt))
        sys.stdout.flush()
        click.echo(_format_shell_error(error), err=True, color=wants_color(sys.stderr))


def _format_shell_error(error: BaseException) -> str:
    match error:
        case Error():
            return format_printed_error(error)
        case UserError() if writes_json():
            return json.dumps(error.as_dict(), ensure_ascii=False)
        case KeyboardInterrupt():
            return "cancelled"
        case click.ClickException():
            return f"error: {escape_controls(error.format_message())}"
        case _:
            return escape_controls(str(error))


def _find_typed_assignment(source: Source) -> str | None:
    (statement, *_) = parse(source).statements
    match statement:
        case ast.Assign(name=name) | ast.TemporalAssign(name=name):
            return str(name)
        case _:
            return None


# --- the shell without a terminal: statements from a pipe or a file, each run as soon as it is complete
NAME = "<stdin>"


def run_piped(shell: Shell, stream: BinaryIO) -> None:
    """Runs the statements of the stream up to its end, `.exit` or Ctrl-C, also after an error."""
    pending, lines = "", 0
    try:
        for text in _read_shell_lines(stream):
            pending += text
            # Searching the end of a statement only where there may be one keeps the time of long ones linear.
            if ";" in text or pending.lstrip().startswith("."):
                pending, lines = _run_complete(shell, pending, lines)
            if shell.cancelled:
                return
            if len(pending) > MAX_BYTES and len(pending.strip()) > MAX_BYTES:
                raise make_script_size_error("a statement on the standard input")
        for piece in split_statements(pending):
            _run_piece(shell, piece, pending, lines)
    except ExitRequest:
        return


def _run_complete(shell: Shell, pending: str, lines: int) -> tuple[str, int]:
    """Runs what is complete; gives the rest, and the number of lines before it."""
    after = 0
    for piece in split_statements(pending):
        if not piece.complete:
            break
        _run_piece(shell, piece, pending, lines)
        after = piece.end
    done = pending.rfind("\n", 0, after) + 1  # the rest keeps its place on its line
    head = pending[done:after]
    return " " * len(head) + pending[after:], lines + pending.count("\n", 0, done)


def _run_piece(shell: Shell, piece: TypedPiece, pending: str, lines: int) -> None:
    if not shell.cancelled:
        shell.run_piece(piece, pending, NAME, lines)


def _read_shell_lines(stream: BinaryIO) -> Iterator[str]:
    """The lines of a stream; long ones in parts, so that at most a script's limit is read."""
    decoder = getincrementaldecoder("utf-8-sig")()
    number = 1
    try:
        while part := stream.readline(MAX_BYTES):
            yield decoder.decode(part)
            number += part.endswith(b"\n")
        yield decoder.decode(b"", final=True)
    except UnicodeDecodeError as error:
        raise SessionError("S002", f"line {number} of the standard input cannot be read: {error}") from error
    except OSError as error:
        raise SessionError("S002", f"the standard input cannot be read: {error}") from error


# --- `ss2sql repl`: the shell
@click.command("repl")
@add_session_options
@add_run_options
@click.option("--format", "form", type=click.Choice(FORMS), default="table", show_default=True,
              help="How results are printed.")  # fmt: skip
@SHOW_OPTION
@click.option("--history/--no-history", default=True, help="Whether what is typed is remembered for the next time.")
@exit_with_code_on_error
def repl_command(
    inputs: ScriptInputs, progress: bool | None, form: str, shown: int, history: bool, **options: Any
) -> None:
    """Runs statements as they are typed. Without a terminal it reads them from standard input."""
    typed = sys.stdin.isatty()
    if typed:
        require_package("prompt_toolkit", "repl", "the shell")
    with inputs.open_session(progress) as session:
        shell = Shell(session, Settings(format=form, show=shown, **options))
        if typed:
            from ss2sql.shell.terminal import Terminal

            Terminal(shell, history).run_until_exit()
            return

        run_piped(shell, sys.stdin.buffer)
    if shell.failed:
        sys.exit(CTRL_C if shell.cancelled else SCRIPT)
