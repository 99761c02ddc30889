"""The result of a script: its value, the rows or paths that it is made of, and how they were found."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, overload

from ss2sql.errors import NOWHERE, RepresentationError, SessionError, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.cancellation import Check, iterate_with_check
from ss2sql.language.kinds import ANY, INT, Type
from ss2sql.language.plan_traversal import format_type
from ss2sql.language.rows import NamedRow, Row, Rows, iterate_checked_paths, make_row_class, make_unique_name
from ss2sql.language.values import copy_for_python
from ss2sql.lowering.sql_query import Sql, SqlQuery, join_sql
from ss2sql.results import copy_result_row, get_result_rows
from ss2sql.runtime.run.run_state import RemainingBounds, Stats, check_run_limit, translate_memory_error
from ss2sql.runtime.run.search_paths import measure_path_lengths

if TYPE_CHECKING:
    from rich.console import Console

    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.results.explain.explanation import Explanation
    from ss2sql.results.watching.animation import Page
    from ss2sql.results.watching.search_trace import SearchTrace
    from ss2sql.runtime.external.duckdb_query import DuckQuery, PredicatePushdown
    from ss2sql.runtime.external.level_query import LevelQuery
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy
    from ss2sql.runtime.sqlite.executor import Database


class OutlineOwner(Protocol):
    """The session of a query, as an explanation sees it: rewrites that are off, functions, cached graphs, SQLite."""

    disabled: frozenset[str]
    functions: dict[str, UserFunction]

    @property
    def graphs(self) -> CachePolicy | None: ...
    def prepare_database(self) -> Database: ...


@dataclass(frozen=True, slots=True)
class OutlinedQuery:
    """One query: as written and after the rewrites, and how it runs."""

    host: OutlineOwner
    written: plan.Query
    query: plan.Query
    engine: str
    lowered: SqlQuery | None  # SQLite's statement, else `reason` and `cures`
    levels: LevelQuery | None  # a search by levels in another database
    duck: DuckQuery | None  # another query in DuckDB
    reason: str
    cures: tuple[str, ...]
    rewrites: tuple[str, ...]
    tell: Callable[[], Sql]  # makes `sql`
    handed: tuple[PredicatePushdown, ...]  # reads in place of tables of DuckDB

    @property
    def sql(self) -> Sql:
        return self.tell()


@dataclass(frozen=True, slots=True)
class OutlinedStatement:
    """The text of a statement and its queries."""

    text: str
    queries: tuple[OutlinedQuery, ...]

    @property
    def sql(self) -> Sql:
        texts = [query.sql for query in self.queries]
        if len(texts) == 1:
            return texts[0]
        if not texts:
            return Sql(f"-- no query: {' '.join(self.text.split())}")
        return Sql("\n".join(f"{text};" for text in texts), statements=tuple(texts))


def join_outlined_sql(statements: Iterable[OutlinedStatement]) -> Sql:
    """The texts of all statements as one, each with its own parameters in `statements`."""
    return join_sql([statement.sql for statement in statements])


# --- results
Status: TypeAlias = Literal["complete", "maximum", "timeout", "cancelled", "memory", "steps"]


@dataclass(slots=True)
class QueryResult:
    """What one query of a script gave: rows as the executor left them, what AS makes of them, the engine.

    `outputs` are the columns of the query in the plan, as far as it is known; `form` is what AS asks for, where the run
    ended before there was a value. `begin` gives the check that is called while the rows are read: within the run
    its own check, after it that of what it has left of its time and its memory.
    """

    rows: Rows
    make: Callable[[Check], Any] | None
    engine: str
    status: Status = "complete"
    outputs: tuple[plan.Output, ...] = ()
    made: Any = None
    form: plan.Representation | None = None
    begin: Callable[[], Check] = RemainingBounds().begin_reading

    @property
    def types(self) -> dict[str, Type]:
        """What the plan promises of columns, by name; nothing of those that SELECT * found at run time."""
        return {output.name: output.expr.type for output in self.outputs if not output.star}

    @property
    def value(self) -> Any:
        """What AS makes of the rows, made when it is first read."""
        if self.make is not None:
            try:
                self.made, self.make = self.make(self.begin()), None
            except MemoryError as error:
                raise translate_memory_error(error) from None
        return self.made


@dataclass(repr=False)
class Result:
    """What a script gave.

    `value` is exactly what AS makes. `columns` and the rows of iteration are a table of it: the rows of a query as
    tuples; of a search one row per step, with the number of the path and of the step before it; of any other value one
    row. `status` is `complete`, `maximum`, `timeout`, `cancelled` or `memory`, `engine` `database` or `native`. `sql`
    is the text that ran, or that SQLite would run, `stats` what was counted (see Stats). `notes` are what a person
    should know, each a line with the cure: why a search may have found too little.
    """

    given_value: Any = field(repr=False)
    engine: str
    status: Status
    stats: Stats
    answer: QueryResult | None = field(default=None)
    outline: tuple[OutlinedStatement, ...] = ()
    notes: tuple[str, ...] = ()
    traced: SearchTrace | None = field(default=None, compare=False)

    @property
    def value(self) -> Any:
        if self.answer is None:
            return self.given_value
        with self.while_reading():
            return self.answer.value

    def __getstate__(self) -> dict[str, Any]:
        """What `pickle` writes and a deep copy has: all that was found, without the session that found it.

        So `explain` of it tells of the run alone.
        """
        state = {**vars(self), "outline": (), "sql": self.sql}
        state.pop("_rows_read", None)
        if self.answer is not None:
            answer, value = self.answer, self.value
            rows = replace(answer.rows, paths=None if answer.rows.paths is None else self.paths)
            outputs = tuple(
                replace(one, expr=plan.Constant(None, one.expr.type, span=NOWHERE), label=None)
                for one in answer.outputs
            )
            state["answer"] = QueryResult(rows, None, answer.engine, answer.status, outputs, made=value)
        return state

    def __copy__(self) -> Result:
        return replace(self)

    @cached_property
    def sql(self) -> Sql:
        return join_outlined_sql(self.outline)

    @property
    def columns(self) -> tuple[str, ...]:
        if self.answer is None:
            return ("value",)
        if self.answer.rows.paths is None:
            return self.answer.rows.columns
        names = ["path", "step"]
        for name in self.answer.rows.columns:
            names.append(make_unique_name(name, names))
        return tuple(names)

    @property
    def paths(self) -> list[list[Row]]:
        """Of a search: the paths, each a list of rows; of anything else an empty list."""
        if self.answer is None or self.answer.rows.paths is None:
            return []
        rows = self.answer.rows
        assert rows.paths is not None
        with self.while_reading() as check:
            paths = iterate_checked_paths(rows.paths, check)
            return (
                list(map(list, paths))
                if rows.plain
                else [list(map(copy_result_row, iterate_with_check(p, check))) for p in paths]
            )

    @contextmanager
    def while_reading(self) -> Iterator[Check]:
        """While all rows are read at once: gives what to ask every few thousand rows whether to go on.

        What it raises is Timeout or OutOfMemory, whose `partial` is this result without its value: its rows can still
        be had one after the other.
        """
        answer = QueryResult(Rows(()), None, self.engine) if self.answer is None else self.answer
        try:
            yield answer.begin()
        except Stopped as stopped:
            found = replace(answer, make=None, status=stopped.status)
            stopped.partial = replace(self, given_value=None, status=stopped.status, answer=found)
            raise

    def __iter__(self) -> Iterator[NamedRow]:
        """The rows as tuples, whose values are also found by the names of the columns: `row["x"]`, `row.x`."""
        return map(make_row_class(self.columns), get_result_rows(self))

    @overload
    def __getitem__(self, place: int) -> NamedRow: ...
    @overload
    def __getitem__(self, place: slice) -> list[NamedRow]: ...
    def __getitem__(self, place: int | slice) -> NamedRow | list[NamedRow]:
        """The row at a place, or those of a slice; all rows are read once for it."""
        return self._rows_read[place]

    @cached_property
    def _rows_read(self) -> list[NamedRow]:
        return list(self)

    def fetchall(self) -> list[NamedRow]:
        """All rows, as iteration gives them."""
        return list(self)

    def one(self) -> NamedRow:
        """The only row. Raises RepresentationError V001 where there is none, or more than one."""
        if len(self) != 1:
            hint = "LIMIT 1 keeps the first row; result[0] is the first row of many"
            raise RepresentationError("V001", f"one() wants one row, and there are {len(self)}", hints=(hint,))
        return self[0]

    def to_dicts(self) -> list[dict[str, Any]]:
        """The rows as dicts by the names of the columns."""
        return [dict(zip(self.columns, row, strict=True)) for row in get_result_rows(self)]

    @property
    def types(self) -> tuple[str, ...]:
        """What the script promises of each of `columns`: `int`, `none or str`, `list of float`, `any`."""
        return tuple(format_type(kind, bounds=False) for kind in self.promised_types)

    @property
    def promised_types(self) -> tuple[Type, ...]:
        """The same as types of the plan."""
        if self.answer is None:
            return (ANY,)
        own = self.answer.rows.columns
        numbers = [INT] * (len(self.columns) - len(own))  # the path and the step, of a search
        return (*numbers, *(self.answer.types.get(name) or ANY for name in own))

    def __len__(self) -> int:
        if self.answer is None:
            return 1
        rows = self.answer.rows
        return len(rows.rows or ()) if rows.paths is None else sum(measure_path_lengths(rows.paths))

    def explain(self) -> Explanation:
        """What became of the script, and what the run has done: a text, whose `as_dict()` gives the same as data.

        Engines and why, rewrites, functions with the number of their calls, SQLite's plan in words, the SQL with the
        values that were bound, the time of each stage, the levels of a search.
        """
        from ss2sql.results.explain.collector import explain_run  # it knows compiled scripts, which know results

        return explain_run(self.outline, self)

    @property
    def trace(self) -> Result:
        """The search as data, of a run with `trace=`: a result with one row per event, in their order.

        `n` is the number of a step, `parent` that of the one before it on its path; the start is 0 and has none. The
        `event` is "generated": the step enters the frontier; "expanded": it leaves it, and its own steps come next;
        "repeated": its row or key was reached already; "stopped": the path ends with it; "goal": its path is a result.
        `state` are the START WITH variables that it reaches and `row` what SELECT shows, as dicts, each None where the
        search has not made it; `g` is the cost or the probability so far, `h` the estimate. Raises RepresentationError
        V001 where the run was not traced.
        """
        from ss2sql.results.watching.search_trace import get_trace

        traced = get_trace(self, "trace")
        status: Status = "complete" if traced.is_whole else "maximum"
        rows = Rows(traced.columns, list(traced.events))
        value = [event._asdict() for event in traced.events]
        answer = QueryResult(rows, lambda check: copy_for_python(value), self.engine, status)
        return Result(None, self.engine, status, self.stats, answer)

    # --- what it can become ----------------------------------------------------------------------------

    def show(self, max_rows: int = 20, console: Console | None = None) -> None:
        """Prints at most `max_rows` rows as a table, or so many paths of a search.

        Below it says how many there are, and the `notes`. Every row is one line, at most 120 characters wide; what is
        too long ends with `...` or `…`. A path is a line, its steps joined by arrows, unless all steps fit only as rows
        of their own.
        """
        from rich.console import Console

        check_run_limit("max_rows", max_rows, 0)
        if console is not None and not isinstance(console, Console):
            hint = "give a rich.console.Console, or leave it out"
            raise SessionError("S002", f"a console is no {type(console).__name__}", hints=(hint,))
        from ss2sql.results import show

        show.print_result(self, max_rows, console or Console())

    def __repr__(self) -> str:
        from ss2sql.results import show

        return show.format_result_text(self)

    def _repr_html_(self) -> str:
        from ss2sql.results import show

        return show.format_html(self)

    def df(self) -> Any:
        """The rows as a pandas DataFrame with the columns of `columns`.

        Whole numbers are int64, beside None Int64; bools are bool and boolean. None is NaN among floats and in text.
        Whole numbers with floats are float64, unless they are beyond 2^53. All else is of dtype object: lists, dicts,
        objects, and columns with values of several kinds. Where all values are None, or there are no rows, the dtype
        is what the script promises of the column. Raises SessionError S003 without pandas.
        """
        from ss2sql.results import frames

        return frames.to_pandas(self)

    def pl(self) -> Any:
        """The rows as a Polars DataFrame; None is null, lists are List, dicts Struct, with null for a missing key.

        Objects, and columns with values of several kinds, are of Polars' type Object. Raises SessionError S003 without
        Polars.
        """
        from ss2sql.results import frames

        return frames.to_polars(self)

    def arrow(self) -> Any:
        """The rows as a table of pyarrow, with the types of `pl`.

        Raises RepresentationError V001 for a column of objects or with values of several kinds, SessionError S003
        without pyarrow.
        """
        from ss2sql.results import frames

        return frames.to_arrow(self)

    def __arrow_c_stream__(self, requested_schema: object = None) -> Any:
        """The rows for libraries that take Arrow data from any object."""
        return self.arrow().__arrow_c_stream__(requested_schema)

    def csv(self, path: str | Path | None = None) -> str | None:
        """The rows as CSV, with a line of names, written to a file or given as text.

        None is an empty field; lists, dicts, bools and dates are written as in JSON.
        """
        from ss2sql.results import frames

        return frames.write_or_return(frames.format_csv(self), path)

    def json(self, path: str | Path | None = None) -> str | None:
        """The value as JSON, written to a file or given as text.

        Sets and arrays are lists, dates are as in ISO 8601, other objects their repr.
        """
        from ss2sql.results import frames

        return frames.write_or_return(frames.format_json(self.value), path)

    def parquet(self, path: str | Path) -> None:
        """Writes the rows to a Parquet file. Raises what `arrow` raises."""
        from ss2sql.results import frames

        frames.write_parquet(self, path)

    def graph(self) -> Any:
        """The paths of a search as a networkx.DiGraph: rows are nodes, an edge leads from a step to the next one.

        A node is the value of the row where that has one column, else the tuple of its values: lists as tuples, an
        object without a hash as something with one that shows the same text and equals itself alone. It has the
        attributes `row`, the row itself, `step`, the least number of a step with this row, `start` and `goal`: whether
        a path begins or ends there. An edge has `step`, the least number of the step that it leads to, and `paths`: how
        often paths take it. Raises RepresentationError V001 where there is no search, SessionError S003 without
        networkx.
        """
        from ss2sql.results import graph_plot

        return graph_plot.build_graph(self)

    def animate(self, path: str | Path | None = None, beside: Result | None = None, title: str | None = None) -> Page:
        """The search of a run with `trace=` as a page that plays it in a browser; notebooks show what this gives.

        Args:
            path: the file to write; it is one HTML file that needs no network.
            beside: the result of another traced run, shown beside this one, event for event.
            title: in place of the names of the strategies.

        Raises:
            RepresentationError: V001 where a run was not traced.
            SessionError: S002 for a file that cannot be written.
        """
        from ss2sql.results.watching.animation import make_watching_page, write_page

        page = make_watching_page([self] if beside is None else [self, beside], title)
        if path is not None:
            write_page(page, path)
        return page

    def plot(self, ax: Any = None, kind: str = "auto", most: int | None = None, title: str | None = None) -> Any:
        """Draws the result with matplotlib.

        Args:
            ax: the Axes to draw on; without it a new figure. On Axes in space, paths in space are drawn as such.
            kind: "auto" chooses. Of a search: "paths" over a plane, or over a map that the Axes show, "graph" of its
                rows by step, "tree" of its paths, "lengths", a count of paths; of a run with `trace=` "search": the
                tree of its steps, or the map of their places, numbered in the order of expansion. Of an array of two
                dimensions, as AS plane gives it: "heat". Of other rows: "bars" for a label and a number, "line",
                "points", over time where a column has times, and each group of GROUP BY by itself.
            most: how many paths, bars or steps are drawn; else 1000 paths, 40 bars, a graph of up to 150 rows, a tree
                of 60 steps.
            title: in place of what was counted.

        Returns:
            The Axes.

        Raises:
            RepresentationError: V001 where there is nothing that could be drawn like this.
            SessionError: S003 without matplotlib, or networkx for a graph.
        """
        from ss2sql.results.plots import plot_result  # it imports NumPy at once

        check_run_limit("most", most, 1)
        if ax is not None and not hasattr(ax, "scatter"):
            raise SessionError("S002", f"Axes are no {type(ax).__name__}", hints=("give what plt.subplots() gives",))
        return plot_result(self, ax, kind, most, title)
