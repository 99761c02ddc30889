"""`inline`, `columns` and `rows`: functions, names in brackets and lists of one column become what they stand for.

    def cost(a, b): return abs(a - b)          WHERE cost(x, 3) < 2          asks          abs(x - 3) < 2

The function must be immutable. frontend/inlining/function_bodies.py reads its body when it is registered,
frontend/inlining/substitution.py says for each call whether the body does what the call does,
frontend/inlining/substitution.py what becomes of large numbers.

Over a table of 100,000 rows `WHERE cost(id, 3) < 2` takes 9 ms in SQLite and 160 ms natively; with the calls, all of
different arguments, it takes 690 and 430 ms.

    SELECT e.this["b"] FROM e = es WHERE e.this["a"] == 3      becomes      SELECT e.b FROM e = es WHERE e.a == 3

so that its type is known, and rows can be looked up by it. The elements must be dicts, of which none lacks the key:
the column of one that does is None, and to read its key is an error. A column that may be None stays as it is written,
except that of a table, whose rows have all columns.

Of a world whose list `pos` consists of the columns x, y and z, `pos[0]` becomes `x`.

    FROM (SELECT this FROM pairs WHERE this[0] == here AS list)       and of it        this, this[1]

    FROM (SELECT this, this[1] FROM pairs WHERE this[0] == here)      and of it        this, this_1

So rows need not be collected in a list that is walked then: they are a part of the product around the query, and are
looked up. It is done where nothing in the query can fail.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias

from ss2sql.frontend.inlining.substitution import InlinedCall, Inliner
from ss2sql.frontend.resolve.scope import resolve_source_column
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import can_fail, list_plan_functions, rebuild_node, walk
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext, rewrite_bottom_up


def inline_functions(query: plan.Query, world: RewriteContext) -> plan.Query:
    return _inline_calls(query, Inliner())


def list_calls_to_rewrite(query: plan.Query) -> list[InlinedCall]:
    """What `inline_functions` does with the calls of functions whose bodies are known, in their order."""
    inliner = Inliner()
    _inline_calls(query, inliner)
    return list(inliner.sites.values())


def _inline_calls(query: plan.Query, inliner: Inliner) -> plan.Query:
    if all(function.body is None for function in list_plan_functions(query)):
        return query
    inliner.sources.update((node.id, node) for node in walk(query) if isinstance(node, plan.SOURCES))

    def inline_call(node: Any) -> Any:
        return inliner.inline_call(node) if isinstance(node, plan.Call) and node.function.body is not None else node

    return rewrite_bottom_up(query, inline_call)


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
                arguments=(plan.Column(source=source, name=name), plan.Constant(value=int(index), type=kind)),
            ) if source in worlds and kind.is_only(Kind.INT):
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
Names: TypeAlias = dict[plan.Expr, str]  # of columns, by what the query computes for them


def read_lists_as_rows(query: plan.Query, world: RewriteContext) -> plan.Query:
    found = [node for node in walk(query) if isinstance(node, plan.QuerySource)]
    whole = {inner.id for node in found if node.optional for inner in node.query.sources}  # read through LEFT JOIN
    among = [node for node in found if not node.optional and node.id not in whole]
    sources = {node.id: node for node in among if _is_list_query(node.query)}
    if not sources:
        return query
    for node in walk(query):
        if isinstance(node, plan.Eval):
            return query
        if (
            isinstance(node, plan.Column)
            and node.source in sources
            and _rewrite_element_read(node, sources[node.source]) is None
        ):
            del sources[node.source]
        if isinstance(node, plan.Output) and node.star and isinstance(node.expr, plan.Element):
            sources.pop(node.expr.source, None)
    names: dict[int, Names] = {number: {source.query.columns[0].expr: "this"} for number, source in sources.items()}

    def read_row(node: Any) -> Any:
        number = _find_source_read(node)
        expr = None if number is None or number not in sources else _rewrite_element_read(node, sources[number])
        if number is None or expr is None:
            return rebuild_node(node, read_row)
        name = names[number].setdefault(expr, f"this_{len(names[number])}")
        return plan.Column(number, name, expr.type, span=node.span)

    def replace_source(node: Any) -> Any:
        return (
            _rewrite_to_rows(node, names[node.id]) if isinstance(node, plan.QuerySource) and node.id in names else node
        )

    return rewrite_bottom_up(read_row(query), replace_source) if sources else query


def _is_list_query(query: plan.Query) -> bool:
    """Whether a query is nothing but sources, conditions and one column of a list, none of which can fail."""
    if query.representation.name != "list" or len(query.columns) > 1 or query.columns[0].label or query.columns[0].star:
        return False
    if query.search or query.grouped or query.order or query.limit:
        return False
    if not all(isinstance(source, (plan.TableSource, plan.ValueSource)) for source in query.sources):
        return False
    return not any(map(can_fail, (*query.sources, query.columns[0].expr, *((query.where,) if query.where else ()))))


def _find_source_read(node: Any) -> int | None:
    """The source of whose element a node reads the whole, a column or an item."""
    match node:
        case plan.Element(source=source) | plan.Column(source=source):
            return source
        case plan.Call(
            function=plan.Function(name="item", builtin=True, raises=False),
            arguments=(plan.Element(source=source), plan.Constant()),
        ):
            return source
        case _:
            return None


def _rewrite_element_read(node: plan.Element | plan.Column | plan.Call, source: plan.QuerySource) -> plan.Expr | None:
    """What is read of an element, as an expression of the query; None for a column that it does not declare."""
    element = source.query.columns[0].expr
    match node:
        case plan.Element():
            return element
        case plan.Call(arguments=(_, place)):
            return replace(node, arguments=(element, place))
        case plan.Column(name=name) if isinstance(element, plan.Element):
            columns = next((one.columns for one in source.query.sources if one.id == element.source), None)
            declared = node.declared and name in dict(columns or ())
            return replace(node, source=element.source) if declared else None
        case _:
            return None


def _rewrite_to_rows(source: plan.QuerySource, names: Names) -> plan.QuerySource:
    columns = tuple((name, expr.type) for expr, name in names.items())
    outputs = tuple(plan.Output(name, expr) for expr, name in names.items())
    query = replace(source.query, columns=outputs, representation=plan.Representation("dict"))
    return replace(source, query=query, element=Type(Kind.DICT, columns=columns))
