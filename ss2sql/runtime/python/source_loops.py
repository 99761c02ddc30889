"""The sources of a query as loops, the last one innermost, and the conditions that are tested between them.

A source that mentions neither an earlier source nor the search's state is read once, when its query begins,
in written order. Any other is read again for each of their values. What is read is a list of its own, so a
value that changes during the walk does no harm.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, takewhile
from typing import TYPE_CHECKING, Any, assert_never

from ss2sql.language import plan
from ss2sql.language.kinds import INT, Kind
from ss2sql.language.plan_traversal import can_end_early, has_array_calls, list_columns_read, split_and
from ss2sql.language.values import make_hashable
from ss2sql.runtime.python.call_code import CallStages
from ss2sql.runtime.python.codegen_context import MAX_LOOPS, ExpressionFacts, PythonScope
from ss2sql.runtime.python.located_code import AstBuilder
from ss2sql.runtime.python.python_expressions import SCALAR_KINDS, generate_expression
from ss2sql.runtime.python.query_execution import (
    TURNS_PER_CHECK,
    iterate_with_checks,
    list_elements_with_keys,
    loop_over_dict_columns,
    loop_over_frame_rows,
    loop_over_table_rows,
)
from ss2sql.runtime.python.source_lookups import (
    Lookup,
    RangeIndex,
    RangeLookup,
    WorldCondition,
    find_world_condition,
    generate_world_loop,
    index_column,
    index_rows,
    index_rows_by_members,
)
from ss2sql.runtime.run.key_order import RowOrder
from ss2sql.vtables.frames import list_elements_or_none, list_source_elements

if TYPE_CHECKING:
    from ss2sql.lowering.flat import TableFilter
    from ss2sql.runtime.python.native_query import QueryCompiler


class SourceLoops:
    """The loops of one query, opened in `body`; what is read once is read in `owner`, around it or the same.

    They stand `inside` of the loops of another query, see flat_query.py, or are loops of their own.
    """

    def __init__(self, builder: QueryCompiler, query: plan.Query, owner: PythonScope, inside: bool = False) -> None:
        from ss2sql.runtime.python.flat_query import can_open_inside, has_test_before_loop

        self.builder = builder
        self.query = query
        self.owner = owner
        self.sources = tuple(map(self._narrow_table, query.sources))
        self.facts = [builder.get_source_facts(source) for source in self.sources]
        own = {source.id for source in query.sources}
        self.lateral = [
            # What a world is queried for depends on the conditions that it gets.
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
            and can_open_inside(source.query, builder.codegen.analysis)
            and not (source is ends and has_test_before_loop(source.query, builder.codegen.analysis))
        }
        own_function = query.search is None and not inside and not owner.parameters
        self.alone = own_function and len(self.sources) == 1 and not any(self.lateral)
        self.items: dict[int, str] = {}  # by source: what is read once
        self.lookups: dict[int, list[Lookup]] = {}  # by source: what its loop looks up
        self.ranges: dict[int, list[list[RangeLookup]]] = {}  # by source: what it looks up in the order of each key
        self.world_conditions: dict[int, list[WorldCondition]] = {}  # by source: what a world is told of conditions
        self.wanted: dict[int, str] = {}  # by source: the only column that is read of what its loop looks up
        self.stages: CallStages | None = None  # where functions that take arrays are called

    @property
    def first_read_once(self) -> int:
        """The number of the first source from which on all are read once."""
        return max((index + 1 for index, lateral in enumerate(self.lateral) if lateral), default=0)

    @property
    def first_unnoticed(self) -> int:
        """The number of the first source from which on reading one has no effect; what fails need not be read."""
        loud = (index + 1 for index, facts in enumerate(self.facts) if self.lateral[index] and not facts.steady)
        return max(loud, default=0)

    def read_constant_sources(self) -> None:
        """Reads what has to be read once."""
        for source, lateral in zip(self.sources, self.lateral, strict=True):
            if self.inside:  # it is read where its loop begins, after the conditions before it
                if isinstance(source, plan.TableSource):
                    self.builder.codegen.tuples[source.id] = tuple(name for name, _ in source.columns)
            elif not lateral:
                build, items = self.builder.codegen.build_at(source.span), self._list_elements(source, self.owner)
                name = self.items[source.id] = self.builder.codegen.new_name("items")
                self.owner.emit(build.assign(name, items))
                self.owner.locals.append(name)

    def attach_keys(self, source: plan.Source) -> None:
        """Lets elements come with their exact keys, where they are values read once."""
        codegen = self.builder.codegen
        if source.id not in self.items or source.id in self.lookups or source.id in codegen.tuples:
            return
        build, name = codegen.build_at(source.span), self.items[source.id]
        codegen.keys[source.id] = codegen.new_name("exact")
        self.owner.emit(build.assign(name, build.call(codegen.use(list_elements_with_keys), build.name(name))))

    def plan_lookup(self, condition: Lookup) -> bool:
        """Plans to look up what the condition asks for; gives whether that is possible and worth it.

        What the column must equal has to be known before the source's loop, and nothing that is read after it
        may notice. A loop that runs only once is as quick without an index.
        """
        if not self._can_look_up(condition):
            return False
        known = self.lookups.setdefault(condition.source, [])
        if not condition.several:
            known.insert(0, condition)
        elif not any(one.several for one in known):
            known.append(condition)
        else:
            return False
        return True

    def plan_range(self, condition: RangeLookup) -> None:
        """Plans the same of a condition of order, which is tested all the same."""
        if self._can_look_up(condition):
            ranges = self.ranges.setdefault(condition.source, [])
            known = next((one for one in ranges if self._is_same(one[0].key, condition.key)), None)
            if known is None:
                ranges.append([condition])
            else:
                known.append(condition)

    def _is_same(self, one: plan.Expr, other: plan.Expr) -> bool:
        key = self.builder.codegen.analysis.facts(one).key
        return key is not None and key == self.builder.codegen.analysis.facts(other).key

    def _can_look_up(self, condition: Lookup | RangeLookup) -> bool:
        number = {source.id: index for index, source in enumerate(self.sources)}
        if condition.source not in number or self._has_noticeable_calls(condition.key):
            return False
        other = self.builder.codegen.analysis.facts(condition.other)
        index = number[condition.source]
        facts = self.facts[index]
        if self.lateral[index] or not facts.steady:
            return False
        if index + 1 < self.first_unnoticed or any(number.get(known, -1) > index for known in other.sources):
            return False
        correlated = bool(other.sources or other.states) and self.owner.find_home(facts)[0] is not self.owner
        return not (index == 0 and self.query.search is None and not correlated)

    def _has_noticeable_calls(self, key: plan.Expr) -> bool:
        """Whether a key calls functions of the user for rows that LIMIT cuts off."""
        return can_end_early(self.query) and self.builder.codegen.analysis.facts(key).calls

    def has_column_index(self, source: plan.Source) -> bool:
        """Whether the source's loop looks up rows by one column of numbers or text."""
        if source.id not in self.builder.codegen.tuples or len(self.lookups.get(source.id, ())) != 1:
            return False
        (known,) = self.lookups[source.id]
        return known.sure and isinstance(known.key, plan.Column) and known.key.type.is_only(SCALAR_KINDS)

    def push_condition_to_world(self, condition: plan.Expr) -> None:
        """Tells a world of a condition, where what its column is compared with is known before the world is queried.

        The condition is tested all the same, so it may be evaluated early only where nobody can notice.
        """
        facts = self.builder.codegen.analysis.facts(condition)
        demand = find_world_condition(condition, self.sources) if facts.steady and facts.total else None
        if demand is None:
            return
        number = {source.id: index for index, source in enumerate(self.sources)}
        index = number[demand.source]
        known = self.builder.codegen.analysis.facts(demand.value).sources
        if index + 1 >= self.first_unnoticed and all(number.get(other, -1) < index for other in known):
            self.world_conditions.setdefault(demand.source, []).append(demand)

    def open_loops(
        self,
        body: PythonScope,
        conditions: Mapping[int, Sequence[plan.Expr]],
        guarded: int | None = None,
        rest: Sequence[plan.Expr] = (),
    ) -> PythonScope:
        """Opens all loops and gives the function where the innermost one is, which goes on to evaluate the `rest`.

        `conditions` gives for each number of bound sources what is tested then. With `guarded` the loops from
        this number on are entered only if all their sources, which are read once, have elements.
        """
        for index, source in enumerate(self.sources):
            if index == guarded:
                self._skip_empty_sources(body, self.sources[index:])
            read: list[Any] = [] if source.id in self.items else [source]
            read += [one.other for one in (*self.lookups.get(source.id, ()), *chain(*self.ranges.get(source.id, ())))]
            body = self._stage_calls(self._test_conditions(body, conditions.get(index, ())), read)
            if body.level == MAX_LOOPS:
                body = self._start_inner_function(body)
            counted = self._are_turns_counted(index + 1 == len(self.sources), bool(conditions.get(index + 1)))
            looked_up = source.id in self.lookups or source.id in self.ranges
            at_once = counted and source.id in self.items and not looked_up
            if at_once:
                self._count_turn(body)
            body = self._open_loop(body, source, at_once)
            if counted and not at_once:
                self._count_turn(body)
        body = self._stage_calls(self._test_conditions(body, conditions.get(len(self.sources), ())), rest)
        if self.stages is not None and self.query.aggregated:  # groups are collected in the last function
            body = self.stages.begin_stage(body, self.builder.codegen.build)
        return body

    def _stage_calls(self, body: PythonScope, parts: Sequence[Any]) -> PythonScope:
        """The function that goes on to evaluate the parts."""
        return body if self.stages is None or not body.level else self.stages.add_calls(body, parts)

    def _open_loop(self, body: PythonScope, source: plan.Source, checked: bool) -> PythonScope:
        """Opens a loop; a `checked` one, whose items are read once, looks at the clock itself where they are many."""
        from ss2sql.runtime.python.flat_query import open_inner_loops

        codegen = self.builder.codegen
        if source.id in self.opened:
            assert isinstance(source, plan.QuerySource)
            read = self._list_columns_read(source.id, tuple(output.name for output in source.query.columns))
            body = open_inner_loops(self.builder, source, read, body)
            body.levels[source.id] = body.level
            return body
        build = codegen.build_at(source.span)
        if source.id in self.items:
            items = build.name(self.items[source.id])
        elif isinstance(source, plan.TableSource) and self.inside and source.id in self.lookups:
            items = self._read_table(source, body)  # of which nothing but the index needs to stay
        else:
            items = self._list_elements(source, body)
        if source.id in self.lookups:
            items = self._look_up_source(source, items, body)
        if source.id in self.ranges:
            items = self._look_up_range(source, items, body)
        name = codegen.names[source.id] = codegen.new_name(source.name)
        names = (name, codegen.keys.get(source.id))
        if (self.alone and body.level == 0) or checked:
            text = (
                f"items if len(items) <= {TURNS_PER_CHECK} else parts(run, items)" if checked else "parts(run, items)"
            )
            items = build.express(text, items=items, parts=iterate_with_checks)
        body.open_loop([word for word in names if word is not None], items, build)
        body.levels[source.id] = body.level
        if source.id in self.items and self.stages is not None:
            self.stages.spent.add(self.items[source.id])
        return body

    def _are_turns_counted(self, innermost: bool, tested: bool) -> bool:
        """Whether a loop counts its turns: the loop around an inner query counts what comes to the end of its loops."""
        return not self.alone and not (self.inside and innermost and not tested)

    def _count_turn(self, body: PythonScope) -> None:
        """Counts a turn, or a loop of few turns, and looks at the clock now and then."""
        codegen = self.builder.codegen
        build = codegen.build
        ticks, due = codegen.name_counter("ticks", body), codegen.name_counter("due_tick", body)
        text = "ticks += 1\nif ticks >= due: due = look"
        body.emit(*build.write(text, ticks=ticks, due=due, look=codegen.write_turn_check(ticks)))

    def _test_conditions(self, body: PythonScope, conditions: Sequence[plan.Expr]) -> PythonScope:
        for condition in conditions:
            body = self._stage_calls(body, [condition])
            build = self.builder.codegen.build_at(condition.span)
            body.emit(build.if_not(generate_expression(self.builder, condition, body), self._write_skip(body, build)))
        return body

    def _skip_empty_sources(self, body: PythonScope, sources: Sequence[plan.Source]) -> None:
        for source in sources:
            build = self.builder.codegen.build_at(source.span)
            body.emit(build.if_not(build.name(self.items[source.id]), self._write_skip(body, build)))

    @staticmethod
    def _write_skip(body: PythonScope, build: AstBuilder) -> ast.stmt:
        """Goes on with the next element of the innermost open loop, or ends where none is open."""
        return build.continue_loop() if body.level else ast.Return(None, **build.at)

    def _start_inner_function(self, body: PythonScope) -> PythonScope:
        """A new function for the loops further in: Python does not nest any number of them."""
        codegen = self.builder.codegen
        rest = PythonScope(codegen, codegen.new_name("rest"), [*body.parameters, *body.locals], body.parent)
        rest.levels = dict.fromkeys(body.levels, 0)
        rest.states, rest.groups, rest.counts = body.states, body.groups, body.counts
        call = codegen.build.call(rest.name, *map(codegen.build.name, rest.parameters))
        body.emit(codegen.build.run(ast.YieldFrom(call, **codegen.build.at)))
        rest.before = body
        return rest

    def _list_elements(self, source: plan.Source, body: PythonScope) -> ast.expr:
        """The elements of a source as a list of values, or of tuples where `codegen.tuples` says so."""
        builder, codegen = self.builder, self.builder.codegen
        build = codegen.build_at(source.span)
        match source:
            case plan.TableSource(columns=columns):
                codegen.tuples[source.id] = tuple(name for name, _ in columns)
                return body.compute_once(ExpressionFacts(), self._read_table(source, body), build, source.name)
            case plan.ValueSource(value=plan.Variable(frame=True) as value, columns=columns) if columns:
                words = codegen.tuples[source.id] = self._list_columns_read(source.id, tuple(w for w, _ in columns))
                read = generate_expression(builder, value, body)
                rows = build.call(codegen.use(loop_over_frame_rows), read, *map(build.constant, words))
                return self._read_once(source, body, rows)
            case plan.ValueSource(value=value) if words := self._list_dict_columns_read(source, body):
                codegen.tuples[source.id] = words
                read = generate_expression(builder, value, body)
                rows = build.call(codegen.use(loop_over_dict_columns), read, *map(build.constant, words))
                return self._read_once(source, body, rows)
            case plan.ValueSource(value=value):
                codegen.elements[source.id] = source.element
                if isinstance(value, plan.MakeList):
                    return self._read_once(source, body, generate_expression(builder, value, body))
                if isinstance(value, plan.Constant):
                    return build.name(codegen.embed(list_source_elements(value.value), "items"))
                build = codegen.build_at(value.span)
                return self._read_once(
                    source,
                    body,
                    build.call(codegen.use(list_source_elements), generate_expression(builder, value, body)),
                )
            case plan.QuerySource(query=query):
                nested = builder.compile_query(query, body)
                if loops_over_query_rows(query):
                    codegen.tuples[source.id] = tuple(output.name for output in query.columns)
                    rows = build.call(nested.found or nested.tuples, *nested.arguments)
                    return self._read_once(source, body, build.call("list", rows) if nested.found else rows)
                codegen.elements[source.id] = source.element
                value_of_query = build.call(nested.value, *nested.arguments)
                made = list_elements_or_none if source.optional else list_source_elements
                return self._read_once(source, body, build.call(codegen.use(made), value_of_query))
            case plan.WorldSource():
                return generate_world_loop(builder, source, self.world_conditions.get(source.id, ()), body)
            case _:
                assert_never(source)

    def _narrow_table(self, source: plan.Source) -> plan.Source:
        """A table with the columns that are read, one at least."""
        if not isinstance(source, plan.TableSource):
            return source
        names = self._list_columns_read(source.id, tuple(name for name, _ in source.columns))
        columns = tuple(column for column in source.columns if column[0] in names) or source.columns[:1]
        collated = tuple(name for name in source.collated if name in dict(columns))
        return replace(source, columns=columns, collated=collated)

    def _read_table(self, source: plan.TableSource, body: PythonScope) -> ast.expr:
        codegen, wanted = self.builder.codegen, self._find_table_filter(source)
        build = codegen.build_at(source.span)
        arguments = [build.name("run"), build.name(codegen.embed(source, "table"))]
        if wanted is not None:
            values = [generate_expression(self.builder, one.expr, body) for one in wanted.parameters]
            arguments += [
                build.name(codegen.embed(wanted, "wanted")),
                build.express("lambda: values", values=build.pack(*values)),
            ]
        return build.call(codegen.use(loop_over_table_rows), *arguments)

    def _find_table_filter(self, source: plan.TableSource) -> TableFilter | None:
        """What SQLite leaves out of the rows of a table, where nobody can notice whether the rest is evaluated."""
        query, find_facts = self.query, self.builder.codegen.analysis.facts
        if query.search is not None or not all(one.steady for one in self.facts):
            return None
        parts = split_and(query.where)
        known = takewhile(lambda part: find_facts(part).steady, parts)
        own = [part for part in known if find_facts(part).total and self._reads_only(source, find_facts(part))]
        enough = None
        if len(self.sources) == 1 and len(own) == len(parts) and not (query.grouped or query.order):
            counts = (query.limit, query.offset or plan.Constant(0, INT, span=source.span))
            values = [count.value for count in counts if isinstance(count, plan.Constant) and type(count.value) is int]
            enough = sum(values) if len(values) == 2 and min(values) >= 0 else None
        if not own and enough is None:
            return None
        from ss2sql.lowering.flat import lower_table_filter  # which takes 60 ms to load

        return lower_table_filter(source, own, enough)

    @staticmethod
    def _reads_only(source: plan.Source, facts: ExpressionFacts) -> bool:
        return facts.sources == {source.id} and not (facts.states or facts.groups)

    def _list_columns_read(
        self, source: int, columns: tuple[str, ...], whole: tuple[str, ...] | None = None
    ) -> tuple[str, ...]:
        """Those of the columns that are read; `whole`, by default all, where elements are."""
        return list_columns_read(self.builder.codegen.analysis.roots, source, columns, whole)

    def _list_dict_columns_read(self, source: plan.ValueSource, body: PythonScope) -> tuple[str, ...]:
        """The columns that a search reads of dicts, where it reads nothing else of them: 0.8 of its time on a grid."""
        if self.query.search is None or body is not self.owner or not source.element.is_only(Kind.DICT):
            return ()
        return self._list_columns_read(source.id, tuple(name for name, _ in source.columns or ()), whole=())

    def _look_up_source(self, source: plan.Source, items: ast.expr, body: PythonScope) -> ast.expr:
        """The elements that the source's lookup finds; its index lives as long as the elements do.

        They are all elements where what the keys must equal cannot be computed.
        """
        codegen, conditions = self.builder.codegen, self.lookups[source.id]
        build = codegen.build_at(conditions[0].key.span)
        write_index = self._write_column_index if source.id in self.wanted else self._write_index
        made = write_index(source, items, build)
        index = body.compute_once(self.builder.get_source_facts(source), made, build, "index")
        build = codegen.build_at(conditions[0].other.span)
        others = [one.other for one in conditions]
        if all(one.sure for one in conditions):
            return build.express("index.get(key, ())", index=index, key=self._write_key(others, body, build))
        with body.write_skippable():
            key = self._write_key(others, body, build)
        index = body.name_or_constant(index, build, "index")
        found = codegen.new_name("found")
        body.locals.append(found)
        attempt = build.write("found = index.find_rows(key)", found=found, index=index, key=key)
        body.emit(*build.try_unless_stopped(attempt, build.write("found = index.rows", found=found, index=index)))
        return build.name(found)

    def _look_up_range(self, source: plan.Source, items: ast.expr, body: PythonScope) -> ast.expr:
        """Those of the items whose keys are within bounds, in the order of a key where the query asks for it."""
        codegen, ranges = self.builder.codegen, self.ranges[source.id]
        ordered = [known for known in ranges if self._is_ordered_by(known[0].key)]
        ranges = ordered or ranges
        build = codegen.build_at(ranges[0][0].key.span)
        keys_of = [self._write_keys_function(source, [known[0].key], build) for known in ranges]
        descending = build.constant(bool(ordered) and self.query.order[0].descending)
        made = build.call(codegen.use(RangeIndex), descending, *keys_of)
        index = body.compute_once(self.builder.get_source_facts(source), made, build, "ranges")
        asked = [
            (
                build.pack(*(build.constant(one.operator) for one in known)),
                build.pack(*(generate_expression(self.builder, one.other, body) for one in known)),
            )
            for known in ranges
        ]
        if not ordered:
            return build.call(build.part(index, "find_rows"), items, *(build.pack(*one) for one in asked))
        order = codegen.bind(("row order", self.query.id), "row_order", build.express("order()", order=RowOrder), build)
        codegen.row_orders[self.query.id] = order
        return build.call(build.part(index, "find_rows_in_order"), items, build.name(order), *asked[0])

    def _is_ordered_by(self, key: plan.Expr) -> bool:
        """Whether the rows of the query are wanted in the order of a key of its only source first, up to LIMIT."""
        query = self.query
        if query.limit is None or not query.order or len(self.sources) != 1:
            return False
        if query.search or query.grouped or query.distinct or not self._is_same(query.order[0].expr, key):
            return False
        return self.builder.codegen.analysis.are_steady([output.expr for output in query.columns])

    def _write_key(self, values: Sequence[plan.Expr], body: PythonScope, build: AstBuilder) -> ast.expr:
        """What stands for values where they are compared."""
        codegen, keys = self.builder.codegen, list[ast.expr]()
        for expr in values:
            value = generate_expression(self.builder, expr, body)
            keys.append(value if expr.type.is_only(SCALAR_KINDS) else build.call(codegen.use(make_hashable), value))
        return keys[0] if len(keys) == 1 else build.pack(*keys)

    def _write_index(self, source: plan.Source, items: ast.expr, build: AstBuilder) -> ast.expr:
        """The index by keys."""
        lookups = self.lookups[source.id]
        make_index = index_rows_by_members if lookups[-1].several else index_rows
        keys_of = self._write_keys_function(source, [one.key for one in lookups], build, lookups)
        return build.call(self.builder.codegen.use(make_index), items, keys_of)

    def _write_keys_function(
        self, source: plan.Source, keys: Sequence[plan.Expr], build: AstBuilder, lookups: Sequence[Lookup] = ()
    ) -> ast.expr:
        """A function that computes the keys of rows, of lookups where these are theirs."""
        codegen = self.builder.codegen
        name, before = codegen.new_name(source.name), codegen.names.get(source.id)
        rows = codegen.new_name("rows")
        body = PythonScope(codegen, codegen.new_name("keys_of"), [rows], codegen.root)
        stages = CallStages(self.builder, body)
        body.count_uses(keys)
        codegen.names[source.id] = name
        body.open_loop([name], build.name(rows), build)
        body.levels[source.id] = 1
        if has_array_calls(*keys):
            body = stages.add_calls(body, keys)
        several = any(one.several for one in lookups)
        key = self._write_several_keys(lookups, body, build) if several else self._write_key(keys, body, build)
        body.emit(build.run(build.yield_(key)))
        body.define_function()
        if before is not None:
            codegen.names[source.id] = before
        return build.name(stages.join_stages())

    def _write_several_keys(self, lookups: Sequence[Lookup], body: PythonScope, build: AstBuilder) -> ast.expr:
        """What the keys of a row have in common, and the rest of each: those of the last lookup."""
        *common, last = lookups
        known = build.pack(*(self._write_key([one.key], body, build) for one in common))
        if last.listed:
            made = generate_expression(self.builder, last.key, body)
            return build.pack(known, build.call("map", build.name(self.builder.codegen.use(make_hashable)), made))
        return build.pack(known, build.pack(*(self._write_key([one], body, build) for one in last.members)))

    def _write_column_index(self, source: plan.Source, items: ast.expr, build: AstBuilder) -> ast.expr:
        """The index of a source of which one column is wanted; without its rows, which nobody needs."""
        codegen, (known,), wanted = self.builder.codegen, self.lookups[source.id], self.wanted[source.id]
        assert isinstance(known.key, plan.Column)
        places = [build.constant(codegen.tuples[source.id].index(name)) for name in (wanted, known.key.name)]
        return build.call(codegen.use(index_column), items, *places)

    def _read_once(self, source: plan.Source, body: PythonScope, items: ast.expr) -> ast.expr:
        facts = self.builder.get_source_facts(source)
        return (
            body.compute_once(facts, items, self.builder.codegen.build_at(source.span), "read")
            if facts.steady
            else items
        )


def loops_over_query_rows(query: plan.Query) -> bool:
    """Whether the elements of a query in FROM are its rows, so that no representation is called."""
    representation = query.representation
    plain = representation.name == "dict" and not (representation.arguments or representation.named)
    shaped = query.gives_paths or representation.labels or (query.group and not query.aggregated)
    return plain and not shaped and not any(output.label or output.star for output in query.columns)


def list_loop_expressions(query: plan.Query) -> list[plan.Expr]:
    values = [source.value for source in query.sources if isinstance(source, plan.ValueSource)]
    return values + [e for source in query.sources if isinstance(source, plan.WorldSource) for e in source.arguments]
