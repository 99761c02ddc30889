"""Tables and views of the session's database, as the resolver sees them.

The kinds of values in a column and the bounds of its numbers are read from the data, not from the declared type,
which SQLite does not enforce. The reading is kept until the database changes. A million rows of three numbers and a
text take 0.23 s, of that the bounds 0.1 s; those of a column that an index begins with take none.
"""

from __future__ import annotations

import math
import os
import sqlite3
from pathlib import Path
from typing import Any

import apsw

from ss2sql import plan
from ss2sql.errors import ExecutionError, SessionError
from ss2sql.kinds import INT_MAX, INT_MIN, Kind, Type
from ss2sql.runtime.copied_databases import CopiedDatabase
from ss2sql.runtime.file_locks import attach_file, close_file, detach_file, open_file
from ss2sql.runtime.guard import UNREADABLE
from ss2sql.runtime.operator_types import MAX
from ss2sql.runtime.remembered.store import Store

_KINDS = {
    "null": Kind.NONE,
    "integer": Kind.INT,
    "real": Kind.FLOAT,
    "text": Kind.STR,
    "blob": Kind.OBJECT,
}
NUMBER = Kind.INT | Kind.FLOAT
FILES = (".db", ".sqlite", ".sqlite3")  # a text that ends so is a path, any other is a value


def parquet_of(source: Any) -> Path | None:
    """The path of a Parquet file, if a source is one: by the end of its text."""
    text = str(source) if isinstance(source, (str, os.PathLike)) else ""
    return Path(text) if text.endswith(".parquet") else None


def path_of(source: Any) -> Path | None:
    """The path of a SQLite file, if a source is one: by its type, or by the end of its text."""
    if isinstance(source, os.PathLike) or (isinstance(source, str) and source.endswith(FILES)):
        return Path(source)
    return None


# Pages of a file that were read are kept, up to 64 MB (in KiB, as SQLite counts what is negative): searching a million
# edges takes 1.8 s in plain SQL then and not 2.6.
CACHE_SIZE = -65536


def quoted(name: str) -> str:
    """A name as SQL reads it whatever characters it has."""
    return '"' + name.replace('"', '""') + '"'


class Tables:
    """Looks up tables and views by name, in the main database first."""

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection
        self._known: dict[tuple[str, str], tuple[Any, plan.TableSource]] = {}
        self.files: dict[str, Path] = {}  # what is attached, by name
        self.copied: dict[str, CopiedDatabase] = {}  # connections of sqlite3 that are attached, by name
        self.graphs: Store | None = None  # of remembered graphs, in tables that are no tables of scripts' own

    def attach(self, name: str, path: Path) -> None:
        """Makes the tables of a SQLite file known as `name.table`. Raises SessionError S002 for any other file."""
        try:
            what = "" if path.is_file() else f"{path} is a folder" if path.is_dir() else f"there is no file {path}"
        except OSError as error:  # such as of a name that is too long
            what = f"{path} cannot be read: {error.strerror}"
        if what:
            raise SessionError("S002", what, hints=("give the path of a SQLite file",))
        self._check_free(name)
        try:
            probe = open_file(str(path), apsw.SQLITE_OPEN_READONLY)
            try:
                probe.execute("SELECT count(*) FROM sqlite_schema").fetchall()
            finally:
                close_file(probe)
            self._make_room(name)
            attach_file(self.connection, name, str(path))
            self.connection.execute(f"PRAGMA {quoted(name)}.cache_size = {CACHE_SIZE}")
        except apsw.Error as error:
            hint = "an encrypted or damaged file cannot be attached, nor one of another program"
            message = f"{path} is not a SQLite file that can be read: {error}"
            raise SessionError("S002", message, hints=(hint,)) from error
        self.files[name] = path

    def attach_connection(self, name: str, source: sqlite3.Connection) -> None:
        """Makes the tables of a connection of `sqlite3` known as `name.table`, as they are when a script runs."""
        self._check_free(name)
        self._make_room(name)
        copied = CopiedDatabase(self.connection, name, source)
        copied.refresh()
        self.copied[name] = copied

    def refresh(self, schema: str | None = None) -> None:
        """Copies what connections of `sqlite3` hold, where that has changed; once in a turn."""
        for name, copied in self.copied.items():
            if schema in (None, name) and copied.refresh():
                self._known.clear()

    @property
    def attached(self) -> tuple[str, ...]:
        """The names of attached files and connections."""
        return (*self.files, *self.copied)

    def _check_free(self, name: str) -> None:
        if name.lower() in ("main", "temp"):
            raise SessionError("S002", f"'{name}' is the session's own database", hints=("choose another name",))

    def _make_room(self, name: str) -> None:
        for twin in [known for known in self.attached if known.lower() == name.lower()]:  # SQLite sees no case
            self.detach(twin)

    def detach(self, name: str) -> None:
        """Forgets the file or connection of this name, if there is one. Raises SessionError S002 while it is read."""
        if name in self.attached:
            try:
                detach_file(self.connection, name)
            except apsw.Error as error:
                hint = "wait until the query that reads it has ended"
                raise SessionError("S002", f"the file '{name}' cannot be let go: {error}", hints=(hint,)) from error
            self._known.clear()
            self.files.pop(name, None)
            self.copied.pop(name, None)

    def names(self) -> list[str]:
        """The names of all tables and views, those of SQLite and of ss2sql apart."""
        rows = self._fetch("SELECT name, type FROM pragma_table_list ORDER BY schema <> 'main', name")
        return [
            name for name, kind in rows if kind in ("table", "view") and not name.startswith(("sqlite_", "ss2sql_"))
        ]

    def find(self, schema: str | None, name: str) -> plan.TableSource | None:
        """The table or view with this name, exactly as it is written there; None if there is none."""
        self.refresh(schema)
        rows = self._fetch(
            "SELECT schema, name, type, wr FROM pragma_table_list"
            " WHERE name = ? AND (? IS NULL OR schema = ?) AND type IN ('table', 'view')"
            " ORDER BY schema <> 'main'",
            (name, schema, schema),
        )
        if not rows or name.startswith("sqlite_"):
            return None
        home, exact, kind, without_rowid = rows[0]
        version = self._version(home)
        known = self._known.get((home, exact))
        if known is not None and known[0] == version and version is not None:
            return known[1]
        try:
            with self.connection:  # all of it is read from one state of the file
                source = self._read(home, exact, kind, bool(without_rowid))
        except UNREADABLE as error:
            hints = (f"look at the definition of the {kind} in the database",)
            raise ExecutionError("X009", f"the {kind} '{name}' cannot be read: {error}", hints=hints) from error
        self._known[(home, exact)] = (version, source)
        return source

    def rows(self, source: plan.TableSource) -> list[tuple[Any, ...]]:
        """All rows of a table in its order."""
        columns = ", ".join(quoted(name) for name, _ in source.columns)
        order = f" ORDER BY {', '.join(quoted(key) for key in source.order)}" if source.order else ""
        return self._fetch(f"SELECT {columns} FROM {quoted(source.schema)}.{quoted(source.table)}{order}")

    def is_empty(self, source: plan.TableSource) -> bool:
        """Whether a table or view has no rows."""
        return not self._fetch(f"SELECT 1 FROM {quoted(source.schema)}.{quoted(source.table)} LIMIT 1")

    def _fetch(self, text: str, bindings: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement. Raises ExecutionError X009 where SQLite refuses it: the file may be locked."""
        try:
            return self.connection.execute(text, bindings).fetchall()
        except UNREADABLE as error:
            raise ExecutionError("X009", f"SQLite: {error}") from error

    def _version(self, schema: str) -> tuple[Any, ...] | None:
        """Changes when this or another connection has changed the database; None where a ROLLBACK may change it."""
        if self.connection.in_transaction:
            return None
        versions = self._fetch(f"PRAGMA {quoted(schema)}.data_version")
        cookies = self._fetch(f"PRAGMA {quoted(schema)}.schema_version")
        own = 0 if self.graphs is None else self.graphs.changes
        return (versions, cookies, self.connection.total_changes() - own)

    def _read(self, schema: str, name: str, kind: str, without_rowid: bool) -> plan.TableSource:
        rows: list[tuple[Any, ...]] = self.connection.execute(
            "SELECT name, pk, hidden FROM pragma_table_xinfo(?, ?) ORDER BY cid", (name, schema)
        ).fetchall()
        columns = [column for column, _, hidden in rows if hidden != 1]
        keys = [column for _, column in sorted((key, column) for column, key, _ in rows if key)]
        if kind == "view":
            order: tuple[str, ...] = ()
        elif without_rowid:
            order = tuple(keys)
        else:
            taken = {column.lower() for column in columns}
            order = tuple(word for word in ("rowid", "_rowid_", "oid") if word not in taken)[:1]
        listed = self._fetch(
            "SELECT name, origin, partial FROM pragma_index_list(?, ?) ORDER BY origin, name", (name, schema)
        )
        indexed = any(origin != "pk" or not without_rowid for _, origin, _ in listed)
        whole = [(index, origin) for index, origin, partial in listed if not partial]
        indexes = () if kind == "view" else self._indexes(schema, name, order, keys, whole)
        kinds = self._kinds(schema, name, columns)
        # What a view computes may change with every look at it, as random() does.
        bounded = {} if kind == "view" else self._bounded(schema, name, kinds, {index[0][0] for index in indexes})
        typed = tuple((column, bounded.get(column, Type(kinds[column]))) for column in columns)
        collated = () if kind == "view" else tuple(c for c in columns if self._collation(schema, name, c) != "BINARY")
        return plan.TableSource(0, name, schema, name, typed, order, collated, indexes, indexed, span=None)  # type: ignore[arg-type]

    def _indexes(
        self, schema: str, name: str, order: tuple[str, ...], keys: list[str], listed: list[tuple[str, str]]
    ) -> tuple[tuple[tuple[str, ...], str], ...]:
        """What finds the rows with one value of some columns and gives them in the order of the table.

        These are pairs of columns and index, the longest first. An index does so for all of its columns, for its
        entries end with what sorts the table. The index "" stands for the table itself. `listed` are all indexes that
        have every row, with their origins.
        """
        found: dict[tuple[str, ...], str] = {}
        if keys and order == tuple(keys):
            (kept,) = (index for index, origin in listed if origin == "pk")
            parts = self._parts(schema, kept)
            ascends = [not down and coll == self._collation(schema, name, key) for key, down, coll in parts]
            if all(coll == "BINARY" for _, _, coll in parts):
                found[tuple(keys)] = ""
            if parts[0][2] == "BINARY" and all(ascends[1:]):
                found[(keys[0],)] = ""
            listed = [row for row in listed if row[1] != "pk"] if all(ascends) else []
        elif len(keys) == 1 and all(origin != "pk" for _, origin in listed):
            found[(keys[0],)] = ""  # a primary key that no index keeps is the rowid
        for index, _ in listed:
            parts = self._parts(schema, index)
            if all(column is not None and collation == "BINARY" for column, _, collation in parts):
                found.setdefault(tuple(column for column, _, _ in parts), index)
        return tuple(sorted(found.items(), key=lambda entry: -len(entry[0])))

    def _parts(self, schema: str, index: str) -> list[tuple[Any, ...]]:
        """The columns of an index, each with whether it descends, and its collation."""
        return self._fetch(
            "SELECT name, desc, coll FROM pragma_index_xinfo(?, ?) WHERE key ORDER BY seqno", (index, schema)
        )

    def _collation(self, schema: str, name: str, column: str) -> str:
        return self.connection.column_metadata(schema, name, column)[1]

    def _kinds(self, schema: str, name: str, columns: list[str]) -> dict[str, Kind]:
        tests = ", ".join(f"typeof({quoted(column)})" for column in columns)
        found: list[tuple[Any, ...]] = self.connection.execute(
            f"SELECT DISTINCT {tests} FROM {quoted(schema)}.{quoted(name)}"
        ).fetchall()
        kinds = dict.fromkeys(columns, Kind(0))
        for row in found:
            for column, word in zip(columns, row, strict=True):
                kinds[column] |= _KINDS[word]
        return kinds

    def _bounded(self, schema: str, name: str, kinds: dict[str, Kind], leading: set[str]) -> dict[str, Type]:
        """The types of the columns that hold numbers and None alone.

        In a query that asks for one end only, SQLite takes it from an index that begins with the column (`leading`).
        """
        numbers = [column for column, found in kinds.items() if found & NUMBER and not found & ~(NUMBER | Kind.NONE)]
        if not numbers:
            return {}
        table = f"{quoted(schema)}.{quoted(name)}"
        terms = []
        for column in numbers:
            ends = [f"{end}({quoted(column)})" for end in ("min", "max")]
            terms += [f"(SELECT {end} FROM {table})" for end in ends] if column in leading else ends
        walked = "" if leading.issuperset(numbers) else f" FROM {table}"
        found: tuple[Any, ...]
        (found,) = self.connection.execute(f"SELECT {', '.join(terms)}{walked}").fetchall()
        return {
            column: rounded(kinds[column], low, high)
            for column, low, high in zip(numbers, found[::2], found[1::2], strict=True)
        }


def rounded(kinds: Kind, low: float | None, high: float | None) -> Type:
    """The type of numbers between these, with powers of two as bounds, so that few changes of a table change it."""
    if low is None or high is None:  # no number is left where SQLite found one, as in a damaged file
        return Type(kinds)
    if math.isinf(low) or math.isinf(high):
        return Type(kinds | Kind.OBJECT)  # no float of the language
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    below, above = -_power_above(-low), _power_above(high)
    return Type(kinds, below if least < below else None, above if above < greatest else None)


def _power_above(value: float) -> int:
    """The least that is not below the value of 0, the powers of two from 1 on, and their negatives."""
    whole = math.ceil(value)
    if whole == 0:
        return 0
    return 1 << (whole - 1).bit_length() if whole > 0 else -1 << ((-whole).bit_length() - 1)
