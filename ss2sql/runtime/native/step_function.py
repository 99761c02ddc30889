"""Writes the step function of a search: `expand(state, closed)`, see search/contract.py.

Of the 8-puzzle (`SELECT slide(this, board) ... UNIQUE`) it looks like this, but for the names:

    def expand(state, closed):
        nonlocal generated, expanded, pruned, due
        made = 0
        board_frozen, = state
        plain = type(board_frozen) is tuple
        slide = slide_remembered if board_frozen == start else slide_once
        expanded += 1
        if generated >= due: due = meter(generated, expanded, pruned)
        block = slides
        generated += len(block)
        turns = iter(block) if len(block) <= 64 else Parts(block, run)
        try:
            for this in turns:
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
            generated -= turns.__length_hint__()
            count(made)
        return len(block)
"""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.runtime import frozen
from ss2sql.runtime.native.call_code import is_remembered, keyed_elements
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import placed_conditions
from ss2sql.runtime.native.fragments import names_read, written
from ss2sql.runtime.native.inlining import has_text, searching
from ss2sql.runtime.native.lookups import Lookup, lookups
from ss2sql.runtime.native.loops import Loops, read_by_sources
from ss2sql.runtime.native.pace import SHORT, Parts, counts_of, meter_of, steps_pace_of
from ss2sql.runtime.native.step_clauses import StepClauses, StepForm
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.ordering import sort_rows
from ss2sql.runtime.rows import Row
from ss2sql.runtime.search.best_first import TAKEN
from ss2sql.runtime.ways import START, Parents, Trail, path_by_parents, path_to, place_of
from ss2sql.walk import walk

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

HELPERS: tuple[Callable[..., Any], ...] = (
    deque,
    heappop,
    heappush,
    path_by_parents,
    path_to,
    place_of,
    Parents,
    Trail,
)  # of the loops
MOST_INSIDE = 8  # loops over sources inside of the loop of the search; Python nests twenty blocks

# The clock is looked at now and then. The counters are those of the whole run, or inlined those of a search.
LOOK = """
if generated >= due:
    due = meter(generated, expanded, pruned)
"""
LOOK_INLINED = """
if generated >= due:
    due = meter(generated, expanded, pruned)
    generated = expanded = pruned = 0
"""

# What stands around the loop over the elements. Those of one list are counted together: a tenth of the time of a grid.
TOGETHER = f"""
expanded += 1
LOOK
block = ITEMS
generated += len(block)
turns = iter(block) if len(block) <= {SHORT} else Parts(block, run)
try:
    LOOP
finally:
    generated -= turns.__length_hint__()
    END
return len(block)
"""
# The same with notes, which may be taken several times.
NOTED = (
    TOGETHER.replace("expanded += 1", "expanded += choose.counted")
    .replace("generated += len", "generated += choose.counted * len")
    .replace("generated -= turns", "generated -= choose.counted * turns")
)
ONE_BY_ONE = """
expanded += 1
drawn = 0
turns = iter(ITEMS)
try:
    LOOP
finally:
    END
return drawn
"""
COUNT = """
drawn += 1
generated += 1
LOOK
"""


def in_order(elements: Iterable[tuple[Any, Row]], descending: tuple[bool, ...]) -> list[Any]:
    """The elements, which come with their keys, as ORDER SIBLINGS BY has them."""
    pairs = list(elements)
    return sort_rows([element for element, _ in pairs], [keys for _, keys in pairs], descending)


class StepLoops(Loops):
    """The loops over the sources of a search, whose innermost turns are its steps; the step function counts these."""

    def _count(self, body: Body, innermost: bool) -> None:
        if not innermost:
            super()._count(body, innermost)


class StepFunction(StepClauses):
    """Writes the function into `owner`, see StepClauses for what it takes."""

    loops: StepLoops

    def __init__(
        self, builder: Builder, query: plan.Query, loops: StepLoops, form: StepForm, made: plan.Expr | None
    ) -> None:
        assert query.search is not None
        more = ["choose"] if query.search.repeats == "memorize" or form.noted else ["drop"] if form.complete else []
        if query.search.repeats == "unique" and query.search.weight is not None:
            more = ["best", "total"]
        body = Body(builder.unit, builder.unit.local("expand"), ["state", "closed", *more], loops.owner)
        super().__init__(builder, query, body, loops, form, made)
        self.resumed = self.search.order == "depth first" and not self.edges  # the loop is left, and entered again
        placed: dict[int, list[plan.Expr]] = {}
        guarded = None
        if made is None:
            self._look_up()
        else:
            placed, guarded = placed_conditions(builder, replace(query, where=made), loops)
            placed[1] = [*placed.pop(0, []), *placed.get(1, [])]  # a step function goes through its elements
            guarded = None if guarded is None else max(guarded, 1)
        if not form.noted:
            self._accompany()
        several = bool(self.search.siblings) or len(query.sources) > MOST_INSIDE or form.noted
        if several:
            self._generate(placed, guarded)
        else:
            self.inner = loops.open(body, placed, guarded)
        loop = body.blocks[0][-1]
        assert isinstance(loop, ast.For)
        self.loop = loop
        alone = len(query.sources) == 1 and not isinstance(query.sources[0], plan.WorldSource)
        # the elements of a state are one list
        self.has_list = form.noted or (alone and not several and len(loop.body) == len(placed.get(1, ())))

    def write_function(self) -> str:
        """Writes the function and gives its name."""
        for name in ("generated", "expanded", "pruned"):
            self.unit.counter(name, self.body)
        meter = self.pen.call(self.unit.helper(meter_of), self.pen.name("run"))
        words = {
            "meter": self.pen.name(self.unit.bind("meter", "meter", meter, self.pen)),
            "due": self.pen.name(self.unit.counter("due_step", self.body)),
        }
        code = self._write(LOOK, words, self.has_list)
        begin = [] if self.single is None else self.single.begin
        names = list(self.frozen_states.values()) + ["_"] * (self.search.first is not None)
        states = self.pen.unpack(names, self.pen.name("state"))
        self.body.blocks[0][:] = [*begin, states, *code]
        self.body.define()
        return self.body.name

    def write_search(self, loop: Callable[..., Any]) -> str | None:
        """Writes the loop of a search with the function put in, and gives its name; None where it cannot be."""
        if not has_text(loop) or self.search.first is not None or (self.resumed and not self.has_list):
            return None
        pen, unit, run = self.pen, self.unit, self.pen.name("run")
        meter = unit.bind("meter of steps", "meter", pen.call(unit.helper(steps_pace_of), run), pen)
        hand_on = unit.bind("hand_on of steps", "hand_on", pen.call(unit.helper(counts_of), run), pen)
        self.body.blocks[0][:] = self._write(
            LOOK_INLINED, {"meter": pen.name(meter)}, self.has_list and not self.resumed
        )
        function = self.body.finished(pen)
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
        expanded = 0 if self.edges else -1  # a search is no step, so its start does not count
        begin = written(f"generated = pruned = due = 0\nexpanded = {expanded}\nturns = iter(())", pen, {})
        begin += [] if self.single is None else self.single.begin
        counted = (pen.name(word) for word in ("generated", "expanded", "pruned"))
        end = pen.run(pen.call(hand_on, *counted))
        name = unit.local("search")
        self.owner.add(searching(loop, function, list(self.frozen_states.values()), known, name, begin, end, pen))
        for helper in HELPERS:
            unit.helper(helper)
        unit.namespace |= {"START": START, "TAKEN": TAKEN}
        return name

    def _write(self, look: str, words: dict[str, ast.expr], together: bool) -> list[ast.stmt]:
        """The code of the function behind the parameters, with what is computed once for a state.

        `together`: the elements of a state are counted together, as soon as it is expanded.
        """
        pen, unit, body = self.pen, self.unit, self.body
        watch = written(look, pen, words)
        if not together:
            self.inner.add(*written(COUNT, pen, {"LOOK": watch}))
        self.write_clauses()
        *before, loop = body.blocks[0]
        assert loop is self.loop
        items = self._items_as_tuples()
        self.loop.iter = pen.name("turns")
        if together and (self.edges or self.form.noted):
            items = self._chosen(items)
        unit.helper(Parts)
        single = self.single
        for_state = [] if single is None else single.for_state
        used = names_read([*before, *for_state, items, self.loop])
        thawed = []
        for name, shape in self.shapes.items():
            value = unit.states[self.query.id, name]
            if shape != "scalar" and value in used:
                made = pen.call(unit.helper(frozen.thaw), pen.name(self.frozen_states[name]))
                thawed.append(pen.assign(value, made))
        end: list[ast.stmt] = [ast.Pass(**pen.at)] if single is None else single.end
        around: dict[str, ast.expr | list[ast.stmt]] = {
            "ITEMS": items,
            "LOOP": [self.loop],
            "END": end,
            "LOOK": watch,
            **words,
        }
        text = NOTED if self.form.noted else TOGETHER if together else ONE_BY_ONE
        return [*thawed, *before, *for_state, *written(text, pen, around)]

    # --- elements --------------------------------------------------------------------------------------

    def _chosen(self, items: ast.expr) -> ast.expr:
        """Those elements of which memorize/both_ends.py knows that they lead to the goal in time."""
        pen = self.pen
        nobody = pen.compare(pen.name("choose"), ast.Is(), pen.constant(None))
        state = pen.pack(*map(pen.name, self.frozen_states.values()))
        return pen.either(nobody, items, pen.call("choose", items, state))

    def _items_as_tuples(self) -> ast.expr:
        """The elements; those of `FROM [[A, b], [a, B]]` that are only taken apart and shown are made as tuples."""
        items, target = self.loop.iter, self.loop.target
        if not (isinstance(items, ast.List) and isinstance(target, ast.Name)):
            return items
        if not all(isinstance(item, ast.List) for item in items.elts):
            return items
        uses = apart = 0
        for node in (node for part in self.loop.body for node in ast.walk(part)):
            match node:
                case ast.Name(id=name) if name == target.id:
                    uses += 1
                case ast.Subscript(ast.Name(id=name), ast.Constant(), ast.Load()) | ast.Call(
                    ast.Name(id="tuple"), [ast.Name(id=name)]
                ) if name == target.id:
                    apart += 1
        if uses > apart:
            return items
        made = (ast.Tuple(item.elts, ast.Load(), **self.pen.at) for item in items.elts if isinstance(item, ast.List))
        return self.pen.array(*made)

    def _generate(self, placed: Mapping[int, Sequence[plan.Expr]], guarded: int | None) -> None:
        """Loops over all sources in a generator of its own, whose elements ORDER SIBLINGS BY may sort."""
        unit, pen, outer, siblings = self.unit, self.pen, self.owner, self.search.siblings
        states = sorted(self.body.states)
        generator = Body(unit, unit.local("elements"), [unit.states[state] for state in states], outer)
        generator.states = self.body.states
        generator.count([*read_by_sources(self.query), *(key.expr for key in siblings)])
        innermost = self.loops.open(generator, placed, guarded)
        names = [unit.names[source.id] for source in self.query.sources]
        for known in () if self.form.noted else (self.loops.frozen, unit.keys):
            names += [known[source.id] for source in self.query.sources if source.id in known]
        given = pen.pack(*map(pen.name, names)) if len(names) > 1 else pen.name(*names)
        if siblings:
            given = pen.pack(given, pen.pack(*(expression(self.builder, key.expr, innermost) for key in siblings)))
        innermost.add(pen.run(pen.give(given)))
        innermost.define()
        items = pen.call(generator.name, *map(pen.name, generator.parameters))
        if siblings:
            descending = pen.name(unit.constant(tuple(key.descending for key in siblings), "descending"))
            items = pen.call(unit.helper(in_order), items, descending)
        self.body.loop(names, items, pen)
        self.body.levels.update((source.id, 1) for source in self.query.sources)

    def _look_up(self) -> None:
        """Leaves out elements that STOP WITH and WHERE drop at once: `STOP WITH a != b ...`, `WHERE a == b ...`.

        Without a WHERE, STOP WITH drops them alone. With MEMORIZE they matter, for a step to a known row is not asked
        whether it stops.
        """
        stop = self.search.stop.parts if isinstance(self.search.stop, plan.Or) else (self.search.stop,)
        where = self.query.where.parts if isinstance(self.query.where, plan.And) else (self.query.where,)
        rows = [self.unit.analysis.of(expr) for expr in self.outputs] if self.compares else []
        told = self.edges or self.form.noted or self.form.complete or self.form.watched
        if told or not all(facts.steady and facts.total for facts in rows):
            return
        for part, other in zip(stop, where if self.query.where else stop, strict=False):
            dropped = [] if part is None else lookups(part, self.unit.analysis, "ne")
            if self.query.where and other is not None:
                kept = lookups(other, self.unit.analysis)
                dropped = [one for one in dropped if any(self._is_same(one, same) for same in kept)]
            if not any(map(self.loops.look_up, dropped)):
                return

    def _is_same(self, one: Lookup, other: Lookup) -> bool:
        pairs = ((one.key, other.key), (one.other, other.other))
        keys = [(self.unit.analysis.of(a).key, self.unit.analysis.of(b).key) for a, b in pairs]
        return all(a is not None and a == b for a, b in keys)

    def _accompany(self) -> None:
        """Elements that are read once, and stand in the row as they are, are frozen once; so are keys of arguments."""
        single = None if self.single is None else self.single.key
        shown = {expr.source for expr in self.outputs if isinstance(expr, plan.Element)}
        calls = (node for expr in self.everything for node in walk(expr) if is_remembered(node))
        others = any(self.unit.analysis.of(call).key != single for call in calls)
        keyed = keyed_elements(self.everything) if others else set()
        for source in self.query.sources:
            freezes = source.id in shown and not self.loops.is_scalar(source)
            if freezes or source.id in keyed:
                self.loops.accompany(source, freezes, source.id in keyed)
