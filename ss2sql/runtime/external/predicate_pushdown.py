"""Tables of DuckDB for queries that run elsewhere: with those rows alone that WHERE can keep, joined there.

SQLite and Python would look for rows of the second table once for each row of the first. For 1,000,000 and 1,000 rows
that takes 22 s and 2 s of the processor, in DuckDB 0.2 s.

Values of other rows never reach Python. WHERE stays as it is, so a table with too many rows is no harm.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

from sqlglot import exp

from ss2sql.errors import UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import can_fail, is_volatile, list_sources, rebuild_node, split_and, walk
from ss2sql.language.rows import make_unique_name
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.portable_expressions import build_refusal
from ss2sql.lowering.portable.portable_flat import ColumnNames
from ss2sql.lowering.portable.pushdown import ExternalTable, join_tables, lower_table_pushdown
from ss2sql.lowering.sql_builder import DUCKDB
from ss2sql.runtime.external.duckdb_query import find_duck_frame
from ss2sql.runtime.external.duckdb_sources import DuckFrame
from ss2sql.runtime.external.table_statements import interrupt_when_due
from ss2sql.runtime.run.run_state import Run
from ss2sql.vtables.frames.frame import Column, Frame

MAX_JOINED_ROWS = 10_000  # rows that are handed over in any case; else no more than the tables have together


@dataclass(frozen=True, slots=True)
class JoinPushdown:
    """Sources of a query that follow each other, and parts of its WHERE, which DuckDB evaluates for them.

    `names` are those of the columns that the query reads, by the number of the source and the name there.
    """

    sources: tuple[plan.ValueSource, ...]
    conditions: tuple[plan.Expr, ...]
    names: Mapping[tuple[int, str], str]

    def read_table(self, run: Run) -> Frame:
        """The rows that are kept, in the order of the product."""
        frames = self._find_frames(run.get_source)
        select, first = self._write_select(frames, run.get_source), frames[self.sources[0].id]
        with first.convert_errors(self.sources[0].span), interrupt_when_due(run, first.reading):
            rows = first.reading.fetch_arrow(DUCKDB.print_tree(select))
        columns = {}
        for (source, name), new in self.names.items():
            frame = frames[source]
            columns[new] = Column(
                frame.columns[name].type, partial(frame.read_column_values, name, partial(rows.column, new))
            )
        return Frame(columns, rows.num_rows)

    def can_run_with(self, variable: Callable[[str], Any]) -> bool:
        """Whether DuckDB can ask all of it with the values that variables have now."""
        try:
            self._write_select(self._find_frames(variable), variable)
        except UnsupportedError:
            return False
        return True

    def reads_only_sources(self, part: plan.Expr) -> bool:
        """Whether a part of WHERE speaks of the sources, and of nothing else that has rows."""
        owners = list_sources(part)
        return bool(owners) and owners <= {source.id for source in self.sources}

    def _find_frames(self, variable: Callable[[str], Any]) -> dict[int, DuckFrame]:
        """The tables behind the sources, by their numbers. Raises UnsupportedError where one is none any more."""
        found = {source.id: find_duck_frame(source, variable) for source in self.sources}
        for source in self.sources:
            frame = found[source.id]
            if frame is None or frame.reading.strange:
                raise build_refusal(f"{source.name} is no table of DuckDB that compares as others do", source.span)
        return {source: frame for source, frame in found.items() if frame is not None}

    def _write_select(self, frames: Mapping[int, DuckFrame], variable: Callable[[str], Any]) -> exp.Select:
        tables = [(source, frames[source.id].outside) for source in self.sources]
        return join_tables(tables, self.names, self.conditions, variable)

    def is_worthwhile(self, variable: Callable[[str], Any]) -> bool:
        """Whether the rows are few enough to be handed over all at once."""
        frames = self._find_frames(variable)
        first, most = frames[self.sources[0].id], max(MAX_JOINED_ROWS, sum(frame.length for frame in frames.values()))
        some = sql_builder.replace_outputs(self._write_select(frames, variable), [sql_builder.number(1)]).limit(
            most + 1
        )
        some.set("order", None)
        count = exp.Select(expressions=[exp.Count(this=exp.Star())]).from_(some.subquery("kept"))
        with first.convert_errors(self.sources[0].span):
            ((rows,),) = first.reading.fetch_rows(DUCKDB.print_tree(count))
        return bool(rows <= most)


def push_down_joins(
    query: plan.Query, parts: Iterable[plan.Expr], variable: Callable[[str], Any]
) -> tuple[plan.Query, list[JoinPushdown]]:
    """The query over one source instead of those that are joined, which has the number of the first of them.

    Args:
        query: a query that DuckDB does not run.
        parts: the parts of its WHERE that come before what may fail.
        variable: gives the values that variables will have, and raises KeyError or an Error where that is not known.
    """
    tables = tuple(
        source
        for source in query.sources
        if isinstance(source, plan.ValueSource) and find_duck_frame(source, variable) is not None
    )
    if len(tables) < 2:
        return query, []
    whole = JoinPushdown(tables, (), {})
    conditions = [
        part
        for part in parts
        if whole.reads_only_sources(part) and replace(whole, conditions=(part,)).can_run_with(variable)
    ]
    found = []
    for sources in _find_linked_tables(query.sources, tables, conditions):
        chosen = JoinPushdown(sources, (), {})
        chosen = replace(chosen, conditions=tuple(part for part in conditions if chosen.reads_only_sources(part)))
        rest = replace(query, where=_remove_pushed_conditions(query.where, chosen.conditions))
        names = _choose_joined_columns(rest, chosen)
        if names and (joining := replace(chosen, names=names)).is_worthwhile(variable):
            query = _replace_joined_sources(rest, joining)
            found.append(joining)
    return query, found


def _find_linked_tables(
    sources: Iterable[plan.Source], tables: Collection[plan.ValueSource], conditions: Iterable[plan.Expr]
) -> list[tuple[plan.ValueSource, ...]]:
    """Tables that follow each other in FROM, each of which must equal one before it in something."""
    links = {pair for part in conditions if (pair := _get_pushed_join(part))}
    groups: list[tuple[plan.ValueSource, ...]] = []
    for source in sources:
        if not isinstance(source, plan.ValueSource) or source not in tables:
            groups.append(())
        elif groups and any({source.id, other.id} in links for other in groups[-1]):
            groups[-1] += (source,)
        else:
            groups.append((source,))
    return [group for group in groups if len(group) > 1]


def _get_pushed_join(part: plan.Expr) -> frozenset[int] | None:
    """The two sources that a condition says to be equal in something."""
    if not (isinstance(part, plan.Call) and part.function.builtin and part.function.name == "eq"):
        return None
    owners = [list_sources(argument) for argument in part.arguments]
    return frozenset.union(*owners) if all(len(read) == 1 for read in owners) and owners[0] != owners[1] else None


def _remove_pushed_conditions(where: plan.Expr | None, conditions: Collection[plan.Expr]) -> plan.Expr | None:
    """What is left of WHERE."""
    left = tuple(part for part in split_and(where) if not any(part is one for one in conditions))
    return replace(where, parts=left) if isinstance(where, plan.And) and len(left) > 1 else next(iter(left), None)


def _choose_joined_columns(rest: plan.Query, joining: JoinPushdown) -> dict[tuple[int, str], str]:
    """Names for the columns that what is left of a query reads; none where it wants rows as a whole."""
    labels, names = {source.id: source.name for source in joining.sources}, ColumnNames()
    read = [node for node in walk(rest) if isinstance(node, (plan.Element, plan.Column)) and node.source in labels]
    columns = [node for node in read if isinstance(node, plan.Column) and node.declared]
    if len(columns) < len(read):
        return {}
    if not read:  # some column there has to be
        columns = [node for node in walk(joining.conditions[0]) if isinstance(node, plan.Column)][:1]
    wanted = dict.fromkeys((node.source, node.name) for node in columns)
    return {(source, name): names.claim(f"{labels[source]}_{name}", "value") for source, name in wanted}


def _replace_joined_sources(rest: plan.Query, joining: JoinPushdown) -> plan.Query:
    """The query over one source, whose columns have the names of the joining."""
    first, *others = joining.sources
    types = {(source.id, name): kind for source in joining.sources for name, kind in source.columns or ()}
    columns = tuple((new, types[column]) for column, new in joining.names.items())
    label = "_".join(source.name for source in joining.sources)
    element = Type(Kind.DICT, columns=columns)
    span = first.span.extend_to(others[-1].span)
    value = plan.Variable("", Type(Kind.LIST, item=element, columns=columns), frame=True, span=span)
    source = plan.ValueSource(first.id, label, value, element, columns, span=span)

    def replace_node(node: Any) -> Any:
        if isinstance(node, plan.Column) and (node.source, node.name) in joining.names:
            return replace(node, source=first.id, name=joining.names[node.source, node.name])
        return rebuild_node(node, replace_node)

    sources = tuple(source if old is first else old for old in rest.sources if old not in others)
    return rebuild_node(replace(rest, sources=sources), replace_node)


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
            return lower_table_pushdown(frame.outside, self.source, self.conditions, variable)
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
    safe = _find_pushed_conditions(query.where)
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
