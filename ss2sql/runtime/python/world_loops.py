"""Sources that are tables of worlds: what walks here are keys, and columns are read of them when they are needed.

Conditions that the adapter gets (`push_condition_to_world` in source_loops.py) only save rows; all are tested again.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.runtime.python.ast_builder import AstBuilder
from ss2sql.vtables.contract import Where

if TYPE_CHECKING:
    from ss2sql.runtime.python.codegen_context import CodegenContext, PythonScope
    from ss2sql.runtime.python.native_query import QueryCompiler
    from ss2sql.vtables.attached_worlds import AttachedWorldTable

_OPERATORS = {"eq": "=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_MIRRORED = {"=": "=", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


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
            operator = _OPERATORS[name]
            for column, sign, value in ((left, operator, right), (right, _MIRRORED[operator], left)):
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
        return build.call_method(f"{reading}.call_function", build.pack(*arguments))
    if not demands:
        return build.call_method(f"{reading}.list_keys", build.name(codegen.embed(Where(), "nothing")))
    comparisons = tuple((demand.column, demand.operator) for demand in demands)
    values = [generate_expression(builder, demand.value, body) for demand in demands]
    told = build.name(codegen.embed(comparisons, "demands"))
    return build.call_method(f"{reading}.find_keys", told, build.pack(*values))


def bind_column_reader(codegen: CodegenContext, source: int, name: str, build: AstBuilder) -> str:
    """A name for the function from a key to a column."""
    table = codegen.worlds[source]
    value = build.call_method(f"{_bind_reading(codegen, table, build)}.make_reader", build.constant(name))
    return codegen.bind(("column", id(table), name), f"read_{name}", value, build)


def bind_element_reader(codegen: CodegenContext, source: int, build: AstBuilder) -> str:
    """A name for the function from a key to the element."""
    table = codegen.worlds[source]
    value = build.part(build.name(_bind_reading(codegen, table, build)), "get_element")
    return codegen.bind(("element", id(table)), "element", value, build)


def _bind_reading(codegen: CodegenContext, table: AttachedWorldTable, build: AstBuilder) -> str:
    from ss2sql.vtables.reading import plan_snapshot

    snapshot = codegen.embed(plan_snapshot(codegen.analysis.roots), "snapshot")
    run = build.name("run")
    memory = build.part(build.part(build.part(run, "host"), "memories"), "now")
    value = build.call_method(f"{snapshot}.copy_tables", memory, build.part(run, "check"))
    readings = codegen.bind("readings", "readings", value, build)
    value = build.call_method(f"{readings}.get_reading", build.name(codegen.embed(table.table, "table")))
    return codegen.bind(("reading", id(table)), "reading", value, build)
