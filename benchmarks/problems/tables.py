"""SQLite files with the tables of the problems, made once and kept in out/."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import apsw

FOLDER = Path(__file__).parents[2] / "out" / "tables"


def table_file(
    name: str, statements: Sequence[str], insert: str, rows: Callable[[], Iterable[tuple[Any, ...]]]
) -> Path:
    """A file with one filled table; `statements` come before the rows, those that begin with CREATE INDEX behind."""
    file = FOLDER / f"{name}.db"
    if file.exists():
        return file
    FOLDER.mkdir(parents=True, exist_ok=True)
    draft = file.with_suffix(f".{os.getpid()}")
    later = [text for text in statements if text.startswith("CREATE INDEX")]
    with apsw.Connection(str(draft)) as connection:
        for text in statements:
            if text not in later:
                connection.execute(text)
        connection.executemany(insert, rows())
        for text in later:
            connection.execute(text)
    connection.close()
    draft.replace(file)  # in one step: another process may be looking for it
    return file


def opened(file: Path) -> apsw.Connection:
    """The file for a contender by hand, with a cache that holds it: 1.7 s and not 2.4 for a million edges in SQL."""
    connection = apsw.Connection(str(file), flags=apsw.SQLITE_OPEN_READONLY)
    connection.execute("PRAGMA cache_size = -262144")
    return connection
