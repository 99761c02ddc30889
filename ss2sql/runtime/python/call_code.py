"""The code of calls of the user's functions: how their arguments are made keys, see run/calls.py."""

from __future__ import annotations

import ast
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeGuard

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import walk_own
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.run.calls import make_call_key

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler

SELF_KEYED_KINDS = Kind.INT | Kind.STR | Kind.NONE  # the kinds that are their own keys, PLAIN in run/calls.py


def is_memoized_call(node: plan.Expr) -> bool:
    """Whether the expression is a call whose results are remembered one by one."""
    if not isinstance(node, plan.Call):
        return False
    function = node.function
    return not (function.builtin or function.vectorized or function.volatility == "volatile")


def generate_memoized_call(builder: QueryCompiler, node: plan.Call, body: PythonScope) -> ast.expr:
    """The call, which gives the value."""
    from ss2sql.runtime.python.python_expressions import generate_expression

    codegen = builder.codegen
    build = codegen.build_at(node.place)
    if codegen.source_call is not None and node is codegen.source_call.node:
        return codegen.source_call.write_call(body)
    values = [generate_expression(builder, argument, body) for argument in node.arguments]
    method = _choose_call_method(node, body)
    keys: list[ast.expr] = []
    again: list[ast.expr] = []  # the keys, once they have been computed
    if method == "call_by_keys":
        for index, argument in enumerate(node.arguments):
            key, values[index] = _generate_argument_key(builder, argument, values[index], body)
            name = key.id if isinstance(key, ast.Name) else codegen.new_name("key")
            keys.append(key if isinstance(key, ast.Name) else build.bind(name, key))
            again.append(build.name(name))
    codegen.page.note_call(node.place, node.function.name)
    constant = build.name(codegen.embed(node.function, "function"))

    def bind_method(part: str) -> str:
        function = build.part(build.call_method("run.host.get_callable", constant, build.name("run")), part)
        return codegen.bind((node.function.name, part), f"{node.function.name}_{part}", function, build)

    if method == "call_any":
        return build.call(bind_method(method), *values)
    # What is remembered is looked up here: 0.1 us in place of 0.5.
    found, plain = codegen.new_name("found"), method == "call_plain"
    made = body.pack(values, build) if plain else reduce(lambda one, other: build.binary(one, ast.Add(), other), keys)
    key_name = made.id if isinstance(made, ast.Name) else codegen.new_name("key")
    made = made if isinstance(made, ast.Name) else build.bind(key_name, made)
    key = build.name(key_name)
    missed = (
        build.call(bind_method("call_new_plain"), build.name(found), key)
        if plain
        else build.call(bind_method("missed"), build.name(found), key, build.pack(*again), *values)
    )
    kind = build.call("type", build.bind(found, build.call(bind_method("get"), made)))
    remembered = [build.compare(kind, ast.Is(), build.name("tuple")), build.call(bind_method("hit"))]
    value = build.item(build.name(found), 0)
    return build.if_else(build.join_conditions(ast.And(), remembered), value, missed)


def find_keyed_sources(places: list[Any]) -> set[int]:
    """The sources whose elements are arguments of remembered calls, and not of such that need no keys."""
    return {
        argument.source
        for place in places
        for node in walk_own(place)
        if is_memoized_call(node) and not _is_self_keyed_call(node)
        for argument in node.arguments
        if isinstance(argument, plan.Element)
    }


def _is_self_keyed_call(node: plan.Call) -> bool:
    return all(argument.type.is_only(SELF_KEYED_KINDS) for argument in node.arguments)


def _choose_call_method(node: plan.Call, body: PythonScope) -> str:
    """How the call is made: it is worth while to make keys here where one of them serves for several calls."""
    if _is_self_keyed_call(node):
        return "call_plain"
    return "call_by_keys" if any(_is_key_known_early(argument, body) for argument in node.arguments) else "call_any"


def _is_key_known_early(argument: plan.Expr, body: PythonScope) -> bool:
    """Whether the key of an argument is known before the innermost loop."""
    if _has_argument_key(argument, body):
        return True
    facts = body.codegen.analysis.facts(argument)
    return facts.steady and not body.has_state_changed(facts) and body.find_home(facts) != (body, body.level)


def _has_argument_key(argument: plan.Expr, body: PythonScope) -> TypeGuard[plan.Element]:
    if not isinstance(argument, plan.Element):
        return False
    name = body.codegen.keys.get(argument.source)
    return name in body.locals or name in body.parameters


def _generate_argument_key(
    builder: QueryCompiler, argument: plan.Expr, value: ast.expr, body: PythonScope
) -> tuple[ast.expr, ast.expr]:
    """The key of an argument, and the argument; the key is computed first."""
    codegen = builder.codegen
    build = codegen.build_at(argument.span)
    name = value
    if not isinstance(value, (ast.Name, ast.Constant)):
        name = build.name(value.target.id if isinstance(value, ast.NamedExpr) else codegen.new_name("argument"))
        assert isinstance(name, ast.Name)
        value = value if isinstance(value, ast.NamedExpr) else build.bind(name.id, value)
    if _has_argument_key(argument, body):
        return build.name(codegen.keys[argument.source]), name
    key = build.call(codegen.use(make_call_key), value)
    facts = codegen.analysis.facts(argument)
    if not _is_key_known_early(argument, body):
        return key, name
    # A key of its own for the key: no expression of the plan has it.
    facts = replace(facts, key=None if facts.key is None else -1 - facts.key)
    kept = body.compute_once(facts, key, build, "key")
    if not isinstance(kept, ast.IfExp) or not isinstance(value, ast.NamedExpr):
        return kept, name
    # Where the key is known already, it must not be left out to give the argument its name.
    known = body.compute_once(facts, build.call(codegen.use(make_call_key), name), build, "key")
    return build.item(build.pack(value, known), 1), name
