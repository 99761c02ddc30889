"""The rows that a search has met: which are equal, which come first, and who remembers them."""

from __future__ import annotations

import random
from typing import Any

import pytest
from agreement import differences
from programs import ProgramCase
from reference import Reference
from sessions import both

import ss2sql
from ss2sql.runtime.search_functions import SearchState

GRAPH = [(0, 1), (0, 2), (1, 3), (2, 3), (3, 0), (3, 4), (4, 4), (2, 4), (2, 3)]

NODES: dict[str, list[Any]] = {
    "whole": [0, 1, 2, 3, 4, 5],
    "text": ["", "a", "A", "1", "b"],
    "numbers": [0, 1, 1.0, 2, 2.0, 0.5, -0.0],
    "mixed": [None, 0, 1, 1.0, "1", "a", 2.5],
    "lists": [[1], [1.0], [], [[]], [1, 2], 1],
    "bools": [True, 1, 1.0, False, 0, None],
}
IN_TABLES = ("whole", "text", "numbers", "mixed")
OPTIONS = ("UNIQUE", "BREADTH FIRST UNIQUE", "DEPTH FIRST UNIQUE", "COST w UNIQUE", "PROBABILITY 1 / (1 + w) UNIQUE")
ROWS = ("dst", "src, dst", "dst, w", "src", "to(dst, name)", "node", "node, dst", "dst, level")


def literal(value: Any) -> str:
    return repr(value)


def program(chance: random.Random) -> ProgramCase:
    """A search over random edges: in a table or a list, looked up, filtered or walked."""
    kind = chance.choice(list(NODES))
    nodes, table = NODES[kind], kind in IN_TABLES and chance.random() < 0.6
    edges = [
        {"src": chance.choice(nodes), "dst": chance.choice(nodes), "w": chance.randrange(3)}
        for _ in range(chance.randrange(1, 14))
    ]
    row = chance.choice(ROWS)
    bounded = "level" in row or "NO CYCLE" in row or chance.random() < 0.3
    option = chance.choice(OPTIONS) if chance.random() < 0.85 or not bounded else "NO CYCLE"
    maximum = f" MAXIMUM {chance.randrange(1, 4)}" if chance.random() < 0.4 else ""
    where, stops = [], ["level == 4"] if bounded else []
    goal = literal(chance.choice(nodes))
    source = "(SELECT * FROM edges WHERE src == node)"
    form = chance.random()
    if form < 0.2:
        source, where = "edges", ["src == node"]
        stops.append("src != node")
    elif form < 0.3:
        source = "(SELECT * FROM edges WHERE src == node AND w > 0)"
    elif form < 0.4:
        source += ", twice = [0, 1]"
    if chance.random() < 0.5:
        where.append(
            chance.choice([f"dst == {goal}", f"dst != {goal}", "w == 1", "level > 1", f"src == {goal} OR w > 1"])
        )
    if chance.random() < 0.3:
        stops.append(chance.choice([f"dst == {goal}", "w == 2", f"node == {goal}"]))
    parts = [
        f"SELECT {row} FROM {source}",
        "WHERE " + " AND ".join(where) if where else "",
        f"START WITH node = {literal(chance.choice(nodes))}, level = 1",
        f"CONNECT BY {option}{maximum} node = dst, level = level + 1",
        "STOP WITH " + " OR ".join(stops) if stops else "",
        chance.choice(["", "", "", "ORDER BY w", "GROUP BY w"]),
        chance.choice(["", "", "LIMIT 2"]),
        chance.choice(["", "AS list", "AS rows"]),
    ]
    script = " ".join(part for part in parts if part) + ";"
    return ProgramCase(script, {} if table else {"edges": edges}, (), {"edges": edges} if table else {})


@pytest.mark.parametrize("number", range(120))
def test_three_evaluators_agree_on_searches_over_edges(number: int) -> None:
    case = program(random.Random(number))
    assert differences(case) == [], case


def test_the_programs_run_in_the_database() -> None:
    count = 0
    for number in range(120):
        case = program(random.Random(number))
        with ss2sql.connect() as ss:
            for name, value in (case.variables | case.tables).items():
                ss.attach(name, value)
            count += "-- no SQL" not in ss.compile(case.script).sql
    assert count > 100


def session_of_graph(table: bool) -> ss2sql.Session:
    ss = ss2sql.connect()
    if table:
        ss.host.connection.execute("CREATE TABLE edges(src, dst)")
        ss.host.connection.executemany("INSERT INTO edges VALUES (?, ?)", GRAPH)
    else:
        ss.attach("edges", [{"src": src, "dst": dst} for src, dst in GRAPH])
    return ss


SEARCH = """SELECT dst FROM (SELECT * FROM edges WHERE src == node)
    START WITH node = 0 CONNECT BY UNIQUE node = dst AS list;"""


@both
@pytest.mark.parametrize("table", [True, False])
def test_the_first_path_to_a_row_counts_and_every_edge_is_looked_at_once(engine: Any, table: bool) -> None:
    with session_of_graph(table) as ss:
        result = ss.run(SEARCH, engine=engine)
    assert result.value == [[1], [2], [1, 3], [2, 4], [1, 3, 0]]
    # The edges of 0 are walked from the start and from the row 0; those of 1, 2, 3 and 4 once.
    assert result.stats.generated == 2 + 9
    assert result.stats.expanded == 5
    assert result.stats.pruned == 11 - 5


def test_the_steps_are_those_of_the_reference() -> None:
    judge = Reference(tables={"edges": [{"src": src, "dst": dst} for src, dst in GRAPH]})
    judge.run(SEARCH)
    with session_of_graph(True) as ss:
        assert ss.run(SEARCH, engine="database").stats.generated == judge.steps


@both
def test_a_row_keeps_the_form_in_which_it_was_reached_first(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE edges(src, dst)")
        ss.host.connection.executemany("INSERT INTO edges VALUES (?, ?)", [(0, 1.0), (0, 1), (1, None), (None, "1")])
        value = ss.run(SEARCH, engine=engine).value
    assert [[(type(cell), cell) for cell in path] for path in value] == [
        [(float, 1.0)],
        [(float, 1.0), (type(None), None)],
        [(float, 1.0), (type(None), None), (str, "1")],
    ]


def test_rows_of_one_column_have_a_function_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: SearchState, *row: Any) -> int:
        raise AssertionError(row)

    monkeypatch.setattr(SearchState, "reached", fail)
    with session_of_graph(True) as ss:
        assert len(ss.run(SEARCH, engine="database").value) == 5


@both
def test_a_search_inside_a_search_has_its_own_rows(engine: Any) -> None:
    with session_of_graph(True) as ss:
        inner = ss.compile("SELECT dst FROM (SELECT * FROM edges WHERE src == node) START WITH node = begin "
                           "CONNECT BY UNIQUE node = dst AS list;", engine=engine)  # fmt: skip

        @ss.function("behind", volatility="immutable")
        def behind(node: int) -> int:
            return len(inner.run(begin=node).value)

        outer = ss.run(SEARCH.replace("START", "WHERE behind(dst) > 1 START"), engine=engine)
    # From 0, 1, 2 and 3 all five are reached, from 4 only 4.
    assert outer.value == [[1], [2], [1, 3], [1, 3, 0]]
    assert outer.stats.expanded == 5


def test_sqlite_keeps_pages_and_copies_in_memory() -> None:
    with ss2sql.connect() as ss:
        assert ss.host.connection.execute("PRAGMA temp_store").get == 2
        assert ss.host.connection.execute("PRAGMA cache_size").get == -65536


@both
def test_the_first_state_may_equal_a_goal_in_another_form(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.attach("edges", [{"src": [1.0], "dst": 5}])
        search = SEARCH.replace("node = 0", "node = [1.0]").replace(
            "node = dst AS", "node = dst STOP WITH node == [1] AS"
        )
        assert ss.run(search, engine=engine).value == []
