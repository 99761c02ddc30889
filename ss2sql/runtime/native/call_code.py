"""The code of calls of the user's functions: how their arguments are made keys, see calls.py."""

from __future__ import annotations

import ast
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeGuard

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.runtime.native.calls import exact_key
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.run import Run
from ss2sql.walk import walk_own

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

_PLAIN = Kind.INT | Kind.STR | Kind.NONE  # the kinds that are their own keys, PLAIN in calls.py


def is_remembered(node: plan.Expr) -> bool:
    """Whether the expression is a call whose results are remembered one by one."""
    if not isinstance(node, plan.Call):
        return False
    function = node.function
    return not (function.builtin or function.vectorized or function.volatility == "volatile")


def remembered_call(builder: Builder, node: plan.Call, body: Body) -> ast.expr:
    """The call; it gives the value and its frozen form, or None for that."""
    from ss2sql.runtime.native.expressions import expression

    unit = builder.unit
    pen = unit.pen_at(node.place)
    values = [expression(builder, argument, body) for argument in node.arguments]
    way = _way(node, body)
    keys: list[ast.expr] = []
    again: list[ast.expr] = []  # the keys, once they have been computed
    if way == "of_keys":
        for index, argument in enumerate(node.arguments):
            key, values[index] = _key(builder, argument, values[index], body)
            name = key.id if isinstance(key, ast.Name) else unit.local("key")
            keys.append(key if isinstance(key, ast.Name) else pen.bind(name, key))
            again.append(pen.name(name))
    unit.page.mark_call(node.place, node.function.name)
    constant = pen.name(unit.constant(node.function, "function"))

    def bound(part: str) -> str:
        function = pen.call(unit.helper(calls_of), pen.name("run"), constant, pen.constant(part))
        return unit.bind((node.function.name, part), f"{node.function.name}_{part}", function, pen)

    if way == "of_any":
        return pen.call(bound(way), *values)
    # What is remembered is asked here: 0.1 us in place of 0.5.
    found, asked = unit.local("found"), unit.local("key")
    if way == "of_plain":
        key = pen.pack(*values)
        missed = pen.call(bound("missed_plain"), pen.name(found), pen.name(asked))
    else:
        key = reduce(lambda one, other: pen.binary(one, ast.Add(), other), keys)
        missed = pen.call(bound("missed"), pen.name(found), pen.name(asked), pen.pack(*again), *values)
    kind = pen.call("type", pen.bind(found, pen.call(bound("get"), pen.bind(asked, key))))
    remembered = [pen.compare(kind, ast.Is(), pen.name("tuple")), pen.call(bound("hit"))]
    return pen.either(pen.both(ast.And(), remembered), pen.name(found), missed)


def keyed_elements(places: list[Any]) -> set[int]:
    """The sources whose elements are arguments of remembered calls, and not of such that need no keys."""
    return {
        argument.source
        for place in places
        for node in walk_own(place)
        if is_remembered(node) and not _is_plain(node)
        for argument in node.arguments
        if isinstance(argument, plan.Element)
    }


def _is_plain(node: plan.Call) -> bool:
    return all(argument.type.only(_PLAIN) for argument in node.arguments)


def _way(node: plan.Call, body: Body) -> str:
    """How the call is made: it is worth while to make keys here where one of them serves for several calls."""
    if _is_plain(node):
        return "of_plain"
    return "of_keys" if any(_is_early(argument, body) for argument in node.arguments) else "of_any"


def _is_early(argument: plan.Expr, body: Body) -> bool:
    """Whether the key of an argument is known before the innermost loop."""
    if _comes_with_key(argument, body):
        return True
    facts = body.unit.analysis.of(argument)
    return body.early_keys and facts.steady and not body.has_moved(facts) and body.home(facts) != (body, body.level)


def _comes_with_key(argument: plan.Expr, body: Body) -> TypeGuard[plan.Element]:
    if not isinstance(argument, plan.Element):
        return False
    name = body.unit.keys.get(argument.source)
    return name in body.locals or name in body.parameters


def _key(builder: Builder, argument: plan.Expr, value: ast.expr, body: Body) -> tuple[ast.expr, ast.expr]:
    """The key of an argument, and the argument; the key is computed first."""
    unit = builder.unit
    pen = unit.pen_at(argument.span)
    name = value
    if not isinstance(value, (ast.Name, ast.Constant)):
        name = pen.name(value.target.id if isinstance(value, ast.NamedExpr) else unit.local("argument"))
        assert isinstance(name, ast.Name)
        value = value if isinstance(value, ast.NamedExpr) else pen.bind(name.id, value)
    if _comes_with_key(argument, body):
        return pen.name(unit.keys[argument.source]), name
    key = pen.call(unit.helper(exact_key), value)
    facts = unit.analysis.of(argument)
    if not _is_early(argument, body):
        return key, name
    # A key of its own for the key: no expression of the plan has it.
    facts = replace(facts, key=None if facts.key is None else -1 - facts.key)
    home, level = body.home(facts)
    if home is not body or not isinstance(argument, (plan.State, plan.Element)) or not isinstance(value, ast.Name):
        kept = body.kept(facts, key, pen, "key")
        if not isinstance(kept, ast.IfExp) or not isinstance(value, ast.NamedExpr):
            return kept, name
        # Where the key is known already, it must not be left out to give the argument its name.
        return pen.item(pen.pack(value, body.kept(facts, pen.call(unit.helper(exact_key), name), pen, "key")), 1), name
    early = body.name_of(facts)
    if early is None:
        early = unit.local("key")
        home.blocks[level].insert(-1, pen.assign(early, key))  # before the loop
        assert facts.key is not None
        home.known[level][facts.key] = early
    return pen.name(early), name


def calls_of(run: Run, function: plan.Function, way: str) -> Any:
    return getattr(run.host.call(function, run), way)
