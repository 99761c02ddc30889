"""Inlining: calls of functions with known bodies, replaced by the bodies with the arguments in place of the parameters.

The expression is made only if it is provably equivalent to the call. No operator in it can fail with the types of
these arguments, since its error would differ from Python's. No argument can fail or has an effect, and no costly
argument is evaluated twice. Types of the result are those that the resolver would have found.

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
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind, Type, make_list_type, type_of, unite
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import (
    can_fail,
    format_type,
    list_parts,
    rebuild_node,
    walk,
)

NO_SPAN = Span(Source(""), 0, 0)
MOST_NODES = 300
# Operations that may be evaluated twice: a few machine instructions, in SQL too.
_CHEAP = frozenset(name for name, row in OPERATIONS.items() if row.cheap)

Args = Mapping[str, plan.Expr]
ColumnReader = Callable[[plan.Element, str], plan.Column | None]


@dataclass(frozen=True, slots=True)
class FunctionBody:
    """A function as an expression of its parameters."""

    parameters: tuple[str, ...]
    defaults: Mapping[str, plan.Constant]  # values of parameters that a call may leave out
    expr: plan.Expr
    text: str  # the expression as Python writes it
    uses: frozenset[str]  # the built-in functions in it
    gives_tuple: bool  # a result may be a tuple, which becomes a list outside of Python


def find_builtin(name: str) -> plan.Function:
    """A built-in function as the plan knows it."""
    return OPERATIONS[name].make_function()


class NotInlinable(Exception):  # noqa: N818 - it is a finding, not an error
    """The call cannot be inlined; the reason is a clause."""


class InlinedBody:
    """The expression for one call.

    `column` reads a column that an element certainly has. The caller guarantees that the arguments fit the parameters.
    """

    def __init__(self, call: plan.Call, column: ColumnReader) -> None:
        body: FunctionBody = call.function.body
        self.span: Span = call.span
        self.place: Span = call.place
        self.column = column
        names = (*body.parameters, *(name for name in body.defaults if name not in body.parameters))
        args: dict[str, plan.Expr] = {**body.defaults, **dict(zip(names, call.arguments, strict=False))}
        for name, argument in args.items():
            if argument.type.may_be(Kind.OBJECT) or not argument.type.kinds:
                raise NotInlinable(f"nothing is known of the argument '{name}'")
        built = self._build_expr(body.expr, args)
        # Expressions from Python have no place in the script, so all get the place of the call.
        self.expr = replace(built, span=call.span) if isinstance(built, plan.Constant) else built
        _check_inlined_size(self.expr)
        _check_uses(call.arguments, self.expr)

    # --- building --------------------------------------------------------------------------------------

    def _build_expr(self, node: plan.Expr, args: Args, test: bool = False) -> plan.Expr:
        """The instance of a part of the body; with `test` only its truth matters."""
        match node:
            case plan.Constant():
                return node
            case plan.Variable(name=name):
                return args[name]
            case plan.Call(function=function, arguments=arguments):
                built = tuple(self._build_expr(argument, args) for argument in arguments)
                if function.builtin:
                    return self._build_call(function.name, built)
                body: FunctionBody = function.body
                return self._build_expr(body.expr, dict(zip(body.parameters, built, strict=True)), test)
            case plan.And(parts=tested) | plan.Or(parts=tested):
                built = tuple(self._build_expr(part, args, test) for part in tested)
                return self._build_and_or(isinstance(node, plan.And), built, test)
            case plan.Not(operand=operand):
                denied = self._build_test(operand, args)
                if isinstance(denied, plan.Constant):
                    return self._build_constant(not denied.value)
                return plan.Not(denied, span=self.span)
            case plan.If(condition=condition, then=(then,), otherwise=(otherwise,)):
                return self._build_choice(self._build_test(condition, args), then, otherwise, args, test)
            case _:
                assert isinstance(node, plan.MakeList), "bodies have no other parts"
                return self._build_list(tuple(self._build_expr(item, args) for item in node.items))

    def _build_test(self, node: plan.Expr, args: Args) -> plan.Expr:
        return self._build_expr(node, args, test=True)

    def _build_and_or(self, both: bool, tested: tuple[plan.Expr, ...], test: bool) -> plan.Expr:
        """Python's `and` or `or`: the operand that decides."""
        if test or all(part.type.is_only(Kind.BOOL) for part in tested):
            return self._build_condition(both, tested)
        result = tested[-1]
        for part in reversed(tested[:-1]):
            result = self._build_if(part, result, part) if both else self._build_if(part, part, result)
        return result

    def _build_condition(self, both: bool, tested: tuple[plan.Expr, ...]) -> plan.Expr:
        """The conjunction (`both`) or disjunction of conditions; constants are folded."""
        known = [bool(part.value) for part in tested if isinstance(part, plan.Constant)]
        if (not both) in known:
            return self._build_constant(not both)
        open_parts = tuple(part for part in tested if not isinstance(part, plan.Constant))
        if not open_parts:
            return self._build_constant(both)
        if len(open_parts) == 1:
            return open_parts[0]
        return (plan.And if both else plan.Or)(open_parts, span=self.span)

    def _build_if(self, condition: plan.Expr, then: plan.Expr, otherwise: plan.Expr) -> plan.Expr:
        if isinstance(condition, plan.Constant):
            return then if condition.value else otherwise
        kind = unite((then.type, otherwise.type))
        return plan.If(condition, (then,), (otherwise,), kind, span=self.span)

    def _build_choice(
        self, condition: plan.Expr, then: plan.Expr, otherwise: plan.Expr, args: Args, test: bool
    ) -> plan.Expr:
        if isinstance(condition, plan.Constant):  # usually a default; the other branch may be invalid
            return self._build_expr(then if condition.value else otherwise, args, test)
        return self._build_if(condition, self._build_expr(then, args, test), self._build_expr(otherwise, args, test))

    def _build_list(self, items: tuple[plan.Expr, ...]) -> plan.Expr:
        types = [item.type for item in items]
        if not all(map(_is_plain_to_inline, types)):
            raise NotInlinable("it puts a value into a list that may be nested too deeply or hold objects")
        if all(isinstance(item, plan.Constant) for item in items):
            return self._build_constant([item.value for item in items if isinstance(item, plan.Constant)])
        return plan.MakeList(items, make_list_type(types), span=self.span)

    def _build_constant(self, value: Any) -> plan.Expr:
        return plan.Constant(value, type_of(value), span=NO_SPAN)

    def _build_call(self, name: str, arguments: tuple[plan.Expr, ...]) -> plan.Expr:
        picked = self._pick_inlined_element(*arguments) if name == "item" else None
        if picked is not None:
            return picked
        types = tuple(argument.type for argument in arguments)
        if name in ("eq", "ne", "in", "not_in") and not _has_inlined_comparison(name, arguments, types):
            raise NotInlinable(f"it compares {' and '.join(map(format_type, types))}, where objects may be inside")
        row = OPERATIONS[name]
        if name == "distance" and not all(kind.is_only(Kind.LIST) for kind in types):
            raise NotInlinable("it measures the distance of what may be no lists")
        if row.can_fail(types):
            raise NotInlinable(f"'{name}' can fail on {' and '.join(map(format_type, types))}")
        if all(isinstance(argument, plan.Constant) for argument in arguments):
            assert row.value is not None
            values = (argument.value for argument in arguments if isinstance(argument, plan.Constant))
            return self._build_constant(row.value(*values))
        return plan.Call(row.make_function(types), arguments, row.result(types), span=self.span, place=self.place)

    def _pick_inlined_element(self, container: plan.Expr, index: plan.Expr) -> plan.Expr | None:
        """An element with a known position: of a list literal, or a column of a row."""
        match container, index:
            case plan.MakeList(items=items), plan.Constant(value=int(place)) if -len(items) <= place < len(items):
                return items[place]
            case plan.Element(), plan.Constant(value=str(name)):
                return self.column(container, name)
            case _:
                return None


def _is_plain_to_inline(kind: Type) -> bool:
    """Whether the values are scalars, or lists of scalars down to a depth that the type describes."""
    if kind.may_be(Kind.OBJECT | Kind.DICT):
        return False
    return not kind.may_be(Kind.LIST) or (kind.item is not None and _is_plain_to_inline(kind.item))


def _has_inlined_comparison(name: str, arguments: tuple[plan.Expr, ...], types: tuple[Type, ...]) -> bool:
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
            result = InlinedBody(call, self._find_column).expr
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
