"""The magics `%%ss` and `%ss`: their options, the names of the notebook that scripts may use, and errors of cells.

Only names in the script that the session does not know are looked up, so a variable `add` of the notebook never becomes
the operator `+`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import click
from IPython.core.error import UsageError
from IPython.core.magic import Magics, line_cell_magic, magics_class, no_var_expand

from ss2sql.errors import Error, ResolveError, Source, Stopped
from ss2sql.errors import render_all as rendered
from ss2sql.errors.exceptions import escape_controls
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import resolve
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.values import SCALARS
from ss2sql.results.result import Result
from ss2sql.results.show import MOST_ROWS, format_html, format_result_text
from ss2sql.results.watching.search_trace import MOST_EVENTS
from ss2sql.session.compiled_query import ENGINES, Engine
from ss2sql.session.session import Session, connect

OWN_FOLDERS = (str(Path(__file__).parent.parent), "src/")  # src/ is apsw


def shorten_traceback(error: Exception, shell: Any) -> Exception:
    """The same exception, with a short traceback in IPython by its method `_render_traceback_`."""
    lines: Callable[[], list[str]]
    if isinstance(error, Error):
        color = getattr(shell, "colors", "nocolor").lower() != "nocolor"
        lines = lambda: [rendered(error, color)]  # noqa: E731
    elif not getattr(error, "_ss2sql_noted", False):
        return error  # it comes from outside of the user's functions
    else:
        frames = keep_user_frames(error.__traceback__)
        lines = lambda: shell.InteractiveTB.structured_traceback(type(error), error, frames)  # noqa: E731
    try:
        error._render_traceback_ = lines  # type: ignore[attr-defined]
    except AttributeError:
        return error  # exceptions with __slots__ cannot be marked; IPython then shows all frames
    return error


def keep_user_frames(traceback: TracebackType | None) -> TracebackType | None:
    """The frames of a traceback without ours and IPython's."""
    frames = []
    while traceback is not None:
        frames.append(traceback)
        traceback = traceback.tb_next
    remaining: TracebackType | None = None
    for frame in reversed(frames):
        if not frame.tb_frame.f_code.co_filename.startswith(OWN_FOLDERS):
            remaining = TracebackType(remaining, frame.tb_frame, frame.tb_lasti, frame.tb_lineno)
    return remaining


# --- the first line of `%%ss`: options, a name for the result, and the beginning of the script
TARGET = re.compile(r"\s*([^\W\d]\w*)\s*<<(?=\s|$)")


@dataclass(frozen=True, slots=True)
class Options:
    """The options of the first line.

    `output` is the variable for the result; `quiet`: it was named with `<<`, so nothing is shown. `rest` comes after.
    """

    engine: Engine = "auto"
    timeout: float | None = None
    maximum: int | None = None
    session: str | None = None
    show: int | None = None
    explain: bool = False
    play: bool = False
    sql: bool = False
    output: str | None = None
    quiet: bool = False
    rest: str = ""


def _check_name(text: str) -> str:
    if not text.isidentifier():
        raise ValueError(text)
    return text


OPTIONS = click.Command(
    "%ss",
    params=[
        click.Option(["--engine"], type=click.Choice(ENGINES), default="auto"),
        click.Option(["--timeout"], type=click.FloatRange(0)),
        click.Option(["--maximum"], type=click.IntRange(1)),
        click.Option(["--session"], type=_check_name),
        click.Option(["--show"], type=click.IntRange(0)),
        *(click.Option([name], is_flag=True) for name in ("--explain", "--play", "--sql")),
        click.Option(["-o", "--output"], type=_check_name),
    ],
    context_settings={"allow_interspersed_args": False, "allow_extra_args": True},
    add_help_option=False,
)


def read_magic_options(line: str) -> Options:
    """The options of a line. Raises UsageError."""
    words = list(re.finditer(r"\S+", line))
    options = list(takewhile(lambda word: not re.match(r"-\W*\d", word), (word[0] for word in words)))  # -1 is a script
    left = len(words) - len(options)
    try:
        with OPTIONS.make_context("%ss", options) as context:
            read, left = context.params, left + len(context.args)
    except click.ClickException as error:
        raise UsageError(f"%ss: {error.format_message()}") from None
    rest = line[words[-left].start() :] if left else ""
    if target := TARGET.match(rest):
        if read["output"] is not None:
            raise UsageError(f"the result has two names, {read['output']} and {target[1]}")
        return Options(**{**read, "output": target[1], "quiet": True}, rest=rest[target.end() :])
    return Options(**read, rest=rest)


# --- functions and values of the notebook for unknown names of a script
MISSING = object()
UNKNOWN = ("R001", "R002", "R003")  # the codes for unknown names, functions and sources


class NotebookNames:
    """The names that one session got from a notebook, so that changes are passed on.

    `names` is the notebook's namespace, `hidden` are the names in it that are IPython's own.
    """

    def __init__(self, session: Session, names: Mapping[str, Any], hidden: Mapping[str, Any]) -> None:
        self.session = session
        self._names = names
        self._hidden = hidden
        self._functions: dict[str, Any] = {}
        self._values: dict[str, tuple[Any, Any]] = {}  # as they are in the notebook, and the same in the session

    def provide_names(self, script: Source) -> None:
        """Gives the session the notebook's values for names of the script that it does not know.

        Raises ParseError, and SessionError for what a session cannot take.
        """
        tree = parse(script)
        self._remove_outdated()
        calls = [node for node in ast.walk_syntax(tree) if isinstance(node, ast.Call) and node.owner is None]
        for name in dict.fromkeys(call.function for call in calls):
            found = self._find_value(name)
            if callable(found):
                self._provide_function(name, found)
        provided = True
        while provided:  # new values may have columns, which changes the unknown names
            provided = sum(map(self._provide_name, self._list_unknown(tree))) > 0

    def add_hints(self, error: ResolveError) -> ResolveError:
        """The error, with hints at names of the notebook that are close to unknown ones."""
        usable = [name for name in self._names if self._find_value(name) is not MISSING]
        for one in error.errors:
            unknown = one.span.text if one.code in UNKNOWN and one.span is not None else ""
            for name in get_close_matches(unknown, usable, n=1):
                if not any(f"'{name}'" in hint for hint in one.hints):
                    one.with_hint(f"the notebook has '{name}'")
        return error

    def _find_value(self, name: str) -> Any:
        """The notebook's value of a name; MISSING where it has none that a script could use."""
        found = self._names.get(name, MISSING)
        own = name in self._hidden and found is self._hidden[name]
        return MISSING if own or name.startswith("_") or isinstance(found, ModuleType) else found

    def _is_new(self, name: str, function: Any) -> bool:
        """Whether the session has no function of the name, or a former one from the notebook."""
        host = self.session.host
        if name in self._functions:
            current = host.functions.get(name)
            ours = current is not None and current.function is self._functions[name]
            return ours and function is not self._functions[name]
        return name not in host.make_catalog().functions and name not in host.world_functions

    def _list_unknown(self, tree: ast.Script) -> tuple[str, ...]:
        catalog = self.session.host.make_catalog(unknown="parameter")
        try:
            return retry_with_stack(lambda: resolve(tree, catalog)).parameters
        except ResolveError:
            return ()  # running the script raises the error

    def _provide_name(self, name: str) -> bool:
        """Gives the session one name; False where the notebook does not have it."""
        found = self._find_value(name)
        if found is MISSING:
            return False
        if callable(found):
            return self._provide_function(name, found)
        if type(found) in SCALARS:
            self.session.set(name, found)
        else:
            self.session.attach(name, found)
        self._values[name] = found, self._get_session_value(name)
        return True

    def _provide_function(self, name: str, function: Any) -> bool:
        """Registers a function that is new; says whether it is."""
        new = self._is_new(name, function)
        if new:
            self.session.function(name, function)
            self._functions[name] = function
        return new

    def _remove_outdated(self) -> None:
        """Removes values that the notebook no longer has; values set by a script stay."""
        for name, (value, kept) in list(self._values.items()):
            if self._get_session_value(name) is kept:  # else it is the session's own now
                if self._find_value(name) is value:
                    continue
                if name in self.session.host.names.values:
                    self.session.host.names.forget_name(name)
                else:
                    self.session.detach(name)
            del self._values[name]

    def _get_session_value(self, name: str) -> Any:
        names = self.session.host.names
        return names.attached.get(name, names.values.get(name, MISSING))


_display: Any = import_module("IPython.display").display  # it has no types


class ShownResult:
    """A result with so many rows."""

    def __init__(self, result: Result, most: int | None) -> None:
        self._result = result
        self._most = MOST_ROWS if most is None else most

    def __repr__(self) -> str:
        return format_result_text(self._result, self._most)

    def _repr_html_(self) -> str:
        return format_html(self._result, self._most)


@magics_class
class ScriptMagics(Magics):
    """The magics of one notebook, and the sessions that its cells run in."""

    def __init__(self, shell: Any) -> None:
        super().__init__(shell)
        self._shell = shell
        self._own: Session | None = None
        self._session_name: str | None = None
        self._notebook_names: dict[int, NotebookNames] = {}  # by the identity of the session, which it keeps alive

    @no_var_expand  # {} is SelectScript's own
    @line_cell_magic
    def ss(self, line: str, cell: str | None = None) -> Result | None:
        """Runs a script in SelectScript.

        %%ss [OPTIONS] [NAME <<]    runs the cell and shows its result; with NAME << it only stores it
        %ss [OPTIONS] SCRIPT        runs the line and gives its result: plan = %ss SELECT this FROM moves
        %ss --session NAME          has all cells from here on run in that session

        The script may use the names of the notebook: its functions, and variables with values, data frames and worlds.

          -o, --output NAME   a variable for the result
          --show N            so many rows are shown
          --engine ENGINE     auto, database or native
          --timeout SECONDS   breaks the run off
          --maximum N         at most so many results of the last search
          --session NAME      a variable that holds a session, in place of the notebook's own
          --explain           shows what became of the script in place of its result
          --play              plays the search in place of its result, its first 10,000 events
          --sql               shows the SQL and runs nothing
        """
        options = read_magic_options(line)
        if cell is None and not options.rest.strip():
            self._choose_session(options)
            return None
        offered = self._get_session(options.session or self._session_name)
        margin = " " * (len(line) - len(options.rest))  # so that errors name the columns of the cell
        source = Source(f"{margin}{options.rest}\n{cell or ''}", f"In[{self._number}]")
        try:
            offered.provide_names(source)
            if options.sql:
                print(escape_controls(offered.session.compile(source, options.engine).sql))
                return None
            result = self._run_and_show(offered.session, source, options, cell is not None)
        except ResolveError as error:
            raise shorten_traceback(offered.add_hints(error), self._shell) from None
        except Exception as error:
            raise shorten_traceback(error, self._shell) from None
        return result if cell is None else None

    def _run_and_show(self, session: Session, source: Source, options: Options, shown: bool) -> Result:
        """Runs the script, stores the result and shows it; a partial result as well."""
        try:
            trace = MOST_EVENTS if options.play else None
            result = session.run(source, options.engine, options.timeout, options.maximum, trace=trace)
        except Stopped as stopped:
            if stopped.partial is not None:
                self._store_result(options, stopped.partial)
                _display(ShownResult(stopped.partial, options.show))
            raise
        self._store_result(options, result)
        if options.explain:
            print(result.explain())
        elif options.play:
            _display(result.animate())
        elif shown and not options.quiet:
            _display(ShownResult(result, options.show))
        return result

    def _store_result(self, options: Options, result: Result) -> None:
        if options.output is not None:
            self._shell.user_ns[options.output] = result

    def _choose_session(self, options: Options) -> None:
        """Makes a session the default of all later cells."""
        if options.session is None:
            raise UsageError("%ss needs a script: %ss SELECT this FROM [1, 2], or a cell that begins with %%ss")
        self._get_session(options.session)
        self._session_name = options.session

    def _get_session(self, name: str | None) -> NotebookNames:
        """The session of a variable, or the notebook's own, with the names that it got from the notebook."""
        if name is None:
            if self._own is None:
                self._own = connect()
            session = self._own
        else:
            session = self._shell.user_ns.get(name)
            if not isinstance(session, Session):
                raise UsageError(f"{name} is no session; make one first: {name} = ss2sql.connect()")
        known = self._notebook_names.get(id(session))
        if known is None:
            known = NotebookNames(session, self._shell.user_ns, self._shell.user_ns_hidden)
            self._notebook_names[id(session)] = known
        return known

    @property
    def _number(self) -> int:
        """The number of the cell that runs; `execution_count` may be that of the next one already."""
        return len(self._shell.user_ns["_ih"]) - 1

    def close_session(self) -> None:
        if self._own is not None:
            self._own.close()
