"""Python functions whose body is one expression, translated to an expression of the plan.

`translate_function_body` reads `return <expression>`, a lambda, and chains of `if` that return. It knows the operators
and functions that mean the same in the language and in Python, and refuses everything else with the reason. Whether
both also fail alike depends on the arguments and is decided call by call, see frontend/inlining/substitution.py.

In the expression a `plan.Variable` is a parameter, a call of a function that is not built in is a helper with its
own body, and `And` and `Or` are Python's, which give one of their operands. Its spans are empty.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any

from ss2sql.frontend.inlining.substitution import NO_SPAN, FunctionBody, find_builtin
from ss2sql.frontend.volatility.function_source import FunctionNode, locate_function
from ss2sql.frontend.volatility.name_bindings import UNKNOWN, Findings, FunctionNames, Unproven
from ss2sql.language import plan
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, type_of
from ss2sql.language.plan_traversal import join_conditions, list_plan_functions

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
        return _translate_function_body(function, ())
    except (NotTranslatable, Unproven) as refused:
        return str(refused)
    except RecursionError:
        return "is nested too deeply to be followed"


def _translate_function_body(function: Any, around: tuple[FunctionType, ...]) -> FunctionBody:
    if type(function) is not FunctionType:
        raise NotTranslatable("is not a function written in Python")
    if function in around or len(around) > MOST_HELPERS:
        raise NotTranslatable("calls functions inside functions too deeply")
    located = locate_function(function)
    if located is None:
        raise NotTranslatable("has no source that can be read")
    node, arguments = located.node, located.node.args
    if arguments.vararg or arguments.kwarg:
        raise NotTranslatable("takes any number of arguments")
    names = tuple(parameter.arg for parameter in (*arguments.posonlyargs, *arguments.args))
    defaults_by_name = dict(zip(reversed(names), reversed(function.__defaults__ or ()), strict=False))
    defaults_by_name.update(function.__kwdefaults__ or {})
    expression = _find_inlined_expression(node)
    reader = _Translator(FunctionNames(function, located, Findings()), (*around, function))
    expr = reader.translate(expression, result=True)
    defaults = {name: _is_inlined_constant(value) for name, value in defaults_by_name.items()}
    return FunctionBody(
        names, defaults, expr, ast.unparse(expression), frozenset(_collect_builtins(expr)), reader.gives_tuple
    )


def _collect_builtins(expr: plan.Expr) -> Iterator[str]:
    """The built-in functions in a body, and in the bodies that it calls."""
    for function in list_plan_functions(expr):
        if function.builtin:
            yield function.name
        else:
            yield from function.body.uses


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


def _is_inlined_constant(value: Any) -> plan.Constant:
    """Whether Python and the language have the value in common."""
    fits = value is None or type(value) in (bool, str)
    fits |= type(value) is int and INT_MIN <= value <= INT_MAX
    fits |= type(value) is float and math.isfinite(value)
    if not fits or type_of(value).may_be(Kind.OBJECT):
        raise NotTranslatable(f"uses a {type(value).__name__}, which the language does not have as a constant")
    return plan.Constant(value, type_of(value), span=NO_SPAN)


class _Translator:
    """Reads one function's expression. `around` are the functions that lead to it, itself included."""

    def __init__(self, frame: FunctionNames, around: tuple[FunctionType, ...]) -> None:
        self.frame = frame
        self.around = around
        self.gives_tuple = False
        self.size = 0

    def translate(self, node: ast.expr, result: bool = False) -> plan.Expr:
        """The translated expression; as the function's `result` a tuple becomes a list."""
        self.size += 1
        if self.size > MOST_NODES:
            raise NotTranslatable("is too long")
        match node:
            case ast.Constant(value=value):
                return _is_inlined_constant(value)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return _is_inlined_constant(-value)
            case ast.Name() | ast.Attribute():
                return self._translate_name(node)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return self._make_call(_ARITHMETIC[type(op)], left, right)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._make_call("neg", operand)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return plan.Not(self.translate(operand), span=NO_SPAN)
            case ast.BoolOp(op=op, values=values):
                parts = tuple(map(self.translate, values))
                return (plan.And if isinstance(op, ast.And) else plan.Or)(parts, span=NO_SPAN)
            case ast.Compare():
                return self._translate_comparison(node)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                then, otherwise = self.translate(body, result), self.translate(orelse, result)
                return plan.If(self.translate(test), (then,), (otherwise,), span=NO_SPAN)
            case ast.List(elts=items):
                return self._make_list(items, result)
            case ast.Tuple(elts=items) if result:
                self.gives_tuple = True
                return self._make_list(items, result)
            case ast.Subscript(value=value, slice=index):
                return self._translate_subscript(value, index, result)
            case ast.Call():
                return self._translate_call(node, result)
            case _:
                raise NotTranslatable(f"uses '{ast.unparse(node)[:40]}', which the language does not have")

    def _make_call(self, name: str, *arguments: ast.expr) -> plan.Call:
        return _make_inlined_builtin(name, *map(self.translate, arguments))

    def _translate_name(self, node: ast.Name | ast.Attribute) -> plan.Expr:
        if self._is_local(node):
            return plan.Variable(ast.unparse(node), span=NO_SPAN)
        value = self.frame.find_object(node)
        if value is UNKNOWN:
            raise NotTranslatable(f"reads '{ast.unparse(node)[:40]}'")
        return _is_inlined_constant(value)

    def _is_local(self, node: ast.expr) -> bool:
        if not isinstance(node, ast.Name) or not self.frame.is_local(node.id):
            return False
        if node.id not in self.frame.parameters:
            raise NotTranslatable("is more than one expression")
        return True

    def _translate_comparison(self, node: ast.Compare) -> plan.Expr:
        operands = (node.left, *node.comparators)
        links = [
            self._translate_link(left, op, right)
            for left, op, right in zip(operands, node.ops, operands[1:], strict=False)
        ]
        return join_conditions(plan.And, links, NO_SPAN)

    def _translate_link(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> plan.Expr:
        if isinstance(op, ast.Is | ast.IsNot):
            if not any(isinstance(side, ast.Constant) and side.value is None for side in (left, right)):
                raise NotTranslatable(f"compares identities in '{ast.unparse(right)[:40]}'")
            return self._make_call("eq" if isinstance(op, ast.Is) else "ne", left, right)
        if isinstance(op, ast.In | ast.NotIn):
            return _make_inlined_builtin(_COMPARISONS[type(op)], self.translate(left), self._translate_sequence(right))
        return self._make_call(_COMPARISONS[type(op)], left, right)

    def _make_list(self, items: Sequence[ast.expr], result: bool) -> plan.Expr:
        return _make_inlined_list(tuple(self.translate(item, result) for item in items))

    def _translate_sequence(self, node: ast.expr, result: bool = False) -> plan.Expr:
        """A list; also a tuple that is only searched or indexed, for which a list is equal."""
        if isinstance(node, ast.Tuple):
            return self._make_list(node.elts, result)
        if isinstance(node, ast.Name | ast.Attribute) and not self._is_local(node):
            value = self.frame.find_object(node)
            if type(value) is tuple:
                return _make_inlined_list(tuple(map(_is_inlined_constant, value)))
        return self.translate(node, result)

    def _translate_subscript(self, value: ast.expr, index: ast.expr, result: bool) -> plan.Expr:
        if not isinstance(index, ast.Slice):
            return _make_inlined_builtin("item", self._translate_sequence(value, result), self.translate(index))
        if index.step is not None:
            raise NotTranslatable("uses a slice with a step, which the language does not have")
        bounds = (ast.Constant(None) if bound is None else bound for bound in (index.lower, index.upper))
        return self._make_call("slice", value, *bounds)

    def _translate_call(self, node: ast.Call, result: bool) -> plan.Expr:
        target = self.frame.find_object(node.func)
        text = ast.unparse(node.func)[:40]
        if type(target) is FunctionType:
            return self._translate_helper(node, target, text, result)
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in node.args):
            raise NotTranslatable(f"calls {text} with arguments by name or in a list")
        for function, name, least, most in _FUNCTIONS:
            if target is function and least <= len(node.args) <= most:
                return self._make_call(name, *node.args)
        if target is builtins.bool and len(node.args) == 1:
            return plan.Not(plan.Not(self.translate(node.args[0]), span=NO_SPAN), span=NO_SPAN)
        raise NotTranslatable(f"calls {text}, which the language does not have")

    def _translate_helper(self, node: ast.Call, target: FunctionType, text: str, result: bool) -> plan.Expr:
        """A call of another Python function, with its body."""
        try:
            body = _translate_function_body(target, self.around)
        except (NotTranslatable, Unproven) as refused:
            raise NotTranslatable(f"calls {text}, which {refused}") from None
        if body.gives_tuple and not result:
            raise NotTranslatable(f"calls {text}, which gives a tuple")
        self.gives_tuple |= body.gives_tuple
        named = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg is not None}
        if len(named) < len(node.keywords) or any(isinstance(one, ast.Starred) for one in node.args):
            raise NotTranslatable(f"calls {text} with arguments that cannot be told apart")
        try:
            given = inspect.signature(target, follow_wrapped=False).bind(*node.args, **named).arguments
        except TypeError:
            raise NotTranslatable(f"calls {text} with the wrong arguments") from None
        # Arguments are evaluated in written order; a body that is inlined cannot fail, so their order is free.
        names = (*body.parameters, *(name for name in body.defaults if name not in body.parameters))
        arguments = tuple(self.translate(given[name]) if name in given else body.defaults[name] for name in names)
        whole = replace(body, parameters=names, defaults={})
        function = plan.Function(text, len(names), len(names), "immutable", builtin=False, body=whole)
        return plan.Call(function, arguments, span=NO_SPAN, place=NO_SPAN)


def _make_inlined_list(items: tuple[plan.Expr, ...]) -> plan.Expr:
    if all(isinstance(item, plan.Constant) for item in items):
        value = [item.value for item in items if isinstance(item, plan.Constant)]
        return plan.Constant(value, type_of(value), span=NO_SPAN)
    return plan.MakeList(items, span=NO_SPAN)


def _make_inlined_builtin(name: str, *arguments: plan.Expr) -> plan.Call:
    return plan.Call(find_builtin(name), arguments, span=NO_SPAN, place=NO_SPAN)
