"""How the steps of a run are made, and what tables have of them: by Python as bytes, by SQL as typed columns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from marshal import loads
from typing import Any

from ss2sql.language.rows import Row
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, TypedColumn, build_element_limit_error
from ss2sql.runtime.external.first_levels import FirstStep
from ss2sql.runtime.external.level_statements import TRIED, LevelStatements
from ss2sql.runtime.external.step_evaluation import StepEvaluation, pickle_values
from ss2sql.runtime.external.table_statements import Value
from ss2sql.runtime.python.native_query import NativeQuery
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_notes import Last, list_elements


def make_level_steps(search_run: SearchRun, written: LevelStatements) -> PythonSteps:
    return PythonSteps(search_run, written) if written.steps is TRIED else SqlSteps(search_run, written)


class PythonSteps:
    """The steps of a search, tried in Python."""

    def __init__(self, search_run: SearchRun, written: LevelStatements) -> None:
        self.search_run, self.written, self.steps = search_run, written, written.steps
        self.trial = StepEvaluation(search_run.problem.expand, search_run.shapes, search_run.flush, search_run.keyed)
        self.values: dict[str, Value] = {}  # what statements name

    def list_known_values(self, begun: FirstStep) -> tuple[Any, ...]:
        """The columns of a step that this process knows: those of its row, then the others."""
        return self.trial.encode_step(begun.row, begun.last, begun.state)

    def make_key(self, begun: FirstStep) -> tuple[Any, ...]:
        """What tells the row of a step from others."""
        return self.list_known_values(begun)[: len(self.steps.rows)]

    def make_table_row(self, begun: FirstStep) -> tuple[Any, ...]:
        """The columns of a step as they stand in its table, with the flags behind those of its row."""
        return self._insert_flags(self.list_known_values(begun), begun.goal, begun.state is not None)

    def _insert_flags(self, known: tuple[Any, ...], goal: bool, goes_on: bool) -> tuple[Any, ...]:
        rows = len(self.steps.rows)
        return *known[:rows], goal, goes_on, *known[rows:]

    def make_start_row(self) -> tuple[Any, ...]:
        """The same of the start, which has no row."""
        return self._insert_flags((None, None, None, pickle_values(self.search_run.start)), False, True)

    def list_next_state(self, begun: FirstStep) -> dict[TypedColumn, Any]:
        """The columns that have the state after a step."""
        return {self.steps.own[-1]: self.list_known_values(begun)[-1]}

    def collect_trail(self, way: Sequence[FirstStep]) -> list[Any]:
        """What NO CYCLE has of the rows of a path."""
        keys = map(self.make_key, way)
        return [key if len(key) > 1 else key[0] for key in keys]

    def make_shown(self, begun: FirstStep) -> tuple[Any, ...]:
        """What is shown of a step, see `LevelStatements.shown`."""
        return self.list_known_values(begun)[1:3]

    def read_row(self, shown: Sequence[Any]) -> Row:
        """The row of a step of which this is shown."""
        row: Row = loads(shown[0])
        return row

    def read_last_part(self, place: int, shown: Sequence[Any], before: Sequence[Any] | None) -> Any:
        """The last part of a step; `before` is shown of the one before, None where that is the start."""
        return None if shown[1] is None else loads(shown[1])


class SqlSteps(PythonSteps):
    """The steps of a search as SQL: nothing but results passes through Python.

    `elements` has what is read of the sources, `nth` counts them.
    """

    def __init__(self, search_run: SearchRun, written: LevelStatements) -> None:
        super().__init__(search_run, written)
        self.values = {label: search_run.run.get_source(name) for label, name in self.steps.parameters.items()}
        assert self.steps.elements is not None
        rows = NativeQuery(self.steps.elements).compute_rows(search_run.run).rows
        assert rows is not None
        if len(rows) > MAX_ELEMENTS:
            raise build_element_limit_error("FROM")
        self.elements = [(nth, *row[: len(self.steps.reads)]) for nth, row in enumerate(rows)]

    def count_tries(self, expanded: int) -> None:
        """Counts the steps from so many states."""
        self.search_run.stats.generated += expanded * len(self.elements)
        self.search_run.stats.expanded += expanded

    def list_known_values(self, begun: FirstStep) -> tuple[Any, ...]:
        after = self.list_next_state(begun)
        return *self.search_run.shapes.thaw_state(begun.row), *(after.get(column) for column in self.steps.own)

    def make_shown(self, begun: FirstStep) -> tuple[Any, ...]:
        return self.list_known_values(begun)

    def make_start_row(self) -> tuple[Any, ...]:
        after = self.steps.match_columns(self.search_run.start)
        return self._insert_flags(tuple(map(after.get, (*self.steps.rows, *self.steps.own))), False, True)

    def list_next_state(self, begun: FirstStep) -> dict[TypedColumn, Any]:
        return {} if begun.state is None else self.steps.match_columns(self.search_run.shapes.thaw_state(begun.state))

    def read_row(self, shown: Sequence[Any]) -> Row:
        return tuple(shown[: len(self.steps.rows)])

    def read_last_part(self, place: int, shown: Sequence[Any], before: Sequence[Any] | None) -> Any:
        if not self.search_run.keyed:
            return None
        elements = self._combinations[place % MAX_ELEMENTS]
        if before is None:
            return (*elements, *self.search_run.start)
        columns = dict(zip((*self.steps.rows, *self.steps.own), before, strict=True))
        return (*elements, *(columns[column] for column in self.steps.states))

    @cached_property
    def _combinations(self) -> list[Last]:
        """The elements of the sources in their order, which are the same for all states."""
        noted = self.search_run.noted
        assert noted is not None
        return list(map(noted.read_elements, list_elements(noted, self.search_run.problem.starts[0])))
