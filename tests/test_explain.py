"""`explain`: which engine runs a query and why, what was rewritten, what became of functions, and the SQL."""

from __future__ import annotations

import random

import ss2sql


def inc(n):
    return n + 1


def ratio(a, b):
    return a / b


def noisy(n):
    return n + random.random()


def several(n):
    m = n
    m += 1
    return m


def lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines()]


def test_a_query_of_the_database() -> None:
    ss = ss2sql.connect()
    ss.function(inc)
    ss.attach("items", [1, 2, 3])
    found = ss.compile("x = 1; SELECT inc(this) FROM items WHERE NOT this == 2 AS list;").explain()
    assert lines(found) == [
        "1. x = 1",
        "no query: runs in Python as it is written",
        "2. SELECT inc(this) FROM items WHERE NOT this == 2 AS list",
        "engine: database",
        "rewrites: inline, split",
        "inc(n) is inlined: n + 1",
        "inc is immutable: it has a source that uses only its arguments",
        "SQL:",
        "SELECT",
        "items.this + 1 AS inc",
        "FROM elements(:items) AS items",
        "WHERE",
        "items.this <> 2",
    ]


def test_why_a_query_runs_natively() -> None:
    ss = ss2sql.connect()
    script = "SELECT n FROM [1, 2] WHERE (n = this) > 1 AS list;"
    found = lines(ss.compile(script).explain())
    assert found[1] == "engine: native: the query assigns a script variable, so it runs natively"
    assert "SQL:" not in found
    assert lines(ss.run("SELECT 1 FROM [1];", engine="native").explain())[1] == (
        "engine: native: engine='native' was asked for"
    )


def test_why_a_function_is_called() -> None:
    ss = ss2sql.connect()
    for function in (inc, ratio, noisy, several):
        ss.function(function)
    ss.function("kept", inc, volatility="stable")
    script = "SELECT inc(this), ratio(1, this), noisy(1), several(this), kept(this) FROM [None, 1] AS list;"
    found = lines(ss.compile(script).explain())
    assert [line for line in found if "is called" in line] == [
        "inc is called: 'add' can fail on none or int 1..1 and int 1..1",
        "ratio is called: 'div' can fail on int 1..1 and none or int 1..1",
        "noisy is called: it is volatile",
        "several is called: it is more than one expression",
        "kept is called: it is stable",
    ]
    assert "kept is stable: declared" in found
    assert any(line.startswith("noisy is volatile: it calls random.random") for line in found)


def test_what_is_switched_off_or_replaced() -> None:
    off = ss2sql.connect(disable=["inline"])
    off.function(inc)
    script = "SELECT inc(this) FROM [1] AS list;"
    assert "inc is called: the rewrite inline is switched off" in lines(off.compile(script).explain())
    ss = ss2sql.connect()
    ss.function(inc)
    ss.function("add", lambda a, b: a)
    assert "inc is called: a built-in function or operator that it uses is replaced" in lines(
        ss.compile(script).explain()
    )


def test_a_result_tells_how_often_functions_were_called() -> None:
    ss = ss2sql.connect()
    ss.function(several)
    for engine in ("database", "native"):
        result = ss.run("SELECT several(this) FROM [1, 2, 1] AS list;", engine=engine)  # type: ignore[arg-type]
        assert "several is called: it is more than one expression (2 calls, 1 remembered)" in lines(result.explain())


def test_limits_are_told() -> None:
    ss = ss2sql.connect()
    ss.function(inc)
    ss.attach("wide", [1, 2**62])
    assert "inc(n) is inlined: n + 1" in lines(ss.compile("SELECT inc(this) FROM wide;").explain())
    ss.attach("wide", [1, 2**63 - 1])
    assert "inc(n) is inlined: n + 1; called for numbers beyond 1,000,000,000,000,000" in lines(
        ss.compile("SELECT inc(this) FROM wide;").explain()
    )
