"""Graphs of MEMORIZE in the session's file: what was found out once is not asked again, and comes back exactly."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import apsw
import pytest
from listings import move
from remembering import KNOWN, MAZE, asked, calls, connect, fresh, near, run, scratch, session
from sessions import code_of, write

import ss2sql
from ss2sql.runtime.graph_cache import cached_steps


def test_the_same_query_again_and_another_goal_ask_nothing(file: Path) -> None:
    with connect(file) as ss:
        first = run(ss)
        assert calls(first) > 0
        assert first.value == fresh()
        again = run(ss)
        assert (again.value, calls(again)) == (first.value, 0)
        assert again.stats.generated == again.stats.remembered_steps == first.stats.generated
        assert again.stats.levels == first.stats.levels
    with connect(file) as ss:
        later = run(ss)
        assert (later.value, calls(later)) == (first.value, 0)
    with connect(file) as ss:
        run(ss, goal=6)
        for goal in (5, 7, 12, 0):
            again = run(ss, goal=goal)
            assert (again.value, calls(again)) == (fresh(goal=goal), 0)
        assert len(ss.graphs()) == 1


def test_another_bound_start_or_stop_asks_for_what_is_new(file: Path) -> None:
    with connect(file) as ss:
        shallow, deep, wanted = run(ss, bound=3), run(ss, bound=5), scratch(bound=5)
        assert deep.value == wanted.value
        assert calls(deep) == calls(wanted) - calls(shallow)
        assert ss.graphs()[0].levels == 5
        again, wanted = run(ss, first=2), scratch(first=2)
        assert again.value == wanted.value
        assert calls(again) < calls(wanted)
        assert calls(run(ss, limit=20)) == 0
        assert len(ss.graphs()) == 1


HANOI = """SELECT this, tower FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] WHERE goal == move(this, tower)
START WITH tower = [[3, 2, 1], [], []] CONNECT BY MEMORIZE 9 tower = move(this, tower)
STOP WITH [] == move(this, tower)"""


def test_what_connect_by_calls_answers_the_clauses(file: Path) -> None:
    with ss2sql.connect(file) as ss:
        ss.function(move)
        first = ss.run(HANOI, goal=[[], [], [3, 2, 1]])
        assert [len(path) for path in first.value] == [7, *[8] * 4, *[9] * 16]
        again = ss.run(HANOI, goal=[[], [3, 2, 1], []])
        assert [len(path) for path in again.value] == [7, *[8] * 4, *[9] * 16]
        assert again.value != first.value
        assert calls(again) == 0


def test_a_step_that_stops_is_known_where_another_variable_goes_with_it(file: Path) -> None:
    script = HANOI.replace("CONNECT BY", ", level = 0 CONNECT BY").replace("STOP WITH", ", level = level + 1 STOP WITH")
    with ss2sql.connect(file) as ss:
        ss.function(move)
        first, again = (ss.run(script, goal=[[], [], [3, 2, 1]]) for _ in range(2))
        assert (again.value, calls(again)) == (first.value, 0)


def test_clauses_with_calls_of_their_own(file: Path) -> None:
    script = """SELECT e.this[0] FROM e = [[1, 2.0], [2, 0.5]] WHERE is_good(e.this[0] + n)
    START WITH n = 0 CONNECT BY MEMORIZE 3 COST price(e.this[1], n) n = n + e.this[0] STOP WITH is_far(n) AS list"""
    functions = {"is_good": lambda n: n % 2 == 0, "price": lambda w, n: w + n, "is_far": lambda n: n > 2}
    with session(file, **functions) as ss:
        first = ss.run(script)
        assert set(first.stats.calls) == set(functions)
    with session(file, **functions) as ss:
        again = ss.run(script)
        assert (again.value, calls(again)) == (first.value, 0)
        other = ss.run(script.replace("is_good(e.this[0] + n)", "NOT is_good(e.this[0] + n)"))
        assert calls(other) == 0
        assert len(ss.graphs()) == 1


def test_after_an_error_each_of_the_known_states_has_all_of_its_steps(file: Path) -> None:
    def near(node: int) -> list[int]:
        return [node // (5 - node), node + 1, node + 2]

    script = "SELECT n.this FROM n = near(node) START WITH node = 0 CONNECT BY MEMORIZE node = n.this AS list"
    with ss2sql.connect(file) as ss:
        ss.function("near", near)
        for _ in range(2):  # what it raised is asked again
            with pytest.raises(ZeroDivisionError):
                ss.run(script)
    assert set(asked(file, KNOWN)) == {(3, 3)}


@pytest.mark.parametrize("has_file", [True, False])
def test_switched_off_or_without_a_file(file: Path, has_file: bool) -> None:
    with connect(file if has_file else None, disable=["remember"] if has_file else []) as ss:
        first, again = run(ss), run(ss)
        assert calls(first) == calls(again) > 0
        assert first.stats.notes == []
        assert (len(ss.graphs()), repr(ss.graphs()), ss.tables()) == (0, "no remembered graphs", {})


def test_read_only_sessions_read(file: Path) -> None:
    with connect(file) as ss:
        run(ss, bound=3)
    with connect(file, read_only=True) as ss:
        assert calls(run(ss, bound=3)) == 0
        deep = run(ss, bound=5)
        assert deep.value == fresh(bound=5)
        assert calls(deep) > 0
        assert any("read only" in note for note in deep.stats.notes)
        assert calls(run(ss, bound=5)) == calls(deep)
        with pytest.raises(ss2sql.ExecutionError):
            ss.graphs().drop()


def test_a_locked_file_is_no_hindrance(file: Path) -> None:
    with connect(file) as ss:
        run(ss, bound=2)
        other = apsw.Connection(str(file))
        other.execute("BEGIN IMMEDIATE")
        ss.host.connection.set_busy_timeout(1)
        locked = run(ss, bound=4)
        assert locked.value == fresh(bound=4)
        assert any("what is new is not remembered" in note for note in locked.stats.notes)
        other.execute("ROLLBACK")
        other.close()
        again = run(ss, bound=4)
        assert 0 < calls(again) <= calls(locked)
        assert calls(run(ss, bound=4)) == 0


def test_graphs_can_be_listed_and_dropped(file: Path) -> None:
    with connect(file) as ss:
        run(ss, bound=3)
        other = "SELECT n.this FROM n = near(node) START WITH node = start CONNECT BY MEMORIZE 2 node = n.this + k"
        ss.eval(other, start=2, k=1)
        graphs = ss.graphs()
        assert [graph.functions for graph in graphs] == [("near",), ("near",)]
        assert [graph.parameters for graph in graphs] == [{}, {"k": 1}]
        assert [graph.levels for graph in graphs] == [3, 2]
        assert graphs[1].query.startswith("SELECT n.this FROM n = near(node) START WITH")
        # 1, then its neighbours 2, 3, 0, then theirs; 0 leads to 0, 0 and -1.
        assert graphs[0].edges == 3 * len({1, 2, 3, 0, 4, 6, 9, -1})
        assert "near" in repr(graphs)
        assert graphs[0].created <= graphs[0].used
        graphs[0].drop()
        assert [graph.id for graph in ss.graphs()] == [graphs[1].id]
        assert calls(run(ss, bound=3)) > 0
        ss.graphs().drop()
        assert len(ss.graphs()) == 0
    for table in ("graphs", "states"):
        assert asked(file, f"SELECT count(*) FROM ss2sql_{table}") == [(0,)]


def test_a_graph_that_is_dropped_meanwhile_is_begun_again(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cached_steps, "PART", 0.0)
    path = str(file)
    spoil = """DELETE FROM ss2sql_graphs;
        INSERT INTO ss2sql_graphs VALUES (NULL, 'other', '', '[]', '{}', '[]', '[]', 0, '', '')"""

    def limit_of(node: int) -> int:
        if node == 4:
            other = apsw.Connection(path)
            other.execute("PRAGMA foreign_keys = ON")
            if not other.execute("SELECT 1 FROM ss2sql_graphs WHERE key = 'other'").fetchall():
                with other:
                    other.execute(spoil)
            other.close()
        return 40

    with connect(file) as ss:
        ss.function("limit_of", limit_of, volatility="immutable")
        script = MAZE.replace("bound", "6").replace("n.this > limit", "n.this > limit_of(n.this)")
        for _ in range(3):
            found = ss.run(script, goal=6, first=1)
            assert (found.value, found.stats.notes) == (fresh(bound=6), [])
            assert [graph.edges > 0 for graph in ss.graphs()] == [False, True]
        assert calls(found) == 0
    orphans = "SELECT count(*) FROM ss2sql_states WHERE graph NOT IN (SELECT id FROM ss2sql_graphs)"
    assert asked(file, orphans) == [(0,)]


def test_scripts_read_the_tables_and_never_write_them(file: Path) -> None:
    with connect(file) as ss:
        run(ss, bound=2)
        assert ss.eval("len(SELECT state FROM ss2sql_states)") == len({1, 2, 3, 0})
        again = ss.run("SELECT state FROM ss2sql_states START WITH n = 0 CONNECT BY MEMORIZE 1 n = n + 1")
        assert (again.stats.notes, len(ss.graphs())) == ([], 1)  # it calls no function


def test_tables_that_are_spoilt(file: Path) -> None:
    with connect(file) as ss:
        run(ss)
    write(file, "UPDATE ss2sql_states SET calls = 'no JSON'")
    with connect(file) as ss, pytest.raises(ss2sql.ExecutionError, match="remembered graphs cannot be read") as caught:
        run(ss)
    assert "disable=['remember']" in str(caught.value)
    write(file, "DROP TABLE ss2sql_states")
    with connect(file) as ss, pytest.raises(ss2sql.ExecutionError, match="no such table: ss2sql_states"):
        run(ss)
    with connect(file, disable=["remember"]) as ss:
        assert run(ss).value == fresh()


def test_explain_says_what_became_of_the_graph(file: Path) -> None:
    with connect(file) as ss:
        run(ss)
        text = run(ss).explain()
        assert "graph: remembered, with the number 1 in ss2sql_graphs;" in text
        ss.function("near", near, volatility="stable")
        text = run(ss).explain()
        assert "graph: not remembered: 'near' is stable, not immutable" in text


def test_both_ends_give_way_where_calls_are_saved(file: Path) -> None:
    script = """SELECT d.this, n FROM d = [1, 2] WHERE n + d.this == 6
    START WITH n = 0 CONNECT BY MEMORIZE 4 n = n + d.this STOP WITH {} AS list"""
    with session(file, is_wall=lambda n: n == 3) as ss:
        first, again = (ss.run(script.format("is_wall(n + d.this)")) for _ in range(2))
        assert (again.value, calls(again)) == (first.value, 0)
        free = ss.run(script.format("n + d.this == 3"))
        assert free.value == first.value
        assert (free.stats.notes, bool(free.stats.backward)) == ([], True)


def test_a_large_number_of_levels(file: Path) -> None:
    script = "SELECT next(n) FROM [0] START WITH n = 0 CONNECT BY MEMORIZE n = next(n) STOP WITH n > 2000 AS list"
    with session(file, next=lambda n: n + 1) as ss:
        first, again = (ss.run(script, maximum=1) for _ in range(2))
        assert (again.value, calls(again)) == (first.value, 0)
        assert ss.graphs()[0].edges == 2002  # from 0 to 2001


def test_a_run_that_is_broken_off_keeps_what_it_has_found_out(file: Path) -> None:
    with connect(file) as ss:
        with pytest.raises(ss2sql.ExecutionError, match="max_rows"):
            ss.run(MAZE.replace("bound", "6"), goal=6, first=1, limit=400, max_rows=20)
        (graph,) = ss.graphs()
        assert graph.edges % 3 == 0
        wanted, again = scratch(bound=6, limit=400), run(ss, bound=6, limit=400)
        assert again.value == wanted.value
        assert calls(again) == calls(wanted) - graph.edges // 3


# --- values, and whatever is asked ------------------------------------------------------------------------

EXACT = [
    *(None, True, False, 0, 1, 1.0, -0.0, 0.1 + 0.2, 5e-324, 1e308, 2**63 - 1, -(2**63), 9007199254740993),
    *("", 'quote " and \\ and \n and \0 and \u2028', "smile 😀 ünï", "{"),
    *([], [[], [1, 1.0, True, None]], {}, {"b": 1, "a": {"z": [1.0], "y": "é"}}, [{"": None}]),
]
INEXACT: list[Any] = [
    *(object(), [b"bytes"], {1: 2}, {(1, 2): 3}, {"a": {None: 1}}, "half \ud83d of a smile", "\ud83d\ude00"),
]
SCRIPT = """SELECT n, value(n), v FROM [0] START WITH n = 0, v = [] CONNECT BY MEMORIZE v = value(n), n = n + 1
STOP WITH n == number AS rows"""


def test_values_of_rows_and_states(tmp_path: Path) -> None:
    file, number = tmp_path / "values.db", len(EXACT)
    with session(None, value=lambda n: EXACT[n]) as ss:
        expected = ss.eval(SCRIPT, number=number - 1)
    with session(file, value=lambda n: EXACT[n]) as ss:
        assert repr(ss.eval(SCRIPT, number=number - 1)) == repr(expected)
    with session(file, value=lambda n: EXACT[n]) as ss:
        again = ss.run(SCRIPT, number=number - 1)
        assert repr(again.value) == repr(expected)
        assert calls(again) == 0
    texts = "SELECT min(json_valid(steps)), min(json_valid(state)) FROM ss2sql_states"
    assert asked(file, texts) == [(1, 1)]


@pytest.mark.parametrize("value", INEXACT, ids=lambda value: ascii(value)[:20])
def test_what_json_cannot_give_back_is_not_remembered(value: Any, tmp_path: Path) -> None:
    values = [1, 2, value, 4, 5]
    with session(None, value=lambda n: values[n]) as ss:
        expected = ss.eval(SCRIPT, number=4)
    with session(tmp_path / "values.db", value=lambda n: values[n]) as ss:
        for _ in range(2):
            result = ss.run(SCRIPT, number=4)
            assert result.value == expected
            (note,) = result.stats.notes
            assert "not remembered: " in note


def test_elements_that_functions_give(tmp_path: Path) -> None:
    """Dicts as elements, read by their columns or as a whole, beside a source that is read once."""
    ways = [[{"to": 1, "how": "by foot"}, {"to": 2, "how": None}], [{"to": 2, "how": 1.0}], []]

    def out_of(node: int) -> list[dict[str, Any]]:
        return ways[node]

    scripts = [
        """SELECT w.to, k.this FROM k = [1, 2], w = out_of(node) WHERE w.to == 2
        START WITH node = 0 CONNECT BY MEMORIZE 3 node = w.to ORDER BY k.this DESC, w.how AS rows""",
        """SELECT w.this["to"], k.this FROM k = [1, 2], w = out_of(node) WHERE w.how != 1
        START WITH node = 0 CONNECT BY MEMORIZE 3 node = w.to AS rows""",
    ]
    for script in 2 * scripts:
        with session(None, out_of=out_of) as scratch, session(tmp_path / "ways.db", out_of=out_of) as ss:
            first, again = ss.run(script), ss.run(script)
            assert first.value == again.value == scratch.eval(script)
            assert calls(again) == 0


# --- whatever is asked -----------------------------------------------------------------------------------

QUERIES = [
    "SELECT e.this[0] FROM e = near(node) WHERE {goal} START WITH node = {first} CONNECT BY MEMORIZE {bound} {options} "
    "node = e.this[0] STOP WITH {stop} AS list",
    "SELECT k.this, reached(node, k.this) FROM k = [0, 1, 2] WHERE reached(node, k.this) IN {goals} "
    "START WITH node = {first} CONNECT BY MEMORIZE {bound} node = reached(node, k.this) "
    "STOP WITH reached(node, k.this) IN {stops} GROUP BY k.this % 2 ORDER BY node AS rows",
]


@pytest.mark.parametrize("seed", [*range(10), *(pytest.param(n, marks=pytest.mark.slow) for n in range(10, 30))])
def test_random_queries_one_after_the_other(seed: int, tmp_path: Path) -> None:
    """Whatever was asked before, a remembered graph answers as a fresh one, with the same steps.

    Equal numbers are one place, whether they are read or made.
    """
    dice = random.Random(seed)
    size = dice.randint(3, 7)
    weights = [0, 0.5, 1.0, 1]
    places = [*range(size), True, *map(float, range(size))]
    edges = [[[dice.choice(places), dice.choice(weights)] for _ in range(dice.randint(0, 4))] for _ in range(size)]
    functions = {
        "near": lambda node: edges[int(node)],
        "reached": lambda node, k: edges[int(node)][k][0] if k < len(edges[int(node)]) else node,
        "is_goal": lambda node, goals: node in goals,
        "weight": lambda edge: edge[1],
    }
    sessions = [session(path, **functions) for path in (tmp_path / "random.db", None)]
    for _ in range(8):
        goals, stops = ([dice.randrange(size) for _ in range(2)] for _ in range(2))
        script = dice.choice(QUERIES).format(
            goal=dice.choice([f"e.this[0] IN {goals}", f"is_goal(e.this[0], {goals})", "node != 0"]),
            stop=dice.choice([f"e.this[0] IN {stops}", f"is_goal(e.this[0], {stops}) AND near(e.this[0]) != []"]),
            options=dice.choice(["", "", "COST weight(e.this)", "PROBABILITY weight(e.this)"]),
            first=dice.randrange(size),
            bound=dice.choice([1, 2, 3, 4, ""]),
            goals=goals,
            stops=stops,
        )
        remembered, scratch = (ss.run(script) for ss in sessions)
        assert repr(remembered.value) == repr(scratch.value), script
        assert remembered.stats.levels == scratch.stats.levels, script
        assert calls(remembered) <= calls(scratch), script
        assert calls(sessions[0].run(script)) == 0, script
    for ss in sessions:
        ss.close()


SPOILT = [
    *("[" * 100_000, "[" * 100_000 + "1" + "]" * 100_000),
    *(f"[{'[' * 5000}{']' * 5000}]", f"[{10**30}]", f"[{-(10**30)}]"),
    *(f'{{"value": {{"(0,)": [{n}]}}}}' for n in (2**63, -(10**30), "NaN", "Infinity", "1e999")),
    *("[1e999]", "[[-1e999]]", "[NaN]", '[{"a": [Infinity]}]', '{"n": 1}', '"abc"', "7", "[null, 1]", "[1], [2]", ""),
]


@pytest.mark.parametrize("text", SPOILT, ids=lambda text: text[:20])
def test_texts_of_others_are_values_or_an_error(tmp_path: Path, text: str) -> None:
    """What another program has written into the tables never becomes a value that the language does not have."""
    file = tmp_path / "values.db"
    script = "SELECT this FROM value(n) START WITH n = 0 CONNECT BY MEMORIZE n = n + 1 STOP WITH n == 3 AS rows"
    with session(file, value=lambda n: [n, n + 1]) as ss:
        assert len(ss.eval(script)) > 2
    write(file, f"UPDATE ss2sql_states SET calls = '{text}'")
    with session(file, value=lambda n: [n, n + 1]) as ss:
        assert code_of(ss.run, script) == "X009"
    write(file, f"UPDATE ss2sql_graphs SET functions = '{text}', parameters = '{text}'")
