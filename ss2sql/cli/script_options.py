"""The inputs of a command: the options for a script and what it may use, and the session made from them."""

from __future__ import annotations

import ast as python_ast
import importlib
import inspect
import os
import runpy
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import fields
from functools import partial, wraps
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ss2sql.cli.output import Option, add_options, mark_user_errors
from ss2sql.errors import Error, SessionError, Source, suggest_names
from ss2sql.fast_dataclasses import dataclass

if TYPE_CHECKING:
    from ss2sql.session.session import Session

F = TypeVar("F", bound=Callable[..., Any])

USES_OPTIONS = (
    click.option(
        "--functions",
        "function_files",
        multiple=True,
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="A Python file whose functions the script may call.",
    ),
    click.option("--world", "worlds", multiple=True, metavar="NAME=MODULE:OBJECT",
                 help="A Python object to attach; a class or function is called, MODULE:FACTORY(seed=3) too."),
    click.option("--database", type=click.Path(dir_okay=False), help="A SQLite file whose tables the script reads."),
    click.option("--attach", "files", multiple=True, metavar="NAME=FILE",
                 help="A Parquet file, read as NAME, or a SQLite file, whose tables are NAME.TABLE."),
)  # fmt: skip

PARAMETER = click.option("-p", "--parameter", "parameters", nargs=2, multiple=True, metavar="NAME VALUE",
                         help="A value for a name of the script, as a Python literal or else as text.")  # fmt: skip

LIMITS = (
    click.option("--max-size", type=click.IntRange(min=1), metavar="BYTES",
                 help="A larger text or list that the script makes is an error."),
    click.option("--max-memory", type=click.IntRange(min=1), metavar="BYTES",
                 help="The run ends when it has taken more memory (on Linux)."),
    click.option("--max-steps", type=click.IntRange(min=0), metavar="N",
                 help="The run ends when its searches have tried more steps."),
    click.option("--max-output", type=click.IntRange(min=0), metavar="N",
                 help="More characters that the script prints are an error."),
)  # fmt: skip


def _build_missing_script_error() -> click.UsageError:
    return click.UsageError("give a script: a FILE, - or a pipe for standard input, or -e TEXT", _get_click_context())


@dataclass(frozen=True, slots=True)
class ScriptInputs:
    """The values of the options: what scripts may use, their parameters and limits, and the script, if any."""

    function_files: tuple[Path, ...] = ()
    worlds: tuple[str, ...] = ()
    database: str | None = None
    files: tuple[str, ...] = ()
    parameters: tuple[tuple[str, str], ...] = ()
    file: str | None = None
    texts: tuple[str, ...] = ()
    max_size: int | None = None
    max_memory: int | None = None
    max_steps: int | None = None
    max_output: int | None = None

    @property
    def script(self) -> str | Path | Source:
        """The script; standard input, which may be a pipe that nothing names, is read each time."""
        missing = self.file is None and not self.texts
        if (self.file is not None and self.texts) or (missing and sys.stdin.isatty()):
            raise _build_missing_script_error()
        if self.texts:
            return "\n;\n".join(self.texts)
        if self.file not in (None, "-"):
            return Path(str(self.file))
        from ss2sql.frontend.syntax.tokenizer import read_script

        try:
            script = read_script(sys.stdin.buffer, "<stdin>")
        except (UnicodeDecodeError, OSError) as error:
            raise SessionError("S002", f"the script on standard input cannot be read: {error}") from error
        if missing and not script.text.strip():
            raise _build_missing_script_error()
        return script

    def open_session(self, progress: bool | None = None) -> Session:
        """A session with all of it; by default progress is shown on a terminal."""
        from ss2sql.session.session import connect  # half a second, which completion and --help avoid

        shown: str | bool = "auto" if progress is None else progress
        limits = {name: getattr(self, name) for name in ("max_size", "max_memory", "max_steps", "max_output")}
        given = {name: limit for name, limit in limits.items() if limit is not None}
        session = connect(self.database, progress=shown, read_only=self.database is not None, **given)
        for path in self.function_files:
            register_file(session, path)
        for world in self.worlds:
            session.attach(*parse_world(world))
        for file in self.files:
            session.attach(*parse_attachment(file))
        for name, text in self.parameters:
            session.set(name, parse_parameter(text))
        return session


NO_INPUTS = ScriptInputs()


def take_inputs(*options: Option) -> Callable[[F], F]:
    """A decorator that adds these options to a command, which takes their values as `inputs`."""

    def take_options(command: F) -> F:
        @wraps(command)
        def run_with_inputs(**values: Any) -> Any:
            own = {field.name: values.pop(field.name) for field in fields(ScriptInputs) if field.name in values}
            return command(inputs=ScriptInputs(**own), **values)

        return add_options(*options)(run_with_inputs)  # type: ignore[return-value]

    return take_options


add_uses_options = take_inputs(*USES_OPTIONS)
add_session_options = take_inputs(*USES_OPTIONS, PARAMETER, *LIMITS)  # where the scripts come later
add_script_options = take_inputs(
    click.argument("file", required=False, type=click.Path(dir_okay=False, allow_dash=True)),
    click.option("-e", "-c", "--execute", "texts", multiple=True, help="The script itself; several run in order."),
    *USES_OPTIONS,
    PARAMETER,
    *LIMITS,
)


@contextmanager
def redirect_output() -> Iterator[None]:
    """Redirects the output of Python and C code to stderr, so that only results go to stdout."""
    with redirect_stdout(sys.stderr):
        if os.name != "posix":
            yield
            return
        import ctypes

        flush, kept = ctypes.CDLL(None).fflush, os.dup(1)
        try:
            os.dup2(2, 1)
            yield
        finally:
            flush(None)  # C's own buffers
            os.dup2(kept, 1)
            os.close(kept)


def register_file(session: Session, path: Path) -> list[str]:
    """Registers the functions of a Python file; gives their names."""
    found = {
        name: value
        for name, value in _load_functions_file(path).items()
        if callable(value) and getattr(value, "__module__", None) == "<run_path>" and not name.startswith("_")
    }
    for name, value in found.items():
        session.function(name, value)
    return list(found)


def _get_click_context() -> click.Context | None:
    return click.get_current_context(silent=True)


def _load_functions_file(path: Path) -> dict[str, Any]:
    with mark_user_errors(), redirect_output():
        return runpy.run_path(str(path))


def parse_attachment(text: str) -> tuple[str, Path]:
    """The value of `--attach`: the name of a file in scripts, and its path."""
    name, _, path = text.partition("=")
    if not name or not path:
        raise click.UsageError(f"--attach takes NAME=FILE, not {text}", _get_click_context())
    return name, Path(path)


# --- worlds --------------------------------------------------------------------------------------------


def parse_world(text: str) -> tuple[str, Any]:
    """The value of `--world`: its name, and an object of a module or a Python file, made by a call or by its type."""
    name, _, rest = text.partition("=")
    module, _, wanted = rest.partition(":")
    try:
        tree = python_ast.parse(wanted.strip(), mode="eval").body
        call = tree if isinstance(tree, python_ast.Call) else None
        names = python_ast.unparse(call.func if call else tree).split(".")
        arguments = list(map(python_ast.literal_eval, call.args if call else ()))
        named = {word.arg or "": python_ast.literal_eval(word.value) for word in (call.keywords if call else ())}
    except (SyntaxError, ValueError):
        names, named = [""], {}
    if not name or not module or not all(word.isidentifier() for word in (*names, *named)):
        message = f"--world takes NAME=MODULE:OBJECT or NAME=MODULE:FACTORY(ARGUMENTS), not {text}"
        raise click.UsageError(message, _get_click_context())
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    found = _find_world_option(module, names, text)
    if not (call or inspect.isroutine(found) or isinstance(found, (type, partial))):
        return name, found
    with mark_user_errors(), redirect_output():
        return name, found(*arguments, **named)


def _find_world_option(module: str, names: list[str], text: str) -> Any:
    """The object of the names. Raises SessionError S002 for a missing one."""
    found = _load_module(module, text)
    for number, name in enumerate(names):
        try:
            found = getattr(found, name)
        except Error:
            raise
        except AttributeError as error:
            words = [word for word in dir(found) if not word.startswith("_")]
            hints = suggest_names(name, words) or (f"it has {', '.join(words[:12]) or 'no names'}",)
            reason = f"{'.'.join((module, *names[:number]))} has no '{name}'"
            raise _make_world_option_error(text, reason, hints) from error
    return found


def _load_module(name: str, text: str) -> Any:
    """A module, or the names of a Python file as one."""
    if name.endswith(".py"):
        return SimpleNamespace(**_load_functions_file(Path(name)))
    with mark_user_errors(), redirect_output():
        try:
            return importlib.import_module(name)
        except ImportError as error:
            raise _make_world_option_error(text, str(error)) from error


def _make_world_option_error(text: str, reason: str, hints: tuple[str, ...] = ()) -> SessionError:
    return SessionError("S002", f"the world {text} cannot be found: {reason}", hints=hints)


def parse_parameter(text: str) -> Any:
    """The value of a Python literal; any other text stays a string."""
    try:
        return python_ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text
