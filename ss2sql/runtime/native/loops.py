"""The sources of a query as loops, the last one innermost, and the conditions that are tested between them.

A source that mentions neither an earlier source nor the search's state is read once, when its query begins,
in written order. Any other is read again for each of their values. What is read is a list of its own, so a
value that changes during the walk does no harm.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from itertools import chain
from typing import TYPE_CHECKING, assert_never

from ss2sql import plan
from ss2sql.errors import Stopped
from ss2sql.kinds import Kind
from ss2sql.runtime.frozen import freeze_any
from ss2sql.runtime.native.calls import exact_key
from ss2sql.runtime.native.expressions import PLAIN, expression
from ss2sql.runtime.native.facts import Facts
from ss2sql.runtime.native.items import accompanied, columns_of, in_parts, in_sight, rows_of_frame, table_rows
from ss2sql.runtime.native.lookups import (
    Lookup,
    found_in,
    found_in_several,
    index_of_columns,
    index_of_elements,
    index_of_integers,
    index_of_keys,
    index_of_plain,
    index_of_tuples,
    index_of_values,
)
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.unit import MOST_LOOPS, Body
from ss2sql.runtime.native.worlds import Demand, demand_of, world_items
from ss2sql.runtime.sources import elements, elements_or_none
from ss2sql.walk import cuts_off, walk

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder


class Loops:
    """The loops of one query, opened in `body`; what is read once is read in `owner`, around it or the same.

    They stand `inside` of the loops of another query, see inner_loops.py, or are loops of their own.
    """

    def __init__(self, builder: Builder, query: plan.Query, owner: Body, inside: bool = False) -> None:
        from ss2sql.runtime.native.inner_loops import stands_inside, tests_before

        self.builder = builder
        self.query = query
        self.owner = owner
        self.sources = query.sources
        self.facts = [builder.source_facts(source) for source in query.sources]
        own = {source.id for source in query.sources}
        self.lateral = [
            # What is asked of a world depends on the conditions that it gets.
            isinstance(source, plan.WorldSource)
            # How often something happens, and whether it fails, must not depend on rewrites.
            or (not isinstance(source, plan.TableSource) and source.lateral and not (facts.steady and facts.total))
            or not own.isdisjoint(facts.sources)
            or any(number == query.id for number, _ in facts.states)
            for source, facts in zip(self.sources, self.facts, strict=True)
        ]
        self.inside = inside
        ends = None if query.search is None else query.sources[0]  # what is tested before its loop would end the search
        self.opened = {
            source.id
            for source, lateral in zip(self.sources, self.lateral, strict=True)
            if lateral
            and isinstance(source, plan.QuerySource)
            and stands_inside(source.query, builder.unit.analysis)
            and not (source is ends and tests_before(source.query, builder.unit.analysis))
        }
        own_function = query.search is None and not inside and not owner.parameters
        self.alone = own_function and len(self.sources) == 1 and not any(self.lateral)
        self.outermost = own_function and len(self.sources) > 1 and not self.lateral[0]
        self.items: dict[int, str] = {}  # by source: what is read once
        self.ready: dict[int, ast.expr] = {}  # the same inside of other loops, where it has no name
        self.lookups: dict[int, list[Lookup]] = {}  # by source: what its loop looks up
        self.demands: dict[int, list[Demand]] = {}  # by source: what a world is told of conditions
        self.wanted: dict[int, str] = {}  # by source: the only column that is read of what its loop looks up
        self.frozen: dict[int, str] = {}  # sources whose elements come with their frozen form

    @property
    def once_from(self) -> int:
        """The number of the first source from which on all are read once."""
        return max((index + 1 for index, lateral in enumerate(self.lateral) if lateral), default=0)

    @property
    def silent_from(self) -> int:
        """The number of the first source from which on nobody can notice whether a source is read."""
        loud = (
            index + 1
            for index, facts in enumerate(self.facts)
            if self.lateral[index] and not (facts.steady and facts.total)
        )
        return max(loud, default=0)

    def read_once(self) -> None:
        """Reads what has to be read once."""
        for source, lateral in zip(self.sources, self.lateral, strict=True):
            if not lateral:
                if self.inside and isinstance(source, plan.TableSource):
                    self.builder.unit.tuples[source.id] = tuple(name for name, _ in source.columns)
                    continue
                pen, items = self.builder.unit.pen_at(source.span), self._items(source, self.owner)
                if self.inside:
                    self.ready[source.id] = items
                    continue
                name = self.items[source.id] = self.builder.unit.local("items")
                self.owner.add(pen.assign(name, items))
                self.owner.locals.append(name)

    def accompany(self, source: plan.Source, frozen: bool, keyed: bool) -> None:
        """Lets elements come with their frozen forms, or with their exact keys, where they are values read once."""
        unit = self.builder.unit
        if source.id not in self.items or source.id in self.lookups or source.id in unit.tuples:
            return
        pen, name = unit.pen_at(source.span), self.items[source.id]
        makers: list[ast.expr] = []
        if frozen:
            self.frozen[source.id] = unit.local("key")
            makers.append(pen.name(unit.helper(freeze_any)))
        if keyed:
            unit.keys[source.id] = unit.local("exact")
            makers.append(pen.name(unit.helper(exact_key)))
        self.owner.add(pen.assign(name, pen.call(unit.helper(accompanied), pen.name(name), *makers)))

    @staticmethod
    def is_scalar(source: plan.Source) -> bool:
        """Whether the elements are numbers and strings, which need no frozen form."""
        return isinstance(source, (plan.ValueSource, plan.QuerySource)) and source.element.only(Kind.NUMBER | Kind.STR)

    def look_up(self, condition: Lookup) -> bool:
        """Plans to look up what the condition asks for; gives whether that is possible and worth it.

        What the column must equal has to be known before the source's loop, and nothing that is read after it
        may notice. A loop that runs only once is as quick without an index.
        """
        number = {source.id: index for index, source in enumerate(self.sources)}
        if condition.source not in number or self._shows_calls(condition.key):
            return False
        source, other = condition.source, self.builder.unit.analysis.of(condition.other)
        index = number[source]
        facts = self.facts[index]
        if source in self.frozen or self.lateral[index] or not facts.steady:
            return False
        if index + 1 < self.silent_from or any(number.get(known, -1) > index for known in other.sources):
            return False
        correlated = bool(other.sources or other.states) and self.owner.home(facts)[0] is not self.owner
        if index == 0 and self.query.search is None and not correlated:
            return False
        self.lookups.setdefault(source, []).append(condition)
        return True

    def _shows_calls(self, key: plan.Expr) -> bool:
        """Whether a key calls functions of the user for rows that LIMIT cuts off."""
        return cuts_off(self.query) and self.builder.unit.analysis.of(key).calls

    def finds_rows(self, source: plan.Source) -> bool:
        """Whether the source's loop looks up rows by columns of numbers and text."""
        known = self.lookups.get(source.id)
        if known is None or source.id not in self.builder.unit.tuples:
            return False
        return all(one.plain and isinstance(one.key, plan.Column) and one.key.type.only(PLAIN) for one in known)

    def pass_on(self, condition: plan.Expr) -> None:
        """Tells a world of a condition, where what its column is compared with is known before the world is asked.

        The condition is tested all the same, so it may be asked early only where nobody can notice.
        """
        facts = self.builder.unit.analysis.of(condition)
        demand = demand_of(condition, self.sources) if facts.steady and facts.total else None
        if demand is None:
            return
        number = {source.id: index for index, source in enumerate(self.sources)}
        index = number[demand.source]
        known = self.builder.unit.analysis.of(demand.value).sources
        if index + 1 >= self.silent_from and all(number.get(other, -1) < index for other in known):
            self.demands.setdefault(demand.source, []).append(demand)

    def open(self, body: Body, conditions: Mapping[int, Sequence[plan.Expr]], guarded: int | None = None) -> Body:
        """Opens all loops and gives the function where the innermost one is.

        `conditions` gives for each number of bound sources what is tested then. With `guarded` the loops from
        this number on are entered only if all their sources, which are read once, have elements.
        """
        for index, source in enumerate(self.sources):
            if index == guarded:
                self._guard(body, self.sources[index:])
            self._test(body, conditions.get(index, ()))
            if body.level == MOST_LOOPS:
                body = self._continued(body)
            body = self._open_one(body, source)
            innermost = index + 1 == len(self.sources)
            # The loop around these counts what comes to their end.
            if not self.alone and not (self.inside and innermost and not conditions.get(index + 1)):
                self._count(body, innermost)
        self._test(body, conditions.get(len(self.sources), ()))
        return body

    def _open_one(self, body: Body, source: plan.Source) -> Body:
        from ss2sql.runtime.native.inner_loops import open_inside

        unit = self.builder.unit
        if source.id in self.opened:
            assert isinstance(source, plan.QuerySource)
            read = self._read_of(source.id, tuple(output.name for output in source.query.columns))
            body = open_inside(self.builder, source, read, body)
            body.levels[source.id] = body.level
            return body
        pen = unit.pen_at(source.span)
        if source.id in self.items:
            items = pen.name(self.items[source.id])
        elif isinstance(source, plan.TableSource) and self.inside and source.id in self.lookups:
            items = self._rows_of(source)  # of which nothing but the index needs to stay
        else:
            items = self.ready.get(source.id) or self._items(source, body)
        if source.id in self.lookups:
            items = self._looked_up(source, items, body)
        name = unit.names[source.id] = unit.local(source.name)
        names = (name, self.frozen.get(source.id), unit.keys.get(source.id))
        if self.alone and body.level == 0:
            items = pen.call(unit.helper(in_parts), pen.name("run"), items)
        elif self.outermost and body.level == 0 and source is self.sources[0]:
            items = pen.call(unit.helper(in_sight), pen.name("run"), items)
        body.loop([word for word in names if word is not None], items, pen)
        body.levels[source.id] = body.level
        return body

    def _count(self, body: Body, innermost: bool) -> None:
        """Counts the turns, and looks at the clock now and then. The innermost turns of a search are its steps."""
        unit = self.builder.unit
        pen = unit.pen
        steps = innermost and self.query.search is not None
        counter = unit.counter("generated" if steps else "ticks", body)
        due = unit.counter("due_step" if steps else "due_tick", body)
        look = pen.assign(due, unit.metered() if steps else unit.paced(counter))
        body.add(pen.increase(counter), pen.when(pen.compare(pen.name(counter), ast.GtE(), pen.name(due)), look))

    def _test(self, body: Body, conditions: Sequence[plan.Expr]) -> None:
        for condition in conditions:
            pen = self.builder.unit.pen_at(condition.span)
            body.add(pen.unless(expression(self.builder, condition, body), self._skip(body, pen)))

    def _guard(self, body: Body, sources: Sequence[plan.Source]) -> None:
        for source in sources:
            pen = self.builder.unit.pen_at(source.span)
            body.add(pen.unless(pen.name(self.items[source.id]), self._skip(body, pen)))

    @staticmethod
    def _skip(body: Body, pen: Pen) -> ast.stmt:
        """Goes on with the next element of the innermost open loop, or ends where none is open."""
        return pen.next_turn() if body.level else ast.Return(None, **pen.at)

    def _continued(self, body: Body) -> Body:
        """A new function for the loops further in: Python does not nest any number of them."""
        unit = self.builder.unit
        rest = Body(unit, unit.local("rest"), [*body.parameters, *body.locals], body.parent)
        rest.levels = dict.fromkeys(body.levels, 0)
        rest.states, rest.groups, rest.counts = body.states, body.groups, body.counts
        call = unit.pen.call(rest.name, *map(unit.pen.name, rest.parameters))
        body.add(unit.pen.run(ast.YieldFrom(call, **unit.pen.at)))
        rest.before = body
        return rest

    def _items(self, source: plan.Source, body: Body) -> ast.expr:
        """The elements of a source as a list of values, or of tuples where `unit.tuples` says so."""
        builder, unit = self.builder, self.builder.unit
        pen = unit.pen_at(source.span)
        match source:
            case plan.TableSource(columns=columns):
                unit.tuples[source.id] = tuple(name for name, _ in columns)
                return body.kept(Facts(), self._rows_of(source), pen, source.name)
            case plan.ValueSource(value=plan.Variable(frame=True) as value, columns=columns) if columns:
                words = unit.tuples[source.id] = self._read_of(source.id, tuple(word for word, _ in columns))
                read = expression(builder, value, body)
                rows = pen.call(unit.helper(rows_of_frame), read, *map(pen.constant, words))
                return self._kept(source, body, rows)
            case plan.ValueSource(value=value) if body is self.owner and (words := self._read_of_dicts(source)):
                unit.tuples[source.id] = words
                rows = pen.call(unit.helper(columns_of), expression(builder, value, body), *map(pen.constant, words))
                return self._kept(source, body, rows)
            case plan.ValueSource(value=value):
                unit.elements[source.id] = source.element
                if isinstance(value, plan.MakeList):
                    return self._kept(source, body, expression(builder, value, body))
                if isinstance(value, plan.Constant):
                    return pen.name(unit.constant(elements(value.value), "items"))
                pen = unit.pen_at(value.span)
                return self._kept(source, body, pen.call(unit.helper(elements), expression(builder, value, body)))
            case plan.QuerySource(query=query):
                nested = builder.query(query, body)
                if is_table(query):
                    unit.tuples[source.id] = tuple(output.name for output in query.columns)
                    rows = pen.call(nested.found or nested.tuples, *nested.arguments)
                    return self._kept(source, body, pen.call("list", rows) if nested.found else rows)
                unit.elements[source.id] = source.element
                value_of_query = pen.call(nested.value, *nested.arguments)
                made = elements_or_none if source.optional else elements
                return self._kept(source, body, pen.call(unit.helper(made), value_of_query))
            case plan.WorldSource():
                return world_items(builder, source, self.demands.get(source.id, ()), body)
            case _:
                assert_never(source)

    def _rows_of(self, source: plan.TableSource) -> ast.expr:
        unit = self.builder.unit
        pen = unit.pen_at(source.span)
        return pen.call(unit.helper(table_rows), pen.name("run"), pen.name(unit.constant(source, "table")))

    def _read_of(self, source: int, columns: tuple[str, ...]) -> tuple[str, ...]:
        """Those columns of a source that anything reads."""
        read: set[str] = set()
        for node in chain.from_iterable(map(walk, self.builder.unit.analysis.roots)):
            if isinstance(node, plan.Eval) or (isinstance(node, plan.Element) and node.source == source):
                return columns
            if isinstance(node, plan.Column) and node.source == source:
                read.add(node.name)
        return tuple(name for name in columns if name in read)

    def _read_of_dicts(self, source: plan.ValueSource) -> tuple[str, ...]:
        """The columns that a search reads of dicts, where it reads nothing else of them."""
        if self.query.search is None or not source.element.only(Kind.DICT):
            return ()
        read: dict[str, None] = {}
        for node in chain.from_iterable(map(walk, self.builder.unit.analysis.roots)):
            if isinstance(node, plan.Eval) or (isinstance(node, plan.Element) and node.source == source.id):
                return ()
            if isinstance(node, plan.Column) and node.source == source.id:
                if not node.declared:
                    return ()
                read[node.name] = None
        return tuple(read)

    def _looked_up(self, source: plan.Source, items: ast.expr, body: Body) -> ast.expr:
        """The elements that the source's lookup finds; its index lives as long as the elements do."""
        unit, conditions = self.builder.unit, self.lookups[source.id]
        pen = unit.pen_at(conditions[0].key.span)
        columns = unit.tuples.get(source.id)
        names = [one.key.name for one in conditions if isinstance(one.key, plan.Column)]
        of_element = not names and len(conditions) == 1 and columns is None
        facts = self.builder.source_facts(source)
        if not all(one.plain for one in conditions) or (len(names) < len(conditions) and not of_element):
            return self._found_by_keys(source, body.kept(facts, self._index_of_keys(source, items), pen, "index"), body)
        if of_element:
            index = pen.call(unit.helper(index_of_elements), items)
        elif columns is not None and self.finds_rows(source):
            index = self._index_of_rows(source, items, names, columns, pen)
        elif columns is None:
            index = pen.call(unit.helper(index_of_columns), items, *map(pen.constant, names))
        else:
            places = (pen.constant(columns.index(name)) for name in names)
            index = pen.call(unit.helper(index_of_tuples), items, *places)
        kept = body.kept(facts, index, pen, "index")
        pen = unit.pen_at(conditions[0].other.span)
        values = [expression(self.builder, one.other, body) for one in conditions]
        if all(one.other.type.only(PLAIN) for one in conditions):
            key = values[0] if len(values) == 1 else pen.pack(*values)
            return pen.call(pen.part(kept, "get"), key, pen.pack())
        return pen.call(unit.helper(found_in if len(conditions) == 1 else found_in_several), kept, *values)

    def _index_of_keys(self, source: plan.Source, items: ast.expr) -> ast.expr:
        """The index by keys that a function of its own computes."""
        unit, conditions = self.builder.unit, self.lookups[source.id]
        pen = unit.pen_at(conditions[0].key.span)
        name, before = unit.local(source.name), unit.names.get(source.id)
        key_of = Body(unit, unit.local("key_of"), [name], unit.root)
        key_of.levels[source.id] = 0
        keys = [one.key for one in conditions]
        key_of.count(keys)
        unit.names[source.id] = name
        key_of.add(pen.back(pen.array(*(expression(self.builder, key, key_of) for key in keys))))
        key_of.define()
        if before is not None:
            unit.names[source.id] = before
        return pen.call(unit.helper(index_of_keys), items, pen.name(key_of.name))

    def _found_by_keys(self, source: plan.Source, index: ast.expr, body: Body) -> ast.expr:
        """What the index finds, or all rows where what the keys must equal cannot be computed."""
        unit, conditions = self.builder.unit, self.lookups[source.id]
        pen = unit.pen_at(conditions[0].other.span)
        sure = all(one.sure for one in conditions)
        with nullcontext() if sure else body.unsure():
            values = [expression(self.builder, one.other, body) for one in conditions]
        if sure:
            return pen.call(pen.part(index, "found"), *values)
        index = body.variable(index, pen, "index")
        found = unit.local("found")
        body.locals.append(found)
        unit.helper(Stopped)
        attempt = pen.assign(found, pen.call(pen.part(index, "found"), *values))
        body.add(pen.unless_stopped(attempt, pen.assign(found, pen.part(index, "rows"))))
        return pen.name(found)

    def _index_of_rows(
        self, source: plan.Source, items: ast.expr, names: list[str], columns: tuple[str, ...], pen: Pen
    ) -> ast.expr:
        places, wanted = [pen.constant(columns.index(name)) for name in names], self.wanted.get(source.id)
        if wanted is None:
            return pen.call(self.builder.unit.helper(index_of_plain), items, *places)
        value = pen.constant(columns.index(wanted))
        kinds = dict(source.columns or ())
        integers = all(kinds[name].only(Kind.INT) for name in (wanted, *names))
        if isinstance(source, plan.TableSource) and len(names) == 1 and integers:
            unit = self.builder.unit
            table = pen.name(unit.constant(source, "table"))
            return pen.call(unit.helper(index_of_integers), pen.name("run"), table, value, *places)
        return pen.call(self.builder.unit.helper(index_of_values), items, value, *places)

    def _kept(self, source: plan.Source, body: Body, items: ast.expr) -> ast.expr:
        facts = self.builder.source_facts(source)
        return body.kept(facts, items, self.builder.unit.pen_at(source.span), "read") if facts.steady else items


def is_table(query: plan.Query) -> bool:
    """Whether the elements of a query in FROM are its rows, so that no representation needs to be asked."""
    representation = query.representation
    plain = representation.name == "dict" and not (representation.arguments or representation.named)
    shaped = query.gives_paths or representation.labels or (query.group and not query.aggregated)
    return plain and not shaped and not any(output.label or output.star for output in query.columns)


def read_by_sources(query: plan.Query) -> list[plan.Expr]:
    """The expressions in the FROM of a query."""
    values = [source.value for source in query.sources if isinstance(source, plan.ValueSource)]
    return values + [e for source in query.sources if isinstance(source, plan.WorldSource) for e in source.arguments]
