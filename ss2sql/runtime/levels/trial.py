"""Trying the steps from one state in Python: what a table notes of them."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import blake2b
from itertools import islice
from marshal import dumps, loads
from typing import Any, TypeAlias

from ss2sql.errors import ExecutionError, Stopped, UnsupportedError
from ss2sql.runtime.memorize.pieces import Last, Pieces, State
from ss2sql.runtime.rows import Row
from ss2sql.runtime.values import freeze

DIGEST = 32  # bytes
ELEMENTS = 1 << 24  # a place is a step and an element, in 64 bits

Try: TypeAlias = tuple[Any, ...]  # a row of `tries`


class Trial:
    """The clauses of a search, asked for steps. `keyed`: GROUP BY or ORDER BY ask for the last part of a result."""

    def __init__(self, pieces: Pieces, keyed: bool) -> None:
        self.pieces, self.keyed = pieces, keyed

    def steps(self, step: int, state: bytes) -> Iterator[Try | None]:
        """What `tries` has of each step from the state that a step led to; None for those that come to nothing.

        Raises UnsupportedError where another database cannot keep what a step comes to.
        """
        for nth, last in enumerate(self._lasts(loads(state))):
            if nth == ELEMENTS:
                raise UnsupportedError("U001", f"a state has more than {ELEMENTS:,} elements", hints=("bound FROM",))
            place = step * ELEMENTS + nth
            made = self._failed(place, None) if last is None else self._tried(place, last)
            yield None if made is None else (place, step, *made)

    def _lasts(self, state: State) -> Iterator[Last | None]:
        """The elements of a state with it; at the end None where the sources fail."""
        try:
            yield from self.pieces.elements(state)
        except (Stopped, UnsupportedError):
            raise
        except Exception:  # raised by `fail`, if it counts
            yield None

    def _tried(self, place: int, last: Last) -> Try | None:
        pieces = self.pieces
        row = None
        try:
            row, _ = pieces.row(last)
            ends = pieces.ends is not None and pieces.ends(last, row, None)
            goal = not ends if pieces.is_goal is None else pieces.is_goal(last, row, None)
            if ends and not goal:
                return None
            state = None if ends else encoded(pieces.follow(last, row))
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            return self._failed(place, row)
        return key_of(row), encoded(row), encoded(last) if self.keyed else None, goal, not ends, state, False

    def _failed(self, place: int, row: Row | None) -> Try:
        """What `tries` has of a step that has raised an error; one without a row counts whatever others there are."""
        key = b"\xff%d" % place if row is None else key_of(row)  # no key of a row begins like this
        return key, None, None, False, False, None, True

    def fail(self, place: int, state: bytes) -> None:
        """Takes the step that failed once more, which raises its error."""
        for last in islice(self.pieces.elements(loads(state)), place % ELEMENTS, None):
            row, _ = self.pieces.row(last)
            for clause in (self.pieces.ends, self.pieces.is_goal):
                if clause is not None:
                    clause(last, row, None)
            self.pieces.follow(last, row)
            break
        hint = "see whether a function is declared immutable that is not"
        raise ExecutionError("X009", "a step that failed did not fail again", hints=(hint,))


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
