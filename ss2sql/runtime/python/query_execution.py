"""Running a compiled query: what its loops call, how its results are found, and what comes after that.

Iterations of a loop may take a tenth of a microsecond or, with a slow function, seconds. So the turns between two
looks at the clock are counted, and their number follows the time that they took. What comes after the results were
found is in run/post_processing.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from functools import partial
from itertools import chain, islice
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import read_column
from ss2sql.language.rows import Row, Rows, build_row_limit_error, make_unique_column_names
from ss2sql.language.values import make_hashable
from ss2sql.runtime.run.calls import make_call_key
from ss2sql.runtime.run.post_processing import PostProcessing, QueryForm
from ss2sql.runtime.run.run_state import Run, find_lowest_run_limit
from ss2sql.vtables.frames import Frame, list_source_elements

if TYPE_CHECKING:
    from ss2sql.lowering.flat import TableFilter
    from ss2sql.runtime.run.key_order import RowOrder


QUICK, SLOW = 0.002, 0.01  # seconds between two looks: below the one there may be more turns, above the other fewer
MAX_TURNS = 128
TURNS_PER_CHECK = 64  # so many turns are quick enough not to look at the clock between them


class ClockChecks:
    """Ends the run where it has to end, and says at which turn to look again."""

    def __init__(self, run: Run) -> None:
        self._check = run.check
        self._turns = 1
        self._last = time.perf_counter()

    def check_clock(self, turn: int) -> int:
        self._check()
        now = time.perf_counter()
        if now - self._last < QUICK:
            self._turns = min(2 * self._turns, MAX_TURNS)
        elif now - self._last > SLOW:
            self._turns = max(self._turns // 4, 1)
        self._last = now
        return turn + self._turns


def make_turn_check(run: Run) -> Callable[[int], int]:
    return ClockChecks(run).check_clock


def make_step_meter(run: Run) -> Callable[[int, int, int], int]:
    """Adds what searches have counted since the last look, and ends the run where it has to end.

    Gives the number of steps until the next look.
    """
    count, check_turn = make_count_report(run), ClockChecks(run).check_clock

    def count_steps(generated: int, expanded: int, pruned: int) -> int:
        count(generated, expanded, pruned)
        return check_turn(0)

    return count_steps


def make_count_report(run: Run) -> Callable[[int, int, int], None]:
    """Hands on to the run what a search has counted."""
    stats = run.stats

    def add_counts(generated: int, expanded: int, pruned: int) -> None:
        stats.generated += generated
        stats.expanded += expanded
        stats.pruned += pruned

    return add_counts


def make_known_steps_check(run: Run) -> Callable[[int], None]:
    """Counts the steps of a state that were known, and looks at the clock now and then."""
    stats, check_turn = run.stats, ClockChecks(run).check_clock
    steps, due = 0, 1

    def check_steps(elements: int) -> None:
        nonlocal steps, due
        stats.generated += elements
        stats.expanded += 1
        steps += elements
        if steps >= due:
            due = check_turn(steps)

    return check_steps


# --- what the loops of generated code walk: helpers that it calls
def list_elements_with_keys(items: list[Any]) -> list[tuple[Any, bytes]]:
    """The items, each with its exact key as an argument of a call."""
    return [(item, make_call_key(item)) for item in items]


def loop_over_dict_columns(value: Any, *names: str) -> list[tuple[Any, ...]]:
    """Columns of the dicts that are the elements of a value."""
    return [tuple([element.get(name) for name in names]) for element in list_source_elements(value)]


def loop_over_frame_rows(source: Any, *names: str) -> list[tuple[Any, ...]]:
    """The rows of a data frame, or of what a function of the user has put in its place."""
    if isinstance(source, Frame):
        return source.list_rows(names)
    return [tuple(read_column(element, name, None) for name in names) for element in list_source_elements(source)]


def loop_over_table_rows(
    run: Run, table: plan.TableSource, wanted: TableFilter | None = None, give: Callable[[], Sequence[Any]] = tuple
) -> list[tuple[Any, ...]]:
    """The rows of a table, without what a filter leaves out for the values that a function gives."""
    try:
        wanted = None if wanted is None else wanted.bind_values(give())
    except NameError:  # a variable has no value, which only a row may miss
        wanted = None
    return run.host.read_table_rows(table, run, wanted)


def iterate_with_checks(run: Run, items: list[Any]) -> Iterator[Any]:
    """The items of a loop that ends when the run has to end; to count them takes 0.02 us more for each."""
    return chain.from_iterable(_loop_over_parts(ClockChecks(run).check_clock, items))


def _loop_over_parts(check_turn: Callable[[int], int], items: list[Any]) -> Iterator[list[Any]]:
    start = 0
    while start < len(items):
        end = check_turn(start)
        yield items[start:end]
        start = end


# --- a query that runs
@dataclass(frozen=True, slots=True)
class QuerySettings:
    """The values of LIMIT, OFFSET, MAXIMUM and MEMORIZE's bound, and the names of columns where `to` computes one."""

    limit: int | None = None
    offset: int | None = None
    maximum: int | None = None
    bound: int | None = None
    labels: tuple[str, ...] | None = None


NO_SETTINGS = QuerySettings()
NOT_CUT = (None, None)  # LIMIT and OFFSET


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
    row_order: RowOrder | None

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
                finishing = PostProcessing(form, group, settings.limit, settings.offset or 0, most, self.row_order)
                finishing.finish(found, results, answer)
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


def _shows_part_of_source(query: plan.Query) -> bool:
    """Whether the rows are a part of a list that there is already, so that they fit where it fits."""
    (source, *others), outputs = query.sources, [output.expr for output in query.columns]
    known = isinstance(source, plan.ValueSource) and isinstance(source.value, plan.Variable) and not others
    return known and len(outputs) == 1 and isinstance(outputs[0], (plan.Element, plan.Column))


# --- what generated code calls -------------------------------------------------------------------------


def get_value_function(task: QueryExecution) -> Callable[..., Any]:
    """What gives the query's value; straight from its loop where its rows, sorted and cut, are all that is wanted.

    An inner query that finds one row takes 2 us so, sorted 4 us, else 7 us.
    """
    query, find, settings = task.form.query, task.find, task.settings
    named = any(output.star or output.label for output in query.columns)
    if query.search or query.grouped or query.distinct or named or task.run.max_rows is not None:
        return task.compute_value
    shapes, sizes = task.run.host.shapes, task.run.sizes
    shape = shapes.find_row_shape(query.representation, task.form.columns, sizes, _shows_part_of_source(query))
    if shape is None:
        return task.compute_value
    if settings is None and not query.order:
        return lambda *outer: shape(list(find(*outer)))

    def compute_value(*outer: Any) -> Any:
        limit, offset, *_ = NOT_CUT if settings is None else settings(*outer)
        rows: list[Any] = []
        if query.order:
            PostProcessing(task.form, None, limit, offset or 0, None, task.row_order).sort_rows(find(*outer), rows)
        else:
            rows.extend(islice(find(*outer), offset or 0, None if limit is None else limit + (offset or 0)))
        return shape(rows)

    return compute_value
