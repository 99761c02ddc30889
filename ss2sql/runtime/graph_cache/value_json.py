"""Values as JSON text, and back as exactly what they were."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from itertools import chain
from marshal import dumps
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import convert_value
from ss2sql.language.frozen_values import Frozen, State, thaw_value
from ss2sql.language.kinds import Opaque, is_encodable
from ss2sql.language.rows import Row
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable

_OTHER_KEYS = "JSON has no form for a dict with keys that are no text"


class CachedStep:
    """A step: its row, the state it leads to, its elements, and what clauses said of it, by their keys.

    The state is None where CONNECT BY is not evaluated, the elements where FROM is read again.
    """

    __slots__ = ("after", "elements", "row", "verdicts")

    def __init__(
        self, row: Row, after: State | None, elements: tuple[Any, ...] | None, verdicts: dict[str, Any]
    ) -> None:
        self.row = row
        self.after = after
        self.elements = elements
        self.verdicts = verdicts


def _thaw_or_refuse(value: Any) -> Any:
    if isinstance(value, Frozen):
        return value.value
    value = value.object if isinstance(value, Opaque) else value
    raise NotCacheable(f"JSON has no form for an object of the type {type(value).__name__}")


_encode = json.JSONEncoder(
    ensure_ascii=False, allow_nan=False, check_circular=False, separators=(",", ":"), default=_thaw_or_refuse
).encode
# What only another program writes, or a long number or a text: large integers, NaN, infinities, halves of characters.
_SUSPECT = re.compile(r"\d{16}|\d[eE]|[IN]|\\u[dD]")
_decode = json.JSONDecoder().decode


def encode_values_as_json(value: Any) -> str:
    """A tuple of values, which may be frozen, as JSON. Raises NotCacheable where JSON would give back others."""
    try:
        text = _encode(value)
    except TypeError:
        raise NotCacheable(_OTHER_KEYS) from None
    except (ValueError, RecursionError) as error:
        raise NotCacheable(f"JSON has no form for a value: {error}") from None
    # Of keys that are numbers JSON makes text; a tuple comes back as a list.
    if "{" in text and dumps(thaw_value(value), 2) != dumps(_decode(text), 2):
        raise NotCacheable(_OTHER_KEYS)
    if not is_encodable(text):
        raise NotCacheable("a text holds half of a character (a lone surrogate)")
    return text


def encode_steps(steps: Sequence[CachedStep]) -> str:
    """The steps of a state as JSON. Raises NotCacheable."""
    parts = [(step.row, step.after, step.elements, [*sum(step.verdicts.items(), ())]) for step in steps]
    return encode_values_as_json(tuple(parts))


def decode_steps(texts: Sequence[str], widths: tuple[int, int, int]) -> list[list[CachedStep]]:
    """The steps of states, whose rows, next states and elements have so many values.

    Raises ValueError for a text that is none of steps, such as another program may have written.
    """
    text = f"[{','.join(texts)}]"
    try:
        states = _decode(text)
        steps = [[_build_step(widths, *parts) for parts in state] for state in states]
        if _SUSPECT.search(text):
            for row, after, elements, said in chain.from_iterable(states):
                for value in chain(row, after or (), elements or (), said):
                    convert_value(value, "a value")
    except (TypeError, LookupError, RecursionError) as error:
        raise ValueError(f"they hold no steps: {error}") from None
    except ExecutionError as error:
        raise ValueError(error.message) from None
    if len(states) != len(texts):
        raise ValueError("there is a text that is none of one list")
    return steps


def _build_step(widths: tuple[int, int, int], row: Any, after: Any, elements: Any, said: list[Any]) -> CachedStep:
    for values, width in zip((row, after, elements), widths, strict=True):
        if (values is not None or values is row) and (type(values) is not list or len(values) != width):
            raise ValueError(f"there are not {width} values in {str(values)[:40]}")
    verdicts = dict(zip(said[::2], said[1::2], strict=True)) if said else {}
    for key, value in verdicts.items():
        if not value >= 0 or (value > 1 and not key.startswith("cost")):
            raise ValueError(f"a {key.partition(' ')[0]} is {value!r}")
    return CachedStep(tuple(row), after and tuple(after), elements and tuple(elements), verdicts)
