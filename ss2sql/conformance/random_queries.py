"""Random queries over the tables of a world, and over plain copies of them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

from ss2sql.errors import Error
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind
from ss2sql.vtables.attached_worlds import AttachedTable
from ss2sql.vtables.contract import Column, World
from ss2sql.vtables.schema import Schema

Outcome = tuple[str, Any]


@dataclass(frozen=True, slots=True)
class TableCopy:
    """A table as a list of dicts: `title` is its name in scripts, `plain` are its columns of scalars."""

    title: str
    schema: Schema
    plain: Sequence[Column]
    rows: list[dict[str, Any]]

    @property
    def name(self) -> str:
        """The copy's name in scripts."""
        return "copy_of_" + self.title.replace(".", "_")


@dataclass(frozen=True, slots=True)
class QueryPair:
    """A query over the world as text, and over the copies."""

    table: str
    text: str
    copied: str


class QueryGenerator:
    """Generates random queries, and runs them."""

    def __init__(self, dice: random.Random, copies: Sequence[TableCopy], world: World) -> None:
        from ss2sql.session.session import connect

        self.dice = dice
        self.copies = [copy for copy in copies if copy.plain]
        self.session = connect()
        self.session.attach("world", world)
        self.session.attach("numbers", [1, 2, 3])
        for copy in self.copies:  # only the needed columns: each query reads the types of all values
            columns = [column.name for column in copy.plain]
            rows = [{name: row[name] for name in columns} for row in copy.rows]
            self.session.attach(copy.name, rows or {name: [] for name in columns})
        self._turned: list[QueryPair] = []  # joins whose other order is still to come
        self._compiled: tuple[str, Any] = ("", None)

    def query_world(self, script: QueryPair, engine: Any) -> Outcome:
        """The outcome of a query over the world."""
        return self._find_outcome(script.text, engine)

    def query_copies(self, script: QueryPair) -> Outcome:
        """The outcome over the copies."""
        return self._find_outcome(script.copied, "native")

    def _find_outcome(self, text: str, engine: Any) -> Outcome:
        try:
            if self._compiled[0] != text:  # both engines share one compilation
                self._compiled = text, self.session.compile(text)
            return "value", tag_with_types(self._compiled[1].run(engine=engine).value)
        except Error as error:
            return "error", error.code if error.code != "X011" else f"{error.code} {error.message}"

    def find_missing_arguments_code(self, table: AttachedTable) -> str:
        """The code of the error for a table function without its arguments."""
        kind, found = self._find_outcome(f"SELECT this FROM world.{table.table.name}() AS list;", "native")
        return str(found) if kind == "error" else "missing"

    def make_query(self) -> QueryPair:
        """A random query over one or two tables; one over numbers where no table has a column of scalars.

        After a join comes the same join with its tables in the other order.
        """
        if self._turned:
            return self._turned.pop()
        if not self.copies:
            return QueryPair("world", "SELECT this FROM numbers AS list;", "SELECT this FROM numbers AS list;")
        dice = self.dice
        first = dice.choice(self.copies)
        sources: list[tuple[str, TableCopy | None]] = [("a", first)]
        if dice.random() < 0.4:
            sources.append(("b", dice.choice([*self.copies, None])))
        named = [(name, copy) for name, copy in sources if copy is not None]
        columns = [f"{name}.{dice.choice(copy.plain).name}" for name, copy in named for _ in range(dice.randint(1, 3))]
        columns += [f"{name}.this" for name, copy in sources if copy is None]
        where = f" WHERE {self._make_condition(named, 2)}" if dice.random() < 0.9 else ""
        order = self._make_order(named)
        limit = f" LIMIT {dice.randint(1, 5)}" if dice.random() < 0.2 else ""
        start, end = f"SELECT {', '.join(columns)} FROM ", f"{where}{order}{limit} AS rows;"
        made = [_write_query(sources, start, end)]
        if len(sources) > 1:
            made.append(_write_query(sources[::-1], start, end))
            dice.shuffle(made)
        script, *self._turned = made
        return script

    def _make_order(self, named: Sequence[tuple[str, TableCopy]]) -> str:
        if self.dice.random() < 0.8:
            return ""
        name, copy = self.dice.choice(named)
        kinds = copy.schema.kinds
        keys = [c.name for c in copy.plain if kinds[c.name].is_only(_NUMBER) or kinds[c.name].is_only(_TEXT)]
        return f" ORDER BY {name}.{self.dice.choice(keys)}{self.dice.choice(('', ' DESC'))}" if keys else ""

    def _make_condition(self, named: Sequence[tuple[str, TableCopy]], depth: int) -> str:
        dice = self.dice
        if depth and dice.random() < 0.6:
            word = dice.choice((" AND ", " AND ", " OR "))
            inner = word.join(self._make_condition(named, depth - 1) for _ in range(dice.randint(2, 3)))
            return f"NOT ({inner})" if dice.random() < 0.15 else f"({inner})"
        name, copy = dice.choice(named)
        column = self._pick_filtered_column(copy)
        left = f"{name}.{column.name}"
        kind = copy.schema.kinds[column.name]
        ordered = kind.is_only(_NUMBER) or kind.is_only(_TEXT)
        operator = dice.choice(("==", "!=", "<", "<=", ">", ">=")) if ordered else dice.choice(("==", "!="))
        if dice.random() < 0.1:
            values = ", ".join(self._make_literal(copy, column) for _ in range(3))
            return f"{left} {dice.choice(('IN', 'NOT IN'))} [{values}]"
        right = self._choose_column(named, kind) if dice.random() < 0.25 else self._make_literal(copy, column)
        return f"{left} {operator} {right}" if dice.random() < 0.8 else f"{right} {_TURNED[operator]} {left}"

    def _pick_filtered_column(self, copy: TableCopy) -> Column:
        """A column, preferably one that the adapter can filter by."""
        filtered = [column for column in copy.plain if column.filter]
        return self.dice.choice(filtered if filtered and self.dice.random() < 0.7 else copy.plain)

    def _choose_column(self, named: Sequence[tuple[str, TableCopy]], kind: Any) -> str:
        """A column of the same kind, of any table."""
        alike = [f"{n}.{p.name}" for n, c in named for p in c.plain if c.schema.kinds[p.name].kinds == kind.kinds]
        shift = f" + {self.dice.randint(-2, 2)}" if kind.kinds == Kind.FLOAT and self.dice.random() < 0.5 else ""
        return f"{self.dice.choice(alike)}{shift}"

    def _make_literal(self, copy: TableCopy, column: Column) -> str:
        """A value that the column has, or one near it; rarely one of another kind."""
        if not copy.rows:
            return "0" if copy.schema.kinds[column.name].is_only(_NUMBER) else '""'
        value = self.dice.choice(copy.rows)[column.name]
        if type(value) is float and self.dice.random() < 0.4:
            value += self.dice.choice((-1.0, 1.0)) * self.dice.random()
        if type(value) is int and self.dice.random() < 0.2:
            value += self.dice.choice((-1, 1, 0.5))
        return write_literal(value)


def _write_query(sources: Sequence[tuple[str, TableCopy | None]], start: str, end: str) -> QueryPair:
    """A query over these sources, as scripts for the world and for its copies."""
    table = next(copy.title for _, copy in sources if copy is not None)
    items = [(name, copy.title if copy else "numbers", copy.name if copy else "numbers") for name, copy in sources]
    texts = (start + ", ".join(f"{item[0]} = {item[place]}" for item in items) + end for place in (1, 2))
    return QueryPair(table, *texts)


_NUMBER = Kind.INT | Kind.FLOAT
_TEXT = Kind.STR
_TURNED = {"==": "==", "!=": "!=", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


def write_literal(value: Any) -> str:
    """A scalar as scripts write it."""
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in "\\'" else f"\\U{ord(c):08x}" for c in value)
        return f"'{escaped}'"
    text = repr(value)
    return f"({text})" if text.startswith("-") else text


def tag_with_types(value: Any) -> Any:
    """A value that equals another only if the types are equal as well."""
    if isinstance(value, (list, tuple)):
        return (type(value).__name__, *map(tag_with_types, value))
    if isinstance(value, dict):
        return ("dict", *((name, tag_with_types(part)) for name, part in value.items()))
    return type(value).__name__, repr(value) if isinstance(value, float) else value
