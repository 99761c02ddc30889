"""`unnest` and `exists`: nested queries that only test elements become conditions.

    [] == (SELECT this FROM [[a.this, b.this], [b.this, c.this]] WHERE this[0] == this[1] AS list)

means the same as `a.this != b.this AND b.this != c.this`, which both executors can evaluate as soon as the sources
are bound: the four-colour map over eight countries takes 8.7 s nested and 0.01 s so. The list may be a
literal, a constant, or a variable's value; in the last case the query relies on the value, and is made anew
when it has changed. A text for `eval` that is constant by then is read, too. The conditions must not fail,
because the nested query evaluates all of them and a conjunction stops early.

    x IN (SELECT e.x FROM e = es WHERE e.k == n.k AS list)

    EXISTS (SELECT 1 FROM e = es WHERE e.k == n.k AND e.x == x)

so that both equalities are looked up, and no list is made. The plan says it with a query `AS value`, cut after its
first row, see `is_exists`. A query that is the same for all rows stays as it is, for its list is made once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, NONE, Kind, unite
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import (
    can_fail,
    has_query,
    is_column_query,
    is_exists,
    is_volatile,
    list_inside,
    list_sources,
    list_states,
    rebuild_node,
    split_and,
    walk,
)
from ss2sql.lowering.rewrites.constant_folding import fold_node, resolve_constant_string
from ss2sql.lowering.rewrites.rewrite_context import (
    COMPARISONS,
    MAX_ELEMENTS,
    NEGATED_COMPARISONS,
    RewriteContext,
    is_plain_value,
    is_true,
    make_bool,
    make_call,
    make_conjunction,
    make_constant,
    make_disjunction,
    negate_expression,
    rewrite_bottom_up,
)

MAX_NODES = 20_000  # of the conditions and columns of all elements together
LIST_FORMS = ("list", "rows", "dict")


@dataclass(frozen=True, slots=True)
class UnrolledRow:
    """What one element of the list comes to: the condition that it passes, and the columns that it gives."""

    passes: plan.Expr
    columns: tuple[plan.Expr, ...]


def unroll_rows(query: plan.Query, world: RewriteContext) -> list[UnrolledRow] | None:
    """A row for each element of a nested query's list; None where the query cannot be taken apart unnoticed.

    All elements and what is made of them must not fail: the query evaluates all, and what its rows are used
    for may stop early. A query that mentions nothing of the queries around it is left alone, for it is evaluated once.
    """
    if not _is_plain_query(query) or not isinstance(query.sources[0], plan.ValueSource):
        return None
    source = query.sources[0]
    if not _is_correlated(query):
        return None
    items = _list_items(source.value, world)
    parts = [query.where or make_constant(True, query.span), *(output.expr for output in query.columns)]
    if items is None or len(items) * sum(1 for part in parts for _ in walk(part)) > MAX_NODES:
        return None
    rows: list[UnrolledRow] = []
    for item in items:
        passes, *columns = (substitute_element(part, source.id, item, world) for part in parts)
        if any(part is None or can_fail(part) for part in (item, passes, *columns)):
            return None
        rows.append(UnrolledRow(passes, tuple(columns)))
    return rows


def find_searched_item(query: plan.Query, world: RewriteContext) -> tuple[plan.Expr, plan.Constant] | None:
    """What a query looks for in which list, if its WHERE asks for nothing but `this == x`; else None."""
    match query.where:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=arguments):
            pass
        case _:
            return None
    if not _is_plain_query(query) or not isinstance(query.sources[0], plan.ValueSource):
        return None
    source = query.sources[0]
    for one, item in (arguments, arguments[::-1]):
        if isinstance(one, plan.Element) and one.source == source.id and source.id not in list_sources(item):
            shown = [item, *(output.expr for output in query.columns)]
            items = None if any(map(can_fail, shown)) or not _is_correlated(query) else _list_items(source.value, world)
            if items and all(isinstance(known, plan.Constant) for known in items):
                values = [known.value for known in items if isinstance(known, plan.Constant)]
                return item, make_constant(values, source.value.span)
    return None


def _is_plain_query(query: plan.Query) -> bool:
    """Whether the query gives a list of the rows that pass its WHERE, in the order of its one source."""
    shaped = (
        query.search or query.grouped or query.limit or query.representation.arguments or query.representation.named
    )
    keys = any(can_fail(key.expr) for key in query.order)
    labelled = any(output.label is not None or output.star for output in query.columns)
    alone = len(query.sources) == 1
    return alone and not (shaped or keys or labelled) and query.representation.name in LIST_FORMS


def _is_correlated(query: plan.Query) -> bool:
    """Whether the query reads anything of the queries around it."""
    return bool(list_sources(query) - {query.sources[0].id} or list_states(query))


def _list_items(value: plan.Expr, world: RewriteContext) -> list[plan.Expr] | None:
    match value:
        case plan.MakeList(items=items):
            known: list[plan.Expr] | None = list(items)
        case plan.Constant(value=list(values)) if is_plain_value(values):
            known = [make_constant(element, value.span) for element in values]
        case plan.Variable(name=name):
            listed = world.get_list(name)
            known = None if listed is None else [make_constant(element, value.span) for element in listed]
        case _:
            return None
    return known if known is not None and len(known) <= MAX_ELEMENTS else None


def substitute_element(expr: Any, source: int, item: plan.Expr, world: RewriteContext) -> Any:
    """The expression with `item` in place of the element, and what that makes known; None where it reads columns."""
    if any(isinstance(node, (plan.Column, plan.Subquery)) and source in list_sources(node) for node in walk(expr)):
        return None

    def put_element(node: Any) -> Any:
        if isinstance(node, plan.Element) and node.source == source:
            return item
        node = fold_node(rebuild_node(node, put_element))
        if isinstance(node, plan.Eval):
            meaning = resolve_constant_string(node, world)
            return node if meaning is None else put_element(meaning)
        return node

    return put_element(expr)


# --- `unnest`: a nested query over a known list, which only tests its elements, becomes conditions
MIRRORED_COMPARISONS = {name: row.mirrored for name, row in OPERATIONS.items() if row.mirrored}
MAX_COUNTED = 50  # elements that are counted one by one
Test: TypeAlias = Callable[[plan.Expr], plan.Expr]


def unnest_subqueries(query: plan.Query, world: RewriteContext) -> plan.Query:
    nested = any(isinstance(node, (plan.Subquery, plan.Eval)) for node in walk(query))
    if not nested or not COMPARISONS.isdisjoint(world.replaced):
        return query
    rewritten = SubqueryUnnester(world).unnest_query(query)
    if _can_assign(rewritten, {*world.lists, *world.types}):
        world.forget_values()
        return SubqueryUnnester(world).unnest_query(query)
    return rewritten


def _can_assign(query: plan.Query, names: Collection[str]) -> bool:
    """Whether the query itself may change one of the variables while it runs."""
    return bool(names) and any(
        isinstance(node, (plan.Eval, plan.AssignLate))
        or (isinstance(node, (plan.Assign, plan.TemporalAssign)) and node.name in names)
        for node in walk(query)
    )


class SubqueryUnnester:
    """The rewrite in one world."""

    def __init__(self, world: RewriteContext) -> None:
        self.world = world

    def unnest_query(self, query: plan.Query) -> plan.Query:
        return rewrite_bottom_up(query, self.unnest_node)

    def unnest_node(self, node: Any) -> Any:
        """The node, whose parts are rewritten already, rewritten."""
        match node:
            case plan.Call(function=plan.Function(builtin=True)):
                known = fold_node(node)  # a text that was read has told more of its type
                return self.unnest_call(known) if isinstance(known, plan.Call) else known
            case plan.And(parts=parts) | plan.Or(parts=parts):
                tested = tuple(map(self.unnest_test, parts))
                return node if _are_identical(tested, parts) else fold_node(replace(node, parts=tested))
            case plan.Not(operand=operand):
                test = self.unnest_test(operand)
                return node if test is operand else fold_node(replace(node, operand=test))
            case plan.If(condition=condition):
                test = self.unnest_test(condition)
                return node if test is condition else fold_node(replace(node, condition=test))
            case plan.Query(where=where) if where is not None:
                test = self.unnest_test(where)
                return node if test is where else fold_node(replace(node, where=test))
            case plan.Search(stop=stop) if stop is not None:
                test = self.unnest_test(stop)
                return node if test is stop else replace(node, stop=test)
            case plan.Eval():
                return resolve_constant_string(node, self.world) or node
            case _:
                return node

    def unroll_subquery(self, expr: plan.Expr) -> list[UnrolledRow] | None:
        return unroll_rows(expr.query, self.world) if isinstance(expr, plan.Subquery) else None

    def unnest_test(self, expr: plan.Expr) -> plan.Expr:
        """An expression of which only the truth counts: a list is true if it has elements."""
        found = self.rewrite_row_test(_get_counted_query(expr) or expr, True, expr.span)
        return expr if found is None else found

    def rewrite_row_test(self, expr: plan.Expr, wanted: bool, span: Span) -> plan.Expr | None:
        """Whether a query has rows, or, if that is wanted, none."""
        if not isinstance(expr, plan.Subquery):
            return None
        found = find_searched_item(expr.query, self.world)
        if found is not None:
            item, values = found
            return make_call("in" if wanted else "not_in", item, values, span=span)
        rows = self.unroll_subquery(expr)
        return None if rows is None else _make_some_row_test(rows, span) if wanted else _make_no_row_test(rows, span)

    # --- comparisons -----------------------------------------------------------------------------------

    def unnest_call(self, call: plan.Call) -> plan.Expr:
        """A comparison or membership with a nested query on one side, as conditions."""
        name = call.function.name
        new: plan.Expr | None = None
        if name in ("in", "not_in"):
            new = self.rewrite_membership(call)
        elif name in MIRRORED_COMPARISONS:
            one, other = call.arguments
            if isinstance(other, plan.Constant):
                new = self.unnest_comparison(name, one, other, call.span)
            elif isinstance(one, plan.Constant):
                new = self.unnest_comparison(MIRRORED_COMPARISONS[name], other, one, call.span)
        return new or call

    def unnest_comparison(self, name: str, value: plan.Expr, known: plan.Constant, span: Span) -> plan.Expr | None:
        """`query == []`, `len(query) > 2`, `max(query) == 3` and their kin."""
        if known.value == [] and name in ("eq", "ne"):
            return self.rewrite_row_test(value, name == "ne", span)
        counted = _get_counted_query(value)
        if counted is not None and type(known.value) is int:
            if (name, known.value) in (("eq", 0), ("lt", 1), ("le", 0), ("ne", 0), ("gt", 0), ("ge", 1)):
                return self.rewrite_row_test(counted, name in ("ne", "gt", "ge"), span)
            rows = self.unroll_subquery(counted)
            width = len(counted.query.columns) if counted.query.representation.name == "list" else 1
            return None if rows is None else self.compare_count(name, rows, width, known.value, span)
        match value:
            case plan.Call(function=plan.Function(name="max" | "min" as extreme, builtin=True), arguments=(query,)):
                return self.rewrite_extreme(name, extreme, query, known, span)
            case _:
                return None

    def compare_count(
        self, name: str, rows: list[UnrolledRow], width: int, number: int, span: Span
    ) -> plan.Expr | None:
        """The number of rows, of `width` elements each, compared with a constant."""
        match name:
            case "eq" | "ne":
                least, rest = divmod(number, width)
                assert number, "whether there are rows is tested in another way"
                return None if rest else self.compare_total(name, rows, least, span)
            case "lt" | "ge":
                least = -(-number // width)
            case _:
                least = number // width + 1
        enough = name in ("ge", "gt")
        if least <= 0 or least > len(rows):
            return make_constant(enough is (least <= 0), span)
        if least == 1:
            return _make_some_row_test(rows, span) if enough else _make_no_row_test(rows, span)
        return self.compare_total("ge" if enough else "lt", rows, least, span)

    def compare_total(self, name: str, rows: list[UnrolledRow], number: int, span: Span) -> plan.Expr | None:
        """The number of rows that pass, as a sum, compared with a number."""
        if len(rows) > MAX_COUNTED:
            return None
        one, zero = make_constant(1, span), make_constant(0, span)
        kind = unite((one.type, zero.type))
        total: plan.Expr = zero
        for row in rows:
            counts = fold_node(plan.If(row.passes, (one,), (zero,), kind, span=span))
            total = counts if total is zero else fold_node(make_call("add", total, counts, span=span))
        return _make_bool(fold_node(make_call(name, total, make_constant(number, span), span=span)))

    def rewrite_extreme(
        self, name: str, extreme: str, query: plan.Expr, known: plan.Constant, span: Span
    ) -> plan.Expr | None:
        """The greatest or least value compared with a constant. Of no rows it is None, which has no order."""
        rows = self.unroll_subquery(query)
        if not rows or not isinstance(query, plan.Subquery) or query.query.representation.name != "list":
            return None
        compared = (known, *(value for row in rows for value in row.columns))
        if not any(all(value.type.is_only(kind) for value in compared) for kind in (Kind.NUMBER, Kind.STR)):
            return None

        def compare_with(operator: str) -> Test:
            return lambda value: fold_node(make_call(operator, value, known, span=span))

        beyond = "gt" if extreme == "max" else "lt"
        if name in ("eq", "ne"):
            reached, exceeded = (
                _make_some_row_test(rows, span, compare_with("eq")),
                _make_some_row_test(rows, span, compare_with(beyond)),
            )
            equal = _make_bool(
                fold_node(plan.And((reached, _make_bool(fold_node(negate_expression(exceeded)))), span=span))
            )
            return equal if name == "eq" else _make_bool(fold_node(negate_expression(equal)))
        if not all(isinstance(row.passes, plan.Constant) and is_true(row.passes) for row in rows):
            return None
        if name[0] == beyond[0]:
            return _make_some_row_test(rows, span, compare_with(name))
        return _make_bool(
            fold_node(negate_expression(_make_some_row_test(rows, span, compare_with(NEGATED_COMPARISONS[name]))))
        )

    def rewrite_membership(self, test: plan.Call) -> plan.Expr | None:
        """`x IN query`: some row passes and has x among its columns."""
        item, query = test.arguments
        if can_fail(item) or not isinstance(query, plan.Subquery) or query.query.representation.name != "list":
            return None
        rows = self.unroll_subquery(query)
        if rows is None:
            return None
        found = _make_some_row_test(
            rows, test.span, lambda value: fold_node(make_call("eq", item, value, span=test.span))
        )
        return found if test.function.name == "in" else _make_bool(fold_node(negate_expression(found)))


def _are_identical(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return all(a is b for a, b in zip(one, other, strict=True))


def _get_counted_query(expr: plan.Expr) -> plan.Subquery | None:
    match expr:
        case plan.Call(
            function=plan.Function(name="len" | "count", builtin=True), arguments=(plan.Subquery() as query,)
        ):
            return query
        case _:
            return None


def _make_some_row_test(rows: list[UnrolledRow], span: Span, test: Test | None = None) -> plan.Expr:
    """Whether some row passes, and a value of it passes the test."""
    parts: list[plan.Expr] = []
    for row in rows:
        passed = row.passes
        if test is not None:
            hit = fold_node(make_disjunction([test(value) for value in row.columns], span))
            passed = fold_node(plan.And((passed, hit), span=span))
        parts.append(passed)
    return _make_bool(fold_node(make_disjunction(parts, span)))


def _make_no_row_test(rows: list[UnrolledRow], span: Span) -> plan.Expr:
    return _make_bool(fold_node(make_conjunction([negate_expression(row.passes) for row in rows], span)))


def _make_bool(expr: Any) -> plan.Expr:
    return make_bool(expr) if not isinstance(expr, plan.Constant) else make_constant(is_true(expr), expr.span)


# --- `exists`: membership in what a query finds for the row around it is the question whether it finds that value
def search_for_members(query: plan.Query, world: RewriteContext) -> plan.Query:
    """The query with such memberships as questions for rows."""
    if not {"in", "not_in", "eq", "ne"}.isdisjoint(world.replaced):
        return query
    return rewrite_bottom_up(query, _rewrite_node)


def _rewrite_node(node: Any) -> Any:
    match node:
        case plan.Call(
            function=plan.Function(name="in" | "not_in" as name, builtin=True),
            arguments=(item, plan.Subquery(query=inner)),
        ) if is_column_query(inner) and _reads_outer_rows(inner) and not has_query(item) and not is_volatile(node):
            column = inner.columns[0].expr
            equal = make_call("eq", column, item, span=node.span)
            found = replace(
                inner,
                columns=(plan.Output("found", make_constant(True, node.span)),),
                where=make_conjunction([*split_and(inner.where), equal], node.span),
                order=(),
                limit=make_constant(1, node.span),
                representation=plan.Representation("value"),
            )
            assert is_exists(found)
            question = plan.Subquery(found, unite((BOOL, NONE)), span=node.span)
            return make_call("ne" if name == "in" else "eq", question, make_constant(None, node.span), span=node.span)
        case _:
            return node


def _reads_outer_rows(query: plan.Query) -> bool:
    return bool(list_sources(query) - list_inside(query) or list_states(query))
