"""Running a compiled query: finding its results, and GROUP BY, HAVING, ORDER BY and LIMIT after that."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from operator import itemgetter
from typing import Any, TypeAlias

from ss2sql import plan
from ss2sql.errors import Error, ExecutionError
from ss2sql.runtime.builtins import AGGREGATES
from ss2sql.runtime.memorize.pieces import Pieces
from ss2sql.runtime.native.searches import SEARCHES, Hunt
from ss2sql.runtime.rows import Row, Rows
from ss2sql.runtime.run import Run
from ss2sql.runtime.values import freeze, sort_rows

# A result with what is evaluated of it besides its columns: arguments of aggregates, GROUP BY, ORDER BY.
Keyed: TypeAlias = tuple[Any, Row]


@dataclass(frozen=True, slots=True)
class Form:
    """What is known of a query when it is compiled."""

    query: plan.Query
    columns: tuple[str, ...]
    aggregates: tuple[plan.Aggregate, ...]
    groups: int
    descending: tuple[bool, ...]

    @staticmethod
    def of(query: plan.Query, aggregates: tuple[plan.Aggregate, ...]) -> Form:
        columns = tuple(output.name for output in query.columns)
        return Form(query, columns, aggregates, len(query.group), tuple(key.descending for key in query.order))


@dataclass(frozen=True, slots=True)
class Settings:
    """The values of LIMIT, MAXIMUM and MEMORIZE's bound, and the names of the columns where `to` computes one."""

    limit: int | None = None
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
        return self.shaped(self.rows(outer), outer)

    def shaped(self, rows: Rows, outer: tuple[Any, ...] = ()) -> Any:
        """What the query's representation makes of its answer."""
        arguments, named = self.arguments(*outer) if self.arguments else ((), {})
        return self.run.host.shape(self.form.query, rows, arguments, named)

    def tuples(self, *outer: Any) -> list[Row]:
        """The rows of a query whose results are rows."""
        rows = self.rows(outer).rows
        assert rows is not None
        return rows

    def stream(self) -> Iterator[Row]:
        """The rows of a query whose results are rows, one by one where nothing follows after they were found."""
        found, keyed = self._results(NO_SETTINGS, (), False)
        return iter(self.tuples()) if keyed else found

    def rows(self, outer: tuple[Any, ...] = (), sink: Rows | None = None, outermost: bool = False) -> Rows:
        """The answer of the query, in `sink` where one is given. The run's limits hold for the `outermost` query."""
        form, query = self.form, self.form.query
        settings = Settings(*self.settings(*outer)) if self.settings else NO_SETTINGS
        found, keyed = self._results(settings, outer, outermost)
        answer = Rows(form.columns) if sink is None else sink
        if settings.labels is not None:
            answer.columns = distinct(settings.labels)
        results: list[Any] = []
        if query.search is None or query.aggregated:
            answer.rows, answer.paths = results, None
        else:
            answer.rows, answer.paths = None, results
        most = self.run.max_rows if outermost else None
        try:
            if keyed:
                ending = Ending(self, settings.limit, most, outer)
                ending.finish(found, results, answer)
            else:
                self._stream(found, results, settings.limit, most)
        finally:
            if self.flush is not None:
                self.flush()
        return answer

    def _results(self, settings: Settings, outer: tuple[Any, ...], outermost: bool) -> tuple[Iterator[Any], bool]:
        """The results, and whether they come with keys."""
        query, search = self.form.query, self.form.query.search
        keyed = bool(query.group or query.order)
        if search is None:
            return self.find(*outer), keyed
        start, steps, keys, pieces = self.find(*outer)
        stats, check = self.run.stats, self.run.check
        taken_apart = pieces and Pieces(*pieces)
        hunt = Hunt(start, steps, search.order, settings.bound, stats, check, query, self.run, taken_apart)
        found = SEARCHES[search.order, search.repeats](hunt)
        counts = [settings.maximum, self.run.maximum if outermost else None]
        known = [number for number in counts if number is not None]
        if known:
            found = islice(found, min(known))
        if not keyed:
            return map(itemgetter(0), found), keyed
        return ((None if query.aggregated else path, keys(last)) for path, last in found), keyed

    def _stream(self, found: Iterator[Any], results: list[Any], limit: int | None, most: int | None) -> None:
        """Fills `results`, of which there must not be more than `most`."""
        if limit is not None and (most is None or limit <= most):
            found, most = islice(found, limit), None
        results.extend(found if most is None else islice(found, most + 1))
        if most is not None and len(results) > most:
            raise too_many(self.form.query, most)


class Ending:
    """What happens to the results of one query after they were found."""

    def __init__(self, task: Task, limit: int | None, most: int | None, outer: tuple[Any, ...]) -> None:
        self.form = task.form
        self.query = task.form.query
        self.group = None if task.group is None else partial(_with_outer, task.group, outer)
        self.limit = limit
        self.most = None if limit is not None and most is not None and limit <= most else most

    def finish(self, found: Iterator[Keyed], results: list[Any], answer: Rows) -> None:
        """Fills `results`, and the groups of the answer where there are partitions."""
        if self.query.aggregated:
            self._aggregate(found, results)
            return
        keys: list[Row] = []
        for result, key in found:
            results.append(result)
            keys.append(key)
            self._room(len(results))
        positions = list(range(len(results)))
        if self.group is not None:
            positions = self._having(keys)
        first = len(self.form.aggregates) + self.form.groups
        if self.form.descending:
            positions = self._sorted(positions, [keys[at][first:] for at in positions])
        positions = positions[: self.limit]
        results[:] = [results[at] for at in positions]
        if self.query.group:
            answer.groups = self._partitions([keys[at] for at in positions])

    def _sorted(self, results: list[Any], keys: list[Row]) -> list[Any]:
        try:
            return sort_rows(results, keys, self.form.descending)
        except Error as error:
            raise error.located(self.query.order[0].expr.span) from None

    def _room(self, number: int) -> None:
        if self.most is not None and number > self.most:
            raise too_many(self.query, self.most)

    # --- groups ----------------------------------------------------------------------------------------

    def _aggregate(self, found: Iterator[Keyed], results: list[Any]) -> None:
        """One row per group; HAVING, the columns and the keys of ORDER BY for one group after the other."""
        assert self.group is not None
        groups: dict[Hashable, list[Row]] = {}
        for _, key in found:
            groups.setdefault(self._group_key(key), []).append(key)
        order: list[Row] = []
        for members in groups.values():
            made = self.group(self._seen_of(members))
            if made is not None:
                results.append(made[0])
                order.append(made[1])
                self._room(len(results))
        if self.form.descending:
            results[:] = self._sorted(results, order)
        if self.limit is not None:
            del results[self.limit :]

    def _having(self, keys: list[Row]) -> list[int]:
        """The positions of the results whose groups HAVING keeps."""
        assert self.group is not None
        groups: dict[Hashable, list[int]] = {}
        for position, key in enumerate(keys):
            groups.setdefault(self._group_key(key), []).append(position)
        kept: list[int] = []
        for members in groups.values():
            if self.group(self._seen_of([keys[at] for at in members])) is not None:
                kept.extend(members)
        return sorted(kept)

    def _partitions(self, keys: list[Row]) -> list[tuple[Any, list[int]]]:
        """The value and the members of each group, in order of first appearance."""
        groups: dict[Hashable, tuple[Any, list[int]]] = {}
        for position, key in enumerate(keys):
            known = groups.get(self._group_key(key))
            if known is None:
                values = self._group_values(key)
                shown = _shown(values[0] if len(values) == 1 else values)
                known = groups[self._group_key(key)] = (shown, [])
            known[1].append(position)
        return list(groups.values())

    def _group_values(self, key: Row) -> Row:
        first = len(self.form.aggregates)
        return key[first : first + self.form.groups]

    def _group_key(self, key: Row) -> Hashable:
        values = self._group_values(key)
        return freeze(values[0]) if len(values) == 1 else tuple(map(freeze, values))

    def _seen_of(self, members: list[Row]) -> Row:
        """What is seen of a group: its aggregates, then its values."""
        columns = zip(*members, strict=True)
        aggregates = [_aggregate(node, values) for node, values in zip(self.form.aggregates, columns, strict=False)]
        return (*aggregates, *self._group_values(members[0]))


def _aggregate(node: plan.Aggregate, values: Iterable[Any]) -> Any:
    try:
        return AGGREGATES[node.function](values)
    except Error as error:
        raise error.located(node.span) from None


def _with_outer(function: Callable[..., Any], outer: tuple[Any, ...], seen: Row) -> Any:
    return function(*seen, *outer)


def _shown(value: Any) -> Any:
    """A group's value as the key of a dict: lists become tuples, dicts tuples of pairs."""
    if isinstance(value, (list, tuple)):
        return tuple(map(_shown, value))
    return _shown(list(map(list, value.items()))) if isinstance(value, dict) else value


def too_many(query: plan.Query, most: int) -> ExecutionError:
    """The error for more results than the run allows."""
    hints = ("add LIMIT or MAXIMUM to the query, or raise max_rows",)
    return ExecutionError("X010", f"the query has more than max_rows={most} results", query.span, hints)


def distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names of columns, a repeated one with `_2`, then `_3`."""
    taken: dict[str, None] = {}
    for name in names:
        free, number = name, 1
        while free in taken:
            number += 1
            free = f"{name}_{number}"
        taken[free] = None
    return tuple(taken)


# --- what generated code calls -------------------------------------------------------------------------


def task_of(run: Run, form: Form, *functions: Any) -> Task:
    return Task(run, form, *functions)


def value_of(task: Task) -> Callable[..., Any]:
    return task.value


def tuples_of(task: Task) -> Callable[..., list[Row]]:
    return task.tuples
