"""References to worlds: their tables in FROM, their columns and methods as functions of elements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ss2sql.errors import ResolveError, Span, suggest_names
from ss2sql.frontend.resolve.scope import Scope, resolve_source_column
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


def resolve_world(resolver: Resolver, name: str) -> Any:
    """The attached world of this name, unless the script has given the name another meaning."""
    if name in resolver.assigned or name in resolver.late:
        return None
    return resolver.catalog.worlds.get(name)


def resolve_world_source(
    resolver: Resolver, table: Any, name: str, arguments: tuple[plan.Expr, ...], span: Span
) -> plan.WorldSource:
    source = plan.WorldSource(resolver.make_number(), name, table, arguments, table.element, table.columns, span=span)
    resolver.tables[source.id] = source
    return source


def resolve_world_table(resolver: Resolver, world: Any, word: str, name: str, span: Span) -> plan.WorldSource:
    """`world.table` in FROM."""
    table = _find_table(world, word, span)
    if table.schema.required:
        _refuse_table_call(table, (), span)
    return resolve_world_source(resolver, table, name, (), span)


def resolve_function_source(resolver: Resolver, tree: ast.Call, name: str, scope: Scope) -> plan.Source:
    """`world.function(arguments)` in FROM: a table function, or a function whose value is walked."""
    from ss2sql.frontend.resolve.from_clause import order_arguments, resolve_value_source

    world = resolve_world(resolver, tree.owner or "")
    if world is None or (tree.function not in world.tables and tree.function in world.functions):
        return resolve_value_source(resolver, name, resolver.resolve_expr(tree, scope), tree.span)
    table = _find_table(world, tree.function, tree.span)
    arguments = order_arguments(tree, table.schema.parameters)
    if not table.schema.required <= len(arguments) <= len(table.schema.parameters):
        _refuse_table_call(table, arguments, tree.span)
    return resolve_world_source(resolver, table, name, resolver.resolve_all(arguments, scope), tree.span)


def _find_table(world: Any, word: str, span: Span) -> Any:
    table = world.tables.get(word)
    if table is None:
        hints = suggest_names(word, world.tables) or (f"its tables: {', '.join(world.tables)}",)
        raise ResolveError("R003", f"the world '{world.name}' has no table '{word}'", span, hints)
    return table


def _refuse_table_call(table: Any, arguments: tuple[ast.Expr, ...], span: Span) -> None:
    schema = table.schema
    if not schema.parameters:
        raise ResolveError("R005", f"'{table.title}' takes no arguments", span, (f"write FROM {table.title}",))
    missing = schema.parameters[len(arguments) : schema.required]
    what = f"lacks {' and '.join(missing)}" if missing else f"takes at most {len(schema.parameters)} arguments"
    hint = f"it is called as {table.world_name}.{schema.signature}"
    raise ResolveError("R005", f"'{table.title}' {what}", span, (hint,))


def resolve_world_call(
    resolver: Resolver, name: str, arguments: tuple[plan.Expr, ...], scope: Scope | None, span: Span
) -> plan.Expr:
    """A call of a world's function; for the current element of a source the column itself, or an item of it."""
    source = _resolve_walked_source(arguments[0], scope) if arguments else None
    if source is not None and any(column == name for column, _ in source.columns):
        if len(arguments) == 1:
            return resolve_source_column(source, name, span)
        if _is_item(resolver, source, name, arguments[1:]):
            return resolver.make_call("item", (resolve_source_column(source, name, span), arguments[1]), span, span)
    function = resolver.catalog.world_functions[name]
    resolver.check_arity(function, len(arguments), span)
    return plan.Call(function, arguments, ANY, span=span, place=span)


def _is_item(resolver: Resolver, source: plan.WorldSource, name: str, following: tuple[plan.Expr, ...]) -> bool:
    """Whether a function is declared to give the item of the column of its name at the second argument."""
    note = resolver.catalog.worlds[source.table.world_name].get_declaration(name)
    length = dict(source.columns)[name].size
    match following:
        case (plan.Constant(value=int(index), type=kind),):
            return note.indexed and length is not None and kind.is_only(Kind.INT) and 0 <= index < length
        case _:
            return False


def _resolve_walked_source(expr: plan.Expr, scope: Scope | None) -> plan.WorldSource | None:
    """The source whose current element the expression is, if that is one of a world."""
    if not isinstance(expr, plan.Element) or scope is None:
        return None
    source = next((one for level in scope.list_outwards() for one in level.sources if one.id == expr.source), None)
    return source if isinstance(source, plan.WorldSource) else None


def resolve_equality(arguments: tuple[plan.Expr, ...], scope: Scope | None) -> tuple[plan.Expr, ...]:
    """The operands of `==` and `!=`: two elements of one table are replaced by keys that are numbers or strings."""
    sources = [_resolve_walked_source(argument, scope) for argument in arguments]
    match sources:
        case [plan.WorldSource(table=one) as first, plan.WorldSource(table=other) as second]:
            same_table = one.schema.keyed is not None and one.schema.keyed is other.schema.keyed
            if same_table and one.key and dict(first.columns)[one.key].kinds in (Kind.INT, Kind.STR):
                pairs = zip((first, second), arguments, strict=True)
                return tuple(resolve_source_column(source, one.key, argument.span) for source, argument in pairs)
    return arguments


def is_function_of_this(resolver: Resolver, name: str, scope: Scope) -> bool:
    """Whether a bare name may be a function that is applied to `this`.

    Where the columns of a source are known only at run time, the name of a column is read as one.
    """
    assert scope.sources, "a query has a source, and one that is unknown ends it"
    if name in resolver.catalog.functions:
        return True
    if name not in resolver.catalog.world_functions:
        return False
    return not any(source.columns is None for level in scope.list_outwards() for source in level.sources)
