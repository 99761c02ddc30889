"""The history of input: a file in the user's state folder that only the user can read."""

from __future__ import annotations

import os
from pathlib import Path

MAX_ENTRIES = 5000  # entries; the file may have twice as many before it is cut


def find_state_folder() -> Path:
    """The folder for programs' state, by the XDG rules."""
    folder = os.environ.get("XDG_STATE_HOME", "")
    base = Path(folder) if os.path.isabs(folder) else Path.home() / ".local" / "state"
    return base / "ss2sql"


def open_history_file() -> Path:
    """The file, created if missing, readable by its owner alone. Raises OSError.

    It has the format of prompt_toolkit: an empty line, `# ` and the time, the lines of the entry after `+`.
    """
    folder = find_state_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = folder / "history"
    # O_NOFOLLOW: somebody else's link would make the shell write to its target.
    number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    with os.fdopen(number, "r+b") as file:
        if hasattr(os, "fchmod"):
            os.fchmod(file.fileno(), 0o600)
        entries = file.read().split(b"\n\n# ")
        if len(entries) > 2 * MAX_ENTRIES:
            file.seek(0)
            file.write(b"\n\n# " + b"\n\n# ".join(entries[-MAX_ENTRIES:]))
            file.truncate()
    return path


def should_remember(text: str) -> bool:
    """Whether a text belongs into the history: texts that begin with a blank do not."""
    return bool(text.strip()) and not text[0].isspace()
