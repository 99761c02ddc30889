"""`lookup` by what is computed: an equality that one side of which reads one list alone is looked up in its copy.

    SELECT n.this, e.this FROM n = ns, e = es WHERE abs(e.x) == n.this

    WITH e_once AS MATERIALIZED (SELECT e.rowid, e.this, abs_of(e.x, '1:50') AS abs FROM elements_x(:es) AS e)
    SELECT n.this, e.this FROM elements(:ns) AS n CROSS JOIN e_once AS e
    WHERE NOT e.rowid IS NULL AND e.abs = n.this

So the side is computed once for each element, and SQLite makes an index of it. Where the types do not promise that
SQLite's own equality is the language's, `make_dict_key` gives both sides the value that stands for all that equal them.
"""

from __future__ import annotations

from collections.abc import Sequence

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import (
    can_end_early,
    can_fail,
    has_query,
    is_volatile,
    list_functions,
    list_sources,
    list_states,
)
from ss2sql.lowering.sqlite_expressions import is_run_constant
from ss2sql.lowering.storage_class import have_same_storage_class

INDEXABLE_OPERATORS = frozenset({"item", "slice", "add", "sub", "mul", "div", "mod", "pow", "neg"})
MIN_INDEXED_LENGTH = 16  # elements of a list that is no longer than this are tried one by one


@dataclass(frozen=True, slots=True)
class ExpressionKey:
    """What a copy has as a column, and what that has to equal, which is known before the source is read.

    It is evaluated only for elements that pass the `guards`.
    """

    expr: plan.Expr
    other: plan.Expr
    guards: tuple[plan.Expr, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether SQLite's own equality is the language's."""
        return have_same_storage_class(self.expr.type, self.other.type, none=True)

    @property
    def name(self) -> str:
        """What the column is called."""
        match self.expr:
            case plan.Call(function=plan.Function(name="item"), arguments=(_, plan.Constant(value=str(name)))):
                return name if name.isidentifier() else "computed"
            case plan.Call(function=plan.Function(name=name)) if name not in INDEXABLE_OPERATORS:
                return name
            case plan.Column(name=name):
                return f"{name}_key"
            case _:
                return "computed"


def find_expression_key(
    query: plan.Query, source: plan.Source, part: plan.Expr, before: Sequence[plan.Expr]
) -> ExpressionKey | None:
    """The key that a part of WHERE asks a source for, `before` being the parts that stand before it."""
    match part:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)) if (
            is_worth_materializing(source)
        ):
            for expr, other in ((left, right), (right, left)):
                if _can_be_key(query, source.id, expr, other):
                    return _find_key_after_guards(source.id, expr, other, before)
    return None


def is_worth_materializing(source: plan.Source) -> bool:
    """Whether a copy of the source serves the whole statement, and is worth its index."""
    return (
        isinstance(source, plan.ValueSource)
        and is_run_constant(source.value)
        and (source.value.type.size or MIN_INDEXED_LENGTH) >= MIN_INDEXED_LENGTH
    )


def _can_be_key(query: plan.Query, source: int, expr: plan.Expr, other: plan.Expr) -> bool:
    if isinstance(expr, (plan.Column, plan.Element)) and have_same_storage_class(expr.type, other.type, none=True):
        return False  # SQLite sees that by itself
    if list_sources(expr) != {source} or list_states(expr) or is_volatile(expr) or is_volatile(other):
        return False
    if source in list_sources(other) or not (list_sources(other) or list_states(other)):
        return False
    if has_query(expr):
        return False
    return not can_end_early(query) or all(function.builtin for function in list_functions(expr))


def _find_key_after_guards(
    source: int, expr: plan.Expr, other: plan.Expr, before: Sequence[plan.Expr]
) -> ExpressionKey | None:
    """The key after the parts that guard it: what can fail must not be evaluated for an element that they drop."""
    if can_fail(other) and any(source in list_sources(part) for part in before):
        return None
    if not can_fail(expr):
        return ExpressionKey(expr, other)
    alone = all(list_sources(part) == {source} and not list_states(part) and not is_volatile(part) for part in before)
    return ExpressionKey(expr, other, tuple(before)) if alone else None
