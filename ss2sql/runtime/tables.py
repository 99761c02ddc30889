"""Tables and views of the session's database, as the resolver sees them.

The kinds of values in a column are read from the data, not from the declared type, which SQLite does not
enforce. The reading is kept until the database changes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import apsw

from ss2sql import plan
from ss2sql.errors import ExecutionError
from ss2sql.kinds import Kind, Type

_KINDS = {
    "null": Kind.NONE,
    "integer": Kind.INT,
    "real": Kind.FLOAT,
    "text": Kind.STR,
    "blob": Kind.OBJECT,
}


def quoted(name: str) -> str:
    """A name as SQL reads it whatever characters it has."""
    return '"' + name.replace('"', '""') + '"'


class Tables:
    """Looks up tables and views by name, in the main database first."""

    def __init__(self, connection: apsw.Connection) -> None:
        self.connection = connection
        self._known: dict[tuple[str, str], tuple[Any, plan.TableSource]] = {}

    def attach(self, name: str, path: Path) -> None:
        """Makes the tables of a SQLite file known as `name.table`. Raises apsw.Error where it is no such file."""
        databases = {row[1].lower() for row in self.connection.execute("PRAGMA database_list")}
        if name.lower() in databases:
            self.connection.execute(f"DETACH {quoted(name)}")
        self._known.clear()
        self.connection.execute(f"ATTACH ? AS {quoted(name)}", (str(path),))
        try:
            self.connection.execute(f"SELECT count(*) FROM {quoted(name)}.sqlite_schema").fetchall()
        except apsw.Error:
            self.connection.execute(f"DETACH {quoted(name)}")
            raise

    def names(self) -> list[str]:
        """The names of all tables and views, those of SQLite and of ss2sql apart."""
        rows = self._fetch("SELECT name, type FROM pragma_table_list ORDER BY schema <> 'main', name")
        return [
            name for name, kind in rows if kind in ("table", "view") and not name.startswith(("sqlite_", "ss2sql_"))
        ]

    def find(self, schema: str | None, name: str) -> plan.TableSource | None:
        """The table or view with this name, exactly as it is written there; None if there is none."""
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
        if known is not None and known[0] == version:
            return known[1]
        try:
            source = self._read(home, exact, kind, bool(without_rowid))
        except apsw.Error as error:
            hints = (f"look at the definition of the {kind} in the database",)
            raise ExecutionError("X009", f"the {kind} '{name}' cannot be read: {error}", hints=hints) from error
        self._known[(home, exact)] = (version, source)
        return source

    def rows(self, source: plan.TableSource) -> list[tuple[Any, ...]]:
        """All rows of a table in its order."""
        columns = ", ".join(quoted(name) for name, _ in source.columns)
        order = f" ORDER BY {', '.join(quoted(key) for key in source.order)}" if source.order else ""
        return self._fetch(f"SELECT {columns} FROM {quoted(source.schema)}.{quoted(source.table)}{order}")

    def _fetch(self, text: str, bindings: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement. Raises ExecutionError X009 where SQLite refuses it: the file may be locked."""
        try:
            return self.connection.execute(text, bindings).fetchall()
        except apsw.Error as error:
            raise ExecutionError("X009", f"SQLite: {error}") from error

    def _version(self, schema: str) -> tuple[Any, ...]:
        """Changes when this or another connection has changed the database."""
        versions = self._fetch(f"PRAGMA {quoted(schema)}.data_version")
        cookies = self._fetch(f"PRAGMA {quoted(schema)}.schema_version")
        return (versions, cookies, self.connection.total_changes())

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
        typed = tuple(zip(columns, self._types(schema, name, columns), strict=True))
        collated = () if kind == "view" else tuple(c for c in columns if self._collation(schema, name, c) != "BINARY")
        indexes = () if kind == "view" else self._indexes(schema, name, order, keys)
        return plan.TableSource(0, name, schema, name, typed, order, collated, indexes, span=None)  # type: ignore[arg-type]

    def _indexes(self, schema: str, name: str, order: tuple[str, ...], keys: list[str]) -> tuple[tuple[str, str], ...]:
        """What finds the rows with one value of a column and gives them in the order of the table, as (column, index).

        That is an index on this column alone, for its entries end with the rowid. The index "" stands for the table
        itself, which is sorted by its key.
        """
        if keys and order == tuple(keys):
            return ((keys[0], ""),) if self._sorted_by_key(schema, name) else ()
        names: list[tuple[Any, ...]] = self.connection.execute(
            "SELECT name, origin FROM pragma_index_list(?, ?) WHERE NOT partial ORDER BY name", (name, schema)
        ).fetchall()
        # A primary key that no index keeps is the rowid.
        found = {keys[0]: ""} if len(keys) == 1 and all(origin != "pk" for _, origin in names) else {}
        for index, origin in names:
            parts: list[tuple[Any, ...]] = self.connection.execute(
                "SELECT name, coll FROM pragma_index_xinfo(?, ?) WHERE key", (index, schema)
            ).fetchall()
            if len(parts) == 1 and parts[0][0] is not None and parts[0][1] == "BINARY" and origin == "c":
                found.setdefault(parts[0][0], index)
        return tuple(found.items())

    def _sorted_by_key(self, schema: str, name: str) -> bool:
        """Whether the rows with one value of the first key of a table without rowid ascend in its other keys."""
        parts = self._fetch(
            "SELECT part.name, part.desc, part.coll FROM pragma_index_list(?1, ?2) AS list,"
            " pragma_index_xinfo(list.name, ?2) AS part WHERE list.origin = 'pk' AND part.key ORDER BY part.seqno",
            (name, schema),
        )
        (_, _, first), *others = parts
        return first == "BINARY" and all(
            not descending and collation == self._collation(schema, name, key) for key, descending, collation in others
        )

    def _collation(self, schema: str, name: str, column: str) -> str:
        return self.connection.column_metadata(schema, name, column)[1]

    def _types(self, schema: str, name: str, columns: list[str]) -> list[Type]:
        tests = ", ".join(f"typeof({quoted(column)})" for column in columns)
        found: list[tuple[Any, ...]] = self.connection.execute(
            f"SELECT DISTINCT {tests} FROM {quoted(schema)}.{quoted(name)}"
        ).fetchall()
        types = []
        for index in range(len(columns)):
            kinds = Kind(0)
            for row in found:
                kinds |= _KINDS[row[index]]
            types.append(Type(kinds))
        return types
