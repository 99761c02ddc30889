"""Sources that are tables of worlds: what walks here are keys, and columns are read of them when they are needed.

What the adapter is told of conditions (`pass_on` in loops.py) only saves rows; each condition is tested again.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.errors import Span
from ss2sql.records import dataclass
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.run import Run
from ss2sql.vtables.attached import AttachedTable
from ss2sql.vtables.reading import NOTHING, Read, Reading, Readings
from ss2sql.vtables.snapshots import Snapshot, first_place, snapshot_for

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder
    from ss2sql.runtime.native.unit import Body, Unit

_OPERATORS = {"eq": "=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_TURNED = {"=": "=", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


@dataclass(frozen=True, slots=True)
class Demand:
    """A column of a world's table is compared with a value that is known before the table is walked."""

    source: int
    column: str
    operator: str
    value: plan.Expr


def demand_of(condition: plan.Expr, sources: Sequence[plan.Source]) -> Demand | None:
    """The condition as something that the adapter of one of the sources can use, if it is."""
    match condition:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name in _OPERATORS:
            operator = _OPERATORS[name]
            for column, sign, value in ((left, operator, right), (right, _TURNED[operator], left)):
                if isinstance(column, plan.Column):
                    source = next((source for source in sources if source.id == column.source), None)
                    if isinstance(source, plan.WorldSource) and _can_use(source.table, column.name, sign):
                        return Demand(source.id, column.name, sign, value)
    return None


def _can_use(table: AttachedTable, name: str, operator: str) -> bool:
    schema = table.schema
    return schema.walked is None and any(c.name == name and operator in c.operators for c in schema.columns)


# --- code ----------------------------------------------------------------------------------------------


def world_items(builder: Builder, source: plan.WorldSource, demands: Sequence[Demand], body: Body) -> ast.expr:
    """The keys that a source walks, or its rows."""
    from ss2sql.runtime.native.expressions import expression

    unit, pen = builder.unit, builder.unit.pen_at(source.span)
    table: AttachedTable = source.table
    if table.schema.keyed is None:
        unit.tuples[source.id] = tuple(name for name, _ in source.columns)
    else:
        unit.worlds[source.id] = table
    reading = pen.name(_reading(unit, table, pen))
    if table.schema.parameters:
        arguments = [expression(builder, argument, body) for argument in source.arguments]
        return pen.call(unit.helper(rows_of), reading, *arguments)
    asked = tuple((demand.column, demand.operator) for demand in demands)
    values = [expression(builder, demand.value, body) for demand in demands]
    return pen.call(unit.helper(keys_of), reading, pen.name(unit.constant(asked, "demands")), *values)


def column_reader(unit: Unit, source: int, name: str, pen: Pen) -> str:
    """A name for the function from a key to a column."""
    table = unit.worlds[source]
    value = pen.call(unit.helper(reader_of), pen.name(_reading(unit, table, pen)), pen.constant(name))
    return unit.bind(("column", id(table), name), f"read_{name}", value, pen)


def element_reader(unit: Unit, source: int, pen: Pen) -> str:
    """A name for the function from a key to the element."""
    table = unit.worlds[source]
    value = pen.call(unit.helper(elements_of), pen.name(_reading(unit, table, pen)))
    return unit.bind(("element", id(table)), "element", value, pen)


def _reading(unit: Unit, table: AttachedTable, pen: Pen) -> str:
    snapshot = pen.name(unit.constant(snapshot_for(unit.analysis.roots), "snapshot"))
    value = pen.call(unit.helper(readings_of), pen.name("run"), snapshot)
    readings = unit.bind("readings", "readings", value, pen)
    known = (table.table, first_place(table, unit.analysis.roots))
    value = pen.call(unit.helper(reading_of), pen.name(readings), pen.name(unit.constant(known, "table")))
    return unit.bind(("reading", id(table)), "reading", value, pen)


# --- what the code calls -------------------------------------------------------------------------------


def readings_of(run: Run, snapshot: Snapshot) -> Readings:
    return snapshot.begin(run.host.memories.now, run.check)


def reading_of(readings: Readings, known: tuple[Any, Span | None]) -> Reading:
    return readings.of(*known)


def reader_of(reading: Reading, name: str) -> Read:
    return reading.reader(name)


def elements_of(reading: Reading) -> Read:
    return reading.element


def keys_of(reading: Reading, demands: Sequence[tuple[str, str]], *values: Any) -> list[Any]:
    return reading.asked(demands, values) if demands else reading.keys(NOTHING)


def rows_of(reading: Reading, *arguments: Any) -> list[Any]:
    return reading.rows(arguments)
