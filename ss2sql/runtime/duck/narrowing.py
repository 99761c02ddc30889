"""Tables of DuckDB for queries that run elsewhere: with those rows alone that WHERE can keep, as DuckDB finds out.

Values of other rows never reach Python. WHERE stays as it is, so a table with too many rows is no harm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ss2sql import plan
from ss2sql.errors import UnsupportedError
from ss2sql.lowering.portable.here import Outside, narrowed
from ss2sql.runtime.duck.query import frame_of
from ss2sql.runtime.duck.tables import DuckFrame
from ss2sql.runtime.rows import free_name
from ss2sql.runtime.run import Run
from ss2sql.walk import can_fail, is_volatile, walk

Variables = Callable[[str], Any]


@dataclass(frozen=True, slots=True)
class Narrowing:
    """A source of a query, and the parts of WHERE that speak of it alone and come before what may fail."""

    source: plan.ValueSource
    conditions: tuple[plan.Expr, ...]

    def read(self, run: Run) -> Any:
        """The source as it is now, with the rows that are kept; the whole of it where it is no table any more."""
        assert isinstance(self.source.value, plan.Variable)
        frame = frame_of(self.source, run.source)
        kept = None if frame is None else self.of(frame, run.source)
        return run.source(self.source.value.name) if frame is None or kept is None else frame.within(kept)

    def under(self, name: str) -> plan.ValueSource:
        """The source, reading a variable of this name."""
        assert isinstance(self.source.value, plan.Variable)
        return replace(self.source, value=replace(self.source.value, name=name))

    def of(self, frame: DuckFrame, variable: Variables) -> Outside | None:
        """The rows of the table that are kept; None where DuckDB cannot tell which."""
        if frame.reading.strange:  # texts may compare in another way
            return None
        try:
            return narrowed(frame.outside, self.source, self.conditions, variable)
        except UnsupportedError:
            return None


def narrow(query: plan.Query, variable: Variables) -> tuple[plan.Query, dict[str, Narrowing]]:
    """The query over variables of their own instead of the tables that can be narrowed, and what these are.

    Args:
        query: a query that DuckDB does not run.
        variable: gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """
    found: dict[str, Narrowing] = {}
    sources = []
    if query.search is not None or query.where is None or any(map(_may_fail, query.sources)):
        return query, {}
    for source in query.sources:
        narrowing = _narrowing(query.where, source, variable) if isinstance(source, plan.ValueSource) else None
        if narrowing is not None:
            name = free_name(f"{source.name}.kept", found)  # no script has a variable with a dot
            found[name] = narrowing
            source = narrowing.under(name)
        sources.append(source)
    if not found or is_volatile(query):  # where something is assigned, conditions may be others for the next row
        return query, {}
    return replace(query, sources=tuple(sources)), found


def _may_fail(source: plan.Source) -> bool:
    """Whether opening a source may raise, or asks for a row of another one: it is opened for all rows before it."""
    match source:
        case plan.ValueSource(value=plan.Variable() | plan.Constant()) | plan.TableSource():
            return False
    return True


def _narrowing(where: plan.Expr, source: plan.ValueSource, variable: Variables) -> Narrowing | None:
    """What DuckDB can ask of a source, if it is a table there and there is such a thing."""
    frame = frame_of(source, variable)
    if frame is None:
        return None
    found: list[plan.Expr] = []
    for part in where.parts if isinstance(where, plan.And) else (where,):
        if can_fail(part) or any(isinstance(node, plan.Call) and not node.function.builtin for node in walk(part)):
            break
        owners = {node.source for node in walk(part) if isinstance(node, (plan.Element, plan.Column))}
        if owners == {source.id} and Narrowing(source, (part,)).of(frame, variable) is not None:
            found.append(part)
    return Narrowing(source, tuple(found)) if found else None
