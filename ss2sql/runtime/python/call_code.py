"""The code of calls of the user's functions: keys of arguments, and calls for blocks of rows, see run/calls.py."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import reduce
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeGuard

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import walk_own
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.python.located_code import AstBuilder
from ss2sql.runtime.run.calls import Guards, call_in_blocks, list_guarded_calls, make_call_key

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
    constant = codegen.embed(node.function, "function")

    def bind_method(part: str) -> str:
        function = build.express(f"run.host.get_callable(constant, run).{part}", constant=constant)
        return codegen.bind((node.function.name, part), f"{node.function.name}_{part}", function, build)

    if method == "call_any":
        return build.call(bind_method(method), *values)
    # What is remembered is looked up here: 0.1 us in place of 0.5.
    found, plain = codegen.new_name("found"), method == "call_plain"
    made = body.pack(values, build) if plain else reduce(lambda a, b: build.express("a + b", a=a, b=b), keys)
    key_name = made.id if isinstance(made, ast.Name) else codegen.new_name("key")
    made = made if isinstance(made, ast.Name) else build.bind(key_name, made)
    parts = [build.name(found), build.name(key_name), *([] if plain else [build.pack(*again), *values])]
    missed = build.call(bind_method("call_new_plain" if plain else "missed"), *parts)
    text = "found[0] if type(found := get(key)) is tuple and hit() else missed"
    return build.express(text, found=found, get=bind_method("get"), key=made, hit=bind_method("hit"), missed=missed)


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


class CallStages:
    """A generated generator in several functions: each takes the rows of the one before, and goes on with them.

    Between two of them a function that takes arrays is called for what comes next, see run/calls.py. `size` is that
    of the first block, by default of all.
    """

    def __init__(self, builder: QueryCompiler, first: PythonScope, size: int | None = None) -> None:
        self.builder, self.codegen = builder, builder.codegen
        self.first, self.outer, self.size = first, tuple(first.parameters), size
        self.stages: list[tuple[PythonScope, ast.expr | None]] = []  # what goes on, and what is called before
        self.spent = set[str]()  # names that nothing further in reads
        self.called: dict[int, str] = {}  # by meaning: the names of the values of calls
        self.guarded: list[int] = []  # of these, calls that are made for some rows alone

    def add_calls(self, body: PythonScope, parts: Sequence[Any]) -> PythonScope:
        """The function that goes on where the calls are made that the parts evaluate next, on some conditions."""
        for key in self.guarded:
            del self.called[key]
            for names in body.known:
                names.pop(key, None)
        self.guarded = []
        found: dict[int, tuple[plan.Call, list[Guards]]] = {}
        for call, guards in chain.from_iterable(map(list_guarded_calls, parts)):
            facts = self.codegen.analysis.facts(call)
            if facts.steady and facts.key is not None and facts.key not in self.called:
                found.setdefault(facts.key, (call, []))[1].append(guards)
        for meaning, (call, guard_sets) in found.items():
            function, build = call.function, self.codegen.build_at(call.place)
            arguments = self._write_arguments(body, call, guard_sets, build)
            self.codegen.page.note_call(call.place, function.name)
            body = self.begin_stage(body, build, build.name(self.codegen.name_function(function, build)), arguments)
            name = self.called[meaning] = body.known[-1][meaning] = self.codegen.new_name(function.name)
            loop = body.blocks[0][-1]
            assert isinstance(loop, ast.For)
            loop.target = ast.Tuple([loop.target, ast.Name(name, ast.Store(), **build.at)], ast.Store(), **build.at)
            body.locals.append(name)
            if () not in guard_sets:
                self.guarded.append(meaning)
        return body

    def _write_arguments(
        self, body: PythonScope, call: plan.Call, guard_sets: Sequence[Guards], build: AstBuilder
    ) -> ast.expr:
        """The arguments of a call, or None for a row in which none of the conditions holds."""
        from ss2sql.runtime.python.python_expressions import generate_expression

        certain = () in guard_sets
        with nullcontext() if certain else body.write_skippable():
            values = build.pack(*(generate_expression(self.builder, argument, body) for argument in call.arguments))
            if certain:
                return values
            tests = []
            for guards in guard_sets:
                parts = [(generate_expression(self.builder, guard, body), truth) for guard, truth in guards]
                tests.append([part if truth else build.negate(part) for part, truth in parts])
        ands = [test[0] if len(test) == 1 else build.join_conditions(ast.And(), test) for test in tests]
        made = ands[0] if len(ands) == 1 else build.join_conditions(ast.Or(), ands)
        return build.if_else(made, values, build.constant(None))

    def begin_stage(
        self, body: PythonScope, build: AstBuilder, function: ast.expr | None = None, arguments: ast.expr | None = None
    ) -> PythonScope:
        """A new function for the rows so far, which come with what another one gives for the arguments."""
        codegen, rows = self.codegen, self.codegen.new_name("rows")
        names = [name for name in (*body.parameters, *body.locals) if name not in {*self.outer, *self.spent}]
        row = build.pack(*map(build.name, names)) if len(names) > 1 else build.name(*names)
        body.emit(build.run(build.yield_(row if arguments is None else build.pack(row, arguments))))
        stage = PythonScope(codegen, codegen.new_name("rows"), [*self.outer, rows], body.parent)
        stage.levels = {source: min(level, 1) for source, level in body.levels.items()}
        stage.states, stage.groups, stage.counts = body.states, body.groups, body.counts
        stage.group_level = min(body.group_level, 1)
        stage.open_loop(names, build.name(rows), build)
        stage.known[-1].update(self.called)
        stage.before = body
        self.spent.add(rows)
        self.stages.append((stage, function))
        return stage

    def join_stages(self) -> str:
        """Writes the generator, which takes what the first function takes; gives its name."""
        build, outer = self.codegen.build, list(map(self.codegen.build.name, self.outer))
        rows = build.call(self.first.name, *outer)
        for stage, function in self.stages:
            if function is not None:
                rows = build.call(self.codegen.use(call_in_blocks), function, rows, build.constant(self.size))
            rows = build.call(stage.name, *outer, rows)
        if not self.stages:
            return self.first.name
        name = self.codegen.new_name("find")
        self.codegen.definitions.append(build.function(name, list(self.outer), [build.return_(rows)]))
        return name
