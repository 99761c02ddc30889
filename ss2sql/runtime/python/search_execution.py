"""The results of a compiled search, as its task asks for them: the loop that finds them, and values in place of frozen
ones.

A level are the steps that are so many steps from the start. The loop of the search says whenever it begins, or comes
back, to the steps from another state; what has been counted since the time before belongs to the state before.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import State, Thaw, is_overestimate
from ss2sql.runtime.python.query_execution import make_count_report, make_known_steps_check
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.search import choose_search
from ss2sql.runtime.search.memorize import run_keyed_memorize, run_memorize
from ss2sql.runtime.search.search_run import Found, SearchRun
from ss2sql.runtime.search.step_contract import Expand, MemoizedSteps, NotedSearch, Problem, ignore_step_key
from ss2sql.runtime.search.trace import TracedSearch

if TYPE_CHECKING:
    from ss2sql.runtime.python.query_execution import QueryExecution
    from ss2sql.runtime.python.search_compiler import SearchForm


def find_search_results(
    task: QueryExecution, search: plan.Search, form: SearchForm, bound: int | None, outer: tuple[Any, ...]
) -> Generator[Any, None, None]:
    """The results as they are found; `bound` is MEMORIZE's."""
    run, query = task.run, task.form.query
    starts, function, keys, key_of, noted = task.find(*outer)
    noted = noted and NotedSearch(*noted)
    problem = Problem(
        starts if key_of is None or search.repeats != "unique" else _drop_equal_starts_of_run(starts, key_of),
        function,
        search.repeats,
        likeliest=search.order == "probability",
        weighed=search.weight is not None,
        keyed=keys is not None,
        alone=len(form.shapes.columns) == 1,
        apart=bool(search.key),
        visits=key_of is not None,
        last=query.last,
        key_of=key_of or id,
        found=partial(_note_search_estimate, run),
    )
    watched = TracedSearch(run.trace, query, problem) if form.watched else None
    problem = problem if watched is None else watched.problem
    find = task.form.find
    if search.repeats == "memorize":
        special = watched is not None or not search.plain
        find = run_keyed_memorize if special else find or run_memorize
    if find is not None:
        return _thaw_paths(task, find(_build_search_run(task, search, form, problem, bound, noted)), keys, None)
    if not form.watched:
        problem = replace(problem, expand=_make_expand(task, form, function))
    paths = (function if form.inlined else choose_search(search))(problem)
    return _thaw_paths(
        task, paths if watched is None else watched.strip_traces(paths), keys, form.shapes.make_row_thaw()
    )


def _note_search_estimate(run: Run, total: Any, guess: Any) -> None:
    run.overestimated |= is_overestimate(guess, total)


def _build_search_run(
    task: QueryExecution,
    search: plan.Search,
    form: SearchForm,
    problem: Problem,
    bound: int | None,
    noted: NotedSearch | None,
) -> SearchRun:
    """The search for who makes the graph of MEMORIZE, or goes by levels in another database."""
    return SearchRun(
        start=form.shapes.thaw_state(problem.starts[0]),
        problem=problem,
        shapes=form.shapes,
        grow=problem.expand if form.inlined else None,  # type: ignore[arg-type]
        order=search.order,
        bound=bound,
        stats=task.run.stats,
        check=task.run.check,
        query=task.form.query,
        run=task.run,
        noted=noted,
        chooses=form.chooses,
        flush=task.report_counts,
        keyed=problem.keyed,
    )


def _make_expand(task: QueryExecution, form: SearchForm, expand: Expand) -> Expand:
    """The step function, with a memory where states come again."""
    run, most = task.run, task.run.host.memo_limit
    if not form.remembered:
        return expand
    compares = task.form.query.search is not None and task.form.query.search.repeats == "no cycle"
    if not most:
        return (lambda state, closed: expand(state, closed, ignore_step_key)) if compares else expand
    return MemoizedSteps(
        expand, most, make_known_steps_check(run), partial(make_count_report(run), 0, 0), compares
    ).expand


def _thaw_paths(
    task: QueryExecution, found: Iterator[Found], keys: Callable[[Any], Row] | None, thaw: Thaw | None
) -> Generator[Any, None, None]:
    """The results, with values in the place of frozen ones."""
    query = task.form.query
    try:
        if keys is None and not query.last:
            paths = map(itemgetter(0), found)
            yield from paths if thaw is None else map(thaw, paths)
        else:
            for path, last in found:
                shown: Any = path if thaw is None or query.aggregated else thaw(path)
                if query.last:
                    shown = shown[-1]
                yield shown if keys is None else (None if query.aggregated else shown, keys(last))
    finally:
        if isinstance(found, Generator):
            found.close()  # it may hold tables of a database, and an error that is kept would hold it


def _drop_equal_starts_of_run(starts: list[State], key_of: Callable[[State], Hashable]) -> list[State]:
    by_key: dict[Hashable, State] = {}
    for start in starts:
        by_key.setdefault(key_of(start), start)
    return list(by_key.values())
