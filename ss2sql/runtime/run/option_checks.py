"""Checks of what users give for options of a session or a run, and the limits of a session."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from ss2sql.errors import SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.run.run_state import measure_memory
from ss2sql.runtime.run.value_sizes import MAX_SIZE, MIN_REMEMBERED_LIMIT


def check_bound(name: str, value: Any, least: int) -> None:
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
        check_bound("max_size", self.max_size, MIN_REMEMBERED_LIMIT)
        if self.max_size is None or self.max_size > MAX_SIZE:
            raise SessionError("S002", f"max_size is at most {MAX_SIZE}, not {self.max_size!r}")
        check_bound("max_memory", self.max_memory, 1)
        check_bound("max_steps", self.max_steps, 0)
        check_bound("max_output", self.max_output, 0)
        if self.max_memory is not None and measure_memory() is None:
            hint = "bound the process from outside"
            message = "max_memory needs /proc/self/statm, which this system does not have"
            raise SessionError("S002", message, hints=(hint,))


NO_LIMITS = Limits()
