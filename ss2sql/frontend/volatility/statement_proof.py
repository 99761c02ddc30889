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
