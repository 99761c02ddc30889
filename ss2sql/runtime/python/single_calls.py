"""Calls that a search makes only once need no memory: to ask it and to fill it is a third of what such a step costs.

UNIQUE and MEMORIZE expand no row twice. Where a row is the state after it they expand no state twice either, but for
the start, which a row may be as well. A call of all that makes a state and of the element is then another one in every
step, if the elements are all different and nobody else calls the function.

What such a call gives is checked only where its row is new, see CHECKED in step_clauses.py.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import frozen_values, plan
from ss2sql.language.frozen_values import Shape
from ss2sql.language.kinds import SCALAR
from ss2sql.language.plan_traversal import find_direct_assignments, list_call_places, walk
from ss2sql.language.values import copy_for_python
from ss2sql.runtime.python.call_code import is_memoized_call
from ss2sql.runtime.python.call_memo import NO_KEY, MemoizedCalls, make_exact_key
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.python_expressions import write_expression
from ss2sql.runtime.run.run_state import Places, Run

if TYPE_CHECKING:
    from ss2sql.runtime.python.step_clauses import StepClauses


@dataclass(slots=True)
class SingleCall:
    """A call that makes a state, in a search that makes it once for each state and element.

    `begin` is done once for a search, `state_statements` once for a state before its elements, `end` at the end.
    """

    node: plan.Call
    key: int
    shape: Shape
    value: str = ""  # the name of what it gives
    begin: list[ast.stmt] = field(default_factory=list)
    state_statements: list[ast.stmt] = field(default_factory=list)
    end: list[ast.stmt] = field(default_factory=list)

    @classmethod
    def find_single_call(cls, step: StepClauses) -> SingleCall | None:
        """The call of a search of which there is one."""
        source = step.query.sources[0].id
        if source not in step.loops.items or source in step.loops.lookups or source in step.codegen.tuples:
            return None
        analysis = step.codegen.analysis
        for call in _find_single_calls(step.query, analysis):
            key = analysis.facts(call).key
            shown = [expr for expr in step.outputs if analysis.facts(expr).key == key]
            made = [step.shapes[name] for name, expr in step.connect.items() if analysis.facts(expr).key == key]
            if key is not None and len(shown) == len(made) == 1:
                return cls(call, key, made[0])
        return None

    def write_call(self, step: StepClauses) -> None:
        """Writes the call, into `value`."""
        codegen, inner, source = step.codegen, step.inner, step.query.sources[0].id
        build, at, function = codegen.build_at(self.node.place), codegen.build, self.node.function
        arguments = [self._write_argument(step, argument) for argument in self.node.arguments]
        once, remembered = codegen.new_name(function.name), codegen.new_name(f"{function.name}_remembered")
        count, made, call = codegen.new_name("count"), codegen.new_name("made"), codegen.new_name(function.name)
        places = at.name(codegen.embed(list_call_places(step.query)[function.name], "places"))
        known = [at.name("run"), at.name(codegen.embed(function, "function")), places]
        known.append(at.name(step.loops.items[source]))
        known.append(at.constant(source not in step.loops.frozen and source not in codegen.keys))
        step.owner.emit(at.unpack([once, remembered, count], at.call(codegen.use(make_call_variants), *known)))
        step.owner.locals += [once, remembered, count]
        self.begin.append(at.assign(made, at.constant(0)))
        self.end.append(at.run(at.call(count, at.name(made))))
        # The start may be a row as well, so it may be expanded twice.
        state, start = at.pack(*map(at.name, step.frozen_states.values())), at.name(step.form.start)
        if len(step.frozen_states) == 1:
            (only,) = step.frozen_states.values()
            state, start = at.name(only), at.item(start, 0)
        is_start = at.compare(state, ast.Eq(), start)
        self.state_statements.append(at.assign(call, at.if_else(is_start, at.name(remembered), at.name(once))))
        codegen.page.note_call(self.node.place, function.name)
        run = at.name("run")  # a slow function must not keep a timeout waiting
        deadline = at.compare(at.part(at.part(run, "bounds"), "deadline"), ast.IsNot(), at.constant(None))
        ends = at.join_conditions(ast.Or(), [at.part(run, "interrupted"), deadline])
        inner.emit(at.when(ends, at.run(at.call(at.part(run, "check")))))
        self.value = codegen.new_name(function.name)
        inner.emit(at.add_to(made), build.assign(self.value, build.call(call, *arguments)))
        self._write_early_stop(step)
        inner.known[-1][self.key] = self.value

    def _write_argument(self, step: StepClauses, argument: plan.Expr) -> ast.expr:
        """An argument as a value that the function may change."""
        if isinstance(argument, plan.State) and argument.query == step.query.id:
            shape = step.shapes[argument.name]
            if shape != "scalar":
                return self._write_state_copy(step, argument.name, shape)
        build, value = step.codegen.build_at(argument.span), write_expression(step.builder, argument, step.inner)
        if argument.type.is_only(SCALAR):
            return value
        flat = frozen_values.is_flat_list(argument.type)
        return build.call(step.codegen.embed(list.copy, "copy") if flat else step.codegen.use(copy_for_python), value)

    def _write_state_copy(self, step: StepClauses, name: str, shape: Shape) -> ast.expr:
        """A fresh value of a START WITH variable: of its frozen one without a call in Python where it has its shape."""
        codegen, build = step.codegen, step.build
        value = build.name(step.frozen_states[name])
        other = build.call(codegen.use(copy_for_python), build.call(codegen.use(frozen_values.thaw_value), value))
        if shape == "any":
            return other
        plain = codegen.new_name("plain")
        is_tuple = build.compare(build.call("type", value), ast.Is(), build.name("tuple"))
        self.state_statements.append(build.assign(plain, is_tuple))
        copy = build.call("list", build.call("map", build.name("list"), value) if shape == "nested" else value)
        return build.if_else(build.name(plain), copy, other)

    def _write_early_stop(self, step: StepClauses) -> None:
        """`STOP WITH [] == move(this, state)` needs no row: what stops without being a goal leaves no trace."""
        stop, where, build, inner = step.search.stop, step.query.where, step.build, step.inner
        parts = stop.parts if isinstance(stop, plan.Or) else () if stop is None else (stop,)
        if not parts or not any(
            _is_empty_list(other) for other in self._list_compared(parts[0], step.codegen.analysis)
        ):
            return
        value = build.name(self.value)
        is_list = build.compare(build.call("type", value), ast.Is(), build.name("list"))
        leaves = [is_list, build.negate(value)]
        if where is not None:
            others = self._list_compared(where, step.codegen.analysis)
            if not any(isinstance(other, (plan.Constant, plan.Variable)) for other in others):
                return
            inner.known.append({self.key: self.value})
            with inner.write_skippable():
                leaves.append(build.negate(write_expression(step.builder, where, inner)))
            inner.known.pop()
        inner.emit(build.when(build.join_conditions(ast.And(), leaves), build.continue_loop()))

    def _list_compared(self, condition: plan.Expr, analysis: ExpressionAnalysis) -> list[plan.Expr]:
        """What the value of the call is compared with where the condition is such an equality."""
        match condition:
            case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
                return [one for one, other in ((left, right), (right, left)) if analysis.facts(other).key == self.key]
        return []


def _is_empty_list(expr: plan.Expr) -> bool:
    if isinstance(expr, plan.MakeList):
        return not expr.items
    return isinstance(expr, plan.Constant) and expr.value == [] and type(expr.value) is list


def _find_single_calls(query: plan.Query, analysis: ExpressionAnalysis) -> Iterator[plan.Call]:
    """The calls that the search makes once for each state and element."""
    search = query.search
    if (
        search is None
        or not search.plain
        or len(query.sources) != 1
        or analysis.roots[0] is not query
        or analysis.open_world
    ):
        return
    expands_once = search.repeats == "memorize" or (search.repeats == "unique" and search.weight is None)
    if not expands_once or not _do_rows_determine_states(query, search, analysis):
        return
    moved = {name for name, _ in search.connect}
    calls: dict[str, list[plan.Call]] = {}
    for node in walk(query):
        if isinstance(node, plan.Call) and is_memoized_call(node):
            calls.setdefault(node.function.name, []).append(node)
    for same in calls.values():
        keys = {analysis.facts(node).key for node in same}
        states = {part.name for part in same[0].arguments if isinstance(part, plan.State) and part.query == query.id}
        elements = {part.source for part in same[0].arguments if isinstance(part, plan.Element)}
        if len(keys) == 1 and None not in keys and moved <= states and query.sources[0].id in elements:
            yield same[0]


def _do_rows_determine_states(query: plan.Query, search: plan.Search, analysis: ExpressionAnalysis) -> bool:
    """Whether equal rows mean equal states and the other way round."""
    outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
    shown = {analysis.facts(expr).key for expr in outputs}
    at_once = find_direct_assignments(query)  # SELECT sees the state before the step
    alike = shown == {analysis.facts(expr).key for expr in at_once.values()}
    return None not in shown and alike and len(at_once) == len(search.connect)


def make_call_variants(
    run: Run, function: plan.Function, places: Places, items: Sequence[Any], single: bool
) -> tuple[Callable[..., Any], Callable[..., Any], Callable[[int], None]]:
    """The function itself, the function with its memory, and what counts the calls that were made of both.

    Where somebody else calls the function, too, or an element comes twice, all calls go by the memory. `places` is
    where the search calls it; `items` has the elements: `single`, or with what accompanies them.
    """
    calls: MemoizedCalls = run.host.get_callable(function, run)  # type: ignore[assignment]

    def call_memoized(*arguments: Any) -> Any:
        return calls.of_any(*arguments)[0]

    def call_recounted(*arguments: Any) -> Any:
        calls.count(-1)  # the memory counts its calls itself
        return call_memoized(*arguments)

    keys = list(map(make_exact_key, items if single else [item[0] for item in items]))
    elsewhere = run.call_places.get(function.name, {None}) - places
    if elsewhere or calls.foretold or NO_KEY in keys or len(set(keys)) < len(keys):
        return call_memoized, call_memoized, lambda made: None
    return calls.body, call_recounted, calls.count
