"""The value of `explain()`: a text for first-time readers that is also data."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from ss2sql.errors.exceptions import escape_controls
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering.strategies import BREADTH_FIRST, get_order, get_repeat_rule
from ss2sql.results import count_words, cut_script


@dataclass(frozen=True, slots=True)
class PlanLine:
    """One line of a plan: its depth, in words, and as in SQLite's EXPLAIN QUERY PLAN."""

    depth: int
    words: str
    sqlite: str


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
    plan: tuple[PlanLine, ...]  # of SQLite
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
    if search.heuristic is not None and search.order == "cost":
        found["HEURISTIC"] = "steps that seem closer to a goal are taken earlier (A*)"
    if search.maximum is not None:
        found["MAXIMUM"] = f"the search ends after so many results: {search.maximum.span.text or 'as given'}"
    return found


def describe_queue(query: plan.Query) -> str:
    """The step that is taken next from the queue."""
    search = query.search
    if search is None:
        return BREADTH_FIRST.next_step
    if search.heuristic is not None and search.order == "cost":
        return "the one with the least cost and estimate together first"
    return get_order(search).next_step


def _make_sentence_of_fact(text: str) -> str:
    return text[0].lower() + text[1:].rstrip(".")


# --- the text of an explanation
MOST_TEXT = 70  # characters of a statement in its heading
MOST_LEVELS, LAST_LEVELS = 20, 5  # of a search: how many are shown, and how many of them are the last ones
INDENT = "  "


def format_explanation(facts: ScriptFacts) -> str:
    lines = [f"needs a value for {', '.join(facts.missing)}"] if facts.missing else []
    for number, statement in enumerate(facts.statements, 1):
        lines.append(f"{number}. {cut_script(statement.text, MOST_TEXT)}")
        if not statement.queries:
            lines.append("   no query: runs in Python as it is written")
        for query in statement.queries:
            if len(statement.queries) > 1:
                lines.append(f"   {cut_script(query.text, MOST_TEXT)}")
            lines.extend(f"   {line}".rstrip() for line in _format_query(query))
    if facts.run is not None:
        lines.extend(_put_run_in_words(facts.run))
    return escape_controls("\n".join(lines))


def _format_query(query: QueryFacts) -> Iterator[str]:
    yield f"engine: {query.engine}: {query.reason}"
    yield from (f"{INDENT}to have SQLite run it: {cure}" for cure in query.cures)
    yield from _format_terms("search", query.search)
    yield from _format_terms("rewrites", query.rewrites)
    for function in query.functions:
        yield from _format_function(function)
    yield from query.notes
    yield from (f"warning: {warning}" for warning in query.warnings)
    yield from _format_plan(query)
    if query.sql is not None:
        yield "SQL:"
        yield from (INDENT + line for line in query.sql.splitlines())
        yield from _format_parameters(query.parameters, "$" if query.engine == "duckdb" else ":")


def _format_terms(heading: str, terms: Mapping[str, str]) -> Iterator[str]:
    if terms:
        yield f"{heading}:"
        yield from (f"{INDENT}{name}: {words}" for name, words in terms.items())


def _format_plan(query: QueryFacts) -> Iterator[str]:
    if query.plan_missing is not None:
        yield f"how SQLite does it cannot be told: {query.plan_missing}"
    if query.plan:
        yield "how SQLite does it:"
        yield from (INDENT * (line.depth + 1) + line.words for line in query.plan)
    if query.afterwards:
        yield "what Python does with its results:"
        yield from (INDENT + words for words in query.afterwards)


def _format_parameters(parameters: Sequence[ParameterFacts], sign: str) -> Iterator[str]:
    """The values of `:name` or `$name` in the SQL, with the script's expressions where these differ."""
    if parameters:
        yield "values that are bound in it:"
    for parameter in parameters:
        name, written = parameter.name, parameter.written
        if parameter.value is None:
            yield f"{INDENT}{sign}{name}{f' = {written}' if written not in ('', name) else ''}, once it runs"
        elif written in ("", name) or written.replace(" ", "") == parameter.value.replace(" ", ""):
            yield f"{INDENT}{sign}{name} = {parameter.value}"
        else:
            yield f"{INDENT}{sign}{name} = {parameter.value}, which is {written}"


def _format_function(function: FunctionFacts) -> Iterator[str]:
    yield from function.inlined
    for reason in function.called:
        yield f"{function.name} is called: {reason}{_format_counts(function)}"
    yield f"{INDENT}{function.name} is {function.volatility}: {function.volatility_reason}"


def _format_counts(function: FunctionFacts) -> str:
    if function.calls is None:
        return ""
    times = count_words(function.calls, "call")
    if function.blocks is not None:
        times = f"{count_words(function.calls, 'row')} in {count_words(function.blocks, 'call')}"
    return f" ({times}, {function.remembered:,} remembered)" if function.remembered else f" ({times})"


def _put_run_in_words(run: RunFacts) -> Iterator[str]:
    paths = "" if run.paths is None else f"{count_words(run.paths, 'path')} of "
    yield f"the run: {run.status}, {paths}{count_words(run.rows, 'row')}, {run.engine}"
    if run.generated:
        pruned = f", {run.pruned:,} pruned for a row that was there before" if run.pruned else ""
        yield f"   {count_words(run.generated, 'step')} generated, {run.expanded:,} of them expanded{pruned}"
    yield "the time of its stages:"
    yield from _put_seconds_in_words(run.seconds)
    if run.levels is not None:
        yield f"{run.levels.title}:"
        yield from _format_table(run.levels)
    yield from run.notes


def _put_seconds_in_words(seconds: Mapping[str, float]) -> Iterator[str]:
    shown = {**{stage: seconds.get(stage, 0.0) for stage in STAGES}, "all": sum(seconds.values())}
    cells = {stage: f"{time * 1000:,.1f} ms" for stage, time in shown.items()}
    width, wide = max(map(len, cells.values())), max(map(len, cells))
    for stage, cell in cells.items():
        yield f"   {stage:{wide}}  {cell:>{width}}  {STAGES.get(stage, '')}".rstrip()


def _format_table(table: LevelTable) -> Iterator[str]:
    """The rows of a table under its names, without the middle ones if there are many, and the sums."""
    sums = ("all", *(sum(column) for column in list(zip(*table.rows, strict=True))[1:]))
    rows: list[Sequence[int | str]] = [*table.rows]
    if len(rows) > MOST_LEVELS:
        rows[MOST_LEVELS - LAST_LEVELS : -LAST_LEVELS] = [("…",) * len(table.columns)]
    cells = [[f"{cell:,}" if isinstance(cell, int) else cell for cell in row] for row in (table.columns, *rows, sums)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        yield "   " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))


class Explanation(str):
    """The text of an explanation; `as_dict` has the same as data."""

    facts: ScriptFacts

    def __new__(cls, facts: ScriptFacts) -> Explanation:
        self = super().__new__(cls, format_explanation(facts))
        self.facts = facts
        return self

    def __repr__(self) -> str:
        """The text itself: what a shell or a notebook shows of it."""
        return str(self)

    def as_dict(self) -> dict[str, Any]:
        """Everything that the text says, and SQLite's own words, as dicts, lists, numbers, texts and None."""
        made: dict[str, Any] = json.loads(json.dumps(asdict(self.facts)))  # tuples become lists
        return made
