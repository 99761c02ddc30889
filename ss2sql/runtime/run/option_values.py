"""The values of options and limits, checked when they are known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.values import NUMBERS, format_value

_AT_LEAST = {
    "COST": "a negative cost would make longer paths ever cheaper",
    "HEURISTIC": "what is left of the way costs at least 0, and HEURISTIC says no more than that",
}


def find_least(*counts: int | None) -> int | None:
    """The lowest of the counts that there are."""
    return min((count for count in counts if count is not None), default=None)


def check_count_value(value: Any, least: int, word: str) -> int:
    """The value of LIMIT, MAXIMUM or MEMORIZE; raises ExecutionError X006 if it is not a number of at least `least`."""
    if type(value) is not int or value < least:
        message = f"{word} needs a whole number of at least {least}, not {format_value(value)}"
        hint = "int(...) makes a whole number" if type(value) in (str, float) else f"for example {word} 10"
        raise ExecutionError("X006", message, hints=(hint,))
    return value


def check_cost(value: Any) -> Any:
    """The COST of a step; raises ExecutionError X006 if it is not a number of at least 0."""
    return _check_not_negative(value, "COST")


def check_heuristic(value: Any) -> Any:
    """The HEURISTIC of a step; raises ExecutionError X006 if it is not a number of at least 0."""
    return _check_not_negative(value, "HEURISTIC")


def check_probability(value: Any) -> Any:
    """The PROBABILITY of a step; raises ExecutionError X006 if it is not a number from 0 to 1."""
    if type(value) not in NUMBERS or not 0 <= value <= 1:
        message = f"PROBABILITY needs a number from 0 to 1, not {format_value(value)}"
        raise ExecutionError("X006", message, hints=("divide by the sum of all weights to get probabilities",))
    return value


def is_proven(promised: Type, check: Callable[[Any], Any]) -> bool:
    """Whether the type of a value already says what the check would find."""
    if not promised.is_only(Kind.NUMBER) or promised.low is None or promised.low < 0:
        return False
    return check is not check_probability or (promised.high is not None and promised.high <= 1)


def _check_not_negative(value: Any, word: str) -> Any:
    if type(value) not in NUMBERS or value < 0:
        message = f"{word} needs a number of at least 0, not {format_value(value)}"
        reason = _AT_LEAST[word] if type(value) in NUMBERS else f"a cost is a number, for example {word} 1"
        raise ExecutionError("X006", message, hints=(reason,))
    return value
