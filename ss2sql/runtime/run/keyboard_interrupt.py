"""Ctrl-C while a script runs.

Python raises KeyboardInterrupt wherever its main thread happens to be. In the middle of ss2sql that could be between
two halves of something: a table that is registered on one side only, a transaction that nobody ends. So while something
of a session is under way, Ctrl-C is noted, and the run ends the next time that it looks, which it does every few
milliseconds (`Run.check`). Where nothing can be left half done it ends at once: in a function of the user, which may
take long, and in the stages that only compute a value from others.
"""

from __future__ import annotations

import gc
import sys
import threading
import time

# Those of `signal` turn numbers into members of an enumeration and back: 8 us a run.
from _signal import SIGINT, default_int_handler, getsignal  # type: ignore[import-not-found]
from _signal import signal as set_handler
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from inspect import CO_GENERATOR
from types import FrameType
from typing import ParamSpec, TypeVar

from ss2sql.runtime.run.run_state import Run

P = ParamSpec("P")
T = TypeVar("T")

PATIENCE_SECONDS = (
    1.0  # seconds after which a second Ctrl-C ends the run wherever it is: the first one has had no effect
)

_OWN = "ss2sql."
# What computes a value from others, and keeps nothing that could be left half done.
_PURE = tuple(_OWN + name for name in ("frontend.", "lowering.", "results.", "runtime.run.post_processing",
                                       "runtime.representations."))  # fmt: skip
# What others call for a moment: whether it may be broken off depends on who calls it.
_HELPERS = tuple(_OWN + name for name in ("errors", "language", "runtime.run.search_paths"))
_LIBRARIES = sys.stdlib_module_names | {"sqlglot"}


class _CtrlC:
    """What Ctrl-C does while something is under way in the main thread."""

    def __init__(self) -> None:
        self.under_way: list[Run | None] = []  # the innermost last; None is no run
        self.pressed: float | None = None  # when it was pressed first

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        impatient = self.pressed is not None and now - self.pressed > PATIENCE_SECONDS
        if self.pressed is None:
            self.pressed = now
        for run in self.under_way:
            if run is not None:
                run.interrupted = True
        innermost = self.under_way[-1] if self.under_way else None
        if impatient or (innermost is not None and can_interrupt(frame)):
            raise KeyboardInterrupt


_ctrl_c = _CtrlC()


def can_interrupt(frame: FrameType | None) -> bool:
    """Whether a run may end at once where it is: in code of the user, and in stages that only compute."""
    if any(map(_does_lose_interrupt, _iterate_interrupted_code(frame))):
        return False
    while frame is not None:
        name = frame.f_globals.get("__name__") or ""
        own = not name or name.startswith(_OWN)  # what is generated has no name
        if own and frame.f_code.co_flags & CO_GENERATOR:  # it is closed when it is dropped: an error would be lost
            return False
        if own:
            if name and not name.startswith(_HELPERS):
                return name.startswith(_PURE)
        elif name.partition(".")[0] not in _LIBRARIES:
            return True
        frame = frame.f_back
    return True


def _iterate_interrupted_code(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _does_lose_interrupt(frame: FrameType) -> bool:
    """Whether Python prints and forgets an error that leaves this frame."""
    code = frame.f_code
    return (
        code.co_name == "__del__"
        or frame.f_globals.get("__name__") == "weakref"
        or any(getattr(callback, "__code__", None) is code for callback in gc.callbacks)
    )


@contextmanager
def defer_keyboard_interrupt(run: Run | None = None) -> Iterator[None]:
    """Has Ctrl-C noted for as long as something is under way, in the main thread.

    A run notices by itself. What is no run is finished first: KeyboardInterrupt is raised after it. Only Python's own
    way to handle Ctrl-C is replaced; whoever has set another one decides what it means.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _ctrl_c.under_way and getsignal(SIGINT) is not default_int_handler:
        yield
        return
    # While Python's own way is in force, KeyboardInterrupt may come anywhere, so nothing is changed then.
    if not _ctrl_c.under_way:
        _ctrl_c.pressed = None
        set_handler(SIGINT, _ctrl_c)
    _ctrl_c.under_way.append(run)
    if run is not None:
        run.interrupted = _ctrl_c.pressed is not None
    try:
        yield
    finally:
        _ctrl_c.under_way.pop()
        if not _ctrl_c.under_way:
            if getsignal(SIGINT) is _ctrl_c:  # else a function of the user has set another one
                set_handler(SIGINT, default_int_handler)
            if _ctrl_c.pressed is not None:
                if run is None:
                    raise KeyboardInterrupt
                run.interrupted = True


def without_keyboard_interrupt(work: Callable[P, T]) -> Callable[P, T]:
    """Decorator: what Ctrl-C does not break off in the middle."""

    @wraps(work)
    def call_uninterrupted(*arguments: P.args, **named: P.kwargs) -> T:
        with defer_keyboard_interrupt():
            return work(*arguments, **named)

    return call_uninterrupted


def close_frames(error: BaseException) -> None:
    """Closes what the frames of an interrupted run hold, while Ctrl-C is noted.

    A traceback keeps the generators of a search. Closed later, with the traceback, they would lose another Ctrl-C.
    """
    from traceback import clear_frames

    raised: BaseException | None = error
    while raised is not None:
        clear_frames(raised.__traceback__)
        raised = raised.__context__
