"""Inlining: bodies of Python functions as expressions of the language, which take the place of calls.

`translate_function_body` reads `return <expression>`, a lambda, and chains of `if` that return. It knows the operators
and functions that mean the same in the language and in Python, and refuses everything else with the reason. Whether
both also fail alike depends on the arguments and is decided call by call, by `Inliner`.

The expression is a syntax tree in which a name is a parameter; what helpers compute stands in it in place of their
calls. AND and OR stand where only the truth counts, or where all their parts are bools: elsewhere Python's give one of
their operands, which IF does. Its spans are empty.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from types import FunctionType
from typing import Any

from ss2sql.errors import NOWHERE
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import Resolver
from ss2sql.frontend.resolve.scope import Catalog, Scope
from ss2sql.frontend.syntax import ast as syntax
from ss2sql.frontend.user_functions import FunctionBody
from ss2sql.frontend.volatility.function_names import (
    UNKNOWN,
    Findings,
    FunctionNames,
    FunctionNode,
    Unproven,
    locate_function,
)
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, INT_MAX, INT_MIN, Kind, Type, type_of, unite
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import can_fail, format_type, rebuild_node, walk

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


def translate_function_body(function: Callable[..., Any]) -> FunctionBody | str:
    """The function's body, or the reason why it cannot become part of a query. Nothing is called."""
    try:
        reader = _Translator(function, ())
        tree = reader.translate_body({name: syntax.Name(name, span=NOWHERE) for name in reader.names})
    except Unproven as refused:
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
        raise Unproven("is too long")
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
            raise Unproven("is more than one expression")


def _make_literal(value: Any) -> syntax.Literal:
    """A value that Python and the language have in common."""
    fits = value is None or type(value) in (bool, str)
    fits |= type(value) is int and INT_MIN <= value <= INT_MAX
    fits |= type(value) is float and math.isfinite(value)
    if not fits or type_of(value).may_be(Kind.OBJECT):
        raise Unproven(f"uses a {type(value).__name__}, which the language does not have as a constant")
    return syntax.Literal(value, span=NOWHERE)


class _Translator:
    """Reads one function's expression. `around` are the functions that lead to it."""

    def __init__(self, function: Any, around: tuple[FunctionType, ...]) -> None:
        if type(function) is not FunctionType:
            raise Unproven("is not a function written in Python")
        if function in around or len(around) > MOST_HELPERS:
            raise Unproven("calls functions inside functions too deeply")
        located = locate_function(function)
        if located is None:
            raise Unproven("has no source that can be read")
        arguments = located.node.args
        if arguments.vararg or arguments.kwarg:
            raise Unproven("takes any number of arguments")
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
            raise Unproven("is too long")
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
                return syntax.Not(self.translate(operand, test=True), span=NOWHERE)
            case ast.BoolOp(op=op, values=values):
                return self._translate_and_or(isinstance(op, ast.And), values, test)
            case ast.Compare():
                return self._translate_comparison(node)
            case ast.IfExp(test=condition, body=body, orelse=orelse):
                then, otherwise = self.translate(body, result, test), self.translate(orelse, result, test)
                return syntax.If(self.translate(condition, test=True), (then,), (otherwise,), span=NOWHERE)
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
                raise Unproven(f"uses '{ast.unparse(node)[:40]}', which the language does not have")

    def _make_call(self, name: str, *arguments: ast.expr) -> syntax.Expr:
        return self._make_builtin(name, *map(self.translate, arguments))

    def _make_builtin(self, name: str, *arguments: syntax.Expr) -> syntax.Expr:
        self.uses.add(name)
        return syntax.Call(name, arguments, span=NOWHERE)

    def _translate_and_or(self, both: bool, values: Sequence[ast.expr], test: bool) -> syntax.Expr:
        """Python's `and` or `or`: the operand that decides."""
        parts = [self.translate(value, test=test) for value in values]
        if test or all(map(_gives_bool, values)):
            return (syntax.And if both else syntax.Or)(tuple(parts), span=NOWHERE)
        whole = parts[-1]
        for part in reversed(parts[:-1]):
            then, otherwise = (whole, part) if both else (part, whole)
            whole = syntax.If(part, (then,), (otherwise,), span=NOWHERE)
        return whole

    def _translate_name(self, node: ast.Name | ast.Attribute) -> syntax.Expr:
        if self._is_local(node):
            return self.arguments[ast.unparse(node)]
        value = self.frame.find_object(node)
        if value is UNKNOWN:
            raise Unproven(f"reads '{ast.unparse(node)[:40]}'")
        return _make_literal(value)

    def _is_local(self, node: ast.expr) -> bool:
        if not isinstance(node, ast.Name) or not self.frame.is_local(node.id):
            return False
        if node.id not in self.arguments:
            raise Unproven("is more than one expression")
        return True

    def _translate_comparison(self, node: ast.Compare) -> syntax.Expr:
        operands = (node.left, *node.comparators)
        links = tuple(
            self._translate_link(left, op, right)
            for left, op, right in zip(operands, node.ops, operands[1:], strict=False)
        )
        return links[0] if len(links) == 1 else syntax.And(links, span=NOWHERE)

    def _translate_link(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> syntax.Expr:
        if isinstance(op, ast.Is | ast.IsNot):
            if not any(isinstance(side, ast.Constant) and side.value is None for side in (left, right)):
                raise Unproven(f"compares identities in '{ast.unparse(right)[:40]}'")
            return self._make_call("eq" if isinstance(op, ast.Is) else "ne", left, right)
        if isinstance(op, ast.In | ast.NotIn):
            return self._make_builtin(_COMPARISONS[type(op)], self.translate(left), self._translate_sequence(right))
        return self._make_call(_COMPARISONS[type(op)], left, right)

    def _make_list(self, items: Sequence[ast.expr], result: bool) -> syntax.Expr:
        return syntax.ListLiteral(tuple(self.translate(item, result) for item in items), span=NOWHERE)

    def _translate_sequence(self, node: ast.expr, result: bool = False) -> syntax.Expr:
        """A list; also a tuple that is only searched or indexed, for which a list is equal."""
        if isinstance(node, ast.Tuple):
            return self._make_list(node.elts, result)
        if isinstance(node, ast.Name | ast.Attribute) and not self._is_local(node):
            value = self.frame.find_object(node)
            if type(value) is tuple:
                return syntax.ListLiteral(tuple(map(_make_literal, value)), span=NOWHERE)
        return self.translate(node, result)

    def _translate_subscript(self, value: ast.expr, index: ast.expr, result: bool) -> syntax.Expr:
        if not isinstance(index, ast.Slice):
            return self._make_builtin("item", self._translate_sequence(value, result), self.translate(index))
        if index.step is not None:
            raise Unproven("uses a slice with a step, which the language does not have")
        bounds = (ast.Constant(None) if bound is None else bound for bound in (index.lower, index.upper))
        return self._make_call("slice", value, *bounds)

    def _translate_call(self, node: ast.Call, result: bool, test: bool) -> syntax.Expr:
        target = self.frame.find_object(node.func)
        text = ast.unparse(node.func)[:40]
        if type(target) is FunctionType:
            return self._translate_helper(node, target, text, result, test)
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in node.args):
            raise Unproven(f"calls {text} with arguments by name or in a list")
        for function, name, least, most in _FUNCTIONS:
            if target is function and least <= len(node.args) <= most:
                return self._make_call(name, *node.args)
        if target is builtins.bool and len(node.args) == 1:
            return syntax.Not(syntax.Not(self.translate(node.args[0], test=True), span=NOWHERE), span=NOWHERE)
        raise Unproven(f"calls {text}, which the language does not have")

    def _translate_helper(
        self, node: ast.Call, target: FunctionType, text: str, result: bool, test: bool
    ) -> syntax.Expr:
        """What another Python function computes of the arguments of a call."""
        named = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg is not None}
        if len(named) < len(node.keywords) or any(isinstance(one, ast.Starred) for one in node.args):
            raise Unproven(f"calls {text} with arguments that cannot be told apart")
        try:
            given = inspect.signature(target, follow_wrapped=False).bind(*node.args, **named).arguments
        except TypeError:
            raise Unproven(f"calls {text} with the wrong arguments") from None
        # Arguments are evaluated in written order; a body that is inlined cannot fail, so their order is free.
        arguments = {name: self.translate(value) for name, value in given.items()}
        try:
            helper = _Translator(target, self.around)
            tree = helper.translate_body({**helper.defaults, **arguments}, test)
        except Unproven as refused:
            raise Unproven(f"calls {text}, which {refused}") from None
        if helper.gives_tuple and not result:
            raise Unproven(f"calls {text}, which gives a tuple")
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


# --- the body in the place of one call -----------------------------------------------------------------
# It is resolved like a part of the script, with the arguments in place of its names. The expression counts only if it
# is provably equivalent to the call. No operator in it can fail with the types of these arguments, since its error
# would differ from Python's. No argument can fail or has an effect, and no costly argument is evaluated twice.
#
# The resolver uses the types, so that it can prove as much of `x = move(x)` as of `x = x + 1`; the rewrite `inline`
# uses the expressions.
MOST_INLINED_NODES = 300
# Operations that may be evaluated twice: a few machine instructions, in SQL too.
_CHEAP = frozenset(name for name, row in OPERATIONS.items() if row.cheap)
_CATALOG = Catalog({name: row.make_function() for name, row in OPERATIONS.items()})

ColumnReader = Callable[[plan.Element, str], plan.Column | None]


class NotInlinable(Exception):  # noqa: N818 - it is a finding, not an error
    """The call cannot be inlined; the reason is a clause."""


class _BodyResolver(Resolver):
    """Resolves the body of the function of one call; what is known of its arguments is computed at once.

    `column` reads a column that an element certainly has. The caller guarantees that the arguments fit the parameters.
    """

    def __init__(self, call: plan.Call, column: ColumnReader) -> None:
        super().__init__(_CATALOG)
        self.call = call
        self.column = column
        self.known: dict[int, plan.Expr] = {}  # by the identity of the tree, of which parts are shared

    def build_expr(self) -> plan.Expr:
        """The expression for the call."""
        body: FunctionBody = self.call.function.body
        args = {name: super(_BodyResolver, self).resolve_expr(value, None) for name, value in body.defaults.items()}
        names = (*body.parameters, *(name for name in args if name not in body.parameters))
        args.update(zip(names, self.call.arguments, strict=False))
        for name, argument in args.items():
            if argument.type.may_be(Kind.OBJECT) or not argument.type.kinds:
                raise NotInlinable(f"nothing is known of the argument '{name}'")
        expr = self.record_errors(self.resolve_expr, body.tree, Scope(None, 0, columns=args))
        if self.errors:
            raise NotInlinable(self.errors[0].message)
        if next(islice(walk(expr), MOST_INLINED_NODES, None), None) is not None:
            raise NotInlinable("it would become too long an expression")
        _check_uses(self.call.arguments, expr)
        return replace(expr, span=self.call.span) if isinstance(expr, plan.Constant) else expr

    def resolve_expr(self, tree: syntax.Expr, scope: Scope | None) -> plan.Expr:
        """The plan of a part of the body. Expressions from Python have no place, so they get that of the call."""
        if isinstance(tree, syntax.Name):
            return super().resolve_expr(tree, scope)
        if id(tree) not in self.known:
            expr = super().resolve_expr(tree, scope)
            if isinstance(expr, plan.Call) and expr.span is NOWHERE:
                expr = replace(self._check_call(expr), span=self.call.span, place=self.call.place)
            elif not isinstance(expr, plan.Constant) and expr.span is NOWHERE:
                expr = replace(expr, span=self.call.span)
            self.known[id(tree)] = self._simplify(expr)
        return self.known[id(tree)]

    def resolve_if(self, tree: syntax.If, scope: Scope | None) -> plan.Expr:
        """The choice; of a known condition, usually a default, one branch alone: the other may be invalid."""
        condition = self.resolve_expr(tree.condition, scope)
        if isinstance(condition, plan.Constant):
            return self.resolve_expr((tree.then if condition.value else tree.otherwise)[0], scope)
        then, otherwise = self.resolve_expr(tree.then[0], scope), self.resolve_expr(tree.otherwise[0], scope)
        return plan.If(condition, (then,), (otherwise,), unite((then.type, otherwise.type)), span=tree.span)

    def _check_call(self, call: plan.Call) -> plan.Call:
        """Raises NotInlinable for a call that can fail, or compares what Python compares in another way."""
        name, types = call.function.name, [argument.type for argument in call.arguments]
        if name == "item" and self._pick_element(call) is not None:
            return call
        if name in ("eq", "ne", "in", "not_in") and not _has_inlined_comparison(name, call.arguments, types):
            raise NotInlinable(f"it compares {' and '.join(map(format_type, types))}, where objects may be inside")
        if name == "distance" and not all(kind.is_only(Kind.LIST) for kind in types):
            raise NotInlinable("it measures the distance of what may be no lists")
        if call.function.raises:
            raise NotInlinable(f"'{name}' can fail on {' and '.join(map(format_type, types))}")
        return call

    def _simplify(self, expr: plan.Expr) -> plan.Expr:
        """The expression, or its value if that is known."""
        match expr:
            case plan.MakeList(items=items) if not all(_is_plain_to_inline(item.type) for item in items):
                raise NotInlinable("it puts a value into a list that may be nested too deeply or hold objects")
            case plan.Call(function=function, arguments=arguments):
                if all(isinstance(argument, plan.Constant) for argument in arguments):
                    value = OPERATIONS[function.name].value
                    assert value is not None
                    return _make_constant(value(*(one.value for one in arguments if isinstance(one, plan.Constant))))
                return (self._pick_element(expr) if function.name == "item" else None) or expr
            case plan.Not(operand=plan.Constant(value=value)):
                return _make_constant(not value)
            case _:
                return expr

    def _pick_element(self, call: plan.Call) -> plan.Expr | None:
        """An element with a known position: of a list literal, or a column of a row."""
        match call.arguments:
            case plan.MakeList(items=items), plan.Constant(value=int(place)) if -len(items) <= place < len(items):
                return items[place]
            case plan.Element() as element, plan.Constant(value=str(name)):
                return self.column(element, name)
            case _:
                return None


def _make_constant(value: Any) -> plan.Constant:
    return plan.Constant(value, type_of(value), span=NOWHERE)


def _is_plain_to_inline(kind: Type) -> bool:
    """Whether the values are scalars, or lists of scalars down to a depth that the type describes."""
    if kind.may_be(Kind.OBJECT | Kind.DICT):
        return False
    return not kind.may_be(Kind.LIST) or (kind.element is not None and _is_plain_to_inline(kind.element))


def _has_inlined_comparison(name: str, arguments: tuple[plan.Expr, ...], types: list[Type]) -> bool:
    """Whether `==` or `in` compares without methods of objects and without unhashable keys of dicts."""
    if name in ("eq", "ne") and any(isinstance(one, plan.Constant) and one.value is None for one in arguments):
        return not any(kind.may_be(Kind.OBJECT) for kind in types)
    return all(map(_is_plain_to_inline, types))


# --- how often arguments are evaluated -----------------------------------------------------------------


def _check_uses(arguments: tuple[plan.Expr, ...], expr: plan.Expr) -> None:
    """Raises NotInlinable where an argument's failure or effect could move, or costly work be done twice."""
    uses = Counter(map(id, walk(expr)))
    for atom in (atom for argument in arguments for atom in _split_inlined_lists(argument)):
        if _is_delicate_to_inline(atom):
            raise NotInlinable("an argument can fail, or be noticed")
        if uses[id(atom)] > 1 and not _is_cheap_to_inline(atom):
            raise NotInlinable("a costly argument would be evaluated more than once")


def _split_inlined_lists(argument: plan.Expr) -> Iterator[plan.Expr]:
    """The parts of an argument with list literals taken apart, without constants."""
    if isinstance(argument, plan.MakeList):
        for item in argument.items:
            yield from _split_inlined_lists(item)
    elif not isinstance(argument, plan.Constant):
        yield argument


def _is_delicate_to_inline(atom: plan.Expr) -> bool:
    """Whether it matters where and how often the expression is evaluated."""
    noticed = (plan.Aggregate, plan.Temporal, plan.Subquery, plan.Eval)
    return can_fail(atom) or any(isinstance(part, noticed) for part in walk(atom))


def _is_cheap_to_inline(atom: plan.Expr) -> bool:
    for part in walk(atom):
        match part:
            case plan.Call(function=function):
                if not function.builtin or function.name not in _CHEAP:
                    return False
            case plan.Element(type=kind):
                if kind.may_be(Kind.DICT):  # every read of a table's row builds a dict
                    return False
            case plan.MakeList():
                return False
    return True


# --- the calls of a plan -------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class InlinedCall:
    """What became of one call: `reason` is why it is not inlined."""

    function: plan.Function
    reason: str | None = None


class Inliner:
    """Replaces calls by bodies. `sources` are those that elements belong to, by their numbers.

    `sites` records what became of each call, by its place in the script.
    """

    def __init__(self) -> None:
        self.sources: dict[int, plan.Source] = {}
        self.sites: dict[tuple[int, int, str], InlinedCall] = {}
        self._known: dict[int, tuple[Any, Any]] = {}

    def inline_calls(self, node: Any) -> Any:
        """The node with every possible call in it inlined."""
        known = self._known.get(id(node))
        if known is not None:
            return known[1]
        changed = rebuild_node(node, self.inline_calls)
        if isinstance(changed, plan.Call) and changed.function.body is not None:
            changed = self.inline_call(changed)
        return self._cache_result(node, changed)

    def _cache_result(self, node: Any, changed: Any) -> Any:
        """Caches the result for a node by its identity, and keeps the node alive for that."""
        self._known[id(node)] = (node, changed)
        return changed

    def refine_type(self, call: plan.Call) -> plan.Call:
        """The call of a function whose body is known, with the type of the inlined expression, if any."""
        changed = self.inline_calls(replace(call, type=ANY))
        call = replace(call, type=changed.type)
        self._cache_result(call, changed)
        return call

    def inline_call(self, call: plan.Call) -> plan.Expr:
        """The replacement of a call whose arguments are already processed."""
        place = (id(call.span.source), call.span.start, call.function.name)
        try:
            result = _BodyResolver(call, self._find_column).build_expr()
        except NotInlinable as refused:
            self.sites[place] = InlinedCall(call.function, str(refused))
            return call
        self.sites[place] = InlinedCall(call.function)
        return result

    def _find_column(self, element: plan.Element, name: str) -> plan.Column | None:
        """The column of a row that certainly has it."""
        source = self.sources.get(element.source)
        kind = dict(source.columns or ()).get(name) if source is not None else None
        if source is None or kind is None or not kind.kinds or kind.may_be(Kind.OBJECT):
            return None
        if not isinstance(source, plan.TableSource):
            made = isinstance(source, plan.QuerySource) and source.query.representation.name == "dict"
            # A key that an element lacks counts as None.
            if not source.element.is_only(Kind.DICT) or (kind.may_be(Kind.NONE) and not made):
                return None
        return plan.Column(source.id, name, kind, span=element.span)
