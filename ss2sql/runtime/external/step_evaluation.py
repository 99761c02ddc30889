"""Trying the steps from one state in Python: what a table notes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from hashlib import blake2b
from marshal import dumps, loads
from typing import Any, TypeAlias

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.frozen_values import FrozenRow, FrozenShapes, State
from ss2sql.language.values import make_hashable
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, build_element_limit_error
from ss2sql.runtime.search.step_contract import Expand

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
        for nth, (row, _, goal, goes_on, after, _, _, last) in enumerate(tried):
            if nth == MAX_ELEMENTS:
                raise build_element_limit_error("a state")
            key, *noted = self.encode_step(row, last, after if goes_on else None)
            yield step * MAX_ELEMENTS + nth, key, goal, goes_on, *noted

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
        raise _build_object_error() from None


def _encode_row_key(row: tuple[Any, ...]) -> bytes:
    """Bytes that are the same for equal rows. Raises UnsupportedError where there are objects among their values."""
    key = make_hashable(list(row))
    if not isinstance(key, bytes):
        raise _build_object_error()
    # What is compared with all other rows should be short. Two rows with the same digest of 256 bits nobody has seen.
    return key if len(key) <= DIGEST else blake2b(key, digest_size=DIGEST).digest()


def _build_object_error() -> UnsupportedError:
    hints = ("show and keep numbers, texts and lists, or leave the engine to ss2sql",)
    return UnsupportedError("U001", "a row or state has an object, which no other database can keep", hints=hints)
