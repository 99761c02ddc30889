"""The facts of an explanation as data, and the words for rewrites, searches and stages."""

from __future__ import annotations

from collections.abc import Mapping

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering.strategies import get_order, get_repeat_rule


@dataclass(frozen=True, slots=True)
class PlanLine:
    """One line of a plan: its depth, in words, and as in SQLite's EXPLAIN QUERY PLAN."""

    depth: int
    words: str
    sqlite: str | None = None


@dataclass(frozen=True, slots=True)
class ParameterFacts:
    """A bound value of the SQL: its name, its expression in the script, and the value as text, once known."""

    name: str
    written: str
    value: str | None


@dataclass(frozen=True, slots=True)
class FunctionFacts:
    """The calls of one function.

    `inlined` are the expressions that replace calls, `called` the reasons for remaining calls. `calls` counts those of
    the whole run, for a function of arrays the rows, in `blocks` calls; None before a run.
    """

    name: str
    inlined: tuple[str, ...]
    called: tuple[str, ...]
    volatility: str
    volatility_reason: str
    calls: int | None = None
    remembered: int | None = None
    blocks: int | None = None


@dataclass(frozen=True, slots=True)
class QueryFacts:
    text: str
    engine: str
    reason: str
    cures: tuple[str, ...]  # would let SQLite run it
    search: Mapping[str, str]
    rewrites: Mapping[str, str]
    functions: tuple[FunctionFacts, ...]
    notes: tuple[str, ...]  # about the search
    warnings: tuple[str, ...]
    plan: tuple[PlanLine, ...]  # of the engine
    plan_missing: str | None  # why there is no plan
    afterwards: tuple[str, ...]  # the post-processing in Python
    sql: str | None
    parameters: tuple[ParameterFacts, ...]  # the bound values of `sql`


@dataclass(frozen=True, slots=True)
class StatementFacts:
    text: str
    queries: tuple[QueryFacts, ...]


@dataclass(frozen=True, slots=True)
class LevelTable:
    """Counts of a search level by level: the names of the columns, and one row of numbers for each level."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """A run: its status, the steps of a search, seconds per stage, notes on problems."""

    status: str
    engine: str
    rows: int
    paths: int | None
    generated: int
    expanded: int
    pruned: int
    seconds: Mapping[str, float]
    levels: LevelTable | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ScriptFacts:
    """A script, and its run, if any; `missing` are the parameters that a run would need."""

    statements: tuple[StatementFacts, ...]
    run: RunFacts | None = None
    missing: tuple[str, ...] = ()


STAGES = {
    "parse": "the text becomes a tree",
    "resolve": "names get their meanings and types",
    "lower": "queries become SQL",
    "compile": "everything else becomes Python",
    "run": "rows are found",
    "shape": "rows become what AS asks for",
}

QUEUES = {
    "depth first": "the deepest first",
    "breadth first": "the oldest first",
    "cost": "the cheapest first",
    "probability": "the likeliest first",
}


def describe_search(query: plan.Query) -> dict[str, str]:
    """The strategy of a search: each of its keywords with its promise."""
    search = query.search
    if search is None:
        return {}
    order, guard = get_order(search), get_repeat_rule(search)
    found = {}
    if search.repeats != "memorize" or search.weight is not None:
        found[order.keyword] = _make_sentence_of_fact(order.promise.partition(";")[0])  # the rest is about HEURISTIC
    if search.repeats == "memorize" and search.weight is not None:
        promise = "every path without a repeated row up to the bound"
        found[guard.keyword] = f"{promise}, {'the cheapest' if search.order == 'cost' else 'the likeliest'} first"
    elif guard.keyword:
        found[guard.keyword] = _make_sentence_of_fact(guard.promise)
    if search.heuristic is not None:
        found["HEURISTIC"] = "steps that seem closer to a goal are taken earlier (A*)"
    if search.maximum is not None:
        found["MAXIMUM"] = f"the search ends after so many results: {search.maximum.span.text or 'as given'}"
    return found


def describe_queue(query: plan.Query) -> str:
    """The step that is taken next from the queue."""
    search = query.search
    if search is None:
        return "the oldest first"
    if search.heuristic is not None:
        return "the one with the least cost and estimate together first"
    return QUEUES[search.order]


def cut_explained_script(text: str, most: int) -> str:
    """A piece of a script on one line, of at most so many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def _make_sentence_of_fact(text: str) -> str:
    return text[0].lower() + text[1:].rstrip(".")
