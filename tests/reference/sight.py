"""What an expression sees: the queries around it, each with its elements and its START WITH variables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from ss2sql.frontend.syntax import ast

from .values import Failure, fresh


@dataclass(frozen=True)
class LateList:
    """A variable's list literal that mentions `a.this`: it is read again wherever it is used."""

    literal: ast.ListLiteral


@dataclass(frozen=True)
class Bound:
    """A source of a query with its current element. Without columns, `columns` is empty."""

    name: str | None
    columns: tuple[str, ...]
    element: Any
    declared: bool = True  # whether the columns are known before it is read

    def column(self, name: str) -> Any:
        return None if self.element is None else self.element.get(name)  # a key that this row lacks reads as None


@dataclass(frozen=True)
class Group:
    """A group of GROUP BY while its row is made: the values of its keys and what its aggregates collected."""

    keys: tuple[tuple[ast.Expr, Any], ...]
    aggregates: tuple[tuple[ast.Call, tuple[Any, ...]], ...]


@dataclass(frozen=True)
class Frame:
    """One query in the middle of its work: its START WITH variables and the elements that are bound so far.

    Of a step `search` is the search that makes it, and `before` are the steps before it on its path.
    """

    outer: Frame | None
    state: dict[str, Any] = field(default_factory=dict)
    bound: tuple[Bound, ...] = ()
    group: Group | None = None
    columns: Mapping[str, ast.Expr] = field(default_factory=dict)  # of SELECT by their names, in ORDER BY and HAVING
    search: Any = None
    before: tuple[Frame, ...] = ()

    def outwards(self) -> Iterator[Frame]:
        frame: Frame | None = self
        while frame is not None:
            yield frame
            frame = frame.outer


def frames(frame: Frame | None) -> Iterator[Frame]:
    """The queries around an expression, innermost first."""
    return iter(()) if frame is None else frame.outwards()


def is_state(frame: Frame | None, name: str) -> bool:
    return any(name in level.state for level in frames(frame))


def in_query(level: Frame, name: str) -> tuple[Any, ...]:
    """What a bare name means in one of the queries around it: a tuple of its value, or of nothing."""
    if name in level.state:
        return (level.state[name],)
    owners = [bound for bound in level.bound if bound.declared and name in bound.columns]
    if len(owners) > 1:
        raise Failure("R004", name)
    return (owners[0].column(name),) if owners else ()


def undeclared(frame: Frame | None, name: str) -> tuple[Any, ...]:
    """What a bare name that is nothing else means: the innermost column that is known only when it is read."""
    for level in frames(frame):
        for bound in level.bound:
            if not bound.declared and name in bound.columns:
                return (bound.column(name),)
    return ()


def is_visible(frame: Frame | None, name: str) -> bool:
    """Whether a bare name means something in the queries around it, ambiguous or not."""
    return any(
        name in level.columns or name in level.state or any(name in bound.columns for bound in level.bound)
        for level in frames(frame)
    )


def source_named(frame: Frame | None, name: str) -> Bound | None:
    for level in frames(frame):
        for bound in level.bound:
            if bound.name == name:
                return bound
    return None


def this(frame: Frame | None) -> Any:
    """The current element of the first source of the innermost query that has one."""
    return first(frame).element


def first(frame: Frame | None) -> Bound:
    """The first source of the innermost query that has one."""
    for level in frames(frame):
        if level.bound:
            return level.bound[0]
    raise Failure("R014", "this outside of a query")


def columns_of(elements: list[Any]) -> tuple[str, ...]:
    """The columns of a list of dicts: all keys in the order of first appearance. Other lists have none."""
    if not elements or not all(isinstance(element, dict) for element in elements):
        return ()
    return tuple(dict.fromkeys(key for element in elements for key in element if isinstance(key, str)))


def elements_of(value: Any) -> list[Any]:
    """The elements of a source: a list's own, the rows of a dict of columns, or the single value."""
    if isinstance(value, list):
        return fresh(value)  # type: ignore[no-any-return]
    if isinstance(value, dict) and value and all(isinstance(column, list) for column in value.values()):
        lengths = {len(column) for column in value.values()}
        if len(lengths) > 1:
            raise Failure("X005", "columns of several lengths")
        return [{name: fresh(value[name][i]) for name in value} for i in range(lengths.pop())]
    return [fresh(value)]


# Mentions: whether an expression depends on the elements or START WITH variables of one query.


@dataclass(frozen=True)
class Own:
    """What belongs to the query: source names, START WITH variables, whether `this` does, and who decides on names."""

    sources: frozenset[str]
    states: frozenset[str]
    this: bool
    elsewhere: Callable[[str], bool]  # whether a bare name means something outside of the query
    late: Callable[[str], LateList | None]
    columns: Callable[[ast.Expr], Iterable[str]]  # those of what stands in FROM, as far as they are known
    free: Callable[[Any, Own], bool] = lambda node, own: False  # parts that do not count where they stand
    asks: Callable[[Any], bool] = lambda node: False  # whether a call asks for the path of a step


def mentions(node: Any, own: Own) -> bool:
    """Whether the node mentions something of its own query; where in doubt, yes.

    A bare name counts unless it is known to mean something elsewhere; `eval` always counts.
    """
    if own.free(node, own):
        return False
    if own.asks(node):
        return True
    match node:
        case ast.This(source=None) | ast.Attribute(source=None):
            return own.this
        case ast.This(source=source) | ast.Attribute(source=source):
            return source in own.sources
        case ast.Name(name=name):
            late = None if name in own.states else own.late(name)
            if late is not None:
                return mentions(late.literal, own)
            return name in own.states or not own.elsewhere(name)
        case ast.Call(function="eval"):
            return True
        case ast.Call(function="to", arguments=(value, ast.Name())):
            return mentions(value, own)  # the other one is the name of a column
        case ast.Query():
            return query_mentions(node, own)
        case tuple():
            return any(mentions(item, own) for item in node)
        case _ if is_dataclass(node):
            return any(mentions(getattr(node, part.name), own) for part in fields(node) if part.compare)
        case _:
            return False


def query_mentions(query: ast.Query, own: Own) -> bool:
    """A nested query has names of its own; its first source sees no `this` and no sources of it, START WITH nothing.

    Each source sees the columns of those before it, the other clauses see those of all.
    """
    hidden = frozenset(name for name in map(source_name, query.sources) if name)
    names: frozenset[str] = frozenset()
    for assigned in query.start:  # a later one sees those before it
        values = assigned.values if isinstance(assigned, ast.Each) else assigned.value
        if mentions(values, _without(own, names, frozenset(), True)):
            return True
        names |= {assigned.name}
    if mentions(query.limit, own):
        return True
    for number, source in enumerate(query.sources):
        if mentions(source.expr, _without(own, names, hidden if number else frozenset(), number == 0)):
            return True
        names = names.union(own.columns(source.expr))
    rest = (query.columns, query.where, query.options, query.connect, query.stop, query.group, query.having)
    more = (query.first, query.made, query.siblings, query.order)
    return mentions((*rest, *more), _without(own, names, hidden, False))


def _without(own: Own, names: frozenset[str], sources: frozenset[str], this: bool) -> Own:
    """The same, inside of a nested query with names and sources of its own."""

    def elsewhere(name: str) -> bool:
        return name in names or own.elsewhere(name)

    return replace(
        own, states=own.states - names, elsewhere=elsewhere, sources=own.sources - sources, this=own.this and this
    )


def assigned_names(node: Any) -> Iterator[str]:
    """The names of variables that are assigned in a part of a script."""
    if isinstance(node, ast.Assign):
        yield node.name
    if isinstance(node, tuple):
        for item in node:
            yield from assigned_names(item)
    elif is_dataclass(node):
        for part in fields(node):
            if part.compare:
                yield from assigned_names(getattr(node, part.name))


def late_literal(expr: ast.Expr, frame: Frame | None) -> bool:
    """Whether an assigned expression is a list literal that mentions `a.this` of a source that is not in sight."""
    return isinstance(expr, ast.ListLiteral) and any(_unseen(item, frame) for item in expr.items)


def _unseen(node: Any, frame: Frame | None) -> bool:
    match node:
        case ast.This(source=str() as name):
            return source_named(frame, name) is None
        case ast.Query():
            return False  # its own sources are in its own sight
        case tuple():
            return any(_unseen(item, frame) for item in node)
        case _ if is_dataclass(node):
            return any(_unseen(getattr(node, part.name), frame) for part in fields(node) if part.compare)
        case _:
            return False


def source_name(source: ast.From) -> str | None:
    """The name of a source: the written one, else that of the name or function that it reads; else none."""
    if source.name is not None:
        return source.name
    match source.expr:
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case _:
            return None
