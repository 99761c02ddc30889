"""Tables of DuckDB for queries that run elsewhere: with those rows alone that WHERE can keep, as DuckDB finds out.

Values of other rows never reach Python. WHERE stays as it is, so a table with too many rows is no harm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Protocol

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail, is_volatile, list_sources, split_and, walk
from ss2sql.language.rows import make_unique_name
from ss2sql.lowering.portable.pushdown import ExternalTable, filter_table
from ss2sql.runtime.external.duckdb_query import find_duck_frame
from ss2sql.runtime.external.duckdb_sources import DuckFrame
from ss2sql.runtime.external.join_pushdown import push_down_joins
from ss2sql.runtime.external.statement_cancellation import interrupt_when_due
from ss2sql.runtime.run.run_state import Run


class PushedTable(Protocol):
    """What DuckDB hands over instead of whole tables.

    `sources` are those that read the tables, `conditions` the parts of WHERE that it evaluates for them.
    """

    @property
    def sources(self) -> tuple[plan.ValueSource, ...]: ...

    @property
    def conditions(self) -> tuple[plan.Expr, ...]: ...

    def read_table(self, run: Run) -> Any:
        """What a run reads under the name that it has in the query."""

    def can_run_with(self, variable: Callable[[str], Any]) -> bool:
        """Whether it can be had with the values that variables have now; the query is made anew where it cannot."""


@dataclass(frozen=True, slots=True)
class PredicatePushdown:
    """A source of a query, and the parts of WHERE that speak of it alone and come before what may fail."""

    source: plan.ValueSource
    conditions: tuple[plan.Expr, ...]

    @property
    def sources(self) -> tuple[plan.ValueSource, ...]:
        return (self.source,)

    def read_table(self, run: Run) -> Any:
        """The source as it is now, with the rows that are kept; the whole of it where it is no table any more."""
        assert isinstance(self.source.value, plan.Variable)
        frame = find_duck_frame(self.source, run.get_source)
        kept = None if frame is None else self.filter_frame(frame, run.get_source)
        if frame is None or kept is None:
            return run.get_source(self.source.value.name)
        with frame.convert_errors(self.source.span), interrupt_when_due(run, frame.reading):
            return frame.restrict_rows(kept)

    def can_run_with(self, variable: Callable[[str], Any]) -> bool:
        return True

    def filter_frame(self, frame: DuckFrame, variable: Callable[[str], Any]) -> ExternalTable | None:
        """The rows of the table that are kept; None where DuckDB cannot tell which."""
        if frame.reading.strange:  # texts may compare in another way
            return None
        try:
            return filter_table(frame.outside, self.source, self.conditions, variable)
        except UnsupportedError:
            return None


def push_down_predicates(
    query: plan.Query, variable: Callable[[str], Any]
) -> tuple[plan.Query, dict[str, PushedTable]]:
    """The query over variables of their own instead of the tables that DuckDB can narrow or join, and what these are.

    Args:
        query: a query that DuckDB does not run.
        variable: gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """
    found: dict[str, PushedTable] = {}
    if query.search is not None or query.where is None or any(map(_can_source_fail, query.sources)):
        return query, {}
    values = [source for source in query.sources if isinstance(source, plan.ValueSource)]
    if all(find_duck_frame(source, variable) is None for source in values):
        return query, {}
    if is_volatile(query):  # where something is assigned, conditions may be others for the next row
        return query, {}
    safe = _find_safe_conditions(query.where)
    query, joinings = push_down_joins(query, safe, variable)
    handed: dict[int, PushedTable] = {joining.sources[0].id: joining for joining in joinings}
    sources = []
    for source in query.sources:
        if isinstance(source, plan.ValueSource):
            known = handed.get(source.id) or _find_pushdown(safe, source, variable)
            if known is not None:
                name = make_unique_name(f"{source.name}.kept", found)  # no script has a variable with a dot
                found[name] = known
                source = replace(source, value=plan.Variable(name, source.value.type, frame=True, span=source.span))
        sources.append(source)
    return replace(query, sources=tuple(sources)), found


def _can_source_fail(source: plan.Source) -> bool:
    """Whether opening a source may raise, or asks for a row of another one: it is opened for all rows before it."""
    match source:
        case plan.ValueSource(value=plan.Variable() | plan.Constant()) | plan.TableSource():
            return False
    return True


def _find_safe_conditions(where: plan.Expr | None) -> list[plan.Expr]:
    """The parts of WHERE before what may fail or calls a Python function: rows that they do not keep are not missed."""
    found: list[plan.Expr] = []
    for part in split_and(where):
        if can_fail(part) or any(isinstance(node, plan.Call) and not node.function.builtin for node in walk(part)):
            break
        found.append(part)
    return found


def _find_pushdown(
    safe: Iterable[plan.Expr], source: plan.ValueSource, variable: Callable[[str], Any]
) -> PredicatePushdown | None:
    """What DuckDB can ask of a source, if it is a table there and there is such a thing."""
    frame = find_duck_frame(source, variable)
    if frame is None:
        return None
    own = (part for part in safe if list_sources(part) == {source.id})
    found = tuple(part for part in own if PredicatePushdown(source, (part,)).filter_frame(frame, variable) is not None)
    return PredicatePushdown(source, found) if found else None
