"""Lists whose rows must equal each other in something: looked up, not found by trying all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from agreement import exact, outcome, reference_outcome, session_for
from hypothesis import given, seed
from programs import ProgramCase
from programs.drawn import amount, drawn
from programs.joins import joins
from reference import Reference
from sessions import code_of

import ss2sql

COUNT = amount(1 / 4)  # for each of eight ways
INDEX = "in an index that SQLite makes for this query"


TYPED = "a INTEGER, b INTEGER, s TEXT, w REAL"


def session_over(case: ProgramCase, tables: Sequence[str], indexed: bool) -> ss2sql.Session:
    """A session in which some of a program's tables are those of a database, and the others lists."""
    lists = {name: rows for name, rows in case.tables.items() if name not in tables}
    ss = session_for(ProgramCase(case.script, {**case.variables, **lists}, case.uses))
    for name in tables:
        ss.host.connection.execute(f"CREATE TABLE {name}({TYPED})")
        values = [(row["a"], row["b"], row["s"], row["w"]) for row in case.tables[name]]
        ss.host.connection.executemany(f"INSERT INTO {name} VALUES (?, ?, ?, ?)", values)
        if indexed:
            ss.host.connection.execute(f"CREATE INDEX {name}_a ON {name}(a)")
            ss.host.connection.execute(f"CREATE INDEX {name}_s ON {name}(s, b)")
    return ss


@pytest.mark.parametrize(
    ("engine", "tables", "indexed"),
    [
        *(("auto", (), False), ("native", (), False), ("auto", ("t",), False), ("auto", ("u",), False)),
        *(("auto", ("u",), True), ("auto", ("t",), True), ("auto", ("t", "u"), True), ("native", ("u",), False)),
    ],
)
def test_random_queries(engine: Any, tables: tuple[str, ...], indexed: bool) -> None:
    looked_up = failed = 0

    @seed(103)
    @drawn(COUNT, shrunk=False)
    @given(joins())
    def run(case: ProgramCase) -> None:
        nonlocal looked_up, failed
        with session_over(case, tables, indexed) as ss:
            found, _ = outcome(ss, case.script, engine=engine)
            looked_up += "lookup: " in str(ss.compile(case.script, engine=engine).explain())
        # SQLite keeps no zero below zero.
        stored = {name: [{**row, "w": row["w"] + 0.0} for row in case.tables[name]] for name in tables}
        as_lists = ProgramCase(case.script, {**case.variables, **case.tables, **stored}, case.uses)
        assert found == reference_outcome(as_lists), case
        failed += found.error is not None

    run()
    assert failed > COUNT // 20
    assert (looked_up > COUNT // 5) == (engine == "auto" and tables != ("t", "u"))


SALES = [{"id": n, "kind": n * 7 % 5, "code": str(n)} for n in range(60)]
KINDS = [{"kind": n % 7, "shelf": n % 3, "name": f"k{n}"} for n in range(20)]
BOTH = [(sale, kind) for sale in SALES for kind in KINDS if sale["kind"] == kind["kind"]]


@pytest.fixture
def ss() -> ss2sql.Session:
    session = ss2sql.connect()
    session.set("sales", SALES)
    session.set("kinds", KINDS)
    return session


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize(
    ("script", "expected"),
    [
        # Rows that are equal in the key come in the order of their list.
        (
            "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AS rows",
            [(a["id"], b["name"]) for a, b in BOTH],
        ),
        (
            "SELECT id, name FROM sales, kinds WHERE kinds.kind == sales.kind AND shelf < 1 LIMIT 3 AS rows",
            [(a["id"], b["name"]) for a, b in BOTH if b["shelf"] < 1][:3],
        ),
        # A key of two columns; a whole row; what is computed.
        (
            "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AND shelf == sales.kind AS rows",
            [(a["id"], b["name"]) for a, b in BOTH if b["shelf"] == a["kind"]],
        ),
        (
            "SELECT kinds.this FROM sales, kinds WHERE sales.id % 2 == kinds.shelf AND sales.id == 3 AS list",
            KINDS[1::3],
        ),
        (
            "SELECT shelf, count(*) FROM sales, kinds WHERE sales.kind == kinds.kind GROUP BY shelf AS rows",
            [
                (shelf, sum(b["shelf"] == shelf for _, b in BOTH))
                for shelf in dict.fromkeys(b["shelf"] for _, b in BOTH)
            ],
        ),
        (
            "SELECT id FROM sales WHERE [] == (SELECT name FROM kinds WHERE kinds.kind == sales.kind AS list) AS list",
            [],
        ),
        (
            "SELECT name FROM kinds WHERE [] == (SELECT id FROM sales WHERE kinds.kind == sales.kind AS list) AS list",
            [b["name"] for b in KINDS if b["kind"] > 4],
        ),
    ],
)
def test_rows_that_are_looked_up(ss: ss2sql.Session, engine: Any, script: str, expected: Any) -> None:
    result = ss.run(script, engine=engine)
    assert exact(result.value) == exact(expected)
    if engine == "database":
        assert INDEX in str(result.explain())
        assert "lookup: " in str(result.explain())


@pytest.mark.parametrize("engine", ["database", "native"])
def test_what_fails_is_asked_of_equal_rows_alone(ss: ss2sql.Session, engine: Any) -> None:
    """A row that no other equals would be asked where SQLite makes its index."""
    script = "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AND 1 / (kinds.kind - 6) < 0 AS rows"
    assert ss.run(script, engine=engine).value == [(a["id"], b["name"]) for a, b in BOTH]
    with pytest.raises(ss2sql.ExecutionError, match="X002"):
        ss.run(script.replace("- 6", "- 4"), engine=engine)
    with pytest.raises(ss2sql.ExecutionError, match="X002"):
        ss.run(
            "SELECT id FROM sales, kinds WHERE 1 / (kinds.kind - 6) < 0 AND sales.kind == kinds.kind AS list",
            engine=engine,
        )


@pytest.mark.parametrize("engine", ["database", "native"])
def test_functions_are_called_for_equal_rows(ss: ss2sql.Session, engine: Any) -> None:
    called: list[Any] = []

    def note(name: str) -> bool:
        called.append(name)
        return name != "k1"

    ss.function("note", note, volatility="volatile")
    script = "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AND note(name) AND id < 9 AS rows"
    found = ss.run(script, engine=engine).value
    assert found == [(a["id"], b["name"]) for a, b in BOTH if b["name"] != "k1" and a["id"] < 9]
    assert called == [b["name"] for _, b in BOTH]


def test_how_many_rows_are_compared(ss: ss2sql.Session) -> None:
    """An empty list, None in a column, and numbers that are equal and of different kinds."""
    ss.set("nobody", [])
    ss.set("mixed", [{"kind": 1.0}, {"kind": None}, {"kind": 2}, {"kind": 1}])
    for engine in ("database", "native"):
        assert ss.run("SELECT id FROM sales, nobody WHERE sales.id == nobody.this AS list", engine=engine).value == []
        found = ss.run("SELECT b.this FROM a = mixed, b = mixed WHERE a.kind == b.kind AS list", engine=engine).value
        ones, nothing, two = [{"kind": 1.0}, {"kind": 1}], [{"kind": None}], [{"kind": 2}]
        assert exact(found) == exact([*ones, *nothing, *two, *ones])


TABLES = {
    "plain": ("CREATE TABLE kinds(kind INTEGER, shelf INTEGER, name TEXT)", INDEX),
    "indexed": (
        "CREATE TABLE kinds(kind INTEGER, shelf INTEGER, name TEXT); CREATE INDEX by_kind ON kinds(kind)",
        "with kind = … in its index by_kind",
    ),
    "keyed": ("CREATE TABLE kinds(kind INTEGER, shelf INTEGER, name TEXT PRIMARY KEY) WITHOUT ROWID", None),
    "wide": (
        "CREATE TABLE kinds(kind INTEGER, shelf INTEGER, name TEXT); CREATE INDEX wide ON kinds(kind, name DESC)",
        INDEX,
    ),
}


@pytest.mark.parametrize("table", TABLES)
def test_a_table_beside_a_list(table: str) -> None:
    """Its rows come in its order, whatever the index is called by which they are found."""
    with ss2sql.connect() as ss:
        made, how = TABLES[table]
        for statement in made.split("; "):
            ss.host.connection.execute(statement)
        rows = [(kind["kind"], kind["shelf"], kind["name"]) for kind in KINDS]
        ss.host.connection.executemany("INSERT INTO kinds VALUES (?, ?, ?)", rows)
        ss.set("sales", SALES)
        order = sorted(KINDS, key=lambda kind: kind["name"]) if table == "keyed" else KINDS
        both = [(sale["id"], kind["name"]) for sale in SALES for kind in order if sale["kind"] == kind["kind"]]
        result = ss.run("SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AS rows", engine="database")
        assert result.value == both
        assert how is None or how in str(result.explain())
        turned = ss.run("SELECT id, name FROM kinds, sales WHERE sales.kind == kinds.kind AS rows", engine="database")
        assert turned.value == [
            (sale["id"], kind["name"]) for kind in order for sale in SALES if sale["kind"] == kind["kind"]
        ]
        assert INDEX in str(turned.explain())
        assert "= +kinds.kind" in str(turned.sql)


def test_switched_off(ss: ss2sql.Session) -> None:
    script = "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AS rows"
    with ss2sql.connect(disable=["lookup"]) as other:
        other.set("sales", SALES)
        other.set("kinds", KINDS)
        result = other.run(script, engine="database")
    assert INDEX not in str(result.explain())
    assert result.value == ss.run(script).value


@pytest.fixture
def tables() -> ss2sql.Session:
    """Tables whose indexes give their rows in another order."""
    session = ss2sql.connect()
    session.host.connection.execute(
        "CREATE TABLE t(x INTEGER, y INTEGER); CREATE INDEX t_x ON t(x); CREATE INDEX t_part ON t(y) WHERE y > 2;"
        "CREATE TABLE u(x INTEGER, y INTEGER); CREATE INDEX u_x ON u(x, y DESC)"
    )
    session.host.connection.executemany("INSERT INTO t VALUES (?, ?)", [(10 - n, n) for n in range(9)])
    session.host.connection.executemany("INSERT INTO u VALUES (?, ?)", [(n % 3 + 2, n) for n in range(9)])
    return session


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("SELECT y FROM t WHERE x > 3 AND 1 / (y - 5) < 2 LIMIT 3 AS list", [0, 1, 2]),
        ("SELECT 10 / (y - 5) FROM t WHERE x > 3 LIMIT 2 AS list", [-2.0, -2.5]),
        ("SELECT 10 / (y - 7) FROM t WHERE y > 2 LIMIT 1 AS list", [-2.5]),
        # The first row that fails says which error it is.
        ("SELECT IF(y == 6; 1 / (y - 6); len(x)) FROM t WHERE x > 3 AND x < 6 AS list", "X007"),
        ("SELECT IF(y == 5; 1 / (y - 5); len(x)) FROM t WHERE x > 3 AND x < 6 AS list", "X002"),
        (
            "SELECT [t.y, u.y] FROM t, u WHERE t.x == u.x AND 10 / (u.y - 8) < 9 LIMIT 2 AS list",
            [[6, 2], [6, 5]],
        ),
        ("SELECT t.y, 12 / (u.y + 1) FROM t, u WHERE t.x == u.x AND u.y < 3 ORDER BY u.y AS rows", None),
        ("SELECT u.x, sum(10 / (u.y + 1)), count(*) FROM t, u WHERE t.x == u.x GROUP BY u.x AS rows", None),
        ("SELECT x, [] == (SELECT u.y FROM u WHERE u.x == t.x AND 1 / (u.y + 1) > 0.5 AS list) FROM t AS rows", None),
    ],
)
def test_what_fails_behind_an_index(tables: ss2sql.Session, engine: Any, script: str, expected: Any) -> None:
    """Rows are asked in the order of their tables, and none that LIMIT cuts off."""
    if isinstance(expected, str):
        assert code_of(tables.run, script, engine=engine) == expected
        return
    if expected is None:
        rows = [{"x": 10 - n, "y": n} for n in range(9)], [{"x": n % 3 + 2, "y": n} for n in range(9)]
        expected = Reference({}, {"t": rows[0], "u": rows[1]}, {}, {}).run(script)
    assert exact(tables.run(script, engine=engine).value) == exact(expected)


def test_an_index_is_used_where_something_may_fail(tables: ss2sql.Session) -> None:
    result = tables.run("SELECT 10 / (y - 5) FROM t WHERE x > 4 AND x < 8 LIMIT 1 AS list", engine="database")
    assert result.value == [-5.0]
    assert "in its index t_x" in str(result.explain())


def test_rows_are_sorted_first_only_where_an_index_may_find_them(tables: ss2sql.Session) -> None:
    for script, sorts in (
        ("SELECT 10 / (y - 6.5) FROM t WHERE x > 3 AS list", True),
        ("SELECT 10 / (y - 6.5) FROM t AS list", False),  # nothing is looked for
        ("SELECT y FROM t WHERE x > 3 AS list", False),  # nothing can fail
    ):
        sql = str(tables.run(script, engine="database").sql)
        assert ("LIMIT -1" in sql) == sorts, script


@pytest.mark.parametrize("name", ["by-kind", "order", 'a"b', "x; DROP TABLE kinds"])
def test_indexes_with_strange_names(ss: ss2sql.Session, name: str) -> None:
    quoted = '"' + name.replace('"', '""') + '"'
    ss.host.connection.execute(f"CREATE TABLE ways(here INTEGER, there INTEGER); CREATE INDEX {quoted} ON ways(here)")
    ss.host.connection.execute("INSERT INTO ways VALUES (1, 2), (2, 3), (2, 4), (3, 4)")
    joined = ss.run("SELECT id, there FROM sales, ways WHERE here == id AND id < 3 AS rows", engine="database")
    assert joined.value == [(1, 2), (2, 3), (2, 4)]
    found = ss.run(
        "SELECT there FROM ways WHERE here == n AND there == 4 START WITH n = 1 CONNECT BY UNIQUE n = there"
        " STOP WITH here != n AS list",
        engine="database",
    )
    assert found.value == [[2, 4]]
    for result in (joined, found):
        assert f"INDEXED BY {quoted}" in str(result.sql)


def test_tables_called_as_copies_are(ss: ss2sql.Session) -> None:
    for name in ("kinds_once", "stock_in_order"):
        ss.host.connection.execute(f"CREATE TABLE {name}(kind INTEGER, z INTEGER)")
        ss.host.connection.execute(f"INSERT INTO {name} VALUES (1, 10), (2, 20)")
    ss.host.connection.execute("CREATE TABLE stock(kind INTEGER, z INTEGER); INSERT INTO stock VALUES (1, 3), (2, 4)")
    for engine in ("database", "native"):
        script = "SELECT x.z, name FROM x = kinds_once, kinds WHERE x.kind == kinds.kind AND shelf == 1 AS rows"
        assert ss.run(script, engine=engine).value == [
            (x * 10, kind["name"]) for x in (1, 2) for kind in KINDS if kind["kind"] == x and kind["shelf"] == 1
        ]
        script = (
            "SELECT name, stock.z, (SELECT z FROM stock_in_order WHERE kind == stock.kind AS value)"
            " FROM kinds, stock WHERE stock.kind == kinds.kind AND shelf == 1 AS rows"
        )
        assert ss.run(script, engine=engine).value == [
            (kind["name"], kind["kind"] + 2, kind["kind"] * 10)
            for kind in KINDS
            if kind["kind"] in (1, 2) and kind["shelf"] == 1
        ]
