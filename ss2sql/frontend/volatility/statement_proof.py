"""The proof that a Python function is immutable: a walk over its source that refuses everything unknown.

A function is immutable when equal arguments give equal values and nothing but its arguments and their parts is changed.
The walk keeps one invariant: parameters, and what lists and dicts hold, are plain values. Sets, iterators and functions
are traced through local names and refused wherever they would be stored, passed on or put in an order.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable

from ss2sql.frontend.volatility.expression_proof import ANY, ExpressionProof
from ss2sql.frontend.volatility.function_source import FunctionNode, pair_targets
from ss2sql.frontend.volatility.name_bindings import (
    CODE,
    NOTHING,
    OBJECT,
    SET,
    SET_OPERATORS,
    VALUE,
    Unproven,
    resolve_import,
)


class FunctionProof(ExpressionProof):
    """The walk over one function's body."""

    __slots__ = ()

    def run(self) -> None:
        """Walks the whole function."""
        self.body(self.frame.located.node)

    def body(self, node: FunctionNode) -> None:
        if isinstance(node, ast.Lambda):
            self.check(node.body, VALUE | SET)
        else:
            self.block(node.body)

    def block(self, statements: Iterable[ast.stmt]) -> None:
        for node in statements:
            try:
                self.statement(node)
            except Unproven as error:
                if error.line is None:
                    error.line = node.lineno
                raise

    def statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Pass() | ast.Break() | ast.Continue():
                pass
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                resolve_import(node, aliases[0].asname or aliases[0].name)
            case ast.Expr(value=value):
                self.check(value, ANY)
            case ast.Return(value=value):
                self.check_all([value], VALUE | SET)
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    self.assign(target, value)
            case ast.AnnAssign(target=target, value=value):
                self.assign(target, value) if value else self.target(target)
            case ast.AugAssign(target=target, op=op, value=value):
                self.frame.findings.changes = True
                # Only a set takes another in without regard to its order: `|=` of a dict reads it as pairs.
                joins = isinstance(op, SET_OPERATORS) and isinstance(target, ast.Name) and self.kind_of(target) == SET
                self.check(value, VALUE | OBJECT | (SET if joins else NOTHING))
                self.target(target)
            case ast.For(target=target, iter=iterable, body=body, orelse=orelse):
                self.check(iterable, VALUE | OBJECT)
                self.target(target)
                self.block([*body, *orelse])
            case ast.While(test=test, body=body, orelse=orelse) | ast.If(test=test, body=body, orelse=orelse):
                self.check(test, ANY)
                self.block([*body, *orelse])
            case ast.Assert(test=test, msg=message):
                self.check(test, ANY)
                self.check_all([message], VALUE)
            case ast.Raise(exc=raised, cause=cause):
                self.check_raise(raised)
                self.check_all([cause], VALUE | OBJECT)
            case ast.Try(body=body, handlers=handlers, orelse=orelse, finalbody=final):
                self.block([*body, *orelse, *final])
                for handler in handlers:
                    self.check_handler(handler.type)
                    self.block(handler.body)
            case ast.Match(subject=subject, cases=cases):
                self.check(subject, VALUE)
                for case in cases:
                    self.pattern(case.pattern)
                    self.check_all([case.guard], ANY)
                    self.block(case.body)
            case ast.FunctionDef():
                self.nested(node)
            case ast.Delete(targets=targets):
                for target in targets:
                    self.target(target)
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                word = "global" if isinstance(node, ast.Global) else "nonlocal"
                raise Unproven(f"declares '{names[0]}' {word}")
            case ast.ClassDef(name=name):
                raise Unproven(f"defines the class '{name}'")
            case _:
                raise Unproven(f"uses '{type(node).__name__.removeprefix('Async').lower()}'")

    def assign(self, target: ast.expr, value: ast.expr) -> None:
        for part, part_value in pair_targets(target, value):
            if part_value is None:
                self.check(value, VALUE | OBJECT)
            else:
                self.check(part_value, ANY if isinstance(part, ast.Name) else VALUE)
            self.target(part)

    def check_raise(self, node: ast.expr | None) -> None:
        if isinstance(node, ast.Name | ast.Attribute) and self.kind_of(node) & CODE:
            # Raising a class calls it.
            self.follow(self.frame.static(node, self.scope), ast.unparse(node))
        else:
            self.check_all([node], VALUE | OBJECT)

    def check_handler(self, node: ast.expr | None) -> None:
        for part in node.elts if isinstance(node, ast.Tuple) else [node]:
            if part is not None and not issubclass(type(self.frame.static(part, self.scope)), type):
                raise Unproven(f"catches '{ast.unparse(part)[:40]}', which is not an exception class")

    def pattern(self, node: ast.pattern) -> None:
        match node:
            case ast.MatchValue(value=value):
                self.check(value, VALUE)
            case ast.MatchMapping(keys=keys, patterns=patterns):
                self.check_all(keys, VALUE)
                self.patterns(patterns)
            case ast.MatchClass(cls=cls, patterns=patterns, kwd_attrs=[]):
                self.builtin_class(cls)
                self.patterns(patterns)
            case ast.MatchSequence(patterns=patterns) | ast.MatchOr(patterns=patterns):
                self.patterns(patterns)
            case ast.MatchAs(pattern=pattern):
                self.patterns([pattern] if pattern else [])
            case ast.MatchSingleton() | ast.MatchStar():
                pass
            case _:
                raise Unproven("matches attributes of an object")

    def patterns(self, nodes: Iterable[ast.pattern]) -> None:
        for node in nodes:
            self.pattern(node)
