"""Sheets: many small scripts in one file, each with the value or the error that the language gives it.

A sheet, `tests/cases/**/*.sheet`, begins like a golden case: a title, what it needs, an empty line. Then come its rows:

    # a comment
    SELECT this FROM [1, 2] AS list
    => [1, 2]
    1 / 0;
    => error X002

Where a row gives an error, it is that of the native run without rewrites; the others may have a value, as nothing in
the answer may need what fails, unless the code ends with `(everywhere)`. Where SQL fails in what the answer does not
need, the value ends with `(SQL gives up)`; with the engine `auto` it is there all the same. What the engine
`database` refuses ends with `(SQL refuses)`. Below `duckdb: every row` DuckDB refuses none.

Every row runs on SQLite, natively and in DuckDB, with rewrites and without, and on the reference evaluator. The rows
of a sheet share a session, so a variable that one assigns is there in the next. `reference: no` below `needs:` leaves
the reference evaluator out. Expectations follow from the language page; nothing writes them.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from cases import needs
from golden import FOLDER, NEEDS, database_of, script_rows
from reference import Failure, Reference

import ss2sql
from ss2sql.lowering.rewrites import REWRITES

WRITTEN_ORDER = ("native", tuple(REWRITES))
# How each row runs: the engine, and the rewrites that are switched off.
RUNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("database", ()), ("database", ("fold",)), ("database", tuple(REWRITES)), ("native", ()),
    WRITTEN_ORDER, ("duckdb", ()),
)  # fmt: skip
GIVES_UP = " (SQL gives up)"
REFUSES = " (SQL refuses)"
EVERYWHERE = " (everywhere)"
NOT_FOR_REFERENCE = "reference: no"
ALL_FOR_DUCKDB = "duckdb: every row"


@dataclass(frozen=True)
class Row:
    """A script and what it gives: a value, or `error CODE`."""

    line: int
    script: str
    expected: str
    gives_up: bool
    refused: bool
    everywhere: bool


@dataclass(frozen=True)
class Sheet:
    """The rows of a file, and the names of what their scripts use."""

    path: Path
    needs: tuple[str, ...]
    rows: tuple[Row, ...]
    in_reference: bool
    in_duckdb: bool


def load(path: Path) -> Sheet:
    head, _, _ = path.read_text(encoding="utf-8").partition("\n\n")
    _, *more = head.splitlines()
    named = [name for line in more if line.startswith(NEEDS) for name in line.removeprefix(NEEDS).split(", ")]
    found = tuple(row(*given) for given in script_rows(path))
    return Sheet(path, tuple(named), found, NOT_FOR_REFERENCE not in more, ALL_FOR_DUCKDB in more)


def row(line: int, script: str, given: str) -> Row:
    ends = (given.endswith(end) for end in (GIVES_UP, REFUSES, EVERYWHERE))
    value = given.removesuffix(GIVES_UP).removesuffix(REFUSES).removesuffix(EVERYWHERE)
    return Row(line, script, value, *ends)


SHEETS = [load(path) for path in sorted(FOLDER.rglob("*.sheet"))]


def shown(value: Any) -> str:
    """A value in one line; sets, which have no order, by their sorted elements."""
    return f"{{{', '.join(sorted(map(repr, value)))}}}" if isinstance(value, set) else repr(value)


def wanted(row: Row) -> str:
    return row.expected if row.expected.startswith("error ") else shown(ast.literal_eval(row.expected))


def given(session: ss2sql.Session, row: Row, engine: Any) -> str | None:
    """What an engine gives; None where it refuses the script."""
    try:
        with redirect_stdout(StringIO()):
            return shown(session.run(row.script, engine=engine).value)
    except ss2sql.UnsupportedError as error:
        return f"error {error.code}" if row.expected == f"error {error.code}" else None
    except ss2sql.Error as error:
        return f"error {error.code}"
    except Exception as error:
        return f"error {type(error).__name__}"


def by_reference(judge: Reference, row: Row) -> str:
    try:
        return shown(judge.run(row.script))
    except Failure as failure:
        return f"error {failure.code}"
    except Exception as error:
        return f"error {type(error).__name__}"


@pytest.mark.parametrize("sheet", SHEETS, ids=lambda sheet: str(sheet.path.relative_to(FOLDER).with_suffix("")))
def test_sheet(sheet: Sheet) -> None:
    assert sheet.rows
    wrong = []
    spares = {"native": False, "duckdb": not sheet.in_duckdb}  # what may refuse rows
    for engine, disable in RUNS:
        with TemporaryDirectory() as folder, opened(sheet, Path(folder), disable, engine) as session:
            for row in sheet.rows:
                if engine == "duckdb" and "CONNECT BY" in row.script.upper():
                    continue  # searches by levels have tests of their own
                found = given(session, row, engine)
                refused = found is None
                if not disable and refused != (row.refused if engine == "database" else refused and spares[engine]):
                    wrong.append(f"{sheet.path.name}:{row.line}: {engine} {'refuses' if refused else 'takes'} it")
                if found is None and engine == "duckdb":  # which refuses what it cannot do; a later row may read it
                    found = given(session, row, "auto")
                if row.gives_up and engine == "database" and found is not None and found.startswith("error "):
                    found = given(session, row, "auto")
                spared = row.expected.startswith("error ") and (engine, disable) != WRITTEN_ORDER and not row.everywhere
                if found not in (None, wanted(row)) and not spared:
                    wrong.append(f"{sheet.path.name}:{row.line}: {engine} without {disable}: {found}")
    if sheet.in_reference:
        judge = Reference(**needs.for_reference(sheet.needs))
        for row in sheet.rows:
            if (found := by_reference(judge, row)) != wanted(row) and not row.expected.startswith("error "):
                wrong.append(f"{sheet.path.name}:{row.line}: reference: {found}")
    if wrong:
        pytest.fail("\n".join(wrong), pytrace=False)


@contextmanager
def opened(sheet: Sheet, folder: Path, disable: tuple[str, ...], engine: str) -> Iterator[ss2sql.Session]:
    """A session with what the sheet needs."""
    path = needs.database(folder, sheet.needs)
    with ss2sql.connect(path, disable=disable) as session:
        session.host.session = database_of(engine)
        needs.furnish(session, sheet.needs)
        yield session
