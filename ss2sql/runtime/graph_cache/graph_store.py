"""Remembered graphs in tables of the session's file, and as users see them: `ss.graphs()`.

They are ordinary tables, documented for users in docs/graphs.md: a row for each graph, and one for each state with all
of its steps and the calls that these needed. What is written at once is written in one short transaction, so that a
crash leaves whole states behind. The statements call no SQL function but json_each, for scripts may have replaced any.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from marshal import dumps
from math import isfinite
from typing import Any, TypeAlias

import apsw

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import convert_value
from ss2sql.language.kinds import Opaque, is_encodable
from ss2sql.language.values import Frozen, thaw_value
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable
from ss2sql.runtime.run.run_state import defer_keyboard_interrupt
from ss2sql.runtime.sqlite.connections import READ_ERRORS

_OTHER_KEYS = "JSON has no form for a dict with keys that are no text"


def _thaw_stored_value(value: Any) -> Any:
    if isinstance(value, Frozen):
        return value.value
    value = value.object if isinstance(value, Opaque) else value
    raise NotCacheable(f"JSON has no form for an object of the type {type(value).__name__}")


_encode = json.JSONEncoder(
    ensure_ascii=False, allow_nan=False, check_circular=False, separators=(",", ":"), default=_thaw_stored_value
).encode


def _read_finite_float(text: str) -> float:
    if isfinite(value := float(text)):
        return value
    raise ValueError(f"{text} is no value")


_decode = json.JSONDecoder(parse_float=_read_finite_float, parse_constant=_read_finite_float).decode
# An integer beyond 64 bits has as many digits at least. To look for them so takes a tenth of the time of a pattern.
_LONG_NUMBER, _ALL_NINES = b"9" * 19, bytes.maketrans(b"012345678", b"999999999")


def encode_values_as_json(value: Any) -> str:
    """A tuple of values, which may be frozen, as JSON. Raises NotCacheable where JSON would give back others."""
    try:
        text = _encode(value)
    except TypeError:
        raise NotCacheable(_OTHER_KEYS) from None
    except (ValueError, RecursionError) as error:
        raise NotCacheable(f"JSON has no form for a value: {error}") from None
    # Of keys that are numbers JSON makes text; a tuple comes back as a list.
    if "{" in text and dumps(thaw_value(value), 2) != dumps(_decode(text), 2):
        raise NotCacheable(_OTHER_KEYS)
    if not is_encodable(text):
        raise NotCacheable("a text holds half of a character (a lone surrogate)")
    return text


# What calls of functions gave: by a name that tells a function from others, then by their arguments as text.
Calls: TypeAlias = dict[str, dict[str, Any]]


def add_calls(calls: Calls, more: Calls) -> None:
    """Adds more calls to these."""
    for name, values in more.items():
        calls.setdefault(name, {}).update(values)


def encode_calls(calls: Calls) -> str:
    """Calls as JSON, without those whose values JSON would not give back."""
    try:
        encode_values_as_json(tuple(value for values in calls.values() for value in values.values()))
    except NotCacheable:
        calls = {name: dict(filter(_is_call_encodable, values.items())) for name, values in calls.items()}
    return _encode(calls)


def _is_call_encodable(call: tuple[str, Any]) -> bool:
    try:
        return bool(encode_values_as_json(call))
    except NotCacheable:
        return False


def decode_calls(text: str) -> Calls:
    """Calls from their JSON. Raises ValueError for a text of another program that is none."""
    try:
        calls: Calls = _decode(text)
        if _LONG_NUMBER in text.encode().translate(_ALL_NINES):  # all else are values: to look takes as long as to read
            calls = convert_value(calls, "a text")
        if not all(type(values) is dict for values in calls.values()):
            raise TypeError(text)
    except (TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"they hold no calls: {error}") from None
    except ExecutionError as error:
        raise ValueError(error.message) from None
    return calls


TABLES = {
    "ss2sql_graphs": """
        id INTEGER PRIMARY KEY AUTOINCREMENT, -- none is used twice
        key TEXT NOT NULL UNIQUE,   -- a hash of the query and its functions
        query TEXT NOT NULL,        -- the text of the query that came first
        functions TEXT NOT NULL,    -- JSON: the names of its Python functions
        parameters TEXT NOT NULL,   -- JSON: the variables that its steps read
        variables TEXT NOT NULL,    -- JSON: the names of the values in a state
        columns TEXT NOT NULL,      -- JSON: the names of the values in a row
        levels INTEGER NOT NULL,    -- how many levels a search has completed
        created TEXT NOT NULL,      -- UTC
        used TEXT NOT NULL          -- UTC, to the minute
    """,
    "ss2sql_states": """
        graph INTEGER NOT NULL REFERENCES ss2sql_graphs(id) ON DELETE CASCADE,
        state TEXT NOT NULL,        -- JSON: the values of the START WITH variables
        length INTEGER NOT NULL,    -- how many steps there are
        steps TEXT NOT NULL,        -- JSON, in the order of FROM: [row, next state]
        calls TEXT NOT NULL,        -- JSON: {function and its hash: {arguments: value}}, those that the steps needed
        PRIMARY KEY (graph, state)
    """,
}
CURE = f"drop the tables {', '.join(TABLES)}; or connect(path, disable=['remember'])"
_MOMENT = "%Y-%m-%d %H:%M"  # UTC


class GraphStore:
    """The tables, over the session's own connection. `changes` counts the rows that were changed here."""

    def __init__(self, connection: apsw.Connection, writable: bool) -> None:
        self.connection = connection
        self.writable = writable
        self.changes = 0

    def fetch_rows(self, text: str, *bindings: Any) -> list[tuple[Any, ...]]:
        return self.connection.execute(text, bindings).fetchall()

    @contextmanager
    def _while_writing(self) -> Iterator[None]:
        """One transaction. Raises apsw.BusyError, apsw.FullError and their like where the file cannot be written."""
        connection = self.connection
        if connection.in_transaction:
            raise apsw.BusyError("a transaction of somebody else is open")
        before = connection.total_changes()
        connection.execute("BEGIN IMMEDIATE")
        try:
            for name, columns in TABLES.items():
                connection.execute(f"CREATE TABLE IF NOT EXISTS {name} ({columns})")
            yield
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
        finally:
            self.changes += connection.total_changes() - before

    # --- graphs ----------------------------------------------------------------------------------------

    def find_graph(self, key: str) -> int | None:
        """The number of the graph with this key, if there is one. Raises errors of apsw."""
        if not self.fetch_rows("SELECT 1 FROM main.sqlite_schema WHERE name = 'ss2sql_graphs'"):
            return None
        found = self.fetch_rows("SELECT id FROM ss2sql_graphs WHERE key = ?", key)
        return found[0][0] if found else None

    def is_use_unnoted(self, graph: int | None) -> bool:
        """Whether it is not noted yet that the graph is used now."""
        now = time.strftime(_MOMENT, time.gmtime())
        return bool(self.fetch_rows("SELECT 1 FROM ss2sql_graphs WHERE id = ? AND used < ?", graph, now))

    def list_graphs(self) -> Iterator[Graph]:
        """All graphs, the oldest first. Raises errors of apsw, and what json raises."""
        if not self.fetch_rows("SELECT 1 FROM main.sqlite_schema WHERE name = 'ss2sql_graphs'"):
            return
        lengths: dict[int, list[int]] = {}
        for graph, length in self.fetch_rows("SELECT graph, length FROM ss2sql_states"):
            lengths.setdefault(graph, []).append(length)
        for graph, query, functions, parameters, levels, created, used in self.fetch_rows(
            "SELECT id, query, functions, parameters, levels, created, used FROM ss2sql_graphs ORDER BY id"
        ):
            names, steps = tuple(json.loads(functions)), lengths.get(graph, [])
            known = json.loads(parameters)
            yield Graph(graph, query, names, known, len(steps), sum(steps), levels, created, used, self)

    @defer_keyboard_interrupt()
    def drop_graph(self, graph: int | None) -> None:
        """Removes a graph. Raises ExecutionError X009 where the file cannot be written."""
        try:
            with self._while_writing():
                self.fetch_rows("DELETE FROM ss2sql_states WHERE graph = ?", graph)
                self.fetch_rows("DELETE FROM ss2sql_graphs WHERE id = ?", graph)
        except READ_ERRORS as error:
            raise ExecutionError("X009", f"the remembered graph cannot be dropped: {error}") from error

    # --- states ----------------------------------------------------------------------------------------

    def read_states(self, graph: int, texts: Sequence[str]) -> dict[str, tuple[str, str]]:
        """The steps and calls of the states that are known, by the texts of states. Raises errors of apsw."""
        found = self.fetch_rows(
            "SELECT s.state, s.steps, s.calls FROM json_each(?) AS e CROSS JOIN ss2sql_states AS s"
            " ON s.graph = ? AND s.state = e.value",
            json.dumps(texts), graph,
        )  # fmt: skip
        return {state: (steps, calls) for state, steps, calls in found}

    def write_states(
        self, key: str, described: Sequence[str], states: Sequence[tuple[str, int, str, str]], levels: int
    ) -> int:
        """Writes states with their steps; gives the number of the graph, which is made where there is none.

        It is `described` by its query, functions, parameters, variables and columns.
        """
        now = time.strftime(_MOMENT, time.gmtime())
        with self._while_writing():
            graph = self.find_graph(key)
            if graph is None:
                self.fetch_rows(
                    "INSERT INTO ss2sql_graphs(key, query, functions, parameters, variables, columns, levels, created,"
                    " used) VALUES (?, ?, ?, ?, ?, ?, 0, ?, ?)",
                    key, *described, now, now,
                )  # fmt: skip
                graph = self.connection.last_insert_rowid()
            self.connection.executemany(
                "INSERT OR REPLACE INTO ss2sql_states(graph, state, length, steps, calls) VALUES (?, ?, ?, ?, ?)",
                ((graph, *state) for state in states),
            )
            self.fetch_rows(
                "UPDATE ss2sql_graphs SET used = ?1, levels = ?2 WHERE id = ?3 AND (used < ?1 OR levels < ?2)",
                now, levels, graph,
            )  # fmt: skip
        return graph


def build_damaged_graph_error(reason: str) -> ExecutionError:
    return ExecutionError("X009", f"the remembered graphs cannot be read: {reason}", hints=(CURE,))


# --- what users see ----------------------------------------------------------------------------------------

_MAX_TEXT_LENGTH = 60


@dataclass(frozen=True, slots=True)
class Graph:
    """A graph that is remembered in the session's file.

    `id` is its number in the table `ss2sql_graphs`. `query` is the text of the query that came first, `functions` are
    the names of the Python functions that its steps call, `parameters` the variables that they read. `nodes` counts
    the states whose steps are known, `edges` steps; `levels` is the greatest number of levels that a search has
    completed. `created` and `used` are times in UTC.
    """

    id: int
    query: str
    functions: tuple[str, ...]
    parameters: dict[str, Any]
    nodes: int
    edges: int
    levels: int
    created: str
    used: str
    _store: GraphStore = field(repr=False, compare=False)

    def drop(self) -> None:
        """Removes the graph from the file. Raises ExecutionError X009 where that cannot be written."""
        self._store.drop_graph(self.id)


class Graphs(tuple[Graph, ...]):
    """The remembered graphs of a file, the oldest first, as they are when `ss.graphs()` is called."""

    __slots__ = ()

    def drop(self) -> None:
        """Removes all of these graphs from the file."""
        for graph in self:
            graph.drop()

    def __repr__(self) -> str:
        if not self:
            return "no remembered graphs"
        names = ("id", "nodes", "edges", "levels", "used", "functions", "query")
        rows = [[_format_graph_cell(getattr(graph, name)) for name in names] for graph in self]
        widths = [max(map(len, column)) for column in zip(names, *rows, strict=True)]
        padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in (names, *rows))
        return "\n".join("  ".join(cells).rstrip() for cells in padded)


def list_graphs(store: GraphStore) -> Graphs:
    """The graphs in a store. Raises ExecutionError X009 where it cannot be read."""
    try:
        return Graphs(store.list_graphs())
    except (apsw.BusyError, apsw.LockedError) as error:
        raise ExecutionError("X009", f"the remembered graphs cannot be read now: {error}") from error
    except (apsw.Error, ValueError, TypeError, RecursionError) as error:
        raise build_damaged_graph_error(str(error)) from error


def _format_graph_cell(value: Any) -> str:
    text = ", ".join(value) if isinstance(value, tuple) else " ".join(str(value).split())
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[: _MAX_TEXT_LENGTH - 3]}..."
