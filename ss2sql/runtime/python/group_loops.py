"""GROUP BY of flat queries with aggregates: the loops collect what each group's aggregates are computed of.

The generated function yields the groups in order of first appearance, each as the lists that its aggregates are
computed of and then its values, after all rows have been evaluated. Aggregates of the same value share a list, and the
number of rows is the length of any.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql.language import plan
from ss2sql.language.values import make_hashable
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.python.python_expressions import SCALAR_KINDS, write_expression
from ss2sql.runtime.run.post_processing import is_row_count

if TYPE_CHECKING:
    from ss2sql.runtime.python.query_compiler import QueryCompiler


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
        value = inner.name_or_constant(write_expression(self.builder, argument, inner), build, node.function)
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
            value = write_expression(self.builder, expr, inner)
            if not self.plain:  # it is read twice, and statements come before expressions
                value = inner.name_or_constant(value, build, "value")
            values.append(value)
            keys.append(value if expr.type.is_only(SCALAR_KINDS) else build.call(codegen.use(make_hashable), value))
        key, group = codegen.new_name("key"), codegen.new_name("group")
        inner.emit(build.assign(key, keys[0] if len(keys) == 1 else build.pack(*keys)))
        groups = build.name(self.groups)
        inner.emit(build.assign(group, build.call(build.part(groups, "get"), build.name(key))))
        made = build.store(groups, build.name(key), self._make_empty_group())
        fill = [made, build.assign(group, build.item(groups, build.name(key)))]
        if not self.plain:
            fill.append(build.store(build.name(self.first_rows), build.name(key), build.pack(*values)))
        inner.emit(build.when(build.compare(build.name(group), ast.Is(), build.constant(None)), *fill))
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
            values = [write_expression(self.builder, value, outer) for value in self.query.group]
            give = build.run(build.yield_(build.pack(*lists, *values)))
            outer.blocks[0].append(build.when(first, give) if self.query.group else give)
            return
        found = build.name(key) if self.plain else build.item(build.name(self.first_rows), build.name(key))
        several = len(self.query.group) > 1 or not self.plain
        values = [build.item(found, index) for index in range(len(self.query.group))] if several else [found]
        items = build.call(build.part(build.name(self.groups), "items"))
        outer.blocks[0].append(build.loop([key, group], items, [build.run(build.yield_(build.pack(*lists, *values)))]))
