"""`fold`, `split` and `unnest`: what becomes of constants, of conditions, and of queries over known lists.

That the values stay the same is shown by sheets, which run with these rewrites and without.
"""

from __future__ import annotations

from typing import Any

import pytest
from sessions import ENGINES, both

import ss2sql
from ss2sql import plan
from ss2sql.lowering.rewrites import optimise

ALL = ("inline", "fold", "unnest", "split")


def rewritten(script: str, *rewrites: str, **functions: Any) -> plan.Query:
    """The plan of a query after these rewrites alone."""
    ss = ss2sql.connect()
    for name, function in functions.items():
        ss.function(name, function)
    statement = ss.compile(script).plan.statements[0]
    assert isinstance(statement.expr, plan.Subquery)
    query, _ = optimise(statement.expr.query, [name for name in ALL if name not in rewrites])
    return query


# --- fold ----------------------------------------------------------------------------------------------


def folded(expression: str, **functions: Any) -> plan.Expr:
    """The column of SELECT after folding alone; `x` is an element of which nothing is known."""
    return rewritten(f"SELECT {expression} FROM x = given", "fold", **functions).columns[0].expr


@pytest.mark.parametrize(
    "expression",
    [
        *("60 * 60", "10.0 + 0", "2 ^ 10", "7 / 2", "-(-3)", "'a' + 'b'", "[1] + [2.0]", "[1 + 1, [True]]"),
        *("[[1, 2], [3]][0][1]", "'abc'[1:]", "len('abc')", "len([x.this, 2])", "[x.this, 2][1]", "range(3)"),
        *("2 IN [1, 2]", "'a' < 'b'", "1 == 1.0", "None == 0", "NOT []", "1 XOR ''", "True AND 1", "1 OR x.this / 0"),
        *("False AND x.this / 0", "x.this == 1 AND False", "IF(1 > 2; x.this / 0; 'else')", "IF([]; 1)"),
        *("max(1, 2) + min([3, 4])", "float(1)", "-0.0 * 1", "range(1, 1000)"),
    ],
)
def test_constants_are_computed_exactly(expression: str) -> None:
    node = folded(expression)
    assert isinstance(node, plan.Constant)
    with ss2sql.connect(disable=["fold"]) as ss:
        assert repr(ss.run(f"SELECT {expression} FROM x = [1] AS rows", engine="native").value) == repr([(node.value,)])


@pytest.mark.parametrize(
    ("expression", "same_as"),
    [
        ("x.this == 1 AND True", "x.this == 1"),
        ("False OR x.this == 1 OR ''", "x.this == 1"),
        ("True XOR x.this", "NOT x.this"),
        ("IF(True; x.this; 1)", "x.this"),
        ("[x.this + 1, 2][0]", "x.this + 1"),
        ("x.this + 2 * 3", "x.this + 6"),
        ("True AND x.this", "NOT NOT x.this"),  # AND gives a bool
    ],
)
def test_what_is_left_of_an_expression(expression: str, same_as: str) -> None:
    assert folded(expression) == folded(same_as)


def test_functions_of_the_user_are_not_run() -> None:
    assert isinstance(folded("double(2)", double=lambda x: 2 * x), plan.Call)
    assert isinstance(folded("1 + 2", add=lambda a, b: [a, b]), plan.Call)
    assert isinstance(folded("print(1)"), plan.Call)
    assert isinstance(folded("range(1, 1001)"), plan.Call)  # a long list is better made when it is needed


# --- split ---------------------------------------------------------------------------------------------

SOURCES = "FROM x = [1, 2, 3], y = [1, 2, 3], t = ['a']"


def condition(text: str, *rewrites: str, **functions: Any) -> plan.Expr | None:
    return rewritten(f"SELECT 1 {SOURCES} WHERE {text}", *rewrites, **functions).where


@pytest.mark.parametrize(
    ("written", "split"),
    [
        ("x.this == 1 AND (y.this == 2 AND x.this < y.this)", "x.this == 1 AND y.this == 2 AND x.this < y.this"),
        ("(x.this == 1 OR y.this == 2) OR x.this < y.this", "x.this == 1 OR y.this == 2 OR x.this < y.this"),
        ("NOT (x.this == 1 OR y.this != 2)", "x.this != 1 AND y.this == 2"),
        ("NOT (x.this < 1 AND y.this >= 2)", "x.this >= 1 OR y.this < 2"),
        ("NOT NOT x.this", "x.this"),
        ("NOT (NOT x.this OR y.this == 2)", "x.this AND y.this != 2"),
        ("NOT x.this IN [1, 'a']", "x.this NOT IN [1, 'a']"),
        ("x.this == 1 AND y.this == 2 AND x.this == 1", "x.this == 1 AND y.this == 2"),
        ("(x.this == 1 AND y.this == 1) OR (x.this == 1 AND y.this == 3)",
         "x.this == 1 AND (y.this == 1 OR y.this == 3)"),
        ("x.this == 1 AND y.this OR x.this == 1 AND t.this", "x.this == 1 AND (y.this OR t.this)"),
        ("x.this == 1 AND y.this == 1 OR x.this == 1", "x.this == 1"),
        ("x.this == 1 OR x.this == 2 OR 3 == x.this OR y.this == 1", "x.this IN [1, 2, 3] OR y.this == 1"),
        ("x.this != 1 AND x.this != 2 AND x.this != 3", "x.this NOT IN [1, 2, 3]"),
        ("IF(NOT NOT x.this; y.this; 0)", "IF(x.this; y.this; 0)"),
    ],
)  # fmt: skip
def test_conditions_are_split(written: str, split: str) -> None:
    assert condition(written, "split") == condition(split)
    script = f"SELECT x.this, y.this {SOURCES} WHERE {written} AS rows"
    expected = ss2sql.connect(disable=["split"]).run(script, engine="native").value
    for engine in ENGINES:
        assert ss2sql.connect().run(script, engine=engine).value == expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "NOT (x.this < t.this)",  # the error says `<`
        "tick() == 1 AND tick() == 1",
        "(x.this == 1 AND tick() == 1) OR (x.this == 1 AND y.this == 1)",
        "x.this == 1 OR x.this == 2",  # no better as IN
        "x.this == 1 OR x.this == None OR x.this == 'a'",
    ],
)
def test_what_stays_as_it_is(text: str) -> None:
    numbers = iter(range(100))
    functions = {"tick": lambda: next(numbers)}
    assert condition(text, "split", **functions) == condition(text, **functions)


def test_stop_is_split_too() -> None:
    script = "SELECT this FROM [1, 2] START WITH s = 1 CONNECT BY s = this STOP WITH NOT (this == 2 AND s != 2)"
    search = rewritten(script, *ALL).search
    assert search is not None
    assert isinstance(search.stop, plan.Or)


def test_many_parts_are_not_too_deep_for_sqlite() -> None:
    parts = [f"x.this != {number} + y.this" for number in range(5, 1105)]
    for joined, expected in ((" AND ".join(parts), 9), (" OR ".join(f"NOT ({part})" for part in parts), 0)):
        result = ss2sql.connect().run(f"SELECT x.this {SOURCES} WHERE {joined} AS list", engine="database")
        assert len(result.value) == expected


@pytest.mark.parametrize("disable", [[], ["split"], ["unnest"]])
@pytest.mark.parametrize("where", ["NOT (a.this == 1)", "[] == (SELECT this FROM [a.this] WHERE this == 1 AS list)"])
def test_a_replaced_operator_keeps_its_meaning(disable: list[str], where: str) -> None:
    with ss2sql.connect(disable=disable) as ss:
        ss.function("ne", lambda a, b: True, volatility="immutable")
        assert ss.eval(f"SELECT a.this FROM a = [1, 2] WHERE {where} AS list") == [2]


# --- unnest --------------------------------------------------------------------------------------------


def test_an_unknown_switch_is_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="unnest"):
        ss2sql.connect(disable=["unnset"])


BORDERS = "a.this <> b.this AND a.this <> c.this"
PAIRS = "[[a.this, b.this], [a.this, c.this]]"
ALIKE = "SELECT this FROM {} WHERE this[0] == this[1] AS list"


@pytest.mark.parametrize(
    ("before", "condition", "where"),
    [
        ("", "NOT (SELECT this FROM [a.this, b.this] WHERE this > 1 AS list)", "a.this <= 1 AND b.this <= 1"),
        ("", "a.this IN (SELECT this + 1 FROM [b.this] AS list)", "a.this = b.this + 1"),
        ("", "[] == (SELECT this FROM [2, 3] WHERE this == a.this AS list)", "NOT (a.this IN (2, 3))"),
        ("", "min(SELECT this FROM [a.this, b.this] AS list) >= 3", "a.this >= 3 AND b.this >= 3"),
        ("", "eval('a' + '.this;') == 1", "a.this = 1"),
        # The forms of the map.
        ("", "a.this != b.this AND a.this != c.this", BORDERS),
        ("", f"[] == ({ALIKE.format(PAIRS)})", BORDERS),
        ("", f"len({ALIKE.format(PAIRS)}) == 0", BORDERS),
        ("", f"NOT ({ALIKE.format(PAIRS)})", BORDERS),
        (f"pairs = {PAIRS};", f"[] == ({ALIKE.format('pairs')})", BORDERS),
        ("pairs = [['a', 'b'], ['a', 'c']];",
         "[] == (SELECT this FROM pairs WHERE eval(this[0] + '.this;') == eval(this[1] + '.this;') AS list)", BORDERS),
        ("", "True AND NOT (a.this == b.this OR b.this == a.this) AND NOT (a.this == c.this OR a.this == c.this)",
         "a.this <> b.this AND b.this <> a.this AND a.this <> c.this"),
    ],
)  # fmt: skip
def test_what_the_sql_asks(before: str, condition: str, where: str) -> None:
    script = f"{before} SELECT a.this FROM a = [1, 2, 3], b = [1, 2, 3], c = [1, 2, 3] WHERE {condition} AS list;"
    with ss2sql.connect() as ss:
        assert ss.run(script, engine="database").sql.statements[-1].endswith(f"WHERE\n  {where}")
    with ss2sql.connect(disable=["unnest", "split"]) as ss:
        assert (where in str(ss.compile(script).sql)) == ("SELECT" not in condition and "(" not in condition)


@both
@pytest.mark.parametrize(
    "expression",
    [
        # of fold
        *("1 / 0", "'a' + 1", "9223372036854775807 + 1", "[1][5]", "a.this / 0 AND False", "[1 / 0, 2][1]"),
        *("len([1 / 0])", "IF(True; 1 / 0, 2; 3)"),
        # of unnest
        "[] == (SELECT this FROM [a.this, 'x'] WHERE this < 2 AS list)",  # fails for the second element
        "[] == (SELECT 1 / this FROM [a.this, 0] WHERE this < 2 AS list)",  # so does its column
        "[] == (SELECT this FROM [a.this, 1 / (a.this - 1)] WHERE True AS list)",  # and this element
        "max(SELECT this FROM [a.this] WHERE this > 9 AS list) > 1",  # None has no order
        "max(SELECT this FROM [a.this, 'x'] AS list) == 1",  # the elements have none among each other
        "eval('a.that;') == 1",  # no such column
        "eval('a.this') AND eval('1 / 0') == 1",
        "eval('SELECT') == 1",
    ],
)
def test_what_fails_fails_as_without_and_when_it_runs(engine: Any, expression: str) -> None:
    messages = set()
    for disable in ([], ["fold"], ["unnest"]):
        for script in ("SELECT {} FROM a = given AS list", "SELECT a.this FROM a = given WHERE {} AS list"):
            with ss2sql.connect(disable=disable) as ss:
                assert ss.eval(script.format(expression), given=[]) == []
                with pytest.raises(ss2sql.Error) as caught:
                    ss.run(script.format(expression), engine="auto" if engine == "database" else engine, given=[1])
            assert caught.value.span is not None
            messages.add((caught.value.code, caught.value.message, caught.value.span.text))
    assert len(messages) == 1


# --- lists in variables --------------------------------------------------------------------------------

WITHOUT = "SELECT a.this FROM a = [1, 2, 3] WHERE [] == (SELECT this FROM banned WHERE this < a.this AS list) AS list"


def test_a_constant_list_in_a_variable_is_known_before_the_run(ss: ss2sql.Session) -> None:
    assert "2 >= a.this" in str(ss.compile(f"banned = [2]; {WITHOUT}").sql)
    ss.attach("banned", [2])
    assert "2 >= a.this" in str(ss.compile(WITHOUT).sql)
    assert "collect(" in str(ss.compile(f"banned = sorted(banned); {WITHOUT}").sql)
    computed = ss.run(f"banned = [3]; banned = sorted([9] + banned); {WITHOUT}", engine="database")
    assert "3 >= a.this" in str(computed.sql)


CHANGES: list[tuple[list[Any], list[int]]] = [
    ([2], [1, 2]),
    ([2, 1], [1]),
    ([], [1, 2, 3]),
    ([1.0], [1]),
    (list(range(2000, 4000)), [1, 2, 3]),  # too long to be taken apart
]


@both
def test_the_query_is_made_anew_when_the_list_has_changed(ss: ss2sql.Session, engine: Any) -> None:
    parameter = ss.compile(WITHOUT)
    assert parameter.parameters == ("banned",)
    banned: list[Any] = [2]
    ss.attach("banned", banned)
    query = ss.compile(WITHOUT)
    for values, expected in CHANGES:
        banned[:] = values
        assert query.run(engine=engine).value == expected
        assert parameter.run(engine=engine, banned=values).value == expected


def test_pairs_of_names_that_are_a_parameter_run_in_the_database(ss: ss2sql.Session) -> None:
    script = """SELECT a.this, b.this FROM a = [1, 2], b = [1, 2] WHERE [] == (SELECT this FROM pairs
    WHERE eval(this[0] + ".this;") == eval(this[1] + ".this;") AS list) AS list"""
    assert ss.run(script, engine="database", pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    query = ss.compile(script, engine="database")
    assert "no SQL" in str(query.sql)
    assert query.run(pairs=[["a", "b"]]).value == [1, 2, 2, 1]
    assert query.run(pairs=[["a", "a"]]).value == []
    with pytest.raises(ss2sql.UnsupportedError, match="eval"):
        query.run(pairs=[["a", "c"]])
    with pytest.raises(ss2sql.ResolveError, match="no source named 'c'"):
        ss.run(script, pairs=[["a", "c"]])


def test_a_function_that_changes_the_list_before_the_query_is_noticed(ss: ss2sql.Session) -> None:
    @ss.function(volatility="volatile")
    def ban(x: int) -> int:
        ss.run(f"banned = [{x}];")
        return x

    assert ss.run(f"banned = [3]; ban(1); {WITHOUT}").value == [1]


def test_a_text_relies_on_the_types_of_its_variables(ss: ss2sql.Session) -> None:
    ss.set("n", 1)
    query = ss.compile("SELECT this FROM [1, 2, 3] WHERE this > eval('n') AS list")
    assert "eval" not in str(query.sql)
    for value, expected in ((1, [2, 3]), (2.5, [3]), (0, [1, 2, 3])):
        ss.set("n", value)
        assert query.run().value == expected
    ss.set("n", "x")
    with pytest.raises(ss2sql.ExecutionError):
        query.run()
