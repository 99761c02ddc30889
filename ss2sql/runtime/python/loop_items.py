"""What the loops of generated code walk: helpers that it calls."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

from ss2sql.language import plan
from ss2sql.language.element_columns import read_column
from ss2sql.runtime.python.loop_cancellation import ClockChecks
from ss2sql.runtime.run.elements import list_elements
from ss2sql.runtime.run.run_state import Run
from ss2sql.vtables.frames.frame import Frame


def attach_computed(items: list[Any], *makers: Callable[[Any], Any]) -> list[tuple[Any, ...]]:
    """The items, each with what the makers make of it."""
    return list(zip(items, *(map(maker, items) for maker in makers), strict=True))


def read_dict_columns(value: Any, *names: str) -> list[tuple[Any, ...]]:
    """Columns of the dicts that are the elements of a value."""
    return [tuple([element.get(name) for name in names]) for element in list_elements(value)]


def read_frame_rows(source: Any, *names: str) -> list[tuple[Any, ...]]:
    """The rows of a data frame, or of what a function of the user has put in its place."""
    if isinstance(source, Frame):
        return source.list_rows(names)
    return [tuple(read_column(element, name, None) for name in names) for element in list_elements(source)]


def read_table_rows(run: Run, table: plan.TableSource) -> list[tuple[Any, ...]]:
    return run.host.read_table_rows(table, run)


def iterate_with_checks(run: Run, items: list[Any]) -> Iterator[Any]:
    """The items of a loop that ends when the run has to end; to count them takes 0.02 us more for each."""
    return chain.from_iterable(_iterate_item_parts(run, ClockChecks(run).check_clock, items))


def _iterate_item_parts(run: Run, check_turn: Callable[[int], int], items: list[Any]) -> Iterator[list[Any]]:
    start, progress = 0, run.progress
    while start < len(items):
        if progress is not None:
            progress.note_walk(items, start, len(items))
        end = check_turn(start)
        yield items[start:end]
        start = end
    if progress is not None:
        progress.note_walk(items, start, start)


def iterate_with_progress(run: Run, items: Sequence[Any]) -> Iterable[Any]:
    """The items of the outermost of several loops, of which the line of progress shows how many are done."""
    return items if run.progress is None else _report_progress(run, items)


def _report_progress(run: Run, items: Sequence[Any]) -> Iterator[Any]:
    for number, item in enumerate(items):
        run.progress.note_walk(items, number, len(items))
        yield item
    run.progress.note_walk(items, len(items), len(items))
