"""Python functions in scripts: registration, names, what they replace, get and give, how often they are called."""

from __future__ import annotations

import ast
import math
from pathlib import PurePath
from typing import Any

import numpy as np
import pytest
from golden import each_row
from random_values import Thing, Unhashable
from sessions import code_of

import ss2sql


def test_the_forms_of_registration(ss: ss2sql.Session) -> None:
    seen: list[int] = []

    @ss.function
    def one(x):
        return x + 1

    @ss.function()
    def two(x):
        seen.append(x)
        return x + 2

    @ss.function("drei", volatility="immutable")
    def three(x):
        return x + 3

    @ss.function(volatility="stable")
    def four(x):
        return x + 4

    assert ss.function("fünf", three) is three
    assert ss.function(three) is three
    assert (one(1), two(1), three(1), four(1)) == (2, 3, 4, 5)
    ss.function("hyp", math.hypot)
    assert ss.eval("[one(1), two(1), drei(1), four(1), fünf(1), three(1), hyp(3, 4)];") == [2, 3, 4, 5, 4, 4, 5.0]
    found = {name: (entry.volatility, entry.inferred) for name, entry in ss.host.functions.items()}
    assert found == {
        "one": ("immutable", True), "two": ("volatile", True), "drei": ("immutable", False), "four": ("stable", False),
        "fünf": ("immutable", True), "three": ("immutable", True), "hyp": ("immutable", True),
    }  # fmt: skip
    assert all(entry.reason for entry in ss.host.functions.values())


def test_the_number_of_arguments_is_that_of_the_signature(ss: ss2sql.Session) -> None:
    ss.function("two", lambda a, b=10, *, c=100: a + b + c)
    ss.function("many", lambda a, *rest: [a, *rest])
    assert ss.eval("[two(1), two(1, 2), many(1), many(1, 2, 3, 4, 5)];") == [111, 103, [1], [1, 2, 3, 4, 5]]
    for call, words in (
        ("two()", "takes 1 to 2 arguments, not 0"), ("two(1, 2, 3)", "1 to 2 arguments, not 3"),
        ("many()", "takes 1 or more arguments, not 0"),
    ):  # fmt: skip
        with pytest.raises(ss2sql.ResolveError, match=rf"R005.*{words}") as caught:
            ss.run(f"SELECT {call} FROM [1];")
        assert caught.value.span is not None
        assert caught.value.span.text == call


def test_what_cannot_be_registered(ss: ss2sql.Session) -> None:
    class Nameless:
        def __call__(self, x):
            return x

    for arguments in (("1x", len), ("f", 3), ("f", lambda *, key: key), (Nameless(),), (lambda x: x,)):
        assert code_of(ss.function, *arguments) == "S002"
    assert code_of(ss.function, "f", len, volatility="pure") == "S002"
    ss.function("named", Nameless())
    assert ss.eval("named(3);") == 3


# --- in place of built-in ones -------------------------------------------------------------------------


def test_operators_and_functions_can_be_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
    ss.function("lt", lambda a, b: len(a) < len(b))
    ss.function("in", lambda a, b: a == b[-1])
    ss.function("neg", lambda a: a[::-1])
    script = "SELECT this + [10, 20], -this, this < [1, 2, 3], 5 IN this, 1 + 2 FROM [[1, 2], [3, 5]] AS rows;"
    rows = [([11, 22], [2, 1], True, False, 3), ([13, 25], [5, 3], True, True, 3)]
    assert ss.run(script, engine=engine).value == rows
    ss.function("max", lambda x: ["mine", x])
    ss.function("len", lambda x: -1)
    assert ss.run("SELECT max(this), len(this) FROM ['ab'] AS rows;", engine=engine).value == [(["mine", "ab"], -1)]
    ss.function("max", lambda x: x * 100, volatility="immutable")
    script = "SELECT max(this), min(this) FROM [1, 2, 1] GROUP BY max(this) AS rows;"
    assert ss.run(script, engine="auto" if engine == "database" else engine).value == [(100, 1), (200, 2)]


NAMES = [
    # words of SQL
    "table", "order", "where", "join", "null", "cast", "case", "match", "like", "glob", "abs", "round", "total",
    "coalesce", "iif", "likelihood", "row_number", "avg", "raise", "Values", "CURRENT_TIME", "default",
    # functions that the compiled SQL uses
    "list", "record", "truth", "in_turn", "field", "elements", "search", "next_step", "keep", "on_path", "reach",
    "reached", "collect", "collect_rows", "group_sum", "list_max", "count", "sum", "item", "slice",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_functions_may_have_any_name(ss: ss2sql.Session, engine: Any, name: str) -> None:
    ss.function(name, lambda *arguments: 100 + sum(arguments), volatility="immutable")
    script = f"""SELECT {name}(this, 1), {name}(5) FROM [1, 2] WHERE {name}(this) > 101
    START WITH n = 1 CONNECT BY n = n + {name}(n) STOP WITH n > 1 AS rows;"""
    assert ss.run(script, engine=engine).value == [[(102, 105), (103, 105)], [(103, 105)], [(103, 105), (103, 105)]]


# --- how often they are called -------------------------------------------------------------------------


class Counted:
    """A function that notes its arguments."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def __call__(self, *arguments: Any) -> Any:
        self.seen.append(arguments[0] if len(arguments) == 1 else arguments)
        return arguments[0]


def test_an_immutable_function_is_called_once_for_each_different_argument(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    values = [1, 1.0, True, 0, False, 0.0, -0.0, "1", None, [1], [1.0], [True], {"a": 1}, {"a": 1.0}]
    ss.attach("items", values * 3)
    result = ss.run("SELECT f(this), f(this) FROM items WHERE f(this) == this AS list;", engine=engine)
    assert repr(result.value) == repr([value for value in values * 3 for _ in range(2)])
    assert repr(f.seen) == repr(values)
    assert result.stats.calls == {"f": len(values)}


@pytest.mark.parametrize("arguments", [(1, 1.0), (1.0, 1), ("a", 0.0), (-0.0, "a"), (None, True), ([1], 2)])
def test_all_arguments_count(ss: ss2sql.Session, engine: Any, arguments: tuple[Any, ...]) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("a", [arguments[0]])
    ss.attach("b", [arguments[1]])
    script = "SELECT f(a.this, b.this), f(b.this, a.this), f(a.this, b.this) FROM a, b, c = [1, 2] AS list;"
    result = ss.run(script, engine=engine)
    assert repr(f.seen) == repr([arguments, arguments[::-1]])
    assert result.stats.calls == {"f": 2}


@each_row("queries/calls-of-each-run", "script", "told")
def test_calls_of_each_run(ss: ss2sql.Session, engine: Any, told: str, script: str) -> None:
    volatility, value, seen = ast.literal_eval(told)
    f = ss.function("f", Counted(), volatility=volatility)
    query = ss.compile(script)
    for _ in range(2):
        result = query.run(engine="auto" if volatility == "volatile" and engine == "database" else engine)
        assert result.value == value
        assert result.stats.calls == {"f": len(seen)}
    assert f.seen == seen * 2


def test_a_stable_function_is_asked_anew_by_the_next_statement(ss: ss2sql.Session, engine: Any) -> None:
    """What it looks at may have been moved in between."""
    places = {"robot": 1}
    f = ss.function("place", Counted(), volatility="stable")
    ss.function("where", lambda name: f(name) and places[name], volatility="stable")
    ss.function("move", lambda name, place: places.update({name: place}) or place, volatility="volatile")
    script = """before = SELECT where("robot") + this FROM [0, 1] AS list; move("robot", 5);
                after = SELECT where("robot") + this FROM [0, 1] AS list; alone = where("robot");
                move("robot", 7); [before, after, alone, where("robot")];"""
    assert ss.run(script, engine=engine if engine == "native" else "auto").value == [[1, 2], [5, 6], 5, 7]
    assert len(f.seen) == 4


@pytest.mark.parametrize("volatility", ["immutable", "stable"])
def test_without_a_memo_results_are_the_same(engine: Any, volatility: Any) -> None:
    with ss2sql.connect(disable=["memo"]) as ss:
        f = ss.function("f", Counted(), volatility=volatility)
        result = ss.run("SELECT f(this) FROM [1, 1, 2, 1] AS list;", engine=engine)
        assert result.value == f.seen == [1, 1, 2, 1]
        assert result.stats.calls == {"f": 4}


def test_old_entries_leave_a_full_memo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.session.host.MEMO_LIMIT", 2)
    with ss2sql.connect() as ss:
        for engine in ("database", "native"):
            f = ss.function("f", Counted(), volatility="immutable")
            result = ss.run("SELECT f(this) FROM [1, 2, 1, 3, 1, 2.0, 2] AS list;", engine=engine)  # type: ignore[arg-type]
            assert repr(result.value) == "[1, 2, 1, 3, 1, 2.0, 2]"
            assert repr(f.seen) == "[1, 2, 3, 1, 2.0, 2]"
            assert result.stats.remembered == {"f": 1}


def test_objects_are_told_apart_by_identity(ss: ss2sql.Session, engine: Any) -> None:
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("items", [first, second, first, [first], [second], [first]])
    result = ss.run("SELECT f(this) FROM items AS list;", engine=engine)
    assert f.seen == [first, second, [first], [second]]
    assert result.value[5][0] is first


def test_what_was_proved_of_plain_data_is_not_trusted_with_objects(ss: ss2sql.Session, engine: Any) -> None:
    class Dice:
        value = 0

        def __add__(self, other):
            self.value += 1
            return self.value

    dice = Dice()
    ss.function("roll", lambda x: x + 1)
    ss.function("roll_first", lambda x: x[0] + 1)
    assert ss.host.functions["roll"].volatility == ss.host.functions["roll_first"].volatility == "immutable"
    ss.attach("items", [dice, dice, dice])
    assert ss.run("SELECT roll(this) FROM items AS list;", engine=engine).value == [1, 2, 3]
    ss.attach("items", [[dice], [dice]])
    assert ss.run("SELECT roll_first(this) FROM items AS list;", engine=engine).value == [4, 5]


def test_the_database_refuses_volatile_calls_out_of_the_written_order(ss: ss2sql.Session) -> None:
    ss.function("tick", lambda: 1, volatility="volatile")
    for script in (
        "SELECT tick() FROM [2, 1] ORDER BY this;", "SELECT this, max(tick()) FROM [2, 1] GROUP BY this;",
        "SELECT len(SELECT tick() FROM [1] AS list) FROM [2, 1];",
        "SELECT tick() FROM [2, 1] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 0;",
    ):  # fmt: skip
        with pytest.raises(ss2sql.UnsupportedError, match="volatile function must be called in written order"):
            ss.run(script, engine="database")
        assert ss.run(script).engine == "native"


def test_an_aggregate_of_the_users_gets_the_values_of_a_group(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE t(k, x)")
        ss.host.connection.execute("INSERT INTO t VALUES (1, 5), (2, 7), (1, NULL), (1, 3), (2, NULL)")
        ss.aggregate("texts", lambda values, mark=" ": mark.join(map(str, values)))

        @ss.aggregate("largest", volatility="immutable")
        def greatest(values: list[Any]) -> Any:
            return max(values)

        assert greatest([1, 2]) == 2
        for script, expected in [
            ("SELECT k, texts(x) FROM t GROUP BY k AS rows;", [(1, "5 3"), (2, "7")]),
            ("SELECT k, texts(x, '-'), largest(x) FROM t GROUP BY k AS rows;", [(1, "5-3", 5), (2, "7", 7)]),
            ("SELECT k FROM t GROUP BY k HAVING largest(x) > 5 ORDER BY texts(x) AS list;", [2]),
            ("SELECT texts(x + k, k) FROM t WHERE x != None GROUP BY str(k) AS list;", None),
            ("texts([1, [2]]);", "1 [2]"),
            ("SELECT texts(this) FROM [[1, 2], [3]] AS list;", ["1 2", "3"]),
        ]:
            if expected is None:
                with pytest.raises(ss2sql.ResolveError, match="belongs to a row"):
                    ss.run(script)
            elif "GROUP" in script and engine == "database":
                with pytest.raises(ss2sql.UnsupportedError, match="U001"):
                    ss.run(script, engine=engine)
            else:
                assert ss.run(script, engine=engine).value == expected, script


def test_an_aggregate_takes_a_list() -> None:
    with ss2sql.connect() as ss:
        with pytest.raises(ss2sql.SessionError, match="takes no list"):
            ss.aggregate("nobody", lambda: 1)
        ss.aggregate("both", lambda values: values, volatility="immutable")
        with pytest.raises(ss2sql.ResolveError, match="both needs a list"):
            ss.run("SELECT both(this) FROM [1, 2];")
        with pytest.raises(ss2sql.ResolveError, match="single rows"):
            ss.run("SELECT both(count(*)) FROM [1] GROUP BY this;")
        assert ss.eval("SELECT both(this) FROM [1, None] GROUP BY this AS list;") == [[1], []]


# --- what functions get, and what comes back ------------------------------------------------------------


def test_what_a_function_does_to_its_arguments_is_seen_by_nobody(ss: ss2sql.Session, engine: Any) -> None:
    thing = Thing()
    items: list[Any] = [[1], {"a": [2]}, [thing]]
    ss.attach("items", items)

    @ss.function(volatility="stable")
    def spoil(x, y):
        x[0 if isinstance(x, list) else "a"] = 9
        y.clear()
        return x

    result = ss.run("SELECT this, spoil(this, this), this FROM items AS rows;", engine=engine)
    assert result.value == [([1], [9], [1]), ({"a": [2]}, {"a": 9}, {"a": [2]}), ([thing], [9], [thing])]
    assert items == [[1], {"a": [2]}, [thing]]


def test_a_function_that_changes_nothing_gets_the_value_itself(ss: ss2sql.Session, engine: Any) -> None:
    """`same` is proven to change nothing, so it gets the value itself and gives it back."""

    @ss.function
    def same(x):
        return x

    @ss.function
    def grow(x):
        x[0].append(1)
        return x

    assert (ss.host.functions["same"].changes, ss.host.functions["grow"].changes) == (False, True)
    result = ss.run("SELECT grow(same(this)), same(this), this FROM [[[]], [[2]]] AS rows;", engine=engine)
    assert result.value == [([[1]], [[]], [[]]), ([[2, 1]], [[2]], [[2]])]

    class Sized(Unhashable):
        def __len__(self) -> int:
            return 3

    ss.function("length", lambda x: len(x))
    ss.attach("things", [[Sized()], Sized()])
    assert ss.run("SELECT length(this) FROM things AS list;", engine=engine).value == [1, 3]


def test_a_function_may_keep_what_it_got_and_gave(ss: ss2sql.Session, engine: Any) -> None:
    kept: list[Any] = []

    @ss.function(volatility="stable")
    def keep(x):
        kept.append(x)
        return x

    value = ss.run("SELECT keep(this) FROM [[1], [2]] AS list;", engine=engine).value
    for item in kept:
        item.append("changed")
    assert value == [[1], [2]]
    value[0].append("mine")
    assert kept == [[1, "changed"], [2, "changed"]]
    log: list[int] = []
    ss.function("log", lambda x: log.append(x) or log, volatility="volatile")
    engine = "native" if engine == "native" else "auto"
    assert ss.run("SELECT log(this) FROM [1, 2, 3] AS list;", engine=engine).value == [[1], [1, 2], [1, 2, 3]]


def test_objects_come_back_identical(ss: ss2sql.Session, engine: Any) -> None:
    objects = [Thing(), Unhashable(), Unhashable(), Thing, len, PurePath("a"), PurePath("a")]
    ss.attach("objects", objects)
    ss.function("same", lambda x: x)
    ss.function("boxed", lambda x: [{"object": x}])
    ss.function("is_one", lambda x: type(x) is Unhashable)
    result = ss.run("SELECT this, same(this), boxed(this), [this, 1.0] FROM objects AS rows;", engine=engine)
    for given, row in zip(objects, result.value, strict=True):
        assert row[0] is row[1] is row[2][0]["object"] is row[3][0] is given
    found = ss.run("SELECT this FROM objects WHERE is_one(this) AS list;", engine=engine).value
    assert [item is given for item, given in zip(found, objects[1:3], strict=True)] == [True, True]
    script = (
        "SELECT o FROM objects WHERE n == 2 START WITH o = 0, n = 0 CONNECT BY o = this, n = n + 1 STOP WITH n == 2;"
    )
    paths = ss.run(script, engine=engine).paths
    assert paths[0][2][0] is objects[0]
