"""What tests of `workers` share: searches, the comparison with one process, and the processes of a session."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from typing import Any

import worker_functions

import ss2sql

GRAPH = """SELECT onward(n, this) FROM [1, 2, 3] {where}
START WITH n = 1 CONNECT BY MEMORIZE {bound} {options} n = onward(n, this) {stop};"""
# How a program in a process of its own begins, so that all calls are worth other processes.
EAGER = """
import ss2sql
from ss2sql.runtime.workers import foretelling, timing
timing.SAMPLES, timing.CHEAP, foretelling.LEAST, foretelling.START = 0, 0.0, 0.0, 0.0
foretelling.Foreteller._own_answer = lambda _: None
"""


def declare(session: ss2sql.Session, *names: str, **others: Callable[..., Any]) -> None:
    """Registers functions of worker_functions, and others, as immutable."""
    for name in names:
        session.function(name, getattr(worker_functions, name), volatility="immutable")
    for name, function in others.items():
        session.function(name, function, volatility="immutable")


def graph(where: str = "", options: str = "", stop: str = "", bound: int = 4) -> str:
    return GRAPH.format(where=where, options=options, stop=stop, bound=bound)


def same(session: ss2sql.Session, script: str, **named: Any) -> int:
    """Compares two workers with one, and gives the number of calls that were made here."""
    one = session.run(script, **named)
    worker_functions.MADE.made = 0
    two = session.run(script, workers=2, **named)
    made = worker_functions.MADE.made
    assert repr(two.value) == repr(one.value)
    for name in ("calls", "remembered", "generated", "expanded", "pruned", "levels"):
        assert getattr(two.stats, name) == getattr(one.stats, name), name
    assert one.stats.calls
    return made


def processes_of(session: ss2sql.Session) -> list[subprocess.Popen[bytes]]:
    processes = session.host.processes
    crew = processes._crew if processes is not None else None
    return list(crew.processes) if crew is not None else []
