"""Counting the steps of a search level by level, for who wants to look closely: see results/explain/level_counts.py.

A level are the steps that are so many steps from the start. The loop of the search says whenever it begins, or comes
back, to the steps from another state; what has been counted since the time before belongs to the state before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.run.backpointers import Path, measure_depth
from ss2sql.runtime.run.run_state import Run, Stats


@dataclass(slots=True)
class LevelCount:
    """The steps of one level: how many were tried, how many of these led on, and how many a guard kept out."""

    generated: int = 0
    expanded: int = 0
    pruned: int = 0


@dataclass(slots=True)
class LevelCounter:
    """The counts of one run, by level."""

    stats: Stats
    levels: list[LevelCount] = field(default_factory=list)
    depth: int = 0
    generated: int = 0
    pruned: int = 0

    def enter_depth(self, depth: int, generated: int, pruned: int, first: bool) -> None:
        """The search turns to the steps from a state at this depth, for the `first` time or again.

        `generated` and `pruned` are what it has not yet told the run.
        """
        self.add_counts(generated, pruned)
        self.depth = depth
        if first and depth:
            self._get_level(depth).expanded += 1

    def add_counts(self, generated: int = 0, pruned: int = 0) -> None:
        """Notes what was counted since the last time."""
        generated, pruned = generated + self.stats.generated, pruned + self.stats.pruned
        if (generated, pruned) != (self.generated, self.pruned):
            level = self._get_level(self.depth + 1)
            level.generated += generated - self.generated
            level.pruned += pruned - self.pruned
            self.generated, self.pruned = generated, pruned

    def _get_level(self, number: int) -> LevelCount:
        while len(self.levels) < number:
            self.levels.append(LevelCount())
        return self.levels[number - 1]


def make_watcher(run: Run, leveled: bool, flush: Callable[[], None]) -> Callable[..., None] | None:
    """What hears to which state a search turns: the line of progress, and counts by level, where they are wanted."""
    progress, by_level = run.progress, run.by_level if leveled else None
    if progress is None and by_level is None:
        return None

    def watch_state(path: Path, first: bool = True) -> None:
        if progress is not None:
            progress.reached = path
        if by_level is not None:
            flush()
            by_level.enter_depth(measure_depth(path)[0], 0, 0, first)

    return watch_state
