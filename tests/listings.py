"""The listings of the paper, as printed, and the function that its Towers of Hanoi call."""

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


PRINTED = {path.stem: path.read_text(encoding="utf-8") for path in (Path(__file__).parent / "cases/listings").iterdir()}
HANOI = {name: PRINTED[name].removesuffix("\n") for name in ("nested", "cycle", "no-cycle", "memorize")}
ROBOT, SPACE = PRINTED["robot"], PRINTED["space"]
