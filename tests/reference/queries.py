"""Queries: section 5 of the language page. Searches share everything that happens to a result after it was found."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ss2sql.frontend.syntax import ast

from . import groups, paths, search
from .functions import BUILTINS
from .sight import Bound, Frame, LateList, Own, columns_of, elements_of, is_visible, mentions, source_name
from .values import Failure, Row, compare_keys, equal, shape

if TYPE_CHECKING:
    from .evaluator import Reference


@dataclass(frozen=True)
class Found:
    """A result on its way through GROUP BY, ORDER BY and LIMIT: a row, or the rows of a path.

    `frame` is the row, or the last step, in which keys are read; `inputs` holds for each aggregate of the query
    what this result adds to it, `keys` the values of GROUP BY and `order` those of ORDER BY.
    """

    rows: list[Row]
    frame: Frame
    inputs: list[Any]
    keys: list[Any]
    order: list[Any]


def answer(ref: Reference, query: ast.Query, outer: Frame | None) -> Any:
    """The value of a query in its representation, whose arguments come last; those of the language take none."""
    value = represented(ref, query, outer)
    form = query.representation
    arguments = () if form is None else (*form.arguments, *(named.value for named in form.named))
    for argument in arguments:
        ref.evaluate(argument, outer)
    if arguments and representation_of(query) != "void":
        raise Failure("V001", "arguments of a representation")
    return value


def represented(ref: Reference, query: ast.Query, outer: Frame | None) -> Any:
    search.check(query)
    query = grouped_by_names(ref, query)
    names = [name for name in map(source_name, query.sources) if name]
    no_repeats(names)
    limit = None if query.limit is None else at_least(0, ref.operand(query.limit, outer))
    offset = 0 if query.offset is None else at_least(0, ref.operand(query.offset, outer))
    cut = slice(offset, None if limit is None else offset + limit)
    representation = representation_of(query)
    shape(representation, [])  # an unknown one fails at once
    computed_once(ref, query)
    for column in query.columns:
        ref.labels.pop(id(column), None)  # of another column, which is gone
        if not isinstance(column, ast.Star):
            with suppress(Failure):  # one that reads the row has a name in each
                ref.labels[id(column)] = column_name(ref, column, Frame(outer))

    whole = groups.is_whole(ref, query)
    late = query.order or query.group or whole or query.distinct  # what needs all results
    if limit == 0 and not (query.order or query.group or whole):  # nothing of the query is evaluated
        search.check_bounds(ref, query, outer)
        return [] if query.searches and not query.last and representation != "void" else shape(representation, [])

    if query.searches:
        hunt = search.Search(ref, query, outer)
        sources, per_group = hunt.sources, hunt.per_group
        paths = hunt.paths()
    else:
        sources = Sources(ref, query, outer, {})
        per_group = sources.per_group()
        paths = flat_rows(ref, query, sources, Frame(outer), per_group)

    results: Iterator[Found] = (finish(ref, query, rows, frame, per_group) for rows, frame in paths)
    if limit is not None and not late:
        results = itertools.islice(results, cut.stop)  # nothing after the last row is evaluated
    found = list(results)
    if query.distinct and not per_group:
        found = first_of_equal(found)

    def shaped(some: list[Found]) -> Any:
        if representation == "void":
            return None
        if query.searches and not per_group and not query.last:
            return [shape(representation, one.rows) for one in some]
        return shape(representation, [one.rows[-1] for one in some])

    if per_group:
        return shaped(in_order(groups.one_row_per_group(ref, query, found, Frame(outer)))[cut])
    if not query.group:
        return shaped(in_order(found)[cut])
    kept = [one for group in groups.grouped(found) if groups.having(ref, query, group) for one in group]
    found = [one for one in found if any(one is other for other in kept)]
    partitions = groups.grouped(in_order(found)[cut])
    if representation == "void":
        return None
    return {groups.shown_key(group[0].keys): shaped(group) for group in partitions}


def representation_of(query: ast.Query) -> str:
    return "dict" if query.representation is None else query.representation.name.lower()


def flat_rows(
    ref: Reference, query: ast.Query, sources: Sources, start: Frame, per_group: bool
) -> Iterator[tuple[list[Row], Frame]]:
    """The rows of a flat query that WHERE lets through, in source order. A row of one group has no columns yet."""
    for frame in sources.product(start):
        if query.where is None or ref.evaluate(query.where, frame):
            yield [] if per_group else [select(ref, query, frame)], frame


def finish(ref: Reference, query: ast.Query, rows: list[Row], frame: Frame, per_group: bool) -> Found:
    """What is read of a row besides its columns, in this order: aggregates, keys of GROUP BY and of ORDER BY."""
    calls = groups.aggregates_of(ref, query, per_group)
    inputs = [None if call.star else groups.collected(ref, groups.only_argument(call), frame) for call in calls]
    keys = [ref.alone(key, frame) for key in query.group]
    named = replace(frame, columns=names_of(query))
    order = [] if per_group else [order_value(ref, query, key.expr, rows, named) for key in query.order]
    return Found(rows, frame, inputs, keys, [Key(value, key) for value, key in zip(order, query.order, strict=False)])


def order_value(ref: Reference, query: ast.Query, expr: ast.Expr, rows: list[Row], named: Frame) -> Any:
    """The value of a key of ORDER BY; a column is not computed again, for its functions may be volatile."""
    meant = named.columns.get(expr.name) if isinstance(expr, ast.Name) else expr if query.distinct else None
    columns = [value_of(column) for column in query.columns]
    starred = any(isinstance(column, ast.Star) for column in columns)
    if query.searches or starred or meant is None or meant not in columns:
        return ref.alone(expr, named)
    return rows[-1][columns.index(meant)][1]


def value_of(column: ast.Expr | ast.Named | ast.Star) -> ast.Expr | ast.Star:
    """What a column of SELECT shows, without the name that it gets."""
    match column:
        case ast.Named(expr=expr) | ast.Call(function="to", arguments=(expr, _)):
            return expr
    return column


# Columns


def select(ref: Reference, query: ast.Query, frame: Frame) -> Row:
    """The columns of one row, with their names."""
    row: Row = []
    for column in query.columns:
        if isinstance(column, ast.Star):
            row.extend(pair for bound in frame.bound for pair in all_columns(bound))
        else:
            label = ref.labels.get(id(column)) or column_name(ref, column, frame)  # a replayed path knows none
            row.append((label, ref.alone(column.expr if isinstance(column, ast.Named) else column, frame)))
    return distinct_names(row)


def all_columns(bound: Bound) -> Row:
    """`*` of one source."""
    if bound.columns:
        return [(name, bound.column(name)) for name in bound.columns]
    return [(bound.name or "this", bound.element)]


def column_name(ref: Reference, column: ast.Expr | ast.Named, frame: Frame) -> str:
    match column:
        case ast.Named(name=name):
            return name
        case ast.Call(function="to", arguments=(_, ast.Name(name=name))) if "to" not in ref.functions:
            return name
        case ast.Call(function="to", arguments=(_, expr)) if "to" not in ref.functions:
            return str(ref.evaluate(expr, frame))
        case ast.Name(name=name) | ast.Attribute(name=name) | ast.Call(function=name):
            return name
        case ast.This(source=source):
            return source or "this"
        case _:
            return column.span.text


def names_of(query: ast.Query) -> dict[str, ast.Expr]:
    """The columns of SELECT by the names that `to` and AS give them, the first of equal ones."""
    found: dict[str, ast.Expr] = {}
    for column in query.columns:
        match column:
            case (
                ast.Named(expr=expr, name=name)
                | ast.Call(function="to", arguments=(expr, ast.Name(name=name)))
                | ast.Call(function="to", arguments=(expr, ast.Literal(value=str(name))))
            ):
                found.setdefault(name, expr)
    return found


def computed_once(ref: Reference, query: ast.Query) -> None:
    """A volatile column may be named by ORDER BY and HAVING alone, for within an expression it is computed again."""
    volatile = {name for name, expr in names_of(query).items() if mentions_volatile(ref, expr)}
    keys = [key.expr for key in query.order if query.searches or not isinstance(key.expr, ast.Name)]
    if any(isinstance(node, ast.Name) and node.name in volatile for node in nodes_of((*keys, query.having))):
        raise Failure("R014", "a volatile column that is computed again")


def mentions_volatile(ref: Reference, expr: Any) -> bool:
    calls = {node.function for node in nodes_of(expr) if isinstance(node, ast.Call)}
    return "eval" in calls - ref.functions.keys() or any(ref.volatility.get(name) == "volatile" for name in calls)


def nodes_of(node: Any) -> Iterator[Any]:
    yield node
    parts = node if isinstance(node, tuple) else ast.list_syntax_children(node) if is_dataclass(node) else ()
    for part in parts:
        yield from nodes_of(part)


def grouped_by_names(ref: Reference, query: ast.Query) -> ast.Query:
    """The query with the columns of SELECT that GROUP BY names, where no column of a source has the name."""
    names, taken = names_of(query), {name for source in query.sources for name in known_columns(ref, source.expr)}
    keys = (
        names.get(key.name, key) if isinstance(key, ast.Name) and key.name not in taken else key for key in query.group
    )
    return replace(query, group=tuple(keys))


def distinct_names(row: Row) -> Row:
    """The same row, where a repeated name gets `_2`, then `_3`."""
    result: Row = []
    for name, value in row:
        free, number = name, 1
        while any(free == other for other, _ in result):
            number += 1
            free = f"{name}_{number}"
        result.append((free, value))
    return result


# Sources


class Sources:
    """The sources of one run of a query.

    A source that mentions neither an earlier source nor a START WITH variable is read once, when the run
    begins; the others are read again for each of their values.
    """

    def __init__(self, ref: Reference, query: ast.Query, outer: Frame | None, state: dict[str, Any]) -> None:
        self.ref, self.query, self.outer, self.state = ref, query, outer, state
        self.once: list[list[Bound] | None] = []
        for number, source in enumerate(query.sources):
            lateral = mentions(source.expr, self.own(number))
            self.once.append(None if lateral else self.read(source, Frame(outer)))

    def product(self, frame: Frame) -> Iterator[Frame]:
        """Every combination of elements in source order, the last source varying fastest."""
        number = len(frame.bound)
        if number == len(self.query.sources):
            yield frame
            return
        source, once = self.query.sources[number], self.once[number]
        elements = self.read(source, frame) if once is None else once
        frames = [replace(frame, bound=(*frame.bound, element)) for element in elements]
        if source.on is not None:
            frames = [one for one in frames if self.ref.evaluate(source.on, one)]
        if source.optional and not frames:
            columns = columns_of([element.element for element in elements])
            columns = columns or tuple(known_columns(self.ref, source.expr))
            frames = [replace(frame, bound=(*frame.bound, Bound(source_name(source), columns, None)))]
        for one in frames:
            yield from self.product(one)

    def read(self, source: ast.From, frame: Frame) -> list[Bound]:
        elements = elements_of(self.value(source.expr, frame))
        declared = not (isinstance(source.expr, ast.Call) and source.expr.function == "eval")
        return [Bound(source_name(source), columns_of(elements), element, declared) for element in elements]

    def value(self, expr: ast.Expr, frame: Frame) -> Any:
        """The value behind FROM: a name, a table, a column of an earlier row, a table function, a list, a query."""
        match expr:
            case ast.Name(name=name):
                found = self.ref.lookup(name, frame)
                if found:
                    return found[0]
                if name in self.ref.tables:
                    return self.ref.tables[name]
                raise Failure("R003", name)
            case ast.Attribute(source=str(world), name=name):
                if any(bound.name == world for level in frame.outwards() for bound in level.bound):
                    return self.ref.evaluate(expr, frame)
                if name in self.ref.tables:
                    return self.ref.tables[name]
                raise Failure("R003", f"{world}.{name}")
            case ast.Call():
                return self.ref.call_table(expr, frame)
            case _:
                return self.ref.evaluate(expr, frame)

    def own(self, number: int) -> Own:
        """What an expression can mention of this query when the first `number` sources are in its sight."""
        names = frozenset(name for name in map(source_name, self.query.sources[:number]) if name)
        columns = {name for bounds in self.once[:number] for bound in bounds or () for name in bound.columns}

        def elsewhere(name: str) -> bool:
            variable = name in self.ref.variables or name in self.ref.assigned
            known = variable or name in self.ref.tables or is_visible(self.outer, name)
            return known and name not in columns

        def asks(node: Any) -> bool:
            return self.query.searches and paths.is_path_function(self.ref, node)

        def late(name: str) -> LateList | None:
            value = self.ref.variables.get(name)
            return value if isinstance(value, LateList) else None

        known = partial(known_columns, self.ref)
        return Own(names, frozenset(self.state), number > 0, elsewhere, late, known, asks=asks)

    def with_sources(self, node: Any, own: Own) -> Any:
        """The same with the names of sources before `this` and columns, so that equal texts mean the same.

        `own` is what belongs to this query where the node stands: inside of another one `this` does not.
        """
        first = source_name(self.query.sources[0])
        match node:
            case ast.This(source=None) | ast.Attribute(source=None):
                return replace(node, source=first) if own.this else node
            case ast.This(source=name) | ast.Attribute(source=name) if name not in own.sources:
                return replace(node, source=f"another {name}")
            case ast.Name(name=name) if own.elsewhere(name):
                return node
            case ast.Name(name=name):
                pairs = zip(map(source_name, self.query.sources), self.once, strict=True)
                having = [source for source, bounds in pairs if any(name in bound.columns for bound in bounds or ())]
                known = len(having) == 1 and having[0] is not None and name not in self.state
                return ast.Attribute(having[0], name, span=node.span) if known else node
            case ast.Query():
                return node
            case tuple():
                return tuple(self.with_sources(item, own) for item in node)
            case _ if is_dataclass(node) and not isinstance(node, type):
                shown = [part.name for part in fields(node) if part.repr]
                return replace(node, **{name: self.with_sources(getattr(node, name), own) for name in shown})
            case _:
                return node

    def per_group(self) -> bool:
        """Whether GROUP BY makes one row per group: nothing of a single row is mentioned in SELECT but the
        keys of GROUP BY and what stands inside of aggregates."""
        query = self.query
        whole = groups.is_whole(self.ref, query)
        if not (query.group or whole) or any(isinstance(column, ast.Star) for column in query.columns):
            return False

        own = self.own(len(query.sources))

        def applied(node: Any) -> Any:
            """A function's name that stands alone means its call."""
            node = node.expr if isinstance(node, ast.Named) else node
            meant = self.with_sources(node, own)  # no name any more, if it is a column
            if not isinstance(meant, ast.Name) or own.elsewhere(meant.name) or meant.name in self.state:
                return node
            is_call = meant.name in self.ref.functions or meant.name in BUILTINS
            this = ast.This(None, span=meant.span)
            return ast.Call(meant.name, (this,), span=meant.span) if is_call else node

        keys = {repr(self.with_sources(form, own)) for key in query.group for form in (key, applied(key))}

        def free(node: Any, here: Own) -> bool:
            return groups.is_aggregate(self.ref, node) or repr(self.with_sources(node, here)) in keys

        mixed = mentions(tuple(map(applied, query.columns)), replace(own, free=free))
        if mixed and any(call.star or len(call.arguments) == 1 for call in groups.calls_in(self.ref, query.columns)):
            raise Failure("R008", "an aggregate beside a value of single rows")
        return not mixed


def known_columns(ref: Reference, expr: ast.Expr) -> dict[str, None]:
    """The columns of what stands in FROM in their order, as far as the run is not needed to know them."""
    match expr:
        case ast.Name(name=name):
            value = ref.variables.get(name, ref.tables.get(name))
            # A dict of columns has them where it has no rows, too.
            without_rows = isinstance(value, dict) and not elements_of(value)
            return dict.fromkeys(value if without_rows else columns_of(elements_of(value)))
        case ast.Query(connect=(), made=None, group=()) if representation_of(expr) == "dict":
            return dict.fromkeys(name for column in expr.columns for name in shown_columns(ref, expr, column))
        case _:
            return {}


def shown_columns(ref: Reference, query: ast.Query, column: ast.Expr | ast.Named | ast.Star) -> Iterable[str]:
    match column:
        case ast.Star():
            return [name for source in query.sources for name in known_columns(ref, source.expr)]
        case ast.Call(function="to", arguments=(_, name)) if not isinstance(name, (ast.Name, ast.Literal)):
            return ()
        case _:
            return (column_name(ref, column, Frame(None)),)


# Order and limits


@dataclass(frozen=True)
class Key:
    """A value of ORDER BY with its direction."""

    value: Any
    key: ast.OrderKey


def in_order(found: list[Found]) -> list[Found]:
    """ORDER BY: by the first key, among equals by the next one; equal results keep their order."""

    def compared(left: Found, right: Found) -> int:
        for a, b in zip(left.order, right.order, strict=True):
            sign = compare_keys(a.value, b.value)
            if sign:
                return -sign if a.key.descending else sign
        return 0

    return sorted(found, key=functools.cmp_to_key(compared))


def first_of_equal(found: list[Found]) -> list[Found]:
    """DISTINCT: the first of results whose rows are equal."""
    kept: list[Found] = []
    for one in found:
        values = [[value for _, value in row] for row in one.rows]
        if not any(equal(values, [[value for _, value in row] for row in other.rows]) for other in kept):
            kept.append(one)
    return kept


def at_least(least: int, value: Any) -> int:
    """The value of LIMIT, MAXIMUM or MEMORIZE."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise Failure("X006", repr(value))
    return value


def no_repeats(names: list[str]) -> None:
    if len(set(names)) < len(names):
        raise Failure("R013", ", ".join(names))
