"""Graphs of MEMORIZE in the session's file: what was found out once is not asked again."""

from __future__ import annotations

from pathlib import Path

import apsw
import pytest
from listings import move
from remembering import KNOWN, MAZE, asked, calls, connect, fresh, near, run, scratch, session
from sessions import write

import ss2sql


def test_the_same_query_again(file: Path) -> None:
    with connect(file) as ss:
        first = run(ss)
        assert calls(first) > 0
        assert first.value == fresh()
        again = run(ss)
        assert again.value == first.value
        assert calls(again) == 0
        assert again.stats.generated == again.stats.remembered_steps == first.stats.generated
        assert again.stats.levels == first.stats.levels
    with connect(file) as ss:
        later = run(ss)
        assert later.value == first.value
        assert calls(later) == 0


def test_another_goal_asks_nothing(file: Path) -> None:
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


def test_names_in_the_script_do_not_matter(file: Path) -> None:
    with connect(file) as ss:
        ss.run("steps = [1, 2]; ways = [1, 2];")
        ss.function("add", lambda a, b: a + b, volatility="immutable")  # which is +
        script = "SELECT s.this + n FROM s = {0} START WITH n = 0 CONNECT BY MEMORIZE 3 n = s.this + n"
        first = ss.run(script.format("steps"))
        assert calls(first) > 0
        again = ss.run(f"[]; {script.format('ways').replace('s = ', 'w = ').replace('s.this', 'w.this')}")
        assert calls(again) == 0
        assert again.value == [[{"w.this + n": row["s.this + n"]} for row in path] for path in first.value]
        assert len(ss.graphs()) == 1


HANOI = """SELECT this, tower FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] WHERE goal == move(this, tower)
START WITH tower = [[3, 2, 1], [], []] CONNECT BY MEMORIZE 9 tower = move(this, tower)
STOP WITH [] == move(this, tower)"""


def test_what_connect_by_calls_answers_the_clauses(file: Path) -> None:
    """STOP WITH and WHERE call `move` for every step, so the state after every step is known, wherever it leads."""
    with ss2sql.connect(file) as ss:
        ss.function(move)
        first = ss.run(HANOI, goal=[[], [], [3, 2, 1]])
        assert [len(path) for path in first.value] == [7, *[8] * 4, *[9] * 16]
        again = ss.run(HANOI, goal=[[], [3, 2, 1], []])
        assert [len(path) for path in again.value] == [7, *[8] * 4, *[9] * 16]
        assert again.value != first.value
        assert calls(again) == 0
    assert asked(file, "SELECT count(*) FROM ss2sql_verdicts") == [(0,)]


def test_verdicts_of_clauses_with_calls_of_their_own(file: Path) -> None:
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
        assert set(other.stats.calls) == {"is_good"}
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
    assert set(asked(file, KNOWN)) == {(3, 3), (None, 0)}


@pytest.mark.parametrize("has_file", [True, False])
def test_switched_off_or_without_a_file(file: Path, has_file: bool) -> None:
    with connect(file if has_file else None, disable=["remember"] if has_file else []) as ss:
        first, again = run(ss), run(ss)
        assert calls(first) == calls(again) > 0
        assert first.stats.notes == []
        assert len(ss.graphs()) == 0
        assert repr(ss.graphs()) == "no remembered graphs"
        assert ss.tables() == {}


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
    for table in ("graphs", "nodes", "edges", "clauses", "verdicts"):
        assert asked(file, f"SELECT count(*) FROM ss2sql_{table}") == [(0,)]


def test_a_graph_that_is_dropped_meanwhile_is_begun_again(file: Path) -> None:
    """Another graph even has the numbers of its nodes, with steps that lead nowhere."""
    path = str(file)

    def limit_of(node: int) -> int:
        if node == 4:
            other = apsw.Connection(path)
            other.execute("PRAGMA foreign_keys = ON")
            if not other.execute("SELECT 1 FROM ss2sql_graphs WHERE key = 'other'").fetchall():
                with other:
                    other.execute("DELETE FROM ss2sql_graphs")
                    other.execute(
                        "INSERT INTO ss2sql_graphs VALUES (NULL, 'other', '', '[]', '{}', '[]', '[]', 0, '', '')"
                    )
                    other.execute(
                        "WITH RECURSIVE n(i) AS (VALUES (1) UNION ALL SELECT i + 1 FROM n WHERE i < 99)"
                        " INSERT INTO ss2sql_nodes SELECT i, (SELECT id FROM ss2sql_graphs), '[' || -i || ']', 0 FROM n"
                    )
            other.close()
        return 40

    with connect(file) as ss:
        ss.function("limit_of", limit_of, volatility="immutable")
        script = MAZE.replace("bound", "6").replace("n.this > limit", "n.this > limit_of(n.this)")
        first = ss.run(script, goal=6, first=1)
        assert first.value == fresh(bound=6)
        assert first.stats.notes == []
        assert ss.graphs()[0].edges == 0
        assert len(ss.graphs()) == 2
        for _ in range(2):
            again = ss.run(script, goal=6, first=1)
            assert again.value == first.value
        assert calls(again) == 0
    orphans = "SELECT count(*) FROM ss2sql_edges WHERE source NOT IN (SELECT id FROM ss2sql_nodes)"
    assert asked(file, orphans) == [(0,)]


def test_scripts_read_the_tables_and_never_write_them(file: Path) -> None:
    with connect(file) as ss:
        run(ss, bound=2)
        assert ss.eval("len(SELECT row FROM ss2sql_edges)") == 3 * len({1, 2, 3, 0})
        again = ss.run("SELECT row FROM ss2sql_edges START WITH n = 0 CONNECT BY MEMORIZE 1 n = n + 1")
        assert any("belongs to ss2sql" in note for note in again.stats.notes)
        assert len(ss.graphs()) == 1


def test_tables_that_are_spoilt(file: Path) -> None:
    with connect(file) as ss:
        run(ss)
    write(file, "UPDATE ss2sql_edges SET row = 'no JSON'")
    with connect(file) as ss, pytest.raises(ss2sql.ExecutionError, match="remembered graphs cannot be read") as caught:
        run(ss)
    assert "disable=['remember']" in str(caught.value)
    write(file, "DROP TABLE ss2sql_verdicts")
    with connect(file) as ss, pytest.raises(ss2sql.ExecutionError, match="'ss2sql_verdicts' is missing"):
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


def test_tables_of_the_file_are_not_read_anew_after_each_run(file: Path) -> None:
    write(file, "CREATE TABLE edges(src INTEGER, dst INTEGER); INSERT INTO edges VALUES (1, 2), (2, 3), (3, 1)")
    script = """SELECT e.dst FROM e = (SELECT * FROM edges WHERE src == node) START WITH node = 1
    CONNECT BY MEMORIZE node = name(e.dst) AS list"""
    with session(file, name=lambda n: n) as ss:
        assert ss.eval(script) == [[2], [2, 3], [2, 3, 1]]
        known = ss.host.tables._known["main", "edges"]
        again = ss.run(script)
        assert again.value == [[2], [2, 3], [2, 3, 1]]
        assert calls(again) == 0
        assert ss.host.tables._known["main", "edges"] is known
        write(file, "INSERT INTO edges VALUES (2, 9)")
        assert ss.eval(script) == [[2], [2, 3], [2, 9], [2, 3, 1]]
        assert len(ss.graphs()) == 2


def test_both_ends_give_way_where_calls_are_saved(file: Path) -> None:
    script = """SELECT d.this, n FROM d = [1, 2] WHERE n + d.this == 6
    START WITH n = 0 CONNECT BY MEMORIZE 4 n = n + d.this STOP WITH {} AS list"""
    with session(file, is_wall=lambda n: n == 3) as ss:
        first, again = (ss.run(script.format("is_wall(n + d.this)")) for _ in range(2))
        assert (again.value, calls(again)) == (first.value, 0)
        free = ss.run(script.format("n + d.this == 3"))
        assert free.value == first.value
        assert any("from both ends" in note for note in free.stats.notes)


def test_a_large_number_of_levels(file: Path) -> None:
    script = "SELECT next(n) FROM [0] START WITH n = 0 CONNECT BY MEMORIZE n = next(n) STOP WITH n > 2000 AS list"
    with session(file, next=lambda n: n + 1) as ss:
        first, again = (ss.run(script, maximum=1) for _ in range(2))
        assert (again.value, calls(again)) == (first.value, 0)
        assert ss.graphs()[0].edges == 2002  # from 0 to 2001


def test_other_processes_are_not_asked_for_what_is_known(file: Path) -> None:
    with connect(file) as ss:
        first = run(ss)
        again = ss.run(MAZE.replace("bound", "4"), workers=2, goal=6, first=1, limit=40)
        assert (again.value, calls(again)) == (first.value, 0)


def test_a_run_that_is_broken_off_keeps_what_it_has_found_out(file: Path) -> None:
    with connect(file) as ss:
        with pytest.raises(ss2sql.ExecutionError, match="max_rows"):
            ss.run(MAZE.replace("bound", "6"), goal=6, first=1, limit=400, max_rows=20)
        (graph,) = ss.graphs()
        assert graph.edges % 3 == 0
        wanted, again = scratch(bound=6, limit=400), run(ss, bound=6, limit=400)
        assert again.value == wanted.value
        assert calls(again) == calls(wanted) - graph.edges // 3
