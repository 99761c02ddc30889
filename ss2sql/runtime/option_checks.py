"""Checks of what users give for options of a session or a run."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from ss2sql.errors import SessionError, did_you_mean


def check_bound(name: str, value: Any, least: int) -> None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
        raise SessionError("S002", f"{name} is a whole number of at least {least}, not {value!r}")


def check_seconds(timeout: Any) -> None:
    """Raises SessionError S002 for what is no time to wait."""
    if timeout is not None and (isinstance(timeout, bool) or not isinstance(timeout, int | float)):
        raise SessionError("S002", f"timeout is a number of seconds, not {timeout!r}", hints=("write timeout=5.0",))


def check_known(what: str, words: Iterable[Any], known: Collection[str]) -> None:
    """Raises SessionError S002 for a word that is not known."""
    if not isinstance(words, Iterable):
        raise SessionError("S002", f"{what}s are named in a list, not {words!r}", hints=('write ["name", ...]',))
    for word in words:
        if word not in known:
            raise SessionError("S002", f"there is no {what} {word!r}", hints=did_you_mean(str(word), known))
