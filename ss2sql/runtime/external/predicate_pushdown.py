"""Tables of DuckDB for queries that run elsewhere: with those rows alone that WHERE can keep.

Values of other rows never reach Python. WHERE stays as it is, so a table with too many rows is no harm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail, is_volatile, list_sources, split_and, walk
from ss2sql.language.rows import make_unique_name
from ss2sql.lowering.portable.pushdown import ExternalTable, lower_table_pushdown
from ss2sql.runtime.external.duckdb_query import find_duck_frame
from ss2sql.runtime.external.duckdb_sources import DuckFrame
from ss2sql.runtime.external.table_statements import interrupt_when_due
from ss2sql.runtime.run.run_state import Run


@dataclass(frozen=True, slots=True)
class PredicatePushdown:
    """A source of a query, and the parts of WHERE that speak of it alone and come before what may fail."""

    source: plan.ValueSource
    conditions: tuple[plan.Expr, ...]

    def read_table(self, run: Run) -> Any:
        """The source as it is now, with the rows that are kept; the whole of it where it is no table any more."""
        assert isinstance(self.source.value, plan.Variable)
        frame = find_duck_frame(self.source, run.get_source)
        kept = None if frame is None else self.filter_frame(frame, run.get_source)
        if frame is None or kept is None:
            return run.get_source(self.source.value.name)
        with interrupt_when_due(run, frame.reading):
            return frame.restrict_rows(kept)

    def filter_frame(self, frame: DuckFrame, variable: Callable[[str], Any]) -> ExternalTable | None:
        """The rows of the table that are kept; None where DuckDB cannot tell which."""
        if frame.reading.strange:  # texts may compare in another way
            return None
        try:
            return lower_table_pushdown(frame.outside, self.source, self.conditions, variable)
        except UnsupportedError:
            return None


def push_down_predicates(
    query: plan.Query, variable: Callable[[str], Any]
) -> tuple[plan.Query, dict[str, PredicatePushdown]]:
    """The query over variables of their own instead of the tables that DuckDB can narrow, and what these are.

    Args:
        query: a query that DuckDB does not run.
        variable: gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """
    found: dict[str, PredicatePushdown] = {}
    if query.search is not None or query.where is None or any(map(_can_source_fail, query.sources)):
        return query, {}
    if is_volatile(query):  # where something is assigned, conditions may be others for the next row
        return query, {}
    safe = _find_pushed_conditions(query.where)
    sources = []
    for source in query.sources:
        if isinstance(source, plan.ValueSource):
            known = _find_pushdown(safe, source, variable)
            if known is not None:
                name = make_unique_name(f"{source.name}.kept", found)  # no script has a variable with a dot
                found[name] = known
                source = replace(source, value=plan.Variable(name, source.value.type, frame=True, span=source.span))
        sources.append(source)
    return replace(query, sources=tuple(sources)), found


def _can_source_fail(source: plan.Source) -> bool:
    """Whether opening a source may raise, or asks for a row of another one: it is opened for all rows before it."""
    known = isinstance(source, plan.ValueSource) and isinstance(source.value, (plan.Variable, plan.Constant))
    return not (known or isinstance(source, plan.TableSource))


def _find_pushed_conditions(where: plan.Expr | None) -> list[plan.Expr]:
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
