"""What a search in SQL has no words for: numbers for its steps, the way back, and the rows that were met.

One `SearchState` serves one execution of one statement. Its methods are the SQL functions that
lowering/search.py writes down. All of them may be asked twice about the same step and then answer the same.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

from ss2sql.runtime.run import Stats


class SearchState:
    """Steps are numbered from 1; 0 is the parent of the first ones."""

    def __init__(self, frozen: Callable[[Any], Hashable], stats: Stats) -> None:
        self.frozen = frozen
        self.stats = stats
        self.steps = 0
        self.kept: dict[int, tuple[int, tuple[Any, ...]]] = {}
        self.owners: dict[Hashable, int] = {}
        self.last_dropped = 0
        self.keys: dict[int, Hashable] = {}  # the frozen rows of kept steps, made when first compared

    def next_step(self, *positions: int) -> int:
        """The number of a new step, after a look at the positions of its rows in their tables."""
        self.steps += 1
        return self.steps

    def keep(self, step: int, parent: int, *row: Any) -> int:
        """Notes the row of a step that goes on; always true."""
        self.kept[step] = (parent, row)
        return 1

    def on_path(self, step: int, parent: int, *row: Any) -> int:
        """Whether the row occurs on the path to this step."""
        key = tuple(map(self.frozen, row))
        keys = self.keys
        while parent:
            known = keys.get(parent)
            if known is None:
                known = keys[parent] = tuple(map(self.frozen, self.kept[parent][1]))
            if known == key:
                self._dropped(step)
                return 1
            parent = self.kept[parent][0]
        return 0

    def reached(self, step: int, parent: int, *row: Any) -> int:
        """Whether another step has reached the row."""
        owner = self.owners.get(tuple(map(self.frozen, row)))
        if owner is None or owner == step:
            return 0
        self._dropped(step)
        return 1

    def reach(self, step: int, parent: int, *row: Any) -> int:
        """Notes that this step reaches the row; always true."""
        self.owners.setdefault(tuple(map(self.frozen, row)), step)
        return 1

    def _dropped(self, step: int) -> None:
        if step != self.last_dropped:
            self.last_dropped = step
            self.stats.pruned += 1

    def path(self, parent: int, row: tuple[Any, ...]) -> list[tuple[Any, ...]]:
        """The rows from the start to a result, the result's own row last."""
        rows = [row]
        while parent:
            parent, row = self.kept[parent]
            rows.append(row)
        rows.reverse()
        return rows
