"""Tables and views of the session's database, as the resolver sees them, and what their data show of the columns.

SQLite does not enforce declared types, so all rows are looked at, once for each state of the database, for the kinds of
values and the bounds of numbers. For a million rows of three numbers and a text that takes 0.16 s, for one column of
integers 0.08 s. A column that is the rowid takes none. Columns that a script does not read are not looked at.

What a view computes may have no end, so it is looked at for a while only. That is counted in steps of SQLite's virtual
machine: one that is too long for this is so on every machine, and its columns may then hold values of all kinds.
"""

from __future__ import annotations

import os
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import apsw

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import decode_text
from ss2sql.language.kinds import Kind, Type, widen_number_type
from ss2sql.runtime.sqlite.connections import (
    READ_ERRORS,
    CopiedDatabase,
    attach_file,
    build_sqlite_error,
    close_file,
    detach_file,
    open_sqlite_file,
    quote_sqlite_name,
)

if TYPE_CHECKING:
    import sqlite3

    from ss2sql.lowering.flat import TableFilter
    from ss2sql.runtime.graph_cache.graph_store import GraphStore


_KINDS = {"null": Kind.NONE, "integer": Kind.INT, "real": Kind.FLOAT, "text": Kind.STR, "blob": Kind.OBJECT}
NUMBER = Kind.INT | Kind.FLOAT
STORED = NUMBER | Kind.NONE | Kind.STR | Kind.OBJECT
# As of two million steps, which take 0.05 s: some 150,000 rows of a view of four columns.
EVERY, TIMES = 10_000, 200


class _TooManyStepsError(Exception):
    """A view takes longer than somebody who only wants to know its columns waits. It never leaves this module."""


@dataclass(frozen=True, slots=True)
class DatabaseColumn:
    """A column with its declared type. `leads_index`: an index, or the table itself, is sorted by its values."""

    name: str
    declared: str = ""
    leads_index: bool = False
    rowid: bool = False

    @property
    def quoted(self) -> str:
        return quote_sqlite_name(self.name)

    @property
    def numeric(self) -> bool:
        """Whether SQLite makes numbers of texts that it is compared with."""
        declared = self.declared.upper()
        others = ("CHAR", "CLOB", "TEXT", "BLOB")
        return "INT" in declared or (declared != "" and not any(word in declared for word in others))


def infer_table_types(connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn]) -> dict[str, Type]:
    """The types of the columns of a table. Raises what apsw raises."""
    kinds = _find_column_kinds(connection, table, columns)
    return {name: Type(found) for name, found in kinds.items()} | _find_sqlite_bounds(connection, table, columns, kinds)


def infer_view_types(connection: apsw.Connection, view: str, columns: Sequence[DatabaseColumn]) -> dict[str, Type]:
    """The same of a view, without bounds: what it computes may change with every look at it, as random() does.

    Infinities are looked for all the same: `a * 0` is None in SQLite where `a` is infinite, and NaN in Python.
    """
    try:
        with _limit_sqlite_steps(connection):
            found = infer_table_types(connection, view, columns)
    except _TooManyStepsError:
        return {column.name: Type(STORED) for column in columns}
    return {name: Type(known.kinds) for name, known in found.items()}


@contextmanager
def _limit_sqlite_steps(connection: apsw.Connection) -> Iterator[None]:
    left = TIMES

    def count_step() -> bool:
        nonlocal left
        left -= 1
        if left < 0:
            raise _TooManyStepsError
        return False

    connection.set_progress_handler(count_step, EVERY, id=count_step)
    try:
        yield
    finally:
        connection.set_progress_handler(None, id=count_step)


def _find_column_kinds(connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn]) -> dict[str, Kind]:
    kinds = {column.name: Kind.INT if column.rowid else Kind(0) for column in columns}
    tested = [column for column in columns if not column.rowid]
    tests = ", ".join(f"typeof({column.quoted})" for column in tested)
    found: list[tuple[Any, ...]] = []
    if tested:
        found = connection.execute(f"SELECT DISTINCT {tests} FROM {table}").fetchall()
    for row in found:
        for column, word in zip(tested, row, strict=True):
            kinds[column.name] |= _KINDS[word]
    return kinds


def _find_sqlite_bounds(
    connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn], kinds: Mapping[str, Kind]
) -> dict[str, Type]:
    """The types of the columns that hold numbers and None alone.

    In a query that asks for one end only, SQLite takes it from an index that begins with the column.
    """
    numbers = [one for one in columns if kinds[one.name] & NUMBER and not kinds[one.name] & ~(NUMBER | Kind.NONE)]
    if not numbers:
        return {}
    terms = []
    for column in numbers:
        ends = [f"{end}({column.quoted})" for end in ("min", "max")]
        terms += [f"(SELECT {end} FROM {table})" for end in ends] if column.leads_index else ends
    walked = "" if all(column.leads_index for column in numbers) else f" FROM {table}"
    found: tuple[Any, ...]
    (found,) = connection.execute(f"SELECT {', '.join(terms)}{walked}").fetchall()
    return {
        column.name: widen_number_type(kinds[column.name], low, high)
        for column, low, high in zip(numbers, found[::2], found[1::2], strict=True)
    }


# --- tables and views of the session's database, as the resolver sees them
MANY_ROWS = 50_000  # rows of a table that is read as arrays
DIGITS = 21  # of an integer in text, with its sign and a comma
FILES = (".db", ".sqlite", ".sqlite3")  # a text that ends so is a path, any other is a value


def find_parquet_path(source: Any) -> Path | None:
    """The path of a Parquet file, if a source is one: by the end of its text."""
    text = str(source) if isinstance(source, (str, os.PathLike)) else ""
    return Path(text) if text.endswith(".parquet") else None


def find_sqlite_path(source: Any) -> Path | None:
    """The path of a SQLite file, if a source is one: by its type, or by the end of its text."""
    if isinstance(source, os.PathLike) or (isinstance(source, str) and source.endswith(FILES)):
        return Path(source)
    return None


# Pages of a file that were read are kept, up to 64 MB (in KiB, as SQLite counts what is negative): searching a million
# edges takes 1.8 s in plain SQL then and not 2.6.
CACHE_SIZE = -65536


Version: TypeAlias = tuple[Any, ...] | None


class KnownTable:
    """A table or view as it was found in a version of its database, with the types of columns that were looked at."""

    def __init__(
        self, version: Version, source: plan.TableSource, columns: tuple[DatabaseColumn, ...], keys: frozenset[str]
    ) -> None:
        self.version = version
        self.source = source
        self.columns = columns
        self.keys = keys
        self.types: dict[str, Type] = {}

    def find_unknown_columns(self, read: Container[str] | None) -> list[DatabaseColumn]:
        """The columns that somebody reads who reads these, as far as their types are not known."""
        return [one for one in self._find_columns_read(read) if one.name not in self.types]

    def _find_columns_read(self, read: Container[str] | None) -> list[DatabaseColumn]:
        """The columns that are read; those of the primary key, which sorts rows, always are."""
        return [one for one in self.columns if read is None or one.name in read or one.name in self.keys]

    def build_source(self, read: Container[str] | None) -> plan.TableSource:
        """The source with the types of the columns that are read; the others are of all kinds."""
        names_read = {one.name for one in self._find_columns_read(read)}
        typed = ((one.name, self.types[one.name] if one.name in names_read else Type(STORED)) for one in self.columns)
        columns = tuple(typed)
        texts = tuple(
            one.name
            for one, (_, kind) in zip(self.columns, columns, strict=True)
            if one.numeric and one.name in names_read and kind.may_be(Kind.STR)
        )
        return replace(self.source, columns=columns, texts_for_numbers=texts)


def _write_sqlite_select(source: plan.TableSource, values: Sequence[str], wanted: TableFilter | None = None) -> str:
    """The statement that gives these for the rows of a table, in its order."""
    home = f"{quote_sqlite_name(source.schema)}.{quote_sqlite_name(source.table)}{wanted.text if wanted else ''}"
    order = f" ORDER BY {', '.join(quote_sqlite_name(key) for key in source.order)}" if source.order else ""
    limit = "" if wanted is None or wanted.limit is None else f" LIMIT {wanted.limit}"
    return f"SELECT {', '.join(values)} FROM {home}{order}{limit}"


class Tables:
    """Looks up tables and views by name, in the main database first."""

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection
        self._known: dict[tuple[str, str], KnownTable] = {}
        self.files: dict[str, Path] = {}  # what is attached, by name
        self.copied: dict[str, CopiedDatabase] = {}  # connections of sqlite3 that are attached, by name
        self.graphs: GraphStore | None = None  # of remembered graphs, in tables that are no tables of scripts' own

    def attach_file(self, name: str, path: Path) -> None:
        """Makes the tables of a SQLite file known as `name.table`. Raises SessionError S002 for any other file."""
        try:
            what = "" if path.is_file() else f"{path} is a folder" if path.is_dir() else f"there is no file {path}"
        except OSError as error:  # such as of a name that is too long
            what = f"{path} cannot be read: {error.strerror}"
        if what:
            raise SessionError("S002", what, hints=("give the path of a SQLite file",))
        self._check_free(name)
        try:
            probe = open_sqlite_file(str(path), apsw.SQLITE_OPEN_READONLY)
            try:
                probe.execute("SELECT count(*) FROM sqlite_schema").fetchall()
            finally:
                close_file(probe)
            self._make_room(name)
            attach_file(self.connection, name, str(path))
            self.connection.execute(f"PRAGMA {quote_sqlite_name(name)}.cache_size = {CACHE_SIZE}")
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
        copied.refresh_copy()
        self.copied[name] = copied

    def refresh_copies(self, schema: str | None = None) -> None:
        """Copies what connections of `sqlite3` hold, where that has changed; once in a turn."""
        for name, copied in self.copied.items():
            if schema in (None, name) and copied.refresh_copy():
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
            self.detach_file(twin)

    def detach_file(self, name: str) -> None:
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

    def list_names(self) -> list[str]:
        """The names of all tables and views, those of SQLite and of ss2sql apart."""
        return [name for _, name in self._list_homes_and_names()]

    def list_full_names(self) -> dict[str, tuple[str, str]]:
        """The same names as FROM writes them, each with its database and its name there."""
        every = self._list_homes_and_names()
        return {name if home in ("main", "temp") else f"{home}.{name}": (home, name) for home, name in every}

    def _list_homes_and_names(self) -> list[tuple[str, str]]:
        rows = self._fetch_rows("SELECT schema, name, type FROM pragma_table_list ORDER BY schema <> 'main', name")
        hidden = ("sqlite_", "ss2sql_")
        return [(home, name) for home, name, k in rows if k in ("table", "view") and not name.startswith(hidden)]

    def find_table(self, schema: str | None, name: str, read: Container[str] | None = None) -> plan.TableSource | None:
        """The table or view with this name, exactly as it is written there; None if there is none.

        What its data show is found out of the columns that are `read`, as far as somebody knows; the others may have
        values of all kinds.
        """
        self.refresh_copies(schema)
        listed = self._find_listing(schema, name)
        if listed is None:
            return None
        home, exact, kind, _ = listed
        version, known = self._read_version(home), self._known.get((home, exact))
        if known is not None and (version is None or known.version != version):
            del self._known[home, exact]
        elif known is not None and not known.find_unknown_columns(read):
            return known.build_source(read)
        try:
            with self.connection:  # all of it is read from one state of the file
                self._learn_table(listed, version, read)
        except READ_ERRORS as error:
            hints = (f"look at the definition of the {kind} in the database",)
            raise ExecutionError("X009", f"the {kind} '{name}' cannot be read: {error}", hints=hints) from error
        return self._known[home, exact].build_source(read)

    def _learn_table(self, listed: tuple[Any, ...], version: Version, read: Container[str] | None) -> None:
        """Finds out what is not known yet of a table in this version. Raises what apsw raises."""
        home, exact, kind, without_rowid = listed
        known = self._known.get((home, exact)) or self._describe_table(home, exact, kind, bool(without_rowid), version)
        if columns := known.find_unknown_columns(read):
            table = f"{quote_sqlite_name(home)}.{quote_sqlite_name(exact)}"
            infer_types = infer_view_types if kind == "view" else infer_table_types
            known.types.update(infer_types(self.connection, table, columns))
        self._known[home, exact] = known

    def list_columns(self, name: str, schema: str | None = None) -> tuple[str, ...]:
        """The columns of a table or view, without a look at its rows; none of a view that cannot be read."""
        listed = self._find_listing(schema, name)
        if listed is None:
            return ()
        home, exact, _, _ = listed
        try:
            self._check_view(home, exact)
            return tuple(column for column, _, _, hidden in self._describe_columns(home, exact) if hidden != 1)
        except READ_ERRORS:
            return ()

    def _find_listing(self, schema: str | None, name: str) -> tuple[Any, ...] | None:
        """Schema, exact name, type and whether it has no rowid, of a table or view that scripts may read."""
        rows = self._fetch_rows(
            "SELECT schema, name, type, wr FROM pragma_table_list"
            " WHERE name = ? AND (? IS NULL OR schema = ?) AND type IN ('table', 'view')"
            " ORDER BY schema <> 'main'",
            (name, schema, schema),
        )
        return rows[0] if rows and not name.startswith("sqlite_") else None

    def _check_view(self, schema: str, name: str) -> None:
        """Finds out whether SQLite can read a view, without a look at its rows. Raises apsw.Error."""
        self.connection.execute(
            f"EXPLAIN SELECT * FROM {quote_sqlite_name(schema)}.{quote_sqlite_name(name)}"
        ).fetchall()

    def _describe_columns(self, schema: str, name: str) -> list[tuple[Any, ...]]:
        """Name, declared type, place in the primary key, and whether it is hidden, of each column."""
        return self.connection.execute(
            "SELECT name, type, pk, hidden FROM pragma_table_xinfo(?, ?) ORDER BY cid", (name, schema)
        ).fetchall()

    def read_rows(self, source: plan.TableSource, wanted: TableFilter | None = None) -> list[tuple[Any, ...]]:
        """The rows of a table in its order, without what a filter leaves out."""
        names = [quote_sqlite_name(name) for name, _ in source.columns]
        return self._fetch_rows(_write_sqlite_select(source, names, wanted), wanted.values if wanted else ())

    def read_integer_columns(self, source: plan.TableSource, *columns: str) -> list[Any] | None:
        """Columns of whole numbers as arrays, in the order of the table; None where rows are as good.

        A million pairs take 0.2 s, as rows 0.5. Of a smaller table it would be the import of NumPy that takes long.
        """
        home = f"{quote_sqlite_name(source.schema)}.{quote_sqlite_name(source.table)}"
        most = self.connection.limit(apsw.SQLITE_LIMIT_LENGTH) // DIGITS
        if not MANY_ROWS <= self._fetch_rows(f"SELECT count(*) FROM {home}")[0][0] <= most:
            return None
        import numpy as np

        names = list(map(quote_sqlite_name, columns))
        shown = ", ".join(f"group_concat({name})" for name in names)
        (texts,) = self._fetch_rows(f"SELECT {shown} FROM ({_write_sqlite_select(source, names)})")
        return [np.fromstring(text, np.int64, sep=",") for text in texts]

    def read_unreadable_rows(self, source: plan.TableSource) -> list[tuple[Any, ...]]:
        """The same where some texts are not UTF-8: an UnreadableText stands for each of these."""
        names = [quote_sqlite_name(name) for name, _ in source.columns]
        texts = [f"typeof({name}) = 'text'" for name in names]
        # The bytes of a text are in the encoding of the file.
        values = [f"iif({test}, CAST({name} AS BLOB), {name})" for name, test in zip(names, texts, strict=True)]
        (encoding,) = self._fetch_rows("PRAGMA encoding")[0]

        def decode_row(row: tuple[Any, ...]) -> tuple[Any, ...]:
            cells = zip(row[: len(names)], row[len(names) :], strict=True)
            return tuple(decode_text(value, encoding) if is_text else value for value, is_text in cells)

        return list(map(decode_row, self._fetch_rows(_write_sqlite_select(source, [*values, *texts]))))

    def _fetch_rows(self, text: str, bindings: tuple[Any, ...] | Mapping[str, Any] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement. Raises ExecutionError X009 where SQLite refuses it: the file may be locked."""
        try:
            return self.connection.execute(text, bindings).fetchall()
        except READ_ERRORS as error:
            raise build_sqlite_error(error) from error

    def _read_version(self, schema: str) -> Version:
        """Changes when this or another connection has changed the database; None where a ROLLBACK may change it."""
        if self.connection.in_transaction:
            return None
        versions = self._fetch_rows(f"PRAGMA {quote_sqlite_name(schema)}.data_version")
        cookies = self._fetch_rows(f"PRAGMA {quote_sqlite_name(schema)}.schema_version")
        own = 0 if self.graphs is None else self.graphs.changes
        return (versions, cookies, self.connection.total_changes() - own)

    def _describe_table(self, schema: str, name: str, kind: str, without_rowid: bool, version: Version) -> KnownTable:
        rows = [row for row in self._describe_columns(schema, name) if row[3] != 1]
        columns = [column for column, *_ in rows]
        keys = [column for _, column in sorted((key, column) for column, _, key, _ in rows if key)]
        if kind == "view":
            order: tuple[str, ...] = ()
        elif without_rowid:
            order = tuple(keys)
        else:
            taken = {column.lower() for column in columns}
            order = tuple(word for word in ("rowid", "_rowid_", "oid") if word not in taken)[:1]
        listed = self._fetch_rows(
            "SELECT name, origin, partial FROM pragma_index_list(?, ?) ORDER BY origin, name", (name, schema)
        )
        indexed = any(origin != "pk" or not without_rowid for _, origin, _ in listed)
        whole = [(index, origin) for index, origin, partial in listed if not partial]
        indexes, kept_by = ((), "") if kind == "view" else self._find_indexes(schema, name, order, keys, whole)
        collated = self._find_collated_columns(schema, name, kind, columns)
        source = plan.TableSource(0, name, schema, name, (), order, collated, (), indexes, indexed, kept_by, span=None)  # type: ignore[arg-type]
        led = {entry[0][0] for entry in indexes} - set(collated)
        rowid = {key for (key, *_), index in indexes if not index and not without_rowid}
        declared = tuple(DatabaseColumn(c, words, c in led, c in rowid) for c, words, *_ in rows)
        if kind == "view":
            self._check_view(schema, name)
            declared = tuple(DatabaseColumn(c, words) for c, words, *_ in rows)
        return KnownTable(version, source, declared, frozenset(keys))

    def _find_indexes(
        self, schema: str, name: str, order: tuple[str, ...], keys: list[str], listed: list[tuple[str, str]]
    ) -> tuple[tuple[tuple[tuple[str, ...], str], ...], str]:
        """What finds the rows with one value of some columns and gives them in the order of the table; what keeps them.

        These are pairs of columns and index, the longest first. An index does so for all of its columns, for its
        entries end with what sorts the table. The index "" stands for the table itself. `listed` are all indexes that
        have every row, with their origins.
        """
        found: dict[tuple[str, ...], str] = {}
        kept_by = ""
        if keys and order == tuple(keys):
            (kept,) = (index for index, origin in listed if origin == "pk")
            parts = self._list_index_columns(schema, kept)
            ascends = [not down and coll == self._find_collation(schema, name, key) for key, down, coll in parts]
            if all(coll == "BINARY" for _, _, coll in parts):
                found[tuple(keys)] = ""
            if parts[0][2] == "BINARY" and all(ascends[1:]):
                found[(keys[0],)] = ""
            kept_by = kept if all(ascends) else ""
            listed = [row for row in listed if row[1] != "pk"] if kept_by else []
        elif len(keys) == 1 and all(origin != "pk" for _, origin in listed):
            found[(keys[0],)] = ""  # a primary key that no index keeps is the rowid
        for index, _ in listed:
            parts = self._list_index_columns(schema, index)
            if all(column is not None and collation == "BINARY" for column, _, collation in parts):
                found.setdefault(tuple(column for column, _, _ in parts), index)
        return tuple(sorted(found.items(), key=lambda entry: -len(entry[0]))), kept_by

    def _list_index_columns(self, schema: str, index: str) -> list[tuple[Any, ...]]:
        """The columns of an index, each with whether it descends, and its collation."""
        return self._fetch_rows(
            "SELECT name, desc, coll FROM pragma_index_xinfo(?, ?) WHERE key ORDER BY seqno", (index, schema)
        )

    def _find_collated_columns(self, schema: str, name: str, kind: str, columns: Sequence[str]) -> tuple[str, ...]:
        """The columns that SQLite would not compare byte by byte; any of a view where its database has such."""
        if kind == "view":
            words = self._fetch_rows(f"SELECT sql LIKE '%collate%' FROM {quote_sqlite_name(schema)}.sqlite_schema")
            return tuple(columns) if schema == "temp" or (1,) in words else ()
        return tuple(column for column in columns if self._find_collation(schema, name, column) != "BINARY")

    def _find_collation(self, schema: str, name: str, column: str) -> str:
        return self.connection.column_metadata(schema, name, column)[1]
