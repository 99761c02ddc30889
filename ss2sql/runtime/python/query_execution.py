"""Running a compiled query: finding its results, and what comes after that, see post_processing.py."""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator
from functools import partial
from itertools import islice
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.rows import Row, Rows, build_row_limit_error, make_unique_column_names
from ss2sql.language.values import make_hashable
from ss2sql.runtime.run.option_checks import find_lowest_run_limit
from ss2sql.runtime.run.post_processing import PostProcessing, QueryForm
from ss2sql.runtime.run.run_state import Run


@dataclass(frozen=True, slots=True)
class QuerySettings:
    """The values of LIMIT, OFFSET, MAXIMUM and MEMORIZE's bound, and the names of columns where `to` computes one."""

    limit: int | None = None
    offset: int | None = None
    maximum: int | None = None
    bound: int | None = None
    labels: tuple[str, ...] | None = None


NO_SETTINGS = QuerySettings()


@dataclass(frozen=True, slots=True)
class QueryExecution:
    """A query bound to a run. The functions are generated; they take the values of outer queries that it reads."""

    run: Run
    form: QueryForm
    settings: Callable[..., tuple[Any, ...]] | None
    find: Callable[..., Any]
    group: Callable[..., Iterator[Any]] | None
    arguments: Callable[..., tuple[tuple[Any, ...], dict[str, Any]]] | None
    flush: Callable[[], None] | None

    def compute_value(self, *outer: Any) -> Any:
        """The query's value, as its representation makes it."""
        counted = self.form.query.representation.name != "value"  # of which the first row alone is kept
        return self.shape_rows(self.compute_rows(outer, counted=counted), outer)

    def shape_rows(self, rows: Rows, outer: tuple[Any, ...] = ()) -> Any:
        """What the query's representation makes of its answer."""
        arguments, named = self.arguments(*outer) if self.arguments else ((), {})
        return self.run.host.shapes.represent_subquery(self.form.query, rows, arguments, named, self.run.sizes)

    def compute_tuples(self, *outer: Any) -> list[Row]:
        """The rows of a query whose results are rows."""
        rows = self.compute_rows(outer).rows
        assert rows is not None
        return rows

    def compute_rows(
        self, outer: tuple[Any, ...] = (), sink: Rows | None = None, outermost: bool = False, counted: bool = False
    ) -> Rows:
        """The answer of the query, in `sink` where one is given. The run's limits hold for the `outermost` query;
        that of its rows for queries inside of others whose value is needed, which are `counted`.
        """
        form, query = self.form, self.form.query
        settings = QuerySettings(*self.settings(*outer)) if self.settings else NO_SETTINGS
        nothing = settings.limit == 0 and not self._needs_keys  # is evaluated then
        every = _yield_nothing() if nothing else self._find_results(settings, outer)
        answer = Rows(form.columns) if sink is None else sink
        maximum = find_lowest_run_limit(settings.maximum, self.run.maximum if outermost and query.search else None)
        found: Iterator[Any] = every if maximum is None else _take_first(every, maximum, answer)
        found = _drop_duplicates(found, self._needs_keys) if query.distinct else found
        if settings.labels is not None:
            answer.columns = make_unique_column_names(settings.labels)
        results: list[Any] = []
        if not query.gives_paths:
            answer.rows, answer.paths = results, None
        else:
            answer.rows, answer.paths = None, results
        most = self.run.max_rows if outermost or counted else None
        try:
            if self._needs_keys:
                group = None if self.group is None else partial(self.group, *outer)
                PostProcessing(form, group, settings.limit, settings.offset or 0, most).finish(found, results, answer)
            else:
                self._fill_results(found, results, settings.limit, settings.offset or 0, most)
        finally:
            every.close()  # so that a search hands on what it has counted
            self.report_counts()
        return answer

    @property
    def _needs_keys(self) -> bool:
        """Whether the results come with keys, because something has to be done with them when all are found."""
        return bool(self.form.query.grouped or self.form.query.order)

    def _find_results(self, settings: QuerySettings, outer: tuple[Any, ...]) -> Generator[Any, None, None]:
        """The results as they are found."""
        if self.form.query.search is None or self.form.search is None:
            return self.find(*outer)  # type: ignore[no-any-return]
        from ss2sql.runtime.python.search_execution import find_search_results

        return find_search_results(self, self.form.query.search, self.form.search, settings.bound, outer)

    def report_counts(self) -> None:
        """Hands on to the run what was counted."""
        if self.flush is not None:
            self.flush()

    def _fill_results(
        self, found: Iterator[Any], results: list[Any], limit: int | None, offset: int, most: int | None
    ) -> None:
        """Fills `results`, of which there must not be more than `most`."""
        if limit is not None:
            found = islice(found, offset, offset + limit)
            most = None if most is None or limit <= most else most
        results.extend(found if most is None else islice(found, most + 1))
        if most is not None and len(results) > most:
            raise build_row_limit_error(most, self.form.query.span)


def _yield_nothing() -> Generator[Any, None, None]:
    yield from ()


def _take_first(every: Iterator[Any], maximum: int, answer: Rows) -> Iterator[Any]:
    """The first results; the answer hears it if there are as many, and no other one is looked for."""
    for number, result in enumerate(every, 1):
        answer.ended = number == maximum
        yield result
        if answer.ended:
            return


def _drop_duplicates(every: Iterator[Any], keyed: bool) -> Iterator[Any]:
    """The first of equal paths, which may come with keys."""
    met: set[Hashable] = set()
    for result in every:
        key = tuple(tuple(map(make_hashable, row)) for row in (result[0] if keyed else result))
        if key not in met:
            met.add(key)
            yield result


# --- what generated code calls -------------------------------------------------------------------------


def get_value_function(task: QueryExecution) -> Callable[..., Any]:
    """What gives the query's value; straight from its loop where its rows are all that is wanted.

    An inner query that finds one row takes 2 us so, else 7 us.
    """
    query, find = task.form.query, task.find
    starred = any(output.star for output in query.columns)
    if query.search or query.grouped or query.order or query.distinct or starred or task.run.max_rows is not None:
        return task.compute_value
    shape = task.run.host.shapes.find_row_shape(query.representation, task.form.columns, task.run.sizes)
    if shape is None or task.settings is not None:
        return task.compute_value
    return lambda *outer: shape(list(find(*outer)))
