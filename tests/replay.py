"""Walks a path again, step by step: START WITH, an element that gives the row, STOP WITH, CONNECT BY, at the end WHERE.

The clauses are evaluated by the reference evaluator, so that nothing of the search under test takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from reference import Reference, queries
from reference.search import Search, State
from reference.sight import Frame

from ss2sql.frontend.syntax import ast

Rows = Sequence[tuple[Any, ...]]
# The state after a step, whether it stops, and whether it is a goal.
Step = tuple[State, bool, bool]


def search_of(script: ast.Script) -> ast.Query | None:
    """The search whose paths are the script's result; None if there is none."""
    last = script.statements[-1]
    if isinstance(last, ast.Assign):
        last = last.value
    return last if isinstance(last, ast.Query) and last.searches else None


class Replay:
    """The search of a script's last statement, after the statements before it have run."""

    def __init__(self, reference: Reference, script: ast.Script, query: ast.Query) -> None:
        if script.statements[:-1]:
            reference.run(ast.Script(script.statements[:-1], span=script.span))
        self.reference, self.query = reference, query
        self.search = Search(reference, query, None)

    def leads_to_a_goal(self, path: Rows) -> bool:
        """Whether the rows are a path from the start to a goal; of several elements with equal rows any will do."""
        states = [self.search.start]
        for row in path[:-1]:
            states = [after for state in states for after, stops, _ in self._steps(state, row) if not stops]
            states = list({repr(state): state for state in states}.values())
        return any(goal for state in states for _, _, goal in self._steps(state, path[-1]))

    def _steps(self, state: State, row: tuple[Any, ...]) -> list[Step]:
        """The steps of the elements that give this row, up to one that fails.

        With MAXIMUM a search may have ended before it came there; it has come to none of those behind.
        """
        found: list[Step] = []
        with suppress(Exception):
            for frame in self.search.elements(state):
                step = self._step(frame, row)
                found += [] if step is None else [step]
        return found

    def _leaves_no_trace(self, frame: Frame) -> bool:
        """Whether the step stops and is no goal: SELECT is not asked of it, and it is on no path."""
        where, stop = self.query.where, self.query.stop
        if stop is None:
            return False
        with suppress(Exception):
            stops = bool(self.reference.evaluate(stop, frame))
            return stops and not (where is not None and self.reference.evaluate(where, frame))
        return False

    def _step(self, frame: Frame, row: tuple[Any, ...]) -> Step | None:
        if self._leaves_no_trace(frame):
            return None
        made = queries.select(self.reference, self.query, frame)
        if [value for _, value in made] != list(row):
            return None
        stop = self.query.stop is not None and bool(self.reference.evaluate(self.query.stop, frame))
        where = self.query.where
        goal = bool(self.reference.evaluate(where, frame)) if where is not None else not stop
        return {} if stop else self.search.connected(frame), stop, goal
