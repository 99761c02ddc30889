"""The trace that a result keeps: the events, and the script with its clauses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from ss2sql.errors import RepresentationError, SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.search_clauses import REPEATS
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.plan_traversal import find_growing_states
from ss2sql.lowering.strategies import ORDERS
from ss2sql.runtime.search.trace import Event, Trace

if TYPE_CHECKING:
    from ss2sql.results.result import Result

MOST_EVENTS = 10_000  # the default
KEYWORDS = re.compile(r"\b(?:SELECT(?:\s+(?:LAST|DISTINCT))*|FROM|WHERE|START\s+WITH|STOP\s+WITH)\s*$", re.IGNORECASE)
STRATEGIES = {order.keyword: order.title for order in ORDERS.values()}


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """The first events of a search, of `total`; its script, and the spans of the clauses that act in each event.

    `strategy` is its name in textbooks with the rule for repeated rows; `weight` is COST or PROBABILITY where it orders
    the queue. `counters` are the START WITH variables that only count.
    """

    events: Sequence[Event]
    total: int
    script: str
    clauses: dict[str, list[tuple[int, int]]]
    strategy: str
    weight: str | None
    counters: frozenset[str]

    columns: ClassVar[tuple[str, ...]] = Event._fields

    @property
    def is_whole(self) -> bool:
        return len(self.events) == self.total


def get_trace(result: Result, user: str) -> SearchTrace:
    """The trace of a result. Raises RepresentationError V001 where the run was not traced."""
    if result.traced is None:
        hints = (
            "run it with trace=1000: ss.run(script, trace=1000); on the command line `ss2sql play` traces a script",
        )
        raise RepresentationError("V001", f"{user} shows a search that was traced, and this run was not", hints=hints)
    return result.traced


def find_traced_query(statement: ast.Expr) -> ast.Query:
    """The search that a traced script ends with. Raises SessionError S002 where it does not."""
    tree = statement.value if isinstance(statement, ast.Assign) else statement
    if isinstance(tree, ast.Query) and tree.searches:
        return tree
    hint = "let its last statement be the query with CONNECT BY, alone or as `name = SELECT ...`"
    raise SessionError("S002", "trace= shows a search, and the script does not end with one", hints=(hint,))


def make_trace(trace: Trace, statement: ast.Expr, written: plan.Query) -> SearchTrace:
    """The trace of the search in the statement, which the plan has as `written`."""
    query = find_traced_query(statement)
    trace.copy_values()
    words = [option.keyword for option in query.options]
    weighed = () if "MEMORIZE" in words else ("COST", "PROBABILITY")
    weight = next((word for word in weighed if word in words), None)
    clauses = {event: list(_find_traced_clauses(query, event)) for event in ("start", *_CLAUSES)}
    counters = find_growing_states(written, evenly=True)
    return SearchTrace(trace.events, trace.total, query.span.text, clauses, _describe_strategy(words), weight, counters)


def collect_notes(trace: Trace, statement: ast.Expr) -> Iterator[str]:
    memorizes = any(option.keyword == "MEMORIZE" for option in find_traced_query(statement).options)
    alone = ", from its start alone and without a remembered graph" if memorizes else ""
    yield f"traced: the search ran natively, step by step{alone}"
    if trace.total > trace.most:
        yield f"the trace holds the first {trace.most:,} of {trace.total:,} events; trace={trace.total} holds all"


def _describe_strategy(words: Sequence[str]) -> str:
    repeats = next((word for word in words if word in REPEATS), None)
    named = [STRATEGIES[word] for word in words if word in STRATEGIES]
    order = "A*" if {"COST", "HEURISTIC"} <= set(words) else named[0] if named else None
    if order is None:
        order = {"UNIQUE": "breadth first", "MEMORIZE": "graph, level by level"}.get(repeats or "", "depth first")
    return order if repeats is None else f"{order}, {repeats}"


_CLAUSES: dict[str, tuple[str, ...]] = {
    "generated": ("columns", "connect"),
    "expanded": ("sources", *STRATEGIES),
    "repeated": REPEATS,
    "stopped": ("stop",),
    "goal": ("where",),
}


def _find_traced_clauses(query: ast.Query, event: str) -> Iterator[tuple[int, int]]:
    """The clauses that act in an event, with their keywords, as spans of the query."""
    text, begin = query.span.text, query.span.start
    spans = [option.span for option in query.options if option.keyword in _CLAUSES.get(event, ())]
    for name in _CLAUSES.get(event, ("start",)):
        parts: Any = getattr(query, name, None) or ()
        parts = parts if isinstance(parts, tuple) else (parts,)
        spans += [parts[0].span.extend_to(parts[-1].span)] if parts else []
    for span in spans:
        start = span.start - begin
        keyword = KEYWORDS.search(text, 0, start)
        yield (keyword.start() if keyword else start), span.end - begin
