"""Ending a statement that works on whole tables when its run has to end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from ss2sql.runtime.run.run_state import Run

CHECK_SECONDS = 0.02  # seconds


class Interruptible(Protocol):
    def interrupt_statement(self) -> None:
        """Ends the statement that runs in another thread; it may be called again until the run has ended."""


class OpenedDatabase(Interruptible, Protocol):
    """What a run has opened in another database."""

    def close_tables(self) -> None:
        """Lets go of everything."""


@contextmanager
def interrupt_when_due(run: Run, opened: Interruptible) -> Iterator[None]:
    """Has a thread of its own look whether the run is interrupted or late, for as long as it takes."""
    over = threading.Event()

    def watch_run() -> None:
        while not over.wait(CHECK_SECONDS):
            if run.interrupted or (run.bounds.deadline is not None and time.monotonic() >= run.bounds.deadline):
                opened.interrupt_statement()  # again and again: it may have come between two statements

    thread = threading.Thread(target=watch_run, daemon=True)
    thread.start()
    try:
        yield
    except Exception:
        run.check()  # what the database says about it comes second
        raise
    finally:
        over.set()
        thread.join()
