"""What becomes of the results of a query after they were found: GROUP BY, HAVING, ORDER BY and LIMIT."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from itertools import chain, compress, islice, takewhile
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import list_parts, walk_own
from ss2sql.language.rows import Row, Rows, build_row_limit_error
from ss2sql.language.values import make_hashable, order_positions, order_rows
from ss2sql.lowering.sql_query import SqlQuery
from ss2sql.runtime.run.search_paths import SearchPaths

if TYPE_CHECKING:
    from ss2sql.runtime.python.search_compiler import SearchForm
    from ss2sql.runtime.run.key_order import RowOrder
    from ss2sql.runtime.search.search_run import FindPaths


@dataclass(frozen=True, slots=True)
class QueryForm:
    """What is known of a query when it is compiled; `find` finds the results of a search that goes by levels."""

    query: plan.Query
    columns: tuple[str, ...]
    aggregates: tuple[plan.Aggregate, ...]
    groups: int
    descending: tuple[bool, ...]
    search: SearchForm | None = None
    find: FindPaths | None = None

    @staticmethod
    def for_query(
        query: plan.Query,
        aggregates: tuple[plan.Aggregate, ...],
        search: SearchForm | None = None,
        find: FindPaths | None = None,
    ) -> QueryForm:
        columns, descending = tuple(output.name for output in query.columns), tuple(k.descending for k in query.order)
        return QueryForm(query, columns, aggregates, len(query.group), descending, search, find)


class PostProcessing:
    """What happens to the results of one query after they were found.

    `group` gives of groups, seen as their aggregates and keys, the row and the sort keys of each that HAVING keeps;
    where there are partitions, whether it keeps them. `row_order` tells once there is a row whether they come sorted
    by the first key.
    """

    def __init__(
        self,
        form: QueryForm,
        group: Callable[[Iterable[Row]], Iterator[Any]] | None,
        limit: int | None,
        offset: int,
        most: int | None,
        row_order: RowOrder | None,
    ) -> None:
        self.row_order = row_order
        self.form = form
        self.query = form.query
        self.group = group
        self.end = None if limit is None else offset + limit
        self.kept = slice(offset, self.end)
        self.most = None if limit is not None and most is not None and limit <= most else most

    def finish(self, found: Iterator[Any], results: list[Any], answer: Rows) -> None:
        """Fills `results`, and the groups of the answer where there are partitions."""
        if self.query.aggregated:
            self._make_group_rows(found, results)
            return
        if self.query.search is None and not self.query.group:
            self.sort_rows(found, results)
            return
        keys: list[Row] = []
        try:
            results.extend(self._check_number(found))
        finally:
            keys += [key for _, key in results]
            results[:] = [result for result, _ in results]
        self._check_room(len(results))
        places = list(range(len(results)))
        if self.group is not None:
            places = self._filter_groups(keys)
        if self.form.descending:
            first = len(self.form.aggregates) + self.form.groups
            places = self._sort_results(places, [keys[at][first:] for at in places])
        places = places[self.kept]
        results[:] = [results[at] for at in places]
        if self.query.group:
            answer.groups = group_positions([self._group_values(keys[at]) for at in places])

    def sort_rows(self, found: Iterator[Any], results: list[Any]) -> None:
        """ORDER BY of a flat query: its keys stand after the columns of its rows."""
        width, whole = len(self.form.columns), list[Row]()
        try:
            whole.extend(islice(found, 1))
            if self.row_order is not None and self.row_order.kept and self.end is not None:
                whole.extend(islice(found, max(0, self.end - 1)))
                if len(self.form.descending) == 1 or not whole:
                    whole = whole[self.kept]
                    return
                last = whole[-1][width]
                whole.extend(takewhile(lambda row: row[width] == last, found))
            else:
                whole.extend(self._check_number(found))
            self._check_room(len(whole))
            columns = [list(map(itemgetter(width + number), whole)) for number in range(len(self.form.descending))]
            whole = [whole[at] for at in self._sort_places(len(whole), columns)[self.kept]]
        finally:
            results += [row[:width] for row in whole]

    def _sort_results(self, results: list[Any], keys: list[Row]) -> list[Any]:
        columns = list(zip(*keys, strict=True)) or [()] * len(self.form.descending)
        return [results[at] for at in self._sort_places(len(results), columns)]

    def _sort_places(self, count: int, columns: Sequence[Sequence[Any]]) -> list[int]:
        """The places of results in the order of their keys; of those beyond LIMIT none may be there."""
        try:
            return order_positions(count, columns, self.form.descending, self.end)
        except Error as error:
            raise error.with_span(self.query.order[0].expr.span) from None

    def _check_number(self, found: Iterator[Any]) -> Iterator[Any]:
        """The results, if there are not too many, else one too many."""
        return found if self.most is None else islice(found, self.most + 1)

    def _check_room(self, number: int) -> None:
        if self.most is not None and number > self.most:
            raise build_row_limit_error(self.most, self.query.span)

    # --- groups ----------------------------------------------------------------------------------------

    def _make_group_rows(self, found: Iterator[Any], results: list[Any]) -> None:
        """One row per group; HAVING, the columns and the keys of ORDER BY for one group after the other.

        Of a flat query `found` are the groups already, of a search the members of all groups.
        """
        assert self.group is not None
        order: list[Row] = []
        for row, keys in self.group(found if self.query.search is None else self._list_values_of_all(found)):
            results.append(row)
            order.append(keys)
            self._check_room(len(results))
        if self.form.descending:
            results[:] = self._sort_results(results, order)
        if self.end is not None:
            results[:] = results[self.kept]

    def _list_values_of_all(self, found: Iterator[Any]) -> Iterator[Row]:
        groups: dict[Hashable, list[Row]] = {}
        for _, key in found:
            groups.setdefault(self._group_key(key), []).append(key)
        if not groups and not self.form.groups:
            return iter([((),) * len(self.form.aggregates)])
        return map(self._list_group_values, groups.values())

    def _filter_groups(self, keys: list[Row]) -> list[int]:
        """The positions of the results whose groups HAVING keeps."""
        assert self.group is not None
        groups: dict[Hashable, list[int]] = {}
        for position, key in enumerate(keys):
            groups.setdefault(self._group_key(key), []).append(position)
        seen = (self._list_group_values([keys[at] for at in members]) for members in groups.values())
        return sorted(chain.from_iterable(compress(groups.values(), self.group(seen))))

    def _group_values(self, key: Row) -> Row:
        first = len(self.form.aggregates)
        return key[first : first + self.form.groups]

    def _group_key(self, key: Row) -> Hashable:
        values = self._group_values(key)
        return make_hashable(values[0]) if len(values) == 1 else tuple(map(make_hashable, values))

    def _list_group_values(self, members: list[Row]) -> Row:
        """What is seen of a group: what its aggregates are computed of, then its values."""
        columns = zip(*members, strict=True)
        return (*islice(columns, len(self.form.aggregates)), *self._group_values(members[0]))


def find_grouped_aggregates(query: plan.Query) -> list[plan.Aggregate]:
    """The aggregates over the rows of the query's groups, in the order in which their arguments are evaluated."""
    if not query.grouped:
        return []
    places: list[Any] = [output.expr for output in query.columns] if query.aggregated else []
    places += [query.having] if query.having is not None else []
    places += [key.expr for key in query.order] if query.aggregated else []
    found = (node for place in places for node in walk_own(place) if isinstance(node, plan.Aggregate))
    return list({id(node): node for node in found}.values())  # equal ones are one


def find_certain_aggregates(query: plan.Query) -> list[plan.Aggregate]:
    """The aggregates that are computed of every group: no HAVING, AND, OR or IF keeps from it."""
    found, ahead = list[plan.Aggregate](), list[Any]()
    if query.having is not None:
        ahead.append(query.having)
    elif query.aggregated:
        ahead += [*(output.expr for output in query.columns), *(key.expr for key in query.order)]
    while ahead:
        match ahead.pop():
            case plan.Aggregate() as node:
                found.append(node)
            case plan.And(parts=(first, *_)) | plan.Or(parts=(first, *_)) | plan.If(condition=first):
                ahead.append(first)
            case plan.Query():
                continue
            case node:
                ahead += list_parts(node)
    return found


def is_row_count(node: plan.Aggregate) -> bool:
    """Whether an aggregate is the number of rows, whatever their values are."""
    return node.function == "count" and (node.argument is None or not node.argument.type.may_be(Kind.NONE))


def make_group_aggregation(node: plan.Aggregate) -> Callable[[list[Any]], Any]:
    """What computes an aggregate of a group's values. None is skipped where there may be any."""
    if is_row_count(node):
        return len
    assert node.argument is not None
    known, row = node.argument.type, GROUPS[node.function]
    if known.may_be(Kind.NONE) or node.may_be_empty:
        return row.aggregate_group
    form = next((form for form in row.python if form.when([known])), None)
    return row.value if form is None or isinstance(form.text, str) else form.text


# --- sorting, cutting and partitioning that a lowered query leaves over
def finish_sql_rows(lowered: SqlQuery, sink: Rows, extras: Sequence[tuple[Any, Any]], kept: slice) -> Rows:
    """Sorting, cutting and partitioning that SQL left over; `kept` is what LIMIT and OFFSET keep."""
    query = lowered.query
    order: Sequence[int] = range(len(extras))
    if lowered.orders:
        descending = tuple(key.descending for key in query.order)
        try:
            order = order_rows(list(order), [extras[index][1] for index in order], descending)
        except ExecutionError as error:
            raise error.with_span(query.order[0].expr.span) from None
    if kept.stop is not None and not lowered.limited:
        order = list(order[kept])
    if query.group and not query.aggregated:
        sink.groups = group_positions([extras[index][0] for index in order])
    if sink.paths is not None:
        sink.paths = sink.paths.choose_paths(order) if isinstance(sink.paths, SearchPaths) else []
    elif not isinstance(order, range):
        assert sink.rows is not None
        sink.rows = [sink.rows[index] for index in order]
    return sink


def group_positions(rows: Iterable[Row]) -> list[tuple[Any, list[int]]]:
    """The value and the members of each group, in order of first appearance; `rows` are the values of GROUP BY."""
    shown: dict[Hashable, Row] = {}
    members: dict[Hashable, list[int]] = {}
    for position, values in enumerate(rows):
        key = tuple(map(make_hashable, values))
        shown.setdefault(key, values)
        members.setdefault(key, []).append(position)
    return [(_make_group_key(values[0] if len(values) == 1 else values), members[key]) for key, values in shown.items()]


def _make_group_key(value: Any) -> Any:
    """A group's value as the key of a dict: lists become tuples, dicts tuples of pairs."""
    if isinstance(value, dict):
        return _make_group_key(list(value.items()))
    return tuple(map(_make_group_key, value)) if isinstance(value, (list, tuple)) else value
