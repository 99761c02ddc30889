"""GROUP BY: aggregates, groups in order of first appearance, and one row for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ss2sql.frontend.syntax import ast

from . import queries
from .functions import AGGREGATES
from .sight import Frame, Group
from .values import Failure, equal, hashable

if TYPE_CHECKING:
    from .evaluator import Reference


NOWHERE = Frame(None)
VALUES = ("value", "val")


def is_aggregate(ref: Reference, node: Any) -> bool:
    """Whether it aggregates the rows of a group; a query among its arguments is a list of its own."""
    if not isinstance(node, ast.Call) or node.function not in AGGREGATES or node.function in ref.functions:
        return False
    inner = (one for one in node.arguments if isinstance(one, ast.Query))
    return all(queries.representation_of(one) in VALUES for one in inner)


def aggregates_of(ref: Reference, query: ast.Query, per_group: bool) -> list[ast.Call]:
    """The aggregates of SELECT, HAVING and ORDER BY in the order of evaluation; what is a key is the key's value."""
    if not query.group and not per_group:
        return []
    places = (query.columns, query.having, query.order) if per_group else (query.having,)
    calls = (call for place in places for call in calls_in(ref, place))
    return [call for call in calls if not any(repr(call) == repr(key) for key in query.group)]


def is_whole(ref: Reference, query: ast.Query) -> bool:
    """Whether all rows are one group, because SELECT counts them without GROUP BY."""
    return not query.group and any(call.star or call.distinct for call in calls_in(ref, query.columns))


def calls_in(ref: Reference, node: Any) -> Iterator[ast.Call]:
    """The aggregates of one query below a node; those of a nested query are its own."""
    if is_aggregate(ref, node):
        yield node
    elif isinstance(node, tuple):
        for item in node:
            yield from calls_in(ref, item)
    elif hasattr(node, "__dataclass_fields__") and not isinstance(node, ast.Query):
        for part in node.__dataclass_fields__.values():
            if part.compare:
                yield from calls_in(ref, getattr(node, part.name))


@dataclass(frozen=True)
class Failed:
    """What an aggregate collects where its argument fails: that is raised if the aggregate is computed."""

    reason: Exception


def collected(ref: Reference, argument: ast.Expr, frame: Frame) -> Any:
    """The value of an aggregate's argument in a row."""
    try:
        return ref.evaluate(argument, frame)
    except Exception as reason:
        return Failed(reason)


def only_argument(call: ast.Call) -> ast.Expr:
    arity(call, 2 if call.function == "percentile" else 1)
    return call.arguments[0]


def arity(call: ast.Call, number: int) -> None:
    if len(call.arguments) != number:
        raise Failure("R005", call.function)


def grouped(found: list[queries.Found]) -> list[list[queries.Found]]:
    """The results by equal keys, groups in order of first appearance."""
    groups: list[list[queries.Found]] = []
    for one in found:
        for group in groups:
            if equal(group[0].keys, one.keys):
                group.append(one)
                break
        else:
            groups.append([one])
    return groups


def group_frame(
    ref: Reference, query: ast.Query, group: list[queries.Found], per_group: bool, outer: Frame = NOWHERE
) -> Frame:
    """The frame of a group: that of its first member, with the group's keys and aggregates; `outer` if it has none."""
    keys = tuple(zip(query.group, group[0].keys, strict=True)) if group else ()
    calls = aggregates_of(ref, query, per_group)
    collected = tuple((call, tuple(one.inputs[i] for one in group)) for i, call in enumerate(calls))
    return replace(group[0].frame if group else outer, group=Group(keys, collected))


def having(ref: Reference, query: ast.Query, group: list[queries.Found]) -> bool:
    frame = replace(group_frame(ref, query, group, False), columns=queries.names_of(query))
    return query.having is None or bool(ref.evaluate(query.having, frame))


def one_row_per_group(
    ref: Reference, query: ast.Query, found: list[queries.Found], outer: Frame
) -> list[queries.Found]:
    """HAVING, then SELECT, then the keys of ORDER BY, for one group after the other."""
    rows = []
    for group in grouped(found) if query.group else [found]:
        frame = group_frame(ref, query, group, True, outer)
        named = replace(frame, columns=queries.names_of(query))
        if query.having is None or ref.evaluate(query.having, named):
            row = queries.select(ref, query, frame)
            order = [queries.Key(ref.alone(key.expr, named), key) for key in query.order]
            rows.append(queries.Found([row], frame, [], [], order))
    return rows


def shown_key(keys: list[Any]) -> Any:
    """The key of a partition: the value itself, of several keys a tuple; a list becomes a tuple."""
    return hashable(keys[0]) if len(keys) == 1 else hashable(keys)
