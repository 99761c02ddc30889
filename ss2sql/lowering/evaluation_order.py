"""When the parts of a flat query's row are evaluated, and what is looked up by what is computed.

    SELECT n.this, e.this FROM n = ns, e = es WHERE abs(e.x) == n.this

    WITH e_once AS MATERIALIZED (SELECT e.rowid, e.this, abs_of(e.x, '1:50') AS abs FROM elements_x(:es) AS e)
    SELECT n.this, e.this FROM elements(:ns) AS n CROSS JOIN e_once AS e
    WHERE NOT e.rowid IS NULL AND e.abs = n.this

So the side is computed once for each element, and SQLite makes an index of it. Where the types do not promise that
SQLite's own equality is the language's, `as_key` gives both sides the value that stands for all that equal them.

The *level* of an expression is the number of sources that are bound when it is evaluated. As written, WHERE
and the columns are evaluated when all are bound. A part that cannot fail is
evaluated as soon as the sources that it reads are bound. One that may fail waits for the conditions before it, which
guard it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import (
    can_end_early,
    has_query,
    is_volatile,
    list_plan_functions,
    list_sources,
    list_states,
    reads_outside,
    split_and,
)
from ss2sql.lowering.guards import is_costly, is_free, is_sql_constant, iterate_certain_parts
from ss2sql.lowering.sqlite_forms import have_same_storage_class

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
    query: plan.Query, source: plan.Source, parts: Sequence[plan.Expr], index: int
) -> ExpressionKey | None:
    """The key that one of the parts of WHERE, or of the ON of a LEFT JOIN, asks a source for."""
    if is_worth_materializing(source, parts):
        for expr, other in get_equality_sides(parts[index]):
            if _can_be_key(query, source, expr, other):
                return _find_key_after_guards(source.id, expr, other, parts[:index])
    return None


def get_equality_sides(part: plan.Expr) -> list[tuple[plan.Expr, plan.Expr]]:
    """The sides of an equality, in both orders."""
    match part:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
            return [(left, right), (right, left)]
        case _:
            return []


def is_worth_materializing(source: plan.Source, parts: Sequence[plan.Expr]) -> bool:
    """Whether a copy of the source serves the whole statement, and is worth its index under these conditions."""
    match source:
        case plan.TableSource(id=number, indexes=indexes):  # an index of its own serves better
            led = {columns[0] for columns, _ in indexes}
            return not any(
                isinstance(expr, plan.Column) and expr.source == number and expr.name in led
                for part in parts
                for expr, other in get_equality_sides(part)
                if number not in list_sources(other)
            )
        case plan.ValueSource(value=value):
            return is_sql_constant(value) and (value.type.size or MIN_INDEXED_LENGTH) >= MIN_INDEXED_LENGTH
        case plan.QuerySource(query=query):  # of dicts SQL makes a table of its own
            return query.representation.name != "dict" and not source.optional and not reads_outside(query)
        case _:
            return False


def _can_be_key(query: plan.Query, source: plan.Source, expr: plan.Expr, other: plan.Expr) -> bool:
    if isinstance(expr, (plan.Column, plan.Element)) and have_same_storage_class(expr.type, other.type, none=True):
        return False  # SQLite sees that by itself
    if isinstance(source, plan.TableSource) and not is_free(expr, other):
        return False
    if list_sources(expr) != {source.id} or list_states(expr) or is_volatile(expr) or is_volatile(other):
        return False
    if source.id in list_sources(other) or not (list_sources(other) or list_states(other)):
        return False
    if has_query(expr):
        return False
    return not can_end_early(query) or all(function.builtin for function in list_plan_functions(expr))


def _find_key_after_guards(
    source: int, expr: plan.Expr, other: plan.Expr, before: Sequence[plan.Expr]
) -> ExpressionKey | None:
    """The key after the parts that guard it: what can fail must not be evaluated for an element that they drop."""
    if not is_free(other) and any(source in list_sources(part) for part in before):
        return None
    if is_free(expr):
        return ExpressionKey(expr, other)
    alone = all(list_sources(part) == {source} and not list_states(part) and not is_volatile(part) for part in before)
    return ExpressionKey(expr, other, tuple(before)) if alone else None


# --- when the parts of a flat query's row are evaluated: as early as their guards allow
@dataclass(frozen=True, slots=True)
class Condition:
    """A part of WHERE with its level. A `free` one may be evaluated at any time from then on; one with a `key` is."""

    expr: plan.Expr
    level: int
    free: bool
    key: ExpressionKey | None = None


@dataclass(slots=True)
class EvaluationOrder:
    """The levels of one query."""

    query: plan.Query
    early: bool
    may_hoist: bool
    may_look_up: bool
    number: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        self.number = {source.id: position for position, source in enumerate(self.query.sources, 1)}

    # --- expressions -----------------------------------------------------------------------------------

    def count_sources(self, expr: object) -> int:
        """The number of sources that have to be bound for the expression."""
        return max((self.number.get(source, 0) for source in list_sources(expr)), default=0)

    def split_where(self) -> list[Condition]:
        """The parts of WHERE in written order. One that may fail is not evaluated before those that guard it."""
        last = len(self.query.sources)
        parts = split_and(self.query.where)
        placed: list[Condition] = []
        reached = 1
        for index, part in enumerate(parts):
            level = self.count_sources(part)
            source = self.query.sources[level - 1]
            key = find_expression_key(self.query, source, parts, index) if self.may_look_up else None
            free = key is not None or is_free(part)
            if not free:
                level = max(level, reached) if self.early else last
            reached = max(reached, level)
            placed.append(Condition(part, level, free, key))
        return placed

    def find_hoisted_values(
        self, conditions: Sequence[Condition], outputs: Sequence[plan.Expr]
    ) -> dict[plan.Expr, int]:
        """The values to compute once at a level, and to read further in: of what is costly in WHERE, then in `outputs`.

        None is computed before the conditions that guard it.
        """
        found: dict[plan.Expr, int] = {}
        if not self.may_hoist or len(self.query.sources) < 2:
            return found
        guarded = 1
        for condition in conditions:
            self._hoist(condition.expr, condition.level, guarded, found)
            guarded = max(guarded, condition.level)
        for output in outputs:
            self._hoist(output, len(self.query.sources), guarded, found)
        return found

    def _hoist(self, expr: plan.Expr, level: int, guarded: int, found: dict[plan.Expr, int]) -> None:
        """Finds what of an expression that is certainly evaluated at this level can be from an earlier one on."""
        if expr in found or not is_costly(expr):
            return
        own = min(level, max(self.count_sources(expr), guarded))
        for part in iterate_certain_parts(expr):
            self._hoist(part, own, guarded, found)
        if own < level:
            found[expr] = own
