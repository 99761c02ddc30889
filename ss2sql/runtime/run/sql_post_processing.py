"""Sorting, cutting and partitioning that a lowered query leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.rows import Rows
from ss2sql.language.values import make_hashable, sort_rows
from ss2sql.lowering.sql_query import SqlQuery
from ss2sql.runtime.run.search_paths import SearchPaths


def finish_sql_rows(lowered: SqlQuery, sink: Rows, extras: Sequence[tuple[Any, Any]], kept: slice) -> Rows:
    """Sorting, cutting and partitioning that SQL left over; `kept` is what LIMIT and OFFSET keep."""
    query = lowered.query
    order: Sequence[int] = range(len(extras))
    if lowered.orders:
        descending = tuple(key.descending for key in query.order)
        try:
            order = sort_rows(list(order), [extras[index][1] for index in order], descending)
        except ExecutionError as error:
            raise error.with_span(query.order[0].expr.span) from None
    if kept.stop is not None and not lowered.limited:
        order = list(order[kept])
    if query.group and not query.aggregated:
        members: dict[Any, list[int]] = {}
        shown: dict[Any, Any] = {}
        for position, index in enumerate(order):
            keys = extras[index][0]
            key = tuple(map(make_hashable, keys))
            shown.setdefault(key, keys[0] if len(keys) == 1 else keys)
            members.setdefault(key, []).append(position)
        sink.groups = [(make_group_key(shown[key]), positions) for key, positions in members.items()]
    if sink.paths is not None:
        sink.paths = sink.paths.choose_paths(order) if isinstance(sink.paths, SearchPaths) else []
    elif not isinstance(order, range):
        assert sink.rows is not None
        sink.rows = [sink.rows[index] for index in order]
    return sink


def make_group_key(value: Any) -> Any:
    """A group's value as the key of a dict: lists become tuples, dicts tuples of pairs."""
    if isinstance(value, dict):
        return make_group_key(list(value.items()))
    return tuple(map(make_group_key, value)) if isinstance(value, (list, tuple)) else value
