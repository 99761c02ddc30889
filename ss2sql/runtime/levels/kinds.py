"""The kinds of searches that go by levels: what each of them is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Protocol

from ss2sql import plan
from ss2sql.lowering.portable.steps import write_steps
from ss2sql.records import dataclass
from ss2sql.runtime.levels.by_cost import CostSearch
from ss2sql.runtime.levels.cost_level import QUEUES, CostStatements
from ss2sql.runtime.levels.graph_level import GraphStatements
from ss2sql.runtime.levels.graph_search import GraphSearch
from ss2sql.runtime.levels.level import GUARDS, LevelStatements
from ss2sql.runtime.levels.search import LevelSearch
from ss2sql.runtime.levels.spark_frame import FramedSearch
from ss2sql.runtime.levels.spark_level import SparkStatements, TypedSparkStatements
from ss2sql.runtime.levels.spark_search import SparkSearch
from ss2sql.runtime.levels.statements import Statement
from ss2sql.runtime.levels.typed import TypedStatements
from ss2sql.runtime.levels.typed_search import TypedSearch
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
    """The statements of a search, which may raise UnsupportedError, and what runs them; in words what a level does
    before and after its steps are tried, and what comes at the end; whether the steps are SQL. `frame` gives the first
    paths, all without a number, as a DataFrame of the database, where it has such.
    """

    write: Callable[[plan.Query], Any]
    search: Callable[[Hunt, Any, Any], Search]
    before: Callable[[plan.Search], str]
    after: Callable[[plan.Search], tuple[str, ...]]
    end: Callable[[plan.Search], tuple[str, ...]] = lambda search: ()
    in_sql: bool = False
    frame: Callable[[Hunt, Any, Any, int | None], Any] | None = None


def kinds_of(search: plan.Search, by_length: tuple[Kind, ...], by_cost: Kind) -> tuple[Kind, ...]:
    """What a search can be made of, the best first, where those are the kinds of the ones with these orders."""
    if search.repeats == "memorize":
        return (BY_GRAPH,)
    return by_length if search.order == "breadth first" else (by_cost,)


def _search(query: plan.Query) -> plan.Search:
    assert query.search is not None
    return query.search


BY_LENGTH = Kind(
    lambda query: LevelStatements(_search(query)),
    LevelSearch,
    lambda search: "searches level by level; all states of a level together:",
    lambda search: (GUARDS[search.repeats].words, "gives the paths to the goals among them"),
)
TYPED = replace(
    BY_LENGTH, write=lambda query: TypedStatements(write_steps(query), _search(query)), search=TypedSearch, in_sql=True
)
BY_COST = Kind(
    lambda query: CostStatements(_search(query)),
    CostSearch,
    lambda search: f"searches {_EXTREME[search.order]} steps first; many of those that wait together:",
    lambda search: (
        "takes those that come before every new step, and gives the paths to the goals among them",
        QUEUES[search.repeats].words,
    ),
)
BY_GRAPH = Kind(
    lambda query: GraphStatements(_search(query)),
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
IN_TABLES = (TYPED, BY_LENGTH)
# In Spark a level is one query.
SPARK_TYPED = replace(
    TYPED,
    write=lambda query: TypedSparkStatements(write_steps(query, apart=True), _search(query)),
    search=SparkSearch,
    frame=lambda hunt, store, written, most: FramedSearch(hunt, store, written).frame(most),
)
SPARK_BY_LENGTH = replace(SPARK_TYPED, write=lambda query: SparkStatements(_search(query)), in_sql=False)
IN_QUERIES = (SPARK_TYPED, SPARK_BY_LENGTH)
# One process of an executor does not know the calls of the others. In DuckDB, where one has made all calls, to keep the
# tries takes 1.2 times as long on a grid of 60 by 60 fields with random costs.
KEEPING_BY_COST = replace(BY_COST, write=lambda query: CostStatements(_search(query), keeps=True))
