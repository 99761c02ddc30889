"""`explain`: the engine and why, rewrites, functions, the SQL, the run, the plan, searches without an end."""

from __future__ import annotations

import ast
import json
import random
from collections.abc import Iterator
from typing import Any

import pytest
from golden import each_row
from sessions import write

import ss2sql
from ss2sql.results.explain.collector import ADVICE
from ss2sql.results.explain.explanation import STAGES


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


def test_why_a_query_runs_natively(ss: ss2sql.Session) -> None:
    ss.host.connection.execute("CREATE TABLE t(a)")
    script = "SELECT n FROM t WHERE (n = a) > 1 AS list;"
    found = lines(ss.compile(script).explain())
    assert found[1:3] == [
        "engine: native: the query assigns a script variable, so it runs natively",
        "to have SQLite run it: move the assignment out of the query",
    ]  # fmt: skip
    assert "SQL:" not in found
    asked = lines(ss.run("SELECT 1 FROM [1];", engine="native").explain())
    assert asked[1] == "engine: native: engine='native' was given"


def test_why_a_function_is_called(ss: ss2sql.Session) -> None:
    for function in (inc, ratio, noisy, several):
        ss.function(function)
    ss.function("kept", inc, volatility="stable")
    script = "SELECT inc(this), ratio(1, this), noisy(1), several(this), kept(this) FROM [None, 1] AS list;"
    found = lines(ss.compile(script).explain())
    assert [line for line in found if "is called" in line] == [
        "inc is called: 'add' can fail on none or int 1..1 and int 1..1",
        "ratio is called: 'div' can fail on int 1..1 and none or int 1..1", "noisy is called: it is volatile",
        "several is called: it is more than one expression", "kept is called: it is stable",
    ]  # fmt: skip
    assert "kept is stable: declared" in found
    assert any(line.startswith("noisy is volatile: it calls random.random") for line in found)


def test_what_can_fail_is_switched_off_or_replaced(ss: ss2sql.Session) -> None:
    ss.function(inc)
    ss.attach("wide", [1, 2**62])
    assert "inc(n) is inlined: n + 1" in lines(ss.compile("SELECT inc(this) FROM wide;").explain())
    ss.attach("wide", [1, 2**63 - 1])
    limited = "inc is called: 'add' can fail on int 1..9223372036854775807 and int 1..1"
    assert limited in lines(ss.compile("SELECT inc(this) FROM wide;").explain())
    script = "SELECT inc(this) FROM [1] AS list;"
    with ss2sql.connect(disable=["inline"]) as off:
        off.function(inc)
        assert "inc is called: the rewrite inline is switched off" in lines(off.compile(script).explain())
    ss.function(inc)
    ss.function("add", lambda a, b: a)
    replaced = "inc is called: a built-in function or operator that it uses is replaced"
    assert replaced in lines(ss.compile(script).explain())


def test_a_result_tells_how_often_functions_were_called(ss: ss2sql.Session, engine: Any) -> None:
    ss.function(several)
    result = ss.run("SELECT several(this) FROM [1, 2, 1] AS list;", engine=engine)
    assert "several is called: it is more than one expression (2 calls, 1 remembered)" in lines(result.explain())


def bound(text: str) -> list[str]:
    _, _, rest = text.partition("values that are bound in it:")
    return [line for line in lines(rest) if line.startswith(":")]


def test_values_stand_beside_the_sql_as_the_script_says_them(ss: ss2sql.Session) -> None:
    ss.set("y", [[2], [3]])
    query = ss.compile("SELECT this FROM [[1], [2]] WHERE this == y[0] OR this == z AS list;", engine="database")
    assert bound(query.explain()) == [":p1 = [[1], [2]]", ":p2 = y[0], once it runs", ":z, once it runs"]
    assert bound(query.run(z=1).explain()) == [":p1 = [[1], [2]]", ":p2 = [2], which is y[0]", ":z = 1"]
    (statement,) = query.run(z=1).explain().as_dict()["statements"]
    assert statement["queries"][0]["parameters"][1] == {"name": "p2", "written": "y[0]", "value": "[2]"}
    ss.attach("many", list(range(100_000)))
    (line,) = bound(ss.run("SELECT this FROM many WHERE this > 5;", engine="database").explain())
    assert len(line) < 130  # it is cut


def test_the_sql_of_a_result_is_that_of_its_run(ss: ss2sql.Session) -> None:
    """`maximum=` makes another statement than the script alone; a later run of the query changes nothing."""
    query = ss.compile("SELECT n FROM [1, 2] WHERE n < m START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 3;")
    first = query.run(m=2, maximum=1)
    text = first.explain()
    (facts,) = text.as_dict()["statements"][0]["queries"]
    assert facts["sql"] == first.sql
    query.run(m=3)
    assert first.explain() == text


# --- the run -------------------------------------------------------------------------------------------


def test_many_levels_are_cut_in_the_middle(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT n FROM [1] START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 1001;")
    found = lines(result.explain())
    table = found[found.index("the search by level:") + 1 :]
    assert len(table) == 1 + 15 + 1 + 5 + 1
    assert (table[15].split(), table[16].split(), table[17].split()) == (["15", "1", "1"], ["…"] * 3, ["996", "1", "1"])
    assert table[-1].split() == ["all", "1,000", "1,000"]
    assert len(result.explain().as_dict()["run"]["levels"]["rows"]) == 1000


def test_times_of_stages(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 3 AS dict;"
    result = ss.run(script)
    assert set(result.stats.seconds) == {"parse", "resolve", "lower", "compile", "run"}
    result.value  # noqa: B018
    assert set(result.stats.seconds) == set(STAGES)
    query = ss.compile(script)
    assert [set(query.run().stats.seconds) for _ in range(2)] == [{"lower", "compile", "run"}, {"run"}]


# --- SQLite's plan in words ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ss2sql.Session]:
    path = tmp_path_factory.mktemp("data") / "map.db"
    tables = """CREATE TABLE edge(src, dst, len); CREATE INDEX start_index ON edge(src);
        CREATE TABLE town(id INTEGER PRIMARY KEY, name); INSERT INTO edge VALUES (1, 2, 5), (2, 3, 5);
        INSERT INTO town VALUES (2, 'Ulm');"""
    write(path, tables)
    with ss2sql.connect(path) as session:
        session.attach("moves", [{"src": 1, "dst": 2}])
        yield session


def plan(ss: ss2sql.Session, script: str) -> list[str]:
    (query,) = ss.compile(script).explain().as_dict()["statements"][0]["queries"]
    return ["  " * line["depth"] + line["words"] for line in query["plan"]]


@each_row("queries/plans", "query", "told")
def test_the_plan_of_sqlite(roads: ss2sql.Session, query: str, told: str) -> None:
    expected = ast.literal_eval(told)
    assert plan(roads, f"{query};") == expected


@pytest.mark.parametrize(
    ("options", "queue"),
    [("", "the deepest first"), ("BREADTH FIRST", "the oldest first"), ("PROBABILITY 0.5", "the likeliest first"),
     ("COST 1 HEURISTIC 0", "the one with the least cost and estimate together first"),
     ("HEURISTIC 3 - n", "the one with the smallest estimate first")],
)  # fmt: skip
def test_the_queue(roads: ss2sql.Session, options: str, queue: str) -> None:
    found = plan(roads, f"SELECT this FROM [1] START WITH n = 1 CONNECT BY {options} n = n + 1 STOP WITH n >= 3;")
    assert f"takes the steps that wait in a queue one by one, {queue}" in map(str.strip, found)


def test_the_plan_of_worlds(ss: ss2sql.Session) -> None:
    ss.attach("space", ss2sql.scenes.chaos(seed=1, bodies=3))
    assert plan(ss, "SELECT mass FROM space;") == ["reads every element of space"]
    found = plan(ss, "SELECT mass FROM space WHERE x >= 0 AND x < 2 AND y > 1;")
    assert found == ["asks for the elements of space with x >= ?, x < ?, y > ?"]
    near = plan(ss, "SELECT id FROM space.near([0, 0, 0], 1);")
    assert near == ["asks for the elements of near with point := ?, radius := ?"]
    ss.function("after", lambda n: [n + 1], volatility="stable")
    called = plan(ss, "SELECT mass, a.this FROM space, a = after(space.id);")
    assert called[1] == "for each of them, walks the elements of a"


def test_what_is_left_for_python(roads: ss2sql.Session) -> None:
    found = roads.compile("SELECT dst FROM edge GROUP BY src;").explain().as_dict()["statements"][0]["queries"][0]
    assert found["afterwards"] == ["puts the results into groups"]


def test_a_plan_that_cannot_be_told_any_more() -> None:
    with ss2sql.connect() as ss:
        result = ss.run("SELECT this FROM [1];", engine="database")
    text = result.explain()
    assert "how SQLite does it cannot be told: the session is closed" in text
    assert "FROM elements" in text


# --- searches without an end ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parts",
    [
        "MAXIMUM 3 n = n + 1",
        "MEMORIZE 3 n = n + 1",
        "UNIQUE n = n + 1",
        "n < 3, n = n + 1",
        "n = n + 1 STOP WITH n > 3",
    ],
)
def test_searches_that_nothing_bounds_are_told(roads: ss2sql.Session, parts: str) -> None:
    script = "SELECT this FROM [1, 2] START WITH n = 1 CONNECT BY {};"
    assert ADVICE not in roads.compile(script.format(parts)).explain()
    assert f"warning: {ADVICE}" in roads.compile(script.format("n = n + 1")).explain()


def test_an_explanation_is_a_text_and_data(ss: ss2sql.Session) -> None:
    ss.function(inc)
    found = ss.run("x = 1; SELECT inc(this) FROM [1, 2] WHERE this > x;", engine="database").explain()
    assert isinstance(found, str)
    assert repr(found) == found
    assert "no query: runs in Python as it is written" in found
    data = found.as_dict()
    assert json.loads(json.dumps(data)) == data
    assignment, select = data["statements"]
    assert assignment == {"text": "x = 1", "queries": []}
    assert select["text"] == "SELECT inc(this) FROM [1, 2] WHERE this > x"
    (query,) = select["queries"]
    assert (query["engine"], query["reason"]) == ("database", "all of it can be said in SQL")
    assert set(query["rewrites"]) == {"inline"}
    (function,) = query["functions"]
    assert (function["name"], function["volatility"], function["calls"]) == ("inc", "immutable", 0)
    assert ss.compile("SELECT 1 FROM [1];").explain().as_dict()["run"] is None


def test_a_result_that_is_no_search_says_nothing_of_levels(ss: ss2sql.Session) -> None:
    for script in ("1 + 1;", "SELECT this FROM [1];", "x = SELECT this FROM [1] AS list; x;"):
        result = ss.run(script)
        assert "level" not in result.explain()
        assert result.explain().as_dict()["run"]["levels"] is None
