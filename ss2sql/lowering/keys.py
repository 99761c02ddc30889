"""`lookup` by what is computed: an equality that one side of which reads one list alone is looked up in its copy.

    SELECT n.this, e.this FROM n = ns, e = es WHERE abs(e.x) == n.this

    WITH e_once AS MATERIALIZED (SELECT e.rowid, e.this, abs_of(e.x, '1:50') AS abs FROM elements_x(:es) AS e)
    SELECT n.this, e.this FROM elements(:ns) AS n CROSS JOIN e_once AS e
    WHERE NOT e.rowid IS NULL AND e.abs = n.this

So the side is computed once for each element, and SQLite makes an index of it. Where the types do not promise that
SQLite's own equality is the language's, `as_key` gives both sides the value that stands for all that equal them.
"""

from __future__ import annotations

from collections.abc import Sequence

from ss2sql import plan
from ss2sql.lowering.classes import same_class
from ss2sql.lowering.expressions import is_fixed
from ss2sql.records import dataclass
from ss2sql.walk import can_fail, cuts_off, functions, has_query, is_volatile, sources_read, states_read

OPERATORS = frozenset({"item", "slice", "add", "sub", "mul", "div", "mod", "pow", "neg"})
FEW = 16  # elements of a list that is no longer than this are tried one by one


@dataclass(frozen=True, slots=True)
class Key:
    """What a copy has as a column, and what that has to equal, which is known before the source is read.

    It is asked of elements that pass the `guards` alone.
    """

    expr: plan.Expr
    other: plan.Expr
    guards: tuple[plan.Expr, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether SQLite's own equality is the language's."""
        return same_class(self.expr.type, self.other.type, none=True)

    @property
    def name(self) -> str:
        """What the column is called."""
        match self.expr:
            case plan.Call(function=plan.Function(name="item"), arguments=(_, plan.Constant(value=str(name)))):
                return name if name.isidentifier() else "computed"
            case plan.Call(function=plan.Function(name=name)) if name not in OPERATORS:
                return name
            case plan.Column(name=name):
                return f"{name}_key"
            case _:
                return "computed"


def key_of(query: plan.Query, source: plan.Source, part: plan.Expr, before: Sequence[plan.Expr]) -> Key | None:
    """The key that a part of WHERE asks a source for, `before` being the parts that stand before it."""
    match part:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)) if is_copied(source):
            for expr, other in ((left, right), (right, left)):
                if _is_key(query, source.id, expr, other):
                    return _guarded(source.id, expr, other, before)
    return None


def is_copied(source: plan.Source) -> bool:
    """Whether a copy of the source serves the whole statement, and is worth its index."""
    return isinstance(source, plan.ValueSource) and is_fixed(source.value) and (source.value.type.size or FEW) >= FEW


def _is_key(query: plan.Query, source: int, expr: plan.Expr, other: plan.Expr) -> bool:
    if isinstance(expr, (plan.Column, plan.Element)) and same_class(expr.type, other.type, none=True):
        return False  # SQLite sees that by itself
    if sources_read(expr) != {source} or states_read(expr) or is_volatile(expr) or is_volatile(other):
        return False
    if source in sources_read(other) or not (sources_read(other) or states_read(other)):
        return False
    if has_query(expr):
        return False
    return not cuts_off(query) or all(function.builtin for function in functions(expr))


def _guarded(source: int, expr: plan.Expr, other: plan.Expr, before: Sequence[plan.Expr]) -> Key | None:
    """The key behind the parts that guard it: what can fail must not be asked of an element that they drop."""
    if can_fail(other) and any(source in sources_read(part) for part in before):
        return None
    if not can_fail(expr):
        return Key(expr, other)
    alone = all(sources_read(part) == {source} and not states_read(part) and not is_volatile(part) for part in before)
    return Key(expr, other, tuple(before)) if alone else None
