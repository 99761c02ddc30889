"""What rewrites share: going through a plan, making new nodes, and what they may ask of the session.

A rewrite makes calls of built-in operators. Where the user has replaced one, its name belongs to the user's
function, so none is made then.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import field, replace
from marshal import dumps
from types import NoneType
from typing import Any, TypeVar

from ss2sql.errors import Error, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, Kind, Type, is_flag, is_supertype, type_of
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import join_conditions, rebuild_node
from ss2sql.language.values import get_truth
from ss2sql.lowering.guards import is_in_order

Node = TypeVar("Node")

NEGATED_COMPARISONS = {name: row.negated for name, row in OPERATIONS.items() if row.negated}
COMPARISONS = frozenset(NEGATED_COMPARISONS)
PLAIN_READS = (plan.Column, plan.Element, plan.State, plan.Variable, plan.Constant)  # it costs nothing to repeat them


def rewrite_bottom_up(node: Node, change: Callable[[Any], Any]) -> Node:
    """The node with `change` applied to every node below it, innermost first, and then to itself."""
    changed: Node = change(rewrite_parts(node, lambda part: rewrite_bottom_up(part, change)))
    return changed


def rewrite_parts(node: Any, change: Callable[[Any], Any]) -> Any:
    """The node with `change` applied to every node directly inside it.

    Columns of queries in FROM, and group values, keep to a type that is bool alone, or is not: those who read them
    go by their type, and a bool travels in another form through SQL.
    """
    new = rebuild_node(node, change)
    if new is not node and isinstance(node, plan.QuerySource):
        pairs = zip(node.query.columns, new.query.columns, strict=True)
        columns = tuple(after if _has_same_form(before.expr, after.expr) else before for before, after in pairs)
        new = replace(new, query=replace(new.query, columns=columns))
    if new is not node and isinstance(node, plan.Query) and new.group:
        groups = zip(node.group, new.group, strict=True)
        new = replace(new, group=tuple(after if _has_same_form(before, after) else before for before, after in groups))
    return new


def _has_same_form(one: plan.Expr, other: plan.Expr) -> bool:
    return is_flag(one.type) == is_flag(other.type)


def make_constant(value: Any, span: Span) -> plan.Constant:
    return plan.Constant(value, type_of(value), span=span)


def list_items(expr: plan.Expr) -> tuple[plan.Expr, ...]:
    """The items of a list that is written as one or is a constant; none of any other expression."""
    match expr:
        case plan.MakeList(items=items):
            return items
        case plan.Constant(value=list() as values):
            return tuple(make_constant(value, expr.span) for value in values)
        case _:
            return ()


def rewrite_to_bool(expr: plan.Expr) -> plan.Expr:
    if expr.type.is_only(Kind.BOOL):
        return expr
    return plan.Not(plan.Not(expr, BOOL, span=expr.span), BOOL, span=expr.span)


def make_connective(kind: type[plan.And | plan.Or], parts: list[plan.Expr], span: Span) -> plan.Expr:
    """The parts as one condition; AND of none is True, OR False."""
    return join_conditions(kind, parts, span) if parts else make_constant(kind is plan.And, span)


def make_call(name: str, *arguments: plan.Expr, span: Span) -> plan.Call:
    row, types = OPERATIONS[name], tuple(argument.type for argument in arguments)
    return plan.Call(row.make_function(types), arguments, row.result(types), span=span, place=span)


def retype_call(call: plan.Call, keeps_failing: bool = False) -> plan.Call:
    """The call of a built-in function with the type that it has for its present arguments.

    What cannot fail for them never can, unless it `keeps_failing`.
    """
    row, types = OPERATIONS[call.function.name], tuple(argument.type for argument in call.arguments)
    raises = call.function.raises and (keeps_failing or row.can_fail(types))
    return replace(call, type=row.result(types), function=replace(call.function, raises=raises))


def negate_expression(expr: plan.Expr) -> plan.Expr:
    """An expression that is true where the other is false; whatever fails in the one fails in the other.

    The caller makes sure that the comparisons are not replaced.
    """
    match expr:
        case plan.Constant():
            return make_constant(not get_truth(expr.value), expr.span)
        case plan.Not(operand=operand):
            return operand
        case plan.And(parts=parts) if not is_in_order(parts):  # AND guards them, OR in SQL does not
            return plan.Or(tuple(map(negate_expression, parts)), span=expr.span)
        case plan.Or(parts=parts):
            return plan.And(tuple(map(negate_expression, parts)), span=expr.span)
        case plan.Call(function=function) if (
            function.builtin and function.name in NEGATED_COMPARISONS and not function.raises
        ):
            return replace(expr, function=replace(function, name=NEGATED_COMPARISONS[function.name]))
        case _:
            return plan.Not(expr, span=expr.span)


# --- what rewrites may ask of the session: values of script variables, and the meaning of texts for `eval`
MAX_ELEMENTS = 1_000
_PLAIN = frozenset({NoneType, bool, int, float, str})
_NO_VARIABLES: dict[str, Any] = {}


@dataclass(slots=True)
class RewriteContext:
    """The session while one query is rewritten, and what the rewritten query relies on."""

    variable: Callable[[str], Any] = _NO_VARIABLES.__getitem__  # raises where the value is unknown
    read: Callable[[str, Any], plan.Expr | None] = lambda text, scope: None  # resolves a text of `eval`
    replaced: Collection[str] = ()  # names of functions of the user
    fixed: bool = True
    lists: dict[str, bytes | None] = field(default_factory=dict)  # fingerprints of the values that it relies on
    types: dict[str, Type] = field(default_factory=dict)  # the types of the variables that texts of `eval` mention

    def get_list(self, name: str) -> list[Any] | None:
        """The value of a variable if it is a short list of plain values; the query then relies on it."""
        if not self.fixed:
            return None
        value = _get_folded_variable(self.variable, name)
        known = self.lists[name] = make_folded_list_key(value)
        return None if known is None else list(value)

    def forget_values(self) -> None:
        """Relies on no values: the query may change its variables itself.

        That a list is not known is still relied on: with its value, texts could be read that may change variables.
        """
        self.fixed = False
        self.lists = {name: None for name, known in self.lists.items() if known is None}

    def is_still_valid(self, variable: Callable[[str], Any]) -> bool:
        """Whether all that the query relies on is so, with the values that `variable` gives."""
        for name, known in self.lists.items():
            if make_folded_list_key(_get_folded_variable(variable, name)) != known:
                return False
        for name, kind in self.types.items():
            try:
                if not is_supertype(kind, type_of(variable(name))):
                    return False
            except (Error, KeyError):
                return False
        return True


def _get_folded_variable(variable: Callable[[str], Any], name: str) -> Any:
    try:
        return variable(name)
    except (Error, KeyError):
        return None


def make_folded_list_key(value: Any) -> bytes | None:
    """What tells a short list of plain values from all others, 1 from 1.0 and True too; None for any other value."""
    if type(value) is not list or len(value) > MAX_ELEMENTS or not is_foldable_value(value):
        return None
    return dumps(value, 2)


def is_foldable_value(value: Any) -> bool:
    """Whether the value is None, a bool, a number, a string, or a list of such values."""
    return type(value) in _PLAIN or (type(value) is list and all(map(is_foldable_value, value)))
