"""A hint shows the right form in the user's own names, and this form runs: it is read from the error and run."""

from __future__ import annotations

import re

import pytest
from cases.data import Body

import ss2sql

STAFF = (
    "CREATE TABLE staff(id INTEGER PRIMARY KEY, name TEXT, boss INTEGER, age INTEGER);"
    "INSERT INTO staff VALUES (1, 'Ann', NULL, 40), (2, 'Bob', 1, 37), (3, 'Cy', 2, 36)"
)
STEPS = "START WITH n = 1 CONNECT BY {} n = id STOP WITH boss != n AS list"
TREE = "START WITH boss == None CONNECT BY PRIOR id == boss"

# The script, its wrong part, which the form in the hint replaces, and what it gives then.
ROWS = [
    ("SELECT this FROM pairs WHERE this[0] = 0 AS list", "this[0] = 0", [[0, 1]]),
    ("SELECT name FROM staff WHERE age + 1 = 37 AS list", "age + 1 = 37", ["Cy"]),
    ("SELECT name FROM staff WHERE boss IS NULL OR age + id = 39 AS list", "age + id = 39", ["Ann", "Bob", "Cy"]),
    ("SELECT a.name FROM a = staff JOIN b = staff ON a.boss = b.id AS list", "a.boss = b.id", ["Bob", "Cy"]),
    ("SELECT CASE WHEN age = 40 THEN 1 ELSE 2 END FROM staff AS list", "age = 40", [1, 2, 2]),
    ("SELECT CASE age WHEN 40 THEN 1 ELSE 2 END FROM staff AS list", "CASE age WHEN 40", [1, 2, 2]),
    ("SELECT CAST(age AS TEXT) FROM staff AS list", "CAST(age AS TEXT)", ["40", "37", "36"]),
    ("CAST('3' AS INTEGER) + 1", "CAST('3' AS INTEGER)", 4),
    ("a, b = [1, 2]; [b, a]", "a, b = [1, 2]", [2, 1]),
    (f"SELECT name FROM staff {STEPS.format('COST = age')}", "COST = age", [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {STEPS.format('MAXIMUM = 1')}", "MAXIMUM = 1", [["Bob"]]),
    (f"SELECT name FROM staff {STEPS.format('BFS')}", "BFS", None),
    (f"SELECT name FROM staff {STEPS.format('DFS')}", "DFS", None),
    (f"SELECT name FROM staff {STEPS.format('ASTAR')}", "ASTAR", None),
    (f"SELECT name FROM staff {STEPS.format('A*')}", "A*", None),
    (f"SELECT name FROM staff {STEPS.format('DISTINCT')}", "DISTINCT", None),
    (f"SELECT name FROM staff {STEPS.format('LIMIT 1')}", "LIMIT 1", None),
    ("SELECT LAST n FROM [1] START WITH EACH n IN 1, 2, 3 CONNECT BY n < 3, n = n + 1 AS list",
     "EACH n IN 1, 2, 3", [1, 2, 2]),
    ("m.A + 1", "m.A", 2),
    (f"SELECT LAST SYS_CONNECT_BY_PATH(name, '/') FROM staff {TREE} AS list", "SYS_CONNECT_BY_PATH(name, '/')",
     ["Ann", "Ann/Bob", "Ann/Bob/Cy"]),
    (f"SELECT LAST CONNECT_BY_ROOT name FROM staff {TREE} AS list", "CONNECT_BY_ROOT name", ["Ann", "Ann", "Ann"]),
    (f"SELECT LAST LEVEL FROM staff {TREE} AS list", "LEVEL", [1, 2, 3]),
    (f"SELECT LAST CONNECT_BY_ISLEAF FROM staff {TREE} AS list", "CONNECT_BY_ISLEAF", [False, False, True]),
    (f"SELECT LAST name FROM staff {TREE.replace('==', '=', 2).replace('boss =', 'boss ==', 1)} AS list",
     "PRIOR id = boss", ["Ann", "Bob", "Cy"]),
    ("SELECT name || 'x' FROM staff AS list", "name || 'x'", ["Annx", "Bobx", "Cyx"]),
    ("WITH t AS (SELECT name FROM staff) SELECT name FROM t AS list",
     "WITH t AS (SELECT name FROM staff) SELECT name FROM t AS list", ["Ann", "Bob", "Cy"]),
    ("SELECT age FROM staff UNION SELECT age FROM staff", "SELECT age FROM staff UNION SELECT age FROM staff",
     [{"age": 40}, {"age": 37}, {"age": 36}]),
    ("SELECT id FROM staff UNION ALL SELECT boss FROM staff", "SELECT id FROM staff UNION ALL SELECT boss FROM staff",
     [{"id": 1}, {"id": 2}, {"id": 3}, {"boss": None}, {"boss": 1}, {"boss": 2}]),
    ("SELECT name, age FROM staff ORDER BY 2 AS list", "ORDER BY 2", ["Cy", 36, "Bob", 37, "Ann", 40]),
    ("SELECT s.* FROM s = staff WHERE s.id == 1 AS list", "s.*", [{"id": 1, "name": "Ann", "boss": None, "age": 40}]),
    ("SELECT name FROM staff LIMIT 1, 2 AS list", "LIMIT 1, 2", ["Bob", "Cy"]),
    ("SELECT age years FROM staff WHERE id == 1", "age years", [{"years": 40}]),
    ("SELECT s.age FROM staff s WHERE s.id == 1 AS list", "staff s", [40]),
    ("(SELECT id FROM staff) == [1, 2, 3]", "(SELECT id FROM staff)", True),
    ("SELECT name FROM staff WHERE age IN (37, 40) AS list", "(37, 40)", ["Ann", "Bob"]),
    ("SELECT id AS n FROM staff WHERE n > 2 AS list", "n > 2", None),
    (f"SELECT name FROM staff {STEPS.format('MEMORIZE k COST age')}", "MEMORIZE k", [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {STEPS.format('MAXIMUM k')}", "MAXIMUM k", [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {STEPS.format('MAXIMUM 1 * k')}", "MAXIMUM 1 * k", [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {STEPS.format('GREEDY')}", "GREEDY", [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {TREE.replace('BY', 'BY NOCYCLE')} AS list", "NOCYCLE",
     [["Ann"], ["Ann", "Bob"], ["Ann", "Bob", "Cy"]]),
    ("SELECT name FROM staff START WITH n = 1 CONNECT BY UNIQUE n boss == n, n = id AS list", "UNIQUE n",
     [["Bob"], ["Bob", "Cy"]]),
    ("SELECT name FROM staff START WITH n = 1 CONNECT BY COST age boss == n, n = id AS list", "COST age boss",
     [["Bob"], ["Bob", "Cy"]]),
    ("SELECT name FROM staff START WITH n = 1 CONNECT BY boss == n AND n = id AS list",
     "CONNECT BY boss == n AND n = id", [["Bob"], ["Bob", "Cy"]]),
    ("SELECT name FROM staff START WITH n = 1 CONNECT BY boss = n, n = id AS list", "boss = n",
     [["Bob"], ["Bob", "Cy"]]),
    ("SELECT name FROM staff START WITH EACH n = [1] CONNECT BY boss == n, n = id AS list", "EACH n = [1]",
     [["Bob"], ["Bob", "Cy"]]),
    (f"SELECT name FROM staff {TREE.replace('boss == None', 'id = 2')} AS list", "START WITH id = 2",
     [["Bob"], ["Bob", "Cy"]]),
    ("SELECT LAST LEVEL FROM [1] CONNECT BY level() <= 3 AS list", "LEVEL", [1, 2, 3]),
    ("SELECT LAST level() FROM [1] CONNECT BY LEVEL <= 3 AS list", "LEVEL", [1, 2, 3]),
    ("SELECT LAST level() FROM dual CONNECT BY level() <= 3 AS list", "FROM dual", [1, 2, 3]),
    (f"SELECT LAST name FROM staff {TREE} SEARCH DEPTH FIRST BY name SET place AS list",
     "SEARCH DEPTH FIRST BY name SET place", ["Ann", "Bob", "Cy"]),
    (f"SELECT LAST name FROM staff {TREE} CYCLE id SET c AS list", "CONNECT BY PRIOR id == boss CYCLE id SET c",
     ["Ann", "Bob", "Cy"]),
    (f"SELECT LAST CONNECT_BY_ROOT(name) FROM staff {TREE} AS list", "CONNECT_BY_ROOT(name)", ["Ann", "Ann", "Ann"]),
    (f"SELECT LAST CONNECT_BY_ISCYCLE FROM staff {TREE.replace('BY', 'BY NO CYCLE BY id,')} AS list",
     "CONNECT_BY_ISCYCLE", [False, False, False]),
    ("1; SELECT id FROM staff AS list SELECT name FROM staff AS list", "SELECT name", ["Ann", "Bob", "Cy"]),
    ("SELECT id FROM staff y = 2", "y =", 2),
    ("SELECT name FROM staff WHERE EXISTS(SELECT id FROM staff WHERE id > 2) AS list",
     "EXISTS(SELECT id FROM staff WHERE id > 2)", ["Ann", "Bob", "Cy"]),
    ("SELECT boss FROM staff EXCEPT SELECT id FROM staff WHERE id == 1 AS list",
     "SELECT boss FROM staff EXCEPT SELECT id FROM staff WHERE id == 1 AS list", [None, 2]),
    ("SELECT id FROM staff INTERSECT SELECT boss FROM staff AS list",
     "SELECT id FROM staff INTERSECT SELECT boss FROM staff AS list", [1, 2]),
    ("SELECT name FROM staff WHERE name ILIKE 'B%' AS list", "name ILIKE 'B%'", ["Bob"]),
    ("SELECT substr(name, 1, 2) FROM staff AS list", "substr(name, 1, 2)", ["An", "Bo", "Cy"]),
    ("SELECT decode(id, 1, 7, 8) FROM staff AS list", "decode(id, 1, 7, 8)", [7, 8, 8]),
    ("m.a + 1", "m.a", 2),
    ("body.weight", "body.weight", 80.0),
    ("SELECT b.name.upper() FROM b = bodies AS list", "b.name.upper()", ["ANVIL"]),
]  # fmt: skip


def session() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.host.connection.execute(STAFF)
    ss.attach("pairs", [[0, 1], [1, 2]])
    ss.set("m", {"A": 1})
    ss.set("k", 2)
    ss.set("body", Body("anvil", 80.0))
    ss.attach("bodies", [Body("anvil", 80.0)])
    return ss


def form_of(error: ss2sql.Error) -> str:
    """What the first hint says to write."""
    found = re.match(
        r"write (.*?)(?: to compare| to join strings| to name .*| for .*|, s\.x .*| to choose .*)?\Z", error.hints[0]
    )
    assert found is not None, error.hints
    return found[1]


@pytest.mark.parametrize(("script", "wrong", "value"), ROWS, ids=[row[0] for row in ROWS])
def test_the_form_in_the_hint_runs(script: str, wrong: str, value: object) -> None:
    with session() as ss:
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(script)
        if script.startswith("SELECT id AS n"):
            assert caught.value.hints[0] == "'n' is a column that SELECT makes; write id here"
            return
        form = form_of(caught.value)
        if form.startswith("; in front of "):
            form = f"; {wrong}"
        elif form.endswith(", right after CONNECT BY"):
            form = f"CONNECT BY {form.removesuffix(' right after CONNECT BY')} PRIOR id == boss"
        right = script.replace(wrong, form, 1)
        found = ss.eval(right)
        assert found == value if value is not None else found
