"""Writes the step function of a search: `expand(state, closed)`, see runtime/search/step_contract.py.

Of the 8-puzzle (`SELECT slide(this, board) ... UNIQUE`) it looks like this, but for the names:

    def expand(state, closed):
        nonlocal generated, expanded, pruned, due
        made = drawn = 0
        board_frozen, = state
        plain = type(board_frozen) is tuple
        slide = slide_remembered if board_frozen == start else slide_once
        expanded += 1
        if generated >= due: due = meter(generated, expanded, pruned)
        block = slides
        turns = iter(block) if len(block) <= 64 else iterate_with_checks(run, block)
        try:
            for this in turns:
                drawn += 1
                generated += 1
                made += 1
                value = slide(this, list(board_frozen) if plain else fresh(thaw(board_frozen)))
                if type(value) is list and not value and not goal_of_script == value: continue     # STOP WITH
                ...                                                 # CHECKED: frozen, closed, check of what is new
                stop = [] == value
                goal = goal_of_script == value
                if stop and not goal: continue
                row = (frozen,)
                if stop:
                    yield row, frozen, True, False, None, None, None, None
                    continue
                yield row, frozen, goal, True, (frozen,), None, None, None
        finally:
            count(made)
        return drawn
"""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from ss2sql.language import plan
from ss2sql.language.plan_traversal import has_array_calls
from ss2sql.language.rows import Row
from ss2sql.language.values import THAWERS, order_rows
from ss2sql.runtime.python.codegen_context import COUNTERS, PythonScope
from ss2sql.runtime.python.flat_query import place_conditions
from ss2sql.runtime.python.located_code import list_names_code_reads
from ss2sql.runtime.python.python_expressions import generate_expression
from ss2sql.runtime.python.query_execution import TURNS_PER_CHECK, iterate_with_checks, make_count_report
from ss2sql.runtime.python.source_lookups import Lookup, find_index_lookups
from ss2sql.runtime.python.source_loops import SourceLoops, list_loop_expressions
from ss2sql.runtime.python.step_clauses import StepClauses, StepForm
from ss2sql.runtime.python.step_inlining import has_search_loop_code, inline_step_function
from ss2sql.runtime.run.search_paths import (
    START,
    PathKeys,
    collect_path_by_parents,
    follow_backpointers,
    make_start_backpointer,
)
from ss2sql.runtime.search.best_first import TAKEN

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler

HELPERS: tuple[Callable[..., Any], ...] = (
    deque,
    heappop,
    heappush,
    collect_path_by_parents,
    follow_backpointers,
    make_start_backpointer,
    PathKeys,
)  # of the loops
MAX_NESTED_LOOPS = 8  # loops over sources inside of the loop of the search; Python nests twenty blocks

# What stands before the loop over the elements, and in each turn of it. The counters are those of all searches, or
# inlined those of one. The clock is looked at now and then: for the elements of one list together, unless many.
BEFORE = """
expanded += TIMES
turns = iter(ITEMS)
"""
BEFORE_LIST = f"""
expanded += TIMES
LOOK
block = ITEMS
turns = iter(block) if len(block) <= {TURNS_PER_CHECK} else iterate_with_checks(run, block)
"""
COUNT = """
generated += TIMES
"""
LOOK = """
if generated >= due:
    counts = generated, expanded, pruned
    generated = expanded = pruned = 0
    due = meter(*counts)
"""


def sort_step_siblings(elements: Iterable[tuple[Any, Row]], descending: tuple[bool, ...]) -> list[Any]:
    """The elements in the order of ORDER SIBLINGS BY; they come with their keys."""
    pairs = list(elements)
    return order_rows([element for element, _ in pairs], [keys for _, keys in pairs], descending)


class StepLoops(SourceLoops):
    """The loops over the sources of a search; the step function counts the iterations of the innermost one."""

    def _are_turns_counted(self, innermost: bool, tested: bool) -> bool:
        return not innermost and super()._are_turns_counted(innermost, tested)


class StepFunction(StepClauses):
    """Writes the step function into `owner`; StepClauses has its arguments."""

    loops: StepLoops

    def __init__(
        self, builder: QueryCompiler, query: plan.Query, loops: StepLoops, form: StepForm, made: plan.Expr | None
    ) -> None:
        assert query.search is not None
        more = ["choose"] if query.search.repeats == "memorize" or form.noted else ["drop"] if form.complete else []
        if query.search.repeats == "unique" and query.search.weight is not None:
            more = ["best", "total"]
        body = PythonScope(builder.codegen, builder.codegen.new_name("expand"), ["state", "closed", *more], loops.owner)
        super().__init__(builder, query, body, loops, form, made)
        self.resumed = self.search.order == "depth first" and not self.edges  # the loop is left, and entered again
        placed: dict[int, list[plan.Expr]] = {}
        guarded = None
        if made is None:
            self._plan_lookups()
        else:
            placed, guarded = place_conditions(builder, replace(query, where=made), loops)
            placed[1] = [*placed.pop(0, []), *placed.get(1, [])]  # a step function goes through its elements
            guarded = None if guarded is None else max(guarded, 1)
        self.takes_arrays = has_array_calls(*self.keeps_everything, *(() if made is None else (made,)))
        listed = form.noted or self.takes_arrays
        several = bool(self.search.siblings) or len(query.sources) > MAX_NESTED_LOOPS or listed
        if several:
            self._write_element_generator(placed, guarded)
        else:
            self.inner = loops.open_loops(body, placed, guarded)
        loop = body.blocks[0][-1]
        assert isinstance(loop, ast.For)
        self.loop = loop
        alone = len(query.sources) == 1 and not isinstance(query.sources[0], plan.WorldSource)
        # the elements of a state are one list
        self.has_list_elements = listed or (alone and not several and len(loop.body) == len(placed.get(1, ())))
        body.find_arguments = self._find_arguments

    def write_function(self) -> str:
        """Writes the function and gives its name."""
        for name in COUNTERS:
            self.codegen.name_counter(name, self.body)
        self.inner.emit(self.build.add_to("drawn"))
        *before, loop = self._write_body(self.codegen.name_counter("due_step", self.body))
        names = list(self.frozen_states.values()) + ["_"] * (self.search.first is not None)
        begin = [self.build.assign("drawn", self.build.constant(0)), self.build.unpack(names, self.build.name("state"))]
        if self.single is not None and self.single.end:
            begin += self.single.begin
            loop = ast.Try([loop], [], [], self.single.end, **self.build.at)
        self.body.blocks[0][:] = [*begin, *before, loop, self.build.return_(self.build.name("drawn"))]
        self.body.define_function()
        return self.body.name

    def write_search(self, loop: Callable[..., Any]) -> str | None:
        """Writes the loop of a search with the step function inlined; gives its name, None if it cannot be inlined."""
        one_by_one = self.resumed and not self.has_list_elements
        if not has_search_loop_code(loop) or self.search.first is not None or self.takes_arrays or one_by_one:
            return None
        build, codegen = self.build, self.codegen
        report = build.express("make(run)", make=make_count_report)
        hand_on = codegen.bind("hand_on of steps", "hand_on", report, build)
        self.body.blocks[0][:] = self._write_body("due")
        function = self.body.build_function(build)
        assert isinstance(function, ast.FunctionDef)
        known = {
            "repeats": self.search.repeats,
            "likeliest": self.search.order == "probability",
            "weighed": self.search.weight is not None,
            "keyed": self.form.keyed,
            "alone": len(self.outputs) == 1,
            "apart": bool(self.search.key),
            "visits": self.form.key_of is not None,
            "last": self.query.last,
            "outdated": None,
        }
        begin = build.write("generated = expanded = pruned = due = 0")
        end = build.write("hand_on(generated, expanded, pruned)", hand_on=hand_on)
        if self.single is not None:
            begin, end = [*begin, *self.single.begin], [*self.single.end, *end]
        name = codegen.new_name("search")
        self.owner.emit(
            inline_step_function(loop, function, list(self.frozen_states.values()), known, name, begin, end, build)
        )
        for helper in HELPERS:
            codegen.use(helper)
        codegen.namespace |= {"START": START, "TAKEN": TAKEN}
        return name

    def _write_body(self, due: str) -> list[ast.stmt]:
        """The code of the function after the parameters, with what is computed once for a state; the loop is last."""
        build, codegen, body = self.build, self.codegen, self.body
        times = build.express("choose.counted" if self.form.noted else "1")
        look = build.write(LOOK, due=due, meter=codegen.read_step_meter())
        self.inner.emit(*build.write(COUNT, TIMES=times), *([] if self.has_list_elements else look))
        self.write_clauses()
        *before, loop = body.blocks[0]
        assert loop is self.loop
        items = self._write_element_tuples()
        self.loop.iter = build.name("turns")
        if self.has_list_elements and (self.edges or self.form.noted):
            items = self._choose_elements(items)
        if self.takes_arrays:
            items = build.call("list", items)
        single = self.single
        for_state = [] if single is None else single.state_statements
        for_state += [] if self.source_call is None else self.source_call.state_statements
        used = list_names_code_reads([*before, *for_state, items, self.loop])
        thawed = []
        for name, shape in self.shapes.items():
            value = codegen.states[self.query.id, name]
            if shape != "scalar" and value in used:
                made = build.call(codegen.use(THAWERS[shape]), build.name(self.frozen_states[name]))
                thawed.append(build.assign(value, made))
        codegen.use(iterate_with_checks)
        text = BEFORE_LIST if self.has_list_elements else BEFORE
        begin = build.write(text, TIMES=times, ITEMS=items, LOOK=look)
        return [*thawed, *before, *for_state, *begin, self.loop]

    # --- elements --------------------------------------------------------------------------------------

    def _find_arguments(self, call: plan.Call) -> str | None:
        """The name of a function that gives the arguments of a call for all elements of the state."""
        facts = [self.codegen.analysis.facts(argument) for argument in call.arguments]
        own = {source.id for source in self.query.sources}
        if own.isdisjoint(frozenset().union(*(one.sources for one in facts))):
            return None
        if not all(one.steady for one in facts) or any(map(self.inner.has_state_changed, facts)):
            return None
        build = self.codegen.build_at(call.place)
        given = PythonScope(self.codegen, self.codegen.new_name("given"), [], self.body)
        given.levels, given.find_arguments = dict.fromkeys(own, 1), self._find_arguments
        given.count_uses(call.arguments)
        given.open_loop(["element"], build.name("block"), build)
        loop = given.blocks[0][-1]
        assert isinstance(loop, ast.For)
        loop.target = self.loop.target
        arguments = (generate_expression(self.builder, argument, given) for argument in call.arguments)
        given.emit(build.run(build.yield_(build.pack(*arguments))))
        self.body.blocks[0].insert(-1, given.build_function(build))
        return given.name

    def _choose_elements(self, items: ast.expr) -> ast.expr:
        """The elements that lead to the goal in time, see runtime/search/bidirectional.py."""
        state = self.build.pack(*map(self.build.name, self.frozen_states.values()))
        return self.build.express("items if choose is None else choose(items, state)", items=items, state=state)

    def _write_element_tuples(self) -> ast.expr:
        """The elements; those of `FROM [[A, b], [a, B]]` are tuples if they are only unpacked and shown."""
        items, target, build = self.loop.iter, self.loop.target, self.build
        if not (isinstance(items, ast.List) and isinstance(target, ast.Name)):
            return items
        if not all(isinstance(item, ast.List) for item in items.elts):
            return items
        uses = apart = 0
        frozen: list[ast.Assign] = []
        for node in (node for part in self.loop.body for node in ast.walk(part)):
            match node:
                case ast.Name(id=name) if name == target.id:
                    uses += 1
                case ast.Subscript(ast.Name(id=name), ast.Constant(), ast.Load()) if name == target.id:
                    apart += 1
                case ast.Assign(value=ast.Call(ast.Name(id="tuple"), [ast.Name(id=name)])) if name == target.id:
                    apart += 1
                    frozen.append(node)
        if uses > apart:
            return items
        for node in frozen:
            node.value = build.name(target.id)  # a tuple already
        return build.array(*(build.pack(*item.elts) for item in items.elts if isinstance(item, ast.List)))

    def _write_element_generator(self, placed: Mapping[int, Sequence[plan.Expr]], guarded: int | None) -> None:
        """Loops over all sources in a generator of its own, for ORDER SIBLINGS BY."""
        codegen, build, outer, siblings = self.codegen, self.build, self.owner, self.search.siblings
        states = sorted(self.body.states)
        generator = PythonScope(codegen, codegen.new_name("elements"), [codegen.states[s] for s in states], outer)
        generator.states = self.body.states
        generator.count_uses([*list_loop_expressions(self.query), *(key.expr for key in siblings)])
        innermost = self.loops.open_loops(generator, placed, guarded)
        names = [codegen.names[source.id] for source in self.query.sources]
        yielded = build.pack(*map(build.name, names)) if len(names) > 1 else build.name(*names)
        if siblings:
            yielded = build.pack(
                yielded, build.pack(*(generate_expression(self.builder, key.expr, innermost) for key in siblings))
            )
        innermost.emit(build.run(build.yield_(yielded)))
        innermost.define_function()
        items = build.call(generator.name, *map(build.name, generator.parameters))
        if siblings:
            descending = build.name(codegen.embed(tuple(key.descending for key in siblings), "descending"))
            items = build.call(codegen.use(sort_step_siblings), items, descending)
        self.body.open_loop(names, items, build)
        self.body.levels.update((source.id, 1) for source in self.query.sources)

    def _plan_lookups(self) -> None:
        """Excludes elements that STOP WITH and WHERE drop at once: `STOP WITH a != b ...`, `WHERE a == b ...`.

        Without a WHERE, STOP WITH suffices. With MEMORIZE these elements matter, because STOP WITH is not evaluated for
        a step to a known row.
        """
        stop = self.search.stop.parts if isinstance(self.search.stop, plan.Or) else (self.search.stop,)
        where = self.query.where.parts if isinstance(self.query.where, plan.And) else (self.query.where,)
        rows = [self.codegen.analysis.facts(expr) for expr in self.outputs] if self.compares else []
        told = self.edges or self.form.noted or self.form.complete or self.form.watched
        if told or not all(facts.steady and facts.total for facts in rows):
            return
        for part, other in zip(stop, where if self.query.where else stop, strict=False):
            dropped = [] if part is None else find_index_lookups(part, self.codegen.analysis, "ne")
            if self.query.where and other is not None:
                kept = find_index_lookups(other, self.codegen.analysis)
                dropped = [one for one in dropped if any(self._do_read_same(one, same) for same in kept)]
            if not any(map(self.loops.plan_lookup, dropped)):
                return

    def _do_read_same(self, one: Lookup, other: Lookup) -> bool:
        pairs = ((one.key, other.key), (one.other, other.other))
        keys = [(self.codegen.analysis.facts(a).key, self.codegen.analysis.facts(b).key) for a, b in pairs]
        return all(a is not None and a == b for a, b in keys)
