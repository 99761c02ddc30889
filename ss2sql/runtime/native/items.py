"""What the loops of generated code walk: helpers that it calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

from ss2sql import plan
from ss2sql.runtime.native.pace import Pace
from ss2sql.runtime.run import Run
from ss2sql.runtime.sources import column_of, elements
from ss2sql.vtables.frames.frame import Frame


def accompanied(items: list[Any], *makers: Callable[[Any], Any]) -> list[tuple[Any, ...]]:
    """The items, each with what the makers make of it."""
    return list(zip(items, *(map(maker, items) for maker in makers), strict=True))


def columns_of(value: Any, *names: str) -> list[tuple[Any, ...]]:
    """Columns of the dicts that are the elements of a value."""
    return [tuple([element.get(name) for name in names]) for element in elements(value)]


def rows_of_frame(source: Any, *names: str) -> list[tuple[Any, ...]]:
    """The rows of a data frame, or of what a function of the user has put in its place."""
    if isinstance(source, Frame):
        return source.rows(names)
    return [tuple(column_of(element, name, None) for name in names) for element in elements(source)]


def table_rows(run: Run, table: plan.TableSource) -> list[tuple[Any, ...]]:
    return run.host.table_rows(table)


def in_parts(run: Run, items: list[Any]) -> Iterator[Any]:
    """The items of a loop that ends when the run has to end; to count them takes 0.02 us more for each."""
    return chain.from_iterable(_parts(Pace(run).next, items))


def _parts(pace: Callable[[int], int], items: list[Any]) -> Iterator[list[Any]]:
    start = 0
    while start < len(items):
        end = pace(start)
        yield items[start:end]
        start = end
