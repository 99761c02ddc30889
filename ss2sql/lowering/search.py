"""A search whose steps are evaluated before they enter the queue.

The recursive term evaluates a step while it is made: the guard, STOP WITH and WHERE decide in its WHERE
whether the step enters at all, and what enters carries the state after it. So most steps never wait, and the
state is made once per step instead of once per child. Of the 3,462 steps of the paper's Towers of Hanoi 577 enter.

All steps from a state are evaluated when it is expanded. Where MAXIMUM or LIMIT ends a search, breadth first and by
weight, a goal waits at the head of the queue, as a result only; if it goes on, the second recursive term lets it wait
again at its own place.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import is_flag
from ss2sql.language.plan_traversal import find_direct_assignments, has_query, list_states
from ss2sql.lowering import sql_builder
from ss2sql.lowering.flat import FlatLowering, lower_aggregate_inputs, lower_group_inputs
from ss2sql.lowering.from_clause import add_call_columns, find_element_calls, lower_sources
from ss2sql.lowering.guards import is_evaluated_by
from ss2sql.lowering.recursive_query import RecursiveQuery, shorten_sql_column_name
from ss2sql.lowering.search_step import (
    SearchStep,
    find_step_equalities,
    simplify_by_equalities,
    split_stop_conditions,
)
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import Bookkeeping, StepCounting, choose_free_name
from ss2sql.lowering.sqlite_expressions import SqlScope

MAX_WEIGHT = 2**40  # costs up to here do not add up to 64 bits: 2^23 steps on one path would be needed


class EagerSearch(RecursiveQuery):
    """The terms of the recursion and the query around it.

    The recursive table has these columns where they are needed: `depth`; the total of COST or PROBABILITY; the estimate
    of HEURISTIC; the flags `goal` and `goes_on`; `waits`, 0 for a goal that waits only as a result; `rank`, which sorts
    the queue; the state after the step; parts of the state before it; elements that are not assigned.
    """

    def __init__(self, selects: FlatLowering, query: plan.Query, cut: bool) -> None:
        self.looked_up = [] if "lookup" in selects.needs.disabled else find_step_equalities(query)
        query = simplify_by_equalities(query, self.looked_up)
        super().__init__(selects, query, cut)
        search = self.search
        self.aggregate_inputs = (
            tuple(dict.fromkeys(lower_aggregate_inputs(query))) if query.aggregated else ()
        )  # what aggregates are computed of
        if self.looked_up:
            selects.needs.applied["lookup"] = None
        # Then no goal is ever expanded, for the first one that comes out is the last step that is taken.
        self.one_result = isinstance(search.maximum, plan.Constant) and search.maximum.value == 1
        # A goal that comes out before its turn to be expanded waits as a result first.
        self.ahead = (search.order == "breadth first" and cut) or search.heuristic is not None
        self.shared = find_element_calls(query) if "calls" not in selects.needs.disabled else ()
        self.stops = split_stop_conditions(query)
        self.depth = self._choose_name("depth") if search.order == "depth first" else None
        self.states = {name: self._choose_name(shorten_sql_column_name(name)) for name in self.variables}
        self.at_once = find_direct_assignments(query)
        self.known = self._find_assigned_values()
        self.goal = self._choose_name("goal") if query.where is not None and not self.ahead else None
        self.continues_column = (
            self._choose_name("goes_on") if self.admits_stopping_goals and not self.one_result else None
        )
        self.total = None if self.order.total is None else self._choose_name(self.order.total)
        self.estimate = None if search.heuristic is None else self._choose_name("estimate")
        self.later = None if search.heuristic is None or self.one_result else self._choose_name("estimate_later")
        self.waits = self._choose_name("waits") if self.ahead else None
        self.rank = self._choose_name("rank") if search.heuristic is not None and self.total is not None else None
        self.before = {name: self._choose_name(f"{short}_before") for name, short in self.states.items()}
        self.siblings = [self._choose_name("sibling") for _ in search.siblings]

    def _choose_name(self, name: str) -> str:
        return choose_free_name(name, self.taken)

    @property
    def most(self) -> int:
        """The greatest weight of a step that is not checked."""
        return 1 if self.search.order == "probability" else MAX_WEIGHT

    @property
    def all_results(self) -> bool:
        """Whether every step that enters is a result, so that the results hold the rows of all paths."""
        plain = self.query.where is None and not self.ahead and self.order.total is None and not self.query.aggregated
        return plain and self.search.repeats == "allowed"

    @property
    def steps_unkept(self) -> bool:
        """Whether the result needs no step before the last one, so that steps need only numbers."""
        return not self.query.gives_paths and self.search.repeats == "allowed"

    @property
    def all_go_on(self) -> bool:
        """Whether every step that enters has children."""
        flags = self.cut or self.waits is not None or self.continues_column is not None
        return not flags and (self.search.repeats != "unique" or self.search.order == "breadth first")

    def describe_steps(self) -> Bookkeeping:
        walked = self.selects.needs.walked if self.counts == "product" else {}
        book = Bookkeeping(
            self.counts,
            self.all_go_on,
            self.all_results,
            sources=tuple(walked[source.id] for source in self.query.sources if source.id in walked),
            keyed=self.keyed,
            steps_unkept=self.steps_unkept,
            uncounted_starts=int(self.starts is None and (self.all_go_on or self.has_special_first_steps)),
        )
        if self.arms is None:
            return book
        parts = tuple(len(self.list_parts(output.expr)) for output in self.query.columns)
        return replace(book, arms=len(self.arms.items), parts=parts)

    @property
    def counts(self) -> StepCounting:
        """How the number of generated steps is known, see `SearchState.add_counts`."""
        query = self.query
        if self.shared:
            return "steps"
        # An element that does not meet the condition makes no step, and an index may skip it.
        chosen = self.search.each or self.search.made or self.search.first
        bound = not self.looked_up and all(map(self._is_bound, query.sources)) and not has_query(query)
        if not chosen and (self.arms is not None or bound):
            return "product"
        stops = self.stops
        drops = bool(stops.others) or stops.pruning_condition is not None or self.search.order == "probability"
        return "steps" if drops else "entered"

    def _is_bound(self, source: plan.Source) -> bool:
        """Whether a source is a value that was bound for all states; known when it was opened."""
        bound = source.id in self.selects.needs.walked
        return bound and isinstance(source, plan.ValueSource) and not list_states(source.value)

    @property
    def counted(self) -> bool:
        """Whether each step is counted when it is made; the table of a list with calls counts by itself."""
        return self.counts == "steps" and not self.shared

    # --- what is known of a step when it is taken ------------------------------------------------------

    def _find_assigned_values(self) -> list[tuple[plan.Expr, str]]:
        """What is the state after the step, with the column that holds it."""
        return [
            (expr, self.states[name])
            for name, expr in self.at_once.items()
            if isinstance(expr, plan.Call | plan.If | plan.Element | plan.Column)
            and self.can_assign_when_stopped(name)
            and is_flag(expr.type) == self.flags[name]
        ]

    @property
    def admits_stopping_goals(self) -> bool:
        """Whether a goal that stops may enter."""
        return self.stops.goals is not None

    def can_assign_when_stopped(self, name: str) -> bool:
        """Whether CONNECT BY may assign the variable for each step that enters, also for one that stops."""
        if not self.admits_stopping_goals:
            return True
        if name not in self.at_once:  # it reads what is set before it, whose type is that of states that go on
            return False
        return is_evaluated_by(self.at_once[name], self.query.where, self.search.stop)

    def now(self) -> SqlScope:
        """Reads the step that was taken: its elements, the state before it, and the calls that became columns."""
        before = {(self.query.id, name): self.column(short) for name, short in self.before.items()}
        known = tuple((expr, self.column(short).copy) for expr, short in self.known)
        return replace(self.make_row_scope().with_states(before), known=known)

    # --- the statement ---------------------------------------------------------------------------------

    def build_statement(self) -> exp.Select:
        results = self.select_results()  # which tells what the recursive table has to carry
        read = {column.name for column in results.find_all(exp.Column)}
        self.before = {name: short for name, short in self.before.items() if short in read}
        labels = set(self.selects.needs.labels)
        start = SqlScope().with_states(self.lower_start())
        # First steps of their own are those under another condition, or from one of several starts.
        terms = self.write_steps(start, True) if self.has_special_first_steps else [self.write_start_row(start)]
        self.selects.needs.labels = labels
        after = {(self.query.id, name): self.column(short) for name, short in self.states.items()}
        terms += self.write_steps(SqlScope().with_states(after), False)
        if self.ahead and not self.one_result:
            terms.append(self.requeue_goals())
        return self.build_recursive_query(self.all_column_names, terms, self.list_queue_keys(), results)

    def write_start_row(self, scope: SqlScope) -> exp.Select:
        """The state of START WITH as row 0; its children are the first steps."""
        known: dict[str | None, Node] = {"step": sql_builder.number(0), "parent": sql_builder.number(0)}
        known |= dict.fromkeys((self.depth, self.goal, self.estimate, self.rank), sql_builder.number(0))
        known |= dict.fromkeys((self.continues_column, self.waits), sql_builder.number(1))
        known[self.total] = sql_builder.number(1 if self.search.order == "probability" else 0)
        for name, short_name in self.states.items():
            known[short_name] = scope.states[(self.query.id, name)]
        outputs = [known.get(name, sql_builder.null()).copy() for name in self.all_column_names]
        return sql_builder.select(outputs, [], self.write_visit(scope))

    @property
    def all_column_names(self) -> list[str]:
        """The columns in the language's order of evaluation, because the first that fails is reported."""
        made = (
            self.depth,
            self.goal,
            self.continues_column,
            self.total,
            self.estimate,
            self.later,
            self.waits,
            self.rank,
        )
        names = ["step", "parent", *(name for name in made if name is not None), *self.siblings]
        return [*names, *self.states.values(), *self.before.values(), *(name for name, _ in self.reads)]

    def list_queue_keys(self) -> Iterable[tuple[str, bool]]:
        if self.rank is not None or self.waits is not None:
            return [(name, False) for name in (self.rank or self.waits, self.estimate, "step") if name is not None]
        # There are siblings depth first, where steps of one depth that wait have one parent.
        keys = [(name, key.descending) for name, key in zip(self.siblings, self.search.siblings, strict=True)]
        return (*self.order.queue[:1], *keys, *self.order.queue[1:])

    def group_results(self, results: exp.Select, names: list[str | None]) -> exp.Select:
        """The groups of the results; the limit keeps SQLite from asking for them twice."""
        results = sql_builder.sort_query(results, (), sql_builder.build_sql_no_limit())
        return self.selects.group_numbered_rows(self.query, results, self.aggregate_inputs, SqlScope(), names)

    # --- the recursive terms ---------------------------------------------------------------------------

    def write_steps(self, scope: SqlScope, first: bool) -> list[exp.Select]:
        """The steps from START WITH, or those from a step that goes on."""
        if self.arms is not None:
            return [self._lower_branch(item, scope, first, item is self.arms.items[0]) for item in self.arms.items]
        opened, scope = lower_sources(self.selects, self.query.sources, scope, self.query.id)
        sources = [item for part in opened for item in part.items]
        conditions = [condition for part in opened for condition in part.conditions]
        witness = (opened[-1].order or (opened[-1].witness_column,))[-1]  # row numbers cost nothing, elements are made
        if self.shared:
            sources[-1], scope = add_call_columns(self.selects, self.query, self.shared, sources[-1], scope)
        items: list[Node] = [sql_builder.table(self.table, self.table)]
        if first:
            items = [] if self.starts is None else [self.starts]
        step = SearchStep(self, scope, first)
        conditions += step.list_lookups()
        sources = self.order_items(sources, conditions)
        entering = [self._evaluate_for_each_step(node, witness) for node in step.lower_entering()]
        if self.counted:
            entering.insert(0, sql_builder.call("count_step", witness.copy()))
        conditions += self.keep_rows_in_order(sources, conditions)
        where = [*([] if first else self.check_parent_continues()), *conditions, *entering]
        return [sql_builder.select(step.lower_columns(), items + sources, sql_builder.conjunction(where))]

    def _lower_branch(self, item: plan.Expr, scope: SqlScope, first: bool, expands: bool) -> exp.Select:
        """The step with one item of the list from a state, which the first of the items `expands`."""
        assert self.arms is not None
        self.selects.needs.applied["arms"] = None
        inner = scope.with_source(self.arms.source.id, self.arms.make_reader(self.expressions, item, scope))
        step = SearchStep(self, inner, first, item)
        entering = step.lower_entering()
        if self.counted:
            entering = entering if first else [self.evaluate_for_each_row(node, step.parent) for node in entering]
            entering.insert(0, sql_builder.call("count_step", step.parent.copy()))
        where = [*([] if first else self.check_parent_continues(expands)), *step.list_lookups(), *entering]
        return sql_builder.select(
            step.lower_columns(),
            [] if first else [sql_builder.table(self.table, self.table)],
            sql_builder.conjunction(where),
        )

    def carry_element(self, node: plan.Element | plan.Column) -> str:
        """The column of what is read of an element, possibly that of a variable to which CONNECT BY assigns it."""
        known = next((name for expr, name in self.known if expr == node), None)
        return known or super().carry_element(node)

    def _evaluate_for_each_step(self, node: Node, witness: Node) -> Node:
        """A condition on entering, evaluated for every step where it may change from step to step."""
        changing = any(call.name in ("reached", "improves") for call in node.find_all(exp.Anonymous))
        return self.evaluate_for_each_row(node, witness) if changing or self.counted else node

    def check_parent_continues(self, expands: bool = True) -> list[Node]:
        """What is evaluated for the step that was taken, before its children; one SELECT counts that it expands."""
        if self.all_go_on:
            return []
        tests = [self.column(name) for name in (self.waits, self.continues_column) if name is not None]
        still = self.check_still_best()
        if not expands or (self.total is not None and still):  # which counts the steps that go on
            return [*tests, *still]
        counted: Node = sql_builder.call("expand", *self.estimate_total())
        return [
            *tests,
            sql_builder.case([(exp.Not(this=still[0]), sql_builder.number(0))], counted) if still else counted,
        ]

    def check_still_best(self) -> list[Node]:
        """Whether the step that was taken is still the best one to its row."""
        if self.search.repeats != "unique":
            return []
        if self.total is not None:
            total = self.rank_total(self.column(self.total))
            return [sql_builder.call("still_best", self.column("step"), total, *self.estimate_total())]
        if self.search.order == "depth first":
            return [sql_builder.call("arrive", self.column("step"))]
        return []

    def estimate_total(self) -> list[Node]:
        """The total that A* expects of paths through the step that was taken."""
        return [] if self.rank is None else [self.column(self.rank)]

    def rank_total(self, total: Node) -> Node:
        """A total as a number that sorts better totals first."""
        return exp.Neg(this=sql_builder.wrap_operand(total)) if self.search.order == "probability" else total

    def requeue_goals(self) -> exp.Select:
        """Lets a goal that was taken as a result wait again, to be expanded at its own place."""
        assert self.waits is not None
        changed: dict[str, Node] = {self.waits: sql_builder.number(1)}
        if self.estimate is not None and self.later is not None:
            changed[self.estimate] = self.column(self.later)
        if self.rank is not None and self.total is not None and self.later is not None:
            changed[self.rank] = sql_builder.binary(exp.Add, self.column(self.total), self.column(self.later))
        outputs = [changed.get(name, self.column(name)) for name in self.all_column_names]
        where: list[Node] = [exp.Not(this=self.column(self.waits))]
        if self.continues_column is not None:
            where.append(self.column(self.continues_column))
        return sql_builder.select(outputs, [sql_builder.table(self.table, self.table)], sql_builder.conjunction(where))

    # --- results ---------------------------------------------------------------------------------------

    def select_results(self) -> exp.Select:
        """The final SELECT, which picks the goals from the rows of `search`."""
        now = self.now()
        query = self.query
        shown: list[Node] = [self.column("step"), self.column("parent")] if query.gives_paths else []
        if query.aggregated:
            number = sql_builder.call("next_position")
            shown += lower_group_inputs(self.selects, self.aggregate_inputs, query.group, now, number)
        else:
            shown += [self.expressions.lower_expr(output.expr, now) for output in query.columns]
            shown += [self.expressions.lower_expr(key, now) for key in query.group]
            shown += [self.expressions.lower_expr(key.expr, now) for key in query.order]
        tests: list[Node] = []
        if self.goal is not None:
            tests.append(self.column(self.goal))
        elif self.waits is not None:
            tests.append(exp.Not(this=self.column(self.waits)))
        elif not self.has_special_first_steps:
            tests.append(sql_builder.binary(exp.GT, self.column("step"), sql_builder.number(0)))
        still = self.check_still_best()
        if self.search.repeats == "unique" and self.total is not None:
            still = [sql_builder.call("give_once", self.column("step"), self.rank_total(self.column(self.total)))]
        elif self.rank is not None:
            still = [sql_builder.call("give", self.column(self.rank))]
        goal = sql_builder.conjunction(tests)
        if goal is not None and still:
            # The repeat test is evaluated last, for it notes the row.
            tests, still = [], [sql_builder.case([(goal, still[0])], sql_builder.number(0))]
        tests += still
        table = sql_builder.table(self.table, self.table)
        maximum = self.search.maximum
        limit = None if maximum is None else self.selects.needs.bind_count(maximum, "maximum")
        return sql_builder.select(shown, [table], sql_builder.conjunction(tests), limit=limit)
