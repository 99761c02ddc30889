"""What rows tell of the step behind them.

The language promises what MEMORIZE and UNIQUE find where equal rows have equal stops, goals and next states. That is
so where SELECT names all that STOP WITH, WHERE and CONNECT BY read, which can be seen in the plan.
"""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql import plan
from ss2sql.walk import parts, walk


def unnamed(query: plan.Query) -> tuple[str, ...]:
    """What the clauses of a search read of its state and its elements and SELECT does not name, as a script says it.

    Empty: equal rows are sure to have equal stops, goals and next states.
    """
    search = query.search
    assert search is not None
    told = list(_told(output.expr for output in query.columns))
    clauses = [search.stop, query.where, *(expr for _, expr in search.connect)]
    found: dict[str, None] = {}
    own = frozenset(source.id for source in query.sources)
    for clause in clauses:
        if clause is not None:
            found.update(dict.fromkeys(_missing(clause, told, query.id, own)))
    return tuple(found)


def _told(columns: Iterator[plan.Expr]) -> Iterator[plan.Expr]:
    """What is known with the values of some columns: these, and the items of lists that they write out."""
    for expr in columns:
        yield expr
        if isinstance(expr, plan.MakeList):
            yield from _told(iter(expr.items))


def _missing(expr: plan.Expr, told: list[plan.Expr], query: int, own: frozenset[int]) -> Iterator[str]:
    if expr in told:
        return
    match expr:
        case plan.State(query=number, name=name) if number == query:
            yield name
        case plan.Column(source=source) if source in own:
            if not any(isinstance(known, plan.Element) and known.source == source for known in told):
                yield expr.span.text
        case plan.Element(source=source) if source in own:
            yield expr.span.text
        case plan.Eval():
            yield " ".join(expr.span.text.split())
        case _:
            for part in parts(expr):
                yield from _missing(part, told, query, own)


def whims(query: plan.Query) -> str | None:
    """Why two runs of a query may give two answers that are both right; None where they may not."""
    for node in walk(query):
        match node:
            case plan.Call(function=function) if function.volatility == "volatile":
                return f"{function.name} is volatile"
            case plan.Assign(name=name) | plan.TemporalAssign(name=name):
                return f"it assigns {name}"
            case plan.Eval():
                return "it reads a text with eval"
    return None
