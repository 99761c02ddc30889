"""Remembered graphs as users see them: `ss.graphs()`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import field
from typing import Any, overload

import apsw

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.graph_cache.graph_store import GraphStore, build_damage_error

_MAX_TEXT_LENGTH = 60


@dataclass(frozen=True, slots=True)
class Graph:
    """A graph that is remembered in the session's file.

    `id` is its number in the table `ss2sql_graphs`. `query` is the text of the query that came first, `functions` are
    the names of the Python functions that its steps call, `parameters` the variables that they read. `nodes` counts
    states, `edges` steps; `levels` is the greatest number of levels that a search has completed. `created` and `used`
    are times in UTC.
    """

    id: int
    query: str
    functions: tuple[str, ...]
    parameters: dict[str, Any]
    nodes: int
    edges: int
    levels: int
    created: str
    used: str
    _store: GraphStore = field(repr=False, compare=False)

    def drop(self) -> None:
        """Removes the graph from the file. Raises ExecutionError X009 where that cannot be written."""
        self._store.drop_graph(self.id)


class Graphs(Sequence[Graph]):
    """The remembered graphs of a file, the oldest first, as they are when `ss.graphs()` is called."""

    def __init__(self, graphs: Sequence[Graph]) -> None:
        self._graphs = tuple(graphs)

    @overload
    def __getitem__(self, index: int) -> Graph: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Graph]: ...
    def __getitem__(self, index: int | slice) -> Graph | Sequence[Graph]:
        return self._graphs[index] if isinstance(index, int) else Graphs(self._graphs[index])

    def __len__(self) -> int:
        return len(self._graphs)

    def __iter__(self) -> Iterator[Graph]:
        return iter(self._graphs)

    def drop(self) -> None:
        """Removes all of these graphs from the file."""
        for graph in self._graphs:
            graph.drop()

    def __repr__(self) -> str:
        if not self._graphs:
            return "no remembered graphs"
        names = ("id", "nodes", "edges", "levels", "used", "functions", "query")
        rows = [[_format_cell(getattr(graph, name)) for name in names] for graph in self._graphs]
        widths = [max(map(len, column)) for column in zip(names, *rows, strict=True)]
        padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in (names, *rows))
        return "\n".join("  ".join(cells).rstrip() for cells in padded)


def list_graphs(store: GraphStore) -> Graphs:
    """The graphs in a store. Raises ExecutionError X009 where it cannot be read."""
    try:
        if not store.has_tables():
            return Graphs(())
        return Graphs([_build_graph(store, row) for row in store.describe_graphs()])
    except (apsw.BusyError, apsw.LockedError) as error:
        raise ExecutionError("X009", f"the remembered graphs cannot be read now: {error}") from error
    except (apsw.Error, ValueError, TypeError, RecursionError) as error:
        raise build_damage_error(str(error)) from error


def _build_graph(store: GraphStore, row: tuple[Any, ...]) -> Graph:
    number, query, functions, parameters, nodes, edges, levels, created, used = row
    names = tuple(json.loads(functions))
    return Graph(number, query, names, json.loads(parameters), nodes, edges, levels, created, used, store)


def _format_cell(value: Any) -> str:
    text = ", ".join(value) if isinstance(value, tuple) else " ".join(str(value).split())
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[: _MAX_TEXT_LENGTH - 3]}..."
