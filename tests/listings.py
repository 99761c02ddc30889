"""The listings of the paper, of the examples or of cases/listings, and the function that its Towers of Hanoi call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


def move(step: Any, towers: Any) -> Any:
    """It changes its argument; an empty list says that the step is not allowed."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


LISTINGS, EXAMPLES = Path(__file__).parent / "cases/listings", Path(__file__).parent.parent / "examples"


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8").removesuffix("\n")


HANOI = {"nested": text_of(EXAMPLES / "hanoi/1_nested.ss"), **{
    name: text_of(LISTINGS / f"{name}.ss") for name in ("cycle", "no-cycle", "memorize")}}  # fmt: skip
ROBOT, SPACE = text_of(EXAMPLES / "navigation/1_paths.ss"), text_of(EXAMPLES / "chaos/3_planes.ss")
