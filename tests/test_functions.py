"""Python functions in scripts: registration, what they get and give, how often they are called, how they fail."""

from __future__ import annotations

import math
import traceback
from collections import OrderedDict
from typing import Any

import numpy as np
import pytest
from listings import ROBOT

import ss2sql

both = pytest.mark.parametrize("engine", ["database", "native"])
MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


@pytest.fixture
def ss():
    with ss2sql.connect() as session:
        yield session


class Counted:
    """A function that notes its arguments."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def __call__(self, *arguments: Any) -> Any:
        self.seen.append(arguments[0] if len(arguments) == 1 else arguments)
        return arguments[0]


# --- registration --------------------------------------------------------------------------------------


def test_the_forms_of_registration(ss: ss2sql.Session) -> None:
    @ss.function
    def one(x):
        return x + 1

    @ss.function()
    def two(x):
        return x + 2

    @ss.function("drei", volatility="immutable")
    def three(x):
        return x + 3

    @ss.function(volatility="stable")
    def four(x):
        return x + 4

    def five(x):
        return x + 5

    assert ss.function("fünf", five) is five
    assert ss.function(five) is five
    assert (one(1), two(1), three(1), four(1)) == (2, 3, 4, 5)
    ss.function("hyp", math.hypot)
    assert ss.eval("[one(1), two(1), drei(1), four(1), fünf(1), five(1), hyp(3, 4)];") == [2, 3, 4, 5, 6, 6, 5.0]
    assert [ss.host.functions[name].volatility for name in ("one", "drei", "four")] == [
        "immutable",
        "immutable",
        "stable",
    ]


def test_volatility_is_inferred_from_the_source(ss: ss2sql.Session) -> None:
    seen = []

    @ss.function
    def pure(x):
        return [y * 2 for y in x]

    @ss.function
    def changes_its_argument(x):
        x.append(1)
        return x

    @ss.function
    def remembers(x):
        seen.append(x)
        return x

    ss.function("unreadable", eval("lambda x: x"))
    words = {name: entry.volatility for name, entry in ss.host.functions.items()}
    assert words == {
        "pure": "immutable",
        "changes_its_argument": "immutable",
        "remembers": "volatile",
        "unreadable": "volatile",
    }
    assert all(entry.inferred and entry.reason for entry in ss.host.functions.values())


def test_the_number_of_arguments_is_that_of_the_signature(ss: ss2sql.Session) -> None:
    ss.function("two", lambda a, b=10, *, c=100: a + b + c)
    ss.function("many", lambda a, *rest: [a, *rest])
    assert ss.eval("[two(1), two(1, 2), many(1), many(1, 2, 3, 4, 5)];") == [111, 103, [1], [1, 2, 3, 4, 5]]
    for call, words in (("two()", "takes 1 to 2 arguments, not 0"), ("two(1, 2, 3)", "1 to 2 arguments, not 3"),
                        ("many()", "takes 1 or more arguments, not 0")):  # fmt: skip
        with pytest.raises(ss2sql.ResolveError, match=words) as caught:
            ss.run(f"SELECT {call} FROM [1];")
        assert caught.value.code == "R005"
        assert caught.value.span is not None
        assert caught.value.span.text == call


def test_what_cannot_be_registered(ss: ss2sql.Session) -> None:
    class Nameless:
        def __call__(self, x):
            return x

    for arguments, named in (
        (("1x", lambda x: x), {}),
        (("f", 3), {}),
        (("f", lambda x: x), {"volatility": "pure"}),
        (("f", lambda *, key: key), {}),
        ((Nameless(),), {}),
        ((lambda x: x,), {}),
    ):
        with pytest.raises(ss2sql.SessionError) as caught:
            ss.function(*arguments, **named)
        assert caught.value.code == "S002"
    ss.function("named", Nameless())
    assert ss.eval("named(3);") == 3


# --- how often -----------------------------------------------------------------------------------------


@both
def test_an_immutable_function_is_called_once_for_each_different_argument(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    values = [1, 1.0, True, 0, False, 0.0, -0.0, "1", None, [1], [1.0], [True], {"a": 1}, {"a": 1.0}]
    ss.attach("items", values * 3)
    result = ss.run("SELECT f(this), f(this) FROM items WHERE f(this) == this AS list;", engine=engine)
    assert repr(result.value) == repr([value for value in values * 3 for _ in range(2)])
    assert repr(f.seen) == repr(values)
    assert result.stats.calls == {"f": len(values)}


@both
@pytest.mark.parametrize("arguments", [(1, 1.0), (1.0, 1), ("a", 0.0), (-0.0, "a"), (None, True), ([1], 2)])
def test_all_arguments_count(ss: ss2sql.Session, engine: Any, arguments: tuple[Any, ...]) -> None:
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("a", [arguments[0]])
    ss.attach("b", [arguments[1]])
    script = "SELECT f(a.this, b.this), f(b.this, a.this), f(a.this, b.this) FROM a, b, c = [1, 2] AS list;"
    result = ss.run(script, engine=engine)
    assert repr(f.seen) == repr([arguments, arguments[::-1]])
    assert result.stats.calls == {"f": 2}


@both
def test_a_stable_function_is_called_once_in_a_run(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="stable")
    query = ss.compile("SELECT f(1) FROM [1, 2, 3] AS list;")
    query.run(engine=engine)
    query.run(engine=engine)
    assert f.seen == [1, 1]


@both
def test_a_stable_function_is_asked_anew_by_the_next_statement(ss: ss2sql.Session, engine: Any) -> None:
    """What it looks at may have been moved in between."""
    places = {"robot": 1}
    f = ss.function("place", Counted(), volatility="stable")
    ss.function("where", lambda name: f(name) and places[name], volatility="stable")
    ss.function("move", lambda name, place: places.update({name: place}) or place, volatility="volatile")
    script = """before = SELECT where("robot") + this FROM [0, 1] AS list;
                move("robot", 5);
                after = SELECT where("robot") + this FROM [0, 1] AS list;
                alone = where("robot");
                move("robot", 7);
                [before, after, alone, where("robot")];"""
    assert ss.run(script, engine=engine if engine == "native" else "auto").value == [[1, 2], [5, 6], 5, 7]
    assert len(f.seen) == 4


@both
def test_a_volatile_function_is_called_for_every_occurrence_in_written_order(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="volatile")
    g = ss.function("g", Counted(), volatility="volatile")
    result = ss.run("SELECT f(this), g(0), f(this) FROM [1, 2, 3] WHERE f(this) > 1 AND g(5) AS list;", engine=engine)
    assert result.value == [2, 0, 2, 3, 0, 3]
    assert f.seen == [1, 2, 2, 2, 3, 3, 3]
    assert g.seen == [5, 0, 5, 0]
    assert result.stats.calls == {"f": 7, "g": 4}


@both
def test_what_the_left_side_decides_is_not_called(ss: ss2sql.Session, engine: Any) -> None:
    f = ss.function("f", Counted(), volatility="volatile")
    ss.run("SELECT this FROM [1, 2, 3] WHERE this > 1 AND f(this) > 2 OR this == 1 OR f(10);", engine=engine)
    assert f.seen == [2, 10, 3]
    f.seen.clear()
    ss.run("SELECT IF(this > 1; f(this); f(-this)) FROM [1, 2];", engine=engine)
    assert f.seen == [-1, 2]


@both
@pytest.mark.parametrize("volatility", ["immutable", "volatile"])
def test_without_a_memo_results_are_the_same(engine: Any, volatility: Any) -> None:
    with ss2sql.connect(disable=["memo"]) as ss:
        f = ss.function("f", Counted(), volatility=volatility)
        result = ss.run("SELECT f(this) FROM [1, 1, 2, 1] AS list;", engine=engine)
        assert result.value == f.seen == [1, 1, 2, 1]
        assert result.stats.calls == {"f": 4}


def test_old_entries_leave_a_full_memo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.runtime.host.MEMO_LIMIT", 2)
    with ss2sql.connect() as ss:
        for engine in ("database", "native"):
            f = ss.function("f", Counted(), volatility="immutable")
            result = ss.run("SELECT f(this) FROM [1, 2, 1, 3, 1, 2.0, 2] AS list;", engine=engine)  # type: ignore[arg-type]
            assert repr(result.value) == "[1, 2, 1, 3, 1, 2.0, 2]"
            assert repr(f.seen) == "[1, 2, 3, 1, 2.0, 2]"
            assert result.stats.remembered == {"f": 1}


@both
def test_calls_are_counted_for_each_run(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", Counted(), volatility="immutable")
    query = ss.compile("SELECT f(this) FROM [1, 2] AS list;")
    assert [query.run(engine=engine).stats.calls["f"] for _ in range(2)] == [2, 2]


@both
def test_objects_are_told_apart_by_identity(ss: ss2sql.Session, engine: Any) -> None:
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    f = ss.function("f", Counted(), volatility="immutable")
    ss.attach("items", [first, second, first, [first], [second], [first]])
    result = ss.run("SELECT f(this) FROM items AS list;", engine=engine)
    assert f.seen == [first, second, [first], [second]]
    assert result.value[5][0] is first


@both
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


# --- fresh values --------------------------------------------------------------------------------------


def moving(step, towers):
    """The paper's function: it changes its argument."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


def pure(step, towers):
    """The same without changing anything."""
    if not towers or not towers[step[0]]:
        return []
    disk = towers[step[0]][-1]
    if towers[step[1]] and towers[step[1]][-1] < disk:
        return []
    changed = {step[0]: towers[step[0]][:-1], step[1]: [*towers[step[1]], disk]}
    return [changed.get(index, tower) for index, tower in enumerate(towers)]


HANOI = """SELECT this, tower FROM moves WHERE [[], [], [3, 2, 1]] == move(this, tower)
START WITH tower = [[3, 2, 1], [], []], level = 1
CONNECT BY {option} tower = move(this, tower), level = level + 1
STOP WITH level == 8 OR [] == move(this, tower);"""
FLAT = """SELECT a.this, move(a.this, start), move(b.this, move(a.this, start)), start FROM a = moves, b = moves
WHERE [] != move(a.this, start) AND len(move(b.this, move(a.this, start))) == 3 AS rows;"""
START = "start = [[3, 2, 1], [], []]; "


@both
@pytest.mark.parametrize("volatility", ["immutable", "volatile"])
@pytest.mark.parametrize("disable", [(), ("memo",)])
@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "MEMORIZE 8", "MAXIMUM 1"])
def test_a_function_that_changes_its_argument_and_its_pure_twin_agree(
    engine: Any, volatility: Any, disable: tuple[str, ...], option: str
) -> None:
    if engine == "database" and ("MEMORIZE" in option or volatility == "volatile"):
        engine = "auto"
    answers = []
    for function in (moving, pure):
        with ss2sql.connect(disable=disable) as ss:
            ss.attach("moves", MOVES)
            ss.function("move", function, volatility=volatility)
            answers.append((ss.run(HANOI.format(option=option), engine=engine).value, ss.eval(START + FLAT)))
    assert answers[0] == answers[1]
    paths, rows = answers[0]
    lengths = [len(path) for path in paths]
    # With UNIQUE each of the two moves that end the game, with the towers before it, is reached once.
    expected = {"UNIQUE": {7: 1, 8: 1}, "MAXIMUM 1": {8: 1}}.get(option, {7: 1, 8: 4})
    assert {length: lengths.count(length) for length in lengths} == expected
    assert all(row[3] == [[3, 2, 1], [], []] for row in rows)


@both
def test_what_a_function_does_to_its_arguments_is_seen_by_nobody(ss: ss2sql.Session, engine: Any) -> None:
    items = [[1], {"a": [2]}]
    ss.attach("items", items)

    @ss.function(volatility="volatile")
    def spoil(x, y):
        x[0 if isinstance(x, list) else "a"] = 9
        y.clear()
        return x

    result = ss.run("SELECT this, spoil(this, this), this FROM items AS rows;", engine=engine)
    assert result.value == [([1], [9], [1]), ({"a": [2]}, {"a": 9}, {"a": [2]})]
    assert items == [[1], {"a": [2]}]


@both
def test_a_value_that_was_not_copied_is_safe_from_others(ss: ss2sql.Session, engine: Any) -> None:
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


@both
def test_objects_are_unwrapped_for_a_function_that_changes_nothing(ss: ss2sql.Session, engine: Any) -> None:
    class Thing:
        __hash__ = None  # type: ignore[assignment]
        size = 3

        def __len__(self) -> int:
            return self.size

    @ss.function
    def length(x):
        return len(x)

    ss.attach("things", [[Thing()], Thing()])
    assert ss.run("SELECT length(this) FROM things AS list;", engine=engine).value == [1, 3]


@both
def test_a_function_may_keep_what_it_got_and_gave(ss: ss2sql.Session, engine: Any) -> None:
    kept: list[Any] = []

    @ss.function(volatility="volatile")
    def keep(x):
        kept.append(x)
        return x

    value = ss.run("SELECT keep(this) FROM [[1], [2]] AS list;", engine=engine).value
    for item in kept:
        item.append("changed")
    assert value == [[1], [2]]
    value[0].append("mine")
    assert kept == [[1, "changed"], [2, "changed"]]


# --- what comes back -----------------------------------------------------------------------------------


class Plain:
    pass


class Unhashable:
    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unhashable)


@both
def test_objects_come_back_identical(ss: ss2sql.Session, engine: Any) -> None:
    objects = [Plain(), Unhashable(), Unhashable(), Plain, len]
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


@both
@pytest.mark.parametrize(
    "value",
    [True, False, 1, 1.0, -0.0, 0.1 + 0.2, 1e308, 5e-324, 2**63 - 1, -(2**63), 2.0**53 + 2, "", "ä\u2028\0x", "\ud800",
     None, [], [[]], [True, 1, 1.0], {"a": True, "b": [1.0]}, {}],
)  # fmt: skip
def test_values_are_exact_on_every_way(ss: ss2sql.Session, engine: Any, value: Any) -> None:
    ss.attach("x", [value])
    ss.function("same", lambda x: x)
    ss.function("given", lambda: value, volatility="volatile")
    ss.function("arrived", lambda x: repr(x) == repr(value), volatility="immutable")
    script = "SELECT this, same(this), given(), [this][0], IF(True; this), arrived(this) FROM x AS rows;"
    assert repr(ss.run(script, engine=engine).value) == repr([(value, value, value, value, value, True)])
    nested = "SELECT y.this, z.this FROM y = (SELECT this FROM x AS list), z = [(SELECT this FROM x AS value)] AS rows;"
    assert repr(ss.run(nested, engine=engine).value) == repr([(value, value)])
    search = "SELECT s FROM x WHERE n == 1 START WITH s = x[0], n = 0 CONNECT BY s = this, n = n + 1 STOP WITH n == 1;"
    assert repr(ss.run(search, engine=engine).paths) == repr([[(value,), (value,)]])


@both
@pytest.mark.parametrize(
    ("given", "value"),
    [((1, (2, 3)), [1, [2, 3]]), ({3, 1, 2}, [1, 2, 3]), (frozenset("ba"), ["a", "b"]), (range(3), [0, 1, 2]),
     (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]), (np.float32(0.5), 0.5), (np.int64(7), 7), (np.bool_(True), True),
     (np.str_("s"), "s"), (OrderedDict(a=(1,)), {"a": [1]}), ([np.array([1.5])], [[1.5]])],
)  # fmt: skip
def test_what_python_returns_becomes_a_value(ss: ss2sql.Session, engine: Any, given: Any, value: Any) -> None:
    ss.function("f", lambda: given, volatility="volatile")
    result = ss.run("SELECT f() FROM [1] AS value;", engine=engine)
    assert repr(result.value) == repr(value)


@both
def test_a_generator_is_read_once_into_a_list(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("letters", lambda text: (letter for letter in text), volatility="immutable")
    assert ss.run("SELECT letters('ab'), len(letters('ab')) FROM [1, 2] AS rows;", engine=engine).value == [
        (["a", "b"], 2),
        (["a", "b"], 2),
    ]


@both
@pytest.mark.parametrize(
    ("given", "words"),
    [(float("nan"), "returned NaN"), (float("-inf"), "returned -inf"), (2**63, "64 bits"), (-(2**63) - 1, "64 bits"),
     (1j, "complex"), ([1, [float("nan")]], r"NaN at \[1\]\[0\]"), ({"a": 2**64}, "at \\['a'\\]"),
     (np.array([np.inf]), "inf")],
)  # fmt: skip
def test_what_is_no_value_is_refused_with_the_name_of_the_function(
    ss: ss2sql.Session, engine: Any, given: Any, words: str
) -> None:
    ss.function("sensor", lambda x: given, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match=words) as caught:
        ss.run("SELECT this\nFROM [1] WHERE True AND sensor(this);", engine=engine)
    assert caught.value.code == "X004"
    assert caught.value.message.startswith("the function 'sensor' returned")
    assert caught.value.span is not None
    assert (caught.value.span.line, caught.value.span.text) == (2, "sensor(this)")
    assert ss.eval("1 + 1;") == 2


# --- exceptions ----------------------------------------------------------------------------------------


class CrashError(RuntimeError):
    pass


class SlottedError(Exception):
    __slots__ = ()


def notes_of(ss: ss2sql.Session, script: str, engine: Any, kind: type[BaseException]) -> list[str]:
    with pytest.raises(kind) as caught:
        ss.run(script, engine=engine)
    assert type(caught.value) is kind
    assert caught.value.__cause__ is None
    lines = traceback.format_exception(caught.value)
    assert any("in broken" in line for line in lines), "the user's own frame is in the traceback"
    assert ss.eval("1 + 1;") == 2
    return list(caught.value.__notes__)


@both
@pytest.mark.parametrize("kind", [CrashError, SlottedError, KeyError, StopIteration, ZeroDivisionError, AssertionError])
def test_an_exception_keeps_its_type_and_gets_one_note(ss: ss2sql.Session, engine: Any, kind: Any) -> None:
    def broken(x):
        raise kind("no")

    ss.function("broken", broken)
    notes = notes_of(ss, "SELECT this,\n  broken(this) FROM [1, 2];", engine, kind)
    assert notes == ["raised by the function 'broken', called at <script>:2:3\n  2 |   broken(this) FROM [1, 2];"]


@both
def test_a_note_names_the_place_among_several(ss: ss2sql.Session, engine: Any) -> None:
    def broken(x):
        if x == 2:
            raise CrashError("no")
        return x

    ss.function("broken", broken, volatility="volatile")
    (note,) = notes_of(ss, "SELECT broken(this)\nFROM [1, 2] WHERE broken(1) AND\nbroken(this);", engine, CrashError)
    assert note.startswith("raised by the function 'broken', called at ")
    assert "<script>:3:1" in note
    assert "3 | broken(this);" in note
    if engine == "database":  # SQLite does not say which of the calls it was; all are named, in the order of the text
        assert "<script>:1:8, <script>:2:19, <script>:3:1" in note


@both
@pytest.mark.parametrize(
    "script",
    ["broken(1);", "x = [1, broken(2)];", "SELECT this FROM broken(1);",
     "SELECT this FROM a = [1], b = broken(a.this);",
     "SELECT this FROM [1] ORDER BY broken(this);", "SELECT this FROM [1] GROUP BY broken(this);",
     "SELECT this FROM [1] LIMIT broken(1);", "SELECT (SELECT broken(a.this) FROM [1] AS value) FROM a = [1];",
     "SELECT this FROM [1] START WITH n = broken(1) CONNECT BY n = n;",
     "SELECT this FROM [1] START WITH n = 1 CONNECT BY n = broken(n);",
     "SELECT this FROM [1] START WITH n = 1 CONNECT BY n = n STOP WITH broken(n);",
     "SELECT broken(this) FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = n;"],
)  # fmt: skip
def test_exceptions_from_every_clause_get_their_note(ss: ss2sql.Session, engine: Any, script: str) -> None:
    def broken(x):
        raise CrashError("no")

    ss.function("broken", broken, volatility="immutable")
    (note,) = notes_of(ss, script, engine, CrashError)
    assert f"called at <script>:1:{script.index('broken') + 1}\n" in note
    assert script in note


@both
def test_an_exception_through_two_scripts_gets_one_note(ss: ss2sql.Session, engine: Any) -> None:
    def broken(x):
        raise CrashError("no")

    ss.function("broken", broken, volatility="volatile")
    ss.function("outer", lambda x: ss.run("SELECT broken(this) FROM [7];", engine=engine), volatility="volatile")
    (note,) = notes_of(ss, "SELECT outer(this) FROM [1];", engine, CrashError)
    assert "broken" in note
    assert "FROM [7]" in note


@both
@pytest.mark.parametrize("kind", [SystemExit, GeneratorExit])
def test_what_is_no_error_passes_untouched(ss: ss2sql.Session, engine: Any, kind: Any) -> None:
    def leave(x):
        raise kind

    ss.function("leave", leave)
    with pytest.raises(kind):
        ss.run("SELECT leave(this) FROM [1];", engine=engine)
    assert ss.run("SELECT this FROM [1] AS list;", engine=engine).value == [1]


# --- in place of built-in ones -------------------------------------------------------------------------


@both
def test_operators_can_be_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
    ss.function("lt", lambda a, b: len(a) < len(b))
    ss.function("in", lambda a, b: a == b[-1])
    ss.function("neg", lambda a: a[::-1])
    script = "SELECT this + [10, 20], -this, this < [1, 2, 3], 5 IN this, 1 + 2 FROM [[1, 2], [3, 5]] AS rows;"
    assert ss.run(script, engine=engine).value == [
        ([11, 22], [2, 1], True, False, 3),
        ([13, 25], [5, 3], True, True, 3),
    ]
    assert ss.run("SELECT this NOT IN [5, 6] FROM [5, 6] AS list;", engine=engine).value in (
        [False, False],
        [True, False],
    )


@both
def test_equality_of_groups_and_searches_stays_the_languages(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("eq", lambda a, b: True)
    assert ss.run("SELECT this FROM [1, 2] WHERE this == 7 AS list;", engine=engine).value == [1, 2]
    assert ss.run("SELECT this, count(*) FROM [1, 2] GROUP BY this AS rows;", engine=engine).value == [(1, 1), (2, 1)]
    search = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this;"
    assert ss.run(search, engine=engine).paths == [[(1,)], [(2,)]]


@both
def test_built_in_functions_can_be_replaced(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("max", lambda x: ["mine", x])
    ss.function("len", lambda x: -1)
    assert ss.run("SELECT max(this), len(this) FROM ['ab'] AS rows;", engine=engine).value == [(["mine", "ab"], -1)]
    ss.function("max", lambda x: x * 100, volatility="immutable")
    script = "SELECT max(this), min(this) FROM [1, 2, 1] GROUP BY max(this) AS rows;"
    assert ss.run(script, engine="auto" if engine == "database" else engine).value == [(100, 1), (200, 2)]


def test_the_robot_listing_adds_vectors() -> None:
    with ss2sql.connect() as ss:
        walls = {(9, 8), (10, 8), (11, 8)}
        sounds: list[str] = []
        at = [10.0, 7.0]

        @ss.function("move", volatility="volatile")
        def move(robot, target):
            at[:] = target
            return target

        ss.function("position", lambda robot: [10.0, 7.0], volatility="stable")
        ss.function("checkCollision", lambda robot: tuple(at) in walls, volatility="volatile")
        ss.function("playSound", lambda file: sounds.append(file), volatility="volatile")
        ss.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
        result = ss.run(ROBOT.replace("MEMORIZE 20 MAXIMUM 1000", "MEMORIZE 6 MAXIMUM 10"))
        assert result.engine == "native"
        assert result.value[0][-1] == [10.0, 9.0]
        lengths = list(map(len, result.value))
        assert lengths == sorted(lengths)
        assert lengths[0] == 4  # two to the side of the wall and back again: 8.., 9..
        assert all(tuple(place) not in walls for path in result.value for place in path)
        assert set(sounds) == {"/usr/share/sounds/ubuntu/stereo/bell.ogg"}


# --- names ---------------------------------------------------------------------------------------------

WORDS_OF_SQL = ["table", "order", "where", "join", "null", "cast", "case", "match", "like", "glob", "abs", "round",
                "total", "coalesce", "iif", "likelihood", "row_number", "avg", "raise", "Values", "CURRENT_TIME",
                "default"]  # fmt: skip
HELPERS = ["list", "record", "truth", "in_turn", "field", "elements", "search", "next_step", "keep", "on_path", "reach",
           "reached", "collect", "collect_rows", "group_sum", "list_max", "count", "sum", "item", "slice"]  # fmt: skip


@both
@pytest.mark.parametrize("name", [*WORDS_OF_SQL, *HELPERS])
def test_functions_may_have_any_name(ss: ss2sql.Session, engine: Any, name: str) -> None:
    ss.function(name, lambda *arguments: 100 + sum(arguments), volatility="immutable")
    script = f"""SELECT {name}(this, 1), {name}(5) FROM [1, 2] WHERE {name}(this) > 101
    START WITH n = 1 CONNECT BY n = n + {name}(n) STOP WITH n > 1 AS rows;"""
    assert ss.run(script, engine=engine).value == [[(102, 105), (103, 105)], [(103, 105)], [(103, 105), (103, 105)]]


@both
def test_names_that_differ_in_case_are_different_functions(ss: ss2sql.Session, engine: Any) -> None:
    names = ("f", "F", "keep", "Keep", "KEEP", "keep_2", "count", "Count")
    for number, name in enumerate(names):
        ss.function(name, lambda x, number=number: x + 10**number, volatility="immutable")
    calls = ", ".join(f"{name}(this)" for name in names)
    assert ss.run(f"SELECT {calls} FROM [0] AS list;", engine=engine).value == [10**number for number in range(8)]


@pytest.mark.parametrize("engine", ["database", "native"])
def test_a_list_that_the_function_changes_after_returning_it_stays_as_it_was(engine: Any) -> None:
    ss = ss2sql.connect()
    kept: list[int] = []

    @ss.function(volatility="volatile")
    def log(x):
        kept.append(x)
        return kept

    assert ss.run("SELECT log(this) FROM [1, 2, 3] AS list;", engine=engine).value == [[1], [1, 2], [1, 2, 3]]
