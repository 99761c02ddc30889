"""What was typed before: a file in the user's state folder that nobody else can read."""

from __future__ import annotations

import os
from pathlib import Path

KEPT = 5000  # entries; the file may have twice as many before it is cut


def state_folder() -> Path:
    """The folder for what programs remember, by the XDG rules."""
    given = os.environ.get("XDG_STATE_HOME", "")
    base = Path(given) if os.path.isabs(given) else Path.home() / ".local" / "state"
    return base / "ss2sql"


def history_file() -> Path:
    """The file, made if it is not there, for its owner alone. Raises OSError where that cannot be.

    It has the form of prompt_toolkit: an empty line, `# ` and the time, the lines of the entry behind `+`.
    """
    folder = state_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = folder / "history"
    # O_NOFOLLOW: a link put there by somebody else would have the shell write to where it leads.
    number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    with os.fdopen(number, "r+b") as file:
        if hasattr(os, "fchmod"):
            os.fchmod(file.fileno(), 0o600)
        entries = file.read().split(b"\n\n# ")
        if len(entries) > 2 * KEPT:
            file.seek(0)
            file.write(b"\n\n# " + b"\n\n# ".join(entries[-KEPT:]))
            file.truncate()
    return path


def is_kept(text: str) -> bool:
    """Whether a text belongs into the history: one that begins with a blank does not."""
    return bool(text.strip()) and not text[0].isspace()
