"""How the steps of a run are made, and what tables have of them: by Python as bytes, by SQL as typed columns."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Hashable, Iterator, Sequence
from functools import cached_property
from hashlib import blake2b
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import FrozenRow, FrozenShapes, State, make_hashable
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, TypedColumn, build_sql_limit_error
from ss2sql.runtime.external.level_query import TRIED, LevelStatements
from ss2sql.runtime.external.table_statements import Value, number_rows, table_of_rows
from ss2sql.runtime.python.located_code import locate_in_script
from ss2sql.runtime.python.native_query import NativeQuery
from ss2sql.runtime.run.run_state import GraphLevel, Run
from ss2sql.runtime.search.search_run import Found, SearchRun
from ss2sql.runtime.search.step_contract import Expand, Last, list_step_elements

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]

DIGEST = 32  # bytes

Try: TypeAlias = tuple[Any, ...]  # a row of `tries`


@dataclass(frozen=True, slots=True)
class StepEvaluation:
    """The step function of a search, see runtime/search/step_contract.py, and how its values are frozen.

    `keyed`: GROUP BY or ORDER BY ask for the last part of a result. `flush` brings the counts of the run up to date.
    """

    expand: Expand
    shapes: FrozenShapes
    flush: Callable[[], None]
    keyed: bool

    def evaluate_steps(self, step: int, state: bytes) -> Iterator[Try]:
        """What `tries` has of each step from the state that a step led to.

        Raises UnsupportedError where another database cannot keep what a step comes to.
        """
        tried = self.expand(self.shapes.freeze_state(loads(state)), ())
        try:
            for nth, (row, _, goal, goes_on, after, _, _, last) in enumerate(tried):
                if nth == MAX_ELEMENTS:
                    raise build_sql_limit_error("a state")
                key, *noted = self.encode_step(row, last, after if goes_on else None)
                yield step * MAX_ELEMENTS + nth, key, goal, goes_on, *noted
        except IndexError as error:
            raise locate_in_script(error) from None

    def encode_step(
        self, row: FrozenRow, last: Any, state: State | None
    ) -> tuple[bytes, bytes, bytes | None, bytes | None]:
        """The key, the row, the last part and the state after a step as bytes."""
        shown = self.shapes.thaw_state(row)
        following = None if state is None else pickle_values(self.shapes.thaw_state(state))
        return _encode_row_key(shown), pickle_values(shown), pickle_values(last) if self.keyed else None, following


def pickle_values(values: State) -> bytes:
    """Values as bytes. Raises UnsupportedError where there are objects among them."""
    try:
        return dumps(values, 2)
    except ValueError:
        raise _build_level_object_error() from None


def _encode_row_key(row: tuple[Any, ...]) -> bytes:
    """Bytes that are the same for equal rows. Raises UnsupportedError where there are objects among their values."""
    key = make_hashable(list(row))
    if not isinstance(key, bytes):
        raise _build_level_object_error()
    # What is compared with all other rows should be short. Two rows with the same digest of 256 bits nobody has seen.
    return key if len(key) <= DIGEST else blake2b(key, digest_size=DIGEST).digest()


def _build_level_object_error() -> UnsupportedError:
    hints = ("show and keep numbers, texts and lists, or leave the engine to ss2sql",)
    return UnsupportedError("U001", "a row or state has an object, which no other database can keep", hints=hints)


# --- the first levels of a search, in memory: where another database plans a level for longer than its steps take
MAX_STATES = 2_000  # of a level that is done here
MOST = 100_000  # steps that are kept here


@dataclass(frozen=True, slots=True)
class FirstStep:
    """A step that was kept, as the step function gives it; `state` is the one to go on from, if there is one.

    `trail` has the keys of the rows of its path, for NO CYCLE.
    """

    place: int
    row: FrozenRow
    last: Any
    goal: bool
    state: State | None
    trail: tuple[Hashable, ...]


class FirstLevels:
    """Goes on step by step, as the native search does, until a level has more than STATES or `states`, takes longer
    than `seconds`, as the one before tells, or all have more than MOST steps.

    The n-th step that a level has kept has the number n; `levels` are those that are done. `frontier` has the steps to
    go on from, with their numbers. `met` are the keys of all rows, for UNIQUE.
    """

    def __init__(self, search_run: SearchRun, states: float = math.inf, seconds: float = math.inf) -> None:
        self.search_run, self.repeats = search_run, search_run.problem.repeats
        self.states, self.seconds = min(states, MAX_STATES), seconds
        self.levels: list[list[FirstStep]] = []
        self.frontier = [(0, FirstStep(0, (), None, False, search_run.problem.starts[0], ()))]
        self.met: set[Hashable] = set()

    def find_goals(self) -> Iterator[FirstStep]:
        search_run, seconds, kept = self.search_run, 0.0, 0
        search_run.flush()
        while 0 < len(self.frontier) <= self.states and seconds * len(self.frontier) <= self.seconds and kept <= MOST:
            search_run.check()
            begin, before = time.monotonic(), search_run.stats.generated
            level: list[FirstStep] = []
            for step, begun in self.frontier:
                for found in self._expand_step(step, begun):
                    level.append(found)
                    if found.goal:
                        yield found
            seconds = (time.monotonic() - begin) / len(self.frontier)
            kept += len(level)
            self.levels.append(level)
            search_run.flush()
            search_run.stats.levels.append(
                GraphLevel(len(level), len(level), search_run.stats.generated - before - len(level))
            )
            self.frontier = [(step, begun) for step, begun in enumerate(level, 1) if begun.state is not None]

    def _expand_step(self, step: int, before: FirstStep) -> Iterator[FirstStep]:
        """The steps from a state that are kept."""
        unique, free = self.repeats == "unique", self.repeats == "no cycle"
        closed: Container[Hashable] = self.met if unique else before.trail
        expanded = self.search_run.problem.expand(before.state, closed)
        for nth, (row, key, goal, goes_on, after, _, _, last) in enumerate(expanded):
            if unique:
                self.met.add(key)
            trail = (*before.trail, key) if free else ()
            yield FirstStep(step * MAX_ELEMENTS + nth, row, last, bool(goal), after if goes_on else None, trail)

    def trace_path(self, step: FirstStep, depth: int) -> list[FirstStep]:
        """The steps of the path to a step of a level."""
        path = [step]
        for level in reversed(self.levels[: depth - 1]):
            path.append(level[path[-1].place // MAX_ELEMENTS - 1])
        return path[::-1]

    def make_result(self, goal: FirstStep) -> Found:
        """The path to a goal that was just found, and the last part of its last step."""
        return [
            self.search_run.shapes.thaw_state(step.row) for step in self.trace_path(goal, len(self.levels) + 1)
        ], goal.last


# Reads the rows of a query that is no search as an Arrow table; None where they have to pass through Python.
FetchRows: TypeAlias = Callable[[plan.Query, Run], "pa.Table | None"]


def make_level_steps(search_run: SearchRun, written: LevelStatements, fetch: FetchRows | None = None) -> PythonSteps:
    return PythonSteps(search_run, written) if written.steps is TRIED else SqlSteps(search_run, written, fetch)


class PythonSteps:
    """The steps of a search, tried in Python."""

    def __init__(self, search_run: SearchRun, written: LevelStatements) -> None:
        self.search_run, self.written, self.steps = search_run, written, written.steps
        self.evaluation = StepEvaluation(
            search_run.problem.expand, search_run.shapes, search_run.flush, search_run.keyed
        )
        self.values: dict[str, Value] = {}  # what statements name

    def list_known_values(self, begun: FirstStep) -> tuple[Any, ...]:
        """The columns of a step that this process knows: those of its row, then the others."""
        return self.evaluation.encode_step(begun.row, begun.last, begun.state)

    def make_key(self, begun: FirstStep) -> tuple[Any, ...]:
        """What tells the row of a step from others."""
        return self.list_known_values(begun)[: len(self.steps.rows)]

    def make_table_row(self, begun: FirstStep) -> tuple[Any, ...]:
        """The columns of a step as they stand in its table, with the flags after those of its row."""
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

    def collect_trail(self, path: Sequence[FirstStep]) -> list[Any]:
        """What NO CYCLE has of the rows of a path."""
        keys = map(self.make_key, path)
        return [key if len(key) > 1 else key[0] for key in keys]

    def make_shown(self, begun: FirstStep) -> tuple[Any, ...]:
        """What is shown of a step, see `LevelStatements.shown`."""
        return self.list_known_values(begun)[1:3]

    def read_row(self, shown: Sequence[Any]) -> Row:
        row: Row = loads(shown[0])
        return row

    def read_last_part(self, place: int, shown: Sequence[Any], before: Sequence[Any] | None) -> Any:
        """The last part of a step; `before` is shown of the one before, None where that is the start."""
        return None if shown[1] is None else loads(shown[1])


class SqlSteps(PythonSteps):
    """The steps of a search as SQL: nothing but results passes through Python.

    `elements` has what is read of the sources, `nth` counts them.
    """

    def __init__(self, search_run: SearchRun, written: LevelStatements, fetch: FetchRows | None) -> None:
        super().__init__(search_run, written)
        self.values = {label: search_run.run.get_source(name) for label, name in self.steps.parameters.items()}
        query = self.steps.elements
        assert query is not None
        table = None if fetch is None else fetch(query, search_run.run)
        if table is None:
            table = table_of_rows(self.steps.reads, NativeQuery(query).compute_rows(search_run.run).rows or ())
        if len(table) > MAX_ELEMENTS:
            raise build_sql_limit_error("FROM")
        self.elements = number_rows(written.elements, table)

    def count_tries(self, expanded: int, generated: int | None) -> None:
        """Counts the states that were expanded, and the elements that they have: all unless there is a number."""
        self.search_run.stats.generated += expanded * len(self.elements) if generated is None else generated
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
        return list(map(noted.read_elements, list_step_elements(noted, self.search_run.problem.starts[0])))
