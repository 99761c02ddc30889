"""What cases may use besides the language: functions, values, tables and representations, each by a name.

A case names what it needs in its header. Everything is made anew for every session, so that counters start at
zero and nothing that a script does reaches another case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import apsw
from cases.data import TABLES, VALUES
from cases.functions import FUNCTIONS, REPRESENTATIONS, Function


def furnish(session: Any, needs: Sequence[str]) -> None:
    """Gives a session what a case needs besides tables. Raises KeyError for a name that is not here."""
    for name in needs:
        if name in FUNCTIONS:
            for called, function in FUNCTIONS[name]().items():
                session.function(called, function)
        elif name in VALUES:
            session.attach(name, VALUES[name]())
        elif name in REPRESENTATIONS:
            session.representation(name)(REPRESENTATIONS[name])
        elif name not in TABLES:
            raise KeyError(name)


def database(folder: Path, needs: Sequence[str]) -> Path | None:
    """A new file with the tables that a case needs, for `connect`; None if it needs none."""
    tables = [TABLES[name] for name in needs if name in TABLES]
    if not tables:
        return None
    path = folder / "world.db"
    path.unlink(missing_ok=True)
    connection = apsw.Connection(str(path))
    connection.execute(";".join(tables))
    connection.close()
    return path


def for_reference(needs: Sequence[str]) -> dict[str, Mapping[str, Any]]:
    """The same for the reference evaluator: arguments of `Reference`."""
    functions: dict[str, Function] = {}
    variables: dict[str, Any] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    for name in needs:
        if name in FUNCTIONS:
            functions.update(FUNCTIONS[name]())
        elif name in VALUES:
            variables[name] = VALUES[name]()
        elif name in TABLES:
            tables.update(_rows(TABLES[name]))
    return {"functions": functions, "variables": variables, "tables": tables}


def _rows(sql: str) -> dict[str, list[dict[str, Any]]]:
    """The tables and views that the statements make, as lists of dicts."""
    connection = apsw.Connection(":memory:")
    connection.execute(sql)
    tables = {}
    for (name,) in connection.execute("SELECT name FROM sqlite_schema WHERE type <> 'index'").fetchall():
        try:
            columns = [row[1] for row in connection.execute(f'PRAGMA table_xinfo("{name}")')]
            rows = connection.execute(f'SELECT * FROM "{name}"').fetchall()
        except apsw.Error:
            continue  # a view that fails on purpose
        tables[name] = [dict(zip(columns, row, strict=True)) for row in rows]
    return tables
