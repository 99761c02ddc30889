"""What a problem consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Problem:
    """A search, and the same search as a loop by hand.

    `script` gives a list of paths; `loop` gives the lengths of the same paths in the same order, with the same Python
    functions, copying what they change.
    """

    name: str
    script: str
    loop: Callable[[], list[int]]
    functions: tuple[Callable[..., Any], ...] = ()
    variables: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Compiling:
    """A script that is parsed, resolved and lowered, but not run. `limit` is the promised number of milliseconds."""

    name: str
    script: str
    functions: tuple[Callable[..., Any], ...] = ()
    limit: float | None = None
