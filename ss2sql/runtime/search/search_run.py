"""One run of a search with MEMORIZE, and what its parts hand to each other: steps, levels, results."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.frozen_values import FrozenShapes, State
from ss2sql.language.rows import Row
from ss2sql.runtime.run.run_state import Run, Stats
from ss2sql.runtime.search.step_contract import Problem
from ss2sql.runtime.search.step_notes import NotedSearch, Notes

if TYPE_CHECKING:
    from ss2sql.runtime.search.graph import RowGraph

# `grow(graph, level, seen, most, choose)` adds the steps from the nodes of a level to the graph, each evaluated in
# source order, and gives the nodes that go on: each a number, then the values of its frozen state. `seen` has the
# numbers of rows by their keys. It ends early when the graph has more than `most` rows and the start.
# `choose(elements, state)`, where it is given, says which elements of a single list are tried; with notes it is Notes.
Node: TypeAlias = tuple[Any, ...]
Nodes: TypeAlias = Iterable[Node]
ChooseElements: TypeAlias = Callable[[list[Any], State], list[Any]] | Notes
GrowLevel: TypeAlias = Callable[["RowGraph", Nodes, dict[Hashable, int], int, ChooseElements | None], list[Node]]

# A result: the rows of its path, and the last part of its last step.
Found: TypeAlias = tuple[Sequence[Row], Any]


# What finds the results of a search.
FindPaths: TypeAlias = Callable[["SearchRun"], Iterator[Found]]


@dataclass(frozen=True, slots=True)
class SearchRun:
    """One run of a search."""

    start: State  # as values; the states of `problem` are frozen
    problem: Problem
    shapes: FrozenShapes  # how states are frozen
    grow: Callable[..., list[Node]] | None  # makes a level of the graph, with the step function inlined
    order: plan.Order
    bound: int | None  # MEMORIZE's greatest length
    stats: Stats
    check: Callable[[], None]  # ends the run if it has to end
    query: plan.Query
    run: Run
    noted: NotedSearch | None = None  # the search with notes of its steps, where it can have some
    chooses: bool = False  # `grow` takes a choice of elements
    flush: Callable[[], None] = lambda: None  # brings `stats` up to date
    keyed: bool = True  # GROUP BY or ORDER BY need the last part of a result
