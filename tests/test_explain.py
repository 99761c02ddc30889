"""`explain`: which engine runs a query and why, what was rewritten, what became of functions, the SQL, the run."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest
from listings import MOVES, move

import ss2sql
from ss2sql.explained.words import STAGES


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
        "engine: database: all of it can be said in SQL",
        "rewrites:",
        "inline: calls of Python functions became the expressions that they compute",
        "split: conditions were taken apart, so that each is asked as early as possible",
        "inc(n) is inlined: n + 1",
        "inc is immutable: it has a source that uses only its arguments",
        "how SQLite does it:",
        "walks the elements of items",
        "SQL:",
        "SELECT",
        "items.this + 1 AS inc",
        "FROM elements(:items) AS items",
        "WHERE",
        "items.this <> 2",
        "values that are bound in it:",
        ":items, once it runs",
    ]


def test_why_a_query_runs_natively() -> None:
    ss = ss2sql.connect()
    script = "SELECT n FROM [1, 2] WHERE (n = this) > 1 AS list;"
    found = lines(ss.compile(script).explain())
    assert found[1:3] == [
        "engine: native: the query assigns a script variable, so it runs natively",
        "to have SQLite run it: move the assignment out of the query",
    ]
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


def test_queries_of_one_statement_have_their_texts() -> None:
    ss = ss2sql.connect()
    found = lines(ss.compile("a = [SELECT this FROM [1] AS list, SELECT 2 * this FROM [3] AS list];").explain())
    assert found[1] == "SELECT this FROM [1] AS list"
    assert "SELECT 2 * this FROM [3] AS list" in found


# --- values that are bound -----------------------------------------------------------------------------


def bound(text: str) -> list[str]:
    found = lines(text)
    if "values that are bound in it:" not in found:
        return []
    rest = found[found.index("values that are bound in it:") + 1 :]
    return [line for line in rest if line.startswith(":")]


def test_values_stand_beside_the_sql_as_the_script_says_them() -> None:
    ss = ss2sql.connect()
    ss.set("y", [[2], [3]])
    query = ss.compile("SELECT this FROM [[1], [2]] WHERE this == y[0] OR this == z AS list;")
    assert bound(query.explain()) == [":p1 = [[1], [2]]", ":p2 = y[0], once it runs", ":z, once it runs"]
    assert bound(query.run(z=1).explain()) == [":p1 = [[1], [2]]", ":p2 = [2], which is y[0]", ":z = 1"]
    (statement,) = query.run(z=1).explain().as_dict()["statements"]
    assert statement["queries"][0]["parameters"] == [
        {"name": "p1", "written": "[[1], [2]]", "value": "[[1], [2]]"},
        {"name": "p2", "written": "y[0]", "value": "[2]"},
        {"name": "z", "written": "z", "value": "1"},
    ]


def test_long_values_are_cut() -> None:
    ss = ss2sql.connect()
    ss.attach("many", list(range(100_000)))
    (line,) = bound(ss.run("SELECT this FROM many WHERE this > 5;").explain())
    assert len(line) < 130


def test_the_sql_of_a_result_is_that_of_its_run() -> None:
    """`maximum=` makes another statement than the script alone; a later run of the query changes nothing."""
    ss = ss2sql.connect()
    query = ss.compile("SELECT n FROM [1, 2] WHERE n < m START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 3;")
    first = query.run(m=2, maximum=1)
    text = first.explain()
    (facts,) = text.as_dict()["statements"][0]["queries"]
    assert facts["sql"] == first.sql
    query.run(m=3)
    assert first.explain() == text


# --- the run -------------------------------------------------------------------------------------------

HANOI = """SELECT this, tower FROM moves WHERE [[], [], [3, 2, 1]] == move(this, tower)
START WITH tower = [[3, 2, 1], [], []], level = 1
CONNECT BY {} tower = move(this, tower), level = level + 1
STOP WITH level == 8 OR [] == move(this, tower);"""


def hanoi(ss: ss2sql.Session, options: str, engine: Any) -> ss2sql.Result:
    ss.attach("moves", MOVES)
    ss.function(move)
    return ss.run(HANOI.format(options), engine=engine)


@pytest.mark.parametrize("engine", ["database", "native"])
def test_a_run_tells_its_steps(engine: Any) -> None:
    ss = ss2sql.connect()
    result = hanoi(ss, "NO CYCLE", engine)
    run = result.explain().as_dict()["run"]
    stats = result.stats
    assert (run["status"], run["engine"], run["rows"], run["paths"]) == ("complete", engine, 39, 5)
    assert (run["generated"], run["expanded"], run["pruned"]) == (stats.generated, stats.expanded, stats.pruned)
    assert {"run"} <= set(run["seconds"]) <= set(STAGES)
    assert min(run["seconds"].values()) >= 0
    table = run["levels"]
    assert [row[0] for row in table["rows"]] == list(range(1, 9))
    assert [row[-1] for row in table["rows"]] == [0] * 6 + [1, 4]  # one path of seven steps, four of eight
    found = lines(result.explain())
    assert "the run: complete, 5 paths of 39 rows, " + engine in found
    assert f"{stats.generated:,} steps generated, {stats.expanded:,} of them expanded" in "\n".join(found)


@pytest.mark.parametrize("options", ["", "NO CYCLE", "BREADTH FIRST", "UNIQUE", "DEPTH FIRST UNIQUE", "COST 1 UNIQUE"])
@pytest.mark.parametrize("tail", ["", "WHERE n + this == 4 "])
def test_levels_count_all_steps_that_were_kept(options: str, tail: str) -> None:
    """The steps that went on, and the results that did not; the reference counts them on the paths of all of them."""
    ss = ss2sql.connect()
    script = """SELECT this, n FROM [1, 2] {} START WITH n = 0 CONNECT BY {} n = n + this STOP WITH n + this > 4;"""
    result = ss.run(script.format(tail, options), engine="database")
    table = result.explain().as_dict()["run"]["levels"]
    kept = {level: number for level, number, _ in table["rows"]}
    assert sum(kept.values()) >= max(result.stats.expanded, len(result.paths))
    for level, number, results in table["rows"]:
        assert results == sum(1 for path in result.paths if len(path) == level)
        assert number >= results
        assert number >= len({tuple(path[:level]) for path in result.paths if len(path) >= level})
    every = ss.run(script.format("", options), engine="database")
    wanted = [len({tuple(path[:level]) for path in every.paths if len(path) >= level}) for level in kept]
    if "UNIQUE" not in options:
        assert list(kept.values()) == wanted


def test_levels_are_not_told_where_there_is_no_search() -> None:
    ss = ss2sql.connect()
    found = ss.run("SELECT this FROM [1, 2];").explain()
    assert "by level" not in found
    assert found.as_dict()["run"]["levels"] is None


def test_many_levels_are_cut_in_the_middle() -> None:
    ss = ss2sql.connect()
    result = ss.run("SELECT n FROM [1] START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 1001;")
    found = lines(result.explain())
    table = found[found.index("the search by level:") + 1 :]
    assert len(table) == 1 + 15 + 1 + 5 + 1
    assert (table[15].split(), table[16].split(), table[17].split()) == (["15", "1", "1"], ["…"] * 3, ["996", "1", "1"])
    assert table[-1].split() == ["all", "1,000", "1,000"]
    assert len(result.explain().as_dict()["run"]["levels"]["rows"]) == 1000


def test_times_of_stages() -> None:
    ss = ss2sql.connect()
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 3 AS dict;"
    result = ss.run(script)
    assert set(result.stats.seconds) == {"parse", "resolve", "lower", "compile", "run"}
    result.value  # noqa: B018
    assert set(result.stats.seconds) == set(STAGES)
    query = ss.compile(script)
    assert set(query.run().stats.seconds) == {"lower", "compile", "run"}
    assert set(query.run().stats.seconds) == {"run"}
    native = ss.run(script, engine="native").stats.seconds
    assert native["compile"] > 0


def test_the_result_of_a_broken_off_run_is_explained() -> None:
    ss = ss2sql.connect()
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run("SELECT n FROM [1] START WITH n = 0 CONNECT BY n = n + 1;", timeout=0.05)
    partial = caught.value.partial
    assert partial is not None
    found = partial.explain()
    assert found.as_dict()["run"]["status"] == "timeout"
    assert "takes the steps that wait in a queue one by one, the deepest first" in lines(found)


# --- as data -------------------------------------------------------------------------------------------


def test_an_explanation_is_a_text_and_data() -> None:
    ss = ss2sql.connect()
    ss.function(inc)
    found = ss.run("x = 1; SELECT inc(this) FROM [1, 2] WHERE this > x;").explain()
    assert isinstance(found, str)
    assert repr(found) == found
    data = found.as_dict()
    assert json.loads(json.dumps(data)) == data
    assert [statement["text"] for statement in data["statements"]] == [
        "x = 1",
        "SELECT inc(this) FROM [1, 2] WHERE this > x",
    ]
    assert data["statements"][0]["queries"] == []
    (query,) = data["statements"][1]["queries"]
    assert (query["engine"], query["reason"]) == ("database", "all of it can be said in SQL")
    assert set(query["rewrites"]) == {"inline"}
    (function,) = query["functions"]
    assert (function["name"], function["volatility"], function["calls"]) == ("inc", "immutable", 0)
    assert ss.compile("SELECT 1 FROM [1];").explain().as_dict()["run"] is None
