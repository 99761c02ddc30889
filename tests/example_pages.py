"""Runs the examples for the tests: each once, in an empty folder, when it is first asked for.

`tests/mutants.py` forgets them, so that an example may run again.
"""

from __future__ import annotations

import io
import runpy
import sys
import time
from collections import Counter
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

EXAMPLES = Path(__file__).parent.parent / "examples"
FOLDER = TemporaryDirectory()  # removed when the tests end


@dataclass
class Played:
    """An example that has run: its module, its page, what it printed, how long it took, where it has put pictures."""

    module: dict[str, Any]
    page: Any
    text: str
    seconds: float
    folder: Path

    def value(self, name: str) -> Any:
        return self.result(name).value

    def result(self, name: str) -> Any:
        return next(shown.result for shown in self.page.shown if shown.name == name)

    def lengths(self, name: str) -> dict[int, int]:
        return dict(Counter(map(len, self.result(name).paths)))

    def picture(self, name: str) -> Path:
        """A picture that the page has written, and has told where."""
        (path,) = (path for path in self.page.pictures if path.name == name)
        assert str(path) in " ".join(self.text.split())
        return self.folder / path


@cache
def play(name: str) -> Played:
    """Runs an example."""
    printed, started = io.StringIO(), time.process_time()
    path, folder = sys.path[:], Path(mkdtemp(dir=FOLDER.name))
    with chdir(folder), redirect_stdout(printed):
        module = runpy.run_path(str(EXAMPLES / name / "run.py"))
        page = module["main"]()
    sys.path[:] = path
    return Played(module, page, printed.getvalue(), time.process_time() - started, folder)
