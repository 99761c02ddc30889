"""`cells`: an index into a list that is the same for the whole statement, and membership in one, without a Python call.

    grid[y][x] == 1              instr(x'0001', substr(:grid_cells, y * 300 + x + 1, 1)) - 1 = 1
    [x, y] IN free               CASE WHEN x BETWEEN 0 AND 299 AND y BETWEEN 0 AND 299
                                 THEN substr(:free_cells, x * 300 + y + 1, 1) = x'01' ELSE 0 END

The list is bound as a BLOB with a byte for each element (see blob_encoding.py); `instr` makes a number of a byte,
whatever the encoding of the database. Where an index may be out of range, a CASE leaves it to Python, which counts from
the end or raises.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql.errors import Source, Span
from ss2sql.language import plan
from ss2sql.language.implied_bounds import Comparison, narrow_type
from ss2sql.language.kinds import ANY, BOOL, Kind, Type, type_of
from ss2sql.language.operations.arithmetic import EXACT
from ss2sql.lowering import sql_builder
from ss2sql.lowering.blob_encoding import ListEncoding, PointSetEncoding
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.storage_class import INTEGRAL, can_repeat, is_sql_number

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope

MAX_SHOWN_BYTES = 16  # bytes that are written into the text
NOWHERE = Span(Source(""), 0, 0)
MAX_BOX_SIZE = 2**22  # 4 MB; a list of a few points that lie far apart is left to Python


# --- elements ------------------------------------------------------------------------------------------


def lower_item(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """`values[i]` and `rows[i][j]`, where the elements are integers in a narrow range, or bools."""
    container, indexes = _split_indexes(call)
    packing = None if "cells" in lowering.needs.disabled else _choose_encoding(container.type, len(indexes))
    if packing is None or not isinstance(container, (plan.Constant, plan.Variable)):
        return None
    if not all(index.type.is_only(INTEGRAL) and is_sql_number(index.type) for index in indexes):
        return None
    nodes = [lowering.lower_expr(index, scope) for index in indexes]
    sizes = [container.type.size, container.type.item.size if container.type.item else None]
    cells = lowering.needs.bind_packed(container, packing)
    found = _build_byte_lookup(
        lowering, cells, _build_offset(nodes, sizes[1 : len(nodes)]), _get_leaf_type(container.type, len(indexes))
    )
    if all(_is_index_in_bounds(index, size, scope.facts) for index, size in zip(indexes, sizes, strict=False)):
        return found
    if not all(map(can_repeat, nodes)):
        return None
    inside = [_build_between(node, 0, size - 1) for node, size in zip(nodes, sizes, strict=False) if size is not None]
    otherwise = sql_builder.mark_as_rare(
        lowering.call_python(call, [lowering.lower_value(argument, scope) for argument in call.arguments])
    )
    condition = sql_builder.conjunction(inside)
    assert condition is not None
    return sql_builder.case([(condition, found)], otherwise)


def _split_indexes(call: plan.Call) -> tuple[plan.Expr, list[plan.Expr]]:
    """`rows[i][j]` as `rows` and its indexes."""
    container, index = call.arguments
    match container:
        case plan.Call(function=plan.Function(name="item", builtin=True), arguments=(rows, first)):
            return rows, [first, index]
        case _:
            return container, [index]


def _choose_encoding(kind: Type, depth: int) -> ListEncoding | None:
    """How lists of the type are packed; None where they cannot be, or where their size is not known."""
    for _ in range(depth):
        if kind.kinds != Kind.LIST or kind.size is None or kind.item is None:
            return None
        kind = kind.item
    if kind.kinds == Kind.BOOL:
        return ListEncoding(depth > 1, 0)
    if kind.kinds != Kind.INT or kind.low is None or kind.high is None or kind.high - kind.low > 255:
        return None
    if not kind.is_bounded(EXACT):
        return None  # the least is written into the text
    return ListEncoding(depth > 1, int(kind.low))


def _get_leaf_type(kind: Type, depth: int) -> Type:
    for _ in range(depth):
        kind = kind.item or ANY
    return kind


def _is_index_in_bounds(index: plan.Expr, size: int | None, facts: Sequence[Comparison]) -> bool:
    """Whether an index is one that counts from the start, in a list of this size."""
    kind = narrow_type(index, facts)
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
    number = sql_builder.call("instr", known, byte)
    offset = least - 1
    return (
        number
        if offset == 0
        else sql_builder.binary(exp.Add if offset > 0 else exp.Sub, number, sql_builder.number(abs(offset)))
    )


def _build_offset(nodes: Sequence[Node], sizes: Sequence[int | None]) -> Node:
    """The place of an element, counted from 0; `sizes` are those of all positions but the first."""
    place = nodes[0].copy()
    for node, size in zip(nodes[1:], sizes, strict=True):
        place = sql_builder.binary(
            exp.Add, sql_builder.binary(exp.Mul, place, sql_builder.number(size or 0)), node.copy()
        )
    return place


def _build_between(node: Node, low: int, high: int) -> Node:
    return exp.Between(
        this=sql_builder.wrap_operand(node.copy()), low=sql_builder.number(low), high=sql_builder.number(high)
    )


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
    places = [_subtract_number(node, low) for node, (low, _) in zip(nodes, packing.box, strict=True)]
    place = _build_offset(places, [high - low + 1 for low, high in packing.box[1:]])
    cells = lowering.needs.bind_packed(container, packing)
    inside = sql_builder.conjunction(
        [_build_between(node, low, high) for node, (low, high) in zip(nodes, packing.box, strict=True)]
    )
    assert inside is not None
    found = sql_builder.case([(inside, _build_byte_lookup(lowering, cells, place, BOOL))], sql_builder.number(0))
    return found if call.function.name == "in" else exp.Not(this=found)


def _choose_point_encoding(kind: Type) -> PointSetEncoding | None:
    points = kind.item
    if kind.kinds != Kind.LIST or points is None or points.kinds != Kind.LIST or points.positions is None:
        return None
    box: list[tuple[int, int]] = []
    for position in points.positions:
        if not position.is_only(INTEGRAL) or position.low is None or position.high is None:
            return None
        box.append((int(position.low), int(position.high)))
    packing = PointSetEncoding(tuple(box))
    return packing if packing.size <= MAX_BOX_SIZE else None


def _subtract_number(node: Node, number: int) -> Node:
    return node if number == 0 else sql_builder.binary(exp.Sub, node, sql_builder.number(number))
