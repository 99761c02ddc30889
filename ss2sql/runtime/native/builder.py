"""Compiles the queries of a unit, each with the queries inside of it.

A query becomes a function that finds its results (flat.py, search_code.py), functions for what stands around them
(LIMIT and its kin, groups, the arguments of AS), and a `Task` that puts them together when a run begins.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from ss2sql import plan
from ss2sql.kinds import SCALAR, Kind
from ss2sql.records import dataclass
from ss2sql.runtime.call_memory import MEMO_LIMIT, forget_half
from ss2sql.runtime.frozen import UNSET
from ss2sql.runtime.native import flat
from ss2sql.runtime.native.calls import exact_key
from ss2sql.runtime.native.endings import Form, aggregates_in
from ss2sql.runtime.native.expressions import expression, group_key
from ss2sql.runtime.native.facts import Facts
from ss2sql.runtime.native.options import whole
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.tasks import task_of, tuples_of, value_of
from ss2sql.runtime.native.texts import Sight, texts_of
from ss2sql.runtime.native.unit import Body, Unit
from ss2sql.runtime.representations.base import label
from ss2sql.runtime.run import Run
from ss2sql.walk import walk, walks_the_same

OWN_KEY = Kind.INT | Kind.STR | Kind.NONE  # equal values of these kinds are the same

Dispatch = Callable[[plan.Query], Callable[[Run], Any]]


@dataclass(frozen=True, slots=True)
class Nested:
    """A compiled query as the code around it uses it: names of functions, and the outer values that they take.

    `found` gives the rows of a query after which nothing follows when they were found.
    """

    task: str
    value: str
    tuples: str
    found: str | None
    arguments: list[ast.expr]


class Builder:
    """Compiles into one unit. With `dispatch` the queries are somebody else's, see `compile_statement`."""

    def __init__(self, unit: Unit, dispatch: Dispatch | None = None) -> None:
        self.unit = unit
        self.dispatch = dispatch

    # --- queries and texts inside of expressions -------------------------------------------------------

    def subquery(self, node: plan.Subquery, body: Body) -> ast.expr:
        """The value of a query in an expression."""
        unit, pen = self.unit, self.unit.pen_at(node.span)
        if self.dispatch is not None:
            return pen.call(unit.constant(self.dispatch(node.query), "query"), pen.name("run"))
        nested = self.query(node.query, body)
        call = pen.call(nested.value, *nested.arguments)
        facts = unit.analysis.of(node)
        return body.kept(facts, call, pen, "value") if facts.steady else call

    def reduction(self, node: plan.Call, body: Body) -> ast.expr | None:
        """A value that a built-in function makes of the rows of a query, once for equal values of the rows around it.

        None for any other call, and where what the query reads of them may be objects, which have no exact keys.
        """
        unit, facts = self.unit, self.unit.analysis.of(node)
        match node.arguments:
            case (plan.Subquery(query=query) as inner,) if facts.steady and node.type.only(SCALAR):
                read = [part for part in walk(inner) if _reads_around(part, body)]
            case _:
                return None
        if self.dispatch is not None or facts.groups or not (read and walks_the_same(query)):
            return None
        if any(part.type.may(Kind.OBJECT) for part in read):
            return None
        pen = unit.pen_at(node.span)
        unit.page.mark_call(node.place, node.function.name)
        keys = [expression(self, part, body) for part in dict.fromkeys(read)]
        keys = [
            key if part.type.only(OWN_KEY) else pen.call(unit.helper(exact_key), key)
            for key, part in zip(keys, dict.fromkeys(read), strict=True)
        ]
        memo = unit.bind(("reduction", id(node)), "reduced", pen.record((), ()), pen)
        key, found = unit.local("key"), unit.local("found")
        with body.unsure():
            value = pen.call(unit.function(node.function, pen), expression(self, inner, body))
        asked = pen.bind(key, keys[0] if len(keys) == 1 else pen.pack(*keys))
        unit.namespace["UNSET"] = UNSET
        known = pen.bind(found, pen.call(pen.part(pen.name(memo), "get"), asked, pen.name("UNSET")))
        missed = pen.call(unit.helper(remembered), pen.name(memo), pen.name(key), value)
        return pen.either(pen.compare(known, ast.IsNot(), pen.name("UNSET")), pen.name(found), missed)

    def text(self, node: plan.Eval, body: Body) -> ast.expr:
        """The value of a text that is compiled when it is met."""
        unit, pen = self.unit, self.unit.pen_at(node.span)
        unit.page.mark_eval(node.span)
        sources = tuple(source for source in node.sources if body.sees(source))
        states = tuple(state for state in node.states if body.sees_state(state))
        kept = ((source, unit.tuples.get(source), unit.elements.get(source)) for source in sources)
        sight = Sight(
            node.scope,
            tuple((*known, unit.worlds.get(known[0])) for known in kept),
            states,
            self.dispatch,
        )
        constant = pen.name(unit.constant(sight, "sight"))
        texts = unit.bind(("texts", id(node)), "texts", pen.call(unit.helper(texts_of), pen.name("run"), constant), pen)
        function = pen.item(pen.name(texts), expression(self, node.text, body))
        return pen.call(function, *self._outer_values(sources, states, body, pen))

    def source_facts(self, source: plan.Source) -> Facts:
        """What the reading of a source depends on."""
        match source:
            case plan.ValueSource(value=value):
                return replace(self.unit.analysis.of(value), key=None)
            case plan.QuerySource(query=query):
                return replace(self.unit.analysis.of(query), key=None, total=False)
            case plan.TableSource():
                return Facts(total=False)
            case plan.WorldSource(arguments=arguments):
                facts = [self.unit.analysis.of(argument) for argument in arguments]
                return Facts(
                    frozenset().union(*(one.sources for one in facts)),
                    frozenset().union(*(one.states for one in facts)),
                    steady=all(one.steady for one in facts),
                    total=all(one.total for one in facts),
                )

    def _outer_values(
        self, sources: Sequence[int], states: Sequence[tuple[int, str]], body: Body, pen: Pen
    ) -> list[ast.expr]:
        unit = self.unit
        values = [pen.name(unit.names[source]) for source in sources]
        return values + [pen.name(body.moved.get(state) or unit.states[state]) for state in states]

    # --- queries ---------------------------------------------------------------------------------------

    def query(self, query: plan.Query, caller: Body) -> Nested:
        """Compiles a query that is used in `caller`."""
        unit = self.unit
        facts = unit.analysis.of(query)
        sources = [source for source in sorted(facts.sources) if caller.sees(source)]
        states = [state for state in sorted(facts.states) if caller.sees_state(state)]
        groups = {key: name for key, name in caller.seen_groups.items() if key[0] in facts.groups}
        pen = unit.pen_at(query.span)

        def part(name: str) -> Body:
            """A function of the query; it takes what the query reads of the queries around it."""
            names = [*(unit.names[s] for s in sources), *(unit.states[s] for s in states), *groups.values()]
            body = Body(unit, unit.local(name), names, unit.root)
            body.levels = dict.fromkeys(sources, 0)
            body.states, body.groups = set(states), dict(groups)
            return body

        own, searched = aggregates_in(query), None
        if query.search is None:
            finder = flat.finder(self, query, part("rows"), own)
        else:
            from ss2sql.runtime.native import search_code

            finder, searched = search_code.finder(self, query, part("rows"), own)
        functions = {
            "settings": self._settings(query, part),
            "find": finder,
            "group": self._group(query, part),
            "arguments": self._arguments(query, part),
            "flush": self._flush(pen) if query.search else None,
        }
        find = unit.find if query is unit.searched else None
        form = pen.name(unit.constant(Form.of(query, tuple(own), searched, find), "form"))
        given = [pen.constant(None) if name is None else pen.name(name) for name in functions.values()]
        task, value, tuples = unit.local("task"), unit.local("value_of"), unit.local("rows_of")
        unit.definitions += [
            pen.assign(task, pen.call(unit.helper(task_of), pen.name("run"), form, *given)),
            pen.assign(value, pen.call(unit.helper(value_of), pen.name(task))),
            pen.assign(tuples, pen.call(unit.helper(tuples_of), pen.name(task))),
        ]
        outer = self._outer_values(sources, states, caller, pen) + [pen.name(name) for name in groups.values()]
        ends = query.search or query.grouped or query.order or functions["settings"]
        return Nested(task, value, tuples, None if ends else functions["find"], outer)

    def _flush(self, pen: Pen) -> str:
        """A function that hands on what was counted."""
        name = self.unit.local("flush")
        self.unit.definitions.append(pen.function(name, [], [pen.run(self.unit.metered())]))
        return name

    def _settings(self, query: plan.Query, part: Callable[[str], Body]) -> str | None:
        """A function that gives LIMIT, OFFSET, MAXIMUM and MEMORIZE's bound, and the names of the columns."""
        search = query.search
        counts = [(query.limit, 0, "LIMIT"), (query.offset, 0, "OFFSET")]
        counts.append((search.maximum if search else None, 1, "MAXIMUM"))
        counts.append((search.bound if search else None, 1, "MEMORIZE"))
        labelled = any(output.label for output in query.columns)
        if not labelled and not any(expr for expr, _, _ in counts):
            return None
        body = part("settings")
        values = [self._count(expr, least, word, body) for expr, least, word in counts]
        pen = self.unit.pen_at(query.span)
        labels = [
            pen.constant(output.name) if output.label is None else self._label(output.label, body)
            for output in query.columns
        ]
        body.add(pen.back(pen.pack(*values, pen.pack(*labels) if labelled else pen.constant(None))))
        body.define()
        return body.name

    def _count(self, expr: plan.Expr | None, least: int, word: str, body: Body) -> ast.expr:
        if expr is None:
            return self.unit.pen.constant(None)
        pen = self.unit.pen_at(expr.span)
        value = expression(self, expr, body)
        return pen.call(self.unit.helper(whole), value, pen.constant(least), pen.constant(word))

    def _label(self, expr: plan.Expr, body: Body) -> ast.expr:
        pen = self.unit.pen_at(expr.span)
        return pen.call(self.unit.helper(label), expression(self, expr, body))

    def _group(self, query: plan.Query, part: Callable[[str], Body]) -> str | None:
        """A function of a group's aggregates and keys.

        It gives None for a group that HAVING drops, else the group's row and its sort keys; the row is None
        where the group is a partition.
        """
        if not query.aggregated and not (query.group and query.having):
            return None
        unit, pen = self.unit, self.unit.pen_at(query.span)
        body = part("group")
        names = {group_key(node): unit.local(node.function) for node in aggregates_in(query)}
        names.update({(query.id, index): unit.local("key") for index in range(len(query.group))})
        body.groups.update(names)
        body.parameters = [*names.values(), *body.parameters]
        outputs = [output.expr for output in query.columns] if query.aggregated else []
        keys = [key.expr for key in query.order] if query.aggregated else []
        body.count([*([query.having] if query.having else []), *outputs, *keys])
        if query.having is not None:
            kept = expression(self, query.having, body)
            body.add(unit.pen_at(query.having.span).unless(kept, ast.Return(pen.constant(None), **pen.at)))
        row, behind = flat.row_and_keys(
            self, query if query.aggregated else replace(query, order=()), outputs, keys, body
        )
        shown = pen.pack(*row) if query.aggregated else pen.constant(None)
        body.add(pen.back(pen.pack(shown, pen.pack(*behind))))
        body.define()
        return body.name

    def _arguments(self, query: plan.Query, part: Callable[[str], Body]) -> str | None:
        """A function that gives the arguments of AS."""
        representation = query.representation
        if not representation.arguments and not representation.named:
            return None
        body = part("arguments")
        pen = self.unit.pen_at(query.span)
        positional = pen.pack(*(expression(self, expr, body) for expr in representation.arguments))
        names = tuple(name for name, _ in representation.named)
        named = pen.record(names, tuple(expression(self, expr, body) for _, expr in representation.named))
        body.add(pen.back(pen.pack(positional, named)))
        body.define()
        return body.name


def _reads_around(part: Any, body: Body) -> bool:
    match part:
        case plan.Element(source=source) | plan.Column(source=source):
            return body.sees(source)
        case plan.State(query=query, name=name):
            return body.sees_state((query, name))
        case _:
            return False


def remembered(memo: dict[Any, Any], key: Any, value: Any) -> Any:
    """The value, kept by its key."""
    if len(memo) >= MEMO_LIMIT:
        forget_half(memo)
    memo[key] = value
    return value
