"""GROUP BY of flat queries with aggregates: the loops collect what each group's aggregates are computed of.

The generated function yields the groups in order of first appearance, each as the lists that its aggregates are
computed of and then its values, after all rows have been evaluated. Aggregates of the same value share a list, and the
number of rows is the length of any.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.runtime.native.endings import counts_rows
from ss2sql.runtime.native.expressions import PLAIN, expression
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder


class Groups:
    """The groups of one query, whose loops stand in `outer`: `collect` adds a row inside of them, `end` comes behind.

    A group is a list, or a tuple of several lists. Where GROUP BY has nothing but constants there is one group, which
    is left out if it has no row; without GROUP BY it stays.
    """

    def __init__(self, builder: Builder, query: plan.Query, aggregates: Sequence[plan.Aggregate], outer: Body) -> None:
        self.builder = builder
        self.unit = builder.unit
        self.query = query
        self.aggregates = aggregates
        self.outer = outer
        self.pen = builder.unit.pen_at(query.span)
        self.single = all(isinstance(key, plan.Constant) for key in query.group)
        self.plain = self.single or all(
            key.type.only(PLAIN) for key in query.group
        )  # so that values are their own keys
        self.groups = self.unit.local("groups")  # the group where there is but one
        self.firsts = self.unit.local("firsts")  # the values of groups by their keys
        self.lists: list[ast.expr] = []  # what is collected, a list for each
        self.of: list[int] = []  # by aggregate: its list
        self.place = len(outer.blocks[0])
        outer.locals += [self.groups] if self.plain else [self.groups, self.firsts]

    def collect(self, inner: Body) -> None:
        """Adds the current row to its group."""
        pen = self.pen
        for node in self.aggregates:
            self.of.append(self._list_of(node, inner))
        self.lists = self.lists or [pen.constant(1)]
        group = self.groups if self.single else self._group(inner)
        for index, value in enumerate(self.lists):
            append = pen.part(self._list(group, index), "append")
            if self.single:  # it is the same for all rows
                name = self.unit.local("append")
                self.outer.locals.append(name)
                self.outer.blocks[0].insert(self.place, pen.assign(name, append))
                append = pen.name(name)
            inner.add(pen.run(pen.call(append, value)))
        empty = self._empty() if self.single else pen.record((), ())
        self.outer.blocks[0].insert(self.place, pen.assign(self.groups, empty))
        if not self.plain:
            self.outer.blocks[0].insert(self.place, pen.assign(self.firsts, pen.record((), ())))
        if inner is not self.outer:  # part of a generator, so it has to be one
            inner.blocks[0] += [pen.back(pen.constant(None)), pen.run(pen.give(pen.constant(None)))]

    def _list_of(self, node: plan.Aggregate, inner: Body) -> int:
        """The number of the list of what an aggregate is computed of; any will do where the rows are counted."""
        argument, pen = node.argument, self.pen
        if argument is None or (counts_rows(node) and self.unit.analysis.of(argument).total):
            return 0
        facts = self.unit.analysis.of(argument)
        value = inner.variable(expression(self.builder, argument, inner), pen, node.function)
        known = [getattr(one, "id", None) for one in self.lists]
        if isinstance(value, ast.Name) and facts.steady and value.id in known:
            return known.index(value.id)
        self.lists.append(value)
        return len(self.lists) - 1

    def _group(self, inner: Body) -> str:
        """The group of the current row, made where it is the first one."""
        pen, unit = self.pen, self.unit
        values, keys = [], []
        for expr in self.query.group:
            value = expression(self.builder, expr, inner)
            if not self.plain:  # it is read twice, and statements come before expressions
                value = inner.variable(value, pen, "value")
            values.append(value)
            keys.append(value if expr.type.only(PLAIN) else pen.call(unit.helper(freeze), value))
        key, group = unit.local("key"), unit.local("group")
        inner.add(pen.assign(key, keys[0] if len(keys) == 1 else pen.pack(*keys)))
        groups = pen.name(self.groups)
        inner.add(pen.assign(group, pen.call(pen.part(groups, "get"), pen.name(key))))
        made = pen.store(groups, pen.name(key), self._empty())
        fill = [made, pen.assign(group, pen.item(groups, pen.name(key)))]
        if not self.plain:
            fill.append(pen.store(pen.name(self.firsts), pen.name(key), pen.pack(*values)))
        inner.add(pen.when(pen.compare(pen.name(group), ast.Is(), pen.constant(None)), *fill))
        return group

    def _list(self, group: str, index: int) -> ast.expr:
        return self.pen.name(group) if len(self.lists) == 1 else self.pen.item(self.pen.name(group), index)

    def _empty(self) -> ast.expr:
        lists = [self.pen.array() for _ in self.lists]
        return lists[0] if len(lists) == 1 else self.pen.pack(*lists)

    def end(self) -> None:
        """Gives the groups."""
        pen, outer = self.pen, self.outer
        group, key = (self.groups if self.single else self.unit.local("group")), self.unit.local("key")
        first, *lists = [self._list(group, index) for index in (0, *self.of)]
        if self.single:
            values = [expression(self.builder, value, outer) for value in self.query.group]
            give = pen.run(pen.give(pen.pack(*lists, *values)))
            outer.blocks[0].append(pen.when(first, give) if self.query.group else give)
            return
        found = pen.name(key) if self.plain else pen.item(pen.name(self.firsts), pen.name(key))
        several = len(self.query.group) > 1 or not self.plain
        values = [pen.item(found, index) for index in range(len(self.query.group))] if several else [found]
        items = pen.call(pen.part(pen.name(self.groups), "items"))
        outer.blocks[0].append(pen.loop([key, group], items, [pen.run(pen.give(pen.pack(*lists, *values)))]))
