"""Calls that a search makes only once need no memory: to ask it and to fill it is a third of what such a step costs.

UNIQUE and MEMORIZE expand no row twice. Where a row is the state after it they expand no state twice either, but for
the start, which a row may be as well. A call of all that makes a state and of the element is then another one in every
step, if the elements are all different and nobody else calls the function. So is the call that gives the elements, as
in `FROM neighbours(node)`.

What such a call gives is checked only where its row is new, see CHECKED in step_clauses.py.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, TypeGuard

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import SCALAR
from ss2sql.language.plan_traversal import find_direct_assignments, list_plan_calls, walk
from ss2sql.language.values import Shape, copy_for_python, is_flat_list_type, thaw_value
from ss2sql.runtime.python.call_code import is_memoized_call
from ss2sql.runtime.python.codegen_context import ExpressionAnalysis
from ss2sql.runtime.python.located_code import AstBuilder
from ss2sql.runtime.python.python_expressions import generate_expression
from ss2sql.runtime.run.calls import NO_KEY, MemoizedCalls, make_call_key
from ss2sql.runtime.run.run_state import Places, Run

if TYPE_CHECKING:
    from ss2sql.runtime.python.codegen_context import PythonScope
    from ss2sql.runtime.python.step_clauses import StepClauses


@dataclass(slots=True)
class SingleCall:
    """A call that makes a state, in a search that makes it once for each state and element.

    Where a `SingleSourceCall` makes the elements, each of which is a state, that writes the call. `begin` is done once
    for a search, `state_statements` once for a state before its elements, `end` at the end.
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
        if step.source_call is not None:
            self.value = codegen.names[source]
            return
        build, at, function = codegen.build_at(self.node.place), codegen.build, self.node.function
        arguments = [self._write_argument(step, *numbered) for numbered in enumerate(self.node.arguments)]
        once, remembered = codegen.new_name(function.name), codegen.new_name(f"{function.name}_remembered")
        count, made, call = codegen.new_name("count"), codegen.new_name("made"), codegen.new_name(function.name)
        places, items = list_plan_calls(step.query)[function.name], step.loops.items[source]
        known = at.express(
            "make(run, function, places, items)",
            make=make_single_call_variants,
            places=codegen.embed(places, "places"),
            function=codegen.embed(function, "function"),
            items=items,
        )
        step.owner.emit(at.unpack([once, remembered, count], known))
        step.owner.locals += [once, remembered, count]
        self.begin += at.write("made = 0", made=made)
        self.end += at.write("count(made)", count=count, made=made)
        # The start may be a row as well, so it may be expanded twice.
        is_start = _generate_start_test(step, at)
        self.state_statements.append(at.assign(call, at.if_else(is_start, at.name(remembered), at.name(once))))
        codegen.page.note_call(self.node.place, function.name)
        # a slow function must not keep a timeout waiting
        inner.emit(*at.write("if run.interrupted or run.bounds.deadline is not None: run.check()"))
        self.value = codegen.new_name(function.name)
        inner.emit(at.add_to(made), build.assign(self.value, build.call(call, *arguments)))
        self._write_early_stop(step)
        inner.known[-1][self.key] = self.value

    def _write_argument(self, step: StepClauses, number: int, argument: plan.Expr) -> ast.expr:
        """An argument as a value that the function may change."""
        value = _generate_argument(step, argument, step.inner, self.state_statements)
        if _is_copied_in_single_call(argument, step) or argument.type.is_only(SCALAR):
            return value
        build, flat = step.codegen.build_at(argument.span), is_flat_list_type(argument.type)
        if flat and number in self.node.function.indexed:
            return value
        return build.call(step.codegen.embed(list.copy, "copy") if flat else step.codegen.use(copy_for_python), value)

    def _write_early_stop(self, step: StepClauses) -> None:
        """`STOP WITH [] == move(this, state)` needs no row: what stops without being a goal leaves no trace."""
        stop, where, build, inner = step.search.stop, step.query.where, step.build, step.inner
        parts = stop.parts if isinstance(stop, plan.Or) else () if stop is None else (stop,)
        if not parts or not any(_is_empty_list(o) for o in self._list_compared(parts[0], step.codegen.analysis)):
            return
        leaves = [build.express("type(value) is list", value=self.value), build.negate(build.name(self.value))]
        if where is not None:
            others = self._list_compared(where, step.codegen.analysis)
            if not any(isinstance(other, (plan.Constant, plan.Variable)) for other in others):
                return
            inner.known.append({self.key: self.value})
            with inner.write_skippable():
                leaves.append(build.negate(generate_expression(step.builder, where, inner)))
            inner.known.pop()
        inner.emit(build.when(build.join_conditions(ast.And(), leaves), build.continue_loop()))

    def _list_compared(self, condition: plan.Expr, analysis: ExpressionAnalysis) -> list[plan.Expr]:
        """What the value of the call is compared with where the condition is such an equality."""
        match condition:
            case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
                return [one for one, other in ((left, right), (right, left)) if analysis.facts(other).key == self.key]
        return []


@dataclass(slots=True)
class SingleSourceCall:
    """A call that gives the elements of the only source, in a search that makes it once for each state.

    `checked`: what it gives is checked as a whole; else each element is, where it is new.
    """

    step: StepClauses
    node: plan.Call
    checked: bool = True
    state_statements: list[ast.stmt] = field(default_factory=list)

    @classmethod
    def find_source_call(cls, step: StepClauses) -> SingleSourceCall | None:
        """The call of a search of which there is one."""
        source = step.query.sources[0]
        calls = _find_single_calls(step.query, step.codegen.analysis)
        return next((cls(step, c) for c in calls if isinstance(source, plan.ValueSource) and c is source.value), None)

    def find_element(self) -> SingleCall | None:
        """The element, where it is a row and the state after it and all have one shape; it is checked then."""
        step, source = self.step, self.step.query.sources[0].id
        shown = [expr for expr in step.outputs if isinstance(expr, plan.Element) and expr.source == source]
        made = [step.shapes[name] for name, expr in step.connect.items() if expr in shown]
        key = step.codegen.analysis.facts(shown[0]).key if shown else None
        if key is None or len(shown) != 1 or len(made) != 1 or made[0] not in ("flat", "nested"):
            return None
        self.checked = False
        return SingleCall(self.node, key, made[0])

    def write_call(self, body: PythonScope) -> ast.expr:
        """The call, which gives the value."""
        step, node = self.step, self.node
        codegen, build = step.codegen, step.codegen.build_at(node.place)
        arguments = [_generate_argument(step, argument, body, self.state_statements) for argument in node.arguments]
        both = build.express(
            "make(run, function, places, fresh, checked)",
            make=make_single_calls,
            places=codegen.embed(list_plan_calls(step.query)[node.function.name], "places"),
            function=codegen.embed(node.function, "function"),
            fresh=all(_is_copied_in_single_call(one, step) or one.type.is_only(SCALAR) for one in node.arguments),
            checked=self.checked,
        )
        codegen.page.note_call(node.place, node.function.name)
        methods = codegen.bind((node.function.name, "single"), f"{node.function.name}_calls", both, build)
        is_start = _generate_start_test(step, build)
        call = build.express("methods[0] if is_start else methods[1]", methods=methods, is_start=is_start)
        return build.call(call, *arguments)


def _generate_start_test(step: StepClauses, build: AstBuilder) -> ast.expr:
    """Whether a state is the start, which a row may be as well, so that it may be expanded twice."""
    if len(step.frozen_states) == 1:
        (only,) = step.frozen_states.values()
        return build.express("only == start[0]", only=only, start=step.form.start)
    state = build.pack(*map(build.name, step.frozen_states.values()))
    return build.express("state == start", state=state, start=step.form.start)


def _is_copied_in_single_call(argument: plan.Expr, step: StepClauses) -> TypeGuard[plan.State]:
    """Whether an argument is a START WITH variable of which its frozen value makes a fresh one at once."""
    if not isinstance(argument, plan.State) or argument.query != step.query.id:
        return False
    return step.shapes[argument.name] in ("flat", "nested")


def _generate_argument(
    step: StepClauses, argument: plan.Expr, body: PythonScope, state_statements: list[ast.stmt]
) -> ast.expr:
    """An argument: a copy of a START WITH variable, by a statement before it, and anything else as it is."""
    if not _is_copied_in_single_call(argument, step):
        return generate_expression(step.builder, argument, body)
    codegen, build, shape = step.codegen, step.build, step.shapes[argument.name]
    value, plain = step.frozen_states[argument.name], codegen.new_name("plain")
    state_statements += build.write("plain = type(value) is tuple", plain=plain, value=value)
    text = "list(map(list, value))" if shape == "nested" else "list(value)"
    text = f"{text} if plain else copy(thaw(value))"
    return build.express(text, plain=plain, value=value, copy=copy_for_python, thaw=thaw_value)


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
        source = query.sources[0]
        of_element = source.id in elements or (isinstance(source, plan.ValueSource) and same[0] is source.value)
        if len(keys) == 1 and None not in keys and moved <= states and of_element:
            yield same[0]


def _do_rows_determine_states(query: plan.Query, search: plan.Search, analysis: ExpressionAnalysis) -> bool:
    """Whether equal rows mean equal states and the other way round."""
    outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
    shown = {analysis.facts(expr).key for expr in outputs}
    at_once = find_direct_assignments(query)  # SELECT sees the state before the step
    alike = shown == {analysis.facts(expr).key for expr in at_once.values()}
    return None not in shown and alike and len(at_once) == len(search.connect)


def make_single_calls(
    run: Run, function: plan.Function, places: Places, fresh: bool, checked: bool
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The function with its memory and without; both with it where somebody else calls it, too, than at `places`."""
    calls: MemoizedCalls = run.host.get_callable(function, run)  # type: ignore[assignment]
    elsewhere = run.call_places.get(function.name, {None}) - places
    return calls.call_any, calls.call_any if elsewhere or calls.foretold else calls.make_single(fresh, checked)


def make_single_call_variants(
    run: Run, function: plan.Function, places: Places, items: Sequence[Any]
) -> tuple[Callable[..., Any], Callable[..., Any], Callable[[int], None]]:
    """The function itself, the function with its memory, and what counts the calls that were made of both.

    Where somebody else calls the function, too, or an element comes twice, all calls go by the memory. `places` is
    where the search calls it; `items` has the elements.
    """
    calls: MemoizedCalls = run.host.get_callable(function, run)  # type: ignore[assignment]

    def call_memoized(*arguments: Any) -> Any:
        return calls.call_any(*arguments)

    def call_recounted(*arguments: Any) -> Any:
        calls.count(-1)  # the memory counts its calls itself
        return call_memoized(*arguments)

    keys = list(map(make_call_key, items))
    elsewhere = run.call_places.get(function.name, {None}) - places
    if elsewhere or calls.foretold or NO_KEY in keys or len(set(keys)) < len(keys):
        return call_memoized, call_memoized, lambda made: None
    return calls.body, call_recounted, calls.count
