"""Types of values: what they say, unions, and when a type covers another."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import ALIKE, VALUES, Thing

from ss2sql.language.kinds import (
    ANY,
    INT,
    LIST,
    NONE,
    NOTHING,
    STR,
    UNENCODABLE,
    Kind,
    Type,
    can_be_equal,
    is_supertype,
    make_list_type,
    type_of,
    unite,
)
from ss2sql.language.kinds import drop_bounds as unbounded
from ss2sql.language.values import convert_value

EMPTY = Type(Kind.LIST, element=NOTHING, columns=())


@dataclass
class Person:
    name: str
    age: int


@dataclass(frozen=True)
class Place:
    name: str


def number(low: float, high: float, kinds: Kind = Kind.INT) -> Type:
    return Type(kinds, low, high)


def plain_list(item: Type) -> Type:
    return Type(Kind.LIST, element=item, columns=())


def long_list(item: Type, length: int | None) -> Type:
    return Type(Kind.LIST, element=item, columns=(), length=length)


def short_list(*positions: Type) -> Type:
    return Type(Kind.LIST, element=unite(positions), columns=(), positions=positions)


TYPES = [
    (None, NONE), (True, Type(Kind.BOOL, 1, 1)), (7, number(7, 7)), (-0.5, number(-0.5, -0.5, Kind.FLOAT)), ("a", STR),
    ("\ud800", UNENCODABLE), ([], EMPTY), ([1, 3, 2], short_list(number(1, 1), number(3, 3), number(2, 2))),
    ([1, 2.5, None, True], short_list(number(1, 1), number(2.5, 2.5, Kind.FLOAT), NONE, number(1, 1, Kind.BOOL))),
    (["a", "b"], short_list(STR, STR)), (["a", 1], short_list(STR, number(1, 1))),
    ([[1, "a"], [3, None]], long_list(short_list(number(1, 3), Type(Kind.STR | Kind.NONE)), 2)),
    ([1] * 16, short_list(*[number(1, 1)] * 16)), ([1] * 17, long_list(number(1, 1), 17)),
    ([[1] * 17, [2] * 17], long_list(long_list(number(1, 2), 17), 2)),
    ([[1, 2], [3]], long_list(plain_list(number(1, 3)), 2)),
    ([1, [2]], long_list(Type(Kind.INT | Kind.LIST, 1, 1, number(2, 2), (), (number(2, 2),)), 2)),
    (["a", "\ud800"], long_list(UNENCODABLE, None)),
    ([[1], [], [2.0]], long_list(plain_list(number(1, 2, Kind.INT | Kind.FLOAT)), 3)), ([[], []], long_list(EMPTY, 2)),
    ([1, []], long_list(Type(Kind.INT | Kind.LIST, 1, 1, NOTHING, ()), 2)),
    ({"a": 1, "b": "x"}, Type(Kind.DICT, columns=(("a", number(1, 1)), ("b", STR)))),
    ({1: 1, "a": None}, Type(Kind.DICT, columns=(("a", NONE),))), ({}, Type(Kind.DICT, columns=())),
    (Thing(), Type(Kind.OBJECT, columns=())), (Place("x"), Type(Kind.OBJECT, columns=(("name", ANY),))),
]  # fmt: skip


@pytest.mark.parametrize(("value", "expected"), TYPES, ids=repr)
def test_the_type_of_a_value(value: Any, expected: Type) -> None:
    assert type_of(value) == expected


def test_lists_of_dicts_and_dataclass_objects_have_columns() -> None:
    rows = [{"a": 1}, {"b": "x", "a": 2.5}]
    columns = (("a", number(1, 2.5, Kind.INT | Kind.FLOAT)), ("b", Type(Kind.STR | Kind.NONE)))
    assert type_of(rows) == Type(Kind.LIST, element=Type(Kind.DICT, columns=columns), columns=columns)
    assert type_of([{"a": 1}, 2]).columns == ()
    people = convert_value([Person("Ann", 5), Person("Bob", 7)], "the variable 'x'")
    assert type_of(people).columns == (("name", ANY), ("age", ANY))
    assert type_of([Place("a"), Place("b")]).columns == (("name", ANY),)
    assert type_of(convert_value([Person("Ann", 5), Place("a")], "the variable 'x'")).columns == (
        ("name", ANY),
        ("age", ANY),
    )
    assert type_of([Place("a"), 1]).columns == type_of([date(2020, 1, 1), Path()]).columns == ()
    assert type_of(people[0]) == Type(Kind.OBJECT, columns=(("name", ANY), ("age", ANY)))


def test_very_deep_lists_have_a_type() -> None:
    value: Any = 1
    for _ in range(500):
        value = [value, {"a": value}] if _ < 3 else [value]
    assert type_of(value).kinds is Kind.LIST
    assert is_supertype(unbounded(type_of(value)), type_of([]))


@given(VALUES)
def test_a_type_covers_itself_and_anything_covers_it(value: Any) -> None:
    kind = type_of(value)
    assert is_supertype(kind, kind)
    assert is_supertype(ANY, kind)
    assert is_supertype(kind, NOTHING)
    assert unite([kind, kind]) == kind
    assert unite([NOTHING, kind]) == unite([kind, NOTHING]) == kind


@given(VALUES, VALUES, VALUES)
def test_a_union_covers_its_members(a: Any, b: Any, c: Any) -> None:
    first, second, third = map(type_of, (a, b, c))
    both = unite([first, second])
    assert is_supertype(both, first)
    assert is_supertype(both, second)
    assert is_supertype(unite([both, third]), both)
    assert is_supertype(unite([third, unite([second, first])]), both)


@given(st.lists(ALIKE, max_size=4))
def test_the_type_of_a_list_covers_its_elements(values: list[Any]) -> None:
    kind = type_of(values)
    assert kind.element is not None
    longer = Type(kind.kinds, element=kind.element, columns=kind.columns)  # of a list of any length
    for value in values:
        assert is_supertype(kind.element, type_of(value))
        assert is_supertype(longer, type_of([value])) or kind.columns != type_of([value]).columns
    assert is_supertype(longer, EMPTY)
    assert is_supertype(longer, kind)
    if kind.size is not None:
        assert kind.size == len(values)
        assert not is_supertype(kind, longer)
    if kind.positions is not None:
        assert not is_supertype(kind, longer)
        assert not is_supertype(kind, EMPTY)
        assert all(is_supertype(*pair) for pair in zip(kind.positions, map(type_of, values), strict=True))
        assert unite(kind.positions) == kind.element
        assert kind == make_list_type(kind.positions)


def test_short_lists_are_described_one_by_one_as_long_as_all_have_one_length() -> None:
    pair, other = short_list(number(1, 1), STR), short_list(number(5, 5), NONE)
    assert unite([pair, other]) == short_list(number(1, 5), Type(Kind.STR | Kind.NONE))
    assert unite([pair, NONE]).positions == pair.positions
    assert unite([pair, short_list(STR)]).positions is None
    assert unite([pair, EMPTY]).positions is None
    assert unite([pair, LIST]) == LIST
    assert make_list_type([INT, ANY]).positions is None  # an element may be a list itself
    assert make_list_type([]).positions is None


DIFFERENT = [None, 1, 2.5, "a", [], [3], [[], []], [1, 2, 3], {"a": 1}]


def test_what_may_be_equal() -> None:
    """Types of equal values say that these may be equal; those of most others do not."""
    equal = [(1, 1.0), (True, 1), (0, False), ([1, True], [1.0, 1]), ([[]], [[]]), ({"a": 1}, {"a": 1.0})]
    equal += [(value, value) for value in DIFFERENT]
    for a, b in equal:
        assert a == b
        assert can_be_equal(type_of(a), type_of(b))
    for a, b in itertools.permutations(DIFFERENT, 2):
        assert not can_be_equal(type_of(a), type_of(b))
        assert can_be_equal(unite([type_of(a), type_of(b)]), type_of(b))
    for value in DIFFERENT:
        assert can_be_equal(type_of(value), type_of(Place("here")))  # it may equal whatever it says
        assert can_be_equal(type_of(value), ANY)
    assert can_be_equal(INT, number(1, 1))
    assert can_be_equal(LIST, type_of([]))
