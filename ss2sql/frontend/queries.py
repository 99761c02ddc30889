"""Queries: sources, the search, columns and groups, resolved clause by clause in the order of their sight."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.errors import ResolveError, Span, did_you_mean
from ss2sql.frontend import ast
from ss2sql.frontend.groups import with_groups
from ss2sql.frontend.options import search_options
from ss2sql.frontend.scope import Scope, bound_name, column_of, element_of
from ss2sql.kinds import ANY, NONE, Kind, Type, covers, union
from ss2sql.runtime.rows import free_name

if TYPE_CHECKING:
    from ss2sql.frontend.resolve import Resolver

SYNONYMS = {"val": "value"}


def resolve_query(resolver: Resolver, tree: ast.Query, outer: Scope | None) -> plan.Subquery:
    """The plan of a query; errors of its clauses are kept, so that all of them are found."""
    scope = Scope(outer, resolver.number())
    search = _search(resolver, tree, scope, outer)
    sources = tuple(scope.sources)
    where = _optional(resolver, tree.where, scope)
    group = tuple(_key(resolver, key, scope) for key in tree.group)
    scope.grouped = bool(group)
    columns = _columns(resolver, tree, scope)
    order = tuple(plan.OrderKey(_key(resolver, key.expr, scope), key.descending) for key in tree.order)
    having = None if tree.having is None else resolver.guarded(resolver.expression, tree.having, scope)
    query = plan.Query(
        scope.query,
        sources,
        columns,
        where,
        search,
        group,
        having,
        False,
        order,
        _optional(resolver, tree.limit, outer),
        _representation(resolver, tree.representation, outer),
        span=tree.span,
    )
    if group:
        query = with_groups(resolver, query)
    return plan.Subquery(query, _value_type(query), span=tree.span)


def _optional(resolver: Resolver, tree: ast.Expr | None, scope: Scope | None) -> plan.Expr | None:
    return None if tree is None else resolver.guarded(resolver.expression, tree, scope)


# --- sources -------------------------------------------------------------------------------------------


def _open_sources(resolver: Resolver, tree: ast.Query, scope: Scope) -> None:
    """Brings the sources into sight, one after the other."""
    for part in tree.sources:
        try:
            source = _source(resolver, part, scope)
            if part.name is not None or not isinstance(part.expr, ast.ListLiteral | ast.Query):
                twin = next((other for other in scope.sources if other.name == source.name), None)
                if twin is not None:
                    raise ResolveError(
                        "R013",
                        f"two sources are called '{source.name}'",
                        part.span,
                        (f"name them: FROM a = {source.name}, b = {source.name}",),
                    )
        except ResolveError as error:
            resolver.errors.append(error)
            nothing = plan.Constant(None, ANY, span=part.span)
            name = part.name or _name_of(part.expr)
            source = plan.ValueSource(resolver.number(), name, nothing, ANY, None, span=part.span)
        scope.sources.append(source)


def _source(resolver: Resolver, tree: ast.From, scope: Scope) -> plan.Source:
    name = tree.name or _name_of(tree.expr)
    match tree.expr:
        case ast.Query():
            inner = resolve_query(resolver, tree.expr, scope)
            element, columns = _elements(inner.type)
            return plan.QuerySource(resolver.number(), name, inner.query, element, columns, span=tree.span)
        case ast.Name(name=word):
            return _named_source(resolver, name, word, scope, tree.expr.span)
        case ast.Attribute(source=schema, name=word):
            if all(schema != source.name for level in scope.outwards() for source in level.sources):
                return _table_source(resolver, name, schema, word, tree.expr.span)
    return _value_source(resolver, name, resolver.expression(tree.expr, scope), tree.span)


def _named_source(resolver: Resolver, name: str, word: str, scope: Scope, span: Span) -> plan.Source:
    if word in resolver.late:
        return _value_source(resolver, name, _late_list(resolver, word, scope, span), span)
    value = bound_name(scope, word, span) or resolver.variable(word, span)
    if value is not None:
        return _value_source(resolver, name, value, span)
    table = resolver.catalog.table(None, word)
    if table is not None:
        return _use_table(resolver, table, name, span)
    if resolver.catalog.open_names:
        return _value_source(resolver, name, resolver.name(word, None, span), span)
    known = [*resolver.assigned, *resolver.catalog.variables, *resolver.catalog.tables, *resolver.late]
    hints = did_you_mean(word, known) or ("assign a list to it, or attach one from Python: session.attach(name, list)",)
    if word in resolver.catalog.functions:
        hints = (f"'{word}' is a function: call it, {word}(...)",)
    raise ResolveError("R003", f"unknown source '{word}'", span, hints)


def _late_list(resolver: Resolver, word: str, scope: Scope, span: Span) -> plan.Expr:
    before = len(resolver.errors)
    value = resolver.expression(resolver.late[word], scope)
    if len(resolver.errors) > before:
        cause = resolver.errors[before]
        del resolver.errors[before:]
        raise ResolveError(
            "R011",
            f"the list '{word}' cannot be read here: {cause.message}",
            span,
            ("read it in a query inside one that has the sources that it mentions",),
            ((resolver.late[word].span, "the list stands here"),),
        )
    return value


def _table_source(resolver: Resolver, name: str, schema: str, word: str, span: Span) -> plan.Source:
    table = resolver.catalog.table(schema, word)
    if table is None:
        hints = did_you_mean(word, resolver.catalog.tables) or (f"'{schema}' is no source here, and has no such table",)
        raise ResolveError("R003", f"unknown source '{schema}.{word}'", span, hints)
    return _use_table(resolver, table, name, span)


def _use_table(resolver: Resolver, table: plan.TableSource, name: str, span: Span) -> plan.Source:
    source = replace(table, id=resolver.number(), name=name, span=span)
    resolver.tables[source.id] = source
    return source


def _value_source(resolver: Resolver, name: str, value: plan.Expr, span: Span) -> plan.Source:
    element, columns = _elements(value.type)
    return plan.ValueSource(resolver.number(), name, value, element, columns, span=span)


def _name_of(tree: ast.Expr) -> str:
    """The name of a source that has none written: the variable's, table's or function's, else `this`."""
    match tree:
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case _:
            return "this"


def _elements(value: Type) -> tuple[Type, tuple[tuple[str, Type], ...] | None]:
    """The type and the columns of the elements of a value that stands in FROM."""
    if value.only(Kind.LIST):
        return value.item or ANY, value.columns
    if value.only(Kind.DICT) and value.columns is not None:
        columns = value.columns
        if columns and all(kind.only(Kind.LIST) for _, kind in columns):
            columns = tuple((name, kind.item or ANY) for name, kind in columns)
        return Type(Kind.DICT, columns=columns), columns
    if value.may(Kind.LIST | Kind.DICT):
        return ANY, None
    return value, value.columns if value.may(Kind.OBJECT) else ()


# --- the search ----------------------------------------------------------------------------------------


def _search(resolver: Resolver, tree: ast.Query, scope: Scope, outer: Scope | None) -> plan.Search | None:
    """Opens the sources and, where there is CONNECT BY, resolves the hierarchical clauses."""
    if not tree.connect and not tree.options:
        for clause, part in (("START WITH", tree.start), ("STOP WITH", tree.stop)):
            if part:
                place = part[0].span if isinstance(part, tuple) else part.span
                resolver.errors.append(
                    ResolveError("R012", f"{clause} needs CONNECT BY", place, ("add CONNECT BY name = expr",))
                )
        _open_sources(resolver, tree, scope)
        return None
    start = _start(resolver, tree, scope)
    _check_assigned(resolver, tree)
    _settle_state_types(resolver, tree, scope, dict(start))
    _open_sources(resolver, tree, scope)
    connect = tuple((a.name, resolver.guarded(resolver.expression, a.value, scope)) for a in tree.connect)
    stop = _optional(resolver, tree.stop, scope)
    return search_options(
        resolver, tree, scope, outer, plan.Search(start, connect, stop, states=tuple(scope.states.items()))
    )


def _start(resolver: Resolver, tree: ast.Query, scope: Scope) -> tuple[tuple[str, plan.Expr], ...]:
    start: list[tuple[str, plan.Expr]] = []
    for assign in tree.start:
        if assign.name in scope.states:
            message = f"START WITH sets '{assign.name}' twice"
            resolver.errors.append(ResolveError("R013", message, assign.name_span, ("keep one of them",)))
        value = resolver.guarded(resolver.expression, assign.value, scope)
        start.append((assign.name, value))
        scope.states[assign.name] = value.type
    return tuple(start)


def _check_assigned(resolver: Resolver, tree: ast.Query) -> None:
    known = [assign.name for assign in tree.start]
    if not tree.connect:
        hint = "name what changes from step to step: CONNECT BY name = expr"
        resolver.errors.append(ResolveError("R012", "CONNECT BY assigns nothing", tree.options[0].span, (hint,)))
    for assign in tree.connect:
        if assign.name not in known:
            hints = did_you_mean(assign.name, known) or (f"add START WITH {assign.name} = ...",)
            message = f"CONNECT BY sets '{assign.name}', which START WITH does not"
            resolver.errors.append(ResolveError("R001", message, assign.name_span, hints))


def _settle_state_types(resolver: Resolver, tree: ast.Query, scope: Scope, start: dict[str, plan.Expr]) -> None:
    """Widens the types of the START WITH variables until CONNECT BY keeps within them.

    Each round resolves FROM and CONNECT BY on trial. Three rounds decide it for everything but growing
    numbers, whose bounds are dropped first, and growing lists; what is still moving is taken as unknown.
    """
    counters = {name: _counter_type(tree, name, value) for name, value in start.items()}
    for name, kind in counters.items():
        if kind is not None:
            scope.states[name] = kind
    for attempt in range(4):
        grown = _connect_types(resolver, tree, scope) if scope.depth <= 2 and attempt < 3 else None
        settled = True
        for name in scope.states:
            if counters.get(name) is not None:
                continue
            if grown is None:
                scope.states[name] = ANY
            elif name in grown and not covers(scope.states[name], grown[name]):
                wide = union((scope.states[name], grown[name]))
                scope.states[name] = replace(wide, low=None, high=None)
                settled = False
        if settled:
            return


def _connect_types(resolver: Resolver, tree: ast.Query, scope: Scope) -> dict[str, Type]:
    """The types that CONNECT BY gives with the present types of the variables; nothing of the trial is kept."""
    errors = len(resolver.errors)
    kept = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    trial = scope.copy()
    _open_sources(resolver, tree, trial)
    types: dict[str, Type] = {}
    for assign in tree.connect:
        value = resolver.guarded(resolver.expression, assign.value, trial)
        types[assign.name] = value.type
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = kept
    return types


def _counter_type(tree: ast.Query, name: str, start: plan.Expr) -> Type | None:
    """The type of a variable that only counts, `level = level + 1`, else None.

    No search makes 2^31 steps on one path, so a small stride from a small start stays within 64 bits.
    """
    match [assign.value for assign in tree.connect if assign.name == name]:
        case [ast.Operator(function="add" | "sub", operands=(ast.Name(name=same), ast.Literal(value=int(stride))))]:
            pass
        case _:
            return None
    small = start.type.only(Kind.INT) and start.type.bounded(2**61)
    if same != name or isinstance(stride, bool) or not 0 <= stride <= 2**30 or not small:
        return None
    return Type(Kind.INT, -(2**62), 2**62)


# --- columns and keys ----------------------------------------------------------------------------------


def _columns(resolver: Resolver, tree: ast.Query, scope: Scope) -> tuple[plan.Output, ...]:
    outputs: list[plan.Output] = []
    for column in tree.columns:
        match column:
            case ast.Star():
                outputs.extend(_star(resolver, scope, column.span))
            case ast.Call(function="to", arguments=(value, label)) if resolver.catalog.functions["to"].builtin:
                outputs.append(_labelled(resolver, value, label, scope))
            case _:
                outputs.append(plan.Output(_column_name(column), _key(resolver, column, scope)))
    if any(output.label for output in outputs):
        return tuple(outputs)  # the names are complete only when the query runs, and are told apart then
    taken: list[str] = []
    for output in outputs:
        taken.append(free_name(output.name, taken))
    return tuple(replace(output, name=name) for output, name in zip(outputs, taken, strict=True))


def _star(resolver: Resolver, scope: Scope, span: Span) -> list[plan.Output]:
    outputs: list[plan.Output] = []
    for source in scope.sources:
        if source.columns is None:
            resolver.tentative = True
        if source.columns:
            outputs.extend(plan.Output(name, column_of(source, name, span)) for name, _ in source.columns)
        else:
            outputs.append(plan.Output(source.name, element_of(source, span), star=source.columns is None))
    return outputs


def _labelled(resolver: Resolver, value: ast.Expr, label: ast.Expr, scope: Scope) -> plan.Output:
    expr = _key(resolver, value, scope)
    match label:
        case ast.Name(name=name) | ast.Literal(value=str(name)):
            return plan.Output(name, expr)
        case _:
            text = resolver.guarded(resolver.expression, label, scope.parent)
            return plan.Output(_column_name(value), expr, text)


def _column_name(tree: ast.Expr) -> str:
    match tree:
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case ast.This(source=None):
            return "this"
        case ast.This(source=str(source)):
            return source
        case _:
            return tree.span.text


def _key(resolver: Resolver, tree: ast.Expr, scope: Scope) -> plan.Expr:
    """A SELECT column, GROUP BY or ORDER BY key: a bare function name is applied to `this`."""
    if isinstance(tree, ast.Name) and tree.name in resolver.catalog.functions and scope.sources:
        try:
            found = bound_name(scope, tree.name, tree.span) or resolver.variable(tree.name, tree.span)
        except ResolveError as error:
            resolver.errors.append(error)
            return plan.Constant(None, ANY, span=tree.span)
        if found is None:
            tree = ast.Call(tree.name, (ast.This(None, span=tree.span),), span=tree.span)
    return resolver.guarded(resolver.expression, tree, scope)


# --- representation ------------------------------------------------------------------------------------


def _representation(resolver: Resolver, tree: ast.Representation | None, outer: Scope | None) -> plan.Representation:
    if tree is None:
        return plan.Representation("dict")
    name = SYNONYMS.get(tree.name.lower(), tree.name.lower())
    known = {word.lower() for word in resolver.catalog.representations}
    if name not in known:
        resolver.errors.append(
            ResolveError("R006", f"unknown representation '{tree.name}'", tree.span, did_you_mean(name, known))
        )
    arguments = resolver.all(tree.arguments, outer)
    named = tuple((a.name, resolver.guarded(resolver.expression, a.value, outer)) for a in tree.named)
    return plan.Representation(name, arguments, named, tree.span)


def _value_type(query: plan.Query) -> Type:
    """The type of what the query gives, where a representation of the language makes it."""
    kinds = [output.expr.type for output in query.columns]
    if any(output.label for output in query.columns):
        return ANY
    rows = Type(Kind.LIST)
    match query.representation.name:
        case "dict":
            columns = tuple((output.name, output.expr.type) for output in query.columns)
            rows = Type(Kind.LIST, item=Type(Kind.DICT, columns=columns), columns=columns)
        case "list" | "set":
            item = union(kinds)
            rows = Type(Kind.LIST, item=item, columns=item.columns if item.may(Kind.DICT | Kind.OBJECT) else ())
        case "rows":
            rows = Type(Kind.LIST, item=Type(Kind.LIST, item=union(kinds)), columns=())
        case "value":
            rows = union((kinds[0], NONE)) if kinds else NONE
        case "void":
            return NONE
        case _:
            return ANY
    if query.group and not query.aggregated:
        return Type(Kind.DICT)
    if query.search is not None:
        return Type(Kind.LIST, item=rows, columns=() if not rows.may(Kind.DICT) else None)
    return rows
