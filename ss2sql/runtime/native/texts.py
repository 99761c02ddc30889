"""Texts given to `eval`: compiled when they are met, once per run, with what their place sees as parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql import plan
from ss2sql.errors import ExecutionError
from ss2sql.kinds import ANY, Type
from ss2sql.records import dataclass
from ss2sql.runtime.native.deep import deep
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.native.unit import Body, Unit
from ss2sql.runtime.run import Run
from ss2sql.runtime.values import show

DEEPEST_TEXTS = 30


@dataclass(frozen=True, slots=True)
class Sight:
    """What one `eval` sees.

    `scope` belongs to the resolver. `sources` are numbers of sources with the columns of tuples, the types of elements
    and the tables of worlds (see Unit), `states` START WITH variables; a compiled text takes their values in this
    order.
    """

    scope: Any
    sources: tuple[tuple[int, tuple[str, ...] | None, Type | None, Any], ...]
    states: tuple[tuple[int, str], ...]
    dispatch: Callable[[plan.Query], Callable[[Run], Any]] | None


class Texts(dict[str, Callable[..., Any]]):
    """The compiled texts of one `eval` in one run; asking for a new one compiles it."""

    def __init__(self, run: Run, sight: Sight) -> None:
        super().__init__()
        self.run = run
        self.sight = sight

    def __getitem__(self, text: Any) -> Callable[..., Any]:
        if type(text) is not str:  # a list could not even be looked up
            raise ExecutionError("X007", f"eval reads a text, not {show(text)}", hints=("put it into quotes",))
        return super().__getitem__(text)

    def __missing__(self, text: str) -> Callable[..., Any]:
        statements = self.run.host.resolve_text(text, self.sight.scope)
        function = self[text] = inside(self.run, compiled(statements, self.sight)(self.run))
        return function


def inside(run: Run, text: Callable[..., Any]) -> Callable[..., Any]:
    """A text that counts how deep it stands inside of others; one that reads itself would never end.

    So many levels fit into the stack, also where SQLite calls each of them.
    """

    def counted(*values: Any) -> Any:
        if run.texts == DEEPEST_TEXTS:
            hint = "let the text end: IF(condition; eval(text); value)"
            raise ExecutionError("X016", f"eval is nested more than {DEEPEST_TEXTS} deep", hints=(hint,))
        run.texts += 1
        try:
            with deep(run.texts):
                return text(*values)
        finally:
            run.texts -= 1

    return counted


def compiled(statements: tuple[plan.Expr, ...], sight: Sight) -> Callable[[Run], Callable[..., Any]]:
    """The function that binds a text to a run; the bound text gives the value of its last statement."""
    from ss2sql.runtime.native.builder import Builder
    from ss2sql.runtime.native.expressions import expression

    analysis = Analysis(statements, open_world=True)
    with deep(analysis.levels):
        unit = Unit(statements[0].span, analysis)
        builder = Builder(unit, sight.dispatch)
        body = Body(unit, unit.local("text"), [], unit.root)
        for source, columns, kind, table in sight.sources:
            name = unit.names[source] = unit.local("element")
            body.parameters.append(name)
            body.levels[source] = 0
            if columns is not None:
                unit.tuples[source] = columns
            if table is not None:
                unit.worlds[source] = table
            unit.elements[source] = kind or ANY
        for state in sight.states:
            name = unit.states[state] = unit.local(state[1])
            body.parameters.append(name)
            body.states.add(state)
        for statement in statements[:-1]:
            pen = unit.pen_at(statement.span)
            body.add(pen.run(expression(builder, statement, body)))
        pen = unit.pen_at(statements[-1].span)
        body.add(pen.back(expression(builder, statements[-1], body)))
        body.define()
        return unit.compiled(unit.module(pen.name(body.name)))


def texts_of(run: Run, sight: Sight) -> Texts:
    return Texts(run, sight)
