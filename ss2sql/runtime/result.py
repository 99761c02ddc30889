"""The result of a script: its value, the rows or paths behind it, and how they were found."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from ss2sql.runtime.rows import Row, Rows
from ss2sql.runtime.run import Stats
from ss2sql.runtime.values import fresh, show

if TYPE_CHECKING:
    from ss2sql.runtime.compiled import CompiledQuery

MOST_TEXT = 200  # characters of a string in a table

Status: TypeAlias = Literal["complete", "maximum", "timeout", "cancelled"]


class Sql(str):
    """SQL text with what it needs beside it.

    `parameters` are the values bound to its `:names`, `statements` the texts of the script's statements one
    by one, `modules` the virtual tables that it reads, with the columns of their elements.
    """

    parameters: Mapping[str, Any]
    statements: tuple[Sql, ...]
    modules: Mapping[str, tuple[str, ...]]

    def __new__(
        cls,
        text: str,
        parameters: Mapping[str, Any] | None = None,
        statements: tuple[Sql, ...] = (),
        modules: Mapping[str, tuple[str, ...]] | None = None,
    ) -> Sql:
        self = super().__new__(cls, text)
        self.parameters = dict(parameters or {})
        self.statements = statements or (self,)
        self.modules = dict(modules or {})
        return self


@dataclass(slots=True)
class Answer:
    """What one query of a script gave: rows as the executor left them, what AS makes of them, the engine."""

    rows: Rows
    make: Callable[[], Any] | None
    engine: str
    status: Status = "complete"
    made: Any = None

    @property
    def value(self) -> Any:
        """What AS makes of the rows, made when it is first asked for."""
        if self.make is not None:
            self.made, self.make = self.make(), None
        return self.made


@dataclass(repr=False)
class Result:
    """What a script gave.

    `value` is what AS asked for, exactly. `columns` and the rows of iteration are a table of it: the rows of
    a query as tuples; of a search one row per step, with the number of the path and of the step before it;
    of any other value one row. `status` is `complete`, `maximum`, `timeout` or `cancelled`, `engine`
    `database` or `native`. `sql` is the text that ran, `stats` what was counted (see Stats).
    """

    given: Any = field(repr=False)
    engine: str
    status: Status
    stats: Stats
    sql: Sql
    answer: Answer | None = field(default=None)
    outline: list[tuple[str, list[CompiledQuery]]] = field(default_factory=list)

    @property
    def value(self) -> Any:
        return self.given if self.answer is None else self.answer.value

    @property
    def columns(self) -> tuple[str, ...]:
        if self.answer is None:
            return ("value",)
        own = self.answer.rows.columns
        return own if self.answer.rows.paths is None else ("path", "step", *own)

    @property
    def paths(self) -> list[list[Row]]:
        """Of a search: the paths, each a list of rows; of anything else an empty list."""
        if self.answer is None or self.answer.rows.paths is None:
            return []
        rows = self.answer.rows
        assert rows.paths is not None
        return list(rows.paths) if rows.plain else [[_fresh_row(row) for row in path] for path in rows.paths]

    def __iter__(self) -> Iterator[Row]:
        if self.answer is None:
            yield (self.value,)
        elif self.answer.rows.paths is not None:
            for number, path in enumerate(self.answer.rows.paths, 1):
                for step, row in enumerate(path, 1):
                    yield (number, step, *_fresh_row(row))
        else:
            yield from map(_fresh_row, self.answer.rows.rows or ())

    def __len__(self) -> int:
        if self.answer is None:
            return 1
        rows = self.answer.rows
        return len(rows.rows or ()) if rows.paths is None else sum(map(len, rows.paths))

    def explain(self) -> str:
        """What became of the script: see `Query.explain`; functions are shown with the number of their calls."""
        from ss2sql.runtime.explain import explain  # it knows compiled scripts, which know results

        return explain(self.outline, self.stats)

    def show(self, max_rows: int = 20, console: Console | None = None) -> None:
        """Prints the rows as a table, at most `max_rows` of them, and says how many there are."""
        console = console or Console()
        console.print(self._table(max_rows))
        console.print(_caption(len(self), max_rows, self), markup=False, highlight=False)

    def _table(self, max_rows: int) -> RichTable:
        table = RichTable()
        for name in self.columns:
            table.add_column(Text(_cell(name)))
        for row, _ in zip(self, range(max_rows), strict=False):
            table.add_row(*(Text(_cell(value)) for value in row))
        return table

    def __repr__(self) -> str:
        console = Console(width=100, color_system=None, record=True, file=io.StringIO())
        self.show(20, console)
        return console.export_text().rstrip()


def _cell(value: Any) -> str:
    """A value as text of one line; what a terminal would take for more than text is shown as in a script."""
    if not isinstance(value, str):
        return show(value)
    if not value.isprintable():
        return show(value, MOST_TEXT)
    return value if len(value) <= MOST_TEXT else value[: MOST_TEXT - 3] + "..."


def _caption(total: int, shown: int, result: Result) -> str:
    """One line under the table: how many rows and paths, and where they came from."""
    parts = [f"{total} row{'' if total == 1 else 's'}"]
    if result.answer is not None and result.answer.rows.paths is not None:
        count = len(result.answer.rows.paths)
        parts.insert(0, f"{count} path{'' if count == 1 else 's'}")
    if total > shown:
        parts.append(f"the first {shown} shown")
    parts.append(result.engine)
    if result.status != "complete":
        parts.append(result.status)
    return ", ".join(parts)


def _fresh_row(row: Row) -> Row:
    return tuple(map(fresh, row))
