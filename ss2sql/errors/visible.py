"""Text for terminals: what a terminal would obey is written as in a script.

A script comes from somebody, and so do data. Control characters could set the title of a window, move the cursor over
what was printed before, or have the terminal send text as if it were typed; signs that turn the direction of writing
show another text than the one that is there; half of a surrogate pair cannot be written at all.
"""

from __future__ import annotations

import re

OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: str) -> str:
    """The text with `\\x1b` for an escape character, and so on. Ends of lines and tabs stay what they are."""
    return text if text.isascii() and text.isprintable() else OBEYED.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    return repr(found.group())[1:-1]
