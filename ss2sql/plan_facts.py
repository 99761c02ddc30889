"""What the plan tells a representation that makes facts of the columns of SELECT."""

from __future__ import annotations

from typing import NamedTuple


class Fact(NamedTuple):
    """A column of SELECT as a fact. It holds no expressions, so it is no node of the plan.

    `name` is empty where the column's own is meant, `places` are those of the arguments among the hidden columns, and
    `valued` says whether the column's value stands behind them.
    """

    name: str
    places: tuple[int, ...]
    valued: bool = True
