"""`columns`: what is read of the row by its name is read as the column that it is.

    SELECT e.this["b"] FROM e = es WHERE e.this["a"] == 3      becomes      SELECT e.b FROM e = es WHERE e.a == 3

so that its type is known, and rows can be looked up by it. The elements must be dicts, of which none lacks the key:
the column of one that does is None, and to read its key is an error. A column that may be None stays as it is written,
except that of a table, whose rows have all columns.

Of a world whose list `pos` consists of the columns x, y and z, `pos[0]` becomes `x`.
"""

from __future__ import annotations

from typing import Any

from ss2sql.frontend.resolve.scope import make_column
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import walk
from ss2sql.lowering.rewrites.plan_nodes import rewrite_bottom_up
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext


def rewrite(query: plan.Query, world: RewriteContext) -> plan.Query:
    columns: dict[int, dict[str, Type]] = {}
    worlds: dict[int, plan.WorldSource] = {}
    for source in walk(query):
        if isinstance(source, plan.WorldSource):
            worlds[source.id] = source
        elif isinstance(source, (plan.TableSource, plan.ValueSource, plan.QuerySource)) and (
            known := _find_common_columns(source)
        ):
            columns[source.id] = known

    def replace_node(node: Any) -> Any:
        match node:
            case plan.Call(
                function=plan.Function(name="item", builtin=True),
                arguments=(plan.Element(source=source), plan.Constant(value=str(name))),
            ) if name in columns.get(source, ()):
                return plan.Column(source, name, columns[source][name], span=node.span)
            case plan.Call(
                function=plan.Function(name="item", builtin=True),
                arguments=(plan.Column(source=source, name=name), plan.Constant(value=int(index), type=kind)),
            ) if source in worlds and kind.is_only(Kind.INT):
                items = worlds[source].table.schema.items.get(name, ())
                if -len(items) <= index < len(items):
                    return make_column(worlds[source], items[index], node.span)
        return node

    return rewrite_bottom_up(query, replace_node) if columns or worlds else query


def _find_common_columns(source: plan.TableSource | plan.ValueSource | plan.QuerySource) -> dict[str, Type]:
    if isinstance(source, plan.TableSource):
        return dict(source.columns)
    if not source.element.is_only(Kind.DICT) or source.columns is None:
        return {}
    return {name: kind for name, kind in source.columns if not kind.may_be(Kind.NONE)}
