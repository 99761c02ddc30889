"""Inlining: calls of functions with known bodies, replaced by the bodies with the arguments in place of the parameters.

The body is resolved like a part of the script, with the arguments in place of its names. The expression counts only if
it is provably equivalent to the call. No operator in it can fail with the types of these arguments, since its error
would differ from Python's. No argument can fail or has an effect, and no costly argument is evaluated twice.

The resolver uses the types, so that it can prove as much of `x = move(x)` as of `x = x + 1`; the rewrite `inline` uses
the expressions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from ss2sql.errors import Source, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import Resolver
from ss2sql.frontend.resolve.scope import Catalog, Scope
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind, Type, type_of, unite
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import can_fail, format_type, list_parts, rebuild_node, walk

NO_SPAN = Span(Source(""), 0, 0)
MOST_NODES = 300
# Operations that may be evaluated twice: a few machine instructions, in SQL too.
_CHEAP = frozenset(name for name, row in OPERATIONS.items() if row.cheap)
_CATALOG = Catalog({name: row.make_function() for name, row in OPERATIONS.items()})

ColumnReader = Callable[[plan.Element, str], plan.Column | None]


@dataclass(frozen=True, slots=True)
class FunctionBody:
    """A function as an expression of its parameters."""

    parameters: tuple[str, ...]
    defaults: Mapping[str, ast.Literal]  # values of parameters that a call may leave out
    tree: ast.Expr
    text: str  # the expression as Python writes it
    uses: frozenset[str]  # the built-in functions in it


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
        _check_inlined_size(expr)
        _check_uses(self.call.arguments, expr)
        return replace(expr, span=self.call.span) if isinstance(expr, plan.Constant) else expr

    def resolve_expr(self, tree: ast.Expr, scope: Scope | None) -> plan.Expr:
        """The plan of a part of the body. Expressions from Python have no place, so they get that of the call."""
        if isinstance(tree, ast.Name):
            return super().resolve_expr(tree, scope)
        if id(tree) not in self.known:
            expr = super().resolve_expr(tree, scope)
            if isinstance(expr, plan.Call) and expr.span is NO_SPAN:
                expr = replace(self._check_call(expr), span=self.call.span, place=self.call.place)
            elif not isinstance(expr, plan.Constant) and expr.span is NO_SPAN:
                expr = replace(expr, span=self.call.span)
            self.known[id(tree)] = self._simplify(expr)
        return self.known[id(tree)]

    def resolve_if(self, tree: ast.If, scope: Scope | None) -> plan.Expr:
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
    return plan.Constant(value, type_of(value), span=NO_SPAN)


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


def _check_inlined_size(expr: plan.Expr) -> None:
    """Raises NotInlinable for an expression that is too long as text; in memory its parts are shared."""
    sizes: dict[int, int] = {}

    def measure_size(node: Any) -> int:
        if id(node) not in sizes:
            sizes[id(node)] = 1 + sum(map(measure_size, list_parts(node)))
        return sizes[id(node)]

    if measure_size(expr) > MOST_NODES:
        raise NotInlinable("it would become too long an expression")


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


# --- inlining: calls of functions with known bodies, replaced by the expressions that they compute
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
        """A call with the type of the inlined expression, if any."""
        if call.function.body is None:
            return call
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
