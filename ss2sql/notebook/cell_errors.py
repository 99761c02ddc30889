"""Errors of cells: those of scripts as a message alone, those of the user's functions with their own frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from ss2sql.errors import Error
from ss2sql.errors import render_all as rendered

OWN_FOLDERS = (str(Path(__file__).parent.parent), "src/")  # src/ is apsw


def shorten_traceback(error: Exception, shell: Any) -> Exception:
    """The same exception, with a short traceback in IPython by its method `_render_traceback_`."""
    lines: Callable[[], list[str]]
    if isinstance(error, Error):
        color = getattr(shell, "colors", "nocolor").lower() != "nocolor"
        lines = lambda: [rendered(error, color)]  # noqa: E731
    elif not getattr(error, "_ss2sql_noted", False):
        return error  # it comes from outside of the user's functions
    else:
        frames = keep_user_frames(error.__traceback__)
        lines = lambda: shell.InteractiveTB.structured_traceback(type(error), error, frames)  # noqa: E731
    try:
        error._render_traceback_ = lines  # type: ignore[attr-defined]
    except AttributeError:
        return error  # exceptions with __slots__ cannot be marked; IPython then shows all frames
    return error


def keep_user_frames(traceback: TracebackType | None) -> TracebackType | None:
    """The frames of a traceback without ours and IPython's."""
    frames = []
    while traceback is not None:
        frames.append(traceback)
        traceback = traceback.tb_next
    remaining: TracebackType | None = None
    for frame in reversed(frames):
        if not frame.tb_frame.f_code.co_filename.startswith(OWN_FOLDERS):
            remaining = TracebackType(remaining, frame.tb_frame, frame.tb_lasti, frame.tb_lineno)
    return remaining
