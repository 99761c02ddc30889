"""The results of a compiled search, as its task asks for them: the loop that finds them, and values in place of frozen
ones."""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.runtime.frozen import State, Thaw
from ss2sql.runtime.memorize.by_key import ByKey
from ss2sql.runtime.memorize.growing import memorize
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.notes import Noted, noted_of
from ss2sql.runtime.native.by_level import watcher
from ss2sql.runtime.native.pace import counts_of, looks_of
from ss2sql.runtime.ordering import exceeds
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Run
from ss2sql.runtime.search import search_of
from ss2sql.runtime.search.contract import Expand, Problem
from ss2sql.runtime.search.remembered_steps import RememberedSteps, ignore
from ss2sql.runtime.search.watched import Watched

if TYPE_CHECKING:
    from ss2sql.runtime.native.search_code import SearchForm
    from ss2sql.runtime.native.tasks import Task


def found(
    task: Task, search: plan.Search, form: SearchForm, bound: int | None, outer: tuple[Any, ...]
) -> Generator[Any, None, None]:
    """The results as they are found; `bound` is MEMORIZE's."""
    run, query = task.run, task.form.query
    starts, function, keys, key_of, noted = task.find(*outer)
    noted = noted and noted_of(*noted)
    problem = Problem(
        starts if key_of is None or search.repeats == "no cycle" else _different_starts(starts, key_of),
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
        found=partial(_look, run),
    )
    watched = Watched(run.trace, query, problem) if form.watched else None
    problem = problem if watched is None else watched.problem
    if search.repeats == "memorize" and (watched is not None or not search.plain):
        shown = None if search.plain else noted
        graph = ByKey(query, problem, bound, run.check, run.max_rows, form.shapes, shown)
        return _paths(task, graph.paths(), keys, None)
    if task.form.find is not None:
        hunt = _hunt(task, search, form, problem, bound, noted)
        return _paths(task, task.form.find(hunt), keys, None)
    if search.repeats == "memorize":
        hunt = _hunt(task, search, form, problem, bound, noted)
        return _paths(task, memorize(hunt), keys, None)
    expand = problem.expand if form.watched else _expand(task, form, function)
    problem = replace(problem, expand=expand, watch=watcher(run, form.leveled, task.tell))
    paths = (function if form.inlined else search_of(search))(problem)
    return _paths(task, paths if watched is None else watched.found(paths), keys, form.shapes.thawing())


def _look(run: Run, total: Any, guess: Any) -> None:
    run.overestimated |= exceeds(guess, total)


def _hunt(
    task: Task, search: plan.Search, form: SearchForm, problem: Problem, bound: int | None, noted: Noted | None
) -> Hunt:
    """The search for who makes the graph of MEMORIZE, or goes by levels in another database."""
    return Hunt(
        start=form.shapes.thaw(problem.starts[0]),
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
        flush=task.tell,
        keyed=problem.keyed,
    )


def _expand(task: Task, form: SearchForm, expand: Expand) -> Expand:
    """The step function, with a memory where states come again."""
    run, most = task.run, task.run.host.memo_limit
    if not form.remembered:
        return expand
    compares = task.form.query.search is not None and task.form.query.search.repeats == "no cycle"
    if not most:
        return (lambda state, closed: expand(state, closed, ignore)) if compares else expand
    return RememberedSteps(expand, most, looks_of(run), partial(counts_of(run), 0, 0), compares).expand


def _paths(
    task: Task, found: Iterator[Found], keys: Callable[[Any], Row] | None, thaw: Thaw | None
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


def _different_starts(starts: list[State], key_of: Callable[[State], Hashable]) -> list[State]:
    """The first of equal starts."""
    by_key: dict[Hashable, State] = {}
    for start in starts:
        by_key.setdefault(key_of(start), start)
    return list(by_key.values())
