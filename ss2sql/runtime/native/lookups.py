"""Looking up the elements that an equality asks for, instead of walking over all of them.

A condition `column == other`, where the source of the column is read once and `other` is known before its
loop, needs no loop over all elements: an index gives those whose column equals the value. It is built when
it is first needed, for several columns of a source together. Conditions that may raise are not looked up, for
they would no longer be asked of every element.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from ss2sql import plan
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.sources import column_of
from ss2sql.runtime.values import freeze


@dataclass(frozen=True, slots=True)
class Lookup:
    """`column == other`: a column or the element of a source, and what it must equal."""

    column: plan.Column | plan.Element
    other: plan.Expr


def lookups(part: plan.Expr, analysis: Analysis, operator: str = "eq") -> list[Lookup]:
    """The condition as lookups: one for each side that is a column or an element, compared with the other one."""
    match part:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name == operator:
            facts = analysis.of(part)
            if not facts.steady or not facts.total:
                return []
            return [
                Lookup(column, other)
                for column, other in ((left, right), (right, left))
                if isinstance(column, (plan.Column, plan.Element)) and column.source not in analysis.of(other).sources
            ]
    return []


def index_of_tuples(rows: list[Any], *positions: int) -> dict[Hashable, list[Any]]:
    """The rows by the value of a column, or by the values of several."""
    index: dict[Hashable, list[Any]] = defaultdict(list)
    for row in rows:
        index[_key([row[position] for position in positions])].append(row)
    return dict(index)


def index_of_plain(rows: list[Any], *positions: int) -> dict[Hashable, list[Any]]:
    """The same for columns of numbers and text: 0.15 us for a row in place of 0.9."""
    return _index(map(itemgetter(*positions), rows), rows)


def index_of_values(rows: list[Any], value: int, *positions: int) -> dict[Hashable, list[Any]]:
    """The same where but one column is wanted of the rows that are found."""
    return _index(map(itemgetter(*positions), rows), map(itemgetter(value), rows))


def _index(keys: Iterable[Hashable], items: Iterable[Any]) -> dict[Hashable, list[Any]]:
    index: dict[Hashable, list[Any]] = {}
    for key, item in zip(keys, items, strict=True):
        known = index.get(key)
        if known is None:
            index[key] = [item]
        else:
            known.append(item)
    return index


def index_of_columns(items: list[Any], *names: str) -> dict[Hashable, list[Any]]:
    """The elements by the value of a column, or by the values of several."""
    index: dict[Hashable, list[Any]] = defaultdict(list)
    for item in items:
        index[_key([column_of(item, name, None) for name in names])].append(item)
    return dict(index)


def _key(values: Sequence[Any]) -> Hashable:
    return freeze(values[0]) if len(values) == 1 else tuple(map(freeze, values))


def index_of_elements(items: list[Any]) -> dict[Hashable, list[Any]]:
    """The elements by themselves."""
    index: dict[Hashable, list[Any]] = defaultdict(list)
    for item in items:
        index[freeze(item)].append(item)
    return dict(index)


def found_in(index: dict[Hashable, list[Any]], value: Any) -> list[Any]:
    """The elements whose column equals the value, in their order."""
    return index.get(freeze(value), [])


def found_in_several(index: dict[Hashable, list[Any]], *values: Any) -> list[Any]:
    """The elements whose columns equal the values, in their order."""
    return index.get(_key(values), [])
