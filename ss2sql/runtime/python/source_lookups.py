"""Sources that are not walked whole: elements that an equality asks for, and tables of worlds.

A condition `key == other`, where the key is a column or is computed of one source that is read once, and `other` is
known before the loop of that source, needs no loop over all elements: an index gives those whose key equals the value.
It is built when it is first needed, for several keys of a source together. Where a key or what it must equal may raise,
the condition is tested all the same, of the elements that are found; where it does raise, that is of all elements, so
that it raises again if the script comes there. Conditions of order that cannot raise, `key <= other`, are looked up in
the order of the numbers that the keys are, among the rows that equalities find, and tested again. Of several keys the
one that leaves the fewest rows is taken, for each value anew.

What walks over the table of a world are keys, and columns are read of them when they are needed. Conditions that the
adapter gets (`push_condition_to_world` in source_loops.py) only save rows; all are tested again.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Hashable, Iterable, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import MIRRORED
from ss2sql.runtime.python.codegen_context import ExpressionAnalysis
from ss2sql.runtime.python.located_code import AstBuilder
from ss2sql.runtime.run.key_order import MIN_LENGTH, KeyOrder, RowOrder, order_keys
from ss2sql.runtime.run.run_state import pause_collector
from ss2sql.vtables.contract import Where

if TYPE_CHECKING:
    from ss2sql.runtime.python.codegen_context import CodegenContext, PythonScope
    from ss2sql.runtime.python.native_query import QueryCompiler
    from ss2sql.vtables.attached_worlds import AttachedWorldTable


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


@dataclass(frozen=True, slots=True)
class RangeLookup:
    """`key <= other`, or another comparison by this operator: what is read of the `source`, and the bound."""

    source: int
    key: plan.Expr
    operator: str
    other: plan.Expr


def find_range_lookups(part: plan.Expr, analysis: ExpressionAnalysis) -> list[RangeLookup]:
    """The condition as lookups of a range, where neither side raises."""
    match part:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name in MIRRORED:
            if not (analysis.facts(part).steady and analysis.facts(part).total):
                return []
            sides = [(left, name, right), (right, MIRRORED[name], left)]
            return [
                RangeLookup(source, key, operator, other)
                for key, operator, other in sides
                if (source := _find_keyed_source(key, other, analysis)) is not None
            ]
        case _:
            return []


def _find_keyed_source(key: plan.Expr, other: plan.Expr, analysis: ExpressionAnalysis) -> int | None:
    """The source of which alone a side of a condition reads, where the other side does not."""
    read = analysis.facts(key)
    if len(read.sources) != 1 or read.states or read.groups:
        return None
    (source,) = read.sources
    return None if source in analysis.facts(other).sources else source


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
        source = _find_keyed_source(key, other, analysis)
        if source is not None:
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

    def add_items(self, pairs: Iterable[tuple[Hashable, Any]]) -> RowIndex:
        with pause_collector():  # 0.55 of the time
            for key, item in pairs:
                known = self.get(key)
                if known is None:
                    self[key] = [item]
                else:
                    known.append(item)
        return self

    def add_where_possible(self, pairs: Iterable[tuple[Hashable, Any]]) -> RowIndex:
        """The same, unless a key raises."""
        try:
            return self.add_items(pairs)
        except Stopped:
            raise
        except Exception:
            self.failed = True
            return self


def index_rows(rows: list[Any], keys_of: Callable[[list[Any]], Iterable[Hashable]]) -> RowIndex:
    """The rows by their keys. What is raised for one of them is raised again where its condition is tested."""
    return RowIndex(rows).add_where_possible(zip(keys_of(rows), rows, strict=True))


def index_rows_by_members(rows: list[Any], keys_of: Callable[[list[Any]], Iterable[Any]]) -> RowIndex:
    """The same where a row has several keys: of each come what all have in common, and the rest of each."""
    pairs = (
        ((*common, member) if common else member, row)
        for (common, members), row in zip(keys_of(rows), rows, strict=True)
        for member in dict.fromkeys(members)
    )
    return RowIndex(rows).add_where_possible(pairs)


class RangeIndex:
    """Rows in which ranges of keys are looked up: those of a source, or those of them that an equality finds.

    Each list of rows is put in order when it is first asked for; it lives as long as this does.
    """

    def __init__(self, descending: bool, *keys_of: Callable[[Sequence[Any]], Iterable[Any]]) -> None:
        self.descending = descending
        self.keys_of = keys_of
        self.made: dict[int, tuple[Sequence[Any], list[KeyOrder | None]]] = {}

    def find_rows(self, rows: Sequence[Any], *asked: tuple[Sequence[str], Sequence[Any]]) -> Sequence[Any]:
        """The rows whose keys meet comparisons by these operators with these values, and maybe more, in their order.

        `asked` has the comparisons of each key: the one that leaves the fewest rows is looked up, none where there are
        neither numbers nor texts.
        """
        if len(rows) < MIN_LENGTH:
            return rows
        start, end, chosen = 0, len(rows), None
        for order, comparisons in zip(self._get_orders(rows), asked, strict=True):
            if order is not None:
                first, last = order.find_bounds(*comparisons)
                if chosen is None or last - first < end - start:
                    start, end, chosen = first, last, order
        if chosen is None or chosen.ascends:
            return rows[start:end]
        return [rows[place] for place in sorted(chosen.places[start:end])]

    def find_rows_in_order(
        self, rows: Sequence[Any], asked: RowOrder, operators: Sequence[str], values: Sequence[Any]
    ) -> Iterable[Any]:
        """The same for a single key, one after the other in the order of it; says whether they are."""
        (order,) = self._get_orders(rows)
        asked.kept = order is not None
        if order is None:
            return rows
        places = map(order.places.__getitem__, range(*order.find_bounds(operators, values)))
        return map(rows.__getitem__, places)

    def _get_orders(self, rows: Sequence[Any]) -> list[KeyOrder | None]:
        """The order of the rows by each key, None where they are neither numbers nor texts."""
        known = self.made.get(id(rows))
        if known is None:
            orders = [order_keys(list(keys_of(rows)), self.descending) for keys_of in self.keys_of]
            known = self.made[id(rows)] = rows, orders
        return known[1]


def index_column(rows: list[Any], value: int, position: int) -> RowIndex:
    """The values of a column by those of another, where nothing else is wanted of the rows that are found."""
    return RowIndex(rows).add_items(map(itemgetter(position, value), rows))


# --- tables of worlds
_OPERATORS = {"eq": "=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}


@dataclass(frozen=True, slots=True)
class WorldCondition:
    """A column of a world's table is compared with a value that is known before the table is walked."""

    source: int
    column: str
    operator: str
    value: plan.Expr


def find_world_condition(condition: plan.Expr, sources: Sequence[plan.Source]) -> WorldCondition | None:
    """The condition as something that the adapter of one of the sources can use, if it is."""
    match condition:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name in _OPERATORS:
            for column, own, value in ((left, name, right), (right, MIRRORED.get(name, name), left)):
                sign = _OPERATORS[own]
                if isinstance(column, plan.Column):
                    source = next((source for source in sources if source.id == column.source), None)
                    if isinstance(source, plan.WorldSource) and _can_use_condition(source.table, column.name, sign):
                        return WorldCondition(source.id, column.name, sign, value)
    return None


def _can_use_condition(table: AttachedWorldTable, name: str, operator: str) -> bool:
    schema = table.schema
    return schema.walked is None and any(c.name == name and operator in c.operators for c in schema.columns)


# --- code ----------------------------------------------------------------------------------------------


def generate_world_loop(
    builder: QueryCompiler, source: plan.WorldSource, demands: Sequence[WorldCondition], body: PythonScope
) -> ast.expr:
    """The keys that a source walks, or its rows."""
    from ss2sql.runtime.python.python_expressions import generate_expression

    codegen, build = builder.codegen, builder.codegen.build_at(source.span)
    table: AttachedWorldTable = source.table
    if table.schema.keyed is None:
        codegen.tuples[source.id] = tuple(name for name, _ in source.columns)
    else:
        codegen.worlds[source.id] = table
    reading = _bind_reading(codegen, table, build)
    if table.schema.parameters:
        arguments = [generate_expression(builder, argument, body) for argument in source.arguments]
        return build.express("reading.call_function(arguments)", reading=reading, arguments=build.pack(*arguments))
    if not demands:
        return build.express("reading.list_keys(nothing)", reading=reading, nothing=codegen.embed(Where(), "nothing"))
    comparisons = tuple((demand.column, demand.operator) for demand in demands)
    values = [generate_expression(builder, demand.value, body) for demand in demands]
    told = codegen.embed(comparisons, "demands")
    return build.express("reading.find_keys(told, values)", reading=reading, told=told, values=build.pack(*values))


def bind_column_reader(codegen: CodegenContext, source: int, name: str, build: AstBuilder) -> str:
    """A name for the function from a key to a column."""
    table = codegen.worlds[source]
    reading = _bind_reading(codegen, table, build)
    value = build.express("reading.make_reader(name)", reading=reading, name=build.constant(name))
    return codegen.bind(("column", id(table), name), f"read_{name}", value, build)


def bind_element_reader(codegen: CodegenContext, source: int, build: AstBuilder) -> str:
    """A name for the function from a key to the element."""
    table = codegen.worlds[source]
    value = build.express("reading.get_element", reading=_bind_reading(codegen, table, build))
    return codegen.bind(("element", id(table)), "element", value, build)


def _bind_reading(codegen: CodegenContext, table: AttachedWorldTable, build: AstBuilder) -> str:
    from ss2sql.vtables.reading import plan_snapshot

    snapshot = codegen.embed(plan_snapshot(codegen.analysis.roots), "snapshot")
    value = build.express("snapshot.copy_tables(run.host.memories.now, run.check)", snapshot=snapshot)
    readings = codegen.bind("readings", "readings", value, build)
    known = codegen.embed(table.table, "table")
    value = build.express("readings.get_reading(known)", readings=readings, known=known)
    return codegen.bind(("reading", id(table)), "reading", value, build)
