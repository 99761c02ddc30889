"""Remembered graphs in tables of the session's file.

They are ordinary tables, documented for users in docs/graphs.md. What is written at once is written in one short
transaction, so that a crash leaves whole states behind. Several processes may extend one graph: what one of them finds
in place it leaves there. The statements call no SQL function, for scripts may have replaced any.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import apsw

from ss2sql.errors import ExecutionError
from ss2sql.runtime.run.keyboard_interrupt import without_keyboard_interrupt
from ss2sql.runtime.sqlite.authorizer import READ_ERRORS

TABLES = {
    "ss2sql_graphs": """
        id INTEGER PRIMARY KEY AUTOINCREMENT, -- none is used twice
        key TEXT NOT NULL UNIQUE,   -- a hash of the query, its functions and what it reads
        query TEXT NOT NULL,        -- the text of the query that came first
        functions TEXT NOT NULL,    -- JSON: the names of its Python functions
        parameters TEXT NOT NULL,   -- JSON: the variables that its steps read
        variables TEXT NOT NULL,    -- JSON: the names of the values in a state
        columns TEXT NOT NULL,      -- JSON: the names of the values in a row
        levels INTEGER NOT NULL,    -- how many levels a search has completed
        created TEXT NOT NULL,      -- UTC
        used TEXT NOT NULL          -- UTC, to the minute""",
    "ss2sql_nodes": """
        id INTEGER PRIMARY KEY,
        graph INTEGER NOT NULL REFERENCES ss2sql_graphs(id) ON DELETE CASCADE,
        state TEXT NOT NULL,        -- JSON: the values of the START WITH variables
        steps INTEGER,              -- the number of edges from here; NULL as long as it is unknown
        UNIQUE (graph, state)""",
    "ss2sql_edges": """
        source INTEGER NOT NULL REFERENCES ss2sql_nodes(id) ON DELETE CASCADE,
        position INTEGER NOT NULL,  -- 0, 1, 2 ... in the order of FROM
        row TEXT NOT NULL,          -- JSON: the values of SELECT
        target INTEGER,             -- the node of the state that CONNECT BY gives; NULL as long as it is unknown
        elements TEXT,              -- JSON: the elements of FROM, where Python functions gave them
        PRIMARY KEY (source, position)""",
    "ss2sql_clauses": """
        id INTEGER PRIMARY KEY,
        graph INTEGER NOT NULL REFERENCES ss2sql_graphs(id) ON DELETE CASCADE,
        key TEXT NOT NULL,
        kind TEXT NOT NULL,         -- condition, cost or probability
        text TEXT NOT NULL,         -- what stands in the query
        UNIQUE (graph, key)""",
    "ss2sql_verdicts": """
        clause INTEGER NOT NULL REFERENCES ss2sql_clauses(id) ON DELETE CASCADE,
        source INTEGER NOT NULL,
        position INTEGER NOT NULL,  -- with source: the edge
        value NOT NULL,             -- of a condition 1 or 0
        PRIMARY KEY (clause, source, position)""",
}
_NO_ROWID = ("ss2sql_edges", "ss2sql_verdicts")
_CONSTRAINTS = ("UNIQUE", "PRIMARY")
_COLUMNS = {
    name: [word for word, *_ in map(str.split, filter(None, text.splitlines())) if word not in _CONSTRAINTS]
    for name, text in TABLES.items()
}
_ONES_OF_A_GRAPH = (
    "DELETE FROM ss2sql_verdicts WHERE clause IN (SELECT id FROM ss2sql_clauses WHERE graph = ?)",
    "DELETE FROM ss2sql_clauses WHERE graph = ?",
    "DELETE FROM ss2sql_edges WHERE source IN (SELECT id FROM ss2sql_nodes WHERE graph = ?)",
    "DELETE FROM ss2sql_nodes WHERE graph = ?",
    "DELETE FROM ss2sql_graphs WHERE id = ?",
)
CURE = f"drop the tables {', '.join(TABLES)}; or connect(path, disable=['remember'])"


_EACH = "json_each(?1) AS e CROSS"  # CROSS JOIN: the wanted nodes are the outer loop


def _join_nodes(nodes: Iterable[int]) -> str:
    """Nodes as one value; in the order of their numbers, which is that of the tables."""
    return f"[{','.join(map(str, sorted(nodes)))}]"


class GraphStore:
    """The tables, over the session's own connection. `changes` counts the rows that were changed here."""

    def __init__(self, connection: apsw.Connection, writable: bool) -> None:
        self.connection = connection
        self.writable = writable
        self.changes = 0
        self._known = False

    # --- transactions ----------------------------------------------------------------------------------

    def has_tables(self) -> bool:
        """Whether the tables are there. Raises ExecutionError X009 where they are not as they are made here."""
        if not self._known:
            found = {name: self._list_columns(name) for name in TABLES}
            if not any(found.values()):
                return False
            for name, columns in found.items():
                if columns != _COLUMNS[name]:
                    raise build_damage_error(f"the table '{name}' is missing or has other columns")
            self._known = True
        return True

    def _list_columns(self, name: str) -> list[str]:
        return [row[1] for row in self.fetch_rows(f"PRAGMA main.table_info({name})")]

    @contextmanager
    def while_reading(self) -> Iterator[None]:
        """A time in which the file stays as it is."""
        with self._convert_errors(), self.connection:
            yield

    @contextmanager
    def while_writing(self) -> Iterator[None]:
        """One transaction. Raises apsw.BusyError, apsw.FullError and their like where the file cannot be written."""
        connection = self.connection
        if connection.in_transaction:
            raise apsw.BusyError("a transaction of somebody else is open")
        before = connection.total_changes()
        connection.execute("BEGIN IMMEDIATE")
        try:
            if not self.has_tables():
                for name, columns in TABLES.items():
                    tail = " WITHOUT ROWID" if name in _NO_ROWID else ""
                    connection.execute(f"CREATE TABLE {name} ({columns}\n    ){tail}")
            yield
            connection.execute("COMMIT")
        except BaseException:
            self._known = False
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
        finally:
            self.changes += connection.total_changes() - before

    @contextmanager
    def _convert_errors(self) -> Iterator[None]:
        try:
            yield
        except (apsw.BusyError, apsw.LockedError):
            raise
        except READ_ERRORS as error:
            raise build_damage_error(str(error)) from error

    def fetch_rows(self, text: str, bindings: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """The rows of a statement."""
        return self.connection.execute(text, tuple(bindings)).fetchall()

    def fetch_many(self, text: str, bindings: Iterable[Sequence[Any]]) -> list[tuple[Any, ...]]:
        """The rows of a statement for one set of values after the other."""
        return self.connection.executemany(text, bindings).fetchall()

    # --- graphs ----------------------------------------------------------------------------------------

    def find_graph(self, key: str) -> int | None:
        """The number of the graph with this key, if there is one."""
        if not self.has_tables():
            return None
        found = self.fetch_rows("SELECT id FROM ss2sql_graphs WHERE key = ?", (key,))
        return found[0][0] if found else None

    def make_graph(self, key: str, described: Sequence[str]) -> int:
        """The number of a new graph; `described` are its query, functions, parameters, variables and columns."""
        now = get_current_minute()
        self.fetch_rows(
            "INSERT INTO ss2sql_graphs(key, query, functions, parameters, variables, columns, levels, created, used)"
            " VALUES (?, ?, ?, ?, ?, ?, 0, ?, ?)",
            (key, *described, now, now),
        )
        return self.connection.last_insert_rowid()

    def note_use(self, graph: int, levels: int) -> None:
        """Notes that a graph was used, and how many levels are complete."""
        self.fetch_rows(
            "UPDATE ss2sql_graphs SET used = ?1, levels = ?2 WHERE id = ?3 AND (used < ?1 OR levels < ?2)",
            (get_current_minute(), levels, graph),
        )

    def is_use_unnoted(self, graph: int | None) -> bool:
        """Whether it is not noted yet that the graph is used now."""
        return bool(
            self.fetch_rows("SELECT 1 FROM ss2sql_graphs WHERE id = ? AND used < ?", (graph, get_current_minute()))
        )

    def number_clause(self, graph: int, key: str, kind: str, text: str) -> int:
        """The number of a clause, which is made if need be."""
        new = "INSERT OR IGNORE INTO ss2sql_clauses(graph, key, kind, text) VALUES (?, ?, ?, ?)"
        self.fetch_rows(new, (graph, key, kind, text))
        found = self.fetch_rows("SELECT id FROM ss2sql_clauses WHERE graph = ? AND key = ?", (graph, key))
        if len(found) != 1:
            raise build_damage_error("a clause that was written cannot be found")
        return int(found[0][0])

    def list_clauses(self, graph: int) -> dict[str, int]:
        """The numbers of the clauses of a graph, by their keys."""
        rows = self.fetch_rows("SELECT key, id FROM ss2sql_clauses WHERE graph = ?", (graph,))
        return {key: number for key, number in rows}  # noqa: C416 - the types

    def describe_graphs(self) -> list[tuple[Any, ...]]:
        """All graphs: number, query, functions, parameters, nodes, edges, levels, created, used."""
        return self.fetch_rows(
            "SELECT id, query, functions, parameters,"
            " (SELECT count(*) FROM ss2sql_nodes WHERE graph = g.id),"
            " (SELECT count(*) FROM ss2sql_nodes AS n JOIN ss2sql_edges AS e ON e.source = n.id WHERE n.graph = g.id),"
            " levels, created, used FROM ss2sql_graphs AS g ORDER BY id"
        )

    @without_keyboard_interrupt
    def drop_graph(self, graph: int | None) -> None:
        """Removes a graph. Raises ExecutionError X009 where the file cannot be written."""
        try:
            with self.while_writing():
                for text in _ONES_OF_A_GRAPH:
                    self.fetch_rows(text, (graph,))
        except READ_ERRORS as error:
            raise ExecutionError("X009", f"the remembered graph cannot be dropped: {error}") from error

    # --- nodes and edges -------------------------------------------------------------------------------

    def find_states(self, graph: int, texts: Iterable[str]) -> list[tuple[int, int]]:
        """The numbers of known states, each after the place of its text."""
        found = self.fetch_many(
            "SELECT ?1, id FROM ss2sql_nodes WHERE graph = ?2 AND state = ?3",
            ((place, graph, text) for place, text in enumerate(texts)),
        )
        return [(place, number) for place, number in found]

    def make_nodes(self, graph: int, texts: Sequence[str]) -> list[int]:
        """The numbers of states, which are made if need be."""
        self.fetch_many("INSERT OR IGNORE INTO ss2sql_nodes(graph, state) VALUES (?, ?)", ((graph, t) for t in texts))
        return [number for _, number in self.find_states(graph, texts)]

    def list_steps(self, graph: int, nodes: Iterable[int]) -> dict[int, int]:
        """The numbers of steps from those nodes that were expanded."""
        text = f"SELECT n.id, n.steps FROM {_EACH} JOIN ss2sql_nodes AS n ON n.id = e.value WHERE n.graph = ?2"
        found = self.fetch_rows(f"{text} AND n.steps IS NOT NULL", (_join_nodes(nodes), graph))
        return {node: steps for node, steps in found}  # noqa: C416

    def list_edges(self, nodes: Iterable[int]) -> list[tuple[Any, ...]]:
        """Source, position, row, target and elements of the edges out of nodes, in order."""
        text = f"SELECT s.* FROM {_EACH} JOIN ss2sql_edges AS s ON s.source = e.value"
        found = self.fetch_rows(text, (_join_nodes(nodes),))
        found.sort()  # they are: that takes SQLite longer to find out
        return found

    def list_states(self, nodes: Iterable[int]) -> list[tuple[Any, ...]]:
        """Number and state of nodes."""
        text = f"SELECT n.id, n.state FROM {_EACH} JOIN ss2sql_nodes AS n ON n.id = e.value"
        return self.fetch_rows(text, (_join_nodes(nodes),))

    def list_verdicts(self, clause: int, nodes: Iterable[int]) -> list[tuple[Any, ...]]:
        """Source, position and value of what is known of a clause."""
        text = f"SELECT v.source, v.position, v.value FROM {_EACH} JOIN ss2sql_verdicts AS v ON v.source = e.value"
        return self.fetch_rows(f"{text} WHERE v.clause = ?2", (_join_nodes(nodes), clause))

    def write_edges(self, edges: Iterable[tuple[Any, ...]]) -> None:
        """Writes edges: source, position, row, target and elements."""
        self.fetch_many(
            "INSERT INTO ss2sql_edges(source, position, row, target, elements) VALUES (?, ?, ?, ?, ?)"
            " ON CONFLICT (source, position) DO UPDATE SET target = excluded.target"
            " WHERE target IS NULL AND excluded.target IS NOT NULL",
            edges,
        )

    def write_steps(self, steps: Iterable[tuple[int, int]]) -> None:
        """Notes of nodes, given second, how many steps there are, and that all of these are kept."""
        self.fetch_many("UPDATE ss2sql_nodes SET steps = ? WHERE id = ?", steps)

    def write_clause_values(self, verdicts: Iterable[tuple[Any, ...]]) -> None:
        """Writes values of clauses: clause, source, position, value."""
        text = "INSERT OR IGNORE INTO ss2sql_verdicts(clause, source, position, value) VALUES (?, ?, ?, ?)"
        self.fetch_many(text, verdicts)


def get_current_minute() -> str:
    """The present minute in UTC, as SQLite writes it."""
    return time.strftime("%Y-%m-%d %H:%M", time.gmtime())


def build_damage_error(reason: str) -> ExecutionError:
    """The error for tables that cannot be read."""
    return ExecutionError("X009", f"the remembered graphs cannot be read: {reason}", hints=(CURE,))
