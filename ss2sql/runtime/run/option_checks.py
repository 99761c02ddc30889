"""Checks of what users give for options and limits of a session, a run or a query."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Any

from ss2sql.errors import ExecutionError, SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.values import NUMBERS, format_value
from ss2sql.runtime.run.run_state import measure_memory
from ss2sql.runtime.run.value_sizes import MAX_SIZE, MIN_REMEMBERED_LIMIT


def check_run_limit(name: str, value: Any, least: int) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
        raise SessionError("S002", f"{name} is a whole number of at least {least}, not {value!r}")


def check_seconds(timeout: Any) -> None:
    """Raises SessionError S002 for what is no time to wait."""
    if timeout is not None and (isinstance(timeout, bool) or not isinstance(timeout, int | float)):
        raise SessionError("S002", f"timeout is a number of seconds, not {timeout!r}", hints=("write timeout=5.0",))


def check_option_word(what: str, words: Iterable[Any], known: Collection[str]) -> None:
    """Raises SessionError S002 for a word that is not known."""
    if not isinstance(words, Iterable):
        raise SessionError("S002", f"{what}s are named in a list, not {words!r}", hints=('write ["name", ...]',))
    for word in words:
        if word not in known:
            raise SessionError("S002", f"there is no {what} {word!r}", hints=suggest_names(str(word), known))


@dataclass(frozen=True, slots=True)
class Limits:
    """See `connect`, which documents each of them. None is no limit."""

    max_size: int = MAX_SIZE
    max_memory: int | None = None
    max_steps: int | None = None
    max_output: int | None = None

    def check_limits(self) -> None:
        """Raises SessionError S002 for limits that make no sense, or that cannot be kept here."""
        check_run_limit("max_size", self.max_size, MIN_REMEMBERED_LIMIT)
        if self.max_size is None or self.max_size > MAX_SIZE:
            raise SessionError("S002", f"max_size is at most {MAX_SIZE}, not {self.max_size!r}")
        check_run_limit("max_memory", self.max_memory, 1)
        check_run_limit("max_steps", self.max_steps, 0)
        check_run_limit("max_output", self.max_output, 0)
        if self.max_memory is not None and measure_memory() is None:
            hint = "bound the process from outside"
            message = "max_memory needs /proc/self/statm, which this system does not have"
            raise SessionError("S002", message, hints=(hint,))


NO_LIMITS = Limits()


# --- the values of options and limits, checked when they are known
_AT_LEAST = {
    "COST": "a negative cost would make longer paths ever cheaper",
    "HEURISTIC": "what is left of the path costs at least 0, and HEURISTIC says no more than that",
}


def find_lowest_run_limit(*counts: int | None) -> int | None:
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
    return _check_step_number(value, "COST")


def check_heuristic(value: Any) -> Any:
    """The HEURISTIC of a step; raises ExecutionError X006 if it is not a number of at least 0."""
    return _check_step_number(value, "HEURISTIC")


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


def _check_step_number(value: Any, word: str) -> Any:
    if type(value) not in NUMBERS or value < 0:
        message = f"{word} needs a number of at least 0, not {format_value(value)}"
        reason = _AT_LEAST[word] if type(value) in NUMBERS else f"a cost is a number, for example {word} 1"
        raise ExecutionError("X006", message, hints=(reason,))
    return value
