"""Trying the steps from one state in Python: what a table notes of them."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from hashlib import blake2b
from itertools import islice
from marshal import dumps, loads
from typing import Any, TypeAlias

from ss2sql.errors import ExecutionError, Stopped, UnsupportedError
from ss2sql.lowering.portable.steps import ELEMENTS, too_many_elements
from ss2sql.runtime.frozen import State
from ss2sql.runtime.memorize.pieces import Last, Pieces
from ss2sql.runtime.rows import Row
from ss2sql.runtime.values import freeze

DIGEST = 32  # bytes
WHOLE = 1 << 53  # the whole numbers up to here are floats, too

FAILED = 8  # where a row of `tries` says whether it failed

Try: TypeAlias = tuple[Any, ...]  # a row of `tries`


class Trial:
    """The clauses of a search, asked for steps in the order in which the native search asks them.

    `keyed`: GROUP BY or ORDER BY ask for the last part of a result. `compared`: rows are, so SELECT comes first, and
    what fails there counts also of a step that leaves no trace.
    """

    def __init__(self, pieces: Pieces, keyed: bool, compared: bool) -> None:
        self.pieces, self.keyed, self.compared = pieces, keyed, compared

    def over(self, pieces: Any) -> Trial:
        """The same over other pieces: those of another process."""
        other = copy(self)
        other.pieces = pieces
        return other

    def steps(self, step: int, state: bytes) -> Iterator[Try | None]:
        """What `tries` has of each step from the state that a step led to; None for those that come to nothing.

        Raises UnsupportedError where another database cannot keep what a step comes to.
        """
        before = loads(state)
        for nth, last in enumerate(self._lasts(before)):
            if nth == ELEMENTS:
                raise too_many_elements("a state")
            place = step * ELEMENTS + nth
            made = self._failed(place, None) if last is None else self._tried(place, last, before)
            yield None if made is None else (place, step, *made)

    def _lasts(self, before: Any) -> Iterator[Last | None]:
        """The elements of a state with it; at the end None where the sources fail."""
        try:
            yield from self.pieces.elements(self._state(before))
        except (Stopped, UnsupportedError):
            raise
        except Exception:  # raised by `fail`, if it counts
            yield None

    def _state(self, before: Any) -> State:
        """The state of what is kept of a step."""
        state: State = before
        return state

    def _tried(self, place: int, last: Last, before: Any) -> Try | None:
        row = None
        try:
            row = self._row(last)
            ends, goal = self._judged(last, row)
            if ends and not goal:
                return None
            if row is None:
                return self._failed(place, None)
            return self._kept(last, row, ends, goal, before)
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            return self._failed(place, row)

    def _row(self, last: Last) -> Row | None:
        """The row of a step; None where SELECT fails, which only counts later."""
        try:
            return self.pieces.row(last)[0]
        except Exception as error:
            if self.compared or isinstance(error, (Stopped, UnsupportedError)):
                raise
            return None

    def _judged(self, last: Last, row: Row | None) -> tuple[bool, bool]:
        """Whether a step stops, and whether it is a goal."""
        pieces = self.pieces
        ends = pieces.ends is not None and pieces.ends(last, row, None)
        return ends, not ends if pieces.is_goal is None else pieces.is_goal(last, row, None)

    def _kept(self, last: Last, row: Row, ends: bool, goal: bool, before: Any) -> Try | None:
        """What `tries` has of a step that leaves a trace, behind `place` and `parent`."""
        state = None if ends else encoded(self.pieces.follow(last, row))
        return key_of(row), encoded(row), encoded(last) if self.keyed else None, goal, not ends, state, False

    def _failed(self, place: int, row: Row | None) -> Try:
        """What `tries` has of a step that has raised an error; one without a row counts whatever others there are."""
        key = b"\xff%d" % place if row is None else key_of(row)  # no key of a row begins like this
        return key, None, None, False, False, None, True

    def fail(self, place: int, state: bytes, known: bool = False) -> None:
        """Takes the step that failed once more, which raises its error; `known`: its row was."""
        before = loads(state)
        for last in islice(self.pieces.elements(self._state(before)), place % ELEMENTS, None):
            row = self._row(last)
            if known:
                self._weighed(last, row)
                break
            ends, _ = self._judged(last, row)
            if row is None:
                row = self.pieces.row(last)[0]
            self._kept(last, row, ends, True, before)
            break
        hint = "see whether a function is declared immutable that is not"
        raise ExecutionError("X009", "a step that failed did not fail again", hints=(hint,))

    def _weighed(self, last: Last, row: Row | None) -> tuple[Any, bool]:
        """What a step weighs, None where nothing is weighed, and whether it is possible."""
        if self.pieces.weigh is None:
            return None, True
        assert row is not None
        weight = self.pieces.weigh(last, row)
        return weight, bool(weight) or not self.pieces.probable


class WeighingTrial(Trial):
    """The same with COST or PROBABILITY. What is kept of a step is its total with the state after it.

    Totals are made as the native search makes them: costs are added up from 0, probabilities multiplied from -1, so
    less is better.
    """

    def _state(self, before: Any) -> State:
        state: State = before[1]
        return state

    def _kept(self, last: Last, row: Row, ends: bool, goal: bool, before: Any) -> Try | None:
        pieces = self.pieces
        weight, possible = self._weighed(last, row)
        if not possible:
            return None
        total = before[0] * weight if pieces.probable else before[0] + weight
        if type(total) is int and total > WHOLE:
            hints = ("write COST in larger units, or leave the engine to ss2sql",)
            raise UnsupportedError("U001", "costs add up to more than 2^53, which tables cannot compare", hints=hints)
        state = None if ends else encoded((total, pieces.follow(last, row)))
        shown = encoded(last) if self.keyed else None
        # Adding 0.0 makes 0.0 of -0.0, which a database need not take for equal.
        return key_of(row), encoded(row), shown, goal, not ends, state, False, total + 0.0

    def _failed(self, place: int, row: Row | None) -> Try:
        return *super()._failed(place, row), None


class GraphTrial(Trial):
    """The same for MEMORIZE: what a step comes to where its row is new, and where it is known, see graph_level.py."""

    def __init__(self, pieces: Pieces, keyed: bool) -> None:
        super().__init__(pieces, keyed, compared=True)

    def _tried(self, place: int, last: Last, before: Any) -> Try | None:
        try:
            row, _ = self.pieces.row(last)
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            return self._failed(place, None)
        weight, leads, weight_failed = self._asked_for_weight(last, row)
        made, failed = None, weight_failed
        try:
            ends, goal = self._judged(last, row)
            if ends and not goal:
                failed = False  # its weight is not asked for
            elif leads:
                made = super()._kept(last, row, ends, goal, before)
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            failed = True
        if not (made or failed or leads or weight_failed):
            return None
        key, shown, _, goal, goes_on, state, _ = made or (key_of(row), None, None, False, False, None, False)
        kept = encoded(last) if self.keyed and leads else None
        return key, shown, kept, goal, goes_on, state, failed, made is not None, leads, weight, weight_failed

    def _asked_for_weight(self, last: Last, row: Row) -> tuple[bytes | None, bool, bool]:
        """What a step weighs, whether it is possible, and whether it failed to say so."""
        try:
            weight, possible = self._weighed(last, row)
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            return None, False, True
        return None if weight is None else dumps(weight, 2), possible, False

    def _kept(self, last: Last, row: Row, ends: bool, goal: bool, before: Any) -> Try | None:
        self._weighed(last, row)
        return super()._kept(last, row, ends, goal, before)

    def _failed(self, place: int, row: Row | None) -> Try:
        return *super()._failed(place, row), False, False, None, False


def encoded(values: State) -> bytes:
    """Values as bytes. Raises UnsupportedError where there are objects among them."""
    try:
        return dumps(values, 2)
    except ValueError:
        raise _no_objects() from None


def key_of(row: tuple[Any, ...]) -> bytes:
    """Bytes that are the same for equal rows. Raises UnsupportedError where there are objects among their values."""
    key = freeze(list(row))
    if not isinstance(key, bytes):
        raise _no_objects()
    # What is compared with all other rows should be short. Two rows with the same digest of 256 bits nobody has seen.
    return key if len(key) <= DIGEST else blake2b(key, digest_size=DIGEST).digest()


def _no_objects() -> UnsupportedError:
    hints = ("show and keep numbers, texts and lists, or leave the engine to ss2sql",)
    return UnsupportedError("U001", "a row or state has an object, which no other database can keep", hints=hints)
