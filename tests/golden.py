"""Golden cases: a script in a file, with its plan, its SQL and its answer. cases/README.md tells the form of a file."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from pprint import pformat
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from cases import needs

import ss2sql
from ss2sql.language.plan_traversal import format_plan
from ss2sql.lowering.sql_query import Sql

FOLDER = Path(__file__).parent / "cases"
SECTIONS = ("plan", "sql", "printed", "status", "value", "error")
COMPILED = ("plan", "sql")
"""Sections of those cases alone whose files have them."""
NEEDS = "needs: "


@dataclass(frozen=True)
class Case:
    """A script with a title, the names of what it needs of the world, and what is expected, by section."""

    path: Path
    title: str
    needs: tuple[str, ...]
    script: str
    expected: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def name(self) -> str:
        return str(self.path.relative_to(FOLDER).with_suffix(""))


@dataclass(frozen=True)
class Outcome:
    """What a script gave on one engine: its sections, the result or the error, and whether the session survived."""

    sections: Mapping[str, str]
    result: ss2sql.Result | None
    error: BaseException | None
    usable: bool

    @property
    def verdict(self) -> tuple[str, ...]:
        """What the engines have to agree on: the answer, or the error's code and place."""
        match self.error:
            case ss2sql.Error(code=code, span=span):
                return ("error", code, span.place if span else "", self.sections["printed"])
            case None:
                return ("value", self.sections["value"], self.sections["status"], self.sections["printed"])
            case _:
                return ("error", type(self.error).__name__, str(self.error), self.sections["printed"])


# --- files ---------------------------------------------------------------------------------------------


def cases() -> list[Case]:
    """All cases, in the order of their names."""
    return [load(path) for path in sorted(FOLDER.rglob("*.case"))]


def level_searches() -> list[Case]:
    """The cases with an answer whose searches may go by levels."""
    words = ("UNIQUE", "BREADTH FIRST")
    return [case for case in cases() if "value" in case.expected and any(word in case.script for word in words)]


def script_rows(path: Path) -> list[tuple[int, str, str]]:
    """The rows of a sheet, or of another file in its form: the line of a script, the script, and what stands behind =>.

    A script may have several lines; so may what it gives, whose further lines are indented by two blanks.
    """
    head, _, rest = path.read_text(encoding="utf-8").partition("\n\n")
    script: list[str] = []
    expected: list[str] = []
    found: list[tuple[int, str, str]] = []
    lines = [*enumerate(rest.splitlines(), head.count("\n") + 3)]
    for line, text in [*lines, (lines[-1][0] + 1, "# end")]:
        if expected and not text.startswith("  "):
            found.append((line - len(expected) - len(script), "\n".join(script), " ".join(expected)))
            script, expected = [], []
        if text.startswith("=> ") or expected:
            expected.append(text.removeprefix("=> ").strip())
        elif text.strip() and not text.startswith("# "):
            script.append(text)
    assert not script, f"{script} gives nothing"
    return found


def each_row(name: str, script: str, told: str) -> Any:
    """Has a test run for each row of `cases/NAME.rows`, with its script and what stands behind => as two arguments."""
    found = [row for _, *row in script_rows(FOLDER / f"{name}.rows")]
    return pytest.mark.parametrize((script, told), found, ids=[row[0] for row in found])


def load(path: Path) -> Case:
    """Reads a file: title, needs, an empty line, the script, and its sections."""
    head, _, rest = path.read_text(encoding="utf-8").partition("\n\n")
    title, _, needs = head.partition("\n")
    assert not needs or needs.startswith(NEEDS), f"{path}: the second line says what the case needs, or is empty"
    script: list[str] = []
    sections: dict[str, list[str]] = {}
    current = script
    for line in rest.splitlines():
        if line.startswith("--- ") and line[4:] in SECTIONS:
            current = sections.setdefault(line[4:], [])
        else:
            current.append(line)
    expected = {name: "\n".join(lines) for name, lines in sections.items()}
    return Case(path, title, tuple(needs.removeprefix(NEEDS).split(", ")) if needs else (), "\n".join(script), expected)


def text(case: Case, sections: Mapping[str, str]) -> str:
    """The file of a case with these sections; empty ones are left out, and what is COMPILED where it was left out."""
    head = case.title + (f"\n{NEEDS}{', '.join(case.needs)}" if case.needs else "")
    parts = [f"{head}\n\n{case.script}\n"]
    wanted = [name for name in SECTIONS if name in case.expected or name not in COMPILED]
    parts += [f"--- {name}\n{sections[name]}\n" for name in wanted if sections.get(name)]
    return "".join(parts)


# --- running -------------------------------------------------------------------------------------------


@cache
def duck() -> Any:
    """A connection of DuckDB for all sessions of tests: to connect takes 20 ms."""
    return import_module("duckdb").connect(config={"threads": 1})


def database_of(engine: Any) -> Any:
    """The connection of DuckDB that a session is handed, which is one of another engine."""
    return duck() if engine == "duckdb" else None


@contextmanager
def furnished(case: Case, engine: Any = "auto") -> Iterator[ss2sql.Session]:
    """A new session with what the case needs."""
    with (
        TemporaryDirectory() as folder,
        ss2sql.connect(needs.database(Path(folder), case.needs)) as session,
    ):
        session.host.session = database_of(engine)
        needs.furnish(session, case.needs)
        yield session


def run(case: Case, engine: str = "auto") -> Outcome:
    """Runs a case in a session of its own; plan and SQL are those of the engine `auto`."""
    printed = io.StringIO()
    result: ss2sql.Result | None = None
    error: BaseException | None = None
    with furnished(case, engine) as session:
        query = compiled(case, session) if engine == "auto" else None
        with redirect_stdout(printed):
            try:
                result = session.run(case.script, engine=engine)
            except Exception as caught:
                error = caught
        usable = session.eval("SELECT this + 1 FROM [1, 2] AS list") == [2, 3]
    sections = dict.fromkeys(SECTIONS, "") | {"printed": printed.getvalue().rstrip("\n")}
    if query is not None:
        sections["plan"] = format_plan(query.plan).rstrip()
        sections["sql"] = sql_text(result.sql if result else query.sql)
    if result is not None:
        sections["value"] = written(result.value)
        sections["status"] = "" if result.status == "complete" else result.status
    if error is not None:
        sections["error"] = error_text(error)
    return Outcome(sections, result, error, usable)


def compiled(case: Case, session: ss2sql.Session) -> ss2sql.Query | None:
    """The compiled script; None where it cannot be compiled, or has names that nobody knows, which run refuses."""
    try:
        query = session.compile(case.script)
    except Exception:  # what is wrong stands in the error that run meets
        return None
    return None if query.parameters else query


def sql_text(sql: Sql) -> str:
    """The statements that run, each with the values of its parameters; statements without a query are left out."""
    parts = []
    for statement in sql.statements:
        if statement.startswith("-- no query"):
            continue
        values = [f"-- :{name} = {value!r}" for name, value in sorted(statement.parameters.items())]
        parts.append("\n".join([statement, *values]))
    return "\n\n".join(parts)


def written(value: Any) -> str:
    """A value as Python writes it, on lines of at most 100 characters."""
    return pformat(value, width=100, compact=True, sort_dicts=False)


def error_text(error: BaseException) -> str:
    """An error as a user sees it: of one's own exceptions also the type and the notes."""
    if isinstance(error, ss2sql.Error):
        return str(error)
    notes: Sequence[str] = getattr(error, "__notes__", ())
    return "\n".join([f"{type(error).__name__}: {error}", *notes])
