"""Compiling queries and statements to Python, and what the rest of ss2sql sees of them.

A query becomes a function that finds its results (flat_query.py, search_compiler.py), functions for what stands around
them (LIMIT and its kin, groups, the arguments of AS), and a `QueryExecution` that puts them together when a run begins.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.cancellation import deepen_stack
from ss2sql.language.kinds import ANY, SCALAR, Kind, Type
from ss2sql.language.plan_traversal import has_array_calls, has_constant_source, may_run_foreign_code, walk
from ss2sql.language.rows import Rows, make_label
from ss2sql.language.values import format_value
from ss2sql.runtime.python import flat_query
from ss2sql.runtime.python.call_code import SELF_KEYED_KINDS, CallStages
from ss2sql.runtime.python.codegen_context import (
    COUNTERS,
    CodegenContext,
    ExpressionAnalysis,
    ExpressionFacts,
    PythonScope,
)
from ss2sql.runtime.python.located_code import AstBuilder, locate_in_script
from ss2sql.runtime.python.python_expressions import generate_expression, get_group_key
from ss2sql.runtime.python.query_execution import QueryExecution, get_value_function
from ss2sql.runtime.run.calls import make_call_key, report_memo_counts
from ss2sql.runtime.run.post_processing import QueryForm, find_certain_aggregates, find_grouped_aggregates
from ss2sql.runtime.run.run_state import Run, check_count_value, keep_bounded

if TYPE_CHECKING:
    from ss2sql.language.values import FrozenShapes
    from ss2sql.runtime.search.search_run import FindPaths
    from ss2sql.runtime.search.step_contract import Expand


# --- compiles the queries of a statement, each with the queries and the texts given to `eval` inside of it
MAX_EVAL_DEPTH = 30


@dataclass(frozen=True, slots=True)
class EvalScope:
    """What one `eval` sees.

    `scope` belongs to the resolver. `sources` are numbers of sources with the columns of tuples, the types of elements
    and the tables of worlds (see CodegenContext), `states` START WITH variables; texts take values in this order.
    """

    scope: Any
    sources: tuple[tuple[int, tuple[str, ...] | None, Type | None, Any], ...]
    states: tuple[tuple[int, str], ...]
    dispatch: Callable[[plan.Query], Callable[[Run], Any]] | None


class EvalCache(dict[str, Callable[..., Any]]):
    """The compiled texts of one `eval` in one run; asking for a new one compiles it."""

    def __init__(self, run: Run, name_scope: EvalScope) -> None:
        super().__init__()
        self.run = run
        self.name_scope = name_scope

    def __getitem__(self, text: Any) -> Callable[..., Any]:
        if type(text) is not str:  # a list could not even be looked up
            raise ExecutionError("X007", f"eval reads a text, not {format_value(text)}", hints=("put it into quotes",))
        return super().__getitem__(text)

    def __missing__(self, text: str) -> Callable[..., Any]:
        statements = self.run.host.resolve_text(text, self.name_scope.scope)
        function = self[text] = limit_eval_depth(self.run, compile_statements(statements, self.name_scope)(self.run))
        return function


def limit_eval_depth(run: Run, text: Callable[..., Any]) -> Callable[..., Any]:
    """A text that counts how deep it stands inside of others; one that reads itself would never end.

    So many levels fit into the stack, also where SQLite calls each of them.
    """

    def count_depth(*values: Any) -> Any:
        if run.texts == MAX_EVAL_DEPTH:
            hint = "let the text end: IF(condition; eval(text); value)"
            raise ExecutionError("X016", f"eval is nested more than {MAX_EVAL_DEPTH} deep", hints=(hint,))
        run.texts += 1
        try:
            with deepen_stack(run.texts):
                return text(*values)
        finally:
            run.texts -= 1

    return count_depth


def compile_statements(statements: tuple[plan.Expr, ...], name_scope: EvalScope) -> Callable[[Run], Callable[..., Any]]:
    """The function that binds a text to a run; the bound text gives the value of its last statement."""
    analysis = ExpressionAnalysis(statements, open_world=True)
    with deepen_stack(analysis.levels):
        codegen = CodegenContext(statements[0].span, analysis)
        builder = QueryCompiler(codegen, name_scope.dispatch)
        body = PythonScope(codegen, codegen.new_name("text"), [], codegen.root)
        for source, columns, kind, table in name_scope.sources:
            name = codegen.names[source] = codegen.new_name("element")
            body.parameters.append(name)
            body.levels[source] = 0
            if columns is not None:
                codegen.tuples[source] = columns
            if table is not None:
                codegen.worlds[source] = table
            codegen.elements[source] = kind or ANY
        for state in name_scope.states:
            name = codegen.states[state] = codegen.new_name(state[1])
            body.parameters.append(name)
            body.states.add(state)
        for statement in statements[:-1]:
            build = codegen.build_at(statement.span)
            body.emit(build.run(generate_expression(builder, statement, body)))
        build = codegen.build_at(statements[-1].span)
        body.emit(build.return_(generate_expression(builder, statements[-1], body)))
        body.define_function()
        return codegen.compile_module(codegen.build_module(build.name(body.name)))


# --- compiles the queries of a statement, each with the queries inside of it
# What a search has counted goes to the run: before the meter may end it, so that nothing counts twice.
HAND_ON = """
counts = generated, expanded, pruned
generated = expanded = pruned = 0
meter(*counts)
"""
Dispatch = Callable[[plan.Query], Callable[[Run], Any]]


@dataclass(frozen=True, slots=True)
class CompiledSubquery:
    """A compiled query as the code around it uses it: names of functions, and the outer values that they take.

    `found` gives the rows of a query after which nothing follows when they were found.
    """

    task: str
    value: str
    tuples: str
    found: str | None
    arguments: list[ast.expr]


class QueryCompiler:
    """Compiles into one CodegenContext. With `dispatch` the queries are somebody else's, see `compile_statement`."""

    def __init__(self, codegen: CodegenContext, dispatch: Dispatch | None = None) -> None:
        self.codegen = codegen
        self.dispatch = dispatch

    # --- queries and texts inside of expressions -------------------------------------------------------

    def write_subquery(self, node: plan.Subquery, body: PythonScope) -> ast.expr:
        """The value of a query in an expression."""
        codegen, build = self.codegen, self.codegen.build_at(node.span)
        if self.dispatch is not None:
            return build.call(codegen.embed(self.dispatch(node.query), "query"), build.name("run"))
        nested = self.compile_query(node.query, body)
        call = build.call(nested.value, *nested.arguments)
        facts = codegen.analysis.facts(node)
        return body.compute_once(facts, call, build, "value") if facts.steady else call

    def write_reduction(self, node: plan.Call, body: PythonScope) -> ast.expr | None:
        """A value that a built-in function makes of the rows of a query, once for equal values of the rows around it.

        None for any other call, and where what the query reads of them may be objects, which have no exact keys.
        """
        codegen, facts = self.codegen, self.codegen.analysis.facts(node)
        match node.arguments:
            case (plan.Subquery(query=query) as inner,) if facts.steady and node.type.is_only(SCALAR):
                read = [part for part in walk(inner) if _reads_outer_loop(part, body)]
            case _:
                return None
        if self.dispatch is not None or facts.groups or not (read and has_constant_source(query)):
            return None
        if any(part.type.may_be(Kind.OBJECT) for part in read):
            return None
        build = codegen.build_at(node.span)
        codegen.page.note_call(node.place, node.function.name)
        keys = [generate_expression(self, part, body) for part in dict.fromkeys(read)]
        keys = [
            key if part.type.is_only(SELF_KEYED_KINDS) else build.call(codegen.use(make_call_key), key)
            for key, part in zip(keys, dict.fromkeys(read), strict=True)
        ]
        memo = codegen.bind(("reduction", id(node)), "reduced", build.record((), ()), build)
        key, found = codegen.new_name("key"), codegen.new_name("found")
        with body.write_skippable():
            value = build.call(codegen.name_function(node.function, build), generate_expression(self, inner, body))
        return build.express(
            "found if (found := memo.get((key := keys), UNSET)) is not UNSET else memoize(memo, key, value)",
            memoize=keep_bounded,
            memo=memo,
            key=key,
            keys=keys[0] if len(keys) == 1 else build.pack(*keys),
            found=found,
            value=value,
        )

    def write_eval(self, node: plan.Eval, body: PythonScope) -> ast.expr:
        """The value of a text that is compiled when it is met."""
        codegen, build = self.codegen, self.codegen.build_at(node.span)
        codegen.page.note_eval(node.span)
        sources = tuple(source for source in node.sources if body.is_source_visible(source))
        states = tuple(state for state in node.states if body.is_state_visible(state))
        kept = ((source, codegen.tuples.get(source), codegen.elements.get(source)) for source in sources)
        eval_scope = EvalScope(
            node.scope, tuple((*known, codegen.worlds.get(known[0])) for known in kept), states, self.dispatch
        )
        made = build.express("cache(run, scope)", cache=EvalCache, scope=codegen.embed(eval_scope, "eval_scope"))
        texts = codegen.bind(("texts", id(node)), "texts", made, build)
        function = build.item(build.name(texts), generate_expression(self, node.text, body))
        return build.call(function, *self._list_outer_values(sources, states, body, build))

    def get_source_facts(self, source: plan.Source) -> ExpressionFacts:
        """What the reading of a source depends on."""
        match source:
            case plan.ValueSource(value=value):
                return replace(self.codegen.analysis.facts(value), key=None)
            case plan.QuerySource(query=query):
                return replace(self.codegen.analysis.facts(query), key=None, total=False)
            case plan.TableSource():
                return ExpressionFacts(total=False)
            case plan.WorldSource(arguments=arguments):
                facts = [self.codegen.analysis.facts(argument) for argument in arguments]
                return ExpressionFacts(
                    frozenset().union(*(one.sources for one in facts)),
                    frozenset().union(*(one.states for one in facts)),
                    steady=all(one.steady for one in facts),
                    total=all(one.total for one in facts),
                )

    def _list_outer_values(
        self, sources: Sequence[int], states: Sequence[tuple[int, str]], body: PythonScope, build: AstBuilder
    ) -> list[ast.expr]:
        codegen = self.codegen
        values = [build.name(codegen.names[source]) for source in sources]
        return values + [build.name(body.moved.get(state) or codegen.states[state]) for state in states]

    # --- queries ---------------------------------------------------------------------------------------

    def compile_query(self, query: plan.Query, caller: PythonScope) -> CompiledSubquery:
        """Compiles a query that is used in `caller`."""
        codegen = self.codegen
        facts = codegen.analysis.facts(query)
        sources = [source for source in sorted(facts.sources) if caller.is_source_visible(source)]
        states = [state for state in sorted(facts.states) if caller.is_state_visible(state)]
        groups = {key: name for key, name in caller.list_visible_groups.items() if key[0] in facts.groups}
        build = codegen.build_at(query.span)

        def open_part(name: str) -> PythonScope:
            """A function of the query; it takes what the query reads of the queries around it."""
            names = [*(codegen.names[s] for s in sources), *(codegen.states[s] for s in states), *groups.values()]
            body = PythonScope(codegen, codegen.new_name(name), names, codegen.root)
            body.levels = dict.fromkeys(sources, 0)
            body.states, body.groups = set(states), dict(groups)
            return body

        own, searched = find_grouped_aggregates(query), None
        guarded = [node.argument for node in own if node not in find_certain_aggregates(query)]
        codegen.guarded_arguments.update(id(expr) for expr in guarded if not codegen.analysis.facts(expr).total)
        if query.search is None:
            finder = flat_query.compile_flat_query(self, query, open_part("rows"), own)
        else:
            from ss2sql.runtime.python import search_compiler

            finder, searched = search_compiler.compile_search(self, query, open_part("rows"), own)
        functions = {
            "settings": self._write_settings(query, open_part),
            "find": finder,
            "group": self._write_group(query, open_part),
            "arguments": self._write_arguments(query, open_part),
            "flush": self._write_flush() if query.search else None,
            "row_order": codegen.row_orders.get(query.id),
        }
        find = codegen.find if query is codegen.level_searched_query else None
        form = build.name(codegen.embed(QueryForm.for_query(query, tuple(own), searched, find), "form"))
        parts = [build.constant(None) if name is None else build.name(name) for name in functions.values()]
        task, value, tuples = codegen.new_name("task"), codegen.new_name("value_of"), codegen.new_name("rows_of")
        codegen.definitions += [
            build.assign(task, build.call(codegen.use(QueryExecution), build.name("run"), form, *parts)),
            *build.write("value = get(task)", value=value, get=get_value_function, task=task),
            *build.write("tuples = task.compute_tuples", tuples=tuples, task=task),
        ]
        outer = self._list_outer_values(sources, states, caller, build) + [build.name(name) for name in groups.values()]
        ends = query.search or query.grouped or query.order or functions["settings"]
        return CompiledSubquery(task, value, tuples, None if ends else functions["find"], outer)

    def _write_flush(self) -> str:
        """A function that hands on what searches have counted."""
        codegen = self.codegen
        body = PythonScope(codegen, codegen.new_name("flush"), [], codegen.root)
        for name in COUNTERS:
            codegen.name_counter(name, body)
        body.emit(*codegen.build.write(HAND_ON, meter=codegen.read_step_meter()))
        body.define_function()
        return body.name

    def _write_settings(self, query: plan.Query, part: Callable[[str], PythonScope]) -> str | None:
        """A function that gives LIMIT, OFFSET, MAXIMUM and MEMORIZE's bound, and the names of the columns."""
        search = query.search
        counts = [(query.limit, 0, "LIMIT"), (query.offset, 0, "OFFSET")]
        counts.append((search.maximum if search else None, 1, "MAXIMUM"))
        counts.append((search.bound if search else None, 1, "MEMORIZE"))
        labelled = any(output.label for output in query.columns)
        if not labelled and not any(expr for expr, _, _ in counts):
            return None
        body = part("settings")
        values = [self._write_count(expr, least, word, body) for expr, least, word in counts]
        build = self.codegen.build_at(query.span)
        labels = [
            build.constant(output.name) if output.label is None else self._write_label(output.label, body)
            for output in query.columns
        ]
        body.emit(build.return_(build.pack(*values, build.pack(*labels) if labelled else build.constant(None))))
        body.define_function()
        return body.name

    def _write_count(self, expr: plan.Expr | None, least: int, word: str, body: PythonScope) -> ast.expr:
        if expr is None:
            return self.codegen.build.constant(None)
        build, value = self.codegen.build_at(expr.span), generate_expression(self, expr, body)
        return build.call(self.codegen.use(check_count_value), value, build.constant(least), build.constant(word))

    def _write_label(self, expr: plan.Expr, body: PythonScope) -> ast.expr:
        value = generate_expression(self, expr, body)
        return self.codegen.build_at(expr.span).express("label(value)", label=make_label, value=value)

    def _write_group(self, query: plan.Query, part: Callable[[str], PythonScope]) -> str | None:
        """A generator: the row and sort keys of each group that HAVING keeps; of partitions whether it keeps them."""
        if not query.aggregated and not (query.group and query.having):
            return None
        codegen, build = self.codegen, self.codegen.build_at(query.span)
        body = part("group")
        names = {get_group_key(node): codegen.new_name(node.function) for node in find_grouped_aggregates(query)}
        names.update({(query.id, index): codegen.new_name("key") for index in range(len(query.group))})
        body.groups.update(names)
        groups, group = codegen.new_name("groups"), codegen.new_name("group")
        body.parameters.append(groups)
        outputs = [output.expr for output in query.columns] if query.aggregated else []
        keys = [key.expr for key in query.order] if query.aggregated else []
        having = [] if query.having is None else [query.having]
        body.count_uses([*having, *outputs, *keys])
        stages = CallStages(self, body)
        staged = has_array_calls(*having, *outputs, *keys) and codegen.analysis.are_steady([*having, *outputs, *keys])
        body.open_loop([group], build.name(groups), build)
        body.emit(build.unpack(list(names.values()), build.name(group)))
        body.locals.extend(names.values())
        body.group_level = 1
        for condition in having:
            body = stages.add_calls(body, having) if staged else body
            kept = generate_expression(self, condition, body)
            if query.aggregated:
                body.emit(codegen.build_at(condition.span).if_not(kept, build.continue_loop()))
            else:
                body.emit(build.run(build.yield_(kept)))
        if query.aggregated:
            body = stages.add_calls(body, [*outputs, *keys]) if staged else body
            row, key_values = flat_query.generate_row_and_keys(self, query, outputs, keys, body)
            body.emit(build.run(build.yield_(build.pack(build.pack(*row), build.pack(*key_values)))))
        body.define_function()
        return stages.join_stages()

    def _write_arguments(self, query: plan.Query, part: Callable[[str], PythonScope]) -> str | None:
        representation = query.representation
        if not representation.arguments and not representation.named:
            return None
        body = part("arguments")
        build = self.codegen.build_at(query.span)
        positional = build.pack(*(generate_expression(self, expr, body) for expr in representation.arguments))
        names = tuple(name for name, _ in representation.named)
        named = build.record(names, tuple(generate_expression(self, expr, body) for _, expr in representation.named))
        body.emit(build.return_(build.pack(positional, named)))
        body.define_function()
        return body.name


def _reads_outer_loop(part: Any, body: PythonScope) -> bool:
    match part:
        case plan.Element(source=source) | plan.Column(source=source):
            return body.is_source_visible(source)
        case plan.State(query=query, name=name):
            return body.is_state_visible((query, name))
        case _:
            return False


# --- what the rest of ss2sql sees of the native executor: compiled queries and compiled statements
class NativeQuery:
    """A query that stands by itself, compiled to Python once, to be run many times.

    A search that is `watched` goes step by step, and `run.trace` hears of it. `find` finds its results in place of a
    loop. `levels` says how deeply its expressions are nested.
    """

    engine = "native"

    def __init__(self, query: plan.Query, find: FindPaths | None = None, watched: bool = False) -> None:
        self.query = query
        analysis = ExpressionAnalysis((query,))
        self.levels = analysis.levels
        self._runs_foreign_code = may_run_foreign_code(query)
        with deepen_stack(self.levels):
            codegen = CodegenContext(query.span, analysis)
            codegen.watched = query if watched else None
            codegen.level_searched_query, codegen.find = query, find
            nested = QueryCompiler(codegen).compile_query(query, codegen.root)
            self._module = codegen.build_module(codegen.build.name(nested.task))
            self._bound = codegen.compile_module(self._module)

    @property
    def generated_code(self) -> str:
        with deepen_stack(2 * self.levels):
            return ast.unparse(ast.fix_missing_locations(self._module))

    def compute_rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query.

        Args:
            run: the run that it belongs to.
            sink: is filled while the query runs, so that what was found by then outlives an error; it is
                then also the result.

        Raises:
            Error: with the place in the script. Exceptions of the user's functions pass with a note.
        """
        return self._run_with_location(  # type: ignore[no-any-return]
            run, lambda: self._bound(run).compute_rows(sink=sink, outermost=True)
        )

    def compute_value(self, run: Run) -> Any:
        """The value that the query's representation makes of its answer; raises what `compute_rows` raises."""

        def compute_shaped() -> Any:
            task = self._bound(run)
            return task.shape_rows(task.compute_rows(outermost=True))

        return self._run_with_location(run, compute_shaped)

    def make_step_function(self, run: Run) -> tuple[Expand, FrozenShapes, Callable[[], None]]:
        """The step function of a search with `find`, how its values are frozen, and what updates `run.stats`."""
        with deepen_stack(self.levels):
            task = self._bound(run)
            _, expand, *_ = task.find()
        return expand, task.form.search.shapes, task.flush

    def _run_with_location(self, run: Run, work: Callable[[], Any]) -> Any:
        try:
            with nullcontext() if self._runs_foreign_code else run.pause_collector():
                return run_located(work, run, self.levels)
        except Error as error:
            error.with_span(self.query.span)
            raise


def compile_statement(expr: plan.Expr, dispatch: Dispatch | None = None) -> Callable[[Run], Any]:
    """A statement as a function of the run.

    Args:
        expr: the statement's expression.
        dispatch: is called once for every query that is not inside of another one, and gives the function that
            runs it and has its value; without it queries run natively.

    Returns:
        The function; it raises as `NativeQuery.compute_rows` does.
    """
    if isinstance(expr, plan.Constant):
        return lambda run: expr.value
    analysis = ExpressionAnalysis((expr,), open_world=True, inside=False)
    with deepen_stack(analysis.levels):
        codegen = CodegenContext(expr.span, analysis)
        builder = QueryCompiler(codegen, dispatch or (lambda query: NativeQuery(query).compute_value))
        bound = codegen.compile_module(codegen.build_module(generate_expression(builder, expr, codegen.root)))

    return lambda run: run_located(lambda: bound(run), run, analysis.levels)


def run_located(work: Callable[[], Any], run: Run, levels: int) -> Any:
    """Runs generated code that is nested so deeply; what it raises gets its place in the script."""
    try:
        with deepen_stack(levels):
            return work()
    except Exception as error:
        other = locate_in_script(error)
        if other is error:
            raise
        raise other from None
    finally:
        report_memo_counts(run)
