"""FROM: sources, by their names and by the types of their values, and paths of files that were meant as sources."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, ResolveError, Span, suggest_names
from ss2sql.frontend.resolve.scope import (
    Scope,
    list_scopes,
    resolve_function_source,
    resolve_this,
    resolve_world,
    resolve_world_source,
    resolve_world_table,
)
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, NONE, Kind, Type, unite
from ss2sql.language.plan_traversal import can_vary_with, split_and

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


def resolve_sources(resolver: Resolver, tree: ast.Query, scope: Scope) -> tuple[plan.Expr, ...]:
    """Makes the sources visible, one after the other.

    Gives the conditions of JOIN: parts of WHERE, or of CONNECT BY in a search.
    """
    conditions: list[plan.Expr] = []
    for part in tree.sources:
        try:
            source = _resolve_source(resolver, part, scope)
            if part.name is not None or not isinstance(part.expr, ast.ListLiteral | ast.Query):
                twin = next((other for other in scope.sources if other.name == source.name), None)
                if twin is not None:
                    hint = f"name them: FROM a = {source.name}, b = {source.name}"
                    if part.name is not None:
                        hint = f"give this one another name: {part.name}_2 = {part.expr.span.text}"
                    raise ResolveError("R013", f"two sources are called '{source.name}'", part.span, (hint,))
        except ResolveError as error:
            resolver.errors.append(error)
            nothing = plan.Constant(None, ANY, span=part.span)
            name = part.name or _derive_source_name(part.expr)
            source = plan.ValueSource(resolver.make_number(), name, nothing, ANY, None, span=part.span)
        scope.sources.append(_resolve_lateral_source(source, scope))
        if part.on is not None:
            on = resolver.record_errors(resolver.resolve_expr, part.on, scope)
            if part.optional:
                joined = _resolve_left_join(resolver, scope.sources.pop(), on, part.span)
                scope.sources.append(_resolve_lateral_source(joined, scope))
            else:
                conditions.extend(split_and(on))
    return tuple(conditions)


def _resolve_left_join(resolver: Resolver, source: plan.Source, on: plan.Expr, span: Span) -> plan.QuerySource:
    """The elements of a source that meet a condition, or None where none does."""
    element = resolve_this(source, span)
    form, column = plan.Representation("list"), plan.Output("this", element)
    query = plan.Query(resolver.make_number(), (source,), (column,), on, representation=form, span=span)
    kind, columns = unite((element.type, NONE)), source.columns
    columns = columns and tuple((name, unite((of, NONE))) for name, of in columns)
    return plan.QuerySource(resolver.make_number(), source.name, query, kind, columns, optional=True, span=span)


def _resolve_lateral_source(source: plan.Source, scope: Scope) -> plan.Source:
    """The source, marked as `lateral` where it reads earlier sources or the state."""
    if not isinstance(source, (plan.ValueSource, plan.QuerySource)) or not (scope.sources or scope.states):
        return source
    lateral = can_vary_with(source, {one.id for one in scope.sources}, scope.query)
    return replace(source, lateral=True) if lateral else source


def _resolve_source(resolver: Resolver, tree: ast.From, scope: Scope) -> plan.Source:
    name = tree.name or _derive_source_name(tree.expr)
    match tree.expr:
        case ast.Call(owner=str()):
            return resolve_function_source(resolver, tree.expr, name, scope)
        case ast.Call(arguments=arguments) if any(isinstance(argument, ast.Assign) for argument in arguments):
            call = replace(tree.expr, arguments=_resolve_arguments(resolver, tree.expr))
            return resolve_value_source(resolver, name, resolver.resolve_expr(call, scope), tree.span)
        case ast.Query():
            from ss2sql.frontend.resolve.query_clauses import resolve_query

            inner = resolve_query(resolver, tree.expr, scope)
            element, columns = _resolve_element_type(inner.type)
            return plan.QuerySource(resolver.make_number(), name, inner.query, element, columns, span=tree.span)
        case ast.Name(name=word):
            return _resolve_named_source(resolver, name, word, scope, tree.expr.span)
        case ast.Literal(value=str(path)) if find_file_ending(path) is not None:
            hint = suggest_source(path, tree.name or "data")
            raise ResolveError("R003", f"FROM opens no file: {tree.expr.span.text}", tree.expr.span, (hint,))
        case ast.Literal(value=str(word)):
            text = resolve_value_source(resolver, name, resolver.resolve_expr(tree.expr, scope), tree.span)
            return replace(text, hides=_explain_hidden_table(resolver, word, None))
        case ast.Index(value=ast.Name(name=schema), index=ast.Literal(value=str(word))) if _is_file(resolver, schema):
            return _resolve_table_source(resolver, tree.name or word, schema, word, tree.expr.span)
        case ast.Attribute(source=str(schema), name=word):
            known = (source for level in list_scopes(scope) for source in level.sources)
            owner = next((source for source in known if source.name == schema), None)
            world = resolver.catalog.worlds.get(schema)
            table = world is not None and word in world.tables
            if owner is None or (table and owner.columns and word not in dict(owner.columns)):
                return _resolve_table_source(resolver, name, schema, word, tree.expr.span)
    return resolve_value_source(resolver, name, resolver.resolve_expr(tree.expr, scope), tree.span)


def _resolve_arguments(resolver: Resolver, tree: ast.Call) -> tuple[ast.Expr, ...]:
    function = resolver.catalog.functions.get(tree.function)
    return order_arguments(tree, None if function is None else function.parameters)


def order_arguments(tree: ast.Call, parameters: tuple[str, ...] | None) -> tuple[ast.Expr, ...]:
    """The arguments of a table function in the order of its parameters; `name = expr` names one here."""
    known = parameters or ()
    positional: list[ast.Expr] = [argument for argument in tree.arguments if not isinstance(argument, ast.Assign)]
    named = {argument.name: argument for argument in tree.arguments if isinstance(argument, ast.Assign)}
    for name, argument in named.items():
        if parameters is not None and name not in known[len(positional) :]:
            message = f"'{tree.function}' has no argument '{name}'"
            hints = suggest_names(name, known) or (f"help('{tree.function}') shows how it is called",)
            if name in known:
                message = f"'{tree.function}' gets the argument '{name}' twice"
                hints = (f"keep one of them: argument {known.index(name) + 1} is '{name}'",)
            raise ResolveError("R005", message, argument.name_span, hints)
    for name in known[len(positional) : len(positional) + len(named)]:
        if name not in named:
            hint = f"give '{name}' as well, which stands before them"
            raise ResolveError("R005", f"'{tree.function}' lacks the argument '{name}'", tree.span, (hint,))
        positional.append(named[name].value)
    return tuple(positional)


def _resolve_named_source(resolver: Resolver, name: str, word: str, scope: Scope, span: Span) -> plan.Source:
    bound = resolver.find_bound(word, scope, span)
    if bound is None and word in resolver.late:
        return resolve_value_source(resolver, name, _resolve_late_list(resolver, word, scope, span), span)
    world = resolve_world(resolver, word) if bound is None else None
    if world is not None:
        return resolve_world_source(resolver, world.principal, name, (), span)
    value = bound or _resolve_variable_source(resolver, word, span)
    if value is not None:
        source = resolve_value_source(resolver, name, value, span)
        return source if bound is None else replace(source, hides=_explain_hidden_table(resolver, word, bound))
    table = _find_table(resolver, None, word, span)
    if table is not None:
        return _make_table_source(resolver, table, name, span)
    value = _resolve_engine_table(resolver, word, span)
    if value is not None:
        return resolve_value_source(resolver, name, value, span)
    if resolver.catalog.unknown == "parameter":
        return resolve_value_source(resolver, name, resolver.resolve_name(word, None, span), span)
    known = [*resolver.assigned, *resolver.catalog.variables, *resolver.catalog.list_tables(), *resolver.late]
    hints = suggest_names(word, known) or (
        "assign a list to it, or attach one: session.attach(name, list), on a command line --world or --attach",
    )
    if word.upper() == "DUAL":
        hints = ("write FROM [1]",)
    if word in resolver.catalog.functions and word.lower() not in map(str.lower, known):
        hints = (f"'{word}' is a function: call it, {word}(...)",)
    if word in resolver.catalog.files:
        what = "the session's own file" if word == "main" else "a file"
        hints = (f"'{word}' is {what}: name one of its tables, FROM {word}.table",)
    raise ResolveError("R003", f"unknown source '{word}'", span, hints)


def _explain_hidden_table(resolver: Resolver, word: str, bound: plan.Expr | None) -> str:
    """What is said of a name in FROM that a column has, or that is a text (None); nothing without a table of this name.

    The table may be a variable, too.
    """
    try:
        table = resolver.catalog.table(None, word)
    except Error:
        return ""  # nobody means a view that is broken
    if table is None and word not in resolver.list_variables():
        return ""
    if bound is None:
        cure = f'{table.schema}["{word}"]' if table is not None and not word.isidentifier() else word
        return f"'{word}' in FROM is a text; for the table write FROM {cure}"
    cure = f"write all_{word} = {word}; before it, and FROM all_{word}"
    if table is not None:
        cure = f"write FROM {table.schema}.{word}"
    what = "variable of START WITH" if isinstance(bound, plan.State) else "column"
    return f"FROM {word} reads the {what} of this name; for the table {cure}"


def _is_file(resolver: Resolver, name: str) -> bool:
    """Whether a name can only mean an attached SQLite file, or `main`, the session's own."""
    others = (resolver.assigned, resolver.catalog.variables, resolver.late)
    return name in resolver.catalog.files and not any(name in known for known in others)


def _resolve_variable_source(resolver: Resolver, word: str, span: Span) -> plan.Variable | None:
    """The script variable of this name; a data frame stays one instead of being read whole."""
    value = resolver.find_variable(word, span)
    if value is None or word in resolver.assigned or word not in resolver.catalog.frames:
        return value
    return replace(value, frame=True)


def _resolve_late_list(resolver: Resolver, word: str, scope: Scope, span: Span) -> plan.Expr:
    if word in resolver.reading:
        places = ((resolver.late[word].span, "the list stands here"),)
        raise ResolveError("R011", f"the list '{word}' reads itself", span, ("read another list in it",), places)
    before = len(resolver.errors)
    resolver.reading.append(word)
    try:
        value = resolver.resolve_expr(resolver.late[word], scope)
    finally:
        resolver.reading.pop()
    if len(resolver.errors) > before:
        cause = resolver.errors[before]
        del resolver.errors[before:]
        hint = "read it in a query inside one that has the sources that it mentions"
        raise ResolveError(
            "R011",
            f"the list '{word}' cannot be read here: {cause.message}",
            span,
            cause.hints if cause.code == "R011" else (hint,),
            ((resolver.late[word].span, "the list stands here"),),
        )
    return value


def _resolve_table_source(resolver: Resolver, name: str, schema: str, word: str, span: Span) -> plan.Source:
    world = resolve_world(resolver, schema)
    if world is not None:
        return resolve_world_table(resolver, world, word, name, span)
    table = _find_table(resolver, schema, word, span)
    value = _resolve_engine_table(resolver, f"{schema}.{word}", span) if table is None else None
    if value is not None:
        return resolve_value_source(resolver, name, value, span)
    if table is None:
        hints = suggest_names(word, resolver.catalog.list_tables())
        if schema in resolver.list_variables():
            hints = (f"'{schema}' is a source without tables of its own: write FROM {schema}",)
        raise ResolveError("R003", f"unknown source '{schema}.{word}'", span, hints)
    return _make_table_source(resolver, table, name, span)


def _find_table(resolver: Resolver, schema: str | None, word: str, span: Span) -> plan.TableSource | None:
    """The table or view of this name; problems with it are errors at its place."""
    try:
        return resolver.catalog.table(schema, word)
    except Error as error:
        raise error.with_span(span) from None


def _resolve_engine_table(resolver: Resolver, name: str, span: Span) -> plan.Variable | None:
    """The table of this name in the engine's own database; it is read as a data frame is."""
    try:
        variable = resolver.catalog.other_table(name)
        if variable is None:
            return None
        kind = resolver.reads[variable] = resolver.catalog.variable_type(variable)
    except Error as error:
        raise error.with_span(span) from None
    return plan.Variable(variable, kind, frame=True, span=span)


def _make_table_source(resolver: Resolver, table: plan.TableSource, name: str, span: Span) -> plan.Source:
    source = replace(table, id=resolver.make_number(), name=name, span=span)
    resolver.tables[source.id] = source
    return source


def resolve_value_source(resolver: Resolver, name: str, value: plan.Expr, span: Span) -> plan.ValueSource:
    element, columns = _resolve_element_type(value.type)
    return plan.ValueSource(resolver.make_number(), name, value, element, columns, span=span)


def _derive_source_name(tree: ast.Expr) -> str:
    """The default name of a source: the variable's, table's or function's, else `this`."""
    match tree:
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case _:
            return "this"


def _resolve_element_type(value: Type) -> tuple[Type, tuple[tuple[str, Type], ...] | None]:
    """The type and the columns of the elements of a value that stands in FROM."""
    if value.is_only(Kind.LIST):
        return value.element or ANY, value.columns
    if value.is_only(Kind.DICT) and value.columns is not None:
        columns = value.columns
        if columns and all(kind.is_only(Kind.LIST) for _, kind in columns):
            columns = tuple((name, kind.element or ANY) for name, kind in columns)
        return Type(Kind.DICT, columns=columns), columns
    if value.may_be(Kind.LIST | Kind.DICT):
        return ANY, None
    return value, value.columns if value.may_be(Kind.OBJECT) else ()


# --- paths of files as sources: the endings that mark a string as a path, and hints for such files
ATTACHED = (".db", ".sqlite", ".sqlite3", ".parquet")
"""Endings of files that `attach` opens."""
READ_IN_PYTHON = (
    ".csv", ".tsv", ".json", ".jsonl", ".ndjson", ".xlsx", ".feather", ".mcap", ".db3", ".bag", ".nc", ".zarr", ".vtu",
)  # fmt: skip


def find_file_ending(source: Any) -> str | None:
    """The known ending of a string or path; None where it is no path, or has another ending."""
    if not isinstance(source, (str, os.PathLike)):
        return None
    ending = os.path.splitext(os.fspath(source))[1]
    known = ending.lower() if isinstance(ending, str) else ""
    return known if known in READ_IN_PYTHON or known in ATTACHED else None


def suggest_source(path: str, name: str) -> str:
    """The hint for a file: how it becomes a source."""
    if find_file_ending(path) in READ_IN_PYTHON:
        return f'read it in Python, into a data frame or a list of dicts: attach("{name}", rows)'
    return f'attach("{name}", "{path}")'
