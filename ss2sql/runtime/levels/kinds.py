"""The kinds of searches that go by levels: what each of them is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from ss2sql import plan
from ss2sql.runtime.levels.by_cost import CostSearch
from ss2sql.runtime.levels.cost_level import QUEUES, CostStatements
from ss2sql.runtime.levels.graph_level import GraphStatements
from ss2sql.runtime.levels.graph_search import GraphSearch
from ss2sql.runtime.levels.level import GUARDS, LevelStatements
from ss2sql.runtime.levels.search import LevelSearch
from ss2sql.runtime.levels.statements import Statement
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.memorize.hunt import Found, Hunt


class Written(Protocol):
    """The statements of a search."""

    def level(self) -> Iterator[Statement]:
        """All of one level, in order."""


class Search(Protocol):
    """One run of a search."""

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""


@dataclass(frozen=True, slots=True)
class Kind:
    """The statements of a search and what runs them; in words what a level does before and after its steps are tried,
    and what comes at the end.
    """

    write: Callable[[plan.Search], Any]
    search: Callable[[Hunt, Tables, Any], Search]
    before: Callable[[plan.Search], str]
    after: Callable[[plan.Search], tuple[str, ...]]
    end: Callable[[plan.Search], tuple[str, ...]] = lambda search: ()


def kind_of(search: plan.Search) -> Kind | None:
    """What a search is made of; None where it does not go by levels."""
    return BY_GRAPH if search.repeats == "memorize" else KINDS.get(search.order)


BY_LENGTH = Kind(
    LevelStatements,
    LevelSearch,
    lambda search: "searches level by level; all states of a level together:",
    lambda search: (GUARDS[search.repeats].words, "gives the paths to the goals among them"),
)
BY_COST = Kind(
    CostStatements,
    CostSearch,
    lambda search: f"searches {_EXTREME[search.order]} steps first; many of those that wait together:",
    lambda search: (
        "takes those that come before every new step, and gives the paths to the goals among them",
        QUEUES[search.repeats].words,
    ),
)
BY_GRAPH = Kind(
    GraphStatements,
    GraphSearch,
    lambda search: "makes the graph of rows level by level; of all states of a level together:",
    lambda search: (
        "keeps the first step to each row that no level before has reached",
        "keeps every step to a row that is reached by then as an edge",
    ),
    lambda search: (
        "finds what of the graph lies on ways to goals, backwards from these",
        f"gives the paths of that, {_EXTREME.get(search.order, 'the shortest')} first",
    ),
)
_EXTREME: dict[plan.Order, str] = {"cost": "the cheapest", "probability": "the likeliest"}
KINDS: dict[plan.Order, Kind] = {"breadth first": BY_LENGTH, "cost": BY_COST, "probability": BY_COST}
