"""Queries in the SQL of other databases: DuckDB gives the same rows in their order; what would differ is refused."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from adapters import ArrayWorld
from agreement import exact
from click.testing import CliRunner
from sessions import wrong_scripts
from sqlglot import exp
from sqlglot.errors import TokenError
from sqlglot.generator import Generator

import ss2sql
from ss2sql.cli import main, script_commands
from ss2sql.lowering.sql_builder import DIALECTS, DUCKDB
from ss2sql.session.compiled_script import translate_script

duckdb = pytest.importorskip("duckdb")


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        session.attach("scene", ArrayWorld())
        session.host.connection.execute(
            "CREATE TABLE people(id INTEGER PRIMARY KEY, name TEXT NOT NULL, age INT NOT NULL) STRICT;"
            "INSERT INTO people VALUES (1, 'Ann', 31);"
            "CREATE TABLE sales(kind TEXT NOT NULL, price INT NOT NULL) STRICT; CREATE TABLE loose(a INTEGER);"
            "CREATE TABLE single(a INT NOT NULL UNIQUE) STRICT;"
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


FROM = "FROM n = [1, 2, 5], x = [0.5, -1.5], t = ['ab', 'c'], b = [True, False], l = [[1, 2], [3, 1]]"
SCRIPTS = [
    f"SELECT n.this + 1, IF(b.this; x.this; None), l.this[0], t.this[0:1] {FROM} WHERE NOT b.this XOR n.this AS rows",
    f"SELECT IF(n.this > 1; None; n.this) == n.this, IF(b.this; None; x.this) != x.this {FROM} AS rows",
    f"SELECT IF(n.this > 1; None; n.this) AND b.this, IF(n.this > 1; None; b.this) OR b.this {FROM} AS rows",
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


@pytest.mark.parametrize(("code", "words", "marked"), [*wrong_scripts("dialects")])
def test_what_is_refused(ss: ss2sql.Session, code: str, words: list[str], marked: str) -> None:
    before, *there = marked.split("«")
    script = marked.replace("FROM samples", FROM).replace("«", "").replace("»", "")
    with pytest.raises(ss2sql.UnsupportedError, match=code) as caught:
        in_dialect(ss, script, "postgres" if there else "duckdb")
    assert words[0] in caught.value.message
    assert caught.value.hints
    assert caught.value.span is not None
    assert not there or caught.value.span.start == len(before)


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


def test_the_command_knows_the_dialects() -> None:
    """It has their names by itself, since sqlglot takes long to load."""
    assert tuple(DIALECTS) == script_commands.DIALECTS
