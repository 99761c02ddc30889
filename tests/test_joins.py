"""Lists whose rows must equal each other in something: looked up, not found by trying all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from agreement import executor_outcome, is_allowed, judged, outcome, reference_outcome, session_for
from golden import each_row
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase
from programs.drawn import amount, drawn
from programs.joins import joins
from reference import Reference

import ss2sql
from ss2sql.runtime.python import source_lookups
from ss2sql.runtime.sqlite import list_elements

COUNT = 2 * amount()
INDEX = "that SQLite makes for this query"

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


@pytest.fixture(scope="module", autouse=True)
def _look_up_in_short_lists() -> Iterator[None]:
    """Ranges are looked up in lists of any length."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_lookups, "MIN_LENGTH", 0)
        patch.setattr(list_elements, "MIN_LENGTH", 0)
        yield


# The engine, which tables are those of a database, and whether these have indexes.
WAYS = [
    *(("auto", (), False), ("native", (), False), ("auto", ("t",), False), ("auto", ("u",), False)),
    *(("auto", ("u",), True), ("auto", ("t",), True), ("auto", ("t", "u"), True), ("native", ("u",), False)),
]


@pytest.mark.drawn
@seed(103)
@drawn(COUNT, shrunk=False)
@given(joins(), st.sampled_from(WAYS))
def test_random_queries(case: ProgramCase, way: tuple[str, tuple[str, ...], bool]) -> None:
    engine, tables, indexed = way
    with session_over(case, tables, indexed) as ss:
        found, _ = outcome(ss, case.script, engine=engine)
    # SQLite keeps no zero below zero.
    stored = {name: [{**row, "w": row["w"] + 0.0} for row in case.tables[name]] for name in tables}
    as_lists = ProgramCase(case.script, {**case.variables, **case.tables, **stored}, case.uses)
    assert is_allowed(found, reference_outcome(as_lists), engine), case


SALES = [{"id": n, "kind": n * 7 % 5, "code": str(n)} for n in range(60)]
KINDS = [{"kind": n % 7, "shelf": n % 3, "name": f"k{n}"} for n in range(20)]
BOTH = [(sale, kind) for sale in SALES for kind in KINDS if sale["kind"] == kind["kind"]]
LISTS: dict[str, Any] = {
    "sales": SALES,
    "kinds": KINDS,
    "nobody": [],
    "mixed": [{"kind": 1.0}, {"kind": None}, {"kind": 2}, {"kind": 1}],
}
# The indexes of t and u give their rows in another order; the others are called as copies of tables are.
TABLES = """
    CREATE TABLE t(x INTEGER, y INTEGER); CREATE INDEX t_x ON t(x); CREATE INDEX t_part ON t(y) WHERE y > 2;
    CREATE TABLE u(x INTEGER, y INTEGER); CREATE INDEX u_x ON u(x, y DESC);
    CREATE TABLE kinds_once(kind INTEGER, z INTEGER); INSERT INTO kinds_once VALUES (1, 10), (2, 20);
    CREATE TABLE stock_in_order(kind INTEGER, z INTEGER); INSERT INTO stock_in_order VALUES (1, 10), (2, 20);
    CREATE TABLE stock(kind INTEGER, z INTEGER); INSERT INTO stock VALUES (1, 3), (2, 4)
"""
ROWS = {
    "t": [{"x": 10 - n, "y": n} for n in range(9)],
    "u": [{"x": n % 3 + 2, "y": n} for n in range(9)],
    "kinds_once": [{"kind": 1, "z": 10}, {"kind": 2, "z": 20}],
    "stock_in_order": [{"kind": 1, "z": 10}, {"kind": 2, "z": 20}],
    "stock": [{"kind": 1, "z": 3}, {"kind": 2, "z": 4}],
}


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        session.host.connection.execute(TABLES)
        for name in ("t", "u"):
            values = [tuple(row.values()) for row in ROWS[name]]
            session.host.connection.executemany(f"INSERT INTO {name} VALUES (?, ?)", values)
        for name, rows in LISTS.items():
            session.set(name, rows)
        yield session


def compared(ss: ss2sql.Session, script: str, engine: Any) -> None:
    """An engine comes to what the reference evaluator does, and `auto` finds it where SQL gives up."""
    expected = judged(Reference({}, LISTS, ROWS, {}), script)
    assert is_allowed(outcome(ss, script, engine=engine)[0], expected, engine)
    assert is_allowed(outcome(ss, script)[0], expected, "auto")


@each_row("queries/looked-up", "script", "told")
def test_rows_of_lists_and_tables(ss: ss2sql.Session, engine: Any, script: str, told: str) -> None:
    compared(ss, script, engine)
    if engine == "database" and told == "an index":
        assert "lookup: " in str(ss.run(script, engine=engine).explain())
        assert INDEX in str(ss.run(script, engine=engine).explain())


def test_functions_are_called_for_equal_rows(ss: ss2sql.Session, engine: Any) -> None:
    called: list[Any] = []

    def note(name: str) -> bool:
        called.append(name)
        return name != "k1"

    ss.function("note", note, volatility="stable")
    script = "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AND note(name) AND id < 9 AS rows"
    found = ss.run(script, engine=engine).value
    assert found == [(a["id"], b["name"]) for a, b in BOTH if b["name"] != "k1" and a["id"] < 9]
    assert sorted(called) == sorted({b["name"] for _, b in BOTH})


@pytest.mark.parametrize(
    ("columns", "how"),
    [
        ("name TEXT)", INDEX),
        ("name TEXT); CREATE INDEX by_kind ON listed(kind)", "kind=? in the index by_kind"),
        ("name TEXT PRIMARY KEY) WITHOUT ROWID", ""),
        ("name TEXT); CREATE INDEX wide ON listed(kind, name DESC)", INDEX),
    ],
)
def test_a_table_beside_a_list(ss: ss2sql.Session, columns: str, how: str) -> None:
    """Its rows come in its order, whatever the index is called by which they are found."""
    ss.host.connection.execute(f"CREATE TABLE listed(kind INTEGER, shelf INTEGER, {columns}")
    ss.host.connection.executemany("INSERT INTO listed VALUES (?, ?, ?)", [tuple(kind.values()) for kind in KINDS])
    order = sorted(KINDS, key=lambda kind: kind["name"]) if "PRIMARY KEY" in columns else KINDS
    judge = Reference({}, LISTS, {"listed": order}, {})
    for sources, found in (("sales, listed", how), ("listed, sales", INDEX)):
        script = f"SELECT id, name FROM {sources} WHERE sales.kind == listed.kind AS rows"
        result = ss.run(script, engine="database")
        assert result.value == judge.run(script)
        assert found in str(result.explain())
    assert "= +listed.kind" in str(result.sql)


def test_switched_off(ss: ss2sql.Session) -> None:
    script = "SELECT id, name FROM sales, kinds WHERE sales.kind == kinds.kind AS rows"
    with ss2sql.connect(disable=["lookup"]) as other:
        other.set("sales", SALES)
        other.set("kinds", KINDS)
        result = other.run(script, engine="database")
    assert INDEX not in str(result.explain())
    assert result.value == ss.run(script).value


def test_an_index_is_used_where_something_may_fail(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT 10 / (y - 5) FROM t WHERE x > 4 AND x < 8 LIMIT 1 AS list", engine="database")
    assert result.value == [-5.0]
    assert "in the index t_x" in str(result.explain())


@pytest.mark.parametrize("name", ["by-kind", "order", 'a"b', "x; DROP TABLE kinds"])
def test_indexes_with_strange_names(ss: ss2sql.Session, name: str) -> None:
    quoted = '"' + name.replace('"', '""') + '"'
    ss.host.connection.execute(f"CREATE TABLE ways(here INTEGER, there INTEGER); CREATE INDEX {quoted} ON ways(here)")
    ss.host.connection.execute("INSERT INTO ways VALUES (1, 2), (2, 3), (2, 4), (3, 4)")
    for script, value in (
        ("SELECT id, there FROM sales, ways WHERE here == id AND id < 3 AS rows", [(1, 2), (2, 3), (2, 4)]),
        ("SELECT there FROM ways WHERE here == n AND there == 4 START WITH n = 1 CONNECT BY UNIQUE n = there"
         " STOP WITH here != n AS list", [[2, 4]]),
    ):  # fmt: skip
        result = ss.run(script, engine="database")
        assert result.value == value
        assert f"INDEXED BY {quoted}" in str(result.sql)


@pytest.mark.parametrize(
    "script",
    [
        "SELECT n.this, e.a FROM n = [1, 2], e = es WHERE e.k == 1 AND abs(e.a) == n.this AS rows",
        "SELECT a FROM es START WITH n = 1 CONNECT BY UNIQUE BY n, k == 1 AND (abs(a) == n OR b == n), n = b AS list",
    ],
)
def test_a_key_that_cannot_be_computed_lets_no_row_pass_another_one(engine: str, script: str) -> None:
    rows = [(1, 2, 1), (None, 0, 0), (2, 1, 1), (1, 1, 0)]
    case = ProgramCase(script, {"es": [dict(zip("abk", row, strict=True)) for row in rows]})
    found, expected = executor_outcome(case, engine), reference_outcome(case)
    assert found == expected
    assert expected.error is None
