"""Equality, membership and elements: operators that sqlite_forms.py has no texts for.

    grid[y][x] == 1              instr(x'0001', substr(:grid_cells, y * 300 + x + 1, 1)) - 1 = 1
    [x, y] IN free               CASE WHEN x BETWEEN 0 AND 299 AND y BETWEEN 0 AND 299
                                 THEN substr(:free_cells, x * 300 + y + 1, 1) = x'01' ELSE 0 END

The list is bound as a BLOB with a byte for each element (see sql_query.py); `instr` makes a number of a byte,
whatever the encoding of the database. Where an index may be out of range, a CASE leaves it to Python, which counts from
the end or raises.

Every entry takes the lowering, the call and the environment, and gives the SQL or None where the types do
not promise enough. Numbers compare exactly across int and float in SQLite, text compares by code point as
in Python; beyond that nothing is taken for granted: a table's column may carry an affinity, so operands of
different classes are never compared natively.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql.errors import NOWHERE
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, Kind, Type, type_of
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.operations.operators import EXACT
from ss2sql.language.plan_traversal import is_column_query, is_exists
from ss2sql.lowering import sql_builder
from ss2sql.lowering.guards import can_be_parameter, is_costly
from ss2sql.lowering.rewrites.rewrite_context import PLAIN_READS
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import EqualValueEncoding, ListEncoding, PointSetEncoding
from ss2sql.lowering.sqlite_forms import INTEGRAL, REAL_NUMBER, can_repeat, have_same_storage_class, is_sql_number

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope


MAX_SHOWN_BYTES = 16  # bytes that are written into the text
MAX_BOX_SIZE = 2**22  # 4 MB; a list of a few points that lie far apart is left to Python


# --- elements ------------------------------------------------------------------------------------------


def lower_item(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """`values[i]` and `rows[i][j]`, where the elements are integers in a narrow range, or bools."""
    container, indexes = _split_indexes(call)
    packed = None if "cells" in lowering.needs.disabled else _choose_encoding(container.type, len(indexes))
    if packed is None or not isinstance(container, (plan.Constant, plan.Variable)):
        return None
    packing, leaf = packed
    if not all(index.type.is_only(INTEGRAL) and is_sql_number(index.type) for index in indexes):
        return None
    nodes = [lowering.lower_expr(index, scope) for index in indexes]
    sizes = [container.type.size, container.type.element.size if container.type.element else None]
    cells = lowering.needs.bind_packed(container, packing)
    found = _build_byte_lookup(lowering, cells, _lower_blob_offset(nodes, sizes[1 : len(nodes)]), leaf)
    if all(_is_index_in_bounds(index.type, size) for index, size in zip(indexes, sizes, strict=False)):
        return found
    if not all(map(can_repeat, nodes)):
        return None
    inside = [
        sql_builder.between(node, 0, size - 1) for node, size in zip(nodes, sizes, strict=False) if size is not None
    ]
    return sql_builder.case([(sql_builder.join_by_and(inside), found)], lowering.call_python(call, scope, rarely=True))


def _split_indexes(call: plan.Call) -> tuple[plan.Expr, list[plan.Expr]]:
    """`rows[i][j]` as `rows` and its indexes."""
    container, index = call.arguments
    match container:
        case plan.Call(function=plan.Function(name="item", builtin=True), arguments=(rows, first)):
            return rows, [first, index]
        case _:
            return container, [index]


def _choose_encoding(kind: Type, depth: int) -> tuple[ListEncoding, Type] | None:
    """How lists of the type are packed, and the type of their items; None where they cannot be."""
    for _ in range(depth):
        if kind.kinds != Kind.LIST or kind.size is None or kind.element is None:
            return None
        kind = kind.element
    if kind.kinds == Kind.BOOL:
        return ListEncoding(depth > 1, 0), kind
    if kind.kinds != Kind.INT or kind.low is None or kind.high is None or kind.high - kind.low > 255:
        return None
    if not kind.is_bounded(EXACT):
        return None  # the least is written into the text
    return ListEncoding(depth > 1, int(kind.low)), kind


def _is_index_in_bounds(kind: Type, size: int | None) -> bool:
    """Whether an index is one that counts from the start, in a list of this size."""
    return size is not None and kind.low is not None and kind.high is not None and 0 <= kind.low <= kind.high < size


def _build_byte_lookup(lowering: ExpressionLowering, cells: Node, place: Node, kind: Type) -> Node:
    """The element at a place: the number of its byte among all bytes that occur."""
    byte = sql_builder.call(
        "substr", cells, sql_builder.binary(exp.Add, place, sql_builder.number(1)), sql_builder.number(1)
    )
    if kind.kinds == Kind.BOOL:
        return sql_builder.binary(exp.EQ, byte, exp.HexString(this="01"))
    least, high = int(kind.low or 0), int(kind.high or 0)
    count = high - least + 1
    alphabet = list(range(256))
    known: Node = exp.HexString(this=bytes(alphabet[:count]).hex())
    if count > MAX_SHOWN_BYTES:
        known = lowering.needs.bind_packed(
            plan.Constant(alphabet, type_of(alphabet), span=NOWHERE), ListEncoding(False, 0)
        )
    return _add_number(sql_builder.call("instr", known, byte), least - 1)


def _add_number(node: Node, number: int) -> Node:
    kind = exp.Add if number > 0 else exp.Sub
    return sql_builder.binary(kind, node, sql_builder.number(abs(number))) if number else node


def _lower_blob_offset(nodes: Sequence[Node], sizes: Sequence[int | None]) -> Node:
    """The place of an element, counted from 0; `sizes` are those of all positions but the first."""
    place = nodes[0].copy()
    for node, size in zip(nodes[1:], sizes, strict=True):
        place = sql_builder.binary(
            exp.Add, sql_builder.binary(exp.Mul, place, sql_builder.number(size or 0)), node.copy()
        )
    return place


# --- membership ----------------------------------------------------------------------------------------


def lower_membership(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """`[x, y] IN points` for lists of integers that lie close together."""
    item, container = call.arguments
    packing = None if "cells" in lowering.needs.disabled else _choose_point_encoding(container.type)
    if packing is None or not isinstance(container, (plan.Constant, plan.Variable)):
        return None
    if not isinstance(item, plan.MakeList) or len(item.items) != len(packing.box):
        return None
    if not all(part.type.is_only(INTEGRAL) and is_sql_number(part.type) for part in item.items):
        return None
    nodes = [lowering.lower_expr(part, scope) for part in item.items]
    if not all(map(can_repeat, nodes)):
        return None
    places = [_add_number(node, -low) for node, (low, _) in zip(nodes, packing.box, strict=True)]
    place = _lower_blob_offset(places, [high - low + 1 for low, high in packing.box[1:]])
    cells = lowering.needs.bind_packed(container, packing)
    inside = [sql_builder.between(node, low, high) for node, (low, high) in zip(nodes, packing.box, strict=True)]
    found = sql_builder.case(
        [(sql_builder.join_by_and(inside), _build_byte_lookup(lowering, cells, place, BOOL))], sql_builder.number(0)
    )
    return found if call.function.name == "in" else exp.Not(this=found)


def _choose_point_encoding(kind: Type) -> PointSetEncoding | None:
    points = kind.element
    if kind.kinds != Kind.LIST or points is None or points.kinds != Kind.LIST or points.positions is None:
        return None
    box: list[tuple[int, int]] = []
    for position in points.positions:
        if not position.is_only(INTEGRAL) or position.low is None or position.high is None:
            return None
        box.append((int(position.low), int(position.high)))
    packing = PointSetEncoding(tuple(box))
    return packing if packing.size <= MAX_BOX_SIZE else None


MAX_WRITTEN_MEMBERS = 30  # of a list that is written into the text
GLOB_PATTERN = str.maketrans({"%": "*", "_": "?", "*": "[*]", "?": "[?]", "[": "[[]"})

LowerFunction: TypeAlias = "Callable[[ExpressionLowering, plan.Call, SqlScope], Node | None]"


def _has_one_form(kind: Type) -> bool:
    """Whether these are lists of which equal ones are the same: of integers, strings, None and such lists."""
    if kind.kinds != Kind.LIST or kind.element is None:
        return False
    return kind.element.is_only(Kind.INT | Kind.STR | Kind.NONE) or _has_one_form(kind.element)


def _lower_handle_comparison(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """Structured values that are compared by their handles, which saves a Python call of 0.4 us.

    Of one that is known beforehand, it is taken for granted that no value that equals it has another form; the
    interning notices when one turns up ([3.0] beside [3]), and the query runs again by one that compares values.
    """
    first, second = call.arguments
    nodes: list[Node] | None = None
    if _has_one_form(first.type) and _has_one_form(second.type):
        nodes = [lowering.lower_value(argument, scope) for argument in call.arguments]
    elif not lowering.needs.by_value:
        for known, other in ((first, second), (second, first)):
            if can_be_parameter(known) and _has_one_form(known.type):
                nodes = [lowering.lower_value(other, scope), lowering.needs.bind_plain(known)]
                break
    if nodes is None:
        return None
    return sql_builder.binary(exp.NullSafeEQ if call.function.name == "eq" else exp.NullSafeNEQ, *nodes)


def _compare_with_equal_value(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """A number or a string that is compared with a variable of unknown kind: with the one that this equals.

    Then SQLite compares by itself, uses indexes, and passes the comparison on to worlds.
    """
    first, second = call.arguments
    for known, other in ((first, second), (second, first)):
        text = known.type.kinds == Kind.STR
        plain = text or known.type.is_only(REAL_NUMBER)
        if plain and isinstance(other, plan.Variable) and not isinstance(known, plan.Variable):
            bound = lowering.needs.bind_value(other, other.name, False, EqualValueEncoding(text))
            kind = exp.NullSafeEQ if call.function.name == "eq" else exp.NullSafeNEQ
            return sql_builder.binary(kind, lowering.lower_expr(known, scope), bound)
    return None


def _lower_equality(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    left, right = (argument.type for argument in call.arguments)
    equal = call.function.name == "eq"
    for index, argument in enumerate(call.arguments):
        if isinstance(argument, plan.Constant) and argument.value is None:
            # None equals nothing but None, whatever the other side is.
            question = call.arguments[1 - index]
            if isinstance(question, plan.Subquery) and is_exists(question.query):
                found = lowering.lower_exists(question, scope)
                return exp.Not(this=found) if equal else found
            other = sql_builder.wrap_operand(lowering.lower_value(call.arguments[1 - index], scope))
            none = sql_builder.null()
            return exp.Is(this=other, expression=none if equal else exp.Not(this=none))
    if not have_same_storage_class(left, right, none=True):
        return _compare_with_equal_value(lowering, call, scope) or _lower_handle_comparison(lowering, call, scope)
    a, b = (lowering.lower_expr(argument, scope) for argument in call.arguments)
    if left.may_be(Kind.NONE) or right.may_be(Kind.NONE):
        return sql_builder.binary(exp.NullSafeEQ if equal else exp.NullSafeNEQ, a, b)
    return sql_builder.binary(exp.EQ if equal else exp.NEQ, a, b)


def _can_test_one_by_one(item: plan.Expr, items: plan.MakeList) -> bool:
    """Whether nobody notices how often these are read, and SQLite's own equality is the language's."""
    return (
        bool(items.items)
        and isinstance(item, PLAIN_READS)
        and not is_costly(items)
        and all(have_same_storage_class(item.type, one.type, none=True) for one in items.items)
    )


def _lower_membership(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """`x IN [1, 2, 3]`, a list of the class of x: written out where it is short, else walked once by SQLite.

    `x IN [a, b]` is `x = a OR x = b`.

    The list of a query is one of SQL: `x IN (SELECT e.b FROM ...)`.
    """
    item, items = call.arguments
    if isinstance(items, plan.MakeList) and _can_test_one_by_one(item, items):
        equal = replace(call.function, name="eq")
        tests = [
            lowering.lower_expr(replace(call, function=equal, arguments=(item, one)), scope) for one in items.items
        ]
        test = sql_builder.disjunction(tests)
        return test if call.function.name == "in" else exp.Not(this=sql_builder.wrap_operand(test))
    known = items.type.element if items.type.kinds == Kind.LIST else None
    if known is None or not have_same_storage_class(item.type, known) or known.may_be(Kind.BOOL):
        return lower_membership(lowering, call, scope)
    listed = items.query.columns[0].expr if isinstance(items, plan.Subquery) and is_column_query(items.query) else None
    if listed is None and not isinstance(items, (plan.Constant, plan.Variable)):
        return None  # before the item is lowered: who comes next would lower it again, and all within it
    this = sql_builder.wrap_operand(lowering.lower_expr(item, scope))
    if listed is not None:
        assert isinstance(items, plan.Subquery)
        found = lowering.lower_unordered(items, scope, lambda inner: lowering.lower_expr(listed, inner))
        test = exp.In(this=this, query=exp.Subquery(this=found))
    elif isinstance(items, plan.Constant) and len(items.value) <= MAX_WRITTEN_MEMBERS:
        written = [lowering.lower_constant(plan.Constant(value, known, span=items.span)) for value in items.value]
        test = exp.In(this=this, expressions=written)
    else:
        label = lowering.needs.choose_label("members")
        members = lowering.lower_expr(items, scope)
        walked = sql_builder.table_function(lowering.needs.name_elements_table(()), [members], label)
        listed_once = sql_builder.select([sql_builder.column("this", label)], [walked])
        test = exp.In(this=this, query=exp.Subquery(this=listed_once))
    return test if call.function.name == "in" else exp.Not(this=exp.Paren(this=test))


def _lower_like(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """A pattern that is written out. SQLite's GLOB ends at a NUL, so some texts with one in them are left to Python."""
    value, pattern = call.arguments
    if call.function.raises or not isinstance(pattern, plan.Constant) or pattern.value.count("%") > 2:
        return None  # SQLite's GLOB tries every place of each *
    text, node, negated = pattern.value, lowering.lower_expr(value, scope), call.function.name == "not_like"
    part = text.strip("%")
    plain = "_" not in part and "%" not in part
    if plain and text == part:
        return sql_builder.binary(exp.NEQ if negated else exp.EQ, node, lowering.lower_constant(pattern))
    if plain and part and text == f"%{part}%":
        found = sql_builder.call("instr", node, sql_builder.string(part))
        return sql_builder.binary(exp.EQ if negated else exp.GT, found, sql_builder.number(0))
    test: Node = exp.Glob(
        this=sql_builder.wrap_operand(node), expression=sql_builder.string(text.translate(GLOB_PATTERN))
    )
    test = exp.Not(this=sql_builder.wrap_operand(test)) if negated else test
    if plain and text == f"{part}%":
        return test
    if not can_repeat(node):
        return None
    nul = sql_builder.call("instr", node.copy(), sql_builder.call("char", sql_builder.number(0)))
    return sql_builder.case([(nul, lowering.call_python(call, scope))], test)


SPECIAL_OPERATIONS: dict[str, LowerFunction] = {
    "eq": _lower_equality,
    "ne": _lower_equality,
    "item": lower_item,
    "in": _lower_membership,
    "not_in": _lower_membership,
    "like": _lower_like,
    "not_like": _lower_like,
}

assert SPECIAL_OPERATIONS.keys() == {name for name, row in OPERATIONS.items() if "sqlite" in row.by_hand}
