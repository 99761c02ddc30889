"""SQL may answer or give up; Python decides: what is so of the second run, and what it takes over from the first."""

from __future__ import annotations

import time
from typing import Any

import pytest
from sessions import code_of

import ss2sql
from ss2sql.session.compiled_query import CompiledQuery

DROPPED = "SELECT a FROM t GROUP BY a HAVING count(*) == 1 ORDER BY sum(b) AS list;"
BRANCH = "SELECT IF(count(*) == 1; sum(b); 0) FROM t GROUP BY a AS list;"
UNREACHED = (
    "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY DEPTH FIRST MAXIMUM 2 n = n + 1 / (2 - this) STOP WITH n > 1;"
)


@pytest.fixture
def ss(ss: ss2sql.Session) -> ss2sql.Session:
    """The sum of the first group leaves 64 bits."""
    ss.host.connection.execute("CREATE TABLE t(a, b); INSERT INTO t VALUES (1, 1 << 62), (1, 1 << 62), (2, 5)")
    return ss


@pytest.mark.parametrize(
    ("script", "value"),
    [(DROPPED, [2]), (BRANCH, [0, 5]), (UNREACHED, [[{"n": 0}], [{"n": 0}, {"n": 1.0}]])],
)  # fmt: skip
def test_python_has_the_value_where_sql_fails(ss: ss2sql.Session, script: str, value: Any) -> None:
    native, result = ss.run(script, engine="native"), ss.run(script)
    assert result.value == native.value == value
    assert result.engine == "native"
    assert result.stats.generated == native.stats.generated  # of the run that answered
    (note,) = result.notes
    assert note.startswith("the query ran twice: SQL gave up (")
    assert ", so it runs natively" in result.explain()
    assert code_of(ss.run, script, engine="database") in ("X002", "X004")


GUARDED = (
    ("g, sum(x / y)", "g", "HAVING min(y) > 0 AS rows", [("a", 2.0)]),
    ("g, CASE WHEN min(y) > 0 THEN sum(x / y) ELSE 0 END", "g", "AS rows", [("a", 2.0), ("b", 0)]),
    ("IF(min(y) == 0; 0; sum(x / y) + max(x / y))", "g", "AS list", [4.0, 0]),
    ("g", "g", "HAVING min(y) == 0 OR sum(x / y) > 1 AS list", ["a", "b"]),
    ("x", "g", "HAVING min(y) > 0 AND sum([1, 2][y - 1]) > 1 AS list", {"a": [4]}),
    ("sum(x / y)", "g, x", "HAVING False AS list", []),
)


@pytest.mark.parametrize(("shown", "key", "end", "value"), GUARDED)
@pytest.mark.parametrize("search", ["", "START WITH n = 0 CONNECT BY MAXIMUM 9 n = n + 1 STOP WITH n == 0"])
def test_what_guards_an_aggregate_guards_its_argument(
    ss: ss2sql.Session, shown: str, key: str, end: str, value: Any, search: str
) -> None:
    ss.host.connection.execute("CREATE TABLE d(g, x, y); INSERT INTO d VALUES ('a', 4, 2), ('b', 1, 0), ('a', NULL, 1)")
    last = "LAST" if search else ""
    query = f"SELECT {last} {shown} FROM d WHERE x IS NOT NULL {search} GROUP BY {key} {end};"
    assert ss.run(query).value == ss.run(query, engine="native").value == value
    unguarded = f"SELECT {last} sum(x / y) FROM d WHERE x IS NOT NULL {search} GROUP BY g HAVING min(y) >= 0 AS list;"
    with pytest.raises(ss2sql.ExecutionError, match="division by zero: 1 / 0") as caught:
        ss.run(unguarded)
    assert caught.value.span is not None
    assert caught.value.span.text in ("/", "x / y")


def test_a_compiled_query_that_gave_up_stays_native(ss: ss2sql.Session) -> None:
    query = ss.compile(DROPPED)
    assert "SELECT" in str(query.sql)
    assert [len(query.run().notes) for _ in range(3)] == [1, 0, 0]
    assert "so it runs natively" in query.explain()
    assert ss.run(DROPPED.replace("sum(b)", "a")).engine == "database"


def test_one_that_had_no_value_is_asked_in_sql_again(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT 1 / (b - n) FROM t AS list;")
    assert code_of(query.run, n=5) == "X002"
    assert query.run(n=6).engine == "database"


VALUES = [1, 1.0, True, 0.0, -0.0, "x", None, [1], [1.0], [True], [[1], [1.0]], {"a": 1}, {"a": True}]


@pytest.mark.parametrize("fails", [False, True])
def test_no_call_is_made_twice(ss: ss2sql.Session, fails: bool) -> None:
    """By value and type at every depth; a call that failed, and that Python does not need, is remembered, too."""
    seen: list[str] = []

    def one(x: Any) -> Any:
        seen.append(repr(x))
        if fails and repr(x) == "[1.0]":
            raise ValueError("no")
        return x

    ss.function("f", one, volatility="immutable")
    ss.attach("given", VALUES * 2)
    script = "SELECT f(this), (SELECT IF(count(*) == 1; sum(b); 0) FROM t GROUP BY a AS list) FROM given AS rows;"
    if fails:
        with pytest.raises(ValueError, match="no"):
            ss.run(script)
    else:
        result = ss.run(script)
        assert repr(result.value) == repr([(value, [0, 5]) for value in VALUES * 2])
        assert any("ran twice" in note for note in result.notes)
    assert len(seen) == len(set(seen))


@pytest.mark.parametrize("of", ["START WITH n = f(3)", "START WITH n = 0 + f(3)"])
def test_a_call_for_a_parameter_is_not_made_again(ss: ss2sql.Session, of: str) -> None:
    seen: list[Any] = []

    def f(x: int) -> int:
        seen.append(x)
        raise ValueError("no")

    ss.function("f", f, volatility="immutable")
    with pytest.raises(ValueError, match="no"):
        ss.run(f"SELECT n FROM [1, 2] {of} CONNECT BY NO CYCLE n = n + this STOP WITH n > 6;")
    assert seen == [3]


@pytest.mark.parametrize(("limit", "code"), [({"max_rows": 2}, "X010"), ({"max_size": 300_000}, "X014")], ids=str)
def test_limits_do_not_begin_again(limit: dict[str, int], code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[Any] = []
    monkeypatch.setattr(CompiledQuery, "_retry_natively", lambda *given: begun.append(given))
    with ss2sql.connect(max_size=limit.get("max_size", 10**9)) as ss:
        ss.function("f", lambda x: [x] * 1_000_000 if "max_size" in limit else x, volatility="stable")
        ss.host.connection.execute("CREATE TABLE u(a); INSERT INTO u VALUES (1), (2), (3), (4)")
        assert code_of(ss.run, "SELECT f(a) FROM u AS list;", max_rows=limit.get("max_rows")) == code
    assert begun == []


@pytest.mark.parametrize("ending", ["timeout", "interrupt"])
def test_what_is_stopped_does_not_begin_again(ss: ss2sql.Session, ending: str) -> None:
    seen: list[int] = []

    def f(x: int) -> int:
        seen.append(x)
        if x == 3:
            time.sleep(0.2) if ending == "timeout" else ss.interrupt()
        return x

    ss.function("f", f, volatility="stable")
    ss.host.connection.execute("CREATE TABLE u(a); INSERT INTO u VALUES (1), (2), (3), (4), (5)")
    with pytest.raises((ss2sql.Timeout, ss2sql.Cancelled)) as caught:
        ss.run("SELECT f(a) FROM u AS list;", timeout=0.1 if ending == "timeout" else None)
    assert seen == [1, 2, 3]
    assert not any("twice" in note for note in caught.value.partial.notes)


def test_python_has_the_value_of_what_is_too_much_for_sqlite(ss: ss2sql.Session) -> None:
    script = f"SELECT [{', '.join(['this'] * 2000)}] FROM [1] AS list"
    assert ss.run(script).value == [[1] * 2000]
    with pytest.raises(ss2sql.UnsupportedError, match="too much for SQLite: too many arguments"):
        ss.run(script, engine="database")


def test_both_runs_have_one_deadline(ss: ss2sql.Session) -> None:
    """The first takes most of the time and fails; the second calls what SQL has not come to."""
    seen: list[int] = []

    def slow(x: int) -> int:
        seen.append(x)
        time.sleep(0.3)
        return x

    ss.function("slow", slow, volatility="stable")
    ss.host.connection.execute("INSERT INTO t VALUES (0, 0)")
    script = "SELECT slow(a), IF(count(*) == 1; sum(b); 0) FROM t GROUP BY a ORDER BY a AS rows;"
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(script, timeout=0.5)
    assert caught.value.partial.engine == "native"
    assert len(seen) == len(set(seen)) == 2


SIFTING = {
    "filter": "SELECT this FROM items WHERE odd(this) AS list;",
    "not": "SELECT this FROM items WHERE NOT odd(this) AS list;",
    "and, or": "SELECT this FROM items WHERE (odd(this) OR this == 5) AND NOT (odd(this) AND this > 2) AS list;",
    "if": "SELECT IF(odd(this); 1; 2) FROM items AS list;",
    "value": "SELECT odd(this), NOT odd(this), odd(this) AND this > 2 FROM items AS rows;",
    "xor": "SELECT this FROM items WHERE odd(this) XOR this > 2 AS list;",
    "search": """SELECT n + this FROM items WHERE NOT odd(n + this) START WITH n = 0 CONNECT BY UNIQUE n = n + this
        STOP WITH odd(n) AND n > 2 OR n > 6 AS list;""",
}


@pytest.mark.parametrize("script", SIFTING.values(), ids=SIFTING)
@pytest.mark.parametrize(
    ("yes", "no"), [(True, False), (3, 0), (0.5, 0.0), ([0], []), ({"a": 1}, {}), ("0", ""), ("a", None), (True, None)]
)
def test_conditions_ask_calls_for_their_truth(script: str, yes: Any, no: Any) -> None:
    """SQLite takes texts for false, and NOT of None for neither; no call is made twice for it."""
    found = []
    for engine in ("native", "database"):
        seen: list[int] = []

        def odd(number: int, seen: list[int] = seen) -> Any:
            seen.append(number)
            return yes if number % 2 else no

        with ss2sql.connect() as ss:
            ss.function("odd", odd, volatility="immutable")
            ss.set("items", [1, 2, 3, 4, 5])
            result = ss.run(script, engine=engine)  # type: ignore[arg-type]
            assert len(seen) == len(set(seen))
            found.append(repr(result.value))
            strange = isinstance(yes, str) or no is None or "XOR" in script
            assert engine == "native" or script == SIFTING["value"] or ("truth(" in result.sql) == strange
    assert found[0] == found[1]
