"""How the steps of a run are made, and what tables have of them: by Python as bytes, by SQL as typed columns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from marshal import loads
from typing import Any

from ss2sql.lowering.portable.steps import ELEMENTS, Typed, too_many_elements
from ss2sql.runtime.levels.beginning import Begun
from ss2sql.runtime.levels.level import TRIED, Level
from ss2sql.runtime.levels.statements import Value
from ss2sql.runtime.levels.trial import Trial, encoded
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.memorize.notes import Last, elements_of
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.rows import Row


def steps_of(hunt: Hunt, written: Level) -> Steps:
    return Steps(hunt, written) if written.steps is TRIED else TypedSteps(hunt, written)


class Steps:
    """The steps of a search, tried in Python."""

    def __init__(self, hunt: Hunt, written: Level) -> None:
        self.hunt, self.written, self.steps = hunt, written, written.steps
        self.trial = Trial(hunt.problem.expand, hunt.shapes, hunt.flush, hunt.keyed)
        self.values: dict[str, Value] = {}  # what statements name

    def known(self, begun: Begun) -> tuple[Any, ...]:
        """The columns of a step that this process knows: those of its row, then the others."""
        return self.trial.noted(begun.row, begun.last, begun.state)

    def key_of(self, begun: Begun) -> tuple[Any, ...]:
        """What tells the row of a step from others."""
        return self.known(begun)[: len(self.steps.rows)]

    def kept(self, begun: Begun) -> tuple[Any, ...]:
        """The columns of a step as they stand in its table, with the flags behind those of its row."""
        return self._with_flags(self.known(begun), begun.goal, begun.state is not None)

    def _with_flags(self, known: tuple[Any, ...], goal: bool, goes_on: bool) -> tuple[Any, ...]:
        rows = len(self.steps.rows)
        return *known[:rows], goal, goes_on, *known[rows:]

    def start(self) -> tuple[Any, ...]:
        """The same of the start, which has no row."""
        return self._with_flags((None, None, None, encoded(self.hunt.start)), False, True)

    def expanded(self, begun: Begun) -> dict[Typed, Any]:
        """The columns that have the state after a step."""
        return {self.steps.own[-1]: self.known(begun)[-1]}

    def trail_of(self, way: Sequence[Begun]) -> list[Any]:
        """What NO CYCLE has of the rows of a path."""
        keys = map(self.key_of, way)
        return [key if len(key) > 1 else key[0] for key in keys]

    def shown_of(self, begun: Begun) -> tuple[Any, ...]:
        """What is shown of a step, see `Level.shown`."""
        return self.known(begun)[1:3]

    def row(self, shown: Sequence[Any]) -> Row:
        """The row of a step of which this is shown."""
        row: Row = loads(shown[0])
        return row

    def last(self, place: int, shown: Sequence[Any], before: Sequence[Any] | None) -> Any:
        """The last part of a step; `before` is shown of the one before, None where that is the start."""
        return None if shown[1] is None else loads(shown[1])


class TypedSteps(Steps):
    """The steps of a search as SQL: nothing but results passes through Python.

    `elements` has what is read of the sources, `nth` counts them.
    """

    def __init__(self, hunt: Hunt, written: Level) -> None:
        super().__init__(hunt, written)
        self.values = {label: hunt.run.source(name) for label, name in self.steps.parameters.items()}
        assert self.steps.elements is not None
        rows = NativeQuery(self.steps.elements).rows(hunt.run).rows
        assert rows is not None
        if len(rows) > ELEMENTS:
            raise too_many_elements("FROM")
        self.elements = [(nth, *row[: len(self.steps.reads)]) for nth, row in enumerate(rows)]

    def count(self, expanded: int) -> None:
        """Counts the steps from so many states."""
        self.hunt.stats.generated += expanded * len(self.elements)
        self.hunt.stats.expanded += expanded

    def known(self, begun: Begun) -> tuple[Any, ...]:
        after = self.expanded(begun)
        return *self.hunt.shapes.thaw(begun.row), *(after.get(column) for column in self.steps.own)

    def shown_of(self, begun: Begun) -> tuple[Any, ...]:
        return self.known(begun)

    def start(self) -> tuple[Any, ...]:
        after = self.steps.after(self.hunt.start)
        return self._with_flags(tuple(map(after.get, (*self.steps.rows, *self.steps.own))), False, True)

    def expanded(self, begun: Begun) -> dict[Typed, Any]:
        return {} if begun.state is None else self.steps.after(self.hunt.shapes.thaw(begun.state))

    def row(self, shown: Sequence[Any]) -> Row:
        return tuple(shown[: len(self.steps.rows)])

    def last(self, place: int, shown: Sequence[Any], before: Sequence[Any] | None) -> Any:
        if not self.hunt.keyed:
            return None
        elements = self._combinations[place % ELEMENTS]
        if before is None:
            return (*elements, *self.hunt.start)
        columns = dict(zip((*self.steps.rows, *self.steps.own), before, strict=True))
        return (*elements, *(columns[column] for column in self.steps.states))

    @cached_property
    def _combinations(self) -> list[Last]:
        """The elements of the sources in their order, which are the same for all states."""
        noted = self.hunt.noted
        assert noted is not None
        return list(map(noted.elements, elements_of(noted, self.hunt.problem.starts[0])))
