"""The proof that a Python function is immutable: a walk over its source that refuses everything unknown.

A function is immutable when equal arguments give equal values and nothing but its arguments and their parts is changed.
The walk keeps one invariant: parameters, what lists and dicts hold, and what inner functions give are plain values.
Sets, iterators and functions are traced through local names and refused wherever they would be stored, passed on or put
in an order; only the function itself may give a set.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.volatility.function_source import Comprehension, FunctionNode, list_parameters, pair_targets
from ss2sql.frontend.volatility.name_bindings import (
    CODE,
    METHODS,
    NOTHING,
    OBJECT,
    SET,
    SET_OPERATORS,
    UNKNOWN,
    VALUE,
    FunctionNames,
    KnownFunction,
    ResultKind,
    Unproven,
    find_known_pure,
)

ANY = VALUE | SET | OBJECT | CODE
# A field of a format string with a dotted name: `{0.name}`, also inside another field.
_ATTRIBUTE = re.compile(r"\{[^{}:!]*\.")


@dataclass(slots=True)
class FunctionProof:
    """The walk over one function's body.

    `follow` proves another Python object that is called by a name. Every check raises `Unproven` where the proof fails.
    """

    names: FunctionNames
    follow: Callable[[Any, str], None]

    def check_function(self, given: ResultKind) -> None:
        """Walks the whole function, which may give values of these kinds."""
        self.check_body(self.names.located.node, given)

    def check_body(self, node: FunctionNode, given: ResultKind) -> None:
        if isinstance(node, ast.Lambda):
            self.check_expr(node.body, given)
        else:
            self.check_block(node.body, given)

    # --- expressions -----------------------------------------------------------------------------------

    def check_all(self, nodes: Iterable[ast.expr | None], allowed: ResultKind) -> None:
        for node in nodes:
            if node is not None:
                self.check_expr(node, allowed)

    def check_expr(self, node: ast.expr, allowed: ResultKind) -> None:
        """Checks an expression whose value may be of the `allowed` kinds; a starred one is iterated."""
        if isinstance(node, ast.Starred):
            self.check_expr(node.value, VALUE | OBJECT)
            return
        self.check_node(node, allowed)
        excess = self.names.infer_kind(node) & ~allowed
        if excess:
            text = ast.unparse(node)[:40]
            if excess & SET:
                raise Unproven(f"uses the set '{text}' where its order may count")
            what = "a function" if excess & CODE else "an iterator, view or exception"
            raise Unproven(f"keeps or passes on '{text}', {what}")

    def check_node(self, node: ast.expr, allowed: ResultKind) -> None:
        match node:
            case ast.Constant():
                pass
            case ast.Name():
                self.names.find_object(node)
            case ast.Call():
                self.check_call(node)
            case ast.Attribute(value=value, attr=name):
                if self.names.find_object(node) is UNKNOWN:
                    self.check_expr(value, ANY)
                    raise Unproven(f"reads the attribute '{name}' of an object")
            case ast.BinOp(left=left, op=op, right=right):
                self.check_all([left, right], VALUE | SET | OBJECT if isinstance(op, SET_OPERATORS) else VALUE)
            case ast.BoolOp(values=values):
                self.check_all(values, allowed)
            case ast.UnaryOp(op=op, operand=operand):
                self.check_expr(operand, ANY if isinstance(op, ast.Not) else VALUE)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                self.check_expr(test, ANY)
                self.check_all([body, orelse], allowed)
            case ast.NamedExpr(value=value):
                self.check_expr(value, allowed)
            case ast.Compare():
                self.check_comparison(node)
            case ast.Subscript(value=value, slice=index):
                self.check_expr(value, VALUE | OBJECT)
                self.check_expr(index, VALUE)
            case ast.Slice(lower=lower, upper=upper, step=step):
                self.check_all([lower, upper, step], VALUE)
            case ast.Set(elts=parts):
                for part in parts:
                    if isinstance(part, ast.Starred):
                        self.check_expr(part.value, VALUE | OBJECT | SET)
                    else:
                        self.check_expr(part, VALUE)
            case ast.List(elts=parts) | ast.Tuple(elts=parts) | ast.JoinedStr(values=parts):
                self.check_all(parts, VALUE)
            case ast.Dict(keys=keys, values=values):
                self.check_all([*keys, *values], VALUE)
            case ast.FormattedValue(value=value, format_spec=spec):
                self.check_all([value, spec], VALUE)
            case ast.Lambda():
                self.check_nested(node)
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                self.check_comprehension(node, unordered=isinstance(node, ast.SetComp))
            case _:
                raise Unproven(f"uses '{type(node).__name__.lower()}'")

    def check_comparison(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for left, op, right in zip(operands, node.ops, node.comparators, strict=False):
            identities = isinstance(op, ast.Is | ast.IsNot) and not (_is_single(left) or _is_single(right))
            if identities and not (self.names.infer_kind(left) | self.names.infer_kind(right)) & CODE:
                raise Unproven(f"compares identities in '{ast.unparse(node)[:40]}'")
        self.check_all(operands, ANY)

    def check_comprehension(self, node: Comprehension, unordered: bool) -> None:
        for generator in node.generators:
            self.check_expr(generator.iter, VALUE | OBJECT | (SET if unordered else NOTHING))
            self.check_target(generator.target)
            self.check_all(generator.ifs, ANY)
        self.check_all([node.key, node.value] if isinstance(node, ast.DictComp) else [node.elt], VALUE)

    def check_target(self, node: ast.expr) -> None:
        match node:
            case ast.Name():
                pass
            case ast.Tuple(elts=parts) | ast.List(elts=parts):
                for part in parts:
                    self.check_target(part)
            case ast.Starred(value=value):
                self.check_target(value)
            case ast.Subscript(value=value, slice=index):
                self.names.findings.changes = True
                self.check_expr(value, VALUE | OBJECT)
                self.check_expr(index, VALUE)
            case _:
                assert isinstance(node, ast.Attribute), "Python assigns to nothing else"
                raise Unproven(f"changes the attribute '{node.attr}'")

    def check_nested(self, node: FunctionNode) -> None:
        arguments = node.args
        self.check_all([*arguments.defaults, *arguments.kw_defaults], VALUE)
        if isinstance(node, ast.FunctionDef):
            if node.decorator_list:
                raise Unproven(f"decorates the inner function '{node.name}'")
            for annotation in (node.returns, *(parameter.annotation for parameter in list_parameters(arguments))):
                if annotation and any(isinstance(part, ast.Call) for part in ast.walk(annotation)):
                    raise Unproven(f"computes the annotation '{ast.unparse(annotation)[:40]}'")
        self.check_body(node, VALUE)

    # --- calls -----------------------------------------------------------------------------------------

    def check_call(self, node: ast.Call) -> None:
        func = node.func
        target = self.names.find_object(func)
        if target is UNKNOWN and isinstance(func, ast.Attribute):
            self.check_method(node, func)
            return
        entry = find_known_pure(target)
        if entry is not None:
            self.check_known_call(node, entry)
            return
        self.check_followed(func, target)
        self.check_all([*node.args, *(keyword.value for keyword in node.keywords)], VALUE)

    def check_followed(self, func: ast.expr, target: Any) -> None:
        """Checks a function that is called: one of Python's objects, or an inner one, which the walk comes to."""
        text = ast.unparse(func)[:40]
        if target is not UNKNOWN:
            self.follow(target, text)
        elif isinstance(func, ast.Name) and func.id in self.names.parameters:
            raise Unproven(f"calls its argument '{text}'")
        elif not isinstance(func, ast.Name) or func.id not in self.names.functions:
            raise Unproven(f"calls '{text}', which is not known")

    def check_known_call(self, node: ast.Call, entry: KnownFunction) -> None:
        self.names.findings.changes |= entry.changes
        keyed = any(keyword.arg == "key" for keyword in node.keywords)
        for position, argument in enumerate(node.args):
            if position == 0 and entry.calls:
                self.check_callable(argument)
            elif position == 1 and entry.target is isinstance:
                self.check_all(argument.elts if isinstance(argument, ast.Tuple) else [argument], VALUE | CODE)
            elif not entry.unordered or len(node.args) > 1:
                self.check_expr(argument, VALUE | OBJECT if position < entry.reads else VALUE)
            elif isinstance(argument, ast.GeneratorExp) and not keyed:
                self.check_comprehension(argument, unordered=True)
            else:
                self.check_expr(argument, VALUE | OBJECT | (NOTHING if keyed else SET))
        self.check_keywords(node)

    def check_keywords(self, node: ast.Call) -> None:
        for keyword in node.keywords:
            if keyword.arg == "key":
                self.check_callable(keyword.value)
            else:
                self.check_expr(keyword.value, VALUE)

    def check_callable(self, node: ast.expr) -> None:
        """Checks an argument that is called: it must be proven, and give plain values."""
        if isinstance(node, ast.Constant):
            return
        if isinstance(node, ast.Lambda):
            self.check_nested(node)
            return
        text = ast.unparse(node)[:40]
        if isinstance(node, ast.Call):
            entry = find_known_pure(self.names.find_object(node.func))
            if entry is None or entry.gives != CODE or entry.target is type:
                raise Unproven(f"calls the result of '{text}'")
            self.check_expr(node, CODE)
            return
        target = self.names.find_object(node)
        if target is UNKNOWN and isinstance(node, ast.Attribute):
            method = METHODS.get(node.attr)
            if method is None or method.gives != VALUE or node.attr in ("copy", "format", "pop"):
                raise Unproven(f"uses the method '{node.attr}', which is not known to be pure")
            self.names.findings.changes |= method.changes
            self.check_expr(node.value, VALUE | SET | OBJECT)
            return
        entry = find_known_pure(target)
        if entry is None:
            self.check_followed(node, target)
        elif entry.gives != VALUE or entry.calls:
            raise Unproven(f"uses {text} as a function, which does not give plain values")
        else:
            self.names.findings.changes |= entry.changes

    def check_method(self, node: ast.Call, func: ast.Attribute) -> None:
        name = func.attr
        method = METHODS.get(name)
        receiver = self.names.infer_kind(func.value)
        if receiver & CODE:
            raise Unproven(f"calls {ast.unparse(func)}, which is not known to be pure")
        self.check_expr(func.value, VALUE | SET | OBJECT)
        if method is None or len(node.args) < method.fewest:
            raise Unproven(f"calls the method '{name}', which is not known to be pure")
        if name == "format":
            self.check_template(func.value)
        if receiver & SET and name == "pop":
            raise Unproven("takes an element of a set, which may be any")
        self.names.findings.changes |= method.changes
        unordered = method.unordered or (method.reads and receiver == SET)
        allowed = VALUE | (OBJECT if method.reads else NOTHING) | (SET if unordered else NOTHING)
        self.check_all(node.args, allowed)
        self.check_keywords(node)

    def check_template(self, node: ast.expr) -> None:
        """Checks that a format string is constant and reads no attributes: the text of a method has an address."""
        text = node.value if isinstance(node, ast.Constant) else self.names.find_object(node)
        if not isinstance(text, str):
            raise Unproven("formats with a text that is not constant")
        if _ATTRIBUTE.search(text):
            raise Unproven(f"reads attributes through the format '{text[:40]}'")

    # --- statements ------------------------------------------------------------------------------------

    def check_block(self, statements: Iterable[ast.stmt], given: ResultKind) -> None:
        for node in statements:
            self.check_statement(node, given)

    def check_statement(self, node: ast.stmt, given: ResultKind) -> None:
        match node:
            case ast.Pass() | ast.Break() | ast.Continue():
                pass
            case ast.Expr(value=value):
                self.check_expr(value, ANY)
            case ast.Return(value=value):
                self.check_all([value], given)
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    self.check_assignment(target, value)
            case ast.AnnAssign(target=target, value=value):
                self.check_assignment(target, value) if value else self.check_target(target)
            case ast.AugAssign(target=target, op=op, value=value):
                self.names.findings.changes = True
                # Only a set takes another in without regard to its order: `|=` of a dict reads it as pairs.
                joins = isinstance(op, SET_OPERATORS) and isinstance(target, ast.Name)
                joins = joins and self.names.infer_kind(target) == SET
                self.check_expr(value, VALUE | OBJECT | (SET if joins else NOTHING))
                self.check_target(target)
            case ast.For(target=target, iter=iterable, body=body, orelse=orelse):
                self.check_expr(iterable, VALUE | OBJECT)
                self.check_target(target)
                self.check_block([*body, *orelse], given)
            case ast.While(test=test, body=body, orelse=orelse) | ast.If(test=test, body=body, orelse=orelse):
                self.check_expr(test, ANY)
                self.check_block([*body, *orelse], given)
            case ast.Assert(test=test, msg=message):
                self.check_expr(test, ANY)
                self.check_all([message], VALUE)
            case ast.Raise(exc=raised, cause=cause):
                self.check_raise(raised)
                self.check_all([cause], VALUE | OBJECT)
            case ast.Try(body=body, handlers=handlers, orelse=orelse, finalbody=final):
                self.check_block([*body, *orelse, *final], given)
                for handler in handlers:
                    self.check_handler(handler.type)
                    self.check_block(handler.body, given)
            case ast.FunctionDef():
                self.check_nested(node)
            case ast.Delete(targets=targets):
                for target in targets:
                    self.check_target(target)
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                word = "global" if isinstance(node, ast.Global) else "nonlocal"
                raise Unproven(f"declares '{names[0]}' {word}")
            case _:
                raise Unproven(f"uses '{type(node).__name__.removeprefix('Async').lower()}'")

    def check_assignment(self, target: ast.expr, value: ast.expr) -> None:
        for part, part_value in pair_targets(target, value):
            if part_value is None:
                self.check_expr(value, VALUE | OBJECT)
            else:
                self.check_expr(part_value, ANY if isinstance(part, ast.Name) else VALUE)
            self.check_target(part)

    def check_raise(self, node: ast.expr | None) -> None:
        if isinstance(node, ast.Name | ast.Attribute) and self.names.infer_kind(node) & CODE:
            # Raising a class calls it.
            self.check_followed(node, self.names.find_object(node))
        else:
            self.check_all([node], VALUE | OBJECT)

    def check_handler(self, node: ast.expr | None) -> None:
        for part in node.elts if isinstance(node, ast.Tuple) else [node]:
            if part is not None and not issubclass(type(self.names.find_object(part)), type):
                raise Unproven(f"catches '{ast.unparse(part)[:40]}', which is not an exception class")


def _is_single(node: ast.expr) -> bool:
    """Whether it is None, True or False, of which there is one each."""
    return isinstance(node, ast.Constant) and (node.value is None or isinstance(node.value, bool))
