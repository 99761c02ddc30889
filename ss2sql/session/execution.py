"""Running a compiled script: its statements one after the other, and what becomes of them in the end.

A long run says on the terminal how far it is:

    12 s | 402,116 steps, 33,509/s | 12 results

The line appears after a second, is written anew ten times a second at the most, and is gone in the end. It has neither
colours nor control codes but for the carriage return, so it looks the same everywhere.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from ss2sql.errors import Cancelled, SessionError, Stopped, Timeout
from ss2sql.language.cancellation import install_cancellation_check
from ss2sql.language.values import copy_for_python
from ss2sql.results import count_words
from ss2sql.results.notes import suggest_timeout_cure
from ss2sql.results.result import QueryResult, Result, Status
from ss2sql.runtime.parallel import IN_WORKER
from ss2sql.runtime.run.keyboard_interrupt import close_frames, defer_keyboard_interrupt
from ss2sql.runtime.run.run_state import Run, Stats, measure_memory, translate_memory_error
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.runtime.sqlite.function_callbacks import CarriedStopError
from ss2sql.session.compiled_query import RunOptions
from ss2sql.session.compiled_script import CompiledStatement, Query, outline_compiled_script

if TYPE_CHECKING:
    from ss2sql.results.watching.search_trace import SearchTrace
    from ss2sql.runtime.parallel.block_calls import CallPrefetcher
    from ss2sql.runtime.run.run_state import Run
    from ss2sql.runtime.sqlite.search_functions import SearchState
    from ss2sql.session.host import SessionHost


T = TypeVar("T")


def run_in_session(host: SessionHost, work: Callable[[Run], T]) -> T:
    """Calls `work` with a new run that Ctrl-C and `interrupt` can end. Raises Stopped with what was found."""
    run: Run | None = None
    try:
        run = Run(host, Stats(), sizes=ValueSizes(host.limits.max_size))
        with defer_keyboard_interrupt(run), host.session_lock:
            host.active_runs.append(run)
            try:
                result = work(run)
            except BaseException as error:
                if run.interrupted:
                    close_frames(error)
                raise
            finally:
                host.active_runs.remove(run)
                for end in run.cleanups:
                    end()
        if not run.interrupted:
            return result
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if run is not None and run.interrupted and not isinstance(error, Cancelled):
            raise _build_script_cancelled(run) from error
        if isinstance(error, Stopped):
            error.partial = _build_session_partial(run, error.status)
            if isinstance(error, Timeout) and run is not None and run.sink is not None:
                error.hints = (suggest_timeout_cure(run.sink.query),)
        elif isinstance(error, MemoryError):
            raise translate_memory_error(error) from None
        elif isinstance(error, CarriedStopError):
            raise error.args[0] from None
        raise
    raise _build_script_cancelled(run) from None


def set_session_deadline(run: Run, host: SessionHost, seconds: float | None) -> None:
    """Sets the end of a run that starts now; that of an inner run is not later than the outer one's."""
    times = [outer.bounds.deadline for outer in host.runs]
    times.append(None if seconds is None else time.monotonic() + seconds)
    run.bounds.deadline = min((moment for moment in times if moment is not None), default=None)


def _build_script_cancelled(run: Run | None) -> Cancelled:
    cancelled = Cancelled("T002", "the run was interrupted")
    cancelled.partial = _build_session_partial(run, cancelled.status)
    return cancelled


def execute_script(
    host: SessionHost, query: Query, options: RunOptions, progress: str | bool, variables: dict[str, Any], run: Run
) -> Result:
    """Runs a compiled script and gives the result of its last statement. The `variables` are values of the language."""
    options.check_options()
    host.prepare_database()
    run.bounds.ceiling = _find_session_memory_limit(host)
    run.max_rows = run.sizes.rows = options.max_rows
    run.steps_left = _count_session_steps(host)
    run.arguments = variables
    with install_cancellation_check(run.check):
        return _execute_statements(host, query, options, progress, run)


def _execute_statements(host: SessionHost, query: Query, options: RunOptions, progress: str | bool, run: Run) -> Result:
    engine = options.engine if options.trace is None else "native"
    statements = run.statements = query.statements(engine, run)
    if options.trace is not None:
        from ss2sql.results.watching.search_trace import find_traced_query

        find_traced_query(statements[-1].tree)
    run.call_places = query.call_places
    run.foreteller = _start_session_workers(host, run, options.workers)
    run.progress = None if host.runs else make_progress(run, progress)  # one inside of another shows none
    host.runs.append(run)
    run.sizes.pause = run.check  # until its end: in a cycle all that it holds would wait for the garbage collector
    started = time.perf_counter()
    try:
        value = _execute_for_last_value(host, run, statements, options)
    finally:
        host.runs.remove(run)
        if host.runs:
            host.runs[-1].inner_run_steps += run.steps
        run.graph = run.sizes.pause = None
        if run.progress is not None:
            run.progress.remove_line()
        run.stats.add_seconds("run", started)
        run.stats.seconds["run"] -= run.stats.seconds.get("shape", 0.0)  # what was shaped meanwhile
    if run.foreteller is not None:
        run.foreteller.report_idle()
    return _build_script_result(run, statements, value)


def _execute_for_last_value(
    host: SessionHost, run: Run, statements: Sequence[CompiledStatement], options: RunOptions
) -> Any:
    value: Any = None
    for statement in statements:
        run.check()
        run.maximum = options.maximum if statement is statements[-1] else None
        run.trace = None
        if options.trace and statement is statements[-1]:
            from ss2sql.runtime.search.trace import Trace

            run.trace = Trace(options.trace)
        run.answer = run.sink = run.graph = None
        if run.progress is not None:
            run.progress.search = None  # that of the statement before
        host.forget_stable_calls(run)
        value = statement.compute_value(run)
        run.check_steps()
    return value


def _collect_session_trace(run: Run, statement: CompiledStatement) -> tuple[SearchTrace | None, tuple[str, ...]]:
    if run.trace is None:
        return None, ()
    from ss2sql.results.watching.search_trace import collect_notes, make_trace

    tree, written = statement.tree, statement.queries[-1].written
    return make_trace(run.trace, tree, written), tuple(collect_notes(run.trace, tree))


def _build_script_result(run: Run, statements: Sequence[CompiledStatement], value: Any) -> Result:
    answer: QueryResult | None = run.answer if statements[-1].is_query else None
    if answer is not None:
        answer.begin = run.bounds.get_remaining().begin_reading
    traced, told = _collect_session_trace(run, statements[-1])
    engines = [compiled.engine for statement in statements for compiled in statement.queries]
    used = answer.engine if answer is not None else (engines[-1] if engines else "native")
    return Result(
        None if answer is not None else copy_for_python(value),
        used,
        answer.status if answer is not None else "complete",
        run.stats,
        answer,
        outline_compiled_script(statements, run),
        (*told, *run.notes),
        traced,
    )


def _start_session_workers(host: SessionHost, run: Run, workers: int) -> CallPrefetcher | None:
    """Starts other processes for calls of functions if `workers` is more than one and this is not one of them."""
    if workers == 1 or IN_WORKER in os.environ:
        return None
    from ss2sql.runtime.parallel.block_calls import CallPrefetcher
    from ss2sql.runtime.parallel.process_pool import ProcessPool

    if host.held.processes is None:
        host.held.processes = ProcessPool()
    return CallPrefetcher(run, workers, host.held.processes, host.planned, host.memo_limit > 0)


def _find_session_memory_limit(host: SessionHost) -> int | None:
    """The bytes that the process may hold; an inner run has the ceiling of the outer one."""
    if host.limits.max_memory is None:
        return None
    ceilings = [run.bounds.ceiling for run in host.runs if run.bounds.ceiling is not None]
    return min(ceilings, default=(measure_memory() or 0) + host.limits.max_memory)


def _count_session_steps(host: SessionHost) -> int | None:
    """The steps that a run may try; an inner run has those that the outer one has left."""
    outer = host.runs[-1] if host.runs else None
    if outer is None or outer.steps_left is None:
        return host.limits.max_steps
    return outer.steps_left - outer.steps


def _build_session_partial(run: Run | None, status: Status) -> Result | None:
    """The rows that the interrupted query has found; None if no query was running."""
    if run is None or run.sink is None:
        return None
    rows, engine = run.sink.rows, run.sink.engine
    shown = run.answer.rows if run.answer is not None else rows.name_as_selected()
    form = None if run.sink.query is None else run.sink.query.representation
    answer = QueryResult(shown, None, engine, status, form=form)
    outlined, notes = outline_compiled_script(run.statements, run), tuple(run.notes)
    traced, _ = _collect_session_trace(run, run.statements[-1])
    return Result(None, engine, status, run.stats, answer, outlined, notes=notes, traced=traced)


# --- one line on the terminal that says how far a long run is
FIRST_SECONDS = 1.0  # seconds before the line appears
REPEAT_SECONDS = 0.1  # seconds until it is written anew


def check_progress_option(wanted: str | bool) -> None:
    """Raises SessionError S002 for anything but "auto", True and False."""
    if wanted is not True and wanted is not False and wanted != "auto":
        raise SessionError("S002", f'progress is "auto", True or False, not {wanted!r}')


def make_progress(run: Run, wanted: str | bool) -> Progress | None:
    """The line for a run; None where nobody would see it."""
    stream = sys.stderr
    if stream is None or wanted is False:
        return None
    if wanted == "auto" and (not stream.isatty() or os.environ.get("TERM") == "dumb"):
        return None
    from shutil import get_terminal_size  # takes 2 ms

    return Progress(run, stream, time.monotonic, lambda: get_terminal_size().columns)


class Progress:
    """The line of one run. `show_line` is called again and again while it works, `remove_line` when it is over.

    `search` is the state of the search that SQLite runs.
    """

    def __init__(self, run: Run, stream: TextIO, clock: Callable[[], float], width: Callable[[], int]) -> None:
        self._run = run
        self._stream = stream
        self._clock = clock
        self._width = width
        self._started = clock()
        self._due = self._started + FIRST_SECONDS
        self._shown = 0  # characters of the line as it stands there
        self.search: SearchState | None = None

    def show_line(self) -> None:
        """Writes the line if it is time to."""
        now = self._clock()
        if now >= self._due:
            self._due = now + REPEAT_SECONDS
            self._write_line(self.describe_progress(now - self._started))

    def remove_line(self) -> None:
        if self._shown:
            self._write_line("")

    def _write_line(self, text: str) -> None:
        text = text[: max(self._width() - 1, 1)]
        blanks = " " * max(self._shown - len(text), 0)
        self._shown = len(text)
        self._stream.write(f"\r{text}{blanks}" if text else f"\r{blanks}\r")
        self._stream.flush()

    def describe_progress(self, seconds: float) -> str:
        """What the run has done in so many seconds."""
        stats, graph = self._run.stats, self._run.graph
        found = None if self._run.sink is None else self._run.sink.rows
        results = None if found is None else len((found.rows if found.paths is None else found.paths) or ())
        parts = [f"{seconds:.0f} s"]
        if graph is not None:
            parts.append(f"{count_words(len(stats.levels), 'level')} of MEMORIZE")
            parts.append(count_words(len(graph.rows) - 1, "row"))
        steps = stats.generated or (0 if self.search is None else self.search.entered)
        if steps:
            parts.append(f"{count_words(steps, 'step')}, {steps / seconds:,.0f}/s")
        if results is not None:
            rate = f", {results / seconds:,.0f}/s" if results and not steps else ""
            parts.append(count_words(results, "result") + rate)
        return " | ".join(parts)
