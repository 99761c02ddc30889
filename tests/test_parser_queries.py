"""The parser: queries, their clauses and options, queries without parentheses, the listings of the paper."""

from __future__ import annotations

import pytest
from listings import HANOI, ROBOT, SPACE
from trees import (
    NOWHERE,
    A,
    B,
    C,
    assign,
    call,
    expr,
    iff,
    index,
    items,
    lit,
    name,
    op,
    query,
    same,
    script,
    select,
    shape,
    source,
    this,
)

from ss2sql.frontend import ast


def test_a_query_with_every_clause() -> None:
    found = query(
        """SELECT a, n.this, f(b) FROM n = space, world.table, m = f(n.this)
        WHERE a > 1
        START WITH t = [1], level = 1
        CONNECT BY NO CYCLE MAXIMUM 10 t = f(this, t), level = level + 1
        STOP WITH level == 7
        GROUP BY a, b HAVING count(*) > 1
        ORDER BY a DESC, b, c ASC
        LIMIT 3
        AS plane('XY', [1], size = 3)"""
    )
    wanted = select(
        (A, this("n"), call("f", B)),
        (
            source(name("space"), "n"),
            source(ast.Attribute("world", "table", span=NOWHERE)),
            source(call("f", this("n")), "m"),
        ),
        where=op("gt", A, lit(1)),
        start=(assign("t", items(lit(1))), assign("level", lit(1))),
        options=(
            ast.Option("NO CYCLE", None, span=NOWHERE),
            ast.Option("MAXIMUM", lit(10), span=NOWHERE),
        ),
        connect=(
            assign("t", call("f", this(), name("t"))),
            assign("level", op("add", name("level"), lit(1))),
        ),
        stop=op("eq", name("level"), lit(7)),
        group=(A, B),
        having=op("gt", call("count", star=True), lit(1)),
        order=tuple(
            ast.OrderKey(key, descending, span=NOWHERE) for key, descending in ((A, True), (B, False), (C, False))
        ),
        limit=lit(3),
        representation=shape("plane", lit("XY"), items(lit(1)), size=lit(3)),
    )
    same(found, wanted)


def test_a_query_with_nothing_but_a_source() -> None:
    same(query("SELECT * FROM a"), select((ast.Star(span=NOWHERE),), (source(A),)))
    same(query("select a from b as VALUE;"), select((A,), (source(B),), representation=shape("VALUE")))
    same(query("SELECT a FROM b AS list()"), select((A,), (source(B),), representation=shape("list")))


SOURCES = ["a", "w.t", "n.this", "f(a, 1)", "[1, 2]", "a[0]", "f(a)[0, 1]", "'text'", "5", "None", "this", "v{-2.0}",
           "(a + b)", "(x = a)", "(SELECT a FROM b)", "SELECT a FROM b AS list", "IF(a; b; c)"]  # fmt: skip


@pytest.mark.parametrize("written", SOURCES)
def test_sources(written: str) -> None:
    for named in ("", "n = "):
        found = query(f"SELECT a FROM x, {named}{written}, y WHERE c")
        assert [part.name for part in found.sources] == [None, "n" if named else None, None]
        same(found.sources[1].expr, expr(written))


@pytest.mark.parametrize(
    "clauses",
    [
        ("GROUP BY a HAVING b", "ORDER BY c", "LIMIT 1"),
        ("LIMIT 1", "GROUP BY a HAVING b", "ORDER BY c"),
        ("ORDER BY c", "LIMIT 1", "GROUP BY a HAVING b"),
    ],
)
def test_group_order_and_limit_stand_in_any_order(clauses: tuple[str, ...]) -> None:
    head = "SELECT x FROM y WHERE z"
    same(query(" ".join((head, *clauses))), query(f"{head} GROUP BY a HAVING b ORDER BY c LIMIT 1"))


OPTIONS = [
    ("DEPTH FIRST", "DEPTH FIRST", None),
    ("breadth first", "BREADTH FIRST", None),
    ("BREADTH /* and */\n FIRST", "BREADTH FIRST", None),
    ("no cycle", "NO CYCLE", None),
    ("Unique", "UNIQUE", None),
    ("MEMORIZE", "MEMORIZE", None),
    ("MEMORIZE 5", "MEMORIZE", lit(5)),
    ("MEMORIZE (n + 1)", "MEMORIZE", op("add", name("n"), lit(1))),
    ("MAXIMUM 5", "MAXIMUM", lit(5)),
    ("MAXIMUM (n)", "MAXIMUM", name("n")),
    ("COST 1", "COST", lit(1)),
    ("COST cost", "COST", name("cost")),
    ("COST first", "COST", name("first")),
    ("COST f(a)[0] + 2 OR unique", "COST",
     ast.Or((op("add", index(call("f", A), lit(0)), lit(2)), name("unique")), span=NOWHERE)),
    ("HEURISTIC a - b", "HEURISTIC", op("sub", A, B)),
    ("PROBABILITY 0.5", "PROBABILITY", lit(0.5)),
    ("COST (SELECT a FROM b AS value)", "COST",
     select((A,), (source(B),), representation=shape("value"))),
    ("COST SELECT a FROM b AS value", "COST", select((A,), (source(B),), representation=shape("value"))),
]  # fmt: skip


@pytest.mark.parametrize(("written", "keyword", "argument"), OPTIONS)
def test_options(written: str, keyword: str, argument: ast.Expr | None) -> None:
    option = ast.Option(keyword, argument, span=NOWHERE)
    unique = ast.Option("UNIQUE", None, span=NOWHERE)
    for options, wanted in ((written, (option,)), (f"{written} UNIQUE", (option, unique))):
        found = query(f"SELECT a FROM b START WITH t = 1 CONNECT BY {options} t = 2, level = 3 STOP WITH c")
        same(found.options, wanted)
        same(found.connect, (assign("t", lit(2)), assign("level", lit(3))))


# A query without parentheses: each pair is one tree, the right side has the parentheses.
OPEN = [
    ("[] == SELECT this FROM p AS list", "[] == (SELECT this FROM p AS list)"),
    ("x = SELECT a FROM b, c", "x = (SELECT a FROM b, c)"),
    ("max(SELECT a FROM b AS list)", "max((SELECT a FROM b AS list))"),
    ("max(SELECT a FROM b)", "max((SELECT a FROM b))"),
    ("max(SELECT a FROM b AS list, c)", "max((SELECT a FROM b AS list), c)"),
    ("max(SELECT a FROM b, c)", "max((SELECT a FROM b, c))"),
    ("max(c, SELECT a FROM b, c)", "max(c, (SELECT a FROM b, c))"),
    ("[SELECT a FROM b AS list, SELECT c FROM d AS list]", "[(SELECT a FROM b AS list), (SELECT c FROM d AS list)]"),
    ("[SELECT a FROM b AS list, SELECT c FROM d]", "[(SELECT a FROM b AS list), (SELECT c FROM d)]"),
    ("IF(a; SELECT a FROM b, c; SELECT c FROM d)", "IF(a; (SELECT a FROM b, c); (SELECT c FROM d))"),
    ("IF(SELECT a FROM b; c)", "IF((SELECT a FROM b); c)"),
    ("x[SELECT a FROM b AS value]", "x[(SELECT a FROM b AS value)]"),
    ("a + SELECT b FROM c LIMIT 1 * 2", "a + (SELECT b FROM c LIMIT (1 * 2))"),
    ("a OR b == SELECT c FROM d WHERE e AND f OR g", "a OR (b == (SELECT c FROM d WHERE ((e AND f) OR g)))"),
    ("NOT SELECT a FROM b", "NOT (SELECT a FROM b)"),
    ("-SELECT a FROM b AS value", "-(SELECT a FROM b AS value)"),
    ("2 ^ SELECT a FROM b AS value", "2 ^ (SELECT a FROM b AS value)"),
    ("a AND b IN SELECT c FROM d AS list", "a AND (b IN (SELECT c FROM d AS list))"),
    # AS ends the query; what follows belongs to the outside.
    ("[] == SELECT a FROM b AS list AND c", "([] == (SELECT a FROM b AS list)) AND c"),
    ("SELECT a FROM b AS value + 1", "(SELECT a FROM b AS value) + 1"),
    ("2 * SELECT a FROM b AS value + 1", "(2 * (SELECT a FROM b AS value)) + 1"),
    ("a = SELECT b FROM c AS value OR d", "a = ((SELECT b FROM c AS value) OR d)"),
    ("SELECT a FROM SELECT b FROM c AS list", "SELECT a FROM (SELECT b FROM c AS list)"),
    ("SELECT a FROM SELECT b FROM c WHERE d AS list WHERE e",
     "SELECT a FROM (SELECT b FROM c WHERE d AS list) WHERE e"),
    ("SELECT a FROM x = SELECT b FROM c AS list, d", "SELECT a FROM x = (SELECT b FROM c AS list), d"),
    ("SELECT a FROM SELECT b FROM c, d AS list, e", "SELECT a FROM (SELECT b FROM c, d AS list), e"),
    ("SELECT a FROM b WHERE [] == SELECT c FROM d WHERE e == f AS list",
     "SELECT a FROM b WHERE [] == (SELECT c FROM d WHERE e == f AS list)"),
    ("SELECT a FROM b WHERE c == SELECT d FROM e AS value AND f LIMIT 1 AS list",
     "SELECT a FROM b WHERE (c == (SELECT d FROM e AS value)) AND f LIMIT 1 AS list"),
    ("SELECT a FROM b WHERE c IN SELECT d FROM e LIMIT 1 AS list LIMIT 2",
     "SELECT a FROM b WHERE c IN (SELECT d FROM e LIMIT 1 AS list) LIMIT 2"),
    ("SELECT a FROM b WHERE c IN SELECT d FROM e AS list AS dict",
     "SELECT a FROM b WHERE c IN (SELECT d FROM e AS list) AS dict"),
    ("SELECT SELECT a FROM b AS value, c FROM d", "SELECT (SELECT a FROM b AS value), c FROM d"),
    ("SELECT a FROM b START WITH x = SELECT c FROM d AS value, y = 1 CONNECT BY x = 2",
     "SELECT a FROM b START WITH x = (SELECT c FROM d AS value), y = 1 CONNECT BY x = 2"),
    ("SELECT a FROM b ORDER BY SELECT c FROM d ORDER BY e ASC AS value DESC",
     "SELECT a FROM b ORDER BY (SELECT c FROM d ORDER BY e ASC AS value) DESC"),
    ("SELECT a FROM b GROUP BY SELECT c FROM d AS value HAVING e",
     "SELECT a FROM b GROUP BY (SELECT c FROM d AS value) HAVING e"),
    ("SELECT a FROM b WHERE max(SELECT c FROM d) > 1", "SELECT a FROM b WHERE max((SELECT c FROM d)) > 1"),
    ("SELECT a FROM b WHERE c == (SELECT d FROM e) LIMIT 1",
     "(SELECT a FROM b WHERE (c == (SELECT d FROM e)) LIMIT 1)"),
    ("v{1} = SELECT a FROM b", "v{1} = (SELECT a FROM b)"),
]  # fmt: skip


@pytest.mark.parametrize(("open_", "closed"), OPEN)
def test_open_queries(open_: str, closed: str) -> None:
    same(expr(open_), expr(closed))


def test_the_listings_of_hanoi() -> None:
    nested = script(HANOI["nested"]).statements[1]
    assert isinstance(nested, ast.Query)
    assert [part.name for part in nested.sources] == [f"m{number}" for number in range(1, 8)]
    assert list(nested.columns) == [this(f"m{number}") for number in range(1, 8)]
    inner, depth = nested.where, 0
    while isinstance(inner, ast.Operator | ast.Call):
        inner = inner.operands[1] if isinstance(inner, ast.Operator) else inner.arguments[1]
        depth += 1
    assert depth == 8
    goal = op("eq", items(items(), items(), items(lit(3), lit(2), lit(1))), call("move", this(), name("tower")))
    cycle = query(HANOI["cycle"])
    same(cycle.where, goal)
    assert [part.name for part in cycle.start] == [part.name for part in cycle.connect] == ["tower", "level"]
    assert isinstance(cycle.stop, ast.Or)
    no_cycle = query(HANOI["no cycle"])
    assert [option.keyword for option in no_cycle.options] == ["NO CYCLE"]
    typo = no_cycle.stop
    assert isinstance(typo, ast.Or)
    same(typo.parts[1], op("eq", items(), call("move", this("mov"), name("tower"))))
    memorize = query(HANOI["memorize"])
    same(memorize.options, (ast.Option("MEMORIZE", lit(15), span=NOWHERE),))


def test_the_listings_of_the_robot_and_the_space() -> None:
    robot = script(ROBOT).statements[-1]
    assert isinstance(robot, ast.Query)
    assert [(option.keyword, option.argument) for option in robot.options] == [
        ("MEMORIZE", lit(20)),
        ("MAXIMUM", lit(1000)),
    ]
    assert isinstance(robot.stop, ast.Or)
    sound = call("playSound", lit("/usr/share/sounds/ubuntu/stereo/bell.ogg"))
    same(robot.stop.parts[2], iff(call("checkCollision", name("robot")), (sound, lit(True))))
    assert robot.representation == shape("list")
    spheres, largest, mass, velocity, both = script(SPACE).statements
    same(largest, assign("maxMass", call("max", query("SELECT mass FROM spheres AS list"))))
    assert isinstance(spheres, ast.Assign)
    assert isinstance(mass, ast.Assign)
    assert isinstance(mass.value, ast.Query)
    minus_five, area = items(lit(-5), lit(-5)), items(lit(100), lit(100), lit(0.1))
    same(mass.value.representation, shape("plane", lit("XY"), minus_five, area, lit(3)))
    assert isinstance(velocity, ast.Assign)
    same(both, items(name("Mass"), name("Velocity")))
