"""Searches over tables that are looked up by several columns: `px == x + dx AND py == y + dy`."""

from __future__ import annotations

import random
from collections.abc import Iterator

import apsw
import pytest
from test_search_tables import machine_steps

import ss2sql

MOVES = [{"dx": 1, "dy": 0}, {"dx": 0, "dy": 1}, {"dx": 1, "dy": 1}]

# How the table is made, and what sorts it: the rowid (None where a cell may stand in several rows), or its key.
CELLS = "CREATE TABLE cells(px INTEGER, py INTEGER, name)"
KEYED = "CREATE TABLE cells(px INTEGER, py INTEGER, name, PRIMARY KEY ({})) WITHOUT ROWID"
TABLES = {
    "no index": ([CELLS], None),
    "index": ([CELLS, "CREATE INDEX i ON cells(px, py)"], None),
    "other way round": ([CELLS, "CREATE INDEX i ON cells(py DESC, px)"], None),
    "one and both": ([CELLS, "CREATE INDEX i ON cells(px)", "CREATE INDEX j ON cells(px, py)"], None),
    "three": ([CELLS, "CREATE INDEX i ON cells(px, py, name DESC)"], None),
    "untyped": (["CREATE TABLE cells(px, py, name)", "CREATE INDEX i ON cells(px, py)"], None),
    "partly typed": (["CREATE TABLE cells(px INTEGER, py, name)", "CREATE INDEX i ON cells(py, px)"], None),
    "unique": ([CELLS, "CREATE UNIQUE INDEX i ON cells(px, py)"], "rowid"),
    "key": (["CREATE TABLE cells(px INTEGER, py INTEGER, name, PRIMARY KEY (px, py))"], "rowid"),
    "without rowid": ([KEYED.format("px, py")], "px, py"),
    "descending": ([KEYED.format("px DESC, py DESC")], "px, py"),
    "wider key": ([KEYED.format("name, px, py"), "CREATE INDEX i ON cells(px, py)"], "name, px, py"),
    "wider descending": ([KEYED.format("name DESC, px, py"), "CREATE INDEX i ON cells(px, py)"], "name, px, py"),
}
TAIL = "START WITH x = 0, y = 0, level = 0 CONNECT BY {option} x = px, y = py, level = level + 1"
FORMS = {
    "query": "SELECT px, py, name FROM moves, (SELECT * FROM cells WHERE px == x + dx AND py == y + dy) "
    f"{TAIL} STOP WITH level == 3 AS rows;",
    "stop": f"SELECT px, py, name FROM moves, cells {TAIL} "
    "STOP WITH px != x + dx OR py != y + dy OR level == 3 AS rows;",
    "where": f"SELECT px, py, name FROM moves, cells WHERE px == x + dx AND py == y + dy {TAIL} "
    "STOP WITH px != x + dx OR py != y + dy OR level == 3 AS rows;",
    "table first": f"SELECT px, py, name FROM cells, moves {TAIL} "
    "STOP WITH px != x + dx OR py != y + dy OR level == 3 AS rows;",
}


def filled(table: str) -> tuple[ss2sql.Session, list[tuple[int, int, str]]]:
    """A session with the table, and the rows in its order: two for some cells where the table takes them."""
    statements, order = TABLES[table]
    rng = random.Random(5)
    rows = [(rng.randrange(4), rng.randrange(4), name) for name in "qwertyuiopasdfghjkl"]
    if order in ("rowid", "px, py"):
        rows = list({row[:2]: row for row in rows}.values())
    session = ss2sql.connect()
    for statement in statements:
        session.host.connection.execute(statement)
    session.host.connection.executemany("INSERT INTO cells VALUES (?, ?, ?)", rows)
    session.set("moves", MOVES)
    if order == "px, py":
        rows.sort()
    elif order == "name, px, py":
        rows.sort(key=lambda row: (row[2], *row[:2]))
    return session, rows


def walked(rows: list[tuple[int, int, str]], longest: int, table_first: bool) -> Iterator[list[tuple[int, int, str]]]:
    """All paths of one to so many cells from (0, 0), depth first."""

    def neighbours(x: int, y: int) -> Iterator[tuple[int, int, str]]:
        places = [(x + move["dx"], y + move["dy"]) for move in MOVES]
        if table_first:
            return (row for row in rows if row[:2] in places)
        return (row for place in places for row in rows if row[:2] == place)

    def below(x: int, y: int, path: list[tuple[int, int, str]]) -> Iterator[list[tuple[int, int, str]]]:
        for row in neighbours(x, y):
            yield [*path, row]
            if len(path) + 1 < longest:
                yield from below(row[0], row[1], [*path, row])

    return below(0, 0, [])


def plan_of(session: ss2sql.Session, result: ss2sql.Result) -> str:
    nothing = dict.fromkeys(result.sql.parameters)
    rows = session.host.connection.execute(f"EXPLAIN QUERY PLAN {result.sql}", nothing)
    return "\n".join(row[3] for row in rows)


@pytest.mark.parametrize("form", list(FORMS))
@pytest.mark.parametrize("table", list(TABLES))
def test_rows_come_in_order_whatever_index_finds_them(table: str, form: str) -> None:
    session, rows = filled(table)
    # A step that stops is a result only where WHERE says so.
    wanted = list(walked(rows, 4 if form == "where" else 3, form == "table first"))
    assert len(wanted) > 9
    for option in ("", "BREADTH FIRST"):
        if option:
            wanted.sort(key=len)
        for engine in ("database", "native"):
            found = session.run(FORMS[form].format(option=option), engine=engine).value  # type: ignore[arg-type]
            assert found == wanted, (option, engine)


@pytest.mark.parametrize(
    ("table", "used"),
    [
        ("index", "INDEX i (px=? AND py=?)"),
        ("other way round", "INDEX i (py=? AND px=?)"),
        ("one and both", "INDEX j (px=? AND py=?)"),
        ("unique", "INDEX i (px=? AND py=?)"),
        ("key", "INDEX sqlite_autoindex_cells_1 (px=? AND py=?)"),
        ("without rowid", "PRIMARY KEY (px=? AND py=?)"),
        ("descending", "PRIMARY KEY (px=? AND py=?)"),
        ("wider key", "INDEX i (px=? AND py=?)"),
        ("no index", "AUTOMATIC COVERING INDEX (px=? AND py=?)"),
        ("three", "AUTOMATIC COVERING INDEX (px=? AND py=?)"),
    ],
)
@pytest.mark.parametrize("form", ["query", "stop", "where"])
def test_both_columns_are_looked_up(table: str, used: str, form: str) -> None:
    session, _ = filled(table)
    result = session.run(FORMS[form].format(option=""), engine="database")
    found = plan_of(session, result).replace("USING COVERING", "USING")
    assert found.count(f"USING {used}") == 2  # for the first steps, and for all others


@pytest.mark.parametrize("test", [
    "[] == (SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS list)",
    "NOT (SELECT * FROM cells WHERE px == x + dx AND py == y + dy)",
    "len(SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS list) == 0",
    "None == (SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS value)",
])  # fmt: skip
@pytest.mark.parametrize("table", ["index", "key", "without rowid", "descending"])
def test_a_query_in_a_condition_looks_up_both_columns(table: str, test: str) -> None:
    session, rows = filled(table)
    script = f"""SELECT to(x + dx, px), to(y + dy, py) FROM moves START WITH x = 0, y = 0
        CONNECT BY BREADTH FIRST UNIQUE x = x + dx, y = y + dy STOP WITH {test} AS rows;"""
    free = {row[:2] for row in rows}
    reached = {path[-1][:2] for path in walked(rows, 3, False)}
    result = session.run(script, engine="database")
    assert {path[-1] for path in result.value} >= reached
    assert {place for path in result.value for place in path} <= free
    assert result.value == session.run(script, engine="native").value
    found = plan_of(session, result)
    assert "(px=? AND py=?)" in found
    assert "SCAN cells" not in found


GRID = """SELECT px, py FROM moves, (SELECT * FROM cells WHERE px == x + dx AND py == y + dy)
    START WITH x = 1, y = 1 CONNECT BY COST 1 UNIQUE x = px, y = py;"""


def grid(size: int) -> ss2sql.Session:
    session = ss2sql.connect()
    session.host.connection.execute(TABLES["without rowid"][0][0])
    rows = [(x, y, None) for x in range(1, size + 1) for y in range(1, size + 1)]
    session.host.connection.executemany("INSERT INTO cells VALUES (?, ?, ?)", rows)
    session.set("moves", MOVES)
    return session


def test_a_search_costs_its_steps_not_the_table() -> None:
    (small, _), (large, _) = (machine_steps(grid(size), GRID) for size in (20, 40))
    assert small > 1_000
    assert large < 4.4 * small  # a quarter of the cells


@pytest.mark.parametrize("form", ["query", "stop", "where"])
def test_natively_too(form: str) -> None:
    """As many steps as there are neighbours."""
    session, _ = filled("no index")
    script = FORMS[form].format(option="")
    steps = [session.run(script, engine=engine).stats.generated for engine in ("database", "native")]  # type: ignore[arg-type]
    assert steps[0] == steps[1] > 9


def test_a_cell_that_is_far_away_comes_later() -> None:
    """With it, a sum of a column may leave 64 bits, so SQLite cannot compute it alone any more."""
    session, _ = filled("without rowid")
    script = FORMS["query"].format(option="")
    query = session.compile(script, engine="database")
    first = query.run().value
    connection: apsw.Connection = session.host.connection
    connection.execute(f"INSERT INTO cells VALUES (1, {2**63 - 1}, 'far')")
    assert query.run().value == first
    connection.execute(f"INSERT INTO cells VALUES ({2**63 - 1}, 0, 'farther')")
    session.set("moves", [*MOVES, {"dx": 2**63 - 1, "dy": 0}])
    with pytest.raises(ss2sql.ExecutionError) as caught:  # the next step from there adds 1
        session.run(script)
    assert caught.value.code == "X004"
    with pytest.raises(ss2sql.UnsupportedError, match="integer overflow: 9223372036854775808"):
        query.run()  # SQLite alone cannot say whether that comes first
