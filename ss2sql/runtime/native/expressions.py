"""Expressions as Python expressions.

Values in generated code are plain values of the language; nobody changes them, so they are shared. Python's
own operators stand in where types prove that they do what the language says, else the operator's function is
called.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeGuard, assert_never

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.runtime.element_columns import column_of
from ss2sql.runtime.native.call_code import is_remembered, remembered_call
from ss2sql.runtime.native.endings import aggregate_of
from ss2sql.runtime.native.facts import OWN_GROUP
from ss2sql.runtime.native.forms import inlined
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.native.worlds import column_reader, element_reader
from ss2sql.runtime.run import Run
from ss2sql.runtime.sizes import FEW
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

PLAIN = Kind.NONE | Kind.NUMBER | Kind.STR  # values that stand for themselves where values are compared

_MEMBERSHIP: dict[str, type[ast.cmpop]] = {"in": ast.In, "not_in": ast.NotIn}


def expression(builder: Builder, node: plan.Expr, body: Body) -> ast.expr:
    """The Python expression with the node's value, to be evaluated in the innermost open loop of `body`."""
    facts, pen = builder.unit.analysis.of(node), builder.unit.pen_at(node.span)
    name = body.name_of(facts)
    if name is not None:
        return pen.name(name)
    value = _computed(builder, node, body, pen)
    if isinstance(node, (plan.Column, plan.MakeList, plan.Aggregate)) or _is_builtin(node):
        return body.named(facts, value, pen, _hint(node)) if facts.steady else value
    return value


def _is_builtin(node: plan.Expr) -> TypeGuard[plan.Call]:
    return isinstance(node, plan.Call) and node.function.builtin


def _hint(node: plan.Column | plan.MakeList | plan.Aggregate | plan.Call) -> str:
    match node:
        case plan.Aggregate(function=name):
            return name
        case plan.Column(name=name):
            return name
        case plan.Call(function=function):
            return function.name
        case _:
            return "list"


def _computed(builder: Builder, node: plan.Expr, body: Body, pen: Pen) -> ast.expr:
    """The expression, whose value has no name yet."""
    unit = builder.unit

    def build(part: plan.Expr) -> ast.expr:
        return expression(builder, part, body)

    def build_maybe(parts: Sequence[plan.Expr]) -> list[ast.expr]:
        with body.unsure():
            return [build(part) for part in parts]

    match node:
        case plan.Constant(value=value):
            return _constant(builder, value, pen)
        case plan.Variable(name=name, frame=frame):
            return unit.frame(name, pen) if frame else unit.variable(name, pen)
        case plan.Element(source=source):
            return element(body, source, pen)
        case plan.Column():
            return _column(body, node, pen)
        case plan.State(query=query, name=name):
            return pen.name(body.moved.get((query, name)) or unit.states[query, name])
        case plan.Call():
            return _call(builder, node, body)
        case plan.And(parts=parts) | plan.Or(parts=parts):
            operator = ast.And() if isinstance(node, plan.And) else ast.Or()
            tested = pen.both(operator, [build(parts[0]), *build_maybe(parts[1:])])
            return tested if all(part.type.only(Kind.BOOL) for part in parts) else pen.truth(tested)
        case plan.Xor(left=left, right=right):
            return pen.compare(pen.negation(build(left)), ast.NotEq(), pen.negation(build(right)))
        case plan.Not(operand=operand):
            return pen.negation(build(operand))
        case plan.If(condition=condition, then=then, otherwise=otherwise):
            tested = build(condition)
            return pen.either(tested, *(_sequence(build_maybe(branch), pen) for branch in (then, otherwise)))
        case plan.MakeList(items=items):
            made = pen.array(*(build(item) for item in items))
            return made if _is_small(items) else pen.call(unit.sizes("checked", pen), made)
        case plan.GroupKey():
            return pen.name(body.seen_groups[group_key(node)])
        case plan.Aggregate(function=function):  # not before it is asked for: HAVING may drop what it fails on
            return pen.call(unit.constant(aggregate_of(node), function), pen.name(body.seen_groups[group_key(node)]))
        case plan.Subquery():
            return builder.subquery(node, body)
        case plan.Eval():
            return builder.text(node, body)
        case plan.Temporal() | plan.Assign() | plan.TemporalAssign() | plan.AssignLate():
            return _variable_access(builder, node, build, pen)
        case _:
            assert_never(node)


def _is_small(items: Sequence[plan.Expr]) -> bool:
    """Whether a list of the values is small whatever they are: it holds numbers, or few values."""
    types = [item.type for item in items]
    return all(map(_holds_numbers, types)) or sum(map(_values_in, types)) <= FEW


def _holds_numbers(known: Type) -> bool:
    """Whether the values are numbers or None, or lists of a known length of such values."""
    if known.only(Kind.NONE | Kind.NUMBER):
        return True
    return known.only(Kind.LIST) and known.positions is not None and all(map(_holds_numbers, known.positions))


def _values_in(known: Type) -> int:
    """The number of values that one of them is, with those inside of it; more than there may be if nobody knows."""
    if known.only(PLAIN):
        return 1
    if known.only(Kind.LIST) and known.positions is not None:
        return 1 + sum(map(_values_in, known.positions))
    return FEW + 1


def group_key(node: plan.GroupKey | plan.Aggregate) -> tuple[int, int]:
    """What a body's `groups` know the value of a group by: its query, and the position or the node."""
    return (node.query, node.index) if isinstance(node, plan.GroupKey) else (OWN_GROUP, id(node))


def element(body: Body, source: int, pen: Pen) -> ast.expr:
    """The current element of a source; that of rows kept as tuples is made a dict."""
    unit = body.unit
    name = unit.names[source]
    if source in unit.worlds:
        return pen.call(element_reader(unit, source, pen), pen.name(name))
    columns = unit.tuples.get(source)
    if columns is None:
        return pen.name(name)
    return pen.record(columns, tuple(pen.item(pen.name(name), index) for index in range(len(columns))))


def _sequence(values: Sequence[ast.expr], pen: Pen) -> ast.expr:
    """All values one after the other; the last one is the value."""
    return values[0] if len(values) == 1 else pen.item(pen.pack(*values), len(values) - 1)


def _constant(builder: Builder, value: Any, pen: Pen) -> ast.expr:
    return pen.name(builder.unit.constant(value)) if isinstance(value, list) else pen.constant(value)


def _column(body: Body, node: plan.Column, pen: Pen) -> ast.expr:
    unit = body.unit
    current = pen.name(unit.names[node.source])
    if node.source in unit.worlds:
        return pen.call(column_reader(unit, node.source, node.name, pen), current)
    if node.source in unit.bare:
        return current
    columns = unit.tuples.get(node.source)
    if columns is not None:
        return pen.item(current, columns.index(node.name))
    unit.page.mark_call(node.span, node.name)  # a field may be computed by code of the user's
    if not node.declared:
        return pen.call(unit.helper(column_of), current, pen.constant(node.name))
    if unit.elements[node.source].only(Kind.DICT):
        if not node.type.may(Kind.NONE):  # so it is there
            return pen.item(current, pen.constant(node.name))
        return pen.call(pen.part(current, "get"), pen.constant(node.name))
    return pen.call(unit.helper(column_of), current, pen.constant(node.name), pen.constant(None))


# --- calls ---------------------------------------------------------------------------------------------


def _call(builder: Builder, node: plan.Call, body: Body) -> ast.expr:
    unit, function = builder.unit, node.function
    facts, pen = unit.analysis.of(node), unit.pen_at(node.place)
    if is_remembered(node):
        value = pen.item(remembered_call(builder, node, body), 0)
        return body.kept(facts, value, unit.pen_at(node.span), function.name) if facts.steady else value
    reduced = builder.reduction(node, body) if function.builtin else None
    if reduced is not None:
        return reduced
    arguments = [expression(builder, argument, body) for argument in node.arguments]
    if function.builtin:
        members = _members(builder, node, arguments, body)
        if members is not None:
            return members
        if _is_index(node) and (body.trusting or not function.raises):
            body.trusted = body.trusted or function.raises
            return pen.item(arguments[0], arguments[1])
        inline = inlined(node, arguments, unit, pen)
        if inline is not None:
            if isinstance(inline, ast.IfExp):
                body.forget(inline.body)
                body.forget(inline.orelse)
            return inline
    unit.page.mark_call(node.place, function.name)
    call = pen.call(unit.function(function, pen), *arguments)
    if function.builtin or not facts.steady:
        return call
    return body.kept(facts, call, unit.pen_at(node.span), function.name)


def _is_index(node: plan.Call) -> bool:
    """Whether the call takes an element of a list by a whole number, so that nothing can be wrong but the number."""
    if node.function.name != "item":
        return False
    container, index = node.arguments
    return container.type.only(Kind.LIST) and index.type.only(Kind.INT)


def _members(builder: Builder, node: plan.Call, arguments: list[ast.expr], body: Body) -> ast.expr | None:
    """Membership in a list that stays the same for long, by a set of its elements, which is made once."""
    if node.function.name not in _MEMBERSHIP or body.parent is None:
        return None
    item, container = node.arguments
    facts = builder.unit.analysis.of(container)
    moves = any(map(body.sees, facts.sources)) or any(map(body.sees_state, facts.states)) or facts.groups
    if not container.type.only(Kind.LIST) or not facts.steady or moves:
        return None
    short = isinstance(container, plan.Constant) and len(container.value) <= 8
    known = facts.key is not None or isinstance(container, plan.Subquery)
    if short or isinstance(container, plan.MakeList) or not known:
        return None
    unit, pen = builder.unit, builder.unit.pen_at(container.span)
    if has_tuple(item.type) and container.type.item is not None and has_tuple(container.type.item):
        function, sought = members_of_lists, tuple_of(arguments[0], pen)
    else:
        function, sought = members_of, arguments[0]
        if not item.type.only(PLAIN):
            sought = pen.call(unit.helper(freeze), sought)
    members = pen.call(unit.helper(function), arguments[1])
    key = None if facts.key is None else -1 - facts.key
    kept = body.kept(replace(facts, key=key), members, pen, "members")
    return pen.compare(sought, _MEMBERSHIP[node.function.name](), kept)


def members_of(items: list[Any]) -> frozenset[Hashable]:
    """The elements of a list, to ask for quickly."""
    return frozenset(map(freeze, items))


def members_of_lists(items: list[Any]) -> frozenset[Hashable]:
    """The same where they are lists of plain values."""
    return frozenset(map(tuple, items))


def has_tuple(known: Type) -> bool:
    """Whether the values are short lists of plain values, so that tuples stand for them: 0.06 us instead of 0.45."""
    return known.only(Kind.LIST) and known.positions is not None and all(part.only(PLAIN) for part in known.positions)


def tuple_of(value: ast.expr, pen: Pen) -> ast.expr:
    """The tuple of a list."""
    return pen.pack(*value.elts) if isinstance(value, ast.List) else pen.call("tuple", value)


# --- script variables ----------------------------------------------------------------------------------


def _variable_access(
    builder: Builder,
    node: plan.Temporal | plan.Assign | plan.TemporalAssign | plan.AssignLate,
    build: Callable[[plan.Expr], ast.expr],
    pen: Pen,
) -> ast.expr:
    """Access to variables beyond reading their value."""
    unit = builder.unit
    owner = (pen.name("run"), pen.constant(node.name))
    match node:
        case plan.Assign(value=value):
            return pen.call(unit.helper(assign), *owner, build(value))
        case plan.Temporal(when=when):
            return pen.call(unit.helper(temporal), *owner, pen.constant(None) if when is None else build(when))
        case plan.TemporalAssign(keep=keep, value=value):
            return pen.call(unit.helper(store_temporal), *owner, build(keep), build(value))
        case plan.AssignLate(literal=literal):
            return pen.call(unit.helper(bind_late), *owner, pen.name(unit.constant(literal)))
        case _:
            assert_never(node)


def assign(run: Run, name: str, value: Any) -> Any:
    return run.assign(name, value)


def temporal(run: Run, name: str, when: Any) -> Any:
    return run.host.temporal(name, when)


def store_temporal(run: Run, name: str, keep: Any, value: Any) -> Any:
    run.host.store_temporal(name, keep, run.own(value))
    return value


def bind_late(run: Run, name: str, literal: Any) -> None:
    run.host.bind_late(name, literal)
