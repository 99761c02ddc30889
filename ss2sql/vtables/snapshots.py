"""Snapshots: the tables that a query copies at its start, because it may move the world during the walk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.vtables.query_cache import QueryCache
from ss2sql.vtables.reading import Readings

if TYPE_CHECKING:
    from ss2sql.vtables.attached_worlds import AttachedTable


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The columns that a query copies at its start, by table; none where it reads the world directly.

    `once` says that it reads each element once, so that nothing is cached. `places` are the first spans of its tables.
    """

    columns: tuple[tuple[AttachedTable, Span | None, tuple[str, ...]], ...] = ()
    once: bool = False
    places: tuple[tuple[AttachedTable, Span | None], ...] = ()

    def copy_tables(self, remembered: QueryCache | None, check: Callable[[], None]) -> Readings:
        """The readings of a run of the query, with the copy made. `remembered` gets the caches of worlds.

        `check` raises where the run has to end.
        """
        readings = Readings(remembered, self.once, self.places, check)
        for table, place, columns in self.columns:
            readings.get_reading(table.table, place).freeze_columns(columns)
        return readings


NO_SNAPSHOT = Snapshot()
_SOURCES = (plan.ValueSource, plan.TableSource, plan.QuerySource, plan.WorldSource)


def plan_snapshot(roots: Collection[Any]) -> Snapshot:
    """The snapshot for these parts of a plan, which run together.

    Only functions of the user or of a world can move it. The string of an `eval` may call any, and read any column.
    """
    nodes = list(chain.from_iterable(map(walk, roots)))
    sources = [node for node in nodes if isinstance(node, plan.WorldSource)]
    if not sources:
        return NO_SNAPSHOT
    places = tuple((table, find_first_place(table, roots)) for table in {source.table: None for source in sources})
    if not any(map(_can_node_move, nodes)):
        return Snapshot((), _is_walked_once(nodes), places)
    texts = any(isinstance(node, plan.Eval) for node in nodes)
    columns: dict[AttachedTable, dict[str, None]] = {}
    for source in sources:
        wanted = columns.setdefault(source.table, {})
        if texts:
            wanted.update(dict.fromkeys(name for name, _ in source.columns))
        for node in nodes:
            if isinstance(node, plan.Column) and node.source == source.id:
                wanted[node.name] = None
    copied = tuple((table, find_first_place(table, roots), tuple(wanted)) for table, wanted in columns.items())
    return Snapshot(copied, places=places)


def _is_walked_once(nodes: Sequence[Any]) -> bool:
    """Whether these parts of a plan have one source, walked once, and no function that reads ahead in it."""
    queries = [node for node in nodes if isinstance(node, plan.Query)]
    return (
        len(queries) == 1
        and sum(isinstance(node, _SOURCES) for node in nodes) == 1
        and queries[0].search is None
        and not queries[0].grouped
        and all(node.function.builtin for node in nodes if isinstance(node, plan.Call))
    )


def find_first_place(table: AttachedTable, roots: Iterable[Any]) -> Span | None:
    """The first span of the table in FROM in these parts of a plan."""
    nodes = chain.from_iterable(walk(root) for root in roots if root is not None)
    return next((node.span for node in nodes if isinstance(node, plan.WorldSource) and node.table is table), None)


def can_move_world(query: plan.Query) -> bool:
    """Whether a query may move the world while it runs."""
    return any(map(_can_node_move, walk(query)))


def _can_node_move(node: Any) -> bool:
    if isinstance(node, plan.Eval):
        return True
    return isinstance(node, plan.Call) and not node.function.builtin and node.function.volatility == "volatile"
