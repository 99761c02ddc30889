"""Inlining: calls of functions with known bodies, replaced by the bodies with the arguments in place of the parameters.

The expression is made only if it is provably equivalent to the call. No operator in it can fail with the types of
these arguments, since its error would differ from Python's. No argument can fail or has an effect, and no costly
argument is evaluated twice. Types of the result are those that the resolver would have found.

The resolver uses the types, so that it can prove as much of `x = move(x)` as of `x = x + 1`; the rewrite `inline` uses
the expressions. Integers beyond 64 bits and infinite floats are errors of the function, so where only large numbers
prevent inlining, the call remains for them:

    IF(x <= limit AND x >= -limit; x + 1; inc(x))
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from ss2sql.errors import Source, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, BOOL, Kind, Type, drop_bounds, make_list_type, type_of, unite
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import (
    can_fail,
    format_type,
    join_conditions,
    list_parts,
    rebuild_node,
    walk,
)

NO_SPAN = Span(Source(""), 0, 0)
MOST_NODES = 300
NUMBER = Kind.INT | Kind.FLOAT
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
    """The call cannot be inlined; the reason is a clause. `fallible`: because an operator can fail."""

    def __init__(self, reason: str, fallible: bool = False) -> None:
        super().__init__(reason)
        self.fallible = fallible


class Instance:
    """The expression for one call.

    `column` reads a column that an element certainly has. With a `limit`, numbers from outside the body are taken to
    lie within -limit..limit; `limited` are those that needed it. The caller
    guarantees that the arguments fit the parameters.
    """

    def __init__(self, call: plan.Call, column: ColumnReader, limit: int | None = None) -> None:
        body: FunctionBody = call.function.body
        self.span: Span = call.span
        self.place: Span = call.place
        self.column = column
        self.limit = limit
        self.limited: dict[int, plan.Expr] = {}
        self._own: dict[int, plan.Expr] = {}  # made from the body, kept alive because lookups go by identity
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

    def infer_type(self, expr: plan.Expr) -> Type:
        """The type of an expression for numbers within the limit."""
        kind = expr.type
        if self.limit is None or id(expr) in self._own or kind.is_bounded(self.limit):
            return kind
        if isinstance(expr, plan.Constant) or not kind.is_only(NUMBER):
            return kind
        self.limited[id(expr)] = expr
        low = -self.limit if kind.low is None else max(kind.low, -self.limit)
        high = self.limit if kind.high is None else min(kind.high, self.limit)
        return replace(kind, low=low, high=high)

    # --- building --------------------------------------------------------------------------------------

    def _remember_node(self, expr: plan.Expr) -> plan.Expr:
        self._own[id(expr)] = expr
        return expr

    def _build_expr(self, node: plan.Expr, args: Args, test: bool = False) -> plan.Expr:
        """The instance of a part of the body; with `test` only its truth matters."""
        match node:
            case plan.Constant():
                return self._remember_node(node)
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
                return self._remember_node(plan.Not(denied, span=self.span))
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
        return self._remember_node((plan.And if both else plan.Or)(open_parts, span=self.span))

    def _build_if(self, condition: plan.Expr, then: plan.Expr, otherwise: plan.Expr) -> plan.Expr:
        if isinstance(condition, plan.Constant):
            return then if condition.value else otherwise
        kind = unite((self.infer_type(then), self.infer_type(otherwise)))
        return self._remember_node(plan.If(condition, (then,), (otherwise,), kind, span=self.span))

    def _build_choice(
        self, condition: plan.Expr, then: plan.Expr, otherwise: plan.Expr, args: Args, test: bool
    ) -> plan.Expr:
        if isinstance(condition, plan.Constant):  # usually a default; the other branch may be invalid
            return self._build_expr(then if condition.value else otherwise, args, test)
        return self._build_if(condition, self._build_expr(then, args, test), self._build_expr(otherwise, args, test))

    def _build_list(self, items: tuple[plan.Expr, ...]) -> plan.Expr:
        types = [self.infer_type(item) for item in items]
        if not all(map(_is_plain_to_inline, types)):
            raise NotInlinable("it puts a value into a list that may be nested too deeply or hold objects")
        if all(isinstance(item, plan.Constant) for item in items):
            return self._build_constant([item.value for item in items if isinstance(item, plan.Constant)])
        return self._remember_node(plan.MakeList(items, make_list_type(types), span=self.span))

    def _build_constant(self, value: Any) -> plan.Expr:
        return self._remember_node(plan.Constant(value, type_of(value), span=NO_SPAN))

    def _build_call(self, name: str, arguments: tuple[plan.Expr, ...]) -> plan.Expr:
        picked = self._pick_inlined_element(*arguments) if name == "item" else None
        if picked is not None:
            return picked
        types = tuple(map(self.infer_type, arguments))
        if name in ("eq", "ne", "in", "not_in") and not _has_inlined_comparison(name, arguments, types):
            raise NotInlinable(f"it compares {' and '.join(map(format_type, types))}, where objects may be inside")
        row = OPERATIONS[name]
        if name == "distance" and not all(kind.is_only(Kind.LIST) for kind in types):
            raise NotInlinable("it measures the distance of what may be no lists")
        if row.can_fail(types):
            raise NotInlinable(f"'{name}' can fail on {' and '.join(map(format_type, types))}", fallible=True)
        if all(isinstance(argument, plan.Constant) for argument in arguments):
            assert row.value is not None
            values = (argument.value for argument in arguments if isinstance(argument, plan.Constant))
            return self._build_constant(row.value(*values))
        made = plan.Call(row.make_function(types), arguments, row.result(types), span=self.span, place=self.place)
        return self._remember_node(made)

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


def is_repeatable(argument: plan.Expr) -> bool:
    """Whether evaluating the argument more than once is cheap and has no effect."""
    return all(
        _is_cheap_to_inline(atom) and not _is_delicate_to_inline(atom) for atom in _split_inlined_lists(argument)
    )


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
# Sums, products of two and of more stay within 64 bits where their parts stay within these.
LIMITS = (10**15, 10**9, 10**6, 10**4)


@dataclass(frozen=True, slots=True)
class InlinedCall:
    """What became of one call: `limit` is the size of numbers up to which it is inlined, `reason` why it is not."""

    function: plan.Function
    limit: int | None = None
    reason: str | None = None


class Inliner:
    """Replaces calls by bodies. `sources` are those that elements belong to, by their numbers.

    `sites` records what became of each call, by its place in the script.
    """

    def __init__(self) -> None:
        self.sources: dict[int, plan.Source] = {}
        self.sites: dict[tuple[int, int, str], InlinedCall] = {}
        self._known: dict[int, tuple[Any, Any]] = {}
        self._read: dict[tuple[int, str, Type], plan.Column] = {}

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
        limit: int | None = None
        reason: str | None = None
        result: plan.Expr | None = None
        try:
            result = Instance(call, self._find_column).expr
        except NotInlinable as refused:
            reason = str(refused)
            if refused.fallible:
                limit, result = self._inline_within_limit(call)
        place = (id(call.span.source), call.span.start, call.function.name)
        self.sites[place] = InlinedCall(call.function, limit, reason if result is None else None)
        return call if result is None else result

    def _inline_within_limit(self, call: plan.Call) -> tuple[int | None, plan.Expr | None]:
        """The call inlined for numbers within a limit, with the limit; None where no limit suffices."""
        if not all(map(is_repeatable, call.arguments)):
            return None, None
        for limit in LIMITS:
            try:
                return limit, _choose_inlined_by_limit(call, Instance(call, self._find_column, limit), limit)
            except NotInlinable:
                continue
        return None, None

    def _find_column(self, element: plan.Element, name: str) -> plan.Column | None:
        """The column of a row that certainly has it; always the same node, because limits go by identity."""
        source = self.sources.get(element.source)
        kind = dict(source.columns or ()).get(name) if source is not None else None
        if source is None or kind is None or not kind.kinds or kind.may_be(Kind.OBJECT):
            return None
        if not isinstance(source, plan.TableSource):
            made = isinstance(source, plan.QuerySource) and source.query.representation.name == "dict"
            # A key that an element lacks counts as None.
            if not source.element.is_only(Kind.DICT) or (kind.may_be(Kind.NONE) and not made):
                return None
        return self._read.setdefault((source.id, name, kind), plan.Column(source.id, name, kind, span=element.span))


def _choose_inlined_by_limit(call: plan.Call, instance: Instance, limit: int) -> plan.Expr:
    """The inlined expression for numbers within the limit, the call for all others."""
    bounds = {
        "le": plan.Constant(limit, type_of(limit), span=NO_SPAN),
        "ge": plan.Constant(-limit, type_of(-limit), span=NO_SPAN),
    }
    conditions: list[plan.Expr] = []
    for number in instance.limited.values():
        low, high = number.type.low, number.type.high
        needed = {"le": high is None or high > limit, "ge": low is None or low < -limit}
        for name in (name for name, counts in needed.items() if counts):
            function = replace(find_builtin(name), raises=False)
            conditions.append(plan.Call(function, (number, bounds[name]), BOOL, span=call.span, place=call.place))
    # Beyond the limit the function gives the same kinds of values, or an error.
    kind = instance.expr.type
    kind = kind if kind.is_only(Kind.BOOL) else drop_bounds(kind)
    rest = replace(call, function=replace(call.function, body=None), type=kind)
    condition = join_conditions(plan.And, conditions, call.span)
    return plan.If(condition, (instance.expr,), (rest,), unite((instance.expr.type, kind)), span=call.span)
