"""Functions in the plan: what is known of them before they are called."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any, Literal, TypeAlias

from ss2sql.records import dataclass

Volatility: TypeAlias = Literal["immutable", "stable", "volatile"]


@dataclass(frozen=True, slots=True)
class Function:
    """What the plan knows of a function; the callable stays in the session.

    `raises` is False only if the call cannot fail. `reason` is that of the volatility, `body` see frontend/inline.py.
    `vectorized` functions take arrays. `of_world` is what scripts call a function that worlds bring along. One that
    `has_inverse` was registered with it; `inverse_of` names the function whose inverse this is.
    With GROUP BY one that `collects` gets the list of the values of a group.
    """

    name: str
    minimum: int
    maximum: int | None
    volatility: Volatility
    builtin: bool = True
    raises: bool = True
    reason: str = field(default="", compare=False)
    parameters: tuple[str, ...] = field(default=(), compare=False)
    body: Any = field(default=None, compare=False, repr=False)
    vectorized: bool = field(default=False, compare=False)
    of_world: str = field(default="", compare=False)
    has_inverse: bool = field(default=False, compare=False)
    inverse_of: str = ""
    collects: bool = False

    def inverted(self) -> Function:
        """The inverse: with the value of the function in the place of one of the arguments it gives that argument."""
        return replace(self, name=f"inverse of {self.name}", has_inverse=False, inverse_of=self.name, body=None)
