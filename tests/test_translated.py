"""Queries in the SQL of other databases: DuckDB gives the same rows in their order; what would differ is refused."""

from __future__ import annotations

from collections import Counter

import pytest
from adapters import ArrayWorld
from agreement import exact
from click.testing import CliRunner
from hypothesis import given, seed
from hypothesis import strategies as st
from programs.drawn import amount, drawn
from second_opinion import DECISIONS, Twin, twin
from sqlglot import exp
from sqlglot.errors import TokenError
from sqlglot.generator import Generator
from test_second_opinion import compared

import ss2sql
from ss2sql.cli import main
from ss2sql.lowering.dialects import DIALECTS, DUCKDB
from ss2sql.runtime.translated import translated

duckdb = pytest.importorskip("duckdb")
COUNT = amount(3 / 10)


def in_dialect(script: str, dialect: str, **variables: object) -> str:
    with ss2sql.connect() as ss:
        for name, value in variables.items():
            ss.set(name, value)
        return str(translated(ss.compile(script).statements(), DIALECTS[dialect]))


def test_duckdb_gives_the_same_rows() -> None:
    tried: Counter[str] = Counter()

    @seed(31)
    @drawn(COUNT)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(twin))
    def run(made: Twin) -> None:
        with ss2sql.connect() as ss:
            for name, rows in made.case.tables.items():
                ss.set(name, rows)
            try:
                text = str(translated(ss.compile(made.case.script).statements(), DUCKDB))
            except ss2sql.UnsupportedError:
                tried["refused"] += 1
                return
            wanted = compared(exact(tuple(row)) for row in ss.run(made.case.script).value)
        assert compared(map(exact, connection.execute(text).fetchall())) == wanted
        tried["written"] += 1

    with duckdb.connect() as connection:
        run()
    assert tried["written"] > COUNT // 4


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


@pytest.mark.parametrize("written", [one for one in EXPRESSIONS.replace("\n", "; ").split("; ") if one])
def test_an_expression_means_the_same(written: str) -> None:
    script = f"SELECT {written.replace(', ', ';') if written.startswith('IF') else written} {FROM} AS rows;"
    with ss2sql.connect() as ss, duckdb.connect() as connection:
        found = connection.execute(in_dialect(script, "duckdb")).fetchall()
        assert [exact(tuple(row)) for row in found] == [exact(tuple(row)) for row in ss.run(script).value]


@pytest.mark.parametrize(
    ("dialect", "empty"), [("duckdb", "CAST([] AS TEXT[])"), ("postgres", "CAST(ARRAY[] AS TEXT[])")]
)
def test_a_list_without_elements_has_a_type(dialect: str, empty: str) -> None:
    assert empty in in_dialect("SELECT [[], ['a']] FROM [1] AS list;", dialect)


def test_membership_in_a_list_that_is_written() -> None:
    assert "this.this IN (1, 2)" in in_dialect("SELECT this IN [1, 2] FROM [1, 3] AS list;", "duckdb")


@pytest.mark.parametrize(
    ("written", "reason"),
    [
        ("min(n.this, x.this)", "the kind of this value is not known"),
        ("[] + l.this", "the kind of this value is not known"),
        ("l.this OR b.this", "the truth of such a value is not the same"),
        ("t.this == n.this", "eq of such values"),
        ("l.this < [1, 2]", "lt of such values"),
        ("n.this not in []", "not_in of such values"),
        ("x.this in [0.5, 1]", "in of such values"),
        ("x.this in l.this", "in of such values"),
        ("min(x.this, 2.5)", "min of such values"),
        ("(n.this - 3) % 4611686018427387905", "mod of such values"),
        ("t.this[-1:2]", "slice of such values"),
        ("x.this % 2", "mod of such values"),
        ("x.this ^ 2", "pow of such values"),
        ("n.this ^ n.this", "pow of such values"),
        ("abs(b.this)", "abs of such values"),
        ("-b.this", "neg of such values"),
        ("b.this / 2", "div of such values"),
        ("len(n.this)", "this may fail"),
        ("l.this[-1]", "item of such values"),
        ("None in l.this", "in of such values"),
        ("round(x.this)", "round is not known to other databases"),
    ],
)
def test_an_expression_that_could_mean_something_else(written: str, reason: str) -> None:
    with pytest.raises(ss2sql.UnsupportedError, match=reason):
        in_dialect(f"SELECT {written} {FROM} AS rows;", "duckdb")


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("SELECT a FROM people", "the rows of people have no order but that of SQLite"),
        ("SELECT p FROM p = people ORDER BY p.a", "have no type for it"),
        ("SELECT * FROM people ORDER BY a", "have no type for it"),
        ("SELECT this FROM range(2000)", "this list is not known"),
        ("SELECT this FROM many", "only lists of up to 1,000 elements"),
        ("SELECT p FROM p = rows", "have no type for it"),
        ("SELECT count(*) FROM [1] GROUP BY this HAVING count(*)", "the truth of such a value"),
        ("SELECT x FROM scene", "worlds are read by Python"),
    ],
)
def test_a_query_that_could_mean_something_else(script: str, reason: str) -> None:
    with ss2sql.connect() as ss:
        ss.attach("scene", ArrayWorld())
        ss.host.connection.execute("CREATE TABLE people(a INTEGER)")
        ss.set("many", list(range(2000)))
        ss.set("rows", [{"a": 1}, {"a": 2}])
        with pytest.raises(ss2sql.UnsupportedError, match=reason):
            translated(ss.compile(script).statements(), DUCKDB)


def test_a_query_in_from() -> None:
    script = """
        SELECT q.kind, n.this
        FROM q = (SELECT kind, to(count(*), many) FROM people GROUP BY kind), n = (SELECT 7 FROM [1, 2] AS list)
        WHERE many > 1 AS rows
    """
    with ss2sql.connect() as ss:
        ss.set("people", [{"kind": "b"}, {"kind": "a"}, {"kind": "b"}, {"kind": "a"}, {"kind": "c"}])
        wanted = ss.run(script).value
        text = str(translated(ss.compile(script).statements(), DUCKDB))
    with duckdb.connect() as connection:
        assert connection.execute(text).fetchall() == wanted == [("b", 7), ("b", 7), ("a", 7), ("a", 7)]


@pytest.mark.parametrize("empty", ["range(0)", "[1, 2][1:1]"])
def test_a_list_without_elements(empty: str) -> None:
    with duckdb.connect() as connection:
        shown = connection.execute(in_dialect(f"SELECT this + 1 FROM {empty} AS list;", "duckdb"))
        assert [kind for _, kind, *_ in shown.description] == ["BIGINT"]
        assert shown.fetchall() == []


def test_a_table_keeps_its_name() -> None:
    with ss2sql.connect() as ss:
        ss.host.connection.execute(
            "CREATE TABLE people(id INTEGER PRIMARY KEY, name TEXT NOT NULL, age INT NOT NULL) STRICT"
        )
        ss.host.connection.execute("INSERT INTO people VALUES (1, 'Ann', 31)")
        statements = ss.compile("SELECT name FROM people WHERE age > 30 AND name != '' AS list;").statements()
        text = str(translated(statements, DIALECTS["postgres"]))
    assert " ".join(text.split()) == (
        "SELECT people.name AS name FROM people WHERE people.age > 30 AND people.name <> ''"
        " ORDER BY people.id ASC NULLS FIRST;"
    )


def test_groups_of_a_table_without_an_order() -> None:
    """The rows of one group need none; groups have that of their first rows."""
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE sales(kind TEXT NOT NULL, price INT NOT NULL) STRICT")
        ss.host.connection.execute("INSERT INTO sales VALUES ('tea', 4), ('cake', 3), ('tea', 5)")

        def shown(script: str) -> str:
            return " ".join(str(translated(ss.compile(script).statements(), DIALECTS["postgres"])).split())

        with pytest.raises(ss2sql.UnsupportedError, match="the rows of sales have no order") as caught:
            shown("SELECT kind, max(price) FROM sales GROUP BY kind AS rows")
        assert caught.value.hints == ("give the table a primary key, or sort the rows",)
        assert "ORDER BY" in shown("SELECT kind, max(price) FROM sales GROUP BY kind ORDER BY kind AS rows")
        assert shown("SELECT m.max FROM m = (SELECT max(price) FROM sales GROUP BY 1) WHERE m.max > 1 AS list") == (
            "SELECT m.max AS max FROM ( SELECT MAX(sales.price) AS max FROM sales"
            " GROUP BY CAST(1 AS BIGINT) ) AS m WHERE m.max > 1;"
        )


def test_what_is_no_query_is_a_comment() -> None:
    text = in_dialect("n = 3; SELECT this + n FROM [1] AS list;", "duckdb")
    assert text.startswith("-- no query: n = 3\n\nSELECT\n  this.this + 3 AS")


def test_a_search_becomes_statements_of_a_level() -> None:
    script = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 4"
    assert "ANTI JOIN steps" in in_dialect(script, "duckdb")


@pytest.mark.parametrize(
    ("script", "reason", "column"),
    [
        ("SELECT n FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n", "nothing runs them in postgres", 1),
        ("SELECT str(this) FROM [1]", "str is not known to other databases", 8),
        ("SELECT this FROM [1, 'a']", "the kind of this is not known", 18),
        ("SELECT this / (this - 1) FROM [1, 2]", "this may fail", 13),
        ("SELECT x.this FROM x = [1], y = [2] GROUP BY y.this", "GROUP BY that makes parts is no SQL", 46),
        ("SELECT this FROM (SELECT n FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = 1)", "a search in FROM", 18),
        ("SELECT this FROM (SELECT this, 1 FROM [1] AS rows)", "the elements of this query are no rows", 18),
        ("SELECT this FROM (SELECT this FROM [1] LIMIT 0 AS list)", "LIMIT of a query in FROM is a number above 0", 46),
        ("SELECT count(*) FROM a = [1], b = [2] GROUP BY a.this", "groups of several sources have no order in SQL", 48),
        ("SELECT a.this FROM a = [[1]], b = a.this", "what stands in FROM depends on another source", 31),
        ("SELECT sum([this, 1]) FROM [1]", "sum is not known to other databases", 8),
        ("SELECT average(this) FROM [1] GROUP BY 1", "average of such values is not the same everywhere", 8),
    ],
)
def test_what_is_refused(script: str, reason: str, column: int) -> None:
    with ss2sql.connect() as ss:
        statements = ss.compile(script).statements()
        with pytest.raises(ss2sql.UnsupportedError) as caught:
            translated(statements, DIALECTS["postgres"])
    assert reason in caught.value.message
    assert caught.value.hints
    assert caught.value.span is not None
    assert caught.value.span.column == column


def test_a_list_that_is_not_known_before_is_refused() -> None:
    with ss2sql.connect() as ss:
        ss.function("f", lambda: 1, volatility="volatile")
        statements = ss.compile("known = [f(), 2]; SELECT this FROM known").statements()
        with pytest.raises(ss2sql.UnsupportedError, match="is not known"):
            translated(statements, DIALECTS["postgres"])


@pytest.mark.parametrize(
    ("dialect", "division"), [("duckdb", "CAST(p.p AS DOUBLE) / 2"), ("postgres", "DOUBLE PRECISION) / 2")]
)
def test_the_command(dialect: str, division: str) -> None:
    done = CliRunner().invoke(main, ["sql", "--dialect", dialect, "-e", "SELECT this / 2 FROM p = [1, 2] AS list;"])
    assert done.exit_code == 0
    assert division in done.output


def test_the_command_names_what_it_refuses() -> None:
    done = CliRunner().invoke(main, ["sql", "--dialect", "postgres", "-e", "SELECT str(this) FROM [1];"])
    assert done.exit_code == 1
    assert "error[U001]: str is not known to other databases" in done.stderr


@pytest.mark.parametrize("cause", [None, RecursionError("too deep"), ValueError("no type")])
def test_what_sqlglot_cannot_read_while_it_prints(cause: Exception | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only a lack of room on the stack is told apart, so that more is made for the same statement."""

    def failing(*_: object) -> str:
        raise TokenError("unreadable") from cause

    monkeypatch.setattr(Generator, "generate", failing)
    wanted = RecursionError if isinstance(cause, RecursionError) else TokenError
    with pytest.raises(wanted):
        DUCKDB.print(exp.select("1"))
