"""What became of a script, as text for people: engines, rewrites, what is inlined, what is called, and the SQL."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.frontend.inline import Body
from ss2sql.frontend.inliner import Site
from ss2sql.lowering.rewrites.inline import sites
from ss2sql.runtime.functions import UserFunction
from ss2sql.runtime.memorize.reverse import reverse_of
from ss2sql.runtime.native.deep import with_room
from ss2sql.runtime.remembered.keeper import calls
from ss2sql.runtime.run import Stats
from ss2sql.walk import functions

if TYPE_CHECKING:
    from ss2sql.runtime.compiled import CompiledQuery, CompiledStatement

MOST_TEXT = 70  # characters of a statement in its heading


def outline(statements: Iterable[CompiledStatement]) -> list[tuple[str, list[CompiledQuery]]]:
    """The text of each statement with its queries as they are compiled now."""
    return [(statement.tree.span.text, list(statement.queries)) for statement in statements]


def explain(outlined: Sequence[tuple[str, Sequence[CompiledQuery]]], stats: Stats | None = None) -> str:
    """For every statement and query: which engine runs it and why, what was rewritten, its functions, its SQL.

    With the `stats` of a run it also says how often each function was called, how the graph of MEMORIZE has grown, and
    what was not done as asked.
    """
    lines: list[str] = []
    for number, (text, queries) in enumerate(outlined, 1):
        heading = " ".join(text.split())
        lines.append(f"{number}. {heading if len(heading) <= MOST_TEXT else heading[: MOST_TEXT - 3] + '...'}")
        if not queries:
            lines.append("   no query: runs in Python as it is written")
        for query in queries:
            lines.extend(f"   {line}".rstrip() for line in _query(query, stats))
    if stats is not None:
        lines.extend(_run(stats))
    return "\n".join(lines)


def _run(stats: Stats) -> Iterator[str]:
    """What a run has to tell: the levels of its last search with MEMORIZE, as a table, and its notes."""
    if stats.levels:
        heading = ("level", "rows", "steps", "repeated", "pruned")
        table = [(n, level.rows, level.steps, level.repeated, level.pruned) for n, level in enumerate(stats.levels, 1)]
        sums = ("all", *(sum(column) for column in list(zip(*table, strict=True))[1:]))
        cells = [[f"{cell:,}" if isinstance(cell, int) else cell for cell in row] for row in (heading, *table, sums)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        yield "the graph of MEMORIZE:"
        for row in cells:
            yield "   " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
    yield from stats.notes


def _query(query: CompiledQuery, stats: Stats | None) -> Iterator[str]:
    yield "engine: database" if query.lowered else f"engine: native: {query.reason}"
    if query.rewrites:
        yield f"rewrites: {', '.join(query.rewrites)}"
    found = with_room(lambda: sites(query.written)) if "inline" not in query.host.disabled else []
    names = dict.fromkeys(function.name for function in functions(query.written) if not function.builtin)
    for name in names:
        entry = query.host.functions.get(name)
        if entry is not None:
            yield from _function(entry, [site for site in found if site.function.name == name], query, stats)
    if query.native is not None and query.query.search is not None and query.query.search.repeats == "memorize":
        remembered = query.host.graphs is not None and calls(query.query)
        yield from _ends(query.query, stats, remembered)
    if stats is not None:
        yield from _remembered(query.query, stats)
    if query.lowered:
        yield "SQL:"
        yield from (f"  {line}" for line in query.sql().splitlines())


def _remembered(query: plan.Query, stats: Stats) -> Iterator[str]:
    """What became of the graph of MEMORIZE in the session's file."""
    if stats.graph is not None and query.search is not None and query.search.repeats == "memorize":
        steps = "1 step was" if stats.remembered_steps == 1 else f"{stats.remembered_steps:,} steps were"
        yield f"graph: remembered, with the number {stats.graph} in ss2sql_graphs; {steps} known from there"


def _ends(query: plan.Query, stats: Stats | None, remembered: bool) -> Iterator[str]:
    """Whether MEMORIZE searches from both ends, and why not."""
    reverse = reverse_of(query)
    if isinstance(reverse, str):
        yield f"searched from the start only: {reverse}"
        return
    if remembered:
        yield "searched from the start only: its graph is remembered"
        return
    undone = [call for expr in reverse.before if expr is not None for call in functions(expr)]
    names = dict.fromkeys(f"the {function.name}" for function in undone if function.inverse_of)
    how = f"by {' and '.join(names)}" if names else "because sums of whole numbers can be undone"
    if stats is None:
        yield f"searched from both ends, from the goal {how}"
    elif stats.backward:
        back = "1 level" if len(stats.backward) == 1 else f"{len(stats.backward)} levels"
        yield f"searched from both ends: {back} back from the goal {how}"


def _function(entry: UserFunction, found: list[Site], query: CompiledQuery, stats: Stats | None) -> Iterator[str]:
    """What became of the calls of one function."""
    body = entry.body
    for limit in dict.fromkeys(site.limit for site in found if site.reason is None):
        assert isinstance(body, Body)
        beyond = "" if limit is None else f"; called for numbers beyond {limit:,}"
        yield f"{entry.name}({', '.join(body.parameters)}) is inlined: {body.text}{beyond}"
    reasons = dict.fromkeys(site.reason for site in found if site.reason is not None)
    if not found:
        reasons = {f"it {body}" if isinstance(body, str) else _switched_off(query): None}
    for reason in reasons:
        yield f"{entry.name} is called: {reason}{_counts(entry.name, stats)}"
    yield f"  {entry.name} is {entry.volatility}: {'it ' if entry.inferred else ''}{entry.reason}"


def _switched_off(query: CompiledQuery) -> str:
    if "inline" in query.host.disabled:
        return "the rewrite inline is switched off"
    return "a built-in function or operator that it uses is replaced"


def _counts(name: str, stats: Stats | None) -> str:
    if stats is None:
        return ""
    called, remembered = stats.calls[name], stats.remembered[name]
    times = "1 call" if called == 1 else f"{called:,} calls"
    if name in stats.blocks:
        rows, blocks = "1 row" if called == 1 else f"{called:,} rows", stats.blocks[name]
        times = f"{rows} in {'1 call' if blocks == 1 else f'{blocks:,} calls'}"
    return f" ({times}, {remembered:,} remembered)" if remembered else f" ({times})"
