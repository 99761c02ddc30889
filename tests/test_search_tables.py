"""Searches over tables of the database: which index finds the rows, and that they come in the order of the table."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

import apsw
import pytest
from sessions import both

import ss2sql

EDGES = [(rng.randrange(12), rng.randrange(12)) for rng in [random.Random(3)] for _ in range(40)]

# How the table is made, what indexes it, and what its own order is: the rowid, or the key in its words.
ROWID = "CREATE TABLE edge(src, dst)"
TABLES = {
    "no index": ([ROWID], None),
    "index": ([ROWID, "CREATE INDEX i ON edge(src)"], None),
    "descending": ([ROWID, "CREATE INDEX i ON edge(src DESC)"], None),
    "with the other": ([ROWID, "CREATE INDEX i ON edge(src, dst DESC)"], None),
    "the other first": ([ROWID, "CREATE INDEX i ON edge(dst DESC, src)"], None),
    "partial": ([ROWID, "CREATE INDEX i ON edge(src) WHERE src > 5"], None),
    "expression": ([ROWID, "CREATE INDEX i ON edge(src + 0, dst DESC)"], None),
    "several": (
        [ROWID, "CREATE INDEX a ON edge(src, dst DESC)", "CREATE INDEX b ON edge(dst)", "CREATE INDEX c ON edge(src)"],
        None,
    ),
    "whole numbers": (["CREATE TABLE edge(src INTEGER, dst INTEGER)", "CREATE INDEX i ON edge(src)"], None),
    "text": (["CREATE TABLE edge(src TEXT, dst TEXT)", "CREATE INDEX i ON edge(src)"], None),
    "nocase": (["CREATE TABLE edge(src TEXT COLLATE NOCASE, dst)", "CREATE INDEX i ON edge(src)"], None),
    "nocase index": ([ROWID, "CREATE INDEX i ON edge(src COLLATE NOCASE)"], None),
    "key": (["CREATE TABLE edge(src, dst, PRIMARY KEY (src, dst))"], None),
    "key of one": (["CREATE TABLE edge(src, dst UNIQUE, n INTEGER PRIMARY KEY)"], "unique"),
    "without rowid": (["CREATE TABLE edge(src, dst, PRIMARY KEY (src, dst)) WITHOUT ROWID"], "src, dst"),
    "descending key": (["CREATE TABLE edge(src, dst, PRIMARY KEY (src, dst DESC)) WITHOUT ROWID"], "src, dst"),
    "other key": (
        ["CREATE TABLE edge(src, dst, PRIMARY KEY (dst, src)) WITHOUT ROWID", "CREATE INDEX i ON edge(src)"],
        "dst, src",
    ),
}
LETTERS = ("text", "nocase")
tables = pytest.mark.parametrize("table", list(TABLES))
SEARCHES = {
    "stop": "SELECT src, dst FROM edge START WITH node = {start} CONNECT BY {option} node = dst, level = level + 1 "
    "STOP WITH src != node OR level == 4;",
    "where": "SELECT src, dst FROM edge WHERE src == node START WITH node = {start} CONNECT BY {option} node = dst, "
    "level = level + 1 STOP WITH src != node OR level == 4;",
    "query": "SELECT src, dst FROM (SELECT * FROM edge WHERE src == node) START WITH node = {start} "
    "CONNECT BY {option} node = dst, level = level + 1 STOP WITH level == 4;",
    "other side": "SELECT src, dst FROM edge START WITH node = {start} CONNECT BY {option} node = src, "
    "level = level + 1 STOP WITH level == 4 OR NOT node == dst;",
}
SEARCHES = {
    name: text.replace("= {start}", "= {start}, level = 1").replace(
        "level == 4", "level == 3" if name == "where" else "level == 4"
    )
    for name, text in SEARCHES.items()
}


def filled(table: str, mixed: bool = False, **options: Any) -> tuple[ss2sql.Session, list[tuple[Any, Any]]]:
    """A session with the table, and the rows in the order of the table."""
    statements, order = TABLES[table]
    session = ss2sql.connect(**options)
    connection = session.host.connection
    for statement in statements:
        connection.execute(statement)
    rows: list[tuple[Any, Any]] = [*EDGES]
    if mixed:  # numbers in two forms, and words that NOCASE takes for equal
        rows = [(src, float(dst) if dst == 3 else dst) for src, dst in EDGES]
        rows += [(None, 1), (1, None), ("a", "A"), ("A", "b"), (2, "a"), ("b", 2), ("A", "a"), ("0", "1"), (0, "0")]
    if table == "whole numbers":
        rows = [row for row in rows if all(type(cell) is int for cell in row)]
    if table in LETTERS:
        # Letters that NOCASE takes for equal; the words of the mixed ones stay.
        rows = [("abAB"[src % 4], "abAB"[dst % 4]) for src, dst in EDGES] + [
            (str(src), str(dst)) for src, dst in rows[len(EDGES) :]
        ]
    rows = [row for row in rows if None not in row] if order else rows
    rows = list(dict.fromkeys(rows)) if order or table.endswith("key") else rows
    if order == "unique":
        rows = list({dst: (src, dst) for src, dst in rows}.values())
    connection.executemany("INSERT INTO edge(src, dst) VALUES (?, ?)", rows)
    if order and order != "unique":
        # Numbers before words, as SQLite sorts them.
        places = (0, 1) if order == "src, dst" else (1, 0)
        rows.sort(key=lambda row: [(type(row[place]) is str, row[place]) for place in places])
    return session, rows


def walked(rows: list[tuple[Any, Any]], start: Any, backwards: bool = False) -> Iterator[list[tuple[Any, Any]]]:
    """All paths of one to three edges from the start, depth first, rows in their order."""

    def below(node: Any, path: list[tuple[Any, Any]]) -> Iterator[list[tuple[Any, Any]]]:
        for row in rows:
            if len(path) < 3 and row[backwards] == node:
                yield [*path, row]
                yield from below(row[not backwards], [*path, row])

    return below(start, [])


@tables
@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("search", list(SEARCHES))
def test_rows_come_in_the_order_of_the_table_whatever_its_indexes(table: str, search: str, mixed: bool) -> None:
    found = 0
    switches: list[dict[str, Any]] = [{}, {"disable": ["lookup"]}]
    for options in switches:
        session, rows = filled(table, mixed, **options)
        starts: list[Any] = ["a", "A", "b", "None"] if table in LETTERS else [0, 2.0, "A"]
        for start in starts:
            wanted = list(walked(rows, start, search == "other side"))
            found += len(wanted)
            for option in ("", "BREADTH FIRST"):
                session.set("here", start)
                script = SEARCHES[search].format(option=option, start="here")
                if option:
                    wanted.sort(key=len)
                for engine in ("database", "native"):
                    result = session.run(script, engine=engine)  # type: ignore[arg-type]
                    assert repr(result.paths) == repr(wanted), (options, start, option, engine)
    assert found > 5 if table == "key of one" else found > 50


def plan_of(session: ss2sql.Session, result: ss2sql.Result) -> str:
    rows = session.host.connection.execute(f"EXPLAIN QUERY PLAN {result.sql}", result.sql.parameters)
    return "\n".join(row[3] for row in rows)


@pytest.mark.parametrize("search", ["stop", "where", "query"])
@pytest.mark.parametrize(
    ("table", "wanted"),
    [("index", "USING INDEX i (src=?)"), ("descending", "USING INDEX i (src=?)"), ("several", "USING INDEX c (src=?)")],
)
def test_an_index_of_the_user_finds_the_rows(table: str, wanted: str, search: str) -> None:
    session, _ = filled(table)
    result = session.run(SEARCHES[search].format(option="", start=0), engine="database")
    assert wanted in plan_of(session, result).replace("COVERING ", "")
    session, _ = filled("without rowid")
    result = session.run(SEARCHES[search].format(option="", start=0), engine="database")
    assert "USING PRIMARY KEY (src=?)" in plan_of(session, result)


@both
def test_indexes_that_come_and_go_between_runs(engine: Any) -> None:
    session, rows = filled("no index")
    connection = session.host.connection
    query = session.compile(SEARCHES["stop"].format(option="", start=0))
    wanted = list(walked(rows, 0))
    for change, used in (
        ("SELECT 1", None),
        ("CREATE INDEX i ON edge(src)", "i"),
        ("DROP INDEX i", None),
        ("CREATE INDEX i ON edge(src DESC, dst)", None),  # which has the rows in another order
        ("CREATE INDEX j ON edge(src)", "j"),
        ("DROP INDEX i", "j"),
        ("DROP INDEX j", None),
        ("CREATE INDEX j ON edge(src) WHERE src > 3", None),
    ):
        connection.execute(change)
        result = query.run(engine=engine)
        assert repr(result.paths) == repr(wanted), change
        if engine == "database":
            found = [name for name in "ij" if f"USING INDEX {name} (src=?)" in plan_of(session, result)]
            assert set(found) == ({used} if used else set()), change


def machine_steps(session: ss2sql.Session, script: str) -> tuple[int, int]:
    """The instructions that SQLite runs for a search, and the number of its paths."""
    steps: list[int] = []

    def note(event: dict[str, Any]) -> None:
        if "RECURSIVE" in event["sql"]:
            steps.append(event["stmt_status"]["SQLITE_STMTSTATUS_VM_STEP"])

    session.host.connection.trace_v2(apsw.SQLITE_TRACE_PROFILE, note)
    paths = session.run(script, engine="database").paths
    session.host.connection.trace_v2(0, None)
    return sum(steps), len(paths)


STAFF = "SELECT name FROM staff {} START WITH boss = 0 CONNECT BY {} boss = id STOP WITH manager != boss;"


@pytest.mark.parametrize("where", ["", "WHERE manager == boss AND id > 0"])
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "COST 1"])
@pytest.mark.parametrize("index", [False, True])
def test_a_hierarchy_costs_its_size(index: bool, option: str, where: str) -> None:
    """Each of the staff leads three others, so depths differ little between 1,000 and 2,000 of them."""

    def cost(size: int) -> int:
        session = ss2sql.connect()
        connection = session.host.connection
        connection.execute("CREATE TABLE staff(id INTEGER, manager INTEGER, name TEXT)")
        if index:
            connection.execute("CREATE INDEX by_manager ON staff(manager)")
        rows = [(number, (number + 1) // 3, f"n{number}") for number in range(1, size + 1)]
        connection.executemany("INSERT INTO staff VALUES (?, ?, ?)", rows)
        steps, paths = machine_steps(session, STAFF.format(where, option))
        assert paths == size
        return steps

    small, large = cost(1_000), cost(2_000)
    assert small > 1_000
    assert large < 2.3 * small


def with_edges(*rows: tuple[int, ...]) -> ss2sql.Session:
    """A session with indexed edges: from, to, length."""
    ss = ss2sql.connect()
    connection = ss.host.connection
    connection.execute("CREATE TABLE edge(src INTEGER, dst INTEGER, length INTEGER); CREATE INDEX i ON edge(src)")
    connection.executemany("INSERT INTO edge VALUES (?, ?, ?)", rows)
    return ss


@pytest.mark.parametrize("engine", ["database", "native"])
def test_rows_that_are_compared_are_made_of_every_element(engine: Any) -> None:
    """An index may not spare what fails in the row of a step that leads nowhere; BREADTH FIRST alone needs no row."""
    ss = with_edges((1, 2, 5), (2, 3, 4), (7, 8, 0))
    search = "SELECT 1 / length FROM edge START WITH node = 1 CONNECT BY {} node = dst STOP WITH src != node AS list;"
    assert ss.run(search.format("BREADTH FIRST"), engine=engine).value == [[0.2], [0.2, 0.25]]
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(search.format("UNIQUE"), engine=engine)
    assert caught.value.code == "X002"


@pytest.mark.parametrize("engine", ["database", "native"])
def test_what_is_looked_up_is_not_asked_again(engine: Any) -> None:
    """The rest of STOP WITH is: both of its other parts."""
    ss = with_edges((1, 2, 0), (2, 3, 0), (2, 9, 0), (3, 4, 0), (4, 5, 0))
    search = (
        "SELECT dst FROM edge START WITH node = 1 CONNECT BY BREADTH FIRST node = dst "
        "STOP WITH src != node OR dst == 9 OR dst > 3 AS list;"
    )
    assert ss.run(search, engine=engine).value == [[2], [2, 3]]
