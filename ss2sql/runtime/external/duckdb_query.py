"""DuckDB for queries that are no search: whole queries there, and tables of DuckDB for queries that run elsewhere.

A query in DuckDB has functions of Python and elements of values as tables. For one that runs elsewhere a table gives
those rows alone that WHERE can keep: values of other rows never reach Python. WHERE stays as it is, so a table with too
many rows is no harm.

Sums and averages of floats are DuckDB's own FSUM and FAVG, which compensate for what they round. A macro around them
ends the query where the language has another value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from inspect import Parameter, Signature
from itertools import chain, count
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, ExecutionError, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import read_column
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import can_fail, is_volatile, list_sources, split_and, walk
from ss2sql.language.rows import Row, Rows, iterate_limited_rows, make_unique_name
from ss2sql.lowering.portable.portable_expressions import build_refusal, get_sql_column_type
from ss2sql.lowering.portable.portable_flat import NUMBER_COLUMN
from ss2sql.lowering.portable.pushdown import (
    LIMIT_PARAMETER,
    LISTED_AGGREGATES,
    SUMMED_AGGREGATES,
    ExternalTable,
    LoadedTable,
    PushdownQuery,
    lower_table_pushdown,
    write_pushdown,
)
from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.lowering.sql_builder import DUCKDB
from ss2sql.runtime.external.duckdb_sources import DuckFrame, DuckSources, DuckTransaction
from ss2sql.runtime.external.table_statements import build_batch, interrupt_when_due
from ss2sql.runtime.python.native_query import compile_statement
from ss2sql.runtime.run.run_state import Run, check_count_value
from ss2sql.vtables.frames import Frame, list_source_elements

if TYPE_CHECKING:
    import duckdb


_numbers = count(1)

TOO_LARGE = "a sum of floats becomes too large on its way"
SUM_OF_NOTHING = "a sum of nothing is a whole number among floats"


def _write_float_aggregate(function: str, nothing: str) -> str:
    """The macro of an aggregate of floats; `nothing` stands for its value of no values."""
    return f"""
        CASE
          WHEN COUNT(x) = 0 THEN {nothing}
          WHEN ISFINITE({function}(x)) THEN {function}(x)
          ELSE ERROR('{TOO_LARGE}')
        END
    """


MACROS = {
    SUMMED_AGGREGATES["sum"]: _write_float_aggregate("FSUM", f"ERROR('{SUM_OF_NOTHING}')"),
    SUMMED_AGGREGATES["average"]: _write_float_aggregate("FAVG", "NULL"),
}
LISTED = {function: GROUPS[name].value for name, function in LISTED_AGGREGATES.items()}


def create_function(
    cursor: duckdb.DuckDBPyConnection, name: str, function: Callable[..., Any], kinds: list[str], result: str
) -> str:
    """Makes a Python function known to a cursor by a macro, which calls it under a name that nobody else has.

    All connections of a database share their functions: two transactions cannot make one of the same name at once.

    Args:
        cursor: the connection.
        name: the macro, which statements call.
        function: takes values of these `kinds`, types of DuckDB, and gives one of the type `result`.

    Returns:
        the other name of the function.
    """
    shared = f"{name}_of_run_{next(_numbers)}"  # names of macros end in a number, too
    cursor.create_function(shared, function, kinds, result, null_handling="special")  # type: ignore[call-overload]
    names = ", ".join(f"x{n}" for n in range(len(kinds)))
    cursor.execute(f"CREATE TEMPORARY MACRO {name}({names}) AS {shared}({names})")
    return shared


def _wrap_listed(function: str, failed: list[str]) -> Callable[[list[float] | None], float | None]:
    compute = LISTED[function]

    def compute_listed(values: list[float] | None) -> float | None:
        try:
            return None if values is None else compute(values)
        except ExecutionError:
            failed.append("an aggregate of floats becomes too large on its way")
            return None

    return compute_listed


# --- a query that is no search, in DuckDB, with functions of Python and elements of values as tables
def register_in_duckdb(
    cursor: duckdb.DuckDBPyConnection, functions: Mapping[str, plan.Call | None], run: Run, failed: list[str]
) -> dict[str, str]:
    """Makes the functions known to a cursor; gives those of Python with their other names.

    `failed` gets why their values are no good.
    """
    made = {}
    for name, call in functions.items():
        if name in MACROS:
            cursor.execute(f"CREATE TEMPORARY MACRO {name}(x) AS {MACROS[name]}")
        elif call is None:
            made[name] = create_function(cursor, name, _wrap_listed(name, failed), ["DOUBLE[]"], "DOUBLE")
        else:
            result, *kinds = (str(get_sql_column_type(part.type)) for part in (call, *call.arguments))
            made[name] = create_function(cursor, name, _wrap_duckdb_function(call, run, failed), kinds, result)
    return made


def _wrap_duckdb_function(call: plan.Call, run: Run, failed: list[str]) -> Callable[..., Any]:
    """The built-in function, which fails where its value becomes larger than one may be."""
    function = run.host.get_callable(call.function, run)

    def call_function(*values: Any) -> Any:
        try:
            return None if failed else function(*values)
        except Exception as error:
            failed.append(getattr(error, "message", str(error)))
            return None

    # DuckDB looks how many arguments there are
    parameters = [Parameter(f"_{n}", Parameter.POSITIONAL_ONLY) for n in range(len(call.arguments))]
    call_function.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return call_function


# --- the elements of values as tables for DuckDB
def collect_duckdb_columns(table: LoadedTable, value: Any) -> list[Sequence[Any]]:
    """The numbers of the elements of a value, and what is read of them, by columns."""
    if isinstance(value, Frame):
        return [range(value.length), *(value.columns[key].values for key in table.columns if key is not None)]
    rows = list_source_elements(value)
    found = (rows if key is None else [read_column(row, key, None) for row in rows] for key in table.columns)
    return [range(len(rows)), *found]


def build_duckdb_table(table: LoadedTable, columns: list[Sequence[Any]]) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped]

    typed = [TypedColumn(name, get_sql_column_type(kind) or "") for name, kind in table.columns.values()]
    return pa.Table.from_batches([build_batch([TypedColumn(NUMBER_COLUMN, "BIGINT"), *typed], columns)])


ROWS_PER_BLOCK = 10_000  # rows that are read at once


class DuckQuery:
    """A query to be run many times. Raises UnsupportedError where it could mean something else in DuckDB.

    `variable` gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """

    engine = "duckdb"

    def __init__(self, query: plan.Query, sources: DuckSources, variable: Callable[[str], Any]) -> None:
        self.query, self.sources = query, sources
        self._known: dict[tuple[Any, ...], tuple[PushdownQuery, str]] = {}
        self.written, self.text = self._write_query(variable)

    @property
    def parameters(self) -> dict[str, str]:
        """What is bound in the text, as the script has it."""
        limit = self.query.limit
        own = {} if limit is None or isinstance(limit, plan.Constant) else {LIMIT_PARAMETER: limit.span.text}
        return {**self.written.parameters, **own}

    # --- what is run ---------------------------------------------------------------------------------------

    @cached_property
    def _has_lists(self) -> bool:
        sources = (node for node in walk(self.query) if isinstance(node, plan.QuerySource))
        return any(source.query.representation.name == "list" for source in sources)

    @cached_property
    def _value_sources(self) -> list[plan.ValueSource]:
        """The values in FROM, also in that of queries in FROM."""
        return [node for node in walk(self.query) if isinstance(node, plan.ValueSource)]

    @cached_property
    def _joins_values(self) -> bool:
        """Whether texts or lists are put together."""
        joined = Kind.STR | Kind.LIST
        calls = (node for node in walk(self.query) if isinstance(node, plan.Call))
        return any(call.function.name == "add" and call.type.may_be(joined) for call in calls)

    def _write_query(self, variable: Callable[[str], Any]) -> tuple[PushdownQuery, str]:
        """The query over the tables that its sources are now, and its text."""
        frames = {source.id: find_duck_frame(source, variable) for source in self._value_sources}
        found = {source: None if frame is None else frame.outside for source, frame in frames.items()}
        key = tuple(None if table is None else table.shape for table in found.values())
        if key not in self._known:
            written = write_pushdown(self.query, lambda source: found[source.id])
            self._known = {key: (written, DUCKDB.print_tree(written.select))}
        return self._known[key]

    # --- running it ----------------------------------------------------------------------------------------

    def compute_rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The rows of the query, see `NativeQuery.compute_rows`. Raises UnsupportedError where only a run can tell."""
        sink = sink or Rows(tuple(output.name for output in self.query.columns), [])
        assert sink.rows is not None
        found = chain.from_iterable(self._read_blocks(run, _fetch_blocks))
        sink.rows.extend(found if run.max_rows is None else iterate_limited_rows(found, run.max_rows))
        for value in chain.from_iterable(sink.rows) if self._joins_values else ():
            run.sizes.check_value(value)
        return sink

    def fetch_table(self, run: Run) -> Any:
        """The rows of a query without LIMIT as an Arrow table; raises what `compute_rows` raises."""
        (table,) = self._read_blocks(run, lambda *statement: [_fetch_table(*statement)])
        return table

    def _read_blocks(self, run: Run, fetch: Callable[..., Iterable[Any]]) -> Iterator[Any]:
        """What `fetch(cursor, text, values)` gives of the statement."""
        limit = self._evaluate_limit(run)
        if limit == 0:
            return  # nothing of the query is evaluated
        reading = self.sources.open_transaction(run)
        if reading.strange:
            reason = "settings of the connection say how texts compare, or where None is sorted"
            cure = "RESET default_collation and default_null_order"
            raise build_refusal(reason, self.query.span, cure)
        if run.max_rows is not None and self._has_lists:
            reason = "max_rows counts the elements of the list that a query in FROM gives"
            raise build_refusal(reason, self.query.span, "leave max_rows away, or the form of the query in FROM")
        self.written, self.text = self._write_query(run.get_source)  # a table may not be what it was
        loaded = [(table, self._read_columns(table, run)) for table in self.written.loaded]
        values = {
            name: limit if name == LIMIT_PARAMETER else run.get_variable(wanted)
            for name, wanted in self.parameters.items()
        }
        run.bound[self] = values
        with reading.convert_errors(), interrupt_when_due(run, reading.cursor.interrupt):
            yield from self._run_statement(reading, loaded, values, run, fetch)

    def _evaluate_limit(self, run: Run) -> int | None:
        limit = self.query.limit
        if limit is None:
            return None
        try:
            return check_count_value(compile_statement(limit)(run), 0, "LIMIT")
        except ExecutionError as error:
            raise error.with_span(limit.span) from None

    def _read_columns(self, table: LoadedTable, run: Run) -> list[Sequence[Any]]:
        try:
            return collect_duckdb_columns(table, compile_statement(table.value)(run))
        except Error as error:
            raise error.with_span(table.value.span) from None

    def _run_statement(
        self,
        reading: DuckTransaction,
        loaded: list[tuple[LoadedTable, list[Sequence[Any]]]],
        values: Mapping[str, Any],
        run: Run,
        fetch: Callable[..., Iterable[Any]],
    ) -> Iterator[Any]:
        cursor, failed = reading.cursor, list[str]()
        for table, columns in loaded:
            cursor.register(table.name, build_duckdb_table(table, columns))
        made = register_in_duckdb(cursor, self.written.functions, run, failed)
        try:
            for block in fetch(cursor, self.text, dict(values) or None):
                if not failed:
                    yield block
                run.check()
        except reading.errors as error:
            failed += [reason for reason in (TOO_LARGE, SUM_OF_NOTHING) if reason in str(error)]
            if not failed:
                raise
            raise build_refusal(failed[0], self.query.span) from None
        for table, _ in loaded:  # where anything fails, they go with the transaction
            cursor.unregister(table.name)
        for name in self.written.functions:
            cursor.execute(f"DROP MACRO {name}")
        for shared in made.values():
            cursor.remove_function(shared)
        if failed:
            raise build_refusal(failed[0], self.query.span)


def _fetch_blocks(cursor: duckdb.DuckDBPyConnection, text: str, values: dict[str, Any] | None) -> Iterator[list[Row]]:
    cursor.execute(text, values)
    while block := cursor.fetchmany(ROWS_PER_BLOCK):
        yield block


def _fetch_table(cursor: duckdb.DuckDBPyConnection, text: str, values: dict[str, Any] | None) -> Any:
    return cursor.sql(text, params=values).to_arrow_table()


def fetch_duckdb_rows(sources: DuckSources, query: plan.Query, run: Run) -> Any:
    """The rows of a query over tables of DuckDB as an Arrow table; None where Python has to read its sources."""
    values = [node for node in walk(query) if isinstance(node, plan.ValueSource)]
    if not any(find_duck_frame(source, run.get_source) for source in values):
        return None
    try:
        return DuckQuery(query, sources, run.get_source).fetch_table(run)
    except UnsupportedError:
        return None


def find_duck_frame(source: plan.ValueSource, variable: Callable[[str], Any]) -> DuckFrame | None:
    """The table of DuckDB that a source is, if it is one."""
    value = source.value
    if not isinstance(value, plan.Variable) or not value.frame:
        return None
    try:
        frame = variable(value.name)
    except (KeyError, Error):
        return None
    return frame if isinstance(frame, DuckFrame) else None


# --- tables of DuckDB for queries that run elsewhere: with those rows alone that WHERE can keep
@dataclass(frozen=True, slots=True)
class PredicatePushdown:
    """A source of a query, and the parts of WHERE that speak of it alone and come before what may fail."""

    source: plan.ValueSource
    conditions: tuple[plan.Expr, ...]

    def read_table(self, run: Run) -> Any:
        """The source as it is now, with the rows that are kept; the whole of it where it is no table any more."""
        assert isinstance(self.source.value, plan.Variable)
        frame = find_duck_frame(self.source, run.get_source)
        kept = None if frame is None else self.filter_frame(frame, run.get_source)
        if frame is None or kept is None:
            return run.get_source(self.source.value.name)
        with interrupt_when_due(run, frame.reading.cursor.interrupt):
            return frame.restrict_rows(kept)

    def filter_frame(self, frame: DuckFrame, variable: Callable[[str], Any]) -> ExternalTable | None:
        """The rows of the table that are kept; None where DuckDB cannot tell which."""
        if frame.reading.strange:  # texts may compare in another way
            return None
        try:
            return lower_table_pushdown(frame.outside, self.source, self.conditions, variable)
        except UnsupportedError:
            return None


def push_down_predicates(
    query: plan.Query, variable: Callable[[str], Any]
) -> tuple[plan.Query, dict[str, PredicatePushdown]]:
    """The query over variables of their own instead of the tables that DuckDB can narrow, and what these are.

    Args:
        query: a query that DuckDB does not run.
        variable: gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """
    found: dict[str, PredicatePushdown] = {}
    if query.search is not None or query.where is None or any(map(_can_source_fail, query.sources)):
        return query, {}
    if is_volatile(query):  # where something is assigned, conditions may be others for the next row
        return query, {}
    safe = _find_pushed_conditions(query.where)
    sources = []
    for source in query.sources:
        if isinstance(source, plan.ValueSource):
            known = _find_pushdown(safe, source, variable)
            if known is not None:
                name = make_unique_name(f"{source.name}.kept", found)  # no script has a variable with a dot
                found[name] = known
                source = replace(source, value=plan.Variable(name, source.value.type, frame=True, span=source.span))
        sources.append(source)
    return replace(query, sources=tuple(sources)), found


def _can_source_fail(source: plan.Source) -> bool:
    """Whether opening a source may raise, or asks for a row of another one: it is opened for all rows before it."""
    known = isinstance(source, plan.ValueSource) and isinstance(source.value, (plan.Variable, plan.Constant))
    return not (known or isinstance(source, plan.TableSource))


def _find_pushed_conditions(where: plan.Expr | None) -> list[plan.Expr]:
    """The parts of WHERE before what may fail or calls a Python function: rows that they do not keep are not missed."""
    found: list[plan.Expr] = []
    for part in split_and(where):
        if can_fail(part) or any(isinstance(node, plan.Call) and not node.function.builtin for node in walk(part)):
            break
        found.append(part)
    return found


def _find_pushdown(
    safe: Iterable[plan.Expr], source: plan.ValueSource, variable: Callable[[str], Any]
) -> PredicatePushdown | None:
    """What DuckDB can ask of a source, if it is a table there and there is such a thing."""
    frame = find_duck_frame(source, variable)
    if frame is None:
        return None
    own = (part for part in safe if list_sources(part) == {source.id})
    found = tuple(part for part in own if PredicatePushdown(source, (part,)).filter_frame(frame, variable) is not None)
    return PredicatePushdown(source, found) if found else None
