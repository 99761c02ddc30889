"""Parsing, resolving and lowering: the paper's robot listing, and calls nested so deep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from problems.base import COMPILING, Prepare, Problem, Target, Work

LISTING = Path(__file__).parents[2] / "examples" / "robot" / "paths.ss"


def position(robot: str) -> list[float]:
    return [0.0, 0.0]


def move(robot: str, place: list[float]) -> list[float]:
    return place


def checkCollision(robot: str) -> bool:  # noqa: N802 - the paper's name
    return False


def playSound(file: str) -> None:  # noqa: N802
    return None


def f(number: int) -> int:
    return number


def robot(size: int) -> str:
    return LISTING.read_text("utf-8") * size


def nested(depth: int) -> str:
    """The smallest script with calls nested so deep."""
    return f"{'f(' * depth}1{')' * depth};"


def compiled(text: Callable[[int], str], functions: tuple[Callable[..., Any], ...]) -> Prepare:
    def prepare(size: int) -> Work:
        import ss2sql

        ss = ss2sql.connect()
        for function in functions:
            ss.function(function)
        script = text(size)
        return Work(lambda: bool(ss.compile(script).sql))

    return prepare


PROBLEMS = (
    Problem(
        "compile-robot",
        "compiling the paper's robot listing",
        "listing",
        (1,),
        1,
        None,
        {COMPILING: compiled(robot, (position, move, checkCollision, playSound))},
        "that there is a text of SQL",
        bool,
        targets=(Target(0.010, None, COMPILING),),
    ),
    Problem(
        "compile-nested",
        "compiling calls nested so deep",
        "calls",
        (1, 8, 64),
        1,
        None,
        {COMPILING: compiled(nested, (f,))},
        "that there is a text of SQL",
        bool,
    ),
)
