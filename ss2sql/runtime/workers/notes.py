"""Why `workers` has no effect, on a whole run or on a function: said once in a run, and kept for `explain`."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

from ss2sql.errors import WorkersWarning
from ss2sql.runtime.run import Stats

_PACKAGE = str(Path(__file__).parents[2])


def tell(stats: Stats, reason: str, cure: str = "") -> None:
    """Warns with a `WorkersWarning` at the place in the user's code that started the run, and notes the same."""
    text = f"workers: {reason}; {cure}" if cure else f"workers: {reason}"
    if text not in stats.notes:
        stats.notes.append(text)
        warnings.warn(text, WorkersWarning, stacklevel=_frames_of_the_package())


def _frames_of_the_package() -> int:
    """The number of frames up to the first one that is not of ss2sql, nor of code that it has made."""
    frame, number = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith((_PACKAGE, "<")):
        frame, number = frame.f_back, number + 1
    return number
