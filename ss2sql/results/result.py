"""The result of a script: its value, the rows or paths that it is made of, and how they were found."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from ss2sql.errors import SessionError, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.search_clauses import FUNCTIONS
from ss2sql.language import plan
from ss2sql.language.cancellation import Check, iterate_with_check
from ss2sql.language.kinds import Type
from ss2sql.language.plan_traversal import (
    find_direct_assignments,
    find_growing_states,
    find_unnamed,
    list_equal_sides,
    list_inside,
    list_sources,
    list_states,
    split_and,
    split_condition,
    split_stop_conditions,
    walk,
    write_in_script,
)
from ss2sql.language.rows import Row, Rows, iterate_checked_paths, make_row_class, make_unique_name
from ss2sql.language.values import copy_for_python, make_hashable
from ss2sql.lowering.sql_query import Sql, SqlQuery, join_sql
from ss2sql.results import copy_result_row, get_result_rows
from ss2sql.runtime.run.option_checks import check_run_limit
from ss2sql.runtime.run.run_state import RemainingBounds, Stats, translate_memory_error
from ss2sql.runtime.run.search_paths import measure_path_lengths

if TYPE_CHECKING:
    from rich.console import Console

    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.results.explain.explanation import Explanation
    from ss2sql.results.watching.animation import Page
    from ss2sql.results.watching.search_trace import SearchTrace
    from ss2sql.runtime.external.duckdb_query import DuckQuery
    from ss2sql.runtime.external.level_query import LevelQuery
    from ss2sql.runtime.external.predicate_pushdown import PredicatePushdown
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy
    from ss2sql.runtime.sqlite.executor import Database


class OutlineOwner(Protocol):
    """The session of a query, as an explanation sees it: rewrites that are off, functions, cached graphs, SQLite."""

    @property
    def disabled(self) -> Collection[str]: ...

    @property
    def functions(self) -> Mapping[str, UserFunction]: ...

    @property
    def database(self) -> Database: ...

    @property
    def graphs(self) -> CachePolicy | None: ...


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


def name_result_columns(own: Sequence[str]) -> tuple[str, ...]:
    """The columns of the result of a search; `own` are those of its rows."""
    names = ["path", "step"]
    for name in own:
        names.append(make_unique_name(name, names))
    return tuple(names)


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

    @cached_property
    def sql(self) -> Sql:
        return join_outlined_sql(self.outline)

    @property
    def columns(self) -> tuple[str, ...]:
        if self.answer is None:
            return ("value",)
        own = self.answer.rows.columns
        return own if self.answer.rows.paths is None else name_result_columns(own)

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

    def __iter__(self) -> Iterator[Row]:
        """The rows as tuples. They know the names of the columns, so that `pandas.DataFrame(result)` has them."""
        return map(make_row_class(self.columns), get_result_rows(self))

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
                "points".
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


# --- what a person should know of a result: why a search may have found too little, and the cure
REPEAT_KEYWORDS = {"unique": "UNIQUE", "no cycle": "NO CYCLE", "memorize": "MEMORIZE"}


def find_notes(query: plan.Query, dropped: bool = False) -> tuple[str, ...]:
    """What can be said of a query, and of those inside of it. `dropped`: it ran, and dropped steps as repeated."""
    searches = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    notes = [note for each in searches for note in _note_undetermined_states(each, dropped)]
    calls = (node.function for each in searches for node in walk(each) if isinstance(node, plan.Call))
    notes += [
        f"{call.name} is the function that was registered under this name; give it another name to ask for the path"
        for call in calls
        if call.name in FUNCTIONS and not call.builtin
    ]
    return tuple(dict.fromkeys(notes))


def explain_empty_result(
    query: plan.Query, rows: Rows, stats: Stats, before: tuple[int, int, int], get_variable: Callable[[str], Any]
) -> Iterator[str]:
    """Why a query has found nothing, where its search may be the reason.

    `before` it ran so many steps had been generated, expanded and pruned.
    """
    search = query.search
    if search is None or rows.rows or rows.paths or rows.groups:
        return
    generated, expanded, pruned = (now - then for now, then in zip(stats.steps, before, strict=True))
    clause, condition = _get_condition_of_first_steps(search)
    read_first = [name for part in condition for _, name in sorted(list_states(part))]
    prior = next((name for name in read_first if name.startswith("prior(")), None)
    if prior is not None and not expanded:
        form = "may have a condition of its own" if clause == "CONNECT BY" else "asks for columns of the first step"
        yield (
            f"in first steps {prior} is None, and nothing was found with it in the condition of {clause}; "
            f"START WITH {form}, for instance START WITH boss == None"
        )
        return
    yield from _note_closed_start(query, get_variable)
    if rows.ended and search.maximum is not None and query.having is not None:
        most, having = write_in_script(search.maximum), write_in_script(query.having)
        cure = _note_larger_bound("MAXIMUM")
        yield f"MAXIMUM {most} ended the search, and HAVING {having} dropped what it had found; {cure}"
    if search.bound is not None and _is_graph_bounded(query, stats):
        cure = _note_larger_bound("MEMORIZE")
        yield f"MEMORIZE {write_in_script(search.bound)} ended paths before any reached its goal; {cure}"
        return
    grown = {(query.id, name) for name in find_growing_states(query)}
    bounds = [("STOP WITH {}", stop) for stop in split_stop_conditions(query)]
    bounds += [("{} in CONNECT BY", part) for part in split_and(search.made)]
    narrow = []
    for place, bound in bounds if generated else ():
        read = {state for state in list_states(bound) if state[0] == query.id}
        if read and read <= grown:
            narrow.append(place.format(write_in_script(bound)))
    for words in narrow:
        yield f"nothing was found before {words} ends a path; a wider bound in it may let paths go on"
    if not (narrow or expanded or pruned):
        yield from _note_ended_first_steps(query, generated)


def has_dropped_steps(query: plan.Query, stats: Stats, pruned: int) -> bool:
    """Whether a search has met rows or keys again; `pruned` steps were dropped before."""
    memorizes = query.search is not None and query.search.repeats == "memorize"
    return stats.pruned > pruned or (memorizes and any(level.repeated for level in stats.levels))


def explain_overestimates(query: plan.Query) -> Iterator[str]:
    """That A* has found a path which costs less than its estimate of what remained."""
    for node in walk(query):
        if isinstance(node, plan.Query) and node.search and node.search.heuristic and node.search.weight:
            estimate = write_in_script(node.search.heuristic)
            yield (
                f"HEURISTIC {estimate} was more than what remained to be paid on a path, so others may be cheaper than "
                "the first that came; the least costs need an estimate that is never too high, or COST alone"
            )


def suggest_timeout_cure(query: plan.Query | None) -> str:
    """What a query lacks that took longer than its timeout: no option that it has already."""
    searches = [(node, node.search) for node in walk(query) if isinstance(node, plan.Query) and node.search]
    if not searches:
        return "raise timeout=, or narrow the query with WHERE or LIMIT"
    owner, search = searches[0]
    grown = sorted(find_growing_states(owner))
    variables = [name for name, _ in search.start if name.isidentifier()]
    if variables and not any(name.isidentifier() for name, _ in search.connect):
        return f"raise timeout=, or let CONNECT BY change the state: {variables[0]} = ..."
    lacks = ["MAXIMUM"] if search.maximum is None else []
    state = next((name for name, _ in search.connect if name.isidentifier()), "")
    lacks += [f"UNIQUE BY {state}" if state else "UNIQUE"] if search.repeats == "allowed" else []
    lacks += ["STOP WITH"] if search.stop is None and search.bound is None else []
    if grown and search.repeats != "allowed" and search.stop is None and search.made is None and search.bound is None:
        return f"raise timeout=, or bound {grown[0]} by a condition in CONNECT BY, such as {grown[0]} < 1000"
    if lacks:
        return f"raise timeout=, or bound the search with {' or '.join(lacks)}"
    if search.order == "cost" and search.heuristic is None:
        return "raise timeout=, or estimate what remains: COST ... HEURISTIC ..."
    return "raise timeout=, or let a condition in CONNECT BY drop steps that cannot lead to a goal"


def _get_condition_of_first_steps(search: plan.Search) -> tuple[str, tuple[plan.Expr, ...]]:
    """The clause that has it, and its parts."""
    return ("CONNECT BY", split_and(search.made)) if search.first is None else ("START WITH", split_and(search.first))


def _note_ended_first_steps(query: plan.Query, generated: int) -> Iterator[str]:
    """That no path goes beyond its first step, because of the start or STOP WITH."""
    search = query.search
    assert search is not None
    if query.offset or query.having or (query.limit and not generated) or search.order == "probability":
        return  # that may be why there is nothing
    if search.each or list_sources(query) - list_inside(query) or any(n != query.id for n, _ in list_states(query)):
        return  # there are several starts, or it runs for each row around it
    values = [f"{name} = {write_in_script(value)}" for name, value in search.start if name.isidentifier()]
    start = f"after START WITH {', '.join(values)} " if values else ""
    parts = _get_condition_of_first_steps(search)[1]
    condition = " AND ".join(map(write_in_script, parts))
    if search.stop is not None and (condition or generated):
        stop = f"STOP WITH {write_in_script(search.stop)}"
        how = f"each first step fails {condition} or {stop} ends it" if condition else f"{stop} ends each first step"
        yield f"{start}{how}, and none is a goal; WHERE True shows the steps that end"
    elif search.stop is None and any(map(list_states, (*parts, *query.sources))):
        what = f"no element meets {condition}" if condition else "FROM has no element"
        yield f"{start}{what}, so no path begins; begin with a value that has first steps"


def _note_closed_start(query: plan.Query, get_variable: Callable[[str], Any]) -> Iterator[str]:
    """That WHERE asks for the state of the start, which counts as visited with a key of the state."""
    search = query.search
    assert search is not None
    if search.by != "state":
        return

    def read_value(expr: plan.Expr) -> Any:
        match expr:
            case plan.Constant(value=value):
                return make_hashable(value)
            case plan.Variable(name=name):
                return make_hashable(get_variable(name))
            case _:
                return expr

    reached, start = find_direct_assignments(query), dict(search.start)
    equal = list_equal_sides(split_condition(query.where, True))
    after = list[plan.Expr]()
    for key in search.key:
        if not isinstance(key, plan.State) or key.name not in reached:
            return
        sides = [other for one, other in equal if one == reached[key.name]]
        if not any(read_value(side) == read_value(start[key.name]) for side in sides):
            return
        after.append(reached[key.name])
    if any(map(list_sources, after)):
        word = REPEAT_KEYWORDS[search.repeats]
        yield (
            f"{word} BY {_join_keys(search.key)} counts the start as visited, and WHERE asks for the start; "
            f"{word} BY {_join_keys(after)} lets a path come back to it"
        )


def _join_keys(keys: Sequence[plan.Expr]) -> str:
    written = ", ".join(map(write_in_script, keys))
    return f"({written})" if len(keys) > 1 else written


def _note_larger_bound(word: str) -> str:
    return f"a larger bound in {word} lets it go on"


def _is_graph_bounded(query: plan.Query, stats: Stats) -> bool:
    """Whether the graph of MEMORIZE could have grown further."""
    inner = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    levels = [*stats.levels, *stats.backward]
    return len(inner) == 1 and bool(levels) and levels[-1].rows > 0


def _note_undetermined_states(query: plan.Query, dropped: bool) -> Iterator[str]:
    """That a search compares rows which do not tell the state that its clauses read."""
    search = query.search
    assert search is not None
    if search.repeats == "allowed" or search.by != "row":
        return
    found = find_unnamed(query)
    counted = find_growing_states(query, evenly=True)
    read = {expr: clauses for expr, clauses in found.items() if not _is_step_count(expr, clauses, counted, search)}
    # Columns of an element often follow from each other, as a name and its key; then hardly a step is dropped.
    if not (read if dropped else any(isinstance(expr, plan.State) for expr in read)):
        return
    word, names = REPEAT_KEYWORDS[search.repeats], _join_note_words(list(dict.fromkeys(map(write_in_script, read))))
    clauses = _join_note_words(list(dict.fromkeys(clause for several in read.values() for clause in several)))
    verb = "read" if " and " in clauses else "reads"
    lengths = all(isinstance(expr, plan.State) and expr.name in counted for expr in read)
    bounded = search.repeats == "memorize" and lengths
    cure = f"let MEMORIZE bound the paths in place of {names}" if bounded else f"name {names} in SELECT"
    yield (
        f"{word} compares rows, and {clauses} {verb} {names}, which SELECT does not name, "
        f"so paths may be missing or end elsewhere; {cure}"
    )


def _is_step_count(expr: plan.Expr, clauses: tuple[str, ...], counted: frozenset[str], search: plan.Search) -> bool:
    """Whether it only counts steps, where a row that comes again later is not worth more.

    So it is on a path with NO CYCLE, and in STOP WITH where UNIQUE reaches each row by the fewest steps.
    """
    if not isinstance(expr, plan.State) or expr.name not in counted:
        return False
    fewest = search.repeats == "unique" and search.order == "breadth first" and "WHERE" not in clauses
    return search.repeats == "no cycle" or fewest


def _join_note_words(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
