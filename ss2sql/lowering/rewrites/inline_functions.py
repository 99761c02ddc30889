"""`inline`, `columns` and `rows`: functions, names in brackets and lists of one column become what they stand for.

    def cost(a, b): return abs(a - b)          WHERE cost(x, 3) < 2          asks          abs(x - 3) < 2

The function must be immutable. frontend/inlining.py reads its body when it is registered, and says for each call
whether the body does what the call does, and what becomes of large numbers.

Over a table of 100,000 rows `WHERE cost(id, 3) < 2` takes 9 ms in SQLite and 160 ms natively; with the calls, all of
different arguments, it takes 690 and 430 ms.

    SELECT e.this["b"] FROM e = es WHERE e.this["a"] == 3      becomes      SELECT e.b FROM e = es WHERE e.a == 3

so that its type is known, and rows can be looked up by it. The elements must be dicts, of which none lacks the key:
the column of one that does is None, and to read its key is an error. A column that may be None stays as it is written,
except that of a table, whose rows have all columns.

Of a world whose list `pos` consists of the columns x, y and z, `pos[0]` becomes `x`.

    FROM (SELECT this FROM pairs WHERE this[0] == here AS list)       and of it        this

    FROM (SELECT this FROM pairs WHERE this[0] == here)               and of it        the column this

So rows need not be collected in a list that is walked then: they are a part of the product around the query, and are
looked up. It is done where nothing in the query can fail, and whole elements are all that is read of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.frontend.resolve.scope import resolve_source_column
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import is_column_query, walk
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext, rewrite_bottom_up

if TYPE_CHECKING:
    from ss2sql.frontend.inlining import InlinedCall


def inline_functions(query: plan.Query, world: RewriteContext) -> plan.Query:
    return _inline_calls(query)[0]


def list_calls_to_rewrite(query: plan.Query) -> list[InlinedCall]:
    """What `inline_functions` does with the calls of functions whose bodies are known, in their order."""
    return _inline_calls(query)[1]


def _inline_calls(query: plan.Query) -> tuple[plan.Query, list[InlinedCall]]:
    from ss2sql.frontend.inlining import Inliner

    inliner = Inliner()
    inliner.sources.update((node.id, node) for node in walk(query) if isinstance(node, plan.SOURCES))

    def inline_call(node: Any) -> Any:
        return inliner.inline_call(node) if isinstance(node, plan.Call) and node.function.body is not None else node

    return rewrite_bottom_up(query, inline_call), list(inliner.sites.values())


# --- `columns`: what is read of the row by its name is read as the column that it is
def read_keys_as_columns(query: plan.Query, world: RewriteContext) -> plan.Query:
    columns: dict[int, dict[str, Type]] = {}
    worlds: dict[int, plan.WorldSource] = {}
    for source in walk(query):
        if isinstance(source, plan.WorldSource):
            worlds[source.id] = source
        elif isinstance(source, (plan.TableSource, plan.ValueSource, plan.QuerySource)) and (
            known := _find_columns_to_rewrite(source)
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
                arguments=(plan.Column(source=source, name=name), plan.Constant(value=int(index))),
            ) if source in worlds:
                items = worlds[source].table.schema.items.get(name, ())
                if -len(items) <= index < len(items):
                    return resolve_source_column(worlds[source], items[index], node.span)
        return node

    return rewrite_bottom_up(query, replace_node) if columns or worlds else query


def _find_columns_to_rewrite(source: plan.TableSource | plan.ValueSource | plan.QuerySource) -> dict[str, Type]:
    if isinstance(source, plan.TableSource):
        return dict(source.columns)
    if not source.element.is_only(Kind.DICT) or source.columns is None:
        return {}
    return {name: kind for name, kind in source.columns if not kind.may_be(Kind.NONE)}


# --- `rows`: a query in FROM that gives a list of one column is read as the rows that it finds
def read_lists_as_rows(query: plan.Query, world: RewriteContext) -> plan.Query:
    nodes = list(walk(query))
    found = [node for node in nodes if isinstance(node, plan.QuerySource)]
    whole = {inner.id for node in found if node.optional for inner in node.query.sources}  # read through LEFT JOIN
    lists = {node.id for node in found if not node.optional and node.id not in whole and _is_list_query(node.query)}
    for node in nodes:
        match node:
            case plan.Column(source=source) | plan.Output(expr=plan.Element(source=source), star=True):
                lists.discard(source)
            case plan.Eval():
                return query

    def read_row(node: Any) -> Any:
        match node:
            case plan.Element(source=source) if source in lists:
                return plan.Column(source, "this", node.type, span=node.span)
            case plan.QuerySource(id=number, query=inner) if number in lists:
                output = plan.Output("this", inner.columns[0].expr)
                inner = replace(inner, columns=(output,), representation=plan.Representation("dict"))
                columns = (("this", output.expr.type),)
                return replace(node, query=inner, element=Type(Kind.DICT, columns=columns), columns=columns)
            case _:
                return node

    return rewrite_bottom_up(query, read_row) if lists else query


def _is_list_query(query: plan.Query) -> bool:
    """Whether a query is nothing but sources, conditions and one column of a list, none of which can fail."""
    if not is_column_query(query) or query.columns[0].label or query.order:
        return False
    if not all(isinstance(source, (plan.TableSource, plan.ValueSource)) for source in query.sources):
        return False
    return is_free(*query.sources, query.columns[0].expr, query.where)
