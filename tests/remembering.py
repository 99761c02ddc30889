"""What tests of remembered graphs share: a maze whose steps come from Python functions, and runs in new processes."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import textwrap
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import ss2sql

# From a node two and three times as far, and one back.
MAZE = """SELECT n.this FROM n = near(node) WHERE n.this == goal
START WITH node = first CONNECT BY MEMORIZE bound node = n.this STOP WITH n.this > limit AS list"""
MODULE = '''
import os, time

def near(node):
    """The neighbours of a node."""
    time.sleep(float(os.environ.get("SECONDS", "0")))
    return [2 * node, 3 * node, node - 1]
'''


def near(node: int) -> list[int]:
    """The neighbours of a node, as the module has them. It is more than one expression, so it is called."""
    twice = 2 * node
    return [twice, 3 * node, node - 1]


def connect(path: Path | str | None, **options: Any) -> ss2sql.Session:
    """A session with `near`."""
    ss = ss2sql.connect(path, **options)
    ss.function("near", near)
    return ss


def session(path: Path | str | None, **functions: Callable[..., Any]) -> ss2sql.Session:
    """A session whose functions are called, whatever they are."""
    ss = ss2sql.connect(path, disable=["inline"])
    for name, function in functions.items():
        ss.function(name, function, volatility="immutable")
    return ss


def run(ss: ss2sql.Session, goal: int = 6, bound: int = 4, first: int = 1, limit: int = 40) -> ss2sql.Result:
    """One search in the maze."""
    script = MAZE.replace("bound", str(bound))
    return ss.run(script, goal=goal, first=first, limit=limit)


def scratch(**options: Any) -> ss2sql.Result:
    """The search without a file."""
    with connect(None) as ss:
        return run(ss, **options)


def fresh(**options: Any) -> Any:
    """What the search gives without a file."""
    return scratch(**options).value


def calls(result: ss2sql.Result) -> int:
    """How often functions of the user were called."""
    return sum(result.stats.calls.values())


# How many steps each state has that is known, and how many it has to have.
KNOWN = "SELECT length, json_array_length(steps) FROM ss2sql_states"


def asked(file: Path, query: str) -> list[Any]:
    """What Python's own SQLite reads from a file."""
    with closing(sqlite3.connect(file)) as plain, plain:
        return plain.execute(query).fetchall()


def process(folder: Path, script: str, **environment: str) -> subprocess.Popen[str]:
    """A new Python that runs a script in a folder; `maze` is the module with `near`."""
    (folder / "maze.py").write_text(MODULE)
    paths = [str(folder), str(Path(ss2sql.__file__).parent.parent)]
    given = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **environment}
    text = textwrap.dedent(script)
    return subprocess.Popen(
        [sys.executable, "-c", text], cwd=folder, env=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def output(started: subprocess.Popen[str]) -> str:
    """What a process has printed; it must not have failed."""
    out, err = started.communicate(timeout=120)
    assert started.returncode == 0, err
    return out
