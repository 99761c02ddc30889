"""MEMORIZE in tables: its graph grows there, and what of it lies on ways to goals comes into memory.

Nodes and edges come in the order in which the native search makes them, so its paths, and their order, are the same.
What leads to no goal within the bound is on none of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from marshal import loads

from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.runtime.levels import graph_level
from ss2sql.runtime.levels.graph_level import GraphStatements
from ss2sql.runtime.levels.search import TableSearch
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.levels.trial import GraphTrial, encoded
from ss2sql.runtime.memorize.graph import FAR, Graph
from ss2sql.runtime.memorize.growing import results_of, too_many
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level


class GraphSearch(TableSearch):
    """One search with MEMORIZE."""

    def __init__(self, hunt: Hunt, tables: Tables, written: GraphStatements) -> None:
        super().__init__(hunt, tables)
        self.written = written
        self.trial = GraphTrial(self.pieces, hunt.keyed)

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        self._grow()
        if self._find_ways():
            yield from results_of(self.hunt, self._loaded())

    def _grow(self) -> None:
        """Makes the graph of the rows that are reached by at most so many steps as the bound."""
        written, tables, bound = self.written, self.tables, self.hunt.bound
        self.run(written.made)
        tables.load("frontier", [[0], [encoded(self.hunt.start)]])
        going, depth, rows, edges = 1, 0, 0, 0
        while going and (bound is None or depth < bound):
            depth += 1
            tried = tables.try_all(self.trial, self.pause).tried
            self.run(written.keep, before=rows, depth=depth)
            edges_before = edges
            ((new, going, last, edges),) = tables.rows(graph_level.COUNTS)
            rows = last or rows
            self._check(rows)
            self.hunt.stats.levels.append(Level(new, edges - edges_before, tried - (edges - edges_before)))
            self.run(written.go_on)

    def _check(self, rows: int) -> None:
        """Raises the error of the first step that failed and counts, or that of too many rows where it comes first."""
        most = self.hunt.run.max_rows
        for place, known in self.tables.rows(graph_level.FAILED):
            parent = place // ELEMENTS
            if most is not None and rows > most:
                ((before,),) = self.tables.rows(graph_level.NODES_FROM, parent=parent)
                if before > most:
                    break
            self.fail(self.trial, place, known)
        if most is not None and rows > most:
            raise too_many(self.hunt.query, most)

    def _find_ways(self) -> int:
        """Finds from which nodes goals are reached, backwards from these; says how many nodes that are."""
        tables, bound = self.tables, self.hunt.bound
        tables.run(graph_level.GOALS)
        ((reached,),) = tables.rows(graph_level.REACHED)
        distance, before = 0, 0
        while reached > before and (bound is None or distance < bound):
            distance, before = distance + 1, reached
            self.pause()
            tables.run(graph_level.REACHING, distance=distance)
            ((reached,),) = tables.rows(graph_level.REACHED)
        return reached  # type: ignore[no-any-return]

    def _loaded(self) -> Graph:
        """What of the graph lies on ways to goals."""
        hunt = self.hunt
        graph = hunt.run.graph = Graph(hunt.check, hunt.bound)
        bound = FAR if hunt.bound is None else hunt.bound
        numbers = {0: 0}
        for node, row, goal in self.tables.rows(graph_level.NODES, bound=bound):
            numbers[node] = graph.add_node(loads(row), goal)
        for node, target, weight, last in self.tables.rows(graph_level.WAYS_ON, bound=bound):
            weighs = None if weight is None else loads(weight)
            graph.add_edge(numbers[node], numbers[target], weighs, None if last is None else loads(last))
        if self.pieces.weigh is None:
            graph.weights.clear()
        if not hunt.keyed:
            graph.lasts.clear()
        return graph
