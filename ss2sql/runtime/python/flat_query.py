"""Flat queries: a generator of nested loops that yields one result after the other, with its groups and inner queries.

The generated function yields the groups in order of first appearance, each as the lists that its aggregates are
computed of and then its values, after all rows have been evaluated. Aggregates of the same value share a list, and the
number of rows is the length of any.

A result is a row; after its columns stand the keys of ORDER BY. With GROUP BY it is a pair of the row and its keys:
the arguments of aggregates, the values of GROUP BY, those of ORDER BY; a query that aggregates yields its groups, see
flat_query.py.

Such a query is read again for each element before it, or for each state of a search. Its rows need not be collected
first where nobody can notice that its parts are evaluated in between: nothing in it may raise or have an effect.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING

from ss2sql.language import plan
from ss2sql.language.kinds import INT
from ss2sql.language.plan_traversal import can_end_early, has_array_calls, is_volatile, split_and, walk
from ss2sql.language.values import make_hashable
from ss2sql.runtime.python.call_code import CallStages, find_keyed_sources
from ss2sql.runtime.python.codegen_context import ExpressionAnalysis, PythonScope
from ss2sql.runtime.python.python_expressions import SCALAR_KINDS, FailedArgument, generate_expression
from ss2sql.runtime.python.source_lookups import find_index_lookups, find_range_lookups
from ss2sql.runtime.python.source_loops import SourceLoops, list_loop_expressions, loops_over_query_rows
from ss2sql.runtime.run.calls import FIRST, has_calls_without_arrays
from ss2sql.runtime.run.post_processing import is_row_count

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler


FIND_GROUP = """
group = groups.get(key)
if group is None:
    group = groups[key] = EMPTY
    FIRST
"""


class GroupCollector:
    """The groups of one query, loops in `outer`: `collect_row` adds a row inside of them, `write_results` follows.

    A group is a list, or a tuple of several lists. Where GROUP BY has nothing but constants there is one group, which
    is left out if it has no row; without GROUP BY it stays.
    """

    def __init__(
        self, builder: QueryCompiler, query: plan.Query, aggregates: Sequence[plan.Aggregate], outer: PythonScope
    ) -> None:
        self.builder = builder
        self.codegen = builder.codegen
        self.query = query
        self.aggregates = aggregates
        self.outer = outer
        self.build = builder.codegen.build_at(query.span)
        self.single = all(isinstance(key, plan.Constant) for key in query.group)
        self.plain = self.single or all(
            key.type.is_only(SCALAR_KINDS) for key in query.group
        )  # so that values are their own keys
        self.groups = self.codegen.new_name("groups")  # the group where there is but one
        self.first_rows = self.codegen.new_name("firsts")  # the values of groups by their keys
        self.lists: list[ast.expr] = []  # what is collected, a list for each
        self.of: list[int] = []  # by aggregate: its list
        self.guarded: dict[int, int] = {}  # by the meaning of what may fail: its list
        self.place = len(outer.blocks[0]) if outer.level == 0 else 0
        outer.locals += [self.groups] if self.plain else [self.groups, self.first_rows]

    def collect_row(self, inner: PythonScope) -> None:
        build = self.build
        for node in self.aggregates:
            self.of.append(self._find_list(node, inner))
        self.lists = self.lists or [build.constant(1)]
        group = self.groups if self.single else self._write_group(inner)
        for index, value in enumerate(self.lists):
            append = build.part(self._read_list(group, index), "append")
            if self.single:  # it is the same for all rows
                name = self.codegen.new_name("append")
                self.outer.locals.append(name)
                self.outer.blocks[0].insert(self.place, build.assign(name, append))
                append = build.name(name)
            inner.emit(build.run(build.call(append, value)))
        empty = self._make_empty_group() if self.single else build.record((), ())
        self.outer.blocks[0].insert(self.place, build.assign(self.groups, empty))
        if not self.plain:
            self.outer.blocks[0].insert(self.place, build.assign(self.first_rows, build.record((), ())))
        if inner is not self.outer:  # part of a generator, so it has to be one
            inner.blocks[0] += [build.return_(build.constant(None)), build.run(build.yield_(build.constant(None)))]

    def _find_list(self, node: plan.Aggregate, inner: PythonScope) -> int:
        """The number of the list of what an aggregate is computed of; any will do where the rows are counted."""
        argument, build = node.argument, self.build
        if argument is None or (is_row_count(node) and self.codegen.analysis.facts(argument).total):
            return 0
        facts = self.codegen.analysis.facts(argument)
        if id(argument) in self.codegen.guarded_arguments and facts.steady and facts.key is not None:
            if facts.key in self.guarded:
                return self.guarded[facts.key]
            self.guarded[facts.key] = len(self.lists)
        value = inner.name_or_constant(generate_key(self.builder, argument, inner), build, node.function)
        known = [getattr(one, "id", None) for one in self.lists]
        if isinstance(value, ast.Name) and facts.steady and value.id in known:
            return known.index(value.id)
        self.lists.append(value)
        return len(self.lists) - 1

    def _write_group(self, inner: PythonScope) -> str:
        """The group of the current row, made where it is the first one."""
        build, codegen = self.build, self.codegen
        values, keys = [], []
        for expr in self.query.group:
            value = generate_expression(self.builder, expr, inner)
            if not self.plain:  # it is read twice, and statements come before expressions
                value = inner.name_or_constant(value, build, "value")
            values.append(value)
            keys.append(value if expr.type.is_only(SCALAR_KINDS) else build.call(codegen.use(make_hashable), value))
        key, group = codegen.new_name("key"), codegen.new_name("group")
        inner.emit(build.assign(key, keys[0] if len(keys) == 1 else build.pack(*keys)))
        first: list[ast.stmt] = []
        if not self.plain:
            first = build.write("firsts[key] = row", firsts=self.first_rows, key=key, row=build.pack(*values))
        words = {"group": group, "groups": self.groups, "key": key}
        inner.emit(*build.write(FIND_GROUP, **words, EMPTY=self._make_empty_group(), FIRST=first))
        return group

    def _read_list(self, group: str, index: int) -> ast.expr:
        return self.build.name(group) if len(self.lists) == 1 else self.build.item(self.build.name(group), index)

    def _make_empty_group(self) -> ast.expr:
        lists = [self.build.array() for _ in self.lists]
        return lists[0] if len(lists) == 1 else self.build.pack(*lists)

    def write_results(self) -> None:
        build, outer = self.build, self.outer
        group, key = ((self.groups if self.single else self.codegen.new_name("group")), self.codegen.new_name("key"))
        first, *lists = [self._read_list(group, index) for index in (0, *self.of)]
        if self.single:
            values = [generate_expression(self.builder, value, outer) for value in self.query.group]
            give = build.run(build.yield_(build.pack(*lists, *values)))
            outer.blocks[0].append(build.when(first, give) if self.query.group else give)
            return
        found = build.name(key) if self.plain else build.item(build.name(self.first_rows), build.name(key))
        several = len(self.query.group) > 1 or not self.plain
        values = [build.item(found, index) for index in range(len(self.query.group))] if several else [found]
        items = build.call(build.part(build.name(self.groups), "items"))
        outer.blocks[0].append(build.loop([key, group], items, [build.run(build.yield_(build.pack(*lists, *values)))]))


# --- flat queries: a generator of nested loops that yields one result after the other
def compile_flat_query(
    builder: QueryCompiler, query: plan.Query, body: PythonScope, aggregates: Sequence[plan.Aggregate]
) -> str:
    """Compiles the generator of results into `body` and gives its name."""
    loops = SourceLoops(builder, query, body)
    keys = list_key_expressions(query, aggregates)
    outputs = () if query.aggregated else tuple(output.expr for output in query.columns)
    inside = list_loop_expressions(query)
    where = () if query.where is None else (query.where,)
    body.count_uses([*inside, *where, *outputs, *keys])

    loops.read_constant_sources()
    conditions, guarded = place_conditions(builder, query, loops)
    if query.aggregated and not query.group:  # there is a group without a row, too, so nothing ends the function early
        conditions[1] = [*conditions.pop(0, []), *conditions.get(1, [])]
        guarded = None if guarded is None else max(guarded, 1)
    keyed = find_keyed_sources([*inside, *where, *outputs, *keys])
    for source in query.sources[1:]:  # the first is walked once
        if source.id in keyed:
            loops.attach_keys(source)
    evaluated = [*where, *outputs, *keys]
    parts = [*query.sources, *evaluated]
    if has_array_calls(*parts) and builder.codegen.analysis.are_steady(evaluated):
        size = FIRST if can_end_early(query) else None
        loops.stages = CallStages(builder, body, 1 if size and has_calls_without_arrays(*parts) else size)
    collects = query.aggregated and loops.stages is None
    groups = GroupCollector(builder, query, aggregates, body) if collects else None
    inner = loops.open_loops(body, conditions, guarded, [*outputs, *keys])
    if query.aggregated:
        groups = groups or GroupCollector(builder, query, aggregates, inner)
        groups.collect_row(inner)
        groups.write_results()
    else:
        build = builder.codegen.build_at(query.span)
        row, key_values = generate_row_and_keys(builder, query, outputs, keys, inner)
        parts = [build.pack(*row), build.pack(*key_values)] if query.group else [*row, *key_values]
        inner.emit(build.run(build.yield_(build.pack(*parts))))
    inner.define_function()
    return body.name if loops.stages is None else loops.stages.join_stages()


def generate_row_and_keys(
    builder: QueryCompiler,
    query: plan.Query,
    outputs: Sequence[plan.Expr],
    keys: Sequence[plan.Expr],
    body: PythonScope,
) -> tuple[list[ast.expr], list[ast.expr]]:
    """The columns, and the keys, the last of which are those of ORDER BY: a column that one names is computed once."""
    named = [(number, key.column) for number, key in enumerate(query.order, len(keys) - len(query.order))]
    shared = {number: column for number, column in named if column is not None and is_volatile(keys[number])}
    row = [generate_expression(builder, expr, body) for expr in outputs]
    if shared or any(id(key) in builder.codegen.guarded_arguments for key in keys):
        build = builder.codegen.build_at(query.span)
        row = [body.name_or_constant(value, build, "column") for value in row]
    values = iter(generate_keys(builder, [key for number, key in enumerate(keys) if number not in shared], body))
    return row, [row[shared[number]] if number in shared else next(values) for number in range(len(keys))]


def generate_keys(builder: QueryCompiler, keys: Sequence[plan.Expr], body: PythonScope) -> list[ast.expr]:
    """What is evaluated of a result besides its columns: by statements where one of them has to be tried."""
    if not any(id(key) in builder.codegen.guarded_arguments for key in keys):
        return [generate_expression(builder, key, body) for key in keys]
    build = builder.codegen.build
    return [body.name_or_constant(generate_key(builder, key, body), build, "key") for key in keys]


def generate_key(builder: QueryCompiler, key: plan.Expr, body: PythonScope) -> ast.expr:
    """The value of a key. The argument of an aggregate that may not be computed is tried: a failure is its value."""
    codegen, build = builder.codegen, builder.codegen.build_at(key.span)
    if id(key) not in codegen.guarded_arguments:
        return generate_expression(builder, key, body)
    with body.write_skippable():
        value = generate_expression(builder, key, body)
    name = codegen.new_name("argument")
    failed = build.write("name = failed()", name=name, failed=FailedArgument)
    body.emit(*build.try_unless_stopped([build.assign(name, value)], failed))
    return build.name(name)


def list_key_expressions(query: plan.Query, aggregates: Sequence[plan.Aggregate]) -> list[plan.Expr]:
    """What is evaluated of a result besides its columns, in this order. `count(*)` counts a constant."""
    one = plan.Constant(1, INT, span=query.span)
    arguments = [one if node.argument is None else node.argument for node in aggregates]
    order = [] if query.aggregated else [key.expr for key in query.order]
    return [*arguments, *query.group, *order]


def place_conditions(
    builder: QueryCompiler, query: plan.Query, loops: SourceLoops
) -> tuple[dict[int, list[plan.Expr]], int | None]:
    """The parts of WHERE by the number of sources that are bound when they are tested; see `SourceLoops.open_loops`.

    As written, all parts are tested from left to right when all sources are bound. A part moves outwards
    only where nobody can notice. It must not have an effect, nor may anything that it then comes before.
    If it may raise, the part before it stays before it, and all later sources must be read once and have
    elements, so that it would be evaluated anyway.
    """
    placed: dict[int, list[plan.Expr]] = defaultdict(list)
    looked_up: list[tuple[int, plan.Expr]] = []  # what need not be tested, unless a key fails and all rows are found
    number = {source.id: index + 1 for index, source in enumerate(query.sources)}
    last, reached, guarded = len(query.sources), 0, None
    certain = steady = True  # of all parts so far
    for part in split_and(query.where):
        facts = builder.codegen.analysis.facts(part)
        level = max((number[source] for source in facts.sources if source in number), default=0)
        if certain and any(map(loops.plan_lookup, find_index_lookups(part, builder.codegen.analysis))):
            reached = max(reached, level)
            if facts.total:
                looked_up.append((max(level, loops.first_unnoticed), part))
                continue
            for known, sure in looked_up:
                placed[known].append(sure)
        elif certain:
            loops.push_condition_to_world(part)
            for comparison in find_range_lookups(part, builder.codegen.analysis):
                loops.plan_range(comparison)
        level = max(level, loops.first_unnoticed)
        if not (certain and facts.total):
            level = max(level, reached, loops.first_read_once)
        steady = steady and facts.steady
        certain = certain and facts.total and steady
        if not steady:
            level = last
        elif not certain and level < last:
            guarded = loops.first_read_once
        reached = max(reached, level)
        placed[level].append(part)
    return dict(placed), guarded


# --- queries in FROM whose loops stand right inside the loops of the query around them
def can_open_inside(query: plan.Query, analysis: ExpressionAnalysis) -> bool:
    """Whether the loops of a query can stand in those of the query around it."""
    if not loops_over_query_rows(query) or query.search or query.grouped or query.order or query.limit is not None:
        return False
    if len({output.name for output in query.columns}) < len(query.columns):
        return False
    # One loop for one: a search may leave the loop over its source, and come back to it later.
    if len(query.sources) > 1 or not isinstance(query.sources[0], (plan.TableSource, plan.ValueSource)):
        return False
    expressions = [*list_loop_expressions(query), *(output.expr for output in query.columns)]
    facts = [analysis.facts(expr) for expr in (*expressions, *((query.where,) if query.where is not None else ()))]
    return all(one.steady and one.total for one in facts)


def has_test_before_loop(query: plan.Query, analysis: ExpressionAnalysis) -> bool:
    """Whether a part of WHERE is tested before the loop, for it reads nothing of the element."""
    own = {source.id for source in query.sources}
    return any(own.isdisjoint(analysis.facts(part).sources) for part in split_and(query.where))


def open_inner_loops(
    builder: QueryCompiler, source: plan.QuerySource, read: tuple[str, ...], body: PythonScope
) -> PythonScope:
    """Opens the loops of a query in FROM; its element is a tuple of the columns that are `read`."""
    codegen, query = builder.codegen, source.query
    loops = SourceLoops(builder, query, body, inside=True)
    outputs = {output.name: output.expr for output in query.columns if output.name in read}
    where = () if query.where is None else (query.where,)
    body.count_uses([*list_loop_expressions(query), *where, *outputs.values()])
    loops.read_constant_sources()
    conditions, guarded = place_conditions(builder, query, loops)
    inner = query.sources[0]
    wanted = _find_column_of_loop(inner, [*chain.from_iterable(conditions.values()), *outputs.values()])
    if wanted is not None and loops.has_column_index(inner):
        loops.wanted[inner.id] = wanted
        codegen.single_column_queries.add(inner.id)
    body = loops.open_loops(body, conditions, guarded)
    if inner.id in codegen.single_column_queries and all(isinstance(expr, plan.Column) for expr in outputs.values()):
        codegen.single_column_queries.add(source.id)
        codegen.names[source.id], codegen.tuples[source.id] = codegen.names[inner.id], tuple(outputs)
        return body
    row = None if inner.id in codegen.single_column_queries else _find_row_tuple_of_loop(builder, outputs)
    if row is not None:
        codegen.names[source.id], codegen.tuples[source.id] = row
        return body
    build = codegen.build_at(source.span)
    codegen.tuples[source.id] = tuple(outputs)
    name = codegen.names[source.id] = codegen.new_name(source.name)
    body.emit(build.assign(name, build.pack(*(generate_expression(builder, expr, body) for expr in outputs.values()))))
    body.locals.append(name)
    return body


def _find_column_of_loop(source: plan.Source, read: Sequence[plan.Expr]) -> str | None:
    names = set[str | None]()
    for node in chain.from_iterable(map(walk, read)):
        if isinstance(node, (plan.Column, plan.Element)) and node.source == source.id:
            names.add(node.name if isinstance(node, plan.Column) else None)
    return names.pop() if len(names) == 1 else None


def _find_row_tuple_of_loop(
    builder: QueryCompiler, outputs: dict[str, plan.Expr]
) -> tuple[str, tuple[str, ...]] | None:
    """The name of a tuple that holds all outputs, and what its columns are called then ("": none of the outputs)."""
    codegen, sources, names = builder.codegen, set[int](), dict[str, str]()
    for name, output in outputs.items():
        if not isinstance(output, plan.Column) or output.name in names:
            return None
        sources.add(output.source)
        names[output.name] = name
    source = sources.pop() if len(sources) == 1 else None
    columns = codegen.tuples.get(source) if source is not None else None
    if source is None or columns is None:
        return None
    return codegen.names[source], tuple(names.get(column, "") for column in columns)
