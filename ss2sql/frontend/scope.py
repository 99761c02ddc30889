"""Lexical scopes: what a name means in the place where it stands.

A query opens one scope. While its clauses are resolved one after the other, its sources come into sight from
left to right and its START WITH variables one after the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from ss2sql import plan
from ss2sql.errors import ResolveError, Span, did_you_mean
from ss2sql.kinds import Kind, Type


@dataclass(slots=True)
class Scope:
    """The names of one query, inside those of the queries around it."""

    parent: Scope | None
    query: int
    sources: list[plan.Source] = field(default_factory=list)
    states: dict[str, Type] = field(default_factory=dict)
    grouped: bool = False  # whether aggregates of rows are in place: SELECT, HAVING and ORDER BY of a GROUP BY

    def outwards(self) -> Iterator[Scope]:
        """This scope and those around it, innermost first."""
        scope: Scope | None = self
        while scope is not None:
            yield scope
            scope = scope.parent

    def copy(self) -> Scope:
        """The scope as it is now; `eval` keeps it for the text that it will meet."""
        return Scope(self.parent, self.query, list(self.sources), dict(self.states), self.grouped)

    @property
    def depth(self) -> int:
        return sum(1 for _ in self.outwards())


def element_of(source: plan.Source, span: Span) -> plan.Element:
    """`this` of a source."""
    if isinstance(source, plan.TableSource):
        row = Type(Kind.DICT, columns=source.columns)
        return plan.Element(source.id, row, span=span)
    return plan.Element(source.id, source.element, span=span)


def source_named(scope: Scope | None, name: str, span: Span) -> plan.Source:
    """The innermost source with this name."""
    known: list[str] = []
    for level in scope.outwards() if scope else ():
        for source in level.sources:
            if source.name == name:
                return source
            known.append(source.name)
    hints = did_you_mean(name, known) or (f"name a source in FROM: FROM {name} = ...",)
    raise ResolveError("R003", f"there is no source named '{name}' here", span, hints)


def column_of(source: plan.Source, name: str, span: Span) -> plan.Column:
    """`source.name`."""
    if source.columns is None:
        return plan.Column(source.id, name, declared=False, span=span)
    for column, kind in source.columns:
        if column == name:
            return plan.Column(source.id, name, kind, span=span)
    known = [column for column, _ in source.columns]
    hints = did_you_mean(name, known) or (
        (f"its columns: {', '.join(known)}",) if known else (f"its elements have no columns; write {source.name}.this",)
    )
    raise ResolveError("R001", f"the source '{source.name}' has no column '{name}'", span, hints)


def bound_name(scope: Scope | None, name: str, span: Span) -> plan.State | plan.Column | None:
    """The START WITH variable or column that a bare name means, from the innermost query outwards."""
    for level in scope.outwards() if scope else ():
        if name in level.states:
            return plan.State(level.query, name, level.states[name], span=span)
        owners = [source for source in level.sources if source.columns and name in dict(source.columns)]
        if len(owners) > 1:
            choices = " or ".join(f"{source.name}.{name}" for source in owners)
            raise ResolveError(
                "R004", f"the column '{name}' belongs to {len(owners)} sources", span, (f"write {choices}",)
            )
        if owners:
            return column_of(owners[0], name, span)
    return None


def open_source(scope: Scope | None) -> plan.Source | None:
    """The only source of the innermost query whose columns are known at run time only, if there is just one."""
    candidates = [source for source in scope.sources if source.columns is None] if scope else []
    return candidates[0] if len(candidates) == 1 else None


def names_in_sight(scope: Scope | None) -> list[str]:
    """All names that a bare name could mean here, for suggestions."""
    names: list[str] = []
    for level in scope.outwards() if scope else ():
        names.extend(level.states)
        for source in level.sources:
            names.extend(column for column, _ in source.columns or ())
    return names
