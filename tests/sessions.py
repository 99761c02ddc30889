"""What tests of sessions share: both engines, the code of an error, a clock, and a way to write to a database file."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import apsw
import pytest

import ss2sql

ENGINES = ("database", "native")
STAFF = """
    CREATE TABLE staff(id INTEGER PRIMARY KEY, boss INTEGER, name TEXT);
    INSERT INTO staff VALUES (1, NULL, 'Ada'), (2, 1, 'Bob'), (3, 1, 'Cy'), (4, 2, 'Di');
    CREATE VIEW chiefs AS SELECT name FROM staff WHERE boss IS NULL;
"""


def code_of(call: Any, *arguments: Any, **named: Any) -> str:
    """The code of the error that a call ends with."""
    with pytest.raises(ss2sql.Error) as caught:
        call(*arguments, **named)
    return caught.value.code


def failure(call: Any, *arguments: Any) -> ss2sql.ExecutionError:
    """The error that a call ends with, which says what to do."""
    with pytest.raises(ss2sql.ExecutionError) as caught:
        call(*arguments)
    assert caught.value.hints
    assert all(caught.value.hints)
    return caught.value


def answers(ss: ss2sql.Session, script: str) -> Any:
    """What a script gives, the same on both engines."""
    one, other = (ss.run(script, engine=engine).value for engine in ENGINES)
    assert one == other
    return one


def wrong_scripts(name: str) -> Iterator[tuple[str, list[str], str]]:
    """The scripts of `cases/errors/NAME.errors`, each behind the code of its error and words that the error shows."""
    text = (Path(__file__).parent / "cases" / "errors" / f"{name}.errors").read_text("utf-8")
    code, words = "", [""]
    for line in text.splitlines()[1:]:
        if line.startswith("    "):
            yield code, words, line.strip()
        elif line and not line.startswith("# "):
            code, _, told = line.partition(" ")
            words = told.split(" | ")


def samples(name: str) -> dict[str, str]:
    """The Python texts of `cases/purity/NAME.txt` by their titles, which stand behind # and a blank."""
    text = (Path(__file__).parent / "cases" / "purity" / f"{name}.txt").read_text("utf-8")
    return dict(re.findall(r"^# (.*)\n((?:(?!# ).*\n)+)", text, re.MULTILINE))


class Clock:
    """A clock that is set by hand."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


def write(file: Path, script: str) -> None:
    """Runs statements of SQL on a database file, which is made where it is missing.

    It is the SQLite of the session that writes: the locks of two copies of SQLite in one process do not see each other.
    """
    connection = apsw.Connection(str(file))
    with connection:
        connection.execute(script)
    connection.close()


def leaping(monkeypatch: pytest.MonkeyPatch, step: int) -> Callable[[int], int]:
    """A function n + 1, at whose call for `step` the clock that runs look at leaps ahead by two hours.

    So a run with a timeout of an hour ends about there, however slow or quick the machine is.
    """
    clock = SimpleNamespace(monotonic=time.monotonic)
    monkeypatch.setattr("ss2sql.runtime.run.run_state.time", clock)

    def leap(n: int) -> int:
        if n == step:
            clock.monotonic = lambda: time.monotonic() + 7200
        return n + 1

    return leap
