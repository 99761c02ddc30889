"""What runs in DuckDB and what elsewhere, what limits it, and what no script may do there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from sessions import code_of, wrong_scripts

import ss2sql

pytest.importorskip("duckdb")

# --- what runs where -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("code", "words", "marked"), [*wrong_scripts("duckdb")])
def test_what_duckdb_cannot_do_is_refused(
    ss: ss2sql.Session, own: Any, code: str, words: list[str], marked: str
) -> None:
    own.execute("CREATE TABLE days AS SELECT TIME '12:00:01' AS at")
    ss.host.connection.execute("CREATE TABLE stored(a INTEGER); INSERT INTO stored VALUES (1)")
    ss.set("nothing", [None])
    ss.function("own", lambda n: n, volatility="volatile")
    before, wrong, behind = re.split("[«»]", marked)
    cure = re.escape(words[1] if len(words) > 1 else "engine='native'")
    with pytest.raises(ss2sql.UnsupportedError, match=rf"{code}[\s\S]*{cure}") as caught:
        ss.run(before + wrong + behind, text="5")
    assert caught.value.message.startswith(words[0])
    assert caught.value.span is not None
    assert (caught.value.span.start, caught.value.span.text) == (len(before), wrong)
    assert ss.run(before + wrong + behind, engine="native", text="5").engine == "native"


def test_what_is_no_query_needs_no_engine(ss: ss2sql.Session) -> None:
    assert ss.eval("n = int('5'); [n, 'a']") == [5, "a"]


def test_what_runs_here_is_explained(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    script = "SELECT a FROM t, n = numbers WHERE a < n.this + least AND a != least AND a != nobody LIMIT most"
    result = ss.run("nobody = None; " + script, numbers=[1, 2], least=3, most=5)
    assert result.engine == "duckdb"
    assert result.sql.parameters == {"least": 3, "limit": 5}
    assert "3" not in result.sql
    text = str(result.explain())
    for line in (
        "engine: duckdb: engine='duckdb' was given",
        "$least = 3",
        "$limit = 5, which is most",
    ):
        assert line in text, line
    assert "SELECT" in str(ss.compile("SELECT a FROM t").explain())


def test_max_rows_counts_the_list_of_a_query(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM (SELECT a.this FROM a = range(9), b = range(9) LIMIT 81 AS list) WHERE this == 3 AS list"
    assert ss.run(script).engine == "duckdb"
    with pytest.raises(ss2sql.UnsupportedError, match="max_rows counts the elements of the list"):
        ss.run(script, max_rows=81)


def test_a_session_that_nobody_closes_is_silent_at_the_end() -> None:
    code = """
import duckdb, ss2sql
own = duckdb.connect()
own.execute("CREATE TABLE t AS SELECT 1 AS a")
ss = ss2sql.connect(engine="duckdb", session=own)
query = ss.compile("SELECT a FROM t AS list")
print(query.run().value)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[1]\n", "")


def test_large_texts_are_not_given() -> None:
    with ss2sql.connect(engine="duckdb", max_size=300_000) as ss:
        ss.set("t", ["x" * 200_000])
        assert ss.run("SELECT len(this) FROM t AS list").engine == "duckdb"
        assert code_of(ss.run, "SELECT this + this FROM t AS list") == "X014"


def test_limits_of_a_run(ss: ss2sql.Session) -> None:
    script = "SELECT a.this FROM a = range(5), b = range(5) WHERE a.this < 4 AS list"
    assert code_of(ss.run, script, max_rows=19) == "X010"
    assert len(ss.run(script, max_rows=20).value) == 20
    assert code_of(ss.run, "SELECT this FROM [1, 2] LIMIT n", n=-1) == "X006"
    assert code_of(ss.run, "SELECT this FROM [1, 2] LIMIT 1 / 0") == "X002"
    sources = "a = range(30000), b = range(30000), c = range(30000)"
    long = f"SELECT count(*) FROM {sources} WHERE a.this * b.this < c.this GROUP BY 1"
    assert code_of(ss.run, long, timeout=0.3) == "T001"
    assert ss.eval("SELECT this FROM [1] AS list") == [1]


# --- hostile scripts -------------------------------------------------------------------------------------

SECRET = 42


@pytest.mark.parametrize(
    "source",
    [
        *("SECRET", "secret", "duckdb_settings", "duckdb_tables", "sqlite_master", "pg_catalog.pg_tables"),
        *("information_schema.tables", "main.duckdb_settings", "system.duckdb_settings", "temp.hidden", "hidden"),
        *("duckdb_settings()", "read_csv('secret.csv')", "read_parquet('secret.parquet')", "read_text('secret.csv')"),
        *("glob('*')", "getenv('HOME')", "memory.main.t"),
    ],
)
def test_a_name_means_a_table_or_view_alone(own: Any, tmp_path: Path, monkeypatch: Any, source: str) -> None:
    monkeypatch.chdir(tmp_path)
    secret = own.sql("SELECT 1 AS a")  # what DuckDB would find among the variables of Python
    secret.write_csv("secret.csv")
    secret.write_parquet("secret.parquet")
    own.execute("CREATE TEMP TABLE hidden AS SELECT 1 AS a")
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    with ss2sql.connect(engine="duckdb", session=own) as ss, pytest.raises(ss2sql.Error) as caught:
        ss.run(f"SELECT * FROM {source}")
    assert caught.value.code[0] in "RP"


@pytest.mark.parametrize("text", ["secret.csv", "secret.parquet", "x'; ATTACH 'y.db' AS y; --", "SELECT 1"])
def test_texts_are_elements(ss: ss2sql.Session, tmp_path: Path, monkeypatch: Any, text: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("secret.csv").write_text("a\n1\n")
    assert ss.eval(f"SELECT this FROM [{text!r}] AS list") == [text]
    assert ss.eval("SELECT this FROM t AS list", t=text) == [text]
    if text.startswith("secret"):
        assert code_of(ss.run, f"SELECT * FROM {text!r}") == "R003"
    else:
        assert ss.eval(f"SELECT this FROM {text!r} AS list") == [text]
    assert not Path("y.db").exists()


def test_a_name_of_a_table_may_look_like_sql(ss: ss2sql.Session, own: Any) -> None:
    own.execute('CREATE TABLE t AS SELECT 1 AS "a""; DROP TABLE t; --"')
    assert ss.eval("SELECT * FROM t AS rows") == [(1,)]
    assert own.execute("SELECT count(*) FROM t").fetchall() == [(1,)]


@pytest.mark.parametrize("name", ["getenv", "read_text", "current_setting", "version", "query", "nextval"])
def test_functions_of_duckdb_are_no_functions(ss: ss2sql.Session, name: str) -> None:
    assert code_of(ss.run, f"SELECT {name}('HOME') FROM [1]") == "R002"
