"""Queries in the SQL of other databases: DuckDB gives the same rows in their order; what would differ is refused."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from adapters import ArrayWorld
from agreement import exact
from click.testing import CliRunner
from sqlglot import exp
from sqlglot.errors import TokenError
from sqlglot.generator import Generator

import ss2sql
from ss2sql.cli import main
from ss2sql.lowering.sql_builder import DIALECTS, DUCKDB
from ss2sql.session.translation import translate_script

duckdb = pytest.importorskip("duckdb")


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        session.attach("scene", ArrayWorld())
        session.host.connection.execute(
            "CREATE TABLE people(id INTEGER PRIMARY KEY, name TEXT NOT NULL, age INT NOT NULL) STRICT;"
            "INSERT INTO people VALUES (1, 'Ann', 31);"
            "CREATE TABLE sales(kind TEXT NOT NULL, price INT NOT NULL) STRICT; CREATE TABLE loose(a INTEGER);"
            "CREATE TABLE pairs(a TEXT, b TEXT COLLATE NOCASE, PRIMARY KEY(a, b)) STRICT, WITHOUT ROWID"
        )
        session.set("many", list(range(2000)))
        session.set("rows", [{"kind": kind} for kind in "babac"])
        session.function("f", lambda: 1, volatility="volatile")
        yield session


def in_dialect(ss: ss2sql.Session, script: str, dialect: str = "duckdb") -> str:
    return str(translate_script(ss.compile(script).statements(), DIALECTS[dialect]))


def in_line(ss: ss2sql.Session, script: str) -> str:
    """The SQL of Postgres in one line."""
    return " ".join(in_dialect(ss, script, "postgres").split())


EXPRESSIONS = """t.this + t.this; l.this + [9]; n.this + x.this; n.this / 2; x.this / 2; (n.this - 3) % 3; n.this % 3
n.this % -2; n.this ^ 2; n.this ^ 1; -n.this; -x.this; -(-x.this); abs(x.this); abs(-n.this); sqrt(n.this)
min(n.this, 3); max(t.this, 'b'); max([n.this]); n.this * 0.5; n.this - 1 - x.this; 1.5e300 * 10
n.this == None; None != t.this; x.this == None; n.this < x.this; n.this == 1.0; t.this == 'ab'; b.this == True
l.this == [1, 2]; 'a' in t.this; 'z' not in t.this; n.this in [1, 2]; n.this in l.this; x.this in [1, 2]
len(t.this); len(l.this); l.this[0]; [n.this, 2]; [[], ['a']]; this; None; b.this
t.this[0:1]; t.this[n.this + 1:7]; t.this[n.this:3]; t.this[n.this:n.this + 1]; t.this[1:n.this]
b.this AND n.this; b.this OR x.this; NOT t.this; b.this XOR n.this; IF(b.this, n.this, 0)
IF(n.this > 1, None, n.this) == n.this; IF(n.this > 1, None, n.this) AND b.this; IF(b.this, None, t.this) OR b.this
IF(n.this > 1, None, b.this) OR b.this; IF(b.this, None, x.this) != x.this"""
FROM = "FROM n = [1, 2, 5], x = [0.5, -1.5], t = ['ab', 'c'], b = [True, False], l = [[1, 2], [3, 1]]"


WRITTEN = [one for one in EXPRESSIONS.replace("\n", "; ").split("; ") if one]
SCRIPTS = [
    *(f"SELECT {one.replace(', ', ';') if one.startswith('IF') else one} {FROM} AS rows" for one in WRITTEN),
    "SELECT q.kind, n.this FROM q = (SELECT kind, to(count(*), many) FROM rows GROUP BY kind),"
    " n = (SELECT 7 FROM [1, 2] AS list) WHERE many > 1 AS rows",
    "SELECT this + 1 FROM range(0) AS rows",
    "SELECT this + 1 FROM [1, 2][1:1] AS rows",
]


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_query_means_the_same(ss: ss2sql.Session, script: str) -> None:
    with duckdb.connect() as connection:
        found = connection.execute(in_dialect(ss, script))
        assert "BIGINT" in {str(kind) for _, kind, *_ in found.description} or "+ 1 FROM" not in script
        assert [exact(tuple(row)) for row in found.fetchall()] == [exact(tuple(row)) for row in ss.run(script).value]


@pytest.mark.parametrize(
    ("dialect", "script", "text"),
    [
        ("duckdb", "SELECT [[], ['a']] FROM [1] AS list", "CAST([] AS TEXT[])"),
        ("postgres", "SELECT [[], ['a']] FROM [1] AS list", "CAST(ARRAY[] AS TEXT[])"),
        ("duckdb", "SELECT this IN [1, 2] FROM [1, 3] AS list", "this.this IN (1, 2)"),
        ("duckdb", "n = 3; SELECT this + n FROM [1] AS list", "-- no query: n = 3\n\nSELECT\n  this.this + 3 AS"),
        # A search becomes statements of a level.
        ("duckdb", "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 4",
         "ANTI JOIN steps"),
    ],
)  # fmt: skip
def test_what_is_written(ss: ss2sql.Session, dialect: str, script: str, text: str) -> None:
    assert text in in_dialect(ss, script, dialect)


def test_a_table_keeps_its_name(ss: ss2sql.Session) -> None:
    assert in_line(ss, "SELECT name FROM people WHERE age > 30 AND name != '' AS list") == (
        "SELECT people.name AS name FROM people WHERE people.age > 30 AND people.name <> ''"
        " ORDER BY people.id ASC NULLS FIRST;"
    )


def test_groups_of_a_table_without_an_order(ss: ss2sql.Session) -> None:
    """The rows of one group need none; groups have that of their first rows."""
    ss.host.connection.execute("INSERT INTO sales VALUES ('tea', 4), ('cake', 3), ('tea', 5)")
    with pytest.raises(ss2sql.UnsupportedError, match="the rows of sales have no order") as caught:
        in_line(ss, "SELECT kind, max(price) FROM sales GROUP BY kind AS rows")
    assert caught.value.hints == ("give the table a primary key, or sort the rows",)
    assert "ORDER BY" in in_line(ss, "SELECT kind, max(price) FROM sales GROUP BY kind ORDER BY kind AS rows")
    assert "ORDER BY" not in in_line(ss, "SELECT count(*) FROM a = [1], b = [2] AS list")
    assert in_line(ss, "SELECT m.max FROM m = (SELECT max(price) FROM sales GROUP BY 1) WHERE m.max > 1 AS list") == (
        "SELECT m.max AS max FROM ( SELECT MAX(sales.price) AS max FROM sales"
        " GROUP BY CAST(1 AS BIGINT) ) AS m WHERE m.max > 1;"
    )


# What could mean something else: expressions with the reason, and whole scripts with the place of the error.
EXPRESSIONS_REFUSED = [
    ("min(n.this, x.this)", "the kind of this value is not known"),
    ("[] + l.this", "the kind of this value is not known"),
    ("l.this OR b.this", "the truth of such a value is not the same"), ("t.this == n.this", "eq of such values"),
    ("l.this < [1, 2]", "lt of such values"), ("n.this not in []", "not_in of such values"),
    ("x.this in [0.5, 1]", "in of such values"), ("x.this in l.this", "in of such values"),
    ("None in l.this", "in of such values"), ("n.this in (SELECT this FROM [1] AS list)", "a query inside"),
    ("min(x.this, 2.5)", "min of such values"),
    ("(n.this - 3) % 4611686018427387905", "mod of such values"), ("x.this % 2", "mod of such values"),
    ("t.this[-1:2]", "slice of such values"), ("x.this ^ 2", "pow of such values"),
    ("n.this ^ n.this", "pow of such values"), ("abs(b.this)", "abs of such values"),
    ("-b.this", "neg of such values"), ("b.this / 2", "div of such values"), ("len(n.this)", "this may fail"),
    ("IF(b.this; 1 / (n.this - 1), 2; 3)", "what stands before the last value of a branch may fail"),
    ("l.this[-1]", "item of such values"), ("round(x.this)", "round is not known to other databases"),
]  # fmt: skip
REFUSED = [
    *((f"SELECT {written} {FROM} AS rows", reason, None) for written, reason in EXPRESSIONS_REFUSED),
    ("SELECT a FROM loose", "the rows of loose have no order but that of SQLite", None),
    ("SELECT a FROM pairs", "the rows of pairs have no order but that of SQLite", None),
    ("SELECT p FROM p = loose ORDER BY p.a", "have no type for it", None),
    ("SELECT * FROM loose ORDER BY a", "have no type for it", None),
    ("SELECT this FROM range(2000)", "this list is not known", None),
    ("SELECT this FROM many", "only lists of up to 1,000 elements", None),
    ("SELECT p FROM p = rows", "have no type for it", None),
    ("SELECT count(*) FROM [1] GROUP BY this HAVING count(*)", "the truth of such a value", None),
    ("SELECT x FROM scene", "worlds are read by Python", None),
    ("known = [f(), 2]; SELECT this FROM known", "is not known", None),
    ("SELECT n FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n", "nothing runs them in postgres", 1),
    ("SELECT round(this) FROM [1]", "round is not known to other databases", 8),
    ("SELECT this FROM [1, 'a']", "the kind of this is not known", 18),
    ("SELECT this / (this - 1) FROM [1, 2]", "this may fail", 13),
    ("SELECT x.this FROM x = [1], y = [2] GROUP BY y.this", "GROUP BY that makes parts is no SQL", 46),
    ("SELECT this FROM (SELECT n FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = 1)", "a search in FROM", 18),
    ("SELECT this FROM (SELECT this, 1 FROM [1] AS rows)", "the elements of this query are no rows", 18),
    ("SELECT this FROM (SELECT this FROM [1] LIMIT 0 AS list)", "LIMIT of an inner query is a number above 0", 46),
    ("SELECT count(*) FROM a = [1], b = [2] GROUP BY a.this", "groups of several sources have no order in SQL", 48),
    ("SELECT a.this FROM a = [[1]], b = a.this", "what stands in FROM depends on another source", 31),
    ("SELECT sum([this, 1]) FROM [1]", "sum is not known to other databases", 8),
    ("SELECT average(this) FROM [1.5] GROUP BY 1", "average of such values is not the same everywhere", 8),
]


@pytest.mark.parametrize(("script", "reason", "column"), REFUSED)
def test_what_is_refused(ss: ss2sql.Session, script: str, reason: str, column: int | None) -> None:
    with pytest.raises(ss2sql.UnsupportedError) as caught:
        in_dialect(ss, script, "postgres" if column else "duckdb")
    assert reason in caught.value.message
    assert caught.value.hints
    assert caught.value.span is not None
    assert column in (None, caught.value.span.column)


@pytest.mark.parametrize(
    ("dialect", "division"), [("duckdb", "CAST(p.p AS DOUBLE) / 2"), ("postgres", "DOUBLE PRECISION) / 2")]
)
def test_the_command(dialect: str, division: str) -> None:
    done = CliRunner().invoke(main, ["sql", "--dialect", dialect, "-e", "SELECT this / 2 FROM p = [1, 2] AS list;"])
    assert done.exit_code == 0
    assert division in done.output


def test_the_command_names_what_it_refuses() -> None:
    done = CliRunner().invoke(main, ["sql", "--dialect", "postgres", "-e", "SELECT round(this) FROM [1];"])
    assert done.exit_code == 1
    assert "error[U001]: round is not known to other databases" in done.stderr


@pytest.mark.parametrize("cause", [None, RecursionError("too deep"), ValueError("no type")])
def test_what_sqlglot_cannot_read_while_it_prints(cause: Exception | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only a lack of room on the stack is told apart, so that more is made for the same statement."""

    def failing(*_: object) -> str:
        raise TokenError("unreadable") from cause

    monkeypatch.setattr(Generator, "generate", failing)
    wanted = RecursionError if isinstance(cause, RecursionError) else TokenError
    with pytest.raises(wanted):
        DUCKDB.print_tree(exp.select("1"))
