"""Errors that no file of tests/cases can hold: wrong use from Python, exceptions of the user, runs that are stopped."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import worker_functions

import ss2sql
from ss2sql import Error, Session
from ss2sql.errors import require_package

ENDLESS = "SELECT n FROM [1] WHERE n % 1000 == 0 START WITH n = 1 CONNECT BY n = n + 1"
LATE = 0.3  # seconds: a run of what is compiled has begun by then, on a machine with much to do as well
GROWING = "SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY BREADTH FIRST n = n + this"
TALKING = "SELECT this FROM range(1000) WHERE print('looking at', this) > 5"


@pytest.fixture
def session() -> Iterator[Session]:
    with ss2sql.connect() as opened:
        yield opened


def failure(action: Callable[[], object]) -> Error:
    """The error of ss2sql that the action raises."""
    with pytest.raises(Error) as caught:
        action()
    error: Error = caught.value
    return error


def still_works(session: Session) -> None:
    assert session.eval("SELECT this + 1 FROM [1, 2] AS list") == [2, 3]


# --- one error for each code that only Python can reach ------------------------------------------------


def closed() -> Session:
    with ss2sql.connect() as session:
        return session


def wrong_block(session: Session) -> None:
    session.function("first", lambda numbers: numbers[:1], vectorized=True)
    session.run("SELECT first(this) FROM [1, 2, 3];")


def worker_that_dies(session: Session) -> None:
    session.function("onward", worker_functions.slow_and_deadly, volatility="immutable")
    script = "SELECT onward(n, this) FROM range(9) START WITH n = 1 CONNECT BY MEMORIZE 2 n = onward(n, this);"
    session.run(script, workers=2)


def in_another_thread(session: Session) -> None:
    """A function that waits for another thread, which runs a script of the same session."""

    def ask(x: int) -> int:
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(session.eval, "1 + 1;").result()

    session.function("ask", ask)
    session.run("ask(1);")


def another_copy(_: Session) -> object:
    """A session with a file that Python's own SQLite has open."""
    with TemporaryDirectory() as folder, closing(sqlite3.connect(f"{folder}/data.db")):
        return ss2sql.connect(f"{folder}/data.db")


FROM_PYTHON: dict[str, Callable[[Session], object]] = {
    "P004": lambda session: session.run("x = 1;" * 100_000),
    "P005": lambda session: session.run("[" * 10_000 + "1" + "]" * 10_000),
    "R009": lambda session: session.compile("SELECT this * factor FROM [1]").run(),
    "U001": lambda session: session.run("n = 0; SELECT (n = n + 1) FROM [1]", engine="database"),
    "X010": lambda session: session.run("SELECT this FROM [1, 2, 3]", max_rows=2),
    "X014": lambda session: ss2sql.connect(max_size=2**18).run("t = 'ha'; SELECT len(t = t + t) FROM range(40)"),
    "X015": lambda session: ss2sql.connect(max_output=10).run(TALKING),
    "T004": lambda session: ss2sql.connect(max_steps=1000).run(GROWING),
    "T003": lambda session: ss2sql.connect(max_memory=20 * 2**20).run(GROWING),
    "X012": lambda session: wrong_block(session),
    "X013": worker_that_dies,
    "T001": lambda session: session.compile(ENDLESS).run(timeout=LATE),
    "T002": lambda session: interrupted(session), "S001": lambda session: closed().run("1;"),
    "S002": lambda session: session.function("two words", len),
    "S003": lambda session: require_package("a_package_that_is_missing", "sim", "a scene"), "S004": in_another_thread,
    "S005": another_copy,
}  # fmt: skip


def interrupted(session: Session) -> None:
    """A run without end, which is interrupted from another thread."""
    query = session.compile(ENDLESS)
    threading.Timer(LATE, session.interrupt).start()
    query.run()


def test_an_index_error_of_the_user_stays_theirs(session: Session) -> None:
    session.function("pick", lambda n: [1, 2][n])
    with pytest.raises(IndexError) as caught:
        session.run("SELECT [[3], [4], [5]][pick(this)] FROM [0, 2] AS list;", engine="native")
    assert type(caught.value) is IndexError
    assert "pick" in "".join(caught.value.__notes__)


def test_an_index_is_explained_where_python_knows_lines_alone() -> None:
    code = "import ss2sql; ss2sql.connect().eval('SELECT [4, 5][this] FROM [0, 3] AS list;')"
    told = subprocess.run([sys.executable, "-X", "no_debug_ranges", "-c", code], capture_output=True, text=True)
    assert "X003" in told.stderr
    assert "index 3 is out of range: [4, 5] has 2 elements" in told.stderr


@pytest.mark.parametrize("code", FROM_PYTHON)
def test_errors_from_python(session: Session, code: str) -> None:
    error = failure(lambda: FROM_PYTHON[code](session))
    assert error.code == code
    assert str(error).startswith(f"error[{code}]: ")
    if code != "T002":
        assert error.hints
    still_works(session)


# --- texts ---------------------------------------------------------------------------------------------


NEARLY_TOO_DEEP: dict[str, tuple[str, Any]] = {
    "sum": ("+".join(["1"] * 300), 300),
    "parentheses": ("(" * 199 + "1" + ")" * 199, 1),
    "calls": ("f(" * 200 + "1" + ")" * 200, 1),
    "not": ("NOT " * 200 + "1", True),
    "branches": ("IF(1; " * 200 + "7" + ")" * 200, 7),
    "queries in FROM": ("(SELECT this FROM " * 100 + "[7, 8]" + " AS list)" * 100, [7, 8]),
    "queries in WHERE": ("(SELECT this FROM [1] WHERE " * 30 + "this == 1" + " AS list)" * 30, [1]),
}


@pytest.mark.parametrize("what", NEARLY_TOO_DEEP)
def test_what_is_nearly_too_deep_runs(session: Session, engine: Any, what: str) -> None:
    session.function("f", lambda value: value, volatility="volatile")
    text, value = NEARLY_TOO_DEEP[what]
    limit = sys.getrecursionlimit()
    assert session.run(text, engine=engine).value == value
    assert sys.getrecursionlimit() == limit


# --- wrong use --------------------------------------------------------------------------------------


NO_TEXTS: list[Any] = [b"x = 1;", None, 7, ["x = 1;"]]


@pytest.mark.parametrize(
    ("action", "word"),
    [
        (lambda session: session.function("f", 5), "function"),
        (lambda session: session.function("f", len, volatility="sometimes"), "volatile"),
        (lambda session: session.function(lambda x: x), "name"),
        (lambda session: session.set("two words", 1), "two words"),
        (lambda session: session.attach("", []), "name"),
        (lambda session: session.attach("db", Path("/no/such/file.db")), "file"),
        (lambda session: session.representation("a-b"), "a-b"),
        (lambda session: session.run("1", engine="turbo"), "turbo"),
        *((lambda session, script=script: session.run(script), type(script).__name__) for script in NO_TEXTS),
        (lambda session: ss2sql.connect(disable=["mem"]), "mem"),
        (lambda session: ss2sql.connect(session=object()), "duckdb"),
        (lambda session: session.run("1", timout=1), "timout"),
        (lambda session: session.compile("x").run(x=1, max_row=1), "max_row"),
        (lambda session: ss2sql.connect("/no/such/folder/x.db"), "x.db"),
    ],
)
def test_wrong_use_says_what_is_wrong(session: Session, action: Any, word: str) -> None:
    error = failure(lambda: action(session))
    assert error.code == "S002"
    assert word in error.message
    still_works(session)


def test_a_variable_may_be_named_nearly_like_an_option_where_the_script_has_it(session: Session) -> None:
    assert session.eval("timout + 1", timout=1, unused=2) == 2
    assert session.eval("eval('max_row + 1')", max_row=1) == 2
