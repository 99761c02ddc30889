"""What a script uses, so that a run can tell what its random programs covered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from ss2sql.errors import Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

AGGREGATES = frozenset({"count", "sum", "min", "max", "average"})

# What random programs have to cover: every one of these is in at least LEAST percent of them.
LEAST = 5
NAMED = (
    *("flat query", "search", "several statements", "nested query", "assignment in a query", "star"),
    *("flat WHERE", "flat GROUP BY", "flat HAVING", "flat ORDER BY", "flat LIMIT"),
    *("flat aggregates", "flat partitions"),
    *("search WHERE", "STOP WITH", "search GROUP BY", "search HAVING", "search ORDER BY", "search LIMIT"),
    *("search aggregates", "search partitions"),
    *("no options", "DEPTH FIRST", "BREADTH FIRST", "COST", "HEURISTIC", "PROBABILITY"),
    *("MEMORIZE", "NO CYCLE", "UNIQUE", "MAXIMUM"),
    *("no AS", "AS dict", "AS list", "AS rows", "AS value", "AS val", "AS set", "AS void"),
    *("1 sources", "2 sources", "3 sources", "lateral source", "source that mentions the state", "source query"),
    *("source call", "source listliteral", "source name"),
    *("state int", "state float", "state str", "state list", "state nested list"),
    *("if", "and", "or", "xor", "not", "literal NoneType", "index", "function eval", "function print"),
    *("function that raises", "function that changes its argument", "volatile function", "opaque objects"),
)
GROUPED = {
    "function that raises": ("picky", "lookup", "strange"),
    "function that changes its argument": ("grow", "flip", "shift"),
    "volatile function": ("tick", "blink"),
    "opaque objects": ("body", "box"),
}
GROUP_OF = {function: group for group, functions in GROUPED.items() for function in functions}


def features(script: str) -> set[str]:
    """The clauses, options, representations, operators and functions of a script, and some of their combinations."""
    tree = parse(Source(script))
    found = {feature for node in walk(tree) for feature in of_node(node)}
    if len(tree.statements) > 1:
        found.add("several statements")
    return found


def walk(node: Any) -> Iterator[Any]:
    """The node and everything below it."""
    if isinstance(node, tuple):
        for item in node:
            yield from walk(item)
    elif is_dataclass(node):
        yield node
        for part in fields(node):
            if part.compare:
                yield from walk(getattr(node, part.name))


def of_node(node: Any) -> Iterator[str]:
    match node:
        case ast.Query():
            yield from of_query(node)
        case ast.Operator(function=function):
            yield f"operator {function}"
        case ast.Call(function=function, star=star):
            yield f"function {function}{'(*)' if star else ''}"
            if function in GROUP_OF:
                yield GROUP_OF[function]
        case ast.Literal(value=value):
            yield f"literal {type(value).__name__}"
        case ast.Script() | ast.Name() | ast.From() | ast.OrderKey() | ast.Option() | ast.Representation():
            return
        case _:
            yield type(node).__name__.lower()


def of_query(query: ast.Query) -> Iterator[str]:
    """The clauses of one query, and what stands inside of them."""
    yield "search" if query.connect else "flat query"
    yield f"{len(query.sources)} sources"
    yield f"AS {query.representation.name.lower()}" if query.representation else "no AS"
    clauses = {
        "WHERE": query.where, "STOP WITH": query.stop, "GROUP BY": query.group, "HAVING": query.having,
        "ORDER BY": query.order, "LIMIT": query.limit,
    }  # fmt: skip
    written = [name for name, clause in clauses.items() if clause]
    kind = "search" if query.connect else "flat"
    yield from ("STOP WITH" if name == "STOP WITH" else f"{kind} {name}" for name in written)
    if query.group:
        aggregated = any(isinstance(part, ast.Call) and part.function in AGGREGATES for part in walk(query.columns))
        yield f"{kind} {'aggregates' if aggregated else 'partitions'}"
    if query.connect:
        words = sorted(option.keyword for option in query.options)
        yield f"options {' + '.join(words)}" if words else "no options"
        yield from words
        yield f"{len(query.start)} variables"
        yield from (f"state {state_kind(assign.value)}" for assign in query.start)
    yield from of_sources(query)
    if any(
        isinstance(part, (ast.Assign, ast.TemporalAssign)) for part in walk((query.columns, query.where, query.order))
    ):
        yield "assignment in a query"
    if any(isinstance(part, ast.Query) for part in walk((query.columns, query.where, query.stop))):
        yield f"nested query in a {kind}"
        yield "nested query"


def state_kind(start: Any) -> str:
    """What a variable of the state holds, by the value that it starts with."""
    match start:
        case ast.Literal(value=value):
            return type(value).__name__
        case ast.ListLiteral(items=items) if any(isinstance(item, ast.ListLiteral) for item in items):
            return "nested list"
        case ast.ListLiteral():
            return "list"
        case _:
            return "of an expression"


def of_sources(query: ast.Query) -> Iterator[str]:
    """The kinds of sources, and whether one mentions an earlier source or the state of the search."""
    seen = {assign.name for assign in query.start}
    for source in query.sources:
        yield f"source {type(source.expr).__name__.lower()}"
        for part in walk(source.expr):
            if isinstance(part, (ast.This, ast.Attribute)) and part.source in seen:
                yield "lateral source"
            if isinstance(part, ast.Name) and part.name in seen:
                yield "source that mentions the state"
        if source.name is not None:
            seen.add(source.name)
