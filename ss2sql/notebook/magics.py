"""The magics `%%ss` and `%ss`."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from IPython.core.error import UsageError
from IPython.core.magic import Magics, line_cell_magic, magics_class, no_var_expand

from ss2sql.errors import ResolveError, Source, Stopped
from ss2sql.errors.renderer import escape_controls
from ss2sql.notebook.caller_names import NotebookNames
from ss2sql.notebook.cell_errors import shorten_traceback
from ss2sql.notebook.magic_options import Options, WrongOption, read_magic_options
from ss2sql.results.result import Result
from ss2sql.results.show import MOST_ROWS, format_html, format_result_text
from ss2sql.results.watching.search_trace import MOST_EVENTS
from ss2sql.session.connect import connect
from ss2sql.session.session import Session

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
        try:
            options = read_magic_options(line)
        except WrongOption as error:
            raise UsageError(str(error)) from None
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
        """Closes the notebook's own session."""
        if self._own is not None:
            self._own.close()
