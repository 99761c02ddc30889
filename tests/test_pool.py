"""Values on their way through SQLite: handles, exactness, equality, truth, memory."""

from __future__ import annotations

import datetime
import gc
import weakref
from decimal import Decimal
from fractions import Fraction
from pathlib import PurePath
from typing import Any

import apsw
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import ALIKE, PLAIN_VALUES, REFUSED, VALUES, Thing, Unhashable, label, python_values, same

from ss2sql.errors import ExecutionError
from ss2sql.runtime.pool import Pool
from ss2sql.runtime.values import fresh, normalise, truth

GIVER = "the function 'f'"


# --- there and back ------------------------------------------------------------------------------------


@given(VALUES)
def test_values_come_back_exactly(value: Any) -> None:
    pool = Pool()
    handle = pool.encode(value)
    assert type(handle) in (type(None), int, float, str, bytes)
    if value is None or type(value) in (int, float):  # SQLite computes with them
        assert same(handle, value)
    assert same(pool.decode(handle), value)
    assert same(normalise(pool.fresh(handle), GIVER), value)
    assert pool.encode(value) == handle
    assert pool.encode(pool.decode(handle)) == handle
    foreign = Pool()
    handle = foreign.encode_foreign(fresh(value), GIVER)
    assert same(foreign.decode(handle), value)
    assert foreign.encode_foreign(fresh(value), GIVER) == handle == foreign.encode(value)


@given(PLAIN_VALUES)
def test_values_survive_sqlite(value: Any) -> None:
    pool = Pool()
    connection = apsw.Connection(":memory:")
    connection.execute("CREATE TABLE one(value)")
    connection.execute("INSERT INTO one VALUES (?)", (pool.encode(value),))
    query = (
        "WITH RECURSIVE steps(value, n) AS (SELECT value, 0 FROM one UNION ALL SELECT value, n + 1 FROM steps "
        "WHERE n < 2 ORDER BY 1) SELECT value FROM (SELECT value FROM steps WHERE n = 2 LIMIT -1)"
    )
    assert same(pool.decode(connection.execute(query).get), value)


def test_foreign_values_are_normalised() -> None:
    pool = Pool()
    for (given_value, expected), (again, _) in zip(python_values(), python_values(), strict=True):
        assert same(pool.decode(pool.encode_foreign(given_value, GIVER)), expected)
        assert pool.encode_foreign(again, GIVER) == pool.encode(expected)


def test_numpy_scalars_are_not_taken_for_their_bytes() -> None:
    pool = Pool()
    raw = np.float64(1.5).tobytes()
    assert pool.decode(pool.encode_foreign([raw], GIVER)) == [raw]
    assert pool.decode(pool.encode_foreign([np.float64(1.5)], GIVER)) == [1.5]
    assert pool.decode(pool.encode_foreign([raw], GIVER)) == [raw]


@pytest.mark.parametrize("bad", [*(value for value, _ in REFUSED), float("inf")], ids=label)
def test_bad_values_are_refused_every_time(bad: Any) -> None:
    pool = Pool()
    for value in (bad, [bad], [[1], [bad]], (bad,), ((bad,),), {"a": bad}, [[[bad]]]):
        for _ in range(2):
            with pytest.raises(ExecutionError, match="the function 'f' returned") as caught:
                pool.encode_foreign(value, GIVER)
            assert caught.value.code == "X004"


def test_lists_that_contain_themselves_are_refused() -> None:
    pool = Pool()
    knot: list[Any] = []
    knot += [knot, knot]
    deep: list[Any] = []
    for _ in range(3000):
        deep = [deep]
    for value in (knot, [1, knot], (knot,), {"a": knot}, deep):
        with pytest.raises(ExecutionError, match="deeper than 500 levels"):
            pool.encode_foreign(value, GIVER)
    with pytest.raises(ExecutionError, match="deeper than 500 levels"):
        pool.encode(deep)
    while deep:
        deep = deep.pop()


# --- copies --------------------------------------------------------------------------------------------


def test_later_changes_of_a_given_list_do_not_show() -> None:
    pool = Pool()
    plain: list[Any] = [[1], 2]
    thing = Thing()
    odd: list[Any] = [[thing], {"a": thing}]
    first, second = pool.encode_foreign(plain, GIVER), pool.encode_foreign(odd, GIVER)
    plain[0].append(3)
    odd[0].append(3)
    odd[1]["b"] = 1
    assert pool.decode(first) == [[1], 2]
    assert pool.decode(first) is pool.decode(first)
    assert pool.decode(second) == [[thing], {"a": thing}]


def test_fresh_copies_may_be_changed() -> None:
    pool = Pool()
    thing = Unhashable()
    for value in ([[1], 2], {"a": [1]}, [[thing]], {"a": [thing]}):
        handle = pool.encode_foreign(value, GIVER)
        before = pool.fresh(handle)
        copy = pool.fresh(handle)
        copy.clear()
        assert pool.fresh(handle) == before == value


def test_objects_come_back_identical() -> None:
    pool = Pool()
    for thing in (Thing(), Unhashable(), PurePath("a"), datetime.date(2020, 1, 1), np.datetime64("2020-01-01"), len):
        alone, inside = pool.encode_foreign(thing, GIVER), pool.encode_foreign({"a": [thing]}, GIVER)
        assert pool.fresh(alone) is thing
        assert pool.fresh(inside)["a"][0] is thing
        assert pool.encode_foreign(thing, GIVER) == alone
        assert pool.encode_foreign({"a": [thing]}, GIVER) == inside
        assert pool.encode(pool.decode(inside)) == inside


def test_equal_objects_keep_their_identity() -> None:
    pool = Pool()
    first, second = PurePath("a"), PurePath("a")
    one, two = pool.encode_foreign([first], GIVER), pool.encode_foreign([second], GIVER)
    assert one != two
    assert pool.equal(one, two)
    assert pool.fresh(one)[0] is first
    assert pool.fresh(two)[0] is second


@pytest.mark.usefixtures("little_heap")
def test_objects_live_as_long_as_the_pool() -> None:
    pool = Pool()
    thing = Thing()
    watch = weakref.ref(thing)
    handle = pool.encode_foreign([thing], GIVER)
    del thing
    gc.collect()
    assert pool.fresh(handle) == [watch()]
    del pool
    gc.collect()
    assert watch() is None


# --- equality ------------------------------------------------------------------------------------------


@given(st.lists(ALIKE, max_size=6))
def test_keys_agree_with_equality_in_any_order_of_meeting(met: list[Any]) -> None:
    pool = Pool()
    handles = [pool.encode(value) for value in met]
    for left, one in zip(met, handles, strict=True):
        for right, two in zip(met, handles, strict=True):
            assert pool.equal(one, two) is (left == right)
            assert (pool.key(one) == pool.key(two)) is (left == right)
            if left == right:
                assert hash(pool.frozen(one)) == hash(pool.frozen(two))
    for value, handle in zip(met, handles, strict=True):
        assert same(pool.decode(handle), value)
        assert pool.key(pool.key(handle)) == pool.key(handle)


@given(ALIKE, ALIKE)
def test_sqlite_compares_keys_as_the_language_compares_values(left: Any, right: Any) -> None:
    pool = Pool()
    keys = [pool.key(pool.encode(value)) for value in (left, right)]
    connection = apsw.Connection(":memory:")
    equal = connection.execute("SELECT ? IS ?", keys).get
    groups = connection.execute(
        "SELECT count(*) FROM (SELECT key FROM (SELECT ? AS key UNION ALL SELECT ?) GROUP BY key)", keys
    )
    assert equal == (left == right)
    assert groups.get == (1 if left == right else 2)


def test_objects_that_equal_numbers_have_their_keys() -> None:
    pool = Pool()
    assert pool.key(pool.encode(Decimal(2))) == 2
    assert pool.key(pool.encode(Fraction(1, 2))) == 0.5
    assert pool.equal(pool.encode([Decimal(2)]), pool.encode([2.0]))
    assert not pool.equal(pool.encode(Decimal("0.1")), 0.1)
    assert same(pool.key(pool.encode(Decimal(2**100))), 2.0**100)
    for beyond in (Decimal(10**300), Decimal("Infinity")):
        handle = pool.encode(beyond)
        assert pool.key(handle) == handle
    assert pool.equal(pool.encode([Decimal(2**100)]), pool.encode([2.0**100]))


# --- bytes of tables -----------------------------------------------------------------------------------


@pytest.mark.parametrize("blob", [b"", b"a", b"gTF{", b"1\0~", b"\x00" * 13, bytes(range(256))])
def test_blobs_of_tables_are_bytes_objects(blob: bytes) -> None:
    pool = Pool()
    assert pool.decode(blob) == pool.fresh(blob) == blob
    handle = pool.encode(blob)
    assert pool.decode(handle) == pool.fresh(handle) == blob
    assert pool.encode_foreign(blob, GIVER) == handle
    assert pool.key(blob) == pool.key(handle)
    assert pool.equal(blob, handle)
    assert not pool.equal(blob, pool.encode([1]))
    assert not pool.equal(blob, pool.encode(b"other"))
    strange = Pool().encode([1])  # the handle of another pool
    assert pool.decode(strange) == strange


# --- truth ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le"])
@pytest.mark.parametrize(
    "value", [True, False, [], [0], {}, {"a": 0}, Thing(), b"", b"0", b"7x", "\ud800", [[]]], ids=repr
)
def test_sqlite_sees_the_truth_of_handles(encoding: str, value: Any) -> None:
    pool = Pool()
    connection = apsw.Connection(":memory:")
    connection.pragma("encoding", encoding)
    connection.execute("CREATE TABLE one(value)")
    connection.execute("INSERT INTO one VALUES (?)", (pool.encode(value),))
    query = (
        "SELECT CASE WHEN value THEN 1 ELSE 0 END, NOT value, value AND 1, value OR 0,"
        " (SELECT count(*) FROM one WHERE value) FROM one"
    )
    expected = int(truth(value))
    assert connection.execute(query).get == (expected, 1 - expected, expected, expected, expected)
