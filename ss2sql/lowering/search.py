"""Hierarchical queries as WITH RECURSIVE.

A row of the recursive table is one step that waits in SQLite's queue: its number, its parent's number, its
depth, the element, and the state before it. SQLite takes the next row in the order of the recursive term's
ORDER BY, hands it to the outer query, which asks whether it is a goal, and then runs the recursive term on
it, which asks whether it goes on and makes its children. So a step is evaluated when it is taken, exactly
in the order of the search, and a search that is cut off has evaluated nothing ahead.

What SQL has no words for are functions of the run (runtime/search_functions.py): `next_step` numbers the
steps, `keep` notes the row of a step that goes on, so that paths can be walked back from their last step at
a cost that does not depend on their length, and the guards know the rows that were met.
"""

from __future__ import annotations

from collections.abc import Iterator

from sqlglot import exp

from ss2sql import plan
from ss2sql.lowering import sql
from ss2sql.lowering.expressions import Env, can_fail, is_flag
from ss2sql.lowering.select import Selects
from ss2sql.lowering.sources import open_sources
from ss2sql.lowering.sql import Node
from ss2sql.lowering.strategies import GUARDS, ORDERS
from ss2sql.walk import rebuild, walk

TABLE = "search"


class Carried:
    """The columns of the recursive table that hold the elements and the state of a step."""

    def __init__(self, query: plan.Query, search: plan.Search) -> None:
        self.reads: list[tuple[str, plan.Element | plan.Column]] = []
        self.states: dict[str, str] = {}
        taken = {"step", "parent", "depth"}
        for name, _ in search.start:
            self.states[name] = _free(name, taken)
        for node in _element_reads(query, search):
            if all(node != known for _, known in self.reads):
                source = next(source for source in query.sources if source.id == node.source)
                name = node.name if isinstance(node, plan.Column) else source.name
                self.reads.append((_free(name, taken), node))

    @property
    def names(self) -> list[str]:
        return ["step", "parent", "depth", *(name for name, _ in self.reads), *self.states.values()]

    def env(self, query: plan.Query, table: str) -> Env:
        """Reads elements and state from a row of the recursive table."""
        env = Env()
        for source in query.sources:
            env = env.with_source(source.id, lambda expr: self._column(expr, table))
        return env.with_states({(query.id, name): sql.column(short, table) for name, short in self.states.items()})

    def _column(self, expr: plan.Element | plan.Column, table: str) -> Node:
        return sql.column(next(name for name, known in self.reads if known == expr), table)


def _free(name: str, taken: set[str]) -> str:
    candidate, count = name, 1
    while candidate.lower() in taken:
        count += 1
        candidate = f"{name}_{count}"
    taken.add(candidate.lower())
    return candidate


def _element_reads(query: plan.Query, search: plan.Search) -> Iterator[plan.Element | plan.Column]:
    own = {source.id for source in query.sources}
    places = [query.where, search.stop, *(output.expr for output in query.columns)]
    places += [expr for _, expr in search.connect] + list(query.group) + [key.expr for key in query.order]
    for place in places:
        for node in walk(place) if place is not None else ():
            if isinstance(node, (plan.Element, plan.Column)) and node.source in own:
                yield node


def lower_search(selects: Selects, query: plan.Query) -> exp.Select:
    """The statement of a search: for each result the step's number, its parent's, and the step's row."""
    search = query.search
    assert search is not None
    return _Search(selects, query, search).statement()


class _Search:
    """The two terms of the recursion and the query around it share the names and the guard."""

    def __init__(self, selects: Selects, query: plan.Query, search: plan.Search) -> None:
        self.selects = selects
        self.expressions = selects.expressions
        self.query = query
        self.search = search
        self.guard = GUARDS[search.repeats]
        self.order = ORDERS[search.order]
        self.table = selects.needs.label(TABLE)
        self.carried = Carried(query, search)
        self.flags = {name: is_flag(kind) for name, kind in search.states}
        self.tables: list[exp.CTE] = []
        self.next_states: list[Node] = []
        self.positions: dict[str, str] = {}  # the column of each copied table that numbers its rows

    def statement(self) -> exp.Select:
        labels = set(self.selects.needs.labels)
        first = self.first()
        # The two terms do not see each other, so their sources may have the same names.
        self.selects.needs.labels = labels
        union = exp.Union(this=first, expression=self.recursive(), distinct=False)
        assert self.order.queue is not None
        names = self.carried.names
        keys = [
            exp.Ordered(this=sql.number(names.index(column) + 1), desc=descending, nulls_first=not descending)
            for column, descending in self.order.queue
        ]
        union.set("order", exp.Order(expressions=keys))
        columns = [sql.identifier(name) for name in names]
        cte = exp.CTE(this=union, alias=exp.TableAlias(this=sql.identifier(self.table), columns=columns))
        select = self.results()
        for copied in self.tables:
            _keep_columns(copied, union)
        select.set("with_", exp.With(expressions=[*self.tables, cte], recursive=True))
        return select

    def first(self) -> exp.Select:
        """The steps from the START WITH state."""
        states: dict[tuple[int, str], Node] = {}
        values: dict[str, plan.Expr] = {}
        for name, expr in self.search.start:
            value = values[name] = self.with_starts(expr, values)
            flag = self.flags[name]
            plain = isinstance(value, plan.Constant) and not isinstance(value.value, (list, bool))
            states[(self.query.id, name)] = (
                self.expressions.lower(value, Env()) if plain else self.selects.needs.bind(value, name, flag)
            )
        return self.steps(Env().with_states(states), sql.number(0), sql.number(1), [], None)

    def with_starts(self, expr: plan.Expr, values: dict[str, plan.Expr]) -> plan.Expr:
        """The expression with the values of the START WITH variables before it in place of their names."""
        if isinstance(expr, plan.State) and expr.query == self.query.id:
            return values[expr.name]
        return rebuild(expr, lambda part: self.with_starts(part, values))

    def recursive(self) -> exp.Select:
        """The children of a step that goes on."""
        parent = self.carried.env(self.query, self.table)
        following = dict(parent.states)
        for name, expr in self.search.connect:
            # A later assignment sees an earlier one, so its expression stands in the place of the name.
            lower = self.expressions.lower if self.flags[name] else self.expressions.value
            following[(self.query.id, name)] = lower(expr, parent.with_states(following))
        depth = sql.binary(exp.Add, sql.column("depth", self.table), sql.number(1))
        table = sql.table(self.table, self.table)
        step = sql.column("step", self.table)
        self.next_states = [following[(self.query.id, name)] for name, _ in self.search.connect]
        return self.steps(Env().with_states(following), step, depth, [table], self.goes_on(parent))

    def steps(self, env: Env, parent: Node, depth: Node, items: list[Node], where: Node | None) -> exp.Select:
        opened, env = open_sources(self.selects, self.query.sources, env, self.query.id)
        sources = [self.in_order(item) for part in opened for item in part.items]
        conditions = [where] if where is not None else []
        conditions += [condition for part in opened for condition in part.conditions]
        positions = [
            sql.column(self.positions[item.name], item.alias_or_name)
            for item in sources
            if isinstance(item, exp.Table) and item.name in self.positions
        ]
        outputs: list[Node] = [sql.call("next_step", *positions), parent, depth]
        outputs += [self.expressions.lower(node, env) for _, node in self.carried.reads]
        outputs += [env.states[(self.query.id, name)].copy() for name in self.carried.states]
        return sql.select(outputs, items + sources, sql.conjunction(conditions))

    def in_order(self, item: Node) -> Node:
        """An item of FROM; a table is read from a copy in its own order.

        Steps are numbered as they are walked, so the walk must be in order. SQLite keeps a materialised copy
        in the order of its making. Where a condition asks for equality it builds an index on the copy, so that
        a step costs its neighbours, not the table. That index holds the key and then the columns that are
        read, in their order: `position`, the first, keeps equal keys in the order of the table.
        """
        if not isinstance(item, exp.Table) or isinstance(item.this, exp.Anonymous):
            return item
        source = self.selects.tables[item.alias_or_name]
        name = f"{item.alias_or_name}_in_order"
        if name not in self.positions:
            self.positions[name] = _free("position", {column.lower() for column, _ in source.columns})
            columns: list[Node] = [sql.column(column) for column, _ in source.columns]
            order = [(sql.column(key), False) for key in source.order]
            keys = [exp.Ordered(this=key, desc=False, nulls_first=True) for key, _ in order]
            number = exp.Window(this=exp.RowNumber(), order=exp.Order(expressions=keys) if keys else None)
            position: Node = sql.column("rowid") if source.order == ("rowid",) else number
            copied = sql.table(source.table, source.table, source.schema)
            select = sql.select([sql.alias(position, self.positions[name]), *columns], [copied], order=order)
            cte = exp.CTE(this=select, alias=exp.TableAlias(this=sql.identifier(name)), materialized=True)
            self.tables.append(cte)
        return sql.table(name, item.alias_or_name)

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
        return [sql.column("step", self.table), sql.column("parent", self.table)]

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
            if stop is not None and self.search.stop is not None and can_fail(self.search.stop) and self.cut():
                goal = sql.call("in_turn", stop, goal)
        goal = self.with_next(goal, stop)
        if self.guard.met is None:
            return goal
        missed = [(exp.Not(this=sql.operand(goal)), sql.number(0))] if goal is not None else []
        return self.guarded(env, missed + self.met(env), sql.number(1))

    def with_next(self, goal: Node | None, stop: Node | None) -> Node | None:
        """The goal, after CONNECT BY of a step that goes on: the last result's own can fail, too."""
        if not (self.cut() and any(can_fail(expr) for _, expr in self.search.connect)):
            return goal
        go_on = sql.call("in_turn", *(node.copy() for node in self.next_states), sql.number(1))
        reached = go_on if stop is None else sql.case([(stop.copy(), sql.number(1))], go_on)
        return reached if goal is None else sql.case([(goal, reached)], sql.number(0))

    def cut(self) -> bool:
        """Whether the search may end before its steps are used up, so that a step's own order shows."""
        return self.search.maximum is not None or self.query.limit is not None

    def results(self) -> exp.Select:
        env = self.carried.env(self.query, self.table)
        outputs = self.numbers()
        outputs += [self.expressions.lower(output.expr, env) for output in self.query.columns]
        outputs += [self.expressions.lower(key, env) for key in self.query.group]
        outputs += [self.expressions.lower(key.expr, env) for key in self.query.order]
        maximum = self.search.maximum
        limit = None if maximum is None else self.selects.needs.count(maximum, "maximum")
        return sql.select(outputs, [sql.table(self.table, self.table)], self.goal(env), limit=limit)


def _keep_columns(copied: exp.CTE, terms: exp.Expr) -> None:
    """Leaves only those columns in the copy of a table that the terms of the recursion read."""
    name = copied.alias_or_name
    labels = {item.alias_or_name for item in terms.find_all(exp.Table) if item.name == name}
    read = {column.name for column in terms.find_all(exp.Column) if column.table in labels}
    select = copied.this
    select.set("expressions", [column for column in select.expressions if column.alias_or_name in read])
