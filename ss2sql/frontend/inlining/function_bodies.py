"""Python functions whose body is one expression, translated to an expression of the language.

`translate_function_body` reads `return <expression>`, a lambda, and chains of `if` that return. It knows the operators
and functions that mean the same in the language and in Python, and refuses everything else with the reason. Whether
both also fail alike depends on the arguments and is decided call by call, see frontend/inlining/substitution.py.

The expression is a syntax tree in which a name is a parameter; what helpers compute stands in it in place of their
calls. AND and OR stand where only the truth counts, or where all their parts are bools: elsewhere Python's give one of
their operands, which IF does. Its spans are empty.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any

from ss2sql.frontend.inlining.substitution import NO_SPAN, FunctionBody
from ss2sql.frontend.syntax import ast as syntax
from ss2sql.frontend.volatility.function_source import FunctionNode, locate_function
from ss2sql.frontend.volatility.name_bindings import UNKNOWN, Findings, FunctionNames, Unproven
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, type_of

MOST_NODES = 200
MOST_HELPERS = 4  # functions inside functions

_ARITHMETIC: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "div",
    ast.Mod: "mod",
    ast.Pow: "pow",
}
_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "lt",
    ast.LtE: "le",
    ast.Eq: "eq",
    ast.NotEq: "ne",
    ast.GtE: "ge",
    ast.Gt: "gt",
    ast.In: "in",
    ast.NotIn: "not_in",
}
# Python's functions with the least and greatest number of arguments for which the built-in one is equal.
_FUNCTIONS: tuple[tuple[Callable[..., Any], str, int, int], ...] = (
    (builtins.abs, "abs", 1, 1),
    (builtins.min, "min", 2, 99),
    (builtins.max, "max", 2, 99),
    (builtins.len, "len", 1, 1),
    (builtins.sum, "sum", 1, 1),
    (builtins.round, "round", 1, 2),
    (builtins.int, "int", 1, 1),
    (builtins.float, "float", 1, 1),
    (builtins.str, "str", 1, 1),
    (builtins.pow, "pow", 2, 2),
    (math.sqrt, "sqrt", 1, 1),
    (math.dist, "distance", 2, 2),
)


class NotTranslatable(Exception):  # noqa: N818 - it is a finding, not an error
    """The function is no expression of the language; the reason has the function as its subject."""


def translate_function_body(function: Callable[..., Any]) -> FunctionBody | str:
    """The function's body, or the reason why it cannot become part of a query. Nothing is called."""
    try:
        reader = _Translator(function, ())
        tree = reader.translate_body({name: syntax.Name(name, span=NO_SPAN) for name in reader.names})
    except (NotTranslatable, Unproven) as refused:
        return str(refused)
    except RecursionError:
        return "is nested too deeply to be followed"
    return FunctionBody(
        reader.positional, reader.defaults, tree, ast.unparse(reader.expression), frozenset(reader.uses)
    )


def _find_inlined_expression(node: FunctionNode) -> ast.expr:
    """The function's body as one expression."""
    if isinstance(node, ast.Lambda):
        return node.body
    statements = node.body
    match statements[0]:
        case ast.Expr(value=ast.Constant(value=str())):
            statements = statements[1:]
    return _fold_returns(statements, [MOST_NODES])


def _fold_returns(statements: Sequence[ast.stmt], left: list[int]) -> ast.expr:
    """Statements that only choose what to return; `left` counts how many more may be read."""
    left[0] -= 1
    if left[0] < 0:
        raise NotTranslatable("is too long")
    match statements:
        case []:
            return ast.Constant(None)
        case [ast.Return(value=value), *_]:
            return ast.Constant(None) if value is None else value
        case [ast.If(test=test, body=then, orelse=otherwise), *rest]:
            return ast.IfExp(test, _fold_returns([*then, *rest], left), _fold_returns([*otherwise, *rest], left))
        case [ast.Pass(), *rest]:
            return _fold_returns(rest, left)
        case _:
            raise NotTranslatable("is more than one expression")


def _make_literal(value: Any) -> syntax.Literal:
    """A value that Python and the language have in common."""
    fits = value is None or type(value) in (bool, str)
    fits |= type(value) is int and INT_MIN <= value <= INT_MAX
    fits |= type(value) is float and math.isfinite(value)
    if not fits or type_of(value).may_be(Kind.OBJECT):
        raise NotTranslatable(f"uses a {type(value).__name__}, which the language does not have as a constant")
    return syntax.Literal(value, span=NO_SPAN)


class _Translator:
    """Reads one function's expression. `around` are the functions that lead to it."""

    def __init__(self, function: Any, around: tuple[FunctionType, ...]) -> None:
        if type(function) is not FunctionType:
            raise NotTranslatable("is not a function written in Python")
        if function in around or len(around) > MOST_HELPERS:
            raise NotTranslatable("calls functions inside functions too deeply")
        located = locate_function(function)
        if located is None:
            raise NotTranslatable("has no source that can be read")
        arguments = located.node.args
        if arguments.vararg or arguments.kwarg:
            raise NotTranslatable("takes any number of arguments")
        self.around = (*around, function)
        self.positional = tuple(parameter.arg for parameter in (*arguments.posonlyargs, *arguments.args))
        values = dict(zip(reversed(self.positional), reversed(function.__defaults__ or ()), strict=False))
        values.update(function.__kwdefaults__ or {})
        self.defaults = {name: _make_literal(value) for name, value in values.items()}
        self.names = (*self.positional, *(name for name in values if name not in self.positional))
        self.expression = _find_inlined_expression(located.node)
        self.frame = FunctionNames(function, located, Findings())
        self.arguments: Mapping[str, syntax.Expr] = {}
        self.uses: set[str] = set()  # the built-in functions in the body
        self.gives_tuple = False  # a result may be a tuple, which becomes a list outside of Python
        self.size = 0

    def translate_body(self, arguments: Mapping[str, syntax.Expr], test: bool = False) -> syntax.Expr:
        """The function's expression with these arguments; with `test` only its truth counts."""
        self.arguments = arguments
        return self.translate(self.expression, result=True, test=test)

    def translate(self, node: ast.expr, result: bool = False, test: bool = False) -> syntax.Expr:
        """The translated expression; as the function's `result` a tuple becomes a list."""
        self.size += 1
        if self.size > MOST_NODES:
            raise NotTranslatable("is too long")
        match node:
            case ast.Constant(value=value):
                return _make_literal(value)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return _make_literal(-value)
            case ast.Name() | ast.Attribute():
                return self._translate_name(node)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return self._make_call(_ARITHMETIC[type(op)], left, right)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._make_call("neg", operand)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return syntax.Not(self.translate(operand, test=True), span=NO_SPAN)
            case ast.BoolOp(op=op, values=values):
                return self._translate_and_or(isinstance(op, ast.And), values, test)
            case ast.Compare():
                return self._translate_comparison(node)
            case ast.IfExp(test=condition, body=body, orelse=orelse):
                then, otherwise = self.translate(body, result, test), self.translate(orelse, result, test)
                return syntax.If(self.translate(condition, test=True), (then,), (otherwise,), span=NO_SPAN)
            case ast.List(elts=items):
                return self._make_list(items, result)
            case ast.Tuple(elts=items) if result:
                self.gives_tuple = True
                return self._make_list(items, result)
            case ast.Subscript(value=value, slice=index):
                return self._translate_subscript(value, index, result)
            case ast.Call():
                return self._translate_call(node, result, test)
            case _:
                raise NotTranslatable(f"uses '{ast.unparse(node)[:40]}', which the language does not have")

    def _make_call(self, name: str, *arguments: ast.expr) -> syntax.Expr:
        return self._make_builtin(name, *map(self.translate, arguments))

    def _make_builtin(self, name: str, *arguments: syntax.Expr) -> syntax.Expr:
        self.uses.add(name)
        return syntax.Call(name, arguments, span=NO_SPAN)

    def _translate_and_or(self, both: bool, values: Sequence[ast.expr], test: bool) -> syntax.Expr:
        """Python's `and` or `or`: the operand that decides."""
        parts = [self.translate(value, test=test) for value in values]
        if test or all(map(_gives_bool, values)):
            return (syntax.And if both else syntax.Or)(tuple(parts), span=NO_SPAN)
        whole = parts[-1]
        for part in reversed(parts[:-1]):
            then, otherwise = (whole, part) if both else (part, whole)
            whole = syntax.If(part, (then,), (otherwise,), span=NO_SPAN)
        return whole

    def _translate_name(self, node: ast.Name | ast.Attribute) -> syntax.Expr:
        if self._is_local(node):
            return self.arguments[ast.unparse(node)]
        value = self.frame.find_object(node)
        if value is UNKNOWN:
            raise NotTranslatable(f"reads '{ast.unparse(node)[:40]}'")
        return _make_literal(value)

    def _is_local(self, node: ast.expr) -> bool:
        if not isinstance(node, ast.Name) or not self.frame.is_local(node.id):
            return False
        if node.id not in self.arguments:
            raise NotTranslatable("is more than one expression")
        return True

    def _translate_comparison(self, node: ast.Compare) -> syntax.Expr:
        operands = (node.left, *node.comparators)
        links = tuple(
            self._translate_link(left, op, right)
            for left, op, right in zip(operands, node.ops, operands[1:], strict=False)
        )
        return links[0] if len(links) == 1 else syntax.And(links, span=NO_SPAN)

    def _translate_link(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> syntax.Expr:
        if isinstance(op, ast.Is | ast.IsNot):
            if not any(isinstance(side, ast.Constant) and side.value is None for side in (left, right)):
                raise NotTranslatable(f"compares identities in '{ast.unparse(right)[:40]}'")
            return self._make_call("eq" if isinstance(op, ast.Is) else "ne", left, right)
        if isinstance(op, ast.In | ast.NotIn):
            return self._make_builtin(_COMPARISONS[type(op)], self.translate(left), self._translate_sequence(right))
        return self._make_call(_COMPARISONS[type(op)], left, right)

    def _make_list(self, items: Sequence[ast.expr], result: bool) -> syntax.Expr:
        return syntax.ListLiteral(tuple(self.translate(item, result) for item in items), span=NO_SPAN)

    def _translate_sequence(self, node: ast.expr, result: bool = False) -> syntax.Expr:
        """A list; also a tuple that is only searched or indexed, for which a list is equal."""
        if isinstance(node, ast.Tuple):
            return self._make_list(node.elts, result)
        if isinstance(node, ast.Name | ast.Attribute) and not self._is_local(node):
            value = self.frame.find_object(node)
            if type(value) is tuple:
                return syntax.ListLiteral(tuple(map(_make_literal, value)), span=NO_SPAN)
        return self.translate(node, result)

    def _translate_subscript(self, value: ast.expr, index: ast.expr, result: bool) -> syntax.Expr:
        if not isinstance(index, ast.Slice):
            return self._make_builtin("item", self._translate_sequence(value, result), self.translate(index))
        if index.step is not None:
            raise NotTranslatable("uses a slice with a step, which the language does not have")
        bounds = (ast.Constant(None) if bound is None else bound for bound in (index.lower, index.upper))
        return self._make_call("slice", value, *bounds)

    def _translate_call(self, node: ast.Call, result: bool, test: bool) -> syntax.Expr:
        target = self.frame.find_object(node.func)
        text = ast.unparse(node.func)[:40]
        if type(target) is FunctionType:
            return self._translate_helper(node, target, text, result, test)
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in node.args):
            raise NotTranslatable(f"calls {text} with arguments by name or in a list")
        for function, name, least, most in _FUNCTIONS:
            if target is function and least <= len(node.args) <= most:
                return self._make_call(name, *node.args)
        if target is builtins.bool and len(node.args) == 1:
            return syntax.Not(syntax.Not(self.translate(node.args[0], test=True), span=NO_SPAN), span=NO_SPAN)
        raise NotTranslatable(f"calls {text}, which the language does not have")

    def _translate_helper(
        self, node: ast.Call, target: FunctionType, text: str, result: bool, test: bool
    ) -> syntax.Expr:
        """What another Python function computes of the arguments of a call."""
        named = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg is not None}
        if len(named) < len(node.keywords) or any(isinstance(one, ast.Starred) for one in node.args):
            raise NotTranslatable(f"calls {text} with arguments that cannot be told apart")
        try:
            given = inspect.signature(target, follow_wrapped=False).bind(*node.args, **named).arguments
        except TypeError:
            raise NotTranslatable(f"calls {text} with the wrong arguments") from None
        # Arguments are evaluated in written order; a body that is inlined cannot fail, so their order is free.
        arguments = {name: self.translate(value) for name, value in given.items()}
        try:
            helper = _Translator(target, self.around)
            tree = helper.translate_body({**helper.defaults, **arguments}, test)
        except (NotTranslatable, Unproven) as refused:
            raise NotTranslatable(f"calls {text}, which {refused}") from None
        if helper.gives_tuple and not result:
            raise NotTranslatable(f"calls {text}, which gives a tuple")
        self.gives_tuple |= helper.gives_tuple
        self.uses |= helper.uses
        self.size += helper.size
        return tree


def _gives_bool(node: ast.expr) -> bool:
    """Whether the value of an expression is a bool, as its text shows."""
    match node:
        case ast.BoolOp(values=values):
            return all(map(_gives_bool, values))
        case ast.Constant(value=value):
            return isinstance(value, bool)
        case _:
            return isinstance(node, ast.Compare) or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not))
