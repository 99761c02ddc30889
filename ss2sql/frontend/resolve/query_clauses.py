"""Queries: their clauses, and the hidden columns that a representation needs beside those of SELECT.

`SELECT mass FROM space AS plane(...)` needs the bodies' positions, `SELECT mass FROM space AS prolog` the bodies
themselves, `SELECT to(mass, name(this)) FROM space AS dict` the name in each row. Such columns follow those of SELECT,
and only the representation sees them.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from ss2sql.errors import ResolveError, Span, suggest_names, suggest_similar
from ss2sql.frontend.resolve.from_clause import resolve_sources, resolve_value_source
from ss2sql.frontend.resolve.grouping import resolve_groups
from ss2sql.frontend.resolve.resolver import resolve_as_list
from ss2sql.frontend.resolve.scope import (
    Scope,
    is_function_of_this,
    is_name_resolution_final,
    resolve_source_column,
    resolve_this,
)
from ss2sql.frontend.resolve.search_clauses import (
    add_path_variables,
    infer_state_types,
    resolve_outside,
    resolve_search_options,
    resolve_without_path,
)
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.tokenizer import shorten_text
from ss2sql.frontend.syntax.tree_builder import VALUED_OPTIONS
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, NONE, Kind, Type, limit_type_depth, make_list_type, unite
from ss2sql.language.operations import OPERATOR_FUNCTIONS
from ss2sql.language.plan_traversal import is_volatile, join_conditions, list_sources, list_states, split_and, walk
from ss2sql.language.rows import make_unique_column_names

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


# --- hidden columns: those that a representation needs beside SELECT's


def add_hidden_columns(resolver: Resolver, query: plan.Query) -> plan.Query:
    """The query with its representation's columns. Rows of searches and groups belong to no single element."""
    query = _resolve_labels(resolver, query)
    form = query.representation
    wanted = resolver.catalog.hidden_columns.get(form.name)
    if wanted is None or (query.search and not query.last) or query.aggregated or not query.sources:
        return query
    hidden: list[plan.Expr] = []
    facts: tuple[plan.FactColumn, ...] = ()
    if wanted == "elements":
        hidden.extend(_find_selected_element(query))
    else:
        facts = tuple(_resolve_hidden_fact(output, query.sources, hidden) for output in query.columns)
    word = wanted.removesuffix("s").replace("call", "argument")
    columns = (*query.columns, *(plan.Output(f"{word} {n}", expr) for n, expr in enumerate(hidden, 1)))
    return replace(query, columns=columns, representation=replace(form, hidden=len(hidden), facts=facts))


def _resolve_labels(resolver: Resolver, query: plan.Query) -> plan.Query:
    """The query with the names that `to` gives to columns row by row, which `AS dict` alone shows.

    UNIQUE and NO CYCLE ignore them: `to(this, "step" + str(level))` repeats where `this` does.
    """
    own = {source.id for source in query.sources}
    named: dict[int, plan.Expr] = {}
    for place, output in enumerate(query.columns):
        label = output.label
        if label is not None and (list_sources(label) & own or query.id in {one for one, _ in list_states(label)}):
            named[place] = label
    if not named:
        return query
    if query.aggregated:
        message = "with GROUP BY or DISTINCT a column has one name"
        span = next(iter(named.values())).span
        resolver.refuse("R014", message, span, "show it in a column of its own")
    columns = [replace(output, label=None) if n in named else output for n, output in enumerate(query.columns)]
    search, form = query.search, query.representation
    if form.name == "dict":
        if search is not None and search.repeats != "allowed" and not search.key:
            search = replace(search, key=tuple(output.expr for output in columns))
        columns += [plan.Output(f"name {place}", label) for place, label in named.items()]
        form = replace(form, hidden=len(named), labels=tuple(named))
    return replace(query, columns=tuple(columns), search=search, representation=form)


def _resolve_hidden_elements(sources: tuple[plan.Source, ...]) -> list[plan.Expr]:
    """The elements of sources, where these are more than rows of columns."""
    found = [resolve_this(source, source.span) for source in sources if not isinstance(source, plan.TableSource)]
    return [element for element in found if element.type.kinds != Kind.DICT]


def _find_selected_element(query: plan.Query) -> list[plan.Expr]:
    """The element whose body or place a row has: that of the source which the columns read.

    Where they read several, or none, it is the one that can only be a body; nothing where that leaves a choice.
    """
    read = {source for output in query.columns for source in list_sources(output.expr)}
    found = _resolve_hidden_elements(query.sources)
    if len(found) > 1:
        found = [each for each in found if each.type.may_be(Kind.OBJECT | Kind.LIST)]
        found = [each for each in found if list_sources(each) & read] or found
    if len(found) > 1:
        found = [each for each in found if each.type.kinds == Kind.OBJECT]
    return found if len(found) == 1 else []


def _resolve_hidden_fact(
    output: plan.Output, sources: tuple[plan.Source, ...], hidden: list[plan.Expr]
) -> plan.FactColumn:
    """A column as a fact; the fact's arguments are added to the hidden columns, each once."""
    name, arguments, valued = "", _resolve_hidden_elements(sources), True
    match output.expr:
        case plan.Element() as element:
            arguments, valued = [element], False
        case plan.Column(source=number, name=word):
            name, arguments = word, _resolve_hidden_elements(tuple(source for source in sources if source.id == number))
        case plan.Call(function=function, arguments=given) if function.name not in OPERATOR_FUNCTIONS and not any(
            map(is_volatile, given)
        ):
            word = function.name.removeprefix("world_").rpartition(".")[2]
            name, arguments = word, list(given)
    if not re.fullmatch(rf"{re.escape(name)}(_\d+)?", output.name):
        name = ""  # `to` has given the column a name of its own
    for argument in arguments:
        if argument not in hidden:
            hidden.append(argument)
    return plan.FactColumn(name, tuple(map(hidden.index, arguments)), valued)


# --- queries: sources, search, columns and groups, resolved in the order in which clauses see each other
SYNONYMS = {"val": "value"}


def resolve_query(resolver: Resolver, tree: ast.Query, outer: Scope | None) -> plan.Subquery:
    """The plan of a query; errors of its clauses are collected."""
    scope = Scope(outer, resolver.make_number(), written=tree)
    scope.shown = {name: expr.span.text for name, expr in map(_split_column_name, tree.columns) if name and expr}
    search, joins = _resolve_search(resolver, tree, scope, outer)
    sources = tuple(scope.sources)
    where = _resolve_optional(resolver, tree.where, scope, "WHERE")
    where = _resolve_conditions(joins, where) if search is None else where
    scope.enter_clause("GROUP BY")
    group = _resolve_group(resolver, tree, scope)
    counted = ast.is_row_count_syntax(tree.columns)
    scope.grouped = bool(group) or counted
    scope.enter_clause("SELECT")
    columns = _resolve_columns(resolver, tree, scope)
    scope.columns = _resolve_column_names(resolver, tree, columns)
    scope.enter_clause("ORDER BY")
    order = tuple(_resolve_order_key(resolver, tree, key, scope, columns) for key in tree.order)
    having = _resolve_optional(resolver, tree.having, scope, "HAVING")
    if having is not None and tree.having is not None:
        _check_clause_once(resolver, having, tree.having, scope, "HAVING")
    if tree.distinct:
        _check_distinct(resolver, tree)
        if not tree.group and not counted and (search is None or tree.last):
            group = tuple(output.expr for output in columns)
    query = plan.Query(
        scope.query,
        sources,
        columns,
        where,
        search,
        group,
        having,
        counted,
        order,
        None if tree.limit is None else resolve_outside(resolver, tree.limit, outer, "LIMIT"),
        None if tree.offset is None else resolve_outside(resolver, tree.offset, outer, "OFFSET"),
        _resolve_representation(resolver, tree.representation, outer),
        distinct=tree.distinct and not counted,
        last=tree.last,
        span=tree.span,
    )
    if search is not None:
        query = resolve_without_path(resolver, tree, query)
    if query.grouped:
        query = resolve_groups(resolver, query)
    query = add_hidden_columns(resolver, query)
    return plan.Subquery(query, infer_value_type(query), span=tree.span)


def _check_distinct(resolver: Resolver, tree: ast.Query) -> None:
    """Refuses DISTINCT beside GROUP BY."""
    if tree.group:
        message = "DISTINCT and GROUP BY do not go together"
        hint = "leave DISTINCT out, or put the query with GROUP BY into FROM: SELECT DISTINCT * FROM (SELECT ...)"
        resolver.refuse("R014", message, tree.group[0].span, hint)


def _resolve_optional(resolver: Resolver, tree: ast.Expr | None, scope: Scope, clause: str) -> plan.Expr | None:
    scope.enter_clause(clause)
    return None if tree is None else resolver.record_errors(resolver.resolve_expr, tree, scope)


# --- the search ----------------------------------------------------------------------------------------


def _resolve_conditions(joins: tuple[plan.Expr, ...], condition: plan.Expr | None) -> plan.Expr | None:
    """The conditions of JOIN, then that of WHERE, or of CONNECT BY in a search."""
    parts = (*joins, *split_and(condition))
    return join_conditions(plan.And, parts, parts[-1].span) if joins else condition


def _resolve_search(
    resolver: Resolver, tree: ast.Query, scope: Scope, outer: Scope | None
) -> tuple[plan.Search | None, tuple[plan.Expr, ...]]:
    """Opens the sources and, where there is CONNECT BY, resolves the hierarchical clauses.

    Also gives the conditions of JOIN, which a search has in its own.
    """
    if not tree.searches:
        _refuse_without_search(resolver, tree)
        return None, resolve_sources(resolver, tree, scope)
    tree, scope.path_functions = add_path_variables(resolver, tree)
    scope.enter_clause("START WITH")
    start, each = _resolve_start(resolver, tree, scope)
    unset = _report_unset_states(tree, scope)
    scope.enter_clause("FROM")
    infer_state_types(resolver, tree, scope, dict(start))
    joins = resolve_sources(resolver, tree, scope)
    resolver.errors.extend(_make_clause_error(assign, tree, scope) for assign in unset)
    _check_hidden_columns(resolver, tree, scope)
    scope.enter_clause("CONNECT BY")
    connect = tuple((a.name, resolver.record_errors(resolver.resolve_expr, a.value, scope)) for a in tree.connect)
    search = plan.Search(start, connect, None, states=tuple(scope.states.items()), each=each)
    scope.path_functions.sources, scope.path_functions.search = tuple(scope.sources), search
    made = _resolve_conditions(joins, _resolve_optional(resolver, tree.made, scope, "the condition of CONNECT BY"))
    first = _resolve_optional(resolver, tree.first, scope, "the condition of START WITH")
    first = None if first is None else _resolve_conditions(joins, first)
    stop = _resolve_optional(resolver, tree.stop, scope, "STOP WITH")
    scope.path_functions.search = search = replace(search, made=made, first=first, stop=stop)
    scope.path_functions.search = search = resolve_search_options(resolver, tree, scope, outer, search)
    scope.enter_clause("ORDER SIBLINGS BY")
    keys = (plan.OrderKey(_resolve_sort_key(resolver, key.expr, scope), key.descending) for key in tree.siblings)
    return replace(search, siblings=tuple(keys)), joins


def _refuse_without_search(resolver: Resolver, tree: ast.Query) -> None:
    parts = (("START WITH", (*tree.start, tree.first)), ("STOP WITH", (tree.stop,)))
    for clause, parts_of_clause in (*parts, ("ORDER SIBLINGS BY", tuple(key.expr for key in tree.siblings))):
        place = next((part.span for part in parts_of_clause if part is not None), None)
        if place is not None:
            hint = "add CONNECT BY with a condition, or with name = expr"
            resolver.refuse("R012", f"{clause} needs CONNECT BY", place, hint)
    if tree.last:
        hint = "leave LAST out: a query without CONNECT BY gives rows anyway"
        message = "SELECT LAST shows the last step of a path, and this query is no search"
        resolver.refuse("R012", message, tree.span, hint)


def _resolve_start(
    resolver: Resolver, tree: ast.Query, scope: Scope
) -> tuple[tuple[tuple[str, plan.Expr], ...], tuple[plan.ValueSource, ...]]:
    """The START WITH variables with their first values, and the lists that EACH walks."""
    start: list[tuple[str, plan.Expr]] = []
    each: list[plan.ValueSource] = []
    for item in tree.start:
        if item.name in scope.states:
            message = f"START WITH sets '{item.name}' twice"
            resolver.refuse("R013", message, item.name_span, "keep one of them")
        tree_of_value = resolve_as_list(item.values) if isinstance(item, ast.Each) else item.value
        (value,) = resolver.resolve_operands((tree_of_value,), scope)
        if isinstance(item, ast.Each):
            source = resolve_value_source(resolver, item.name, value, item.span)
            each.append(source)
            value = resolve_this(source, item.name_span)
        start.append((item.name, value))
        scope.states[item.name] = value.type
    return tuple(start), tuple(each)


def _report_unset_states(tree: ast.Query, scope: Scope) -> list[ast.Assign]:
    """Reports what CONNECT BY assigns and START WITH does not; other clauses may then mention it."""
    known = {item.name for item in tree.start}
    unset = [assign for assign in tree.connect if assign.name not in known]
    scope.states.update((assign.name, ANY) for assign in unset)
    return unset


def _make_clause_error(assign: ast.Assign, tree: ast.Query, scope: Scope) -> ResolveError:
    """The error for such an assignment, perhaps meant as a comparison."""
    name = assign.name
    message = f"CONNECT BY sets '{name}', which START WITH does not"
    value = shorten_text(assign.value.span.text)
    known = [item.name for item in tree.start if item.name.isidentifier()]
    hints = suggest_names(name, known)
    if not suggest_similar(name, known):
        begun = [item.span.text for item in tree.start if item.name in known]
        begun += [] if tree.first is None else [tree.first.span.text]
        hints += (f"write START WITH {', '.join([*begun, f'{name} = None'])}, or another first value",)
    if name.upper() in VALUED_OPTIONS:
        hints = (f"write {name.upper()} {value}", "an option stands in front of the assignments, and takes no =")
    for part in tree.first.parts if isinstance(tree.first, ast.And) else (tree.first,):
        match part:
            case ast.Operator(function="eq" | "in" as test, operands=(ast.Name(name=tested), first)) if tested == name:
                start = f"{name} = " if test == "eq" else f"EACH {name} IN "
                hints = (f"write START WITH {start}{shorten_text(first.span.text)}",)
    if any(name == column for source in scope.sources for column, _ in source.columns or ()):
        hints = (f"write {name} == {value} to compare",)
    return ResolveError("R001", message, assign.name_span, hints)


def _check_hidden_columns(resolver: Resolver, tree: ast.Query, scope: Scope) -> None:
    """Refuses a constant variable that hides a column: it was meant as a comparison."""
    assigned = {assign.name for assign in tree.connect}
    for item in tree.start:
        owner = next((s for s in scope.sources if any(name == item.name for name, _ in s.columns or ())), None)
        if item.name in assigned or owner is None:
            continue
        value = item.values if isinstance(item, ast.Each) else item.value
        sign = "IN" if isinstance(item, ast.Each) else "=="
        message = f"START WITH sets '{item.name}', which is a column of '{owner.name}', and CONNECT BY never changes it"
        hint = f"write START WITH {item.name} {sign} {shorten_text(value.span.text)} to choose the first steps"
        resolver.refuse("R013", message, item.name_span, hint, "or give the variable another name")


def _resolve_group(resolver: Resolver, tree: ast.Query, scope: Scope) -> tuple[plan.Expr, ...]:
    """The values of GROUP BY, which may be columns of SELECT by their names."""
    named = {name: expr for name, expr in map(_split_column_name, reversed(tree.columns)) if name and expr}

    def resolve_output(name: str) -> plan.Expr | None:
        if name not in named:
            return None
        scope.later = None  # it does not mean itself
        try:
            return _resolve_sort_key(resolver, named[name], scope)
        finally:
            scope.later = resolve_output

    scope.later = resolve_output
    group = tuple(_resolve_sort_key(resolver, key, scope) for key in tree.group)
    scope.later = None
    return group


# --- columns and keys ----------------------------------------------------------------------------------


def _resolve_columns(resolver: Resolver, tree: ast.Query, scope: Scope) -> tuple[plan.Output, ...]:
    outputs: list[plan.Output] = []
    for column in tree.columns:
        match column:
            case ast.Star():
                outputs.extend(_expand_star(resolver, scope, column.span))
            case ast.Call(function="to", arguments=(value, label)) if resolver.catalog.functions["to"].builtin:
                outputs.append(_resolve_labelled_column(resolver, value, label, scope))
            case ast.Named(expr=value, name=name):
                outputs.append(plan.Output(name, _resolve_sort_key(resolver, value, scope)))
            case _:
                outputs.append(plan.Output(_derive_column_name(column), _resolve_sort_key(resolver, column, scope)))
    if any(output.label for output in outputs):
        return tuple(outputs)  # names that are complete only when the query runs are made unique then
    names = make_unique_column_names(output.name for output in outputs)
    return tuple(replace(output, name=name) for output, name in zip(outputs, names, strict=True))


def _split_column_name(column: ast.Expr | ast.Named | ast.Star) -> tuple[str | None, ast.Expr | None]:
    """The name that `to` or AS gives to a column, and the column."""
    match column:
        case ast.Named(expr=expr, name=name):
            return name, expr
        case ast.Call(function="to", arguments=(expr, ast.Name(name=name) | ast.Literal(value=str(name)))):
            return name, expr
        case _:
            return None, None


def _resolve_column_names(
    resolver: Resolver, tree: ast.Query, columns: tuple[plan.Output, ...]
) -> dict[str, plan.Expr]:
    """The columns of SELECT by the names that `to` or AS gives them."""
    builtin = resolver.catalog.functions["to"].builtin
    found: dict[str, plan.Expr] = {}
    if not any(isinstance(column, ast.Star) for column in tree.columns):
        for column, output in zip(tree.columns, columns, strict=True):
            name, _ = _split_column_name(column)
            if name is not None and (builtin or isinstance(column, ast.Named)):
                found.setdefault(name, output.expr)
    return found


def _expand_star(resolver: Resolver, scope: Scope, span: Span) -> list[plan.Output]:
    outputs: list[plan.Output] = []
    if not is_name_resolution_final(Scope(None, scope.query, scope.sources), None):
        resolver.tentative = True
    for source in scope.sources:
        if source.columns:
            outputs.extend(plan.Output(name, resolve_source_column(source, name, span)) for name, _ in source.columns)
        else:
            outputs.append(plan.Output(source.name, resolve_this(source, span), star=source.columns is None))
    return outputs


def _resolve_labelled_column(resolver: Resolver, value: ast.Expr, label: ast.Expr, scope: Scope) -> plan.Output:
    expr = _resolve_sort_key(resolver, value, scope)
    match label:
        case ast.Name(name=name) | ast.Literal(value=str(name)):
            return plan.Output(name, expr)
        case _:
            text = resolver.record_errors(resolver.resolve_expr, label, scope)
            return plan.Output(_derive_column_name(value), expr, text)


def _derive_column_name(tree: ast.Expr) -> str:
    match tree:
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case ast.This(source=None):
            return "this"
        case ast.This(source=str(source)):
            return source
        case ast.Index(index=ast.Literal(value=str(name))) if not tree.span.text.endswith("]"):
            return name  # address.city
        case _:
            return tree.span.text


def _resolve_sort_key(resolver: Resolver, tree: ast.Expr, scope: Scope) -> plan.Expr:
    """A SELECT column, GROUP BY or ORDER BY key: a bare function name is applied to `this`."""
    if isinstance(tree, ast.Name) and is_function_of_this(resolver, tree.name, scope):
        try:
            found = resolver.find_bound(tree.name, scope, tree.span) or resolver.find_variable(tree.name, tree.span)
        except ResolveError as error:
            resolver.errors.append(error)
            return plan.Constant(None, ANY, span=tree.span)
        if found is None:
            tree = ast.Call(tree.name, (ast.This(None, span=tree.span),), span=tree.span)
    return resolver.record_errors(resolver.resolve_expr, tree, scope)


def _resolve_order_key(
    resolver: Resolver, tree: ast.Query, written: ast.OrderKey, scope: Scope, columns: tuple[plan.Output, ...]
) -> plan.OrderKey:
    """A key of ORDER BY. Refuses a literal, which SQL takes for the number of a column."""
    key = written.expr
    if isinstance(key, ast.Literal):
        shown = [_split_column_name(column)[0] or column.span.text for column in tree.columns]
        known = list(dict.fromkeys(name for source in scope.sources for name, _ in source.columns or ()))
        number = key.value if type(key.value) is int else 0
        if any(isinstance(column, ast.Star) for column in tree.columns):
            shown = known
        meant = shown[number - 1] if 0 < number <= len(shown) else key.value
        if meant in (*shown, *known):
            hint = f"write ORDER BY {meant}"
        else:
            hint = f"write what to order by, such as {', '.join(known or shown or ['this'])}"
        text = key.span.text
        message = f"ORDER BY {text} orders nothing: {text} is the same for every row"
        resolver.refuse("R014", message, key.span, hint)
    expr = _resolve_sort_key(resolver, key, scope)
    place = next((index for index, output in enumerate(columns) if output.expr is expr), None)
    if place is None or tree.searches:
        _check_clause_once(resolver, expr, key, scope, "ORDER BY")
    return plan.OrderKey(expr, written.descending, place)


def _check_clause_once(resolver: Resolver, expr: plan.Expr, tree: ast.Expr, scope: Scope, clause: str) -> None:
    """Refuses the name of a column whose value would differ when it is computed again."""
    for name, column in scope.columns.items():
        if is_volatile(column) and any(node is column for node in walk(expr)):
            message = f"{clause} would compute '{name}' once more, and it may be another value then"
            hint = (
                f"put the query into FROM: SELECT * FROM (SELECT ...) {clause if clause != 'HAVING' else 'WHERE'} ..."
            )
            resolver.refuse("R014", message, tree.span, hint)


# --- representation ------------------------------------------------------------------------------------


def _resolve_representation(
    resolver: Resolver, tree: ast.Representation | None, outer: Scope | None
) -> plan.Representation:
    if tree is None:
        return plan.Representation("dict")
    name = SYNONYMS.get(tree.name.lower(), tree.name.lower())
    known = {word.lower() for word in resolver.catalog.representations}
    if name not in known:
        hints = suggest_names(name, known) if suggest_similar(name, known) else ()
        hints = hints or (
            f"the forms are {', '.join(sorted(known))}; session.representation registers others",
            f"to name a source write FROM {tree.name} = ...",
        )
        resolver.errors.append(ResolveError("R006", f"unknown representation '{tree.name}'", tree.span, hints))
    arguments = resolver.resolve_all(tree.arguments, outer)
    named = tuple((a.name, resolver.record_errors(resolver.resolve_expr, a.value, outer)) for a in tree.named)
    return plan.Representation(name, arguments, named, tree.span)


def infer_value_type(query: plan.Query) -> Type:
    """The type of the query's value, for representations of the language."""
    kinds = [limit_type_depth(output.expr.type) for output in query.columns]
    if query.representation.labels or any(output.label for output in query.columns):
        return ANY
    match query.representation.name:
        case "dict":
            columns = tuple((output.name, kind) for output, kind in zip(query.columns, kinds, strict=True))
            rows = Type(Kind.LIST, element=Type(Kind.DICT, columns=columns), columns=columns)
        case "list" | "set":
            rows = replace(make_list_type(kinds), positions=None)  # for any number of rows
        case "rows":
            rows = Type(Kind.LIST, element=make_list_type(kinds), columns=())
        case "value":
            cut = query.search or query.group or query.having or query.limit or query.offset
            one = query.aggregated and not cut  # one group, even without rows
            rows = unite((kinds[0],) if one else (kinds[0], NONE)) if kinds else NONE
        case "void":
            return NONE
        case _:
            return ANY
    if query.group and not query.aggregated:
        return Type(Kind.DICT)
    if query.gives_paths:
        return Type(Kind.LIST, element=rows, columns=() if not rows.may_be(Kind.DICT) else None)
    return rows
