"""`calls`: a function that every step of a search calls is called once per step, and its value is a column of the list.

    SELECT move(this, tower) FROM moves             FROM search
    WHERE goal == move(this, tower)                 CROSS JOIN elements_with_move(:moves, search.tower) AS moves
    ... STOP WITH [] == move(this, tower)           WHERE NOT moves.move IS :p1 /* [] */ ...

The table of the last source, a list that is the same for all states, then calls the function with each of its elements.
Each clause reads the column where it would else call SQLite's function, which finds the value in the memory of calls:
the 8-puzzle takes 0.5 of its time so. Calls for the same state are remembered together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.plan_traversal import has_query, list_sources, list_states, walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.search_step import find_certain_parts
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_names import choose_free_name, choose_sql_names
from ss2sql.lowering.sql_query import ElementCall, ListTable
from ss2sql.lowering.sqlite_expressions import SqlScope

if TYPE_CHECKING:
    from ss2sql.lowering.flat import FlatLowering


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
    clauses = [*find_certain_parts(search.stop), *find_certain_parts(query.where)]
    if search.repeats in ("unique", "no cycle") and search.by == "row":
        row = search.key or tuple(output.expr for output in query.columns)
        yield from (part for expr in row for part in find_certain_parts(expr))
        # Clauses are evaluated for new rows. A repeated row was evaluated where it has all that they read.
        clauses = [part for part in clauses if all(read in row for read in _iterate_element_arguments(part))]
    yield from clauses
    if search.stop is None and query.where is None:
        for output in query.columns:
            yield from find_certain_parts(output.expr)
        for _, expr in search.connect:
            yield from find_certain_parts(expr)


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
            match argument:
                case plan.Column(name=name) if _does_read_element(argument, source):
                    arguments.append(name)
                case plan.Element() if _does_read_element(argument, source):
                    arguments.append("this")
                case _:
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
        (call, selects.expressions.unbox_value(sql_builder.column(column.name, label), call.type))
        for call, column in zip(calls, made, strict=True)
    ]
    table = sql_builder.table_function(
        module,
        [*item.this.expressions, *(selects.expressions.lower_value(argument, scope) for argument in shared)],
        label,
    )
    return table, replace(scope, known=(*scope.known, *known))
