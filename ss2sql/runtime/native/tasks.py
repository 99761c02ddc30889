"""Running a compiled query: finding its results, and what comes after that, see endings.py."""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.runtime.frozen import State, Thaw
from ss2sql.runtime.memorize.by_key import ByKey
from ss2sql.runtime.memorize.growing import memorize
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.pieces import Pieces
from ss2sql.runtime.native.by_level import watcher
from ss2sql.runtime.native.endings import Ending, Form
from ss2sql.runtime.native.options import least_of
from ss2sql.runtime.native.pace import counts_of, looks_of
from ss2sql.runtime.rows import Row, Rows, distinct, too_many
from ss2sql.runtime.run import Run
from ss2sql.runtime.search import search_of
from ss2sql.runtime.search.contract import Expand, Problem, exceeds
from ss2sql.runtime.search.remembered_steps import RememberedSteps, ignore
from ss2sql.runtime.search.watched import Watched
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from ss2sql.runtime.native.search_code import SearchForm


@dataclass(frozen=True, slots=True)
class Settings:
    """The values of LIMIT, OFFSET, MAXIMUM and MEMORIZE's bound, and the names of columns where `to` computes one."""

    limit: int | None = None
    offset: int | None = None
    maximum: int | None = None
    bound: int | None = None
    labels: tuple[str, ...] | None = None


NO_SETTINGS = Settings()


@dataclass(frozen=True, slots=True)
class Task:
    """A query bound to a run. The functions are generated; they take the values of outer queries that it reads."""

    run: Run
    form: Form
    settings: Callable[..., tuple[Any, ...]] | None
    find: Callable[..., Any]
    group: Callable[..., tuple[Row | None, Row] | None] | None
    arguments: Callable[..., tuple[tuple[Any, ...], dict[str, Any]]] | None
    flush: Callable[[], None] | None

    def value(self, *outer: Any) -> Any:
        """The query's value, as its representation makes it."""
        counted = self.form.query.representation.name != "value"  # of which the first row alone is kept
        return self.shaped(self.rows(outer, counted=counted), outer)

    def shaped(self, rows: Rows, outer: tuple[Any, ...] = ()) -> Any:
        """What the query's representation makes of its answer."""
        arguments, named = self.arguments(*outer) if self.arguments else ((), {})
        return self.run.host.shape(self.form.query, rows, arguments, named, self.run)

    def tuples(self, *outer: Any) -> list[Row]:
        """The rows of a query whose results are rows."""
        rows = self.rows(outer).rows
        assert rows is not None
        return rows

    def stream(self) -> Iterator[Row]:
        """The rows of a query whose results are rows, one by one where nothing follows after they were found."""
        return iter(self.tuples()) if self._is_keyed else self._found(None, ())

    def rows(
        self, outer: tuple[Any, ...] = (), sink: Rows | None = None, outermost: bool = False, counted: bool = False
    ) -> Rows:
        """The answer of the query, in `sink` where one is given. The run's limits hold for the `outermost` query;
        that of its rows for queries inside of others whose value is asked for, which are `counted`.
        """
        form, query = self.form, self.form.query
        settings = Settings(*self.settings(*outer)) if self.settings else NO_SETTINGS
        nothing = settings.limit == 0 and not self._is_keyed  # is evaluated then
        every = _none_found() if nothing else self._found(settings.bound, outer)
        answer = Rows(form.columns) if sink is None else sink
        maximum = least_of(settings.maximum, self.run.maximum if outermost and query.search else None)
        found: Iterator[Any] = every if maximum is None else _first(every, maximum, answer)
        found = _different(found, self._is_keyed) if query.distinct else found
        if settings.labels is not None:
            answer.columns = distinct(settings.labels)
        results: list[Any] = []
        if not query.gives_paths:
            answer.rows, answer.paths = results, None
        else:
            answer.rows, answer.paths = None, results
        most = self.run.max_rows if outermost or counted else None
        try:
            if self._is_keyed:
                group = None if self.group is None else partial(_with_outer, self.group, outer)
                Ending(form, group, settings.limit, settings.offset or 0, most).finish(found, results, answer)
            else:
                self._stream(found, results, settings.limit, settings.offset or 0, most)
        finally:
            every.close()  # so that a search hands on what it has counted
            self._flush()
        return answer

    @property
    def _is_keyed(self) -> bool:
        """Whether the results come with keys, because something has to be done with them when all are found."""
        return bool(self.form.query.grouped or self.form.query.order)

    def _found(self, bound: int | None, outer: tuple[Any, ...]) -> Generator[Any, None, None]:
        """The results as they are found; `bound` is MEMORIZE's."""
        search, form = self.form.query.search, self.form.search
        if search is None or form is None:
            return self.find(*outer)  # type: ignore[no-any-return]
        starts, function, keys, key_of, pieces = self.find(*outer)
        problem = Problem(
            starts if key_of is None or search.repeats != "unique" else _different_starts(starts, key_of),
            function,
            search.repeats,
            likeliest=search.order == "probability",
            weighed=search.weight is not None,
            keyed=keys is not None,
            alone=len(form.shapes.columns) == 1,
            apart=bool(search.key),
            visits=key_of is not None,
            last=self.form.query.last,
            key_of=key_of or id,
            found=self._look,
        )
        watched = Watched(self.run.trace, self.form.query, problem) if form.watched else None
        problem = problem if watched is None else watched.problem
        if search.repeats == "memorize" and (watched is not None or not search.plain):
            shown = None if search.plain else pieces
            found = ByKey(self.form.query, problem, bound, self.run.check, form.shapes.thawing(), shown).paths()
            return self._paths(found, keys, None)
        if search.repeats == "memorize":
            hunt = self._hunt(search, form, problem, bound, pieces and Pieces(*pieces))
            return self._paths((self.form.find or memorize)(hunt), keys, None)
        expand = problem.expand if form.watched else self._expand(form, function)
        problem = replace(problem, expand=expand, watch=watcher(self.run, form.leveled, self._flush))
        found = (function if form.inlined else search_of(search))(problem)
        return self._paths(found if watched is None else watched.found(found), keys, form.shapes.thawing())

    def _look(self, total: Any, guess: Any) -> None:
        self.run.overestimated |= exceeds(guess, total)

    def _flush(self) -> None:
        if self.flush is not None:
            self.flush()

    def _hunt(
        self, search: plan.Search, form: SearchForm, problem: Problem, bound: int | None, pieces: Pieces | None
    ) -> Hunt:
        """The search that makes the graph of MEMORIZE."""
        return Hunt(
            start=form.shapes.thaw(problem.starts[0]),
            problem=problem,
            shapes=form.shapes,
            grow=problem.expand if form.inlined else None,  # type: ignore[arg-type]
            order=search.order,
            bound=bound,
            stats=self.run.stats,
            check=self.run.check,
            query=self.form.query,
            run=self.run,
            pieces=pieces,
            flush=self._flush,
            keyed=problem.keyed,
        )

    def _expand(self, form: SearchForm, expand: Expand) -> Expand:
        """The step function, with a memory where states come again."""
        run, most = self.run, self.run.host.memo_limit
        if not form.remembered:
            return expand
        compares = self.form.query.search is not None and self.form.query.search.repeats == "no cycle"
        if not most:
            return (lambda state, closed: expand(state, closed, ignore)) if compares else expand
        return RememberedSteps(expand, most, looks_of(run), partial(counts_of(run), 0, 0), compares).expand

    def _paths(
        self, found: Iterator[Found], keys: Callable[[Any], Row] | None, thaw: Thaw | None
    ) -> Generator[Any, None, None]:
        """The results, with values in the place of frozen ones."""
        try:
            if keys is None and not self.form.query.last:
                paths = map(itemgetter(0), found)
                yield from paths if thaw is None else map(thaw, paths)
            else:
                for path, last in found:
                    shown: Any = path if thaw is None or self.form.query.aggregated else thaw(path)
                    if self.form.query.last:
                        shown = shown[-1]
                    yield shown if keys is None else (None if self.form.query.aggregated else shown, keys(last))
        finally:
            if isinstance(found, Generator):
                found.close()  # it may hold tables of a database, and an error that is kept would hold it

    def _stream(
        self, found: Iterator[Any], results: list[Any], limit: int | None, offset: int, most: int | None
    ) -> None:
        """Fills `results`, of which there must not be more than `most`."""
        if limit is not None:
            found = islice(found, offset, offset + limit)
            most = None if most is None or limit <= most else most
        results.extend(found if most is None else islice(found, most + 1))
        if most is not None and len(results) > most:
            raise too_many(most, self.form.query.span)


def _different_starts(starts: list[State], key_of: Callable[[State], Hashable]) -> list[State]:
    """The first of equal starts."""
    by_key: dict[Hashable, State] = {}
    for start in starts:
        by_key.setdefault(key_of(start), start)
    return list(by_key.values())


def _none_found() -> Generator[Any, None, None]:
    yield from ()


def _first(every: Iterator[Any], maximum: int, answer: Rows) -> Iterator[Any]:
    """The first results; the answer hears it if there are as many, and no other one is looked for."""
    for number, result in enumerate(every, 1):
        answer.ended = number == maximum
        yield result
        if answer.ended:
            return


def _different(every: Iterator[Any], keyed: bool) -> Iterator[Any]:
    """The first of equal paths, which may come with keys."""
    met: set[Hashable] = set()
    for result in every:
        key = tuple(tuple(map(freeze, row)) for row in (result[0] if keyed else result))
        if key not in met:
            met.add(key)
            yield result


def _with_outer(function: Callable[..., Any], outer: tuple[Any, ...], *seen: Any) -> Any:
    return function(*seen, *outer)


# --- what generated code calls -------------------------------------------------------------------------


def task_of(run: Run, form: Form, *functions: Any) -> Task:
    return Task(run, form, *functions)


def value_of(task: Task) -> Callable[..., Any]:
    return task.value


def tuples_of(task: Task) -> Callable[..., list[Row]]:
    return task.tuples
