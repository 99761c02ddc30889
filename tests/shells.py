"""What tests of the shell share: a folder to be in, and to remember in."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

TWICE = '''
def twice(x):
    """Twice the value."""
    return 2 * x
'''


def moved_into(folder: Path, monkeypatch: pytest.MonkeyPatch, functions: str = TWICE) -> Path:
    """The folder, with a file of functions, as the current one; what is imported or remembered there stays there."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    (folder / "functions.py").write_text(functions)
    return folder
