"""The value rules: copies, truth, equality as keys, order, messages, what Python hands over, the way through SQLite."""

from __future__ import annotations

import datetime
import enum
import gc
import itertools
import pathlib
import weakref
from collections import UserList
from decimal import Decimal
from fractions import Fraction
from typing import Any

import apsw
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import ALIKE, NUMBERS, REFUSED, VALUES, Thing, Unhashable, label, python_values, same, values
from sessions import failure

import ss2sql
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.values import (
    Opaque,
    compare_values,
    convert_value,
    copy_for_python,
    format_value,
    get_truth,
    make_hashable,
    order_rows,
)
from ss2sql.runtime.sqlite.interning import Interning
from ss2sql.runtime.sqlite.sql_functions import MemberCache

lt, le, gt, ge = (OPERATIONS[name].value for name in ("lt", "le", "gt", "ge"))
GIVER = "the function 'f'"


def nested(depth: int, leaf: Any = 1) -> Any:
    for _ in range(depth):
        leaf = [leaf]
    return leaf


# --- copies and truth ----------------------------------------------------------------------------------


@given(VALUES)
def test_values_and_their_copies_are_the_same(value: Any) -> None:
    assert same(convert_value(value, GIVER), value)
    assert same(convert_value((1, [(value, value)]), GIVER), [1, [[value, value]]])
    copy = copy_for_python(value)
    assert same(convert_value(copy, GIVER), value)
    assert not _shares_structure(copy, value)


def _shares_structure(left: Any, right: Any) -> bool:
    if isinstance(left, list):
        return left is right or any(map(_shares_structure, left, right))
    if isinstance(left, dict):
        return left is right or any(map(_shares_structure, left.values(), right.values()))
    return False


def test_parts_that_were_shared_are_copied_apart() -> None:
    part = [1]
    for shared in ([part, part], [part, part, Thing()]):
        first, second, *_ = copy_for_python(shared)
        first.append(2)
        assert second == [1]


def test_truth() -> None:
    assert not any(map(get_truth, [None, 0, 0.0, -0.0, False, "", [], {}, b""]))
    assert all(map(get_truth, [True, -1, 0.5, "0", [[]], [0], {"a": 0}, b"0"]))

    class Empty(Unhashable):
        def __len__(self) -> int:
            return 0

    class Refusing(Unhashable):
        def __bool__(self) -> bool:
            raise ValueError("ambiguous")

    assert get_truth(convert_value(Empty(), GIVER)) is False
    assert get_truth(convert_value(Refusing(), GIVER)) is True
    assert get_truth(Refusing()) is True


# --- equality as keys ----------------------------------------------------------------------------------


@given(st.one_of(st.tuples(ALIKE, ALIKE), st.tuples(VALUES, VALUES)))
def test_keys_are_equal_exactly_where_values_are(pair: tuple[Any, Any]) -> None:
    left, right = pair
    assert (make_hashable(left) == make_hashable(right)) is (left == right)
    assert left != right or hash(make_hashable(left)) == hash(make_hashable(right))
    assert make_hashable(left) == make_hashable(convert_value(copy_for_python(left), GIVER))


def test_keys_of_chosen_values() -> None:
    equal = [
        (1, 1.0), (1, True), ([10, 9], [10.0, 9.0]), ([[0.0]], [[-0.0]]), ([True], [1]),
        ({"a": 1, "b": [1.0]}, {"b": [True], "a": 1}),
        ([b"a", 1.0], [b"a", 1]), (2**53, 2.0**53),
    ]  # fmt: skip
    pool = Interning()
    for left, right in equal:
        assert left == right
        assert make_hashable(left) == make_hashable(right)
        assert pool.make_key(pool.encode(left)) == pool.make_key(pool.encode(right))
    different = [
        [], [[]], {}, [{}], "", "[]", 0, "0", None, [None], "1", 1, b"", b"1", [b"1"], ["1"], [1], [[1]], [1, 1],
        {"a": 1}, {"a": "1"}, [["a", 1]], 2**53 + 1, 2.0**53, [2**53 + 1], [2.0**53], 2.0**63, [Decimal("0.1")], [0.1],
        make_hashable([1]),
    ]  # fmt: skip
    for left, right in itertools.combinations(different, 2):
        assert make_hashable(left) != make_hashable(right), (left, right)
        assert pool.make_key(pool.encode(left)) != pool.make_key(pool.encode(right)), (left, right)


def test_values_that_a_script_nested_too_deeply_have_no_key() -> None:
    assert failure(make_hashable, nested(1500, 0.5)).message == "cannot compare a value nested deeper than 500 levels"
    assert "deeper than 500 levels" in failure(Interning().encode, nested(3000)).message


# --- order ---------------------------------------------------------------------------------------------


def test_what_is_without_order_in_a_list_is_named() -> None:
    error = failure(lt, [1, ["a"]], [1.0, [2]])
    assert error.message == "cannot compare [1, ['a']] < [1.0, [2]], because of 'a' and 2"
    assert failure(order_rows, "ab", [([1],), (["a"],)], (False,)).message.startswith("cannot order ")
    assert "None" in failure(ge, None, 1).hints[0]


@given(values(st.one_of(st.none(), NUMBERS, st.text(max_size=9))))
def test_short_values_are_shown_whole(value: Any) -> None:
    assert format_value(value, 10_000) == repr(value)
    shown = format_value(value, 20)
    assert shown == repr(value) if len(repr(value)) <= 20 else shown.endswith("...") and len(shown) == 20


def test_values_in_messages() -> None:
    class Silent(Thing):
        def __repr__(self) -> str:
            raise ValueError

    assert format_value([Opaque(Thing()), Silent()]) == "[Thing, <Silent>]"
    assert format_value(np.zeros((2, 2))) == "array([[0., 0.], [0., 0.]])"
    assert len(format_value(list(range(10**6)))) == 60
    assert format_value(-(10**5000)) == "<integer of 16610 bits>"


# --- the border: what Python hands over becomes values, or is refused -----------------------------------


def test_python_values_become_plain_values() -> None:
    clean = [1, [2.5, "a", None], {"b": [True]}]
    assert convert_value(clean, GIVER) is clean
    pool = Interning()
    raw = np.float64(1.5).tobytes()  # which marshal would also make of the number
    assert [pool.decode(pool.encode_object([x], GIVER)) for x in (raw, np.float64(1.5))] == [[raw], [1.5]]
    thrice = [python_values() for _ in range(3)]  # some can be read once
    for (one, expected), (two, _), (three, _) in zip(*thrice, strict=True):
        assert same(convert_value(one, GIVER), expected)
        assert same(pool.decode(pool.encode_object(two, GIVER)), expected)
        assert pool.encode_object(three, GIVER) == pool.encode(expected)


def test_objects_stay_themselves() -> None:
    """Also buffers, code, and what looks like a container."""
    pool = Interning()
    dates = [datetime.datetime(2020, 1, 1), np.timedelta64(1, "s"), np.datetime64(1, "ns")]
    red = enum.Enum("Colour", "RED")["RED"]
    objects = [Decimal("1.5"), Fraction(1, 3), pathlib.PurePath("a"), red, Thing(), Unhashable(), UserList([1])]
    for thing in (*dates, *objects, len, Thing, Ellipsis, memoryview(b"abc"), (lambda: 0).__code__):
        value = convert_value([thing], GIVER)
        assert get_truth(value[0]) is True
        assert copy_for_python(value)[0] is copy_for_python(convert_value(thing, GIVER)) is thing
        assert value == convert_value([thing], GIVER)
        alone, inside = pool.encode_object(thing, GIVER), pool.encode_object({"a": [thing]}, GIVER)
        assert pool.decode_copy(alone) is pool.decode_copy(inside)["a"][0] is thing
        assert pool.encode_object(thing, GIVER) == alone
        assert pool.encode_object({"a": [thing]}, GIVER) == inside == pool.encode(pool.decode(inside))
    assert copy_for_python(convert_value(np.array(dates[1:2]), GIVER)) == dates[1:2]
    assert convert_value(b"bytes", GIVER) == b"bytes"
    assert get_truth(b"bytes") is True


def test_times_of_numpy_and_pandas_are_those_that_they_equal() -> None:
    pandas = pytest.importorskip("pandas")
    noon = datetime.datetime(2024, 5, 1, 12)
    zoned = noon.replace(tzinfo=datetime.UTC)
    for one, wanted in (
        (pandas.Timestamp(noon), noon),
        (pandas.Timestamp(zoned), zoned),
        (np.datetime64(noon), noon),
        (np.array(noon, "M8[ns]"), noon),
        (np.datetime64("2024-05-01"), noon.date()),
        (pandas.NaT, None),
        (np.datetime64("NaT"), None),
        (np.timedelta64("NaT"), None),
    ):
        (value,) = convert_value([one], GIVER)
        assert (type(value), value) == (type(wanted), wanted)
    for finer in (pandas.Timestamp(1), np.datetime64(1, "ns")):  # which would be lost
        assert copy_for_python(convert_value([finer], GIVER))[0] is finer
    with ss2sql.connect() as ss:
        ss.set("log", [{"t": pandas.Timestamp(noon)}, {"t": pandas.Timestamp(2024, 1, 1)}])
        ss.function("noon", lambda: pandas.Timestamp(noon))
        assert ss.eval("SELECT month(t) FROM log ORDER BY t AS list;") == [1, 5]
        assert ss.eval("SELECT t FROM log WHERE t >= noon() AND t == datetime('2024-05-01 12:00') AS list;") == [noon]


class Vague(Thing):
    __hash__ = Thing.__hash__

    def __eq__(self, other: object) -> bool:
        raise ValueError("more than one element")


def test_objects_that_do_not_equal_themselves_compare_by_identity() -> None:
    assert convert_value(Decimal("NaN"), GIVER) != convert_value(Decimal("NaN"), GIVER)
    vague = Vague()
    assert convert_value([vague], GIVER) == convert_value([vague], GIVER)
    assert convert_value([vague], GIVER) != convert_value([Vague()], GIVER)


@pytest.mark.parametrize(("bad", "message"), REFUSED, ids=label)
def test_values_that_the_language_does_not_have(bad: Any, message: str) -> None:
    error = failure(convert_value, bad, GIVER)
    assert (error.code, error.message) == ("X004", f"the function 'f' returned {message}")
    pool = Interning()
    for value in (bad, [bad], [[1], [bad]], (bad,), ((bad,),), {"a": bad}, [[[bad]]]):
        for _ in range(2):  # it is refused every time
            refused = failure(pool.encode_object, value, GIVER)
            assert (refused.code, refused.message[:25]) == ("X004", "the function 'f' returned")


def test_lists_that_contain_themselves() -> None:
    once: list[Any] = []
    once.append(once)
    twice: list[Any] = []
    twice += [twice, twice]
    parent: dict[str, Any] = {}
    parent["children"] = [{"parent": parent}, {"parent": parent}]
    for value in (once, [1, once], (once,), twice, [[twice, 1.0]], parent, [parent], {"a": twice}):
        for border in (convert_value, Interning().encode_object):
            error = failure(border, value, GIVER)
            assert error.code == "X004"
            assert error.message == "the function 'f' returned a value nested deeper than 500 levels"


def test_deep_lists_work_or_are_refused() -> None:
    deep = nested(500)
    for value in (deep, nested(500, b"bytes"), nested(499, (1,))):
        clean = convert_value(value, GIVER)
        assert copy_for_python(clean) == clean
        assert make_hashable(clean) == make_hashable(copy_for_python(clean))
        assert format_value(clean) == "[" * 57 + "..."
        assert compare_values(clean, copy_for_python(clean)) == 0
    record: Any = 1
    for _ in range(250):
        record = {"a": [record, Decimal(1)]}
    record = convert_value(record, GIVER)
    assert make_hashable(record) == make_hashable(convert_value(copy_for_python(record), GIVER))
    for depth in (501, 1001, 100_000):
        for value in (nested(depth), nested(depth, float("nan")), nested(depth, (1,))):
            assert failure(convert_value, value, GIVER).code == "X004"
            while value and isinstance(value, list):  # Python would free it recursively
                value = value.pop()


# --- the pool: values on their way through SQLite --------------------------------------------------------


def table(value: Any, encoding: str = "UTF-8") -> apsw.Connection:
    """A database with a table of one value."""
    connection = apsw.Connection(":memory:")
    connection.pragma("encoding", encoding)
    connection.execute("CREATE TABLE one(value)")
    connection.execute("INSERT INTO one VALUES (?)", (value,))
    return connection


THROUGH_SQLITE = (
    "WITH RECURSIVE steps(value, n) AS (SELECT value, 0 FROM one UNION ALL SELECT value, n + 1 FROM steps "
    "WHERE n < 2 ORDER BY 1) SELECT value FROM (SELECT value FROM steps WHERE n = 2 LIMIT -1)"
)


@given(VALUES)
def test_values_come_back_exactly(value: Any) -> None:
    pool = Interning()
    handle = pool.encode(value)
    assert type(handle) in (type(None), int, float, str, bytes)
    if value is None or type(value) in (int, float):  # SQLite computes with them
        assert same(handle, value)
    assert same(pool.decode(handle), value)
    assert same(convert_value(pool.decode_copy(handle), GIVER), value)
    assert not _shares_structure(pool.decode_copy(handle), pool.decode(handle))
    assert (pool.encode(value), pool.encode(pool.decode(handle))) == (handle, handle)
    assert same(pool.decode(table(handle).execute(THROUGH_SQLITE).get), value)
    foreign = Interning()
    handle = foreign.encode_object(copy_for_python(value), GIVER)
    assert same(foreign.decode(handle), value)
    assert foreign.encode_object(copy_for_python(value), GIVER) == handle == foreign.encode(value)


def test_objects_live_as_long_as_the_pool() -> None:
    pool = Interning()
    thing = Thing()
    watch = weakref.ref(thing)
    handle = pool.encode_object([thing], GIVER)
    del thing
    gc.collect()
    assert pool.decode_copy(handle) == [watch()]
    del pool
    gc.collect()
    assert watch() is None


@given(st.lists(ALIKE, max_size=6))
def test_keys_agree_with_equality_in_any_order_of_meeting(met: list[Any]) -> None:
    pool = Interning()
    handles = [pool.encode(value) for value in met]
    for left, one in zip(met, handles, strict=True):
        for right, two in zip(met, handles, strict=True):
            assert pool.are_equal(one, two) is (left == right)
            assert (pool.make_key(one) == pool.make_key(two)) is (left == right)
            if left == right:
                assert hash(pool.make_key(one)) == hash(pool.make_key(two))
    for value, handle in zip(met, handles, strict=True):
        assert same(pool.decode(handle), value)
        assert pool.make_key(pool.make_key(handle)) == pool.make_key(handle)


@pytest.mark.parametrize("blob", [b"", b"a", b"gTF{", b"1\0~", b"\x00" * 13, bytes(range(256))])
def test_blobs_of_tables_are_bytes_objects(blob: bytes) -> None:
    pool = Interning()
    assert pool.decode(blob) == pool.decode_copy(blob) == blob
    handle = pool.encode(blob)
    assert pool.decode(handle) == pool.decode_copy(handle) == blob
    assert pool.encode_object(blob, GIVER) == handle
    assert [pool.are_equal(blob, other) for other in (handle, pool.encode([1]))] == [True, False]
    strange = Interning().encode([1])  # the handle of another pool
    assert pool.decode(strange) == strange


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le"])
@pytest.mark.parametrize("value", [True, False, [], [0], {}, {"a": 0}, Thing(), b"", b"0", b"7x", "\ud800"], ids=repr)
def test_sqlite_sees_the_truth_of_handles(encoding: str, value: Any) -> None:
    query = (
        "SELECT CASE WHEN value THEN 1 ELSE 0 END, NOT value, value AND 1, value OR 0,"
        " (SELECT count(*) FROM one WHERE value) FROM one"
    )
    expected = int(get_truth(value))
    found = table(Interning().encode(value), encoding).execute(query).get
    assert found == (expected, 1 - expected, expected, expected, expected)


# --- objects equal objects only, whatever their own `==` says of numbers and strings ------------------------
class Same:
    """It calls itself equal to what it holds, and to others that hold the same."""

    def __init__(self, held: Any) -> None:
        self.held = held

    def __eq__(self, other: object) -> bool:
        return bool(self.held == (other.held if isinstance(other, Same) else other))

    def __hash__(self) -> int:
        return hash(self.held)

    def __repr__(self) -> str:
        return f"Same({self.held!r})"


PAIRS = [(Same(1), 1), (Same("a"), "a"), (Same(True), True), (Same(None), None), (Decimal(1), 1), (Fraction(1, 2), 0.5)]


@pytest.fixture(params=PAIRS, ids=repr)
def pair(request: pytest.FixtureRequest, ss: ss2sql.Session) -> tuple[Any, Any]:
    """An object and a value that it calls equal; a list, a function, a dict and columns that hold them."""
    thing, plain = request.param
    assert thing == plain
    ss.attach("both", [thing, plain])
    ss.attach("one", [thing])
    ss.attach("other", [plain])
    ss.attach("rows", [{"k": thing, "n": 1}, {"k": plain, "n": 2}])
    ss.function("give", lambda: thing, volatility="immutable")
    ss.set("plain", plain)
    return thing, plain


FALSE = [
    *("one[0] == other[0]", "other[0] == one[0]", "one == other", "[one] == [other]", "one[0] == plain"),
    *("give() == plain", "one[0] IN other", "other[0] IN one", "give() IN [plain]"),
]
COUNTS = {  # scripts and the number of rows, of which there would be fewer or more if the two were equal
    "SELECT a.this FROM a = one, b = other WHERE a.this == b.this AS list": 0,
    "SELECT a.n FROM a = rows, b = rows WHERE a.k == b.k AS list": 2,
    "SELECT this FROM both WHERE this == plain AS list": 1,
    "SELECT n FROM rows WHERE k == plain AS list": 1,
    "SELECT n FROM rows WHERE k IN [plain] AS list": 1,
    "SELECT this FROM both GROUP BY this AS list": 2,
    "uniq(both);": 2,
    "SELECT this FROM both START WITH n = 0 CONNECT BY UNIQUE n = 1 STOP WITH n > 0 AS list": 2,
    "SELECT this FROM both START WITH n = 0 CONNECT BY BREADTH FIRST NO CYCLE n = n + 1 STOP WITH n > 1 AS list": 4,
    "SELECT this FROM both START WITH n = 0 CONNECT BY MEMORIZE 2 n = n + 1 AS list": 4,
}


@pytest.mark.parametrize("script", [*(f"SELECT 1 FROM [1] WHERE {one} AS list" for one in FALSE), *COUNTS, *FALSE])
def test_objects_equal_no_plain_values(ss: ss2sql.Session, pair: tuple[Any, Any], engine: Any, script: str) -> None:
    try:
        found = ss.run(script, engine=engine).value
        assert found is False if script in FALSE else len(found) == COUNTS.get(script, 0)
    except ss2sql.UnsupportedError:
        assert engine == "database"


def test_objects_keep_their_own_equality_among_each_other(ss: ss2sql.Session, engine: Any) -> None:
    things = [Same(1), Same(1), Decimal("1.0"), Decimal(1), Same(2)]
    ss.attach("things", things)
    assert ss.run("SELECT a.this FROM a = things, b = things WHERE a.this == b.this AS list", engine=engine).value == [
        a for a in things for b in things if a == b
    ]
    assert ss.run("SELECT this FROM things AS list", engine=engine).value[2] is things[2]


def test_keys_of_a_list_are_made_when_it_is_asked_again() -> None:
    pool = Interning()
    members, handle = MemberCache(pool), pool.encode([1, 2.0])
    with pytest.raises(KeyError):  # who asks once looks through the list itself
        members[handle]
    assert members[handle] == {1, 2.0}
