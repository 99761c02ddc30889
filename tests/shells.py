"""What tests of the shell share: a folder to be in, and to remember in."""

from __future__ import annotations

from pathlib import Path

import command_lines
import pytest

TWICE = '''
def twice(x):
    """Twice the value."""
    return 2 * x
'''


def moved_into(folder: Path, monkeypatch: pytest.MonkeyPatch, functions: str = TWICE) -> Path:
    """The folder, with a file of functions, as the current one; what is imported or remembered there stays there."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    return command_lines.moved_into(folder, monkeypatch, {"functions.py": functions})
