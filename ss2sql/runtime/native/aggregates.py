"""The aggregates of a query, and what computes them of the values of a group."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.walk import walk_own


def aggregates_in(query: plan.Query) -> list[plan.Aggregate]:
    """The aggregates over the rows of the query's groups, in the order in which their arguments are evaluated."""
    if not query.grouped:
        return []
    places: list[Any] = [output.expr for output in query.columns] if query.aggregated else []
    places += [query.having] if query.having is not None else []
    places += [key.expr for key in query.order] if query.aggregated else []
    found = (node for place in places for node in walk_own(place) if isinstance(node, plan.Aggregate))
    return list({id(node): node for node in found}.values())  # equal ones are one


def counts_rows(node: plan.Aggregate) -> bool:
    """Whether an aggregate is the number of rows, whatever their values are."""
    return node.function == "count" and (node.argument is None or not node.argument.type.may(Kind.NONE))


def aggregate_of(node: plan.Aggregate) -> Callable[[list[Any]], Any]:
    """What computes an aggregate of a group's values. None is skipped where there may be any."""
    if counts_rows(node):
        return len
    assert node.argument is not None
    known, row = node.argument.type, GROUPS[node.function]
    if known.may(Kind.NONE) or node.may_be_empty:
        return row.of_group
    form = next((form for form in row.python if form.when([known])), None)
    return row.value if form is None or isinstance(form.text, str) else form.text
