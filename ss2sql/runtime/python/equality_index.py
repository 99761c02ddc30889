"""Looking up the elements that an equality asks for, instead of walking over all of them.

A condition `key == other`, where the key is a column or is computed of one source that is read once, and `other` is
known before the loop of that source, needs no loop over all elements: an index gives those whose key equals the value.
It is built when it is first needed, for several keys of a source together. Where a key or what it must equal may raise,
the condition is tested all the same, of the elements that are found; where it does raise, that is of all elements, so
that it raises again if the script comes there.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from operator import itemgetter
from typing import Any

from ss2sql.errors import Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.runtime.python.codegen_context import ExpressionAnalysis
from ss2sql.runtime.run.run_state import Run, pause_collector


@dataclass(frozen=True, slots=True)
class Lookup:
    """`key == other`: what is read of the `source`, and what it must equal; where it is `sure`, neither raises.

    With `members` one of these must equal it, of a `listed` key one of its elements: a row has several keys then.
    """

    source: int
    key: plan.Expr
    other: plan.Expr
    sure: bool
    members: tuple[plan.Expr, ...] = ()
    listed: bool = False

    @property
    def several(self) -> bool:
        return self.listed or bool(self.members)


def find_index_lookups(part: plan.Expr, analysis: ExpressionAnalysis, operator: str = "eq") -> list[Lookup]:
    """The condition as lookups: one for each side that reads one source, and nothing else that changes in a run."""
    facts = analysis.facts(part)
    if not facts.steady:
        return []
    match part:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name == operator:
            pairs = [(left, right, False), (right, left, False)]
        case plan.Call(function=plan.Function(name="in", builtin=True), arguments=(item, container)) if (
            operator == "eq" and container.type.is_only(Kind.LIST)
        ):
            pairs = [(container, item, True)]
        case plan.Or(parts=parts) if operator == "eq":
            alternatives = [[one for one in find_index_lookups(other, analysis) if not one.several] for other in parts]
            return [lookup for one in alternatives[0] if (lookup := _join_lookups(part, one, alternatives, analysis))]
        case _:
            return []
    found: list[Lookup] = []
    for key, other, listed in pairs:
        read = analysis.facts(key)
        if len(read.sources) == 1 and not (read.states or read.groups):
            (source,) = read.sources
            if source not in analysis.facts(other).sources:
                members = key.items if listed and isinstance(key, plan.MakeList) else ()
                found.append(Lookup(source, key, other, facts.total, members, listed and not members))
    return found


def _join_lookups(
    part: plan.Expr, first: Lookup, alternatives: Sequence[Sequence[Lookup]], analysis: ExpressionAnalysis
) -> Lookup | None:
    """The lookup of rows of which one of several keys equals the same: `a == x OR b == x`."""
    same, members = analysis.facts(first.other).key, list[plan.Expr]()
    for alternative in alternatives:
        known = [one.key for one in alternative if one.source == first.source and analysis.facts(one.other).key == same]
        members += known[:1]
    if same is None or len(members) < len(alternatives):
        return None
    return Lookup(first.source, part, first.other, analysis.facts(part).total, tuple(members))


class RowIndex(dict[Hashable, list[Any]]):
    """The rows of a source by their keys. Where a key could not be computed it `failed`, and all are found."""

    def __init__(self, rows: list[Any]) -> None:
        super().__init__()
        self.rows = rows
        self.failed = False

    def find_rows(self, key: Hashable) -> Sequence[Any]:
        """The rows with this key, in their order."""
        return self.rows if self.failed else self.get(key, ())

    def add_items(self, keys: Iterable[Hashable], items: Iterable[Any]) -> RowIndex:
        with pause_collector():  # 0.55 of the time
            for key, item in zip(keys, items, strict=True):
                known = self.get(key)
                if known is None:
                    self[key] = [item]
                else:
                    known.append(item)
        return self


def index_rows(rows: list[Any], keys_of: Callable[[list[Any]], Iterable[Hashable]]) -> RowIndex:
    """The rows by their keys. What is raised for one of them is raised again where its condition is tested."""
    index = RowIndex(rows)
    try:
        return index.add_items(keys_of(rows), rows)
    except Stopped:
        raise
    except Exception:
        index.failed = True
        return index


def index_rows_by_members(rows: list[Any], keys_of: Callable[[list[Any]], Iterable[Any]]) -> RowIndex:
    """The same where a row has several keys: of each come what all have in common, and the rest of each."""

    def list_keys() -> Iterator[tuple[Hashable, Any]]:
        for (common, members), row in zip(keys_of(rows), rows, strict=True):
            for member in dict.fromkeys(members):
                yield (*common, member) if common else member, row

    index = RowIndex(rows)
    try:
        pairs = list(list_keys())
    except Stopped:
        raise
    except Exception:
        index.failed = True
        return index
    return index.add_items(*zip(*pairs, strict=True)) if pairs else index


def index_column(rows: list[Any], value: int, position: int) -> RowIndex:
    """The values of a column by those of another, where nothing else is wanted of the rows that are found."""
    return RowIndex(rows).add_items(map(itemgetter(position), rows), map(itemgetter(value), rows))


def index_table_column(run: Run, table: plan.TableSource, value: int, position: int) -> dict[Hashable, list[Any]]:
    """The same of a table whose two columns hold whole numbers."""
    found = run.host.read_integer_columns(table, table.columns[position][0], table.columns[value][0])
    if found is None:
        return index_column(run.host.read_table_rows(table, run), value, position)
    import numpy as np

    order = np.argsort(found[0], kind="stable")  # so that the items of a key keep their order
    keys, items = found[0][order], found[1][order].tolist()
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    bounds = [*starts.tolist(), len(items)]
    return {key: items[start:end] for key, start, end in zip(keys[starts].tolist(), bounds, bounds[1:], strict=False)}
