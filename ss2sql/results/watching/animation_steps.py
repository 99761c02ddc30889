"""The view of a traced search: its steps, their texts, places and outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.results.path_plot import find_coordinates
from ss2sql.results.plot_style import cut_label
from ss2sql.results.show import format_cell
from ss2sql.results.watching.search_trace import SearchTrace
from ss2sql.runtime.search.trace import Event

MOST_TEXT = 60  # characters of a row or a state
FINEST = 200  # cells that a map is across at most
Place: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class TraceScene:
    """The `steps` of a trace, each by its first event, and the place of each where there is a map.

    The cells of the map are `pitch` wide.
    """

    traced: SearchTrace
    steps: Sequence[Event]
    places: Sequence[Place | None]
    pitch: float

    @property
    def is_map(self) -> bool:
        return self.pitch > 0

    @cached_property
    def expanded(self) -> dict[int, int]:
        """The expanded steps, each with its number in the order of expansion."""
        order = (event.n for event in self.traced.events if event.event == "expanded")
        return {n: number for number, n in enumerate(order, 1)}

    @cached_property
    def last(self) -> dict[int, str]:
        """The last event of each step."""
        return {event.n: event.event for event in self.traced.events}

    @cached_property
    def goals(self) -> list[int]:
        return [event.n for event in self.traced.events if event.event == "goal"]

    @cached_property
    def lost(self) -> set[int]:
        """The repeated or stopped steps that are neither goals nor expanded."""
        lost = {n for n, event in self.last.items() if event in ("repeated", "stopped")}
        return lost - self.expanded.keys() - set(self.goals)

    def find_path(self, n: int | None) -> list[int]:
        """The steps from the start to this one."""
        found = []
        while n is not None:
            found.append(n)
            n = self.steps[n].parent
        return found[::-1]


def make_scene(traced: SearchTrace) -> TraceScene:
    steps: dict[int, Event] = {}
    for event in traced.events:
        steps.setdefault(event.n, event)
    every = list(steps.values())
    found = _find_places(traced, every)
    return TraceScene(traced, every, found, _measure_pitch([place for place in found if place is not None]))


def format_traced_row(shown: dict[str, Any] | None, named: bool = False) -> str:
    """A row or a state as a short text; the names of several values are `named`."""
    several = named and len(shown or ()) > 1
    values = (f"{key} {format_cell(value)}" if several else format_cell(value) for key, value in (shown or {}).items())
    return cut_label(", ".join(values), MOST_TEXT)


def _find_places(traced: SearchTrace, steps: Sequence[Event]) -> list[Place | None]:
    """The places of the steps: those of their states, or else of their rows.

    A step that stops has no state. Its row gives its place where the rows of other steps equal their states' places.
    In states with other lists, as in a puzzle, lists of two numbers are moves, not places.
    """
    counters = traced.counters
    states = _read_points([_drop_names(event.state, counters) for event in steps])
    rows = _read_points([event.row for event in steps])
    if any(states):
        both = [(state, row) for state, row in zip(states, rows, strict=True) if state and row]
        told = bool(both) and all(state == row for state, row in both)
        return [state or (row if told else None) for state, row in zip(states, rows, strict=True)]
    puzzle = any(isinstance(value, (list, dict)) for event in steps for value in (event.state or {}).values())
    return [None] * len(steps) if puzzle else rows


def _drop_names(state: dict[str, Any] | None, names: frozenset[str]) -> dict[str, Any] | None:
    return None if state is None else {name: value for name, value in state.items() if name not in names}


def _read_points(shown: Sequence[dict[str, Any] | None]) -> list[Place | None]:
    """The places in rows or states; empty where one of them has no place."""
    there = [tuple(one.values()) for one in shown if one]
    where = find_coordinates(list(next(filter(None, shown), ())), there)
    if where is None:
        return [None] * len(shown)
    values = iter(there)
    return [_round_place(where.of(next(values))) if one else None for one in shown]


def _round_place(place: Sequence[float]) -> Place:
    return round(place[0], 6), round(place[1], 6)


def _measure_pitch(found: Sequence[Place]) -> float:
    """The least distance of two places along an axis."""
    if not found:
        return 0.0
    axes = [sorted({place[axis] for place in found}) for axis in (0, 1)]
    gaps = [after - before for axis in axes for before, after in pairwise(axis)]
    return max(min(gaps, default=1.0), *((axis[-1] - axis[0]) / FINEST for axis in axes))
