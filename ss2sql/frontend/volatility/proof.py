"""The proof that a Python function is immutable: a walk over its source that refuses everything unknown.

A function is immutable when equal arguments give equal values and nothing but its arguments and their parts is changed.
The walk keeps one invariant: parameters, and what lists and dicts hold, are plain values. Sets, iterators and functions
are traced through local names and refused wherever they would be stored, passed on or put in an order.
"""

from __future__ import annotations

import ast
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import field
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.volatility.function_source import Comprehension, FunctionNode, Owner, list_parameters, pair_targets
from ss2sql.frontend.volatility.name_bindings import (
    CLASSES,
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
    LocalFunction,
    ResultKind,
    Scope,
    Target,
    Unproven,
    find_known_pure,
    resolve_import,
)

ANY = VALUE | SET | OBJECT | CODE
# A field of a format string with a dotted name: `{0.name}`, also inside another field.
_ATTRIBUTE = re.compile(r"\{[^{}:!]*\.")
_SINGLES = (None, True, False)


@dataclass(slots=True)
class ExpressionProof(ABC):
    """The part of the proof that checks expressions.

    `follow` proves another Python object that is called by a name. Every check raises `Unproven` where the proof fails.
    """

    frame: FunctionNames
    follow: Callable[[Any, str], None]
    scope: Scope = field(init=False)  # where the walk stands

    def __post_init__(self) -> None:
        self.scope = self.frame.root

    @abstractmethod
    def check_body(self, node: FunctionNode) -> None:
        """Walks the body of a function or lambda, in its own scope."""

    @contextmanager
    def within_scope(self, owner: Owner) -> Iterator[None]:
        outer, self.scope = self.scope, self.frame.open_scope(owner, self.scope)
        try:
            yield
        finally:
            self.scope = outer

    def check_all(self, nodes: Iterable[ast.expr | None], allowed: ResultKind) -> None:
        for node in nodes:
            if node is not None:
                self.check_expr(node, allowed)

    def check_expr(self, node: ast.expr, allowed: ResultKind) -> None:
        """Checks an expression whose value may be of the `allowed` kinds."""
        try:
            self.check_node(node, allowed)
            excess = self.frame.infer_kind(node, self.scope) & ~allowed
        except Unproven as error:
            if error.line is None:
                error.line = node.lineno
            raise
        if excess:
            text = ast.unparse(node)[:40]
            if excess & SET:
                raise Unproven(f"uses the set '{text}' where its order may count", node.lineno)
            what = "a function" if excess & CODE else "an iterator, view or exception"
            raise Unproven(f"keeps or passes on '{text}', {what}", node.lineno)

    def check_node(self, node: ast.expr, allowed: ResultKind) -> None:
        match node:
            case ast.Constant() | ast.Name(ctx=ast.Load()):
                if isinstance(node, ast.Name) and self.scope.find_bindings(node.id) is None:
                    self.frame.find_outside(node.id)
            case ast.Call():
                self.check_call(node)
            case ast.Attribute(value=value, attr=name):
                if self.frame.find_object(node, self.scope) is UNKNOWN:
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
                # Values computed by a comprehension are not traced to the names around it.
                computed = not isinstance(self.scope.owner, ast.FunctionDef | ast.Lambda)
                self.check_expr(value, VALUE if computed else allowed)
            case ast.Compare():
                self.check_comparison(node)
            case ast.Subscript(value=value, slice=index):
                self.check_expr(value, VALUE | OBJECT)
                self.check_expr(index, VALUE)
            case ast.Slice(lower=lower, upper=upper, step=step):
                self.check_all([lower, upper, step], VALUE)
            case ast.List(elts=parts) | ast.Tuple(elts=parts) | ast.Set(elts=parts):
                for part in parts:
                    self.check_element(part, SET if isinstance(node, ast.Set) else NOTHING)
            case ast.Dict(keys=keys, values=values):
                self.check_all([*keys, *values], VALUE)
            case ast.JoinedStr(values=values):
                self.check_all(values, VALUE)
            case ast.FormattedValue(value=value, format_spec=spec):
                self.check_all([value, spec], VALUE)
            case ast.Lambda():
                self.check_nested(node)
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                self.check_comprehension(node, unordered=isinstance(node, ast.SetComp))
            case _:
                raise Unproven(f"uses '{type(node).__name__.lower()}'")

    def check_element(self, node: ast.expr, also: ResultKind) -> None:
        """Checks an element of a display or an argument; a starred one is iterated."""
        if isinstance(node, ast.Starred):
            self.check_expr(node.value, VALUE | OBJECT | also)
        else:
            self.check_expr(node, VALUE)

    def check_comparison(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for left, op, right in zip(operands, node.ops, node.comparators, strict=False):
            if isinstance(op, ast.Is | ast.IsNot):
                single = isinstance(left, ast.Constant) and any(left.value is one for one in _SINGLES)
                single |= isinstance(right, ast.Constant) and any(right.value is one for one in _SINGLES)
                if not single and not (self.find_kind(left) | self.find_kind(right)) & CODE:
                    raise Unproven(f"compares identities in '{ast.unparse(node)[:40]}'")
        self.check_all(operands, ANY)

    def find_kind(self, node: ast.expr) -> ResultKind:
        return self.frame.infer_kind(node, self.scope)

    def check_comprehension(self, node: Comprehension, unordered: bool) -> None:
        read_through = VALUE | OBJECT | (SET if unordered else NOTHING)
        # The first source is read outside the comprehension, everything else inside.
        self.check_expr(node.generators[0].iter, read_through)
        with self.within_scope(node):
            for number, generator in enumerate(node.generators):
                if number:
                    self.check_expr(generator.iter, read_through)
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
                self.frame.findings.changes = True
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
                self.check_annotation(annotation)
        with self.within_scope(node):
            self.check_body(node)

    def check_annotation(self, node: ast.expr | None) -> None:
        match node:
            case None | ast.Constant():
                pass
            case ast.Name():
                self.check_builtin_class(node)
            case ast.Subscript(value=left, slice=right) | ast.BinOp(left=left, op=ast.BitOr(), right=right):
                self.check_annotation(left)
                self.check_annotation(right)
            case ast.Tuple(elts=parts):
                for part in parts:
                    self.check_annotation(part)
            case _:
                raise Unproven(f"computes the annotation '{ast.unparse(node)[:40]}'")

    def check_builtin_class(self, node: ast.expr) -> None:
        value = self.frame.find_object(node, self.scope)
        if not any(value is owner for owner in CLASSES):
            raise Unproven(f"asks whether a value is a '{ast.unparse(node)[:40]}'")

    # Calls

    def check_call(self, node: ast.Call) -> None:
        func = node.func
        if isinstance(func, ast.Attribute) and self.frame.find_object(func, self.scope) is UNKNOWN:
            self.check_method(node, func)
            return
        if isinstance(func, ast.Lambda | ast.IfExp):
            self.check_expr(func, CODE)
        text = ast.unparse(func)
        for target in self.frame.find_targets(func, self.scope):
            entry = None if isinstance(target, LocalFunction) else find_known_pure(target)
            if entry is not None:
                self.check_known_call(node, entry)
                continue
            if not isinstance(target, LocalFunction):
                self.follow(target, text)
            for argument in node.args:
                self.check_element(argument, NOTHING)
            self.check_all([keyword.value for keyword in node.keywords], VALUE)

    def check_known_call(self, node: ast.Call, entry: KnownFunction) -> None:
        self.frame.findings.changes |= entry.changes
        if len(node.args) > entry.most:
            raise Unproven(f"calls {entry.name} with more arguments than are known")
        reads = entry.reads if not entry.alone or len(node.args) == 1 else range(0)
        keyed = any(keyword.arg == "key" for keyword in node.keywords)
        for position, argument in enumerate(node.args):
            starred = isinstance(argument, ast.Starred)
            if starred and (entry.most < 99 or (entry.function is not None and position <= entry.function)):
                raise Unproven(f"calls {entry.name} with arguments that are not counted")
            if position == entry.function:
                self.check_callable(argument)
            elif entry.target is isinstance and position == 1:
                for part in argument.elts if isinstance(argument, ast.Tuple) else [argument]:
                    self.check_builtin_class(part)
            elif position not in reads or starred:
                self.check_element(argument, NOTHING)
            elif entry.generated and not keyed and isinstance(argument, ast.GeneratorExp):
                self.check_comprehension(argument, unordered=True)
            else:
                self.check_expr(argument, VALUE | OBJECT | (SET if entry.unordered and not keyed else NOTHING))
        self.check_keywords(node, entry.name, entry.keywords)

    def check_keywords(self, node: ast.Call, name: str, accepted: tuple[str, ...]) -> None:
        for keyword in node.keywords:
            if keyword.arg == "key" and "key" in accepted:
                self.check_callable(keyword.value)
            elif keyword.arg in accepted or "*" in accepted:
                self.check_expr(keyword.value, VALUE)
            else:
                raise Unproven(f"calls {name} with the argument '{keyword.arg or '**'}', which is not known to be pure")

    def check_callable(self, node: ast.expr) -> None:
        """Checks an argument that is called: it must be proven, and give plain values."""
        if isinstance(node, ast.Constant):
            return
        if isinstance(node, ast.Attribute) and self.frame.find_object(node, self.scope) is UNKNOWN:
            method = METHODS.get(node.attr)
            if method is None or method.gives != VALUE or node.attr in ("copy", "format", "pop"):
                raise Unproven(f"uses the method '{node.attr}', which is not known to be pure")
            self.frame.findings.changes |= method.changes
            self.check_expr(node.value, VALUE | SET | OBJECT)
            return
        if isinstance(node, ast.Call):
            entry = find_known_pure(self.frame.find_object(node.func, self.scope))
            if entry is None or entry.gives != CODE or entry.target is type:
                raise Unproven(f"calls the result of '{ast.unparse(node)[:40]}'")
            self.check_expr(node, CODE)
            return
        if isinstance(node, ast.Lambda | ast.IfExp):
            self.check_expr(node, CODE)
        for target in self.frame.find_targets(node, self.scope):
            self.check_callback(target, ast.unparse(node))

    def check_callback(self, target: Target, text: str) -> None:
        entry = None if isinstance(target, LocalFunction) else find_known_pure(target)
        if entry is not None:
            self.frame.findings.changes |= entry.changes
        elif not isinstance(target, LocalFunction):
            self.follow(target, text)
        if self.frame.infer_result_kind(target) & ~VALUE or (entry is not None and entry.function is not None):
            raise Unproven(f"uses {text} as a function, which does not give plain values")

    def check_method(self, node: ast.Call, func: ast.Attribute) -> None:
        name = func.attr
        method = METHODS.get(name)
        receiver = self.find_kind(func.value)
        if receiver & CODE:
            raise Unproven(f"calls {ast.unparse(func)}, which is not known to be pure")
        self.check_expr(func.value, VALUE | SET | OBJECT)
        if method is None:
            raise Unproven(f"calls the method '{name}', which is not known to be pure")
        if name == "format":
            self.check_template(func.value)
        if receiver & SET and name == "pop":
            raise Unproven("takes an element of a set, which may be any")
        spread = any(isinstance(argument, ast.Starred) for argument in node.args)
        if not (method.fewest <= len(node.args) <= method.most or spread) or (spread and method.most < 99):
            raise Unproven(f"calls the method '{name}' unlike a method of Python's own types")
        self.frame.findings.changes |= method.changes
        unordered = method.unordered or (method.reads and receiver == SET)
        allowed = VALUE | (OBJECT if method.reads else NOTHING) | (SET if unordered else NOTHING)
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                self.check_element(argument, NOTHING)
            else:
                self.check_expr(argument, allowed)
        self.check_keywords(node, f"the method '{name}'", method.keywords)

    def check_template(self, node: ast.expr) -> None:
        """Checks that a format string is constant and reads no attributes: the text of a method has an address."""
        text = node.value if isinstance(node, ast.Constant) else self.frame.find_object(node, self.scope)
        if not isinstance(text, str):
            raise Unproven("formats with a text that is not constant")
        if _ATTRIBUTE.search(text):
            raise Unproven(f"reads attributes through the format '{text[:40]}'")


# --- the proof that a Python function is immutable: a walk over its source that refuses everything unknown
class FunctionProof(ExpressionProof):
    """The walk over one function's body."""

    __slots__ = ()

    def check_function(self) -> None:
        """Walks the whole function."""
        self.check_body(self.frame.located.node)

    def check_body(self, node: FunctionNode) -> None:
        if isinstance(node, ast.Lambda):
            self.check_expr(node.body, VALUE | SET)
        else:
            self.check_block(node.body)

    def check_block(self, statements: Iterable[ast.stmt]) -> None:
        for node in statements:
            try:
                self.check_statement(node)
            except Unproven as error:
                if error.line is None:
                    error.line = node.lineno
                raise

    def check_statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Pass() | ast.Break() | ast.Continue():
                pass
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                resolve_import(node, aliases[0].asname or aliases[0].name)
            case ast.Expr(value=value):
                self.check_expr(value, ANY)
            case ast.Return(value=value):
                self.check_all([value], VALUE | SET)
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    self.check_assignment(target, value)
            case ast.AnnAssign(target=target, value=value):
                self.check_assignment(target, value) if value else self.check_target(target)
            case ast.AugAssign(target=target, op=op, value=value):
                self.frame.findings.changes = True
                # Only a set takes another in without regard to its order: `|=` of a dict reads it as pairs.
                joins = isinstance(op, SET_OPERATORS) and isinstance(target, ast.Name) and self.find_kind(target) == SET
                self.check_expr(value, VALUE | OBJECT | (SET if joins else NOTHING))
                self.check_target(target)
            case ast.For(target=target, iter=iterable, body=body, orelse=orelse):
                self.check_expr(iterable, VALUE | OBJECT)
                self.check_target(target)
                self.check_block([*body, *orelse])
            case ast.While(test=test, body=body, orelse=orelse) | ast.If(test=test, body=body, orelse=orelse):
                self.check_expr(test, ANY)
                self.check_block([*body, *orelse])
            case ast.Assert(test=test, msg=message):
                self.check_expr(test, ANY)
                self.check_all([message], VALUE)
            case ast.Raise(exc=raised, cause=cause):
                self.check_raise(raised)
                self.check_all([cause], VALUE | OBJECT)
            case ast.Try(body=body, handlers=handlers, orelse=orelse, finalbody=final):
                self.check_block([*body, *orelse, *final])
                for handler in handlers:
                    self.check_handler(handler.type)
                    self.check_block(handler.body)
            case ast.Match(subject=subject, cases=cases):
                self.check_expr(subject, VALUE)
                for case in cases:
                    self.check_pattern(case.pattern)
                    self.check_all([case.guard], ANY)
                    self.check_block(case.body)
            case ast.FunctionDef():
                self.check_nested(node)
            case ast.Delete(targets=targets):
                for target in targets:
                    self.check_target(target)
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                word = "global" if isinstance(node, ast.Global) else "nonlocal"
                raise Unproven(f"declares '{names[0]}' {word}")
            case ast.ClassDef(name=name):
                raise Unproven(f"defines the class '{name}'")
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
        if isinstance(node, ast.Name | ast.Attribute) and self.find_kind(node) & CODE:
            # Raising a class calls it.
            self.follow(self.frame.find_object(node, self.scope), ast.unparse(node))
        else:
            self.check_all([node], VALUE | OBJECT)

    def check_handler(self, node: ast.expr | None) -> None:
        for part in node.elts if isinstance(node, ast.Tuple) else [node]:
            if part is not None and not issubclass(type(self.frame.find_object(part, self.scope)), type):
                raise Unproven(f"catches '{ast.unparse(part)[:40]}', which is not an exception class")

    def check_pattern(self, node: ast.pattern) -> None:
        match node:
            case ast.MatchValue(value=value):
                self.check_expr(value, VALUE)
            case ast.MatchMapping(keys=keys, patterns=patterns):
                self.check_all(keys, VALUE)
                self.check_patterns(patterns)
            case ast.MatchClass(cls=cls, patterns=patterns, kwd_attrs=[]):
                self.check_builtin_class(cls)
                self.check_patterns(patterns)
            case ast.MatchSequence(patterns=patterns) | ast.MatchOr(patterns=patterns):
                self.check_patterns(patterns)
            case ast.MatchAs(pattern=pattern):
                self.check_patterns([pattern] if pattern else [])
            case ast.MatchSingleton() | ast.MatchStar():
                pass
            case _:
                raise Unproven("matches attributes of an object")

    def check_patterns(self, nodes: Iterable[ast.pattern]) -> None:
        for node in nodes:
            self.check_pattern(node)
