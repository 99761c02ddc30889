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

from ss2sql import plan
from ss2sql.lowering import sql
from ss2sql.lowering.entering_step import certain
from ss2sql.lowering.expressions import Env
from ss2sql.lowering.names import free_name, sql_names
from ss2sql.lowering.sql import Node
from ss2sql.lowering.sql_query import ElementCall, ListTable
from ss2sql.walk import has_query, sources_read, states_read, walk

if TYPE_CHECKING:
    from ss2sql.lowering.select import Selects


def element_calls(query: plan.Query) -> tuple[plan.Call, ...]:
    """The calls that every step makes with an element of the last source, and with nothing else that it reads."""
    source = query.sources[-1]
    if not isinstance(source, plan.ValueSource) or sources_read(source.value) or states_read(source.value):
        return ()
    if isinstance(source.value, plan.Variable) and source.value.frame:
        return ()
    found: list[plan.Call] = []
    for expr in _asked_of_every_step(query):
        if isinstance(expr, plan.Call) and _is_of_element(expr, source) and expr not in found:
            found.append(expr)
    # A function that is called with other arguments, too, has one memory of calls for all of them.
    calls = [node for node in walk(query) if isinstance(node, plan.Call)]
    return tuple(call for call in found if all(call == other for other in calls if other.function == call.function))


def _asked_of_every_step(query: plan.Query) -> Iterator[plan.Expr]:
    """What is evaluated for each step that is generated, whatever the clauses before it say."""
    search = query.search
    assert search is not None
    if search.made is not None or search.first is not None:  # which come before all else
        yield from certain(search.made if search.first is None else None)
        return
    clauses = [*certain(search.stop), *certain(query.where)]
    if search.repeats in ("unique", "no cycle") and search.by == "row":
        row = search.key or tuple(output.expr for output in query.columns)
        yield from (part for expr in row for part in certain(expr))
        # The clauses are asked of rows that are new. A row that repeats has been asked where it says what they read.
        clauses = [part for part in clauses if all(read in row for read in _arguments_read(part))]
    yield from clauses
    if search.stop is None and query.where is None:
        for output in query.columns:
            yield from certain(output.expr)
        for _, expr in search.connect:
            yield from certain(expr)


def _arguments_read(part: plan.Expr) -> Iterator[plan.Expr]:
    """The arguments of a call that read the element or the state."""
    for argument in part.arguments if isinstance(part, plan.Call) else ():
        if sources_read(argument) or states_read(argument):
            yield argument


def _is_of_element(call: plan.Call, source: plan.ValueSource) -> bool:
    """Whether a call of the user's function takes parts of the element as they are, and has another argument."""
    function = call.function
    if function.builtin or function.vectorized or function.of_world:
        return False
    whole = [argument for argument in call.arguments if _is_read(argument, source)]
    others = [argument for argument in call.arguments if not _is_read(argument, source)]
    if not whole or not any(states_read(other) or sources_read(other) for other in others):
        return False
    return all(source.id not in sources_read(other) and not has_query(other) for other in others)


def _is_read(argument: plan.Expr, source: plan.ValueSource) -> bool:
    match argument:
        case plan.Element(source=number):
            return number == source.id
        case plan.Column(source=number, declared=declared):
            return number == source.id and declared
        case _:
            return False


def with_calls(
    selects: Selects, query: plan.Query, calls: tuple[plan.Call, ...], item: Node, env: Env
) -> tuple[Node, Env]:
    """The item of FROM for the last source with columns for these calls, and the sight in which they are known."""
    source = query.sources[-1]
    assert isinstance(source, plan.ValueSource)
    assert isinstance(item, exp.Table)
    columns = tuple(name for name, _ in source.columns or ())
    taken = {"this", *(name.lower() for name in sql_names(columns).values())}
    given: list[plan.Expr] = []
    made: list[ElementCall] = []
    for call in calls:
        arguments: list[str | int] = []
        for argument in call.arguments:
            match argument:
                case plan.Column(name=name) if _is_read(argument, source):
                    arguments.append(name)
                case plan.Element() if _is_read(argument, source):
                    arguments.append("this")
                case _:
                    if argument not in given:
                        given.append(argument)
                    arguments.append(given.index(argument) + 1)
        selects.needs.function(call.function.name, call.place)
        made.append(ElementCall(free_name(call.function.name, taken), call.function.name, tuple(arguments)))
    module = selects.needs.list_table(ListTable(columns, tuple(made)))
    if module is None:
        return item, env
    selects.needs.applied["calls"] = None
    label = item.alias_or_name
    known = [
        (call, selects.expressions.unboxed(sql.column(column.name, label), call.type))
        for call, column in zip(calls, made, strict=True)
    ]
    table = sql.table_function(
        module, [*item.this.expressions, *(selects.expressions.value(argument, env) for argument in given)], label
    )
    return table, replace(env, known=(*env.known, *known))
