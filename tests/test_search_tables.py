"""Searches over tables of the database: which index finds the rows, and that they come in the order of the table."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Any

import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sessions import ENGINES

import ss2sql
from ss2sql.runtime.search.edge_walk import walk_edges

Row = tuple[Any, ...]

# --- one column: `src == node` -------------------------------------------------------------------------

EDGES = [(rng.randrange(12), rng.randrange(12)) for rng in [random.Random(3)] for _ in range(40)]
ROWID = "CREATE TABLE edge(src, dst)"
KEYED = "CREATE TABLE edge(src, dst, PRIMARY KEY ({})) WITHOUT ROWID"
TABLES = {
    "no index": ROWID,
    "index": f"{ROWID}; CREATE INDEX i ON edge(src)",
    "descending": f"{ROWID}; CREATE INDEX i ON edge(src DESC)",
    "with the other": f"{ROWID}; CREATE INDEX i ON edge(src, dst DESC)",
    "the other first": f"{ROWID}; CREATE INDEX i ON edge(dst DESC, src)",
    "partial": f"{ROWID}; CREATE INDEX i ON edge(src) WHERE src > 5",
    "expression": f"{ROWID}; CREATE INDEX i ON edge(src + 0, dst DESC)",
    "several": f"{ROWID}; CREATE INDEX a ON edge(src, dst DESC); CREATE INDEX b ON edge(dst);"
    " CREATE INDEX c ON edge(src)",
    "whole numbers": "CREATE TABLE edge(src INTEGER, dst INTEGER); CREATE INDEX i ON edge(src)",
    "text": "CREATE TABLE edge(src TEXT, dst TEXT); CREATE INDEX i ON edge(src)",
    "nocase": "CREATE TABLE edge(src TEXT COLLATE NOCASE, dst); CREATE INDEX i ON edge(src)",
    "nocase index": f"{ROWID}; CREATE INDEX i ON edge(src COLLATE NOCASE)",
    "key": "CREATE TABLE edge(src, dst, PRIMARY KEY (src, dst))",
    "key of one": "CREATE TABLE edge(src, dst UNIQUE, n INTEGER PRIMARY KEY)",
    "without rowid": KEYED.format("src, dst"),
    "descending key": KEYED.format("src, dst DESC"),
    "other key": f"{KEYED.format('dst, src')}; CREATE INDEX i ON edge(src)",
}
LETTERS = ("text", "nocase")
# The places of the columns by which a table is sorted that has no rowid.
SORTED = {"without rowid": (0, 1), "descending key": (0, 1), "other key": (1, 0)}
TAIL = "START WITH node = {start}, level = 1 CONNECT BY {option} node = dst, level = level + 1 STOP WITH"
SEARCHES = {
    "stop": f"SELECT src, dst FROM edge {TAIL} src != node OR level == 4;",
    "where": f"SELECT src, dst FROM edge WHERE src == node {TAIL} src != node OR level == 3;",
    "query": f"SELECT src, dst FROM (SELECT * FROM edge WHERE src == node) {TAIL} level == 4;",
    "other side": f"SELECT src, dst FROM edge {TAIL.replace('dst', 'src')} level == 4 OR NOT node == dst;",
}


def filled(table: str, mixed: bool = False, **options: Any) -> tuple[ss2sql.Session, list[Row]]:
    """A session with the table, and the rows in the order of the table."""
    session = ss2sql.connect(**options)
    session.host.connection.execute(TABLES[table])
    rows: list[Row] = [*EDGES]
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
    if table in SORTED or table == "key of one":
        rows = [row for row in rows if None not in row]
    if table in SORTED or table.endswith("key"):
        rows = list(dict.fromkeys(rows))
    if table == "key of one":
        rows = list({dst: (src, dst) for src, dst in rows}.values())
    session.host.connection.executemany("INSERT INTO edge(src, dst) VALUES (?, ?)", rows)
    if table in SORTED:  # numbers before words, as SQLite sorts them
        rows.sort(key=lambda row: [(type(row[place]) is str, row[place]) for place in SORTED[table]])
    return session, rows


def paths_of(start: Any, longest: int, step: Callable[[Any], Iterator[tuple[Row, Any]]]) -> list[list[Row]]:
    """All paths of so many rows at most, depth first; a step gives rows and the states behind them."""

    def below(state: Any, path: list[Row]) -> Iterator[list[Row]]:
        for row, behind in step(state) if len(path) < longest else ():
            yield [*path, row]
            yield from below(behind, [*path, row])

    return list(below(start, []))


def walked(rows: list[Row], start: Any, backwards: bool = False) -> list[list[Row]]:
    """All paths of one to three edges from the start."""
    return paths_of(start, 3, lambda node: ((row, row[not backwards]) for row in rows if row[backwards] == node))


@pytest.mark.parametrize("table", list(TABLES))
@pytest.mark.parametrize("mixed", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("search", list(SEARCHES))
def test_rows_come_in_the_order_of_the_table_whatever_its_indexes(table: str, search: str, mixed: bool) -> None:
    found = 0
    switches: list[dict[str, Any]] = [{}, {"disable": ["lookup"]}]
    for options in switches:
        session, rows = filled(table, mixed, **options)
        starts: list[Any] = ["a", "A", "b", "None"] if table in LETTERS else [0, 2.0, "A"]
        for start in starts:
            wanted = walked(rows, start, search == "other side")
            found += len(wanted)
            for option in ("", "BREADTH FIRST"):
                session.set("here", start)
                script = SEARCHES[search].format(option=option, start="here")
                if option:
                    wanted.sort(key=len)
                for engine in ENGINES:
                    result = session.run(script, engine=engine)
                    assert repr(result.paths) == repr(wanted), (options, start, option, engine)
    assert found > 5 if table == "key of one" else found > 50


def plan_of(session: ss2sql.Session, result: ss2sql.Result) -> str:
    """How SQLite runs the statement, be its indexes covering or not."""
    nothing = dict.fromkeys(result.sql.parameters)
    rows = session.host.connection.execute(f"EXPLAIN QUERY PLAN {result.sql}", nothing)
    return "\n".join(row[3] for row in rows).replace("USING COVERING", "USING")


@pytest.mark.parametrize("search", ["stop", "where", "query"])
@pytest.mark.parametrize(
    ("table", "wanted"),
    [("index", "INDEX i"), ("descending", "INDEX i"), ("several", "INDEX c"), ("without rowid", "PRIMARY KEY")],
)
def test_an_index_of_the_user_finds_the_rows(table: str, wanted: str, search: str) -> None:
    session, _ = filled(table)
    result = session.run(SEARCHES[search].format(option="", start=0), engine="database")
    assert f"USING {wanted} (src=?)" in plan_of(session, result)


def test_indexes_that_come_and_go_between_runs(engine: Any) -> None:
    session, rows = filled("no index")
    query = session.compile(SEARCHES["stop"].format(option="", start=0))
    wanted = walked(rows, 0)
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
        session.host.connection.execute(change)
        result = query.run(engine=engine)
        assert repr(result.paths) == repr(wanted), change
        if engine == "database":
            found = [name for name in "ij" if f"USING INDEX {name} (src=?)" in plan_of(session, result)]
            assert set(found) == ({used} if used else set()), change


# --- two columns: `px == x + dx AND py == y + dy` ------------------------------------------------------

MOVES = [{"dx": 1, "dy": 0}, {"dx": 0, "dy": 1}, {"dx": 1, "dy": 1}]
CELLS = "CREATE TABLE cells(px INTEGER, py INTEGER, name)"
CELLS_BY = "CREATE TABLE cells(px INTEGER, py INTEGER, name, PRIMARY KEY ({})) WITHOUT ROWID"
GRIDS = {
    "no index": CELLS,
    "index": f"{CELLS}; CREATE INDEX i ON cells(px, py)",
    "other way round": f"{CELLS}; CREATE INDEX i ON cells(py DESC, px)",
    "one and both": f"{CELLS}; CREATE INDEX i ON cells(px); CREATE INDEX j ON cells(px, py)",
    "three": f"{CELLS}; CREATE INDEX i ON cells(px, py, name DESC)",
    "untyped": "CREATE TABLE cells(px, py, name); CREATE INDEX i ON cells(px, py)",
    "partly typed": "CREATE TABLE cells(px INTEGER, py, name); CREATE INDEX i ON cells(py, px)",
    "unique": f"{CELLS}; CREATE UNIQUE INDEX i ON cells(px, py)",
    "key": "CREATE TABLE cells(px INTEGER, py INTEGER, name, PRIMARY KEY (px, py))",
    "without rowid": CELLS_BY.format("px, py"),
    "descending": CELLS_BY.format("px DESC, py DESC"),
    "wider key": f"{CELLS_BY.format('name, px, py')}; CREATE INDEX i ON cells(px, py)",
    "wider descending": f"{CELLS_BY.format('name DESC, px, py')}; CREATE INDEX i ON cells(px, py)",
}
ONCE = ("unique", "key", "without rowid", "descending")  # a cell stands in one row of these, in two of others
BEFORE = "START WITH x = 0, y = 0, level = 0 CONNECT BY {option} x = px, y = py, level = level + 1 STOP WITH"
OUTSIDE = f"{BEFORE} px != x + dx OR py != y + dy OR level == 3 AS rows;"
FORMS = {
    "query": "SELECT px, py, name FROM moves, (SELECT * FROM cells WHERE px == x + dx AND py == y + dy) "
    f"{BEFORE} level == 3 AS rows;",
    "stop": f"SELECT px, py, name FROM moves, cells {OUTSIDE}",
    "where": f"SELECT px, py, name FROM moves, cells WHERE px == x + dx AND py == y + dy {OUTSIDE}",
    "table first": f"SELECT px, py, name FROM cells, moves {OUTSIDE}",
}


def grid(table: str) -> tuple[ss2sql.Session, list[Row]]:
    """A session with the table of cells, and the rows in its order."""
    rng = random.Random(5)
    rows: list[Row] = [(rng.randrange(4), rng.randrange(4), name) for name in "qwertyuiopasdfghjkl"]
    if table in ONCE:
        rows = list({row[:2]: row for row in rows}.values())
    session = ss2sql.connect()
    session.host.connection.execute(GRIDS[table])
    session.host.connection.executemany("INSERT INTO cells VALUES (?, ?, ?)", rows)
    session.set("moves", MOVES)
    if table in ("without rowid", "descending"):
        rows.sort()
    elif "wider" in table:
        rows.sort(key=lambda row: (row[2], *row[:2]))
    return session, rows


def cells_from_the_corner(rows: list[Row], longest: int, table_first: bool = False) -> list[list[Row]]:
    def neighbours(place: Row) -> Iterator[tuple[Row, Row]]:
        places = [(place[0] + move["dx"], place[1] + move["dy"]) for move in MOVES]
        for group in [places] if table_first else [[one] for one in places]:
            yield from ((row, row[:2]) for row in rows if row[:2] in group)

    return paths_of((0, 0), longest, neighbours)


@pytest.mark.parametrize("form", list(FORMS))
@pytest.mark.parametrize("table", list(GRIDS))
def test_cells_come_in_order_whatever_index_finds_them(table: str, form: str) -> None:
    session, rows = grid(table)
    # A step that stops is a result only where WHERE says so.
    wanted = cells_from_the_corner(rows, 4 if form == "where" else 3, form == "table first")
    assert len(wanted) > 9
    for option in ("", "BREADTH FIRST"):
        if option:
            wanted.sort(key=len)
        found = [session.run(FORMS[form].format(option=option), engine=engine) for engine in ENGINES]
        assert [result.value for result in found] == [wanted, wanted], option
        # As many steps as there are neighbours, also natively.
        assert found[0].stats.generated == found[1].stats.generated > 9 or form == "table first"


@pytest.mark.parametrize(
    ("table", "used"),
    [
        ("index", "INDEX i (px=? AND py=?)"), ("other way round", "INDEX i (py=? AND px=?)"),
        ("one and both", "INDEX j (px=? AND py=?)"), ("unique", "INDEX i (px=? AND py=?)"),
        ("key", "INDEX sqlite_autoindex_cells_1 (px=? AND py=?)"), ("without rowid", "PRIMARY KEY (px=? AND py=?)"),
        ("descending", "PRIMARY KEY (px=? AND py=?)"), ("wider key", "INDEX i (px=? AND py=?)"),
        ("no index", "AUTOMATIC PARTIAL COVERING INDEX (px=? AND py=?)"),
        ("three", "AUTOMATIC PARTIAL COVERING INDEX (px=? AND py=?)"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("form", ["query", "stop", "where"])
def test_both_columns_are_looked_up(table: str, used: str, form: str) -> None:
    session, _ = grid(table)
    result = session.run(FORMS[form].format(option=""), engine="database")
    assert plan_of(session, result).count(f"USING {used}") == 1


@pytest.mark.parametrize("test", [
    "[] == (SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS list)",
    "NOT (SELECT * FROM cells WHERE px == x + dx AND py == y + dy)",
    "len(SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS list) == 0",
    "None == (SELECT name FROM cells WHERE px == x + dx AND py == y + dy AS value)",
])  # fmt: skip
@pytest.mark.parametrize("table", ["index", "key", "without rowid", "descending"])
def test_a_query_in_a_condition_looks_up_both_columns(table: str, test: str) -> None:
    session, rows = grid(table)
    script = f"""SELECT to(x + dx, px), to(y + dy, py) FROM moves START WITH x = 0, y = 0
        CONNECT BY BREADTH FIRST UNIQUE x = x + dx, y = y + dy STOP WITH {test} AS rows;"""
    free = {row[:2] for row in rows}
    reached = {path[-1][:2] for path in cells_from_the_corner(rows, 3)}
    result = session.run(script, engine="database")
    assert {path[-1] for path in result.value} >= reached
    assert {place for path in result.value for place in path} <= free
    assert result.value == session.run(script, engine="native").value
    found = plan_of(session, result)
    assert "(px=? AND py=?)" in found
    assert "SCAN cells" not in found


def test_a_cell_that_is_far_away_comes_later() -> None:
    """With it, a sum of a column may leave 64 bits, so SQLite cannot compute it alone any more."""
    session, _ = grid("without rowid")
    script = FORMS["query"].format(option="")
    query = session.compile(script, engine="database")
    first = query.run().value
    session.host.connection.execute(f"INSERT INTO cells VALUES (1, {2**63 - 1}, 'far')")
    assert query.run().value == first
    session.host.connection.execute(f"INSERT INTO cells VALUES ({2**63 - 1}, 0, 'farther')")
    session.set("moves", [*MOVES, {"dx": 2**63 - 1, "dy": 0}])
    for work in (query.run, lambda: session.run(script)):
        with pytest.raises(ss2sql.ExecutionError, match="X004"):  # the next step from there adds 1
            work()


# --- many whole numbers, which come as arrays ------------------------------------------------------------

FAR = 2**63 - 1
NUMBERS = [-FAR - 1, FAR, 0, -7, 3, FAR - 1]


@pytest.mark.parametrize("table", ["whole numbers", "descending", "without rowid", "descending key", "other key"])
def test_numbers_come_as_arrays_in_the_order_of_the_table(table: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.runtime.sqlite.database_tables.MANY_ROWS", 1)
    session = ss2sql.connect(engine="native")
    session.host.connection.execute(TABLES[table])
    edges = [(NUMBERS[src % 6], NUMBERS[dst % 6]) for src, dst in EDGES]
    session.host.connection.executemany("INSERT OR IGNORE INTO edge(src, dst) VALUES (?, ?)", edges)
    rows = session.host.connection.execute("SELECT src, dst FROM edge").fetchall()
    if table in SORTED:
        rows.sort(key=lambda row: [row[at] for at in SORTED[table]])
    read: list[Any] = []
    arrays = session.host.tables.read_integer_columns
    monkeypatch.setattr(
        session.host.tables, "read_integer_columns", lambda *given: read.append(given) or arrays(*given)
    )
    script = "SELECT dst FROM (SELECT * FROM edge WHERE src == node) START WITH node = 0 CONNECT BY UNIQUE node = dst;"
    reached, queue = set[int](), list[tuple[int, list[int]]]([(0, [])])
    for node, path in queue:
        for src, dst in rows:
            if src == node and dst not in reached:
                reached.add(dst)
                queue.append((dst, [*path, dst]))
    found = session.run(script).paths
    assert [[row[0] for row in path] for path in found] == [path for _, path in queue[1:]]
    assert len(read) == 1


# --- edges that are walked over arrays, see runtime/search/edge_walk.py ----------------------------------

NODES = [0, 1, 2, 3, 4, 5, FAR, -FAR - 1]  # as many as fit close together, and others
NODE_PAIRS = st.tuples(*[st.sampled_from(NODES)] * 2)
ENDINGS = ["", "WHERE dst == goal", "WHERE goal == dst", "WHERE dst == 3"]
OPTIONS = ["", "MAXIMUM 1", "MAXIMUM 2"]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(NODE_PAIRS, min_size=1, max_size=20).map(lambda pairs: sorted(pairs, key=str)),
    st.sampled_from(NODES[:6]),
    st.sampled_from([*NODES, 9]),
    st.sampled_from(ENDINGS),
    st.sampled_from(OPTIONS),
    st.booleans(),
)
def test_a_walk_over_arrays_finds_the_same_paths(
    edges: list[tuple[int, int]], start: int, goal: int, ending: str, option: str, framed: bool
) -> None:
    session = ss2sql.connect()
    if framed:
        session.attach("edges", pandas.DataFrame(edges, columns=["src", "dst"]))
    else:
        session.host.connection.execute("CREATE TABLE edges(src INTEGER, dst INTEGER)")
        session.host.connection.executemany("INSERT INTO edges VALUES (?, ?)", edges)
    script = f"""SELECT dst FROM (SELECT * FROM edges WHERE src == node) {ending}
        START WITH node = {start} CONNECT BY UNIQUE {option} node = dst"""
    walked: list[object] = []

    def walk(*given: Any) -> Any:
        walked.append(given)
        return walk_edges(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ss2sql.runtime.sqlite.database_tables.MANY_ROWS", 1)
        patch.setattr("ss2sql.runtime.python.edge_search.MANY_ROWS", 1)
        patch.setattr("ss2sql.runtime.search.edge_walk.walk_edges", walk)
        found = session.run(script, engine="native", goal=goal)
    assert walked
    for engine in ("native", "database"):
        other = session.run(script, engine=engine, goal=goal)
        assert found.paths == other.paths
        for count in ("generated", "expanded", "pruned"):
            assert getattr(found.stats, count) == getattr(other.stats, count), (engine, count)
    assert len(walked) == 1
