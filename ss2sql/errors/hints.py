"""Hints: known names that are similar to the one that was written; the wording for a shell."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TypeAlias
from unicodedata import normalize

from ss2sql.errors.exceptions import Error

Spellings: TypeAlias = tuple[tuple[re.Pattern[str], str], ...]

FEW = 8  # up to so many names are all shown


def suggest_similar(name: str, known: Iterable[str]) -> list[str]:
    """The known names, three at most, with a similar spelling; a name that differs only in case is returned alone."""
    from difflib import get_close_matches

    lowered = {one.lower(): one for one in sorted(set(known), reverse=True)}
    if name.lower() in lowered:
        return [lowered[name.lower()]]
    close = get_close_matches(name.lower(), list(lowered), n=3, cutoff=0.6)
    # get_close_matches misses a name that merely lost its tail (mov for moves): offer prefixes as well.
    close += [one for one in sorted(lowered) if one not in close and len(name) > 1 and one.startswith(name.lower())]
    return [lowered[one] for one in close[:3]]


def suggest_names(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Hints with the closest known names, or with all names where there are few."""
    names = sorted(set(known))
    if twins := [one for one in names if one != name and normalize("NFKC", one) == normalize("NFKC", name)]:
        return tuple(f"did you mean '{one}', which is written with {_spell_code_points(one)}?" for one in twins)
    if close := suggest_similar(name, names):
        return ("did you mean " + " or ".join(f"'{one}'" for one in close) + "?",)
    if 0 < len(names) <= FEW:
        return ("known here: " + ", ".join(names),)
    return ()


def _spell_code_points(name: str) -> str:
    """A name with the code points of its characters beyond ASCII, for names that look the same."""
    return ", ".join(f"U+{ord(char):04X}" if not char.isascii() else char for char in name)


def respell_hints(error: Error, spellings: Spellings) -> None:
    """Rewrites hints for users of Python into hints for a command line or a shell."""
    for one in error.errors:
        for pattern, spelling in spellings:
            one.hints = tuple(pattern.sub(spelling, hint) for hint in one.hints)
