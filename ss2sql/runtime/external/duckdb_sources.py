"""Tables and views of a connection of DuckDB by their names, and Parquet files, as data frames.

The types are read from the data, as those of tables of SQLite are.

What one run reads of them is of one state of the database: all of it happens in one transaction of a cursor. A name
means what the catalogue of DuckDB has under it, never a file, a function or a variable of Python.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import sqlglot
from sqlglot import exp

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import INT_MAX, INT_MIN, MAX_FLOAT, Kind, Type, widen_number_type
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.portable_expressions import write_cast
from ss2sql.lowering.portable.pushdown import ExternalTable, choose_sql_number_column, quote_sql_identifier
from ss2sql.lowering.sql_builder import DUCKDB
from ss2sql.runtime.run.run_state import Run
from ss2sql.vtables.frames import Column as FrameColumn
from ss2sql.vtables.frames import Frame
from ss2sql.vtables.frames.array_columns import convert_frame_cell

if TYPE_CHECKING:
    import duckdb


T = TypeVar("T")
_INTEGERS = ("TINYINT", "SMALLINT", "INTEGER", "UTINYINT", "USMALLINT", "UINTEGER")
_LARGE = ("UBIGINT", "HUGEINT", "UHUGEINT")
_TIMES = ("DATE", "TIME", "TIMESTAMP")
# Times as texts in ISO 8601, by the type; `{0}` stands for the column. Years before 1 and after 9999 look otherwise.
_SQL_FORMS = {
    "DATE": "CAST({0} AS VARCHAR)",
    "TIMESTAMP": """
        CASE
          WHEN MICROSECOND({0}) % 1000000 = 0 THEN STRFTIME({0}, '%Y-%m-%dT%H:%M:%S')
          ELSE STRFTIME({0}, '%Y-%m-%dT%H:%M:%S.%f')
        END
    """,
}
_IN_RANGE = "MIN({0}) >= '0001-01-01' AND MAX({0}) < '9999-12-31'"
# What Arrow gives as something else: a time without its zone, bits and large numbers as bytes.
_UNSUPPORTED = ("TIME WITH TIME ZONE", "BIT", "BIGNUM", "VARINT")
_DECIMAL = re.compile(r"DECIMAL\((\d+),(\d+)\)\Z")
_EXACT_DIGITS = 15  # of a decimal: dividing by a power of ten then rounds once


@dataclass(frozen=True, slots=True)
class DuckColumn:
    """A column of a table of DuckDB, by its name and its type there."""

    name: str
    kind: str

    @property
    def plain(self) -> exp.Column:
        return exp.Column(this=quote_sql_identifier(self.name))

    @property
    def decimals(self) -> tuple[int, int] | None:
        """Digits of a decimal, and how many of them stand after the point."""
        match = _DECIMAL.match(self.kind)
        return None if match is None else (int(match[1]), int(match[2]))

    @property
    def holds(self) -> Kind | None:
        """The kind of its values; None where that shows in the values alone."""
        if self.strange:
            return None
        if self.kind in (*_INTEGERS, "BIGINT", *_LARGE):
            return Kind.INT
        if self.decimals is not None:
            return Kind.FLOAT if self.decimals[1] else Kind.INT
        if self.kind in ("DOUBLE", "FLOAT"):
            return Kind.FLOAT
        if self.kind == "VARCHAR" or self.kind.startswith(("ENUM(", *_TIMES)):
            return Kind.STR if "[" not in self.kind else None
        return Kind.BOOL if self.kind == "BOOLEAN" else None

    @property
    def strange(self) -> bool:
        """Whether the language has no values for it."""
        return self.kind in _UNSUPPORTED

    @property
    def has_nan(self) -> bool:
        return self.kind in ("DOUBLE", "FLOAT")

    def write_questions(self) -> Iterator[exp.Expr]:
        """What is computed over all rows: how many have a value, the ends of numbers, how many are no numbers."""
        if self.holds is None:
            return
        yield exp.Count(this=self.plain)
        if self.kind in _SQL_FORMS:
            yield self._parse_expression(_IN_RANGE)
        if self.holds in Kind.INT | Kind.FLOAT:
            ends: list[exp.Expr] = [exp.Min(this=self.plain), exp.Max(this=self.plain)]
            if self.has_nan:
                number = exp.Where(this=exp.Not(this=exp.IsNan(this=self.plain)))
                yield exp.CountIf(this=exp.IsNan(this=self.plain))
                ends = [exp.Filter(this=end, expression=number.copy()) for end in ends]
            yield from ends

    @property
    def _limits(self) -> tuple[float, float]:
        """Between these are the numbers of the language."""
        return (INT_MIN, INT_MAX) if self.holds is Kind.INT else (-MAX_FLOAT, MAX_FLOAT)

    def interpret_answers(self, rows: int, answers: Iterator[Any], reading: DuckTransaction) -> ColumnFacts:
        """What the answers say of the column in a table of so many rows."""
        kind = self.holds
        if kind is None:
            return ColumnFacts(Type(), None)
        present = next(answers)
        nan = (next(answers) or 0) if self.has_nan else 0
        missing = Kind.NONE if present - nan < rows else Kind(0)
        if kind is Kind.STR:
            usual = self.kind not in _SQL_FORMS or next(answers) is not False
            return ColumnFacts(Type(kind | missing), self._write_text(reading.collated) if usual else None)
        if kind is Kind.BOOL:
            return ColumnFacts(Type(kind | missing, 0, 1), self.plain)
        low, high = (convert_frame_cell(next(answers)) for _ in range(2))
        if low is None:
            return ColumnFacts(Type(kind | missing), self._write_number(nan))
        least, greatest = self._limits
        if not least <= low <= high <= greatest:
            return ColumnFacts(Type(), None, refused=True)
        return ColumnFacts(widen_number_type(kind | missing, low, high), self._write_number(nan))

    def _write_text(self, collated: bool) -> exp.Expr | None:
        if self.kind.startswith(_TIMES):
            return self._parse_expression(_SQL_FORMS[self.kind]) if self.kind in _SQL_FORMS else None
        text = self.plain if self.kind == "VARCHAR" else write_cast(self.plain, "VARCHAR")
        return exp.Collate(this=text, expression=exp.Var(this="C")) if collated else text

    def _parse_expression(self, text: str) -> exp.Expr:
        tree = sqlglot.parse_one(text.format("placeholder"), read="duckdb")
        for column in tree.find_all(exp.Column):
            column.set("this", quote_sql_identifier(self.name))
        return tree

    def _write_number(self, nan: int) -> exp.Expr | None:
        if self.decimals is not None and self.decimals[1] and self.decimals[0] > _EXACT_DIGITS:
            return None
        wide = "BIGINT" if self.holds is Kind.INT else "DOUBLE"
        number = self.plain if self.kind == wide else write_cast(self.plain, wide)
        if not nan:
            return number
        return exp.Anonymous(this="NULLIF", expressions=[number, write_cast(exp.Literal.string("NaN"), "DOUBLE")])


@dataclass(frozen=True, slots=True)
class ColumnFacts:
    """What is known of a column: its type, its values as SQL, and whether a value is none of the language."""

    type: Type
    sql: exp.Expr | None
    refused: bool = False


_FIND_TABLE = """
    SELECT database_name, schema_name, name, is_table AND type = 'duckdb'
    FROM (
      SELECT database_name, schema_name, table_name AS name, internal, temporary, TRUE AS is_table FROM duckdb_tables()
      UNION ALL
      SELECT database_name, schema_name, view_name, internal, temporary, FALSE FROM duckdb_views()
    ) AS known
    JOIN (SELECT database_name, type FROM duckdb_databases()) AS databases USING (database_name)
    WHERE NOT internal AND NOT temporary
      AND ($schema::VARCHAR IS NULL AND database_name = current_database() AND schema_name = current_schema()
        OR schema_name = $schema AND database_name = current_database()
        OR database_name = $schema AND schema_name = 'main')
"""
# Whether columns may compare their texts in a way of their own.
_COLLATED = """
    SELECT EXISTS (SELECT 1 FROM duckdb_tables() WHERE sql ILIKE '%collate%')
      OR EXISTS (SELECT 1 FROM duckdb_views() WHERE NOT internal AND sql ILIKE '%collate%')
"""
# Whether the connection does so with all texts, or sorts None in another way than DuckDB does by itself.
_STRANGE = """
    SELECT current_setting('default_collation') <> ''
      OR lower(current_setting('default_null_order')) NOT IN ('nulls_last', 'last')
"""


PREFIX = "duckdb."  # of the variables as which tables are read; a script has none with a dot


class DuckTransaction:
    """A cursor of its own on a connection, in a transaction, which ends with the run.

    In a `strange` connection SQL means something else than by itself. What DuckDB raises, one of `errors`, becomes
    ExecutionError X009.
    """

    def __init__(
        self, make_cursor: Callable[[], duckdb.DuckDBPyConnection], errors: tuple[type[Exception], ...]
    ) -> None:
        self.errors = errors
        with self.convert_errors():
            self.cursor = make_cursor()
            self.cursor.begin()

    @contextmanager
    def convert_errors(self) -> Iterator[None]:
        try:
            yield
        except self.errors as error:
            raise ExecutionError("X009", f"duckdb: {error}") from error

    @cached_property
    def collated(self) -> bool:
        """Whether texts may compare in a way of their own."""
        return self._fetch_flag(_COLLATED)

    @cached_property
    def strange(self) -> bool:
        return self._fetch_flag(_STRANGE)

    def _fetch_flag(self, text: str) -> bool:
        ((flag,),) = self.fetch_rows(text)
        return bool(flag)

    def fetch_rows(self, text: str, values: Any = None) -> list[tuple[Any, ...]]:
        with self.convert_errors():
            return self.cursor.execute(text, values).fetchall()

    def fetch_arrow(self, text: str) -> Any:
        with self.convert_errors():
            return self.cursor.sql(text).to_arrow_table()


class DuckFrame(Frame):
    """A table of DuckDB as a data frame, which `reading` reads: a column when it is first needed.

    `outside` is how the table is written in SQL, `strange` has the types of columns without values of the language.
    """

    __slots__ = ("outside", "read_column", "reader", "reading", "strange")

    def __init__(
        self,
        reader: DuckTableReader,
        reading: DuckTransaction,
        outside: ExternalTable,
        strange: dict[str, str],
        types: dict[str, Type],
        length: int,
    ) -> None:
        self.reader, self.reading, self.outside, self.strange = reader, reading, outside, strange
        self.read_column = read = partial(reader.read_column, reading, outside, strange, [])
        super().__init__({name: FrameColumn(kind, partial(read, name)) for name, kind in types.items()}, length)

    def restrict_rows(self, outside: ExternalTable) -> DuckFrame:
        """The table with some of its rows, which `outside` chooses."""
        count = exp.Select(expressions=[exp.Count(this=exp.Star())]).from_(outside.item.copy())
        ((rows,),) = self.reading.fetch_rows(DUCKDB.print_tree(count))
        types = {name: column.type for name, column in self.columns.items()}
        return DuckFrame(self.reader, self.reading, outside, self.strange, types, rows)


class DuckSources:
    """What scripts can read of a connection, of which `cursor` gives new ones. `errors` are those of DuckDB.

    `begun` are the runs of the session, the innermost last.
    """

    def __init__(
        self,
        cursor: Callable[[], duckdb.DuckDBPyConnection],
        errors: tuple[type[Exception], ...],
        active_runs: Sequence[Run],
    ) -> None:
        self.cursor, self.errors, self.active_runs = cursor, errors, active_runs
        self.read_columns: dict[str, set[str] | None] = {}  # of each table, by its SQL; None: all

    def read_once(self, key: Hashable, read: Callable[[], T], run: Run | None = None) -> T:
        """What was read in a run under this key, which is read once; outside of runs anew."""
        run = run or (self.active_runs[-1] if self.active_runs else None)
        if run is None:
            return read()
        if (self, key) not in run.readings:
            run.readings[self, key] = read()
        return run.readings[self, key]  # type: ignore[no-any-return]

    def open_transaction(self, run: Run | None = None) -> DuckTransaction:
        """The transaction of a run; of none a new one. Raises ExecutionError X009 where the connection is closed."""
        run = run or (self.active_runs[-1] if self.active_runs else None)

        def begin() -> DuckTransaction:
            made = DuckTransaction(self.cursor, self.errors)
            if run is not None:
                run.cleanups.append(made.cursor.close)
            return made

        return self.read_once("transaction", begin, run)

    def find_variable(self, name: str) -> str | None:
        """As what variable the table or view `name`, or `schema.name`, is read; None if there is none."""
        return PREFIX + name if self._find_in_catalogue(name) else None

    def find_reader(self, variable: str) -> DuckTableReader | None:
        """What reads the table of such a variable, if there is one."""
        if not variable.startswith(PREFIX):
            return None
        name = variable.removeprefix(PREFIX)
        found = self._find_in_catalogue(name)
        if not found:
            return None
        database, home, exact, has_rowid = found[0]
        item = exp.Table(
            this=quote_sql_identifier(exact), db=quote_sql_identifier(home), catalog=quote_sql_identifier(database)
        )
        return DuckTableReader(self, name, item, "rowid" if has_rowid else None)

    def list_names(self) -> list[str]:
        """The names of all tables and views that need no schema before them."""
        found = self.open_transaction().fetch_rows(_FIND_TABLE, {"schema": None})
        return [name for _, _, name, _ in found]

    def note_read_columns(self, table: str) -> set[str] | None:
        """The columns of a table that scripts have read so far, or may read now; None where that is any of them."""
        noted = self.read_columns.setdefault(table, set())
        more = self.active_runs[-1].reads() if self.active_runs else frozenset()
        self.read_columns[table] = None if noted is None or more is None else noted | more
        return self.read_columns[table]

    def describe_table(self, name: str) -> tuple[tuple[str, Type], ...]:
        """The columns of a table or view; nothing where there is none or it cannot be read."""
        reader = self.find_reader(PREFIX + name)
        try:
            frame = None if reader is None else reader(every_column=True)
        except ExecutionError:
            return ()
        return () if frame is None else tuple((word, column.type) for word, column in frame.columns.items())

    def make_parquet_reader(self, path: Path, name: str) -> Callable[[], Frame]:
        """What reads a Parquet file. Raises SessionError S002 where it cannot be read."""
        hint = "give the path of one Parquet file; of several a view of DuckDB makes one table"
        if not path.is_file() or set("*?[") & set(str(path)):
            raise SessionError("S002", f"{path} is not a Parquet file that can be read", hints=(hint,))
        arguments = [exp.Literal.string(str(path)), exp.EQ(this=exp.column("file_row_number"), expression=exp.true())]
        item = exp.Table(this=exp.Anonymous(this="read_parquet", expressions=arguments))
        reader = DuckTableReader(self, name, item, "file_row_number", path)
        try:
            reader.describe_columns(DuckTransaction(self.cursor, self.errors))
        except ExecutionError as error:
            message = f"{path} is not a Parquet file that can be read: {error.message}"
            raise SessionError("S002", message, hints=(hint,)) from error
        return reader

    def _find_in_catalogue(self, name: str) -> list[tuple[Any, ...]]:
        """Where the catalogue has the table; queried once in a run."""
        schema, _, table = name.rpartition(".")
        values = {"schema": schema or None, "name": table}
        text = f"{_FIND_TABLE} AND name = $name"
        return self.read_once(("name", name), lambda: self.open_transaction().fetch_rows(text, values))


@dataclass(slots=True)
class TableFacts:
    """What is known of a table: its columns, the number of its rows, and facts of those columns that were read."""

    columns: list[DuckColumn]
    rows: int | None = None
    facts: dict[str, ColumnFacts] = field(default_factory=dict)


class DuckTableReader:
    """Reads one table as it stands, once in a run; a `file` keeps its facts as long as it is the same.

    Facts are found of columns that scripts read: to find those of 80 columns of a million rows takes seconds.
    """

    def __init__(
        self, sources: DuckSources, name: str, item: exp.Table, number: str | None, file: Path | None = None
    ) -> None:
        self.sources, self.name, self.item, self.number, self.file = sources, name, item, number, file
        self.sql = DUCKDB.print_tree(item)
        self.known: TableFacts | None = None
        self.state: tuple[int, ...] | None = None  # of the file

    def __call__(self, every_column: bool = False) -> Frame:
        wanted = None if every_column else self.sources.note_read_columns(self.sql)
        key = (self.sql, None if wanted is None else frozenset(wanted))
        return self.sources.read_once(key, lambda: self._read_frame(self.sources.open_transaction(), wanted))

    def describe_columns(self, reading: DuckTransaction) -> list[DuckColumn]:
        described = reading.fetch_rows(f"DESCRIBE SELECT * FROM {DUCKDB.print_tree(self.item)}")
        return [DuckColumn(name, k) for name, k, *_ in described if name != "file_row_number" or self.number != name]

    def _find_facts(self, reading: DuckTransaction, wanted: set[str] | None) -> TableFacts:
        """What is known of the table and of the wanted columns, which DuckDB computes where it is not known yet."""
        state = None
        if self.file is not None:
            stat = self.file.stat()
            state = stat.st_mtime_ns, stat.st_size, stat.st_ino
        if self.known is None or state is None or state != self.state:
            self.known, self.state = TableFacts(self.describe_columns(reading)), state
        table = self.known
        missing = [c for c in table.columns if (wanted is None or c.name in wanted) and c.name not in table.facts]
        if table.rows is None or missing:
            questions = [question for column in missing for question in column.write_questions()]
            select = exp.Select(expressions=[exp.Count(this=exp.Star()), *questions]).from_(self.item.copy())
            ((table.rows, *found),) = reading.fetch_rows(DUCKDB.print_tree(select))
            answers = iter(found)
            table.facts |= {c.name: c.interpret_answers(table.rows, answers, reading) for c in missing}
        return table

    def _read_frame(self, reading: DuckTransaction, wanted: set[str] | None) -> Frame:
        table = self._find_facts(reading, wanted)
        columns, rows = table.columns, table.rows
        assert rows is not None
        seen = {column.name: table.facts.get(column.name, ColumnFacts(Type(), None)) for column in columns}
        outside = self._make_external_table(seen)
        strange = {column.name: column.kind for column in columns if column.strange}
        frame = DuckFrame(self, reading, outside, strange, {name: known.type for name, known in seen.items()}, rows)
        for name, known in seen.items():
            if known.refused:
                frame.read_column(name)  # raises, with the row's number
        return frame

    def read_column(
        self, reading: DuckTransaction, outside: ExternalTable, strange: dict[str, str], whole: list[Any], name: str
    ) -> list[Any]:
        """The values of a column. Raises ExecutionError X004 for what is none of the language.

        Where rows have no fixed order all columns are read at once, and kept in `whole`.
        """
        from ss2sql.vtables.frames.arrow import convert_arrow_column

        place = f"the column '{name}' of '{self.name}'"
        if name in strange:
            hint = "make texts or numbers of them in a view of DuckDB"
            raise ExecutionError("X004", f"{place} holds values of the type {strange[name]}", hints=(hint,))
        if self.number is None and not whole:
            whole.append(_fetch_columns(reading, outside, [name for name in outside.columns if name not in strange]))
        array = _fetch_columns(reading, outside, [name]) if self.number is not None else whole[0]
        return convert_arrow_column(array.column(name), place).values

    def _make_external_table(self, seen: dict[str, ColumnFacts]) -> ExternalTable:
        columns = {name: known.sql for name, known in seen.items()}
        shape = (self.sql, tuple((name, repr(column)) for name, column in columns.items()))
        if self.number is not None and self.number not in {name.lower() for name in columns}:
            return ExternalTable(self.item, self.number, columns, shape)
        number = choose_sql_number_column(columns)
        row = exp.Alias(this=sql_builder.row_number(()), alias=quote_sql_identifier(number))
        numbered = exp.Select(expressions=[exp.Star(), row]).from_(self.item.copy())
        return ExternalTable(exp.Subquery(this=numbered), number, columns, shape)


def _fetch_columns(reading: DuckTransaction, outside: ExternalTable, names: Sequence[str]) -> Any:
    columns = [exp.Column(this=quote_sql_identifier(name)) for name in names]
    select = exp.Select(expressions=columns).from_(outside.item.copy())
    ordered = select.order_by(exp.Column(this=quote_sql_identifier(outside.number)))
    return reading.fetch_arrow(DUCKDB.print_tree(ordered))
