"""Parsing and compiling: the paper's robot listing, and calls nested one and eight deep."""

from __future__ import annotations

from pathlib import Path

from problems.base import Compiling

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


def nested(depth: int) -> str:
    """The smallest script with calls nested so deep."""
    return f"{'f(' * depth}1{')' * depth};"


PROBLEMS = (
    Compiling("robot listing", LISTING.read_text("utf-8"), (position, move, checkCollision, playSound), limit=10.0),
    Compiling("nested calls, depth 1", nested(1), (f,)),
    Compiling("nested calls, depth 8", nested(8), (f,)),
)
