"""A search whose steps are evaluated when they are taken from the queue, exactly in the order of the search.

The recursive table holds a step's number, its parent's, its depth, the elements, and the state before it. The
outer query asks whether the step is a goal, and then the recursive term whether it goes on; so a search that
is cut off has evaluated nothing ahead. The price: what leads nowhere waits in the queue like everything else,
and every clause makes its own calls, though the memo answers all but the first.
"""

from __future__ import annotations

from sqlglot import exp

from ss2sql import plan
from ss2sql.lowering import sql
from ss2sql.lowering.expressions import Env, can_fail
from ss2sql.lowering.parameters import Bookkeeping
from ss2sql.lowering.search import SearchLowering, element_reads
from ss2sql.lowering.select import Selects
from ss2sql.lowering.sql import Node, free_name


class WhenTaken(SearchLowering):
    """The two terms of the recursion and the query around it."""

    def __init__(self, selects: Selects, query: plan.Query, cut: bool) -> None:
        super().__init__(selects, query, cut)
        self.taken.add("depth")
        self.states = {name: free_name(name, self.taken) for name in self.variables}
        places = [query.where, self.search.stop, *(output.expr for output in query.columns)]
        places += [expr for _, expr in self.search.connect] + list(query.group) + [key.expr for key in query.order]
        for node in element_reads(query, places):
            self.carry(node)
        self.next_states: list[Node] = []

    def statement(self) -> exp.Select:
        labels = set(self.selects.needs.labels)
        first = self.children(Env().with_states(self.start()), sql.number(0), sql.number(1), [], None)
        # The two terms do not see each other, so their sources may have the same names.
        self.selects.needs.labels = labels
        others = self.recursive()
        names = ["step", "parent", "depth", *(name for name, _ in self.reads), *self.states.values()]
        return self.recursive_query(names, [first, others], self.results())

    def bookkeeping(self) -> Bookkeeping:
        return Bookkeeping(by_turns=True)

    def env(self) -> Env:
        """Reads elements and state from a row of the recursive table."""
        own = self.query.id
        return self.reading().with_states({(own, name): self.column(short) for name, short in self.states.items()})

    def recursive(self) -> exp.Select:
        """The children of a step that goes on."""
        parent = self.env()
        following = self.following(parent)
        self.next_states = [following[(self.query.id, name)] for name in self.variables]
        depth = sql.binary(exp.Add, self.column("depth"), sql.number(1))
        table = sql.table(self.table, self.table)
        return self.children(Env().with_states(following), self.column("step"), depth, [table], self.goes_on(parent))

    def children(self, env: Env, parent: Node, depth: Node, items: list[Node], where: Node | None) -> exp.Select:
        sources, conditions, env, _ = self.open(env)
        sources = self.arranged(sources, conditions)
        number = sql.call("next_step", *self.positions_of(sources, conditions))
        outputs: list[Node] = [number, parent, depth]
        outputs += [self.expressions.lower(node, env) for _, node in self.reads]
        outputs += [env.states[(self.query.id, name)].copy() for name in self.states]
        conditions = [where, *conditions] if where is not None else conditions
        return sql.select(outputs, items + sources, sql.conjunction(conditions))

    # --- what is asked of a step -----------------------------------------------------------------------

    def row(self, env: Env) -> list[Node]:
        """The step's row as values."""
        return [self.expressions.value(output.expr, env) for output in self.query.columns]

    def guarded(self, env: Env, branches: list[tuple[Node, Node]], default: Node) -> Node:
        """A CASE that first drops a step whose row was met before."""
        if self.guard.met is not None:
            met = sql.call(self.guard.met, *self.numbers(), *self.row(env))
            branches = [(met, sql.number(0)), *branches]
        return sql.case(branches, default)

    def numbers(self) -> list[Node]:
        return [self.column("step"), self.column("parent")]

    def met(self, env: Env) -> list[tuple[Node, Node]]:
        """The branch that notes the row, once the step counts; it never ends the CASE otherwise."""
        if self.guard.meet is None:
            return []
        meet = sql.call(self.guard.meet, *self.numbers(), *self.row(env))
        return [(exp.Not(this=meet), sql.number(0))]

    def goes_on(self, env: Env) -> Node:
        """Whether the step has children; if so its row is kept."""
        branches: list[tuple[Node, Node]] = []
        if self.search.stop is not None:
            branches.append((self.expressions.condition(self.search.stop, env), sql.number(0)))
        keep = sql.call("keep", *self.numbers(), *self.row(env))
        return self.guarded(env, branches + self.met(env), keep)

    def goal(self, env: Env) -> Node | None:
        """Whether the step is a goal; STOP WITH is asked before it where its failing would matter."""
        stop = None if self.search.stop is None else self.expressions.condition(self.search.stop, env)
        if self.query.where is None:
            goal: Node | None = None if stop is None else exp.Not(this=sql.operand(stop))
        else:
            goal = self.expressions.condition(self.query.where, env)
            matters = self.cut or can_fail(self.query.where)
            if stop is not None and self.search.stop is not None and can_fail(self.search.stop) and matters:
                goal = sql.call("in_turn", stop, goal)
        goal = self.with_next(env, goal, stop)
        if self.guard.met is None:
            return goal
        missed = [(exp.Not(this=sql.operand(goal)), sql.number(0))] if goal is not None else []
        return self.guarded(env, missed + self.met(env), sql.number(1))

    def with_next(self, env: Env, goal: Node | None, stop: Node | None) -> Node | None:
        """The goal, after SELECT and CONNECT BY of a step that goes on: the last result's own can fail, too."""
        keys = [*self.query.group, *(key.expr for key in self.query.order)]  # which come after CONNECT BY
        matters = self.cut or any(map(can_fail, keys))
        if not (matters and any(can_fail(expr) for _, expr in self.search.connect)):
            return goal
        shown = [self.expressions.value(one.expr, env) for one in self.query.columns if can_fail(one.expr)]
        go_on = sql.call("in_turn", *shown, *(node.copy() for node in self.next_states), sql.number(1))
        reached = go_on if stop is None else sql.case([(stop.copy(), sql.number(1))], go_on)
        return reached if goal is None else sql.case([(goal, reached)], sql.number(0))

    def results(self) -> exp.Select:
        env = self.env()
        outputs = self.numbers()
        outputs += [self.expressions.lower(output.expr, env) for output in self.query.columns]
        outputs += [self.expressions.lower(key, env) for key in self.query.group]
        outputs += [self.expressions.lower(key.expr, env) for key in self.query.order]
        goal = self.goal(env)
        goal = None if goal is None else sql.asked_of(self.column("step"), goal)
        return sql.select(outputs, [sql.table(self.table, self.table)], goal, limit=self.limit())
