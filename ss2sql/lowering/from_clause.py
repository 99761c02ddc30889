"""FROM: sources as items of SQL, and calls that every step of a search makes, as columns of its list.

A list, a dict of columns or a single value is walked by the virtual table `elements`, or by one whose name
carries the columns of its elements; it takes the value as its argument, so a source that mentions an earlier
one or the search's state is a join from left to right. A query in FROM becomes part of the query around it
where its evaluation cannot be told apart, a derived table where it stands alone, else a value to walk.

A function that every step of a search calls is called once per step, and its value is a column of the list:

    SELECT move(this, tower) FROM moves             FROM search
    WHERE goal == move(this, tower)                 CROSS JOIN elements_with_move(:moves, search.tower) AS moves
    ... STOP WITH [] == move(this, tower)           WHERE NOT moves.move IS :p1 /* [] */ ...

The table of the last source, a list that is the same for all states, then calls the function with each of its elements.
Each clause reads the column where it would else call SQLite's function, which finds the value in the memory of calls:
the 8-puzzle takes 0.5 of its time so. Calls for the same state are remembered together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, assert_never

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, is_flag
from ss2sql.language.plan_traversal import (
    can_vary_with,
    has_query,
    list_columns_read,
    list_sources,
    list_states,
    reads_outside,
    walk,
)
from ss2sql.lowering import sql_builder
from ss2sql.lowering.guards import find_certain_parts, is_free
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import ROW_NUMBER, ElementCall, ListTable, choose_free_name, choose_sql_names
from ss2sql.lowering.sqlite_expressions import Reader, SqlScope
from ss2sql.lowering.statement_needs import add_sql_row_numbers, build_materialized_cte, sort_sql_by_row_number

if TYPE_CHECKING:
    from ss2sql.lowering.flat import FlatLowering


# --- calls that every step of a search makes, as columns of its list
def find_element_calls(query: plan.Query) -> tuple[plan.Call, ...]:
    """The calls that every step makes with an element of the last source, and with nothing else that it reads."""
    source = query.sources[-1]
    if not isinstance(source, plan.ValueSource) or list_sources(source.value) or list_states(source.value):
        return ()
    if isinstance(source.value, plan.Variable) and source.value.frame:
        return ()
    found: list[plan.Call] = []
    for expr in _iterate_step_expressions(query):
        if isinstance(expr, plan.Call) and _does_take_element(expr, source) and expr not in found:
            found.append(expr)
    # A function that is called with other arguments, too, has one memory of calls for all of them.
    calls = [node for node in walk(query) if isinstance(node, plan.Call)]
    return tuple(call for call in found if all(call == other for other in calls if other.function == call.function))


def _iterate_step_expressions(query: plan.Query) -> Iterator[plan.Expr]:
    """What is evaluated for each step that is generated, whatever the clauses before it say."""
    search = query.search
    assert search is not None
    if search.made is not None or search.first is not None:  # which come before all else
        yield from find_certain_parts(search.made if search.first is None else None)
        return
    clauses = list(find_certain_parts(search.stop, query.where))
    if search.repeats in ("unique", "no cycle") and search.by == "row":
        row = search.key or tuple(output.expr for output in query.columns)
        yield from find_certain_parts(*row)
        # Clauses are evaluated for new rows. A repeated row was evaluated where it has all that they read.
        clauses = [part for part in clauses if all(read in row for read in _iterate_element_arguments(part))]
    yield from clauses
    if search.stop is None and query.where is None:
        yield from find_certain_parts(*(output.expr for output in query.columns), *(e for _, e in search.connect))


def _iterate_element_arguments(part: plan.Expr) -> Iterator[plan.Expr]:
    """The arguments of a call that read the element or the state."""
    for argument in part.arguments if isinstance(part, plan.Call) else ():
        if list_sources(argument) or list_states(argument):
            yield argument


def _does_take_element(call: plan.Call, source: plan.ValueSource) -> bool:
    """Whether a call of the user's function takes parts of the element as they are, and has another argument."""
    function = call.function
    if function.builtin or function.vectorized or function.of_world:
        return False
    whole = [argument for argument in call.arguments if _does_read_element(argument, source)]
    others = [argument for argument in call.arguments if not _does_read_element(argument, source)]
    if not whole or not any(list_states(other) or list_sources(other) for other in others):
        return False
    return all(source.id not in list_sources(other) and not has_query(other) for other in others)


def _does_read_element(argument: plan.Expr, source: plan.ValueSource) -> bool:
    match argument:
        case plan.Element(source=number):
            return number == source.id
        case plan.Column(source=number, declared=declared):
            return number == source.id and declared
        case _:
            return False


def add_call_columns(
    selects: FlatLowering, query: plan.Query, calls: tuple[plan.Call, ...], item: Node, scope: SqlScope
) -> tuple[Node, SqlScope]:
    """The item of FROM for the last source with columns for these calls, and the sight in which they are known."""
    source = query.sources[-1]
    assert isinstance(source, plan.ValueSource)
    assert isinstance(item, exp.Table)
    columns = tuple(name for name, _ in source.columns or ())
    taken = {"this", *(name.lower() for name in choose_sql_names(columns).values())}
    shared: list[plan.Expr] = []
    made: list[ElementCall] = []
    for call in calls:
        arguments: list[str | int] = []
        for argument in call.arguments:
            if _does_read_element(argument, source):
                arguments.append(argument.name if isinstance(argument, plan.Column) else "this")
                continue
            if argument not in shared:
                shared.append(argument)
            arguments.append(shared.index(argument) + 1)
        selects.needs.name_function(call.function.name, call.place)
        made.append(ElementCall(choose_free_name(call.function.name, taken), call.function.name, tuple(arguments)))
    module = selects.needs.name_list_table(ListTable(columns, tuple(made)))
    assert module is not None  # a statement has one search, so no other table of this name
    selects.needs.applied["calls"] = None
    label = item.alias_or_name
    known = [
        (call, selects.expressions.unbox_value(sql_builder.column(column.name, label), call.type).copy)
        for call, column in zip(calls, made, strict=True)
    ]
    table = sql_builder.table_function(
        module,
        [*item.this.expressions, *(selects.expressions.lower_value(argument, scope) for argument in shared)],
        label,
    )
    return table, replace(scope, known=(*scope.known, *known))


# --- sources as items of FROM
@dataclass(frozen=True, slots=True)
class FromItem:
    """A source as SQL: the item of FROM, how it is read, and what sorts it in its own order (empty: nothing does).

    `witness` is some column of it; mentioning it keeps a condition from being evaluated before the source is read.
    `conditions` filter it, when it stems from a query; of one that is `merged` these are the sources, an item each.
    With `rows` it is the right side of a LEFT JOIN: ON reads its rows so, which are there.
    """

    items: tuple[Node, ...]
    reader: Reader
    order: tuple[Node, ...]
    witness_column: Node
    conditions: tuple[Node, ...] = ()
    rows: Reader | None = None
    merged: tuple[plan.Source, ...] = ()


def lower_sources(
    selects: FlatLowering, sources: tuple[plan.Source, ...], scope: SqlScope, search: int | None = None
) -> tuple[list[FromItem], SqlScope]:
    """All sources of a query, from left to right, each in the sight of those before it.

    `search` is the number of the query if its state may be mentioned.
    """
    siblings: set[int] = set()
    opened: list[FromItem] = []
    for source in sources:
        part = lower_source(selects, source, scope, siblings, search)
        scope = scope.with_source(source.id, part.reader)
        siblings.add(source.id)
        opened.append(part)
    return opened, scope


def lower_source(
    selects: FlatLowering, source: plan.Source, scope: SqlScope, siblings: set[int], search: int | None
) -> FromItem:
    match source:
        case plan.TableSource():
            return _lower_table(selects, source)
        case plan.ValueSource(value=value):
            lowered = selects.expressions.lower_value(value, scope)
            return _lower_function_source(selects, source, lowered) or _lower_list_elements(selects, source, lowered)
        case plan.QuerySource(optional=True):
            return _lower_left_join(selects, source, scope, siblings)
        case plan.QuerySource(query=query):
            ordered = len(query.sources) == 1 or not any(map(is_view, query.sources))
            merged = ordered and can_lower_into_join(query)
            if merged and not (search is None and _reads_only_outer_rows(query, siblings)):
                return _lower_joined_query(selects, source, scope, siblings, search)
            lateral = can_vary_with(query, siblings, search)
            whole = search is not None
            apart = not lateral and not (whole and reads_outside(query))
            if apart and query.representation.name == "dict" and (not query.group or query.aggregated):
                return _lower_derived_table(selects, source, scope, whole)
            return _lower_list_elements(
                selects, source, selects.lower_subquery(query, replace(scope, again=scope.again or lateral))
            )
        case plan.WorldSource():
            return _lower_world(selects, source, scope)
        case _:
            assert_never(source)


def is_view(source: plan.Source) -> bool:
    """Whether nothing sorts the rows of a table of the database."""
    return isinstance(source, plan.TableSource) and not source.order


def _lower_table(selects: FlatLowering, source: plan.TableSource) -> FromItem:
    label = selects.needs.choose_label(source.name)
    selects.tables[label] = source
    schema = None if source.schema == "main" and not sql_builder.can_need_sql_schema(source.table) else source.schema
    columns: dict[str, Node] = {name: sql_builder.column(name, label) for name, _ in source.columns}
    for name in source.collated:
        columns[name] = exp.Collate(this=columns[name], expression=exp.Var(this="BINARY"))

    def read_column(expr: plan.Element | plan.Column) -> Node:
        if isinstance(expr, plan.Column):
            return columns[expr.name].copy()
        return lower_record({name: node.copy() for name, node in columns.items()})

    order = tuple(sql_builder.column(name, label) for name in source.order)
    return FromItem((sql_builder.table(source.table, label, schema),), read_column, order, next(iter(columns.values())))


def _lower_function_source(selects: FlatLowering, source: plan.ValueSource, value: Node) -> FromItem | None:
    """A source that calls a function of the user once per row, such as `neighbours(node)`, as a table of its own."""
    call = source.value
    if not isinstance(call, plan.Call) or not isinstance(value, exp.Anonymous) or source.columns:
        return None
    function = call.function
    if function.builtin or function.vectorized or function.of_world or not (list_sources(call) or list_states(call)):
        return None
    module = selects.needs.name_list_table(ListTable((), function=function.name, arity=len(value.expressions)))
    return None if module is None else _lower_elements_walk(selects, source, module, value.expressions)


def _lower_list_elements(selects: FlatLowering, source: plan.ValueSource | plan.QuerySource, value: Node) -> FromItem:
    if isinstance(value, exp.Placeholder):
        selects.needs.walked[source.id] = value.name
    module = selects.needs.name_elements_table(tuple(name for name, _ in source.columns or ()))
    return _lower_elements_walk(selects, source, module, [value])


def _lower_elements_walk(
    selects: FlatLowering, source: plan.ValueSource | plan.QuerySource, module: str, arguments: list[Node]
) -> FromItem:
    """The elements that a virtual table walks for its arguments."""
    names = choose_sql_names(tuple(name for name, _ in source.columns or ()))
    label = selects.needs.choose_label(source.name)

    def read_element(expr: plan.Element | plan.Column) -> Node:
        this = sql_builder.column("this", label)
        if isinstance(expr, plan.Element):
            return selects.expressions.unbox_value(this, expr.type)
        if expr.declared:
            return selects.expressions.unbox_value(sql_builder.column(names[expr.name], label), expr.type)
        return selects.expressions.read_field(this, expr)

    item = sql_builder.table_function(module, arguments, label)
    # The elements of a data frame are made when they are read; its row numbers cost nothing.
    framed = isinstance(source, plan.ValueSource) and isinstance(source.value, plan.Variable) and source.value.frame
    witness = sql_builder.column("rowid" if framed else "this", label)
    return FromItem((item,), read_element, (sql_builder.column("rowid", label),), witness)


def _lower_world(selects: FlatLowering, source: plan.WorldSource, scope: SqlScope) -> FromItem:
    """A table of a world, or one of its table functions; it is walked in its own order."""
    label = selects.needs.choose_label(source.name)
    names = choose_sql_names(tuple(name for name, _ in source.columns))
    selects.needs.worlds[label] = source.table

    def read_column(expr: plan.Element | plan.Column) -> Node:
        return sql_builder.column("this" if isinstance(expr, plan.Element) else names[expr.name], label)

    item = sql_builder.table(source.table.module, label)
    if source.table.schema.parameters:
        arguments = [selects.expressions.lower_value(argument, scope) for argument in source.arguments]
        item = sql_builder.table_function(source.table.module, arguments, label)
    return FromItem(
        (item,), read_column, (sql_builder.column(ROW_NUMBER, label),), sql_builder.column(ROW_NUMBER, label)
    )


def lower_record(columns: dict[str, Node]) -> Node:
    arguments: list[Node] = []
    for name, node in columns.items():
        arguments += [sql_builder.string(name), node]
    return sql_builder.call("record", *arguments)


def can_lower_into_join(query: plan.Query) -> bool:
    """Whether a query in FROM may be merged with the one around it: nothing but a product, filters and columns."""
    plain = not (query.search or query.grouped or query.order or query.limit or query.having)
    if not plain or query.representation.name != "dict" or any(output.label for output in query.columns):
        return False
    inside = [source.value for source in query.sources if isinstance(source, plan.ValueSource)]
    inside += [output.expr for output in query.columns]
    return is_free(*inside, query.where) and not any(isinstance(one, plan.QuerySource) for one in query.sources)


def _reads_only_outer_rows(query: plan.Query, siblings: set[int]) -> bool:
    """Whether a column reads nothing but rows around: an aggregate over it would be one of the query around in SQL."""
    own = siblings | {source.id for source in query.sources}
    exprs = [output.expr for output in query.columns]
    return any((list_sources(expr) or list_states(expr)) and not list_sources(expr) & own for expr in exprs)


def _lower_joined_query(
    selects: FlatLowering, source: plan.QuerySource, scope: SqlScope, siblings: set[int], search: int | None
) -> FromItem:
    """The sources and conditions of a simple query, joined with those of the query around it."""
    query = source.query
    items: list[Node] = []
    order: list[Node] = []
    inner = scope
    for part in query.sources:
        opened = lower_source(selects, part, inner, siblings, search)
        inner = inner.with_source(part.id, opened.reader)
        items.extend(opened.items)
        order.extend(opened.order)
    conditions = selects.lower_where(query.where, inner)
    reader = make_sql_column_reader(
        selects, query, {o.name: selects.expressions.lower_expr(o.expr, inner) for o in query.columns}
    )
    witness = opened.witness_column
    return FromItem(tuple(items), reader, tuple(order), witness, tuple(conditions), merged=query.sources)


def _lower_query_elements(opened: FromItem, query: plan.Query) -> Reader:
    """Reads the elements of a query that are those of its only source."""
    source = query.sources[0]
    kinds = dict(source.columns or ())

    def read_output(expr: plan.Element | plan.Column) -> Node:
        if isinstance(expr, plan.Element):
            return opened.reader(replace(expr, source=source.id, type=query.columns[0].expr.type))
        known = expr.name in kinds
        return opened.reader(replace(expr, source=source.id, type=kinds.get(expr.name, ANY), declared=known))

    return read_output


def _lower_left_join(selects: FlatLowering, source: plan.QuerySource, scope: SqlScope, siblings: set[int]) -> FromItem:
    """The right side of a LEFT JOIN. A number of its rows is needed, which says whether there is one."""
    query = source.query
    (inner,) = query.sources
    rows = isinstance(inner, plan.QuerySource) and inner.query.representation.name == "dict"
    if isinstance(inner, plan.QuerySource) and rows and not can_vary_with(inner.query, siblings, None):
        part = _lower_derived_table(selects, inner, scope, False)
    else:
        part = lower_source(selects, inner, scope, siblings, None)
    if not part.order:
        part = lower_numbered_rows(part, inner)
        number = part.witness_column  # has it read from an index that SQLite makes on the rows
        kept = sort_sql_by_row_number(part.items[0].alias_or_name, number.name)
        part = replace(part, conditions=(*part.conditions, kept))
    plain, number = _lower_query_elements(part, query), part.order[-1]
    element, kinds = query.columns[0].expr.type, dict(inner.columns or ())

    def read_or_null(expr: plan.Element | plan.Column) -> Node:
        node = plain(expr)
        flag = is_flag(kinds.get(expr.name, ANY) if isinstance(expr, plan.Column) else element)
        if isinstance(node, exp.Column) and not flag:
            return node
        found = exp.Not(this=exp.Is(this=number.copy(), expression=sql_builder.null()))
        return sql_builder.case([(found, selects.expressions.box_flag(node) if flag else node)], sql_builder.null())

    return FromItem(part.items, read_or_null, part.order, part.witness_column, part.conditions, rows=part.reader)


def lower_numbered_rows(
    part: FromItem, source: plan.Source, query: plan.Query | None = None, where: Sequence[Node] = ()
) -> FromItem:
    """A view, or a query, with the numbers of its rows, by which a product can be sorted.

    Of a view only what the query reads: the columns, and the rows for which `where` holds. Its order may depend on it.
    """
    (item,) = part.items
    label = item.alias_or_name
    if not isinstance(item, exp.Subquery):
        kinds = dict(source.columns or ())
        names = tuple(kinds) if query is None else list_columns_read((query,), source.id, tuple(kinds))
        shown = names or tuple(kinds)[:1]
        read = [part.reader(plan.Column(source.id, name, kinds[name], span=source.span)) for name in shown]
        found = (column for node in (*read, *part.conditions) for column in node.find_all(exp.Column))
        known = {column.name: column.copy() for column in found if column.table == label}  # without collations
        rows = sql_builder.select(
            list(known.values()), [item], sql_builder.conjunction(where), (), sql_builder.build_sql_no_limit()
        )
        item = sql_builder.derived(rows, label)
    item.set("this", add_sql_row_numbers(item.this, label))
    number = sql_builder.column(item.this.expressions[0].alias, label)
    return replace(part, items=(item,), order=(number,), witness_column=number)


def _lower_derived_table(selects: FlatLowering, source: plan.QuerySource, scope: SqlScope, whole: bool) -> FromItem:
    """`(SELECT ... LIMIT -1) AS name`, which the limit keeps apart, and its order with it; or a table of WITH."""
    query, needs = source.query, selects.needs
    label = needs.choose_label(source.name)
    if whole:
        if source.id not in needs.materialized_ctes:  # a search opens its sources twice
            made = selects.lower_derived(query, scope)
            needs.materialized_ctes[source.id] = build_materialized_cte(
                needs.choose_table_name(f"{source.name}_once"), made
            )
        item: Node = sql_builder.table(needs.materialized_ctes[source.id].alias, label)
    else:
        item = sql_builder.derived(selects.lower_derived(query, scope), label)
    names = choose_sql_names(tuple(output.name for output in query.columns))
    columns: dict[str, Node] = {name: sql_builder.column(short, label) for name, short in names.items()}
    return FromItem((item,), make_sql_column_reader(selects, query, columns), (), next(iter(columns.values())))


def make_sql_column_reader(selects: FlatLowering, query: plan.Query, columns: dict[str, Node]) -> Reader:
    """Reads the rows of a query by the columns that its outputs have become."""
    types = {output.name: output.expr.type for output in query.columns}

    def read_column(expr: plan.Element | plan.Column) -> Node:
        if isinstance(expr, plan.Column):
            return columns[expr.name].copy()
        boxed = {
            name: selects.expressions.box_flag(node.copy()) if is_flag(types[name]) else node.copy()
            for name, node in columns.items()
        }
        return lower_record(boxed)

    return read_column
