"""The dot commands and the settings of the shell, a row each."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import click

from ss2sql.cli.output import SHOWN, print_line, print_note, read_count
from ss2sql.cli.script_commands import ENGINES, KINDS, PICTURES, format_sql_with_parameters
from ss2sql.cli.script_options import parse_parameter, parse_world, register_file
from ss2sql.editor.keywords import keywords
from ss2sql.errors import require_package, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import format_value as written
from ss2sql.results import cut_text
from ss2sql.session.descriptions import FunctionAbout
from ss2sql.session.session import read_script_source
from ss2sql.shell.symbols import SymbolTable

if TYPE_CHECKING:
    from ss2sql.results.result import Result
    from ss2sql.session.compiled_script import Query
    from ss2sql.shell.shell import Shell


class CommandError(Exception):
    """A dot command failed: the reason, and what to do."""

    def __init__(self, message: str, *hints: str) -> None:
        super().__init__(message)
        self.hints = hints

    def __str__(self) -> str:
        return "\n".join([f"error: {self.args[0]}", *(f"  = help: {hint}" for hint in self.hints)])


class ExitRequest(Exception):  # noqa: N818 - no error
    """The user leaves the shell."""


class FileFailed(Exception):  # noqa: N818 - the error itself has been told
    """A file that was read has failed."""


@dataclass(slots=True)
class Settings:
    """How statements run, and how results are shown."""

    engine: str = "auto"
    format: str = "table"
    show: int = SHOWN
    timeout: float | None = None
    maximum: int | None = None
    max_rows: int | None = None
    workers: int = 1
    timer: bool = False

    def make_run_options(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("engine", "timeout", "maximum", "max_rows", "workers")}


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting: its name, its values, what reads one, and a description."""

    name: str
    form: str
    about: str
    type: click.ParamType[Any]

    @property
    def choices(self) -> list[str]:
        """The values that are words."""
        return [word for word in self.form.split("|") if word.islower()]

    def read(self, text: str) -> Any:
        if text.lower() == "off" and "off" in self.choices:
            return False if "on" in self.choices else None
        value = self.type.convert(text, None, None)
        if value != value or value == float("inf"):
            raise click.BadParameter(text)
        return value


FORMS = ("table", "json", "csv")  # others are not for terminals
SETTINGS = {
    entry.name: entry
    for entry in (
        Setting("engine", "|".join(ENGINES), "where queries run", click.Choice(ENGINES, case_sensitive=False)),
        Setting("format", "|".join(FORMS), "how results are printed", click.Choice(FORMS, case_sensitive=False)),
        Setting("show", "N|all", "how many rows or paths of a table are shown", click.types.convert_type(read_count)),
        Setting("timer", "on|off", "whether the time of a run is told", click.BOOL),
        Setting("timeout", "SECONDS|off", "when a run is broken off", click.FloatRange(0)),
        Setting("maximum", "N|off", "at most so many results of a search", click.IntRange(1)),
        Setting("workers", "N", "processes for the calls that MEMORIZE makes", click.IntRange(1)),
    )
}


def format_setting(value: Any) -> str:
    """A value in the notation of the command."""
    if value is None or value is False:
        return "off"
    if value is True:
        return "on"
    return "all" if value == sys.maxsize else f"{value:g}" if isinstance(value, float) else str(value)


def change_setting(settings: Settings, name: str, text: str) -> str:
    """Changes a setting; gives the line with its new value."""
    entry = SETTINGS[name]
    try:
        setattr(settings, name, entry.read(text))
    except click.BadParameter:
        raise CommandError(f".{name} takes {entry.form.replace('|', ' or ')}, not {text}") from None
    return f"{name}: {format_setting(getattr(settings, name))}"


# --- the dot commands, a row each: arguments, description and function
Takes: TypeAlias = Literal["nothing", "script", "file", "setting", "function", "table", "variable", "help"]

EXAMPLE = "SELECT this, this ^ 2 FROM range(5) WHERE this > 1;"
WIDE = 100  # characters of a line in lists
MOST_READ = 20  # files that read each other


@dataclass(frozen=True, slots=True)
class DotCommand:
    """A dot command: `form` is its syntax, `takes` the kind of its argument, `about` a line for lists."""

    form: str
    about: str
    takes: Takes
    do: Callable[[Shell, str], None]
    example: str = ""

    @property
    def name(self) -> str:
        return self.form.split()[0]


def run_dot_command(shell: Shell, line: str) -> None:
    """Runs a line. Raises CommandError, what the command's script raises, and Leave."""
    name, _, rest = line.strip().partition(" ")
    command = COMMANDS.get(name) or COMMANDS.get(name.lower())
    if command is None:
        hints = suggest_names(name, COMMANDS) or (".help lists all of them",)
        raise CommandError(f"there is no command '{name}'", *hints)
    if command.takes == "nothing" and rest.strip():
        raise CommandError(f"{command.name} takes nothing, not {rest.strip()}")
    command.do(shell, rest.strip())


# --- help and lists ------------------------------------------------------------------------------------


def _run_dot_help(shell: Shell, name: str) -> None:
    if not name:
        lines = ["A statement ends with ; and may take several lines. For example:", "", f"  {EXAMPLE}", ""]
        lines += _align_dot_columns((entry.form, entry.about) for entry in COMMANDS.values())
        lines += ["", ".sql, .explain and .plot without more are about the last statement.",
                  "Tab completes, Ctrl-R searches the history, Ctrl-C clears the line or cancels a run, Ctrl-D leaves.",
                  ".help NAME explains a command, a function or a keyword: .help CONNECT BY"]  # fmt: skip
        print_line("\n".join(lines))
        return
    command = COMMANDS.get(name) or COMMANDS.get(f".{name}")
    keyword = keywords().get(name.upper().split()[0])
    if command is not None:
        example = f"\n  {command.example}" if command.example else ""
        print_line(f"{command.form}: {command.about}{example}")
    elif keyword is not None:
        print_line(f"{keyword.text}: {keyword.about}")
    else:
        _run_dot_functions(shell, name)


def _run_dot_tables(shell: Shell, name: str) -> None:
    if name:
        print_line(shell.session.describe(name))
        return
    names = {table: ", ".join(about.columns) for table, about in shell.session.tables().items()}
    empty = "FROM finds nothing yet; .attach NAME FILE.db brings the tables of a SQLite file"
    print_line("\n".join(_align_dot_columns(names.items(), cut=True)) or empty)


def _run_dot_functions(shell: Shell, name: str) -> None:
    symbols = SymbolTable(shell.session)
    every = {**symbols.representations, **symbols.functions}
    if not name:
        own = [entry for entry in symbols.functions.values() if entry.reason]
        built_in = [entry for entry in symbols.functions.values() if not entry.reason]
        lines = [*_describe_dot_entries(own), *([""] if own else []), *_describe_dot_entries(built_in)]
        lines += ["", "after AS:", *_describe_dot_entries(symbols.representations.values())]
        print_line("\n".join(lines))
    elif name in every:
        (line,) = _describe_dot_entries([every[name]])
        print_line(line.strip() + ("" if name in symbols.functions else f"\n  SELECT ... FROM ... AS {name}"))
    else:
        raise CommandError(f"there is no function, command or keyword '{name}'", *suggest_names(name, every))


def _run_dot_variables(shell: Shell, _: str) -> None:
    found = _align_dot_columns(SymbolTable(shell.session).variables.items(), cut=True)
    print_line("\n".join(found) or "there are no variables; x = 1; makes one")


def _describe_dot_entries(entries: Iterable[FunctionAbout]) -> list[str]:
    return _align_dot_columns((entry.call, entry.about) for entry in entries)


def _align_dot_columns(rows: Iterable[tuple[str, str]], cut: bool = False) -> list[str]:
    table = list(rows)
    width = max((len(first) for first, _ in table if len(first) < WIDE // 3), default=0)
    lines = [f"  {first:<{width}}  {second}".rstrip() for first, second in table]
    return [cut_text(line, WIDE) if cut else line for line in lines]


# --- what scripts may use ------------------------------------------------------------------------------


def _run_dot_set(shell: Shell, rest: str) -> None:
    name, _, value = rest.partition(" ")
    if not value.strip():
        raise CommandError(".set takes a name and a value", ".set start [[2,1],[],[]]")
    shell.session.set(name, parse_parameter(value.strip()))
    print_note(f"{name} = {written(shell.session.get(name), WIDE)}")


def _run_dot_attach(shell: Shell, rest: str) -> None:
    name, _, what = rest.partition(" ") if " " in rest else rest.partition("=")
    what = what.strip()
    if not name or not what:
        raise CommandError(".attach takes a name and what is attached", ".attach staff staff.db",
                           ".attach space ss2sql.scenes:chaos")  # fmt: skip
    path = Path(what).expanduser()
    if ":" in what:
        shell.session.attach(*parse_world(f"{name}={what}"))
    elif path.is_file():
        shell.session.attach(name, path)
    else:
        raise CommandError(f"there is no file {what}", "an object of Python is MODULE:OBJECT")
    symbols = SymbolTable(shell.session)
    found = [table for table in symbols.tables if table.split("(")[0].split(".")[0] == name]
    about = [f"{name}: {symbols.variables[name]}"] if name in symbols.variables else []
    print_note("\n".join(about) if about or not found else f"tables: {', '.join(found)}")


def _run_dot_load(shell: Shell, rest: str) -> None:
    if not rest:
        raise CommandError(".load takes a file of Python functions", ".load functions.py")
    path = Path(rest).expanduser()
    if not path.is_file():
        raise CommandError(f"there is no file {rest}")
    found = register_file(shell.session, path)
    print_note(f"functions: {', '.join(found)}" if found else f"{rest} has no functions")


def _run_dot_read(shell: Shell, rest: str) -> None:
    if not rest:
        raise CommandError(".read takes a file of statements", ".read hanoi.ss")
    source = read_script_source(Path(rest).expanduser())
    if shell.reading > MOST_READ:
        raise CommandError(f"{rest} is read by a file that it reads itself")
    shell.reading += 1
    try:
        if not shell.run_text(source.text, source.name):
            raise FileFailed
    finally:
        shell.reading -= 1


# --- the last statement --------------------------------------------------------------------------------


def _find_result_or_compile(shell: Shell, text: str) -> Result | Query:
    """The result of the last statement; of a text, or of one that has no result, the compiled script."""
    if text:
        return shell.session.compile(text)
    if shell.source is None:
        raise CommandError("nothing has run yet", "run a statement first, or write one after the command")
    return shell.result or shell.session.compile(shell.source)


def _run_dot_sql(shell: Shell, text: str) -> None:
    print_line(format_sql_with_parameters(_find_result_or_compile(shell, text).sql))


def _run_dot_plot(shell: Shell, rest: str) -> None:
    """Draws the last result into a file, else into a window, else, without a screen, into a new file."""
    if shell.result is None:
        raise CommandError("there is no result to draw", "run a query first")
    kind, path = "auto", None
    for word in rest.split():
        if word in KINDS:
            kind = word
        elif Path(word).suffix.lower() in PICTURES:
            path = Path(word).expanduser()
        else:
            raise CommandError(f".plot takes a file that ends in {', '.join(PICTURES)}, and what is drawn, not {word}",
                               f"what can be drawn: {', '.join(KINDS)}")  # fmt: skip
    pyplot = require_package("matplotlib.pyplot", "plot", ".plot")
    figure = shell.result.plot(kind=kind).figure
    try:
        if path is None and pyplot.get_backend().lower() not in WINDOWLESS:
            print_note("close the window to go on")
            pyplot.show()
            return
        names = (f"plot{'' if number == 1 else f'-{number}'}.png" for number in count(1))
        path = path or next(one for one in map(Path, names) if not one.exists())
        figure.savefig(path)
        print_note(f"written to {path}")
    except OSError as error:
        raise CommandError(f"{path} cannot be written: {error.strerror or error}") from error
    finally:
        pyplot.close(figure)


WINDOWLESS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")


def _leave_shell(shell: Shell, _: str) -> None:
    raise ExitRequest


def _make_setting_command(name: str) -> DotCommand:
    entry = SETTINGS[name]

    def change_or_show(shell: Shell, text: str) -> None:
        if text:
            print_note(change_setting(shell.settings, name, text))
        else:
            value = format_setting(getattr(shell.settings, name))
            print_line(f"{name}: {value}   (.{name} {entry.form}: {entry.about})")

    return DotCommand(f".{name} [{entry.form}]", entry.about, "setting", change_or_show)


_ALL = (
    DotCommand(".help [NAME]", "this list, or what a command, function or keyword does", "help", _run_dot_help),
    DotCommand(".tables [NAME]", "the tables that FROM finds, or the columns of one", "table", _run_dot_tables),
    DotCommand(".functions [NAME]", "the functions, or what one does", "function", _run_dot_functions),
    DotCommand(".variables", "the variables and what they hold", "nothing", _run_dot_variables),
    DotCommand(".set NAME VALUE", "gives a variable a value", "variable", _run_dot_set, ".set start [[2,1],[],[]]"),
    DotCommand(".attach NAME WHAT", "a SQLite file, or MODULE:OBJECT of Python, under a name", "file", _run_dot_attach,
            ".attach staff staff.db"),
    DotCommand(".load FILE.py", "registers the functions of a Python file", "file", _run_dot_load),
    DotCommand(".read FILE", "runs the statements of a file", "file", _run_dot_read),
    DotCommand(".sql [SCRIPT]", "the SQL that a script becomes", "script", _run_dot_sql, f".sql {EXAMPLE}"),
    DotCommand(".explain [SCRIPT]", "where queries run and why, and what was called how often", "script",
            lambda shell, text: print_line(_find_result_or_compile(shell, text).explain())),
    DotCommand(".plot [FILE] [KIND]", "draws the last result, in a window or in a file", "file", _run_dot_plot,
            ".plot paths.png graph"),
    *map(_make_setting_command, SETTINGS),
    DotCommand(".exit", "leaves, as Ctrl-D does", "nothing", _leave_shell),
)  # fmt: skip
COMMANDS = {entry.name: entry for entry in _ALL}
