"""The plan of a query in words: SQLite's own, and that of a query that runs elsewhere.

`EXPLAIN QUERY PLAN` gives a tree of short lines such as `SEARCH edge USING INDEX i (src=?)`. Each kind of line for
lowered queries has its sentence here; any other is shown unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ss2sql.language import plan
from ss2sql.lowering.portable.pushdown import PushdownQuery
from ss2sql.results.explain.findings import PlanLine, cut_explained_script, describe_queue
from ss2sql.results.explain.outline import OutlinedQuery
from ss2sql.runtime.external.level_query import WORDS, LevelStatements
from ss2sql.runtime.sqlite.interning import Interning

LONGEST = 60  # characters of a source


def describe_python_plan(query: plan.Query) -> tuple[PlanLine, ...]:
    """The loops over the sources, and around them the search."""
    search = query.search
    if search is None:
        return (*_describe_loops(query, 0), *_describe_post_processing(query))
    if search.repeats == "memorize":
        first = {"cost": "the cheapest", "probability": "the likeliest"}.get(search.order, "the shortest")
        lines = (
            PlanLine(0, "makes the graph of rows level by level; for each row that is new:"),
            *_describe_loops(query, 1),
            PlanLine(0, f"gives the paths of the graph, {first} first"),
        )
    else:
        lines = (
            PlanLine(0, "searches step by step:"),
            PlanLine(1, f"takes the steps that wait one by one, {describe_queue(query)}"),
            *_describe_loops(query, 1, inner=True),
            PlanLine(0, "gives the results as the search finds them"),
        )
    return (*lines, *_describe_post_processing(query))


def describe_table_plan(query: plan.Query, tables: LevelStatements) -> tuple[PlanLine, ...]:
    """The plan of a search from level to level in tables."""
    assert query.search
    because = "SQL" if tables.hindrance is None else f"Python: {tables.hindrance}"
    lines = (
        PlanLine(0, "searches level by level; all states of a level together:"),
        PlanLine(1, f"tries the steps from them, in {because}"),
        *_describe_loops(query, 2, inner=True),
        PlanLine(1, WORDS[query.search.repeats]),
        PlanLine(1, "gives the paths to the goals among them"),
    )
    return (*lines, *_describe_post_processing(query))


def describe_duckdb_plan(query: plan.Query, written: PushdownQuery) -> tuple[PlanLine, ...]:
    """The plan of a query that is one SELECT in DuckDB."""
    texts = [cut_explained_script(table.value.span.text, LONGEST) for table in written.loaded]
    given = (PlanLine(1, f"is given the elements of {text} in a table") for text in texts)
    return (PlanLine(0, "finds the rows with one SELECT"), *given, *_describe_post_processing(query))


def _describe_loops(query: plan.Query, depth: int, inner: bool = False) -> Iterator[PlanLine]:
    """The loops, each one inside of those before it."""
    for number, source in enumerate(query.sources):
        yield PlanLine(depth, f"{'for each of them, ' if number or inner else ''}{_describe_loop(source, query)}")


def _describe_loop(source: plan.Source, query: plan.Query) -> str:
    match source:
        case plan.TableSource():
            left_out = "" if query.where is None or query.search else "that SQLite does not leave out for WHERE, "
            words = f"reads every row {left_out}of {source.table}"
        case plan.WorldSource():
            words = f"reads every element of {source.table.title}"
        case plan.QuerySource():
            words = f"finds the rows of ({cut_explained_script(source.query.span.text, LONGEST)})"
        case plan.ValueSource():
            words = f"walks the elements of {cut_explained_script(source.value.span.text or source.name, LONGEST)}"
    return words if source.name == "this" or words.endswith(source.name) else f"{words} (as {source.name})"


def _describe_post_processing(query: plan.Query) -> Iterator[PlanLine]:
    if query.group:
        yield PlanLine(0, "puts them into groups")
    if query.order:
        yield PlanLine(0, "sorts them for ORDER BY")
    if query.limit is not None:
        yield PlanLine(0, "keeps as many as LIMIT says")


def describe_sqlite_plan(outlined: OutlinedQuery) -> tuple[PlanLine, ...]:
    """SQLite's plan of a query. Raises apsw.Error where it is unavailable: the session is closed, a table is gone."""
    assert outlined.lowered is not None
    explaining = replace(outlined.lowered, text=f"EXPLAIN QUERY PLAN {outlined.lowered.text}")
    cursor = outlined.host.database.open_cursor(explaining, Interning(), lambda parameter: 0)
    try:
        rows: list[tuple[int, int, int, str]] = list(cursor)
    finally:
        cursor.close(True)
    return tuple(_nest_plan_lines(rows, 0, 0, describe_queue(outlined.query)))


def _nest_plan_lines(
    rows: Sequence[tuple[int, int, int, str]], parent: int, depth: int, queue: str, recursive: bool = False
) -> Iterator[PlanLine]:
    """The lines below a parent. Loops over tables are nested: a later one runs for each row of the one before."""
    loops = 0
    for own, above, _, text in rows:
        if above != parent:
            continue
        waiting = recursive and text == "SCAN search"
        words = f"takes the steps that wait in a queue one by one, {queue}" if waiting else _put_line_in_words(text)
        if text.startswith(("SCAN ", "SEARCH ")):
            words = f"for each of them, {words}" if loops else words
            loops += 1
        yield PlanLine(depth, words, text)
        yield from _nest_plan_lines(rows, own, depth + 1, queue, recursive or text == "RECURSIVE STEP")


def _put_line_in_words(text: str) -> str:
    for pattern, words in SENTENCES:
        if found := re.fullmatch(pattern, text):
            return found.expand(words)
    return text


# The kinds of lines for lowered queries and their words; any other is shown as it is. Names are those of the SQL.
SENTENCES = (
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:each element", r"walks the elements of \1"),
    (
        r"SCAN (.+) VIRTUAL TABLE INDEX \d+:each element, (.*) IS NOT \?",
        r"walks the elements of \1, but not where \2 is ?",
    ),
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:all", r"reads every element of \1"),
    (r"SCAN (.+) VIRTUAL TABLE INDEX \d+:(.*)", r"asks for the elements of \1 with \2"),
    (r"SCAN CONSTANT ROW|SCAN \d+ CONSTANT ROWS?", "makes a row of what is known"),
    (r"SCAN search", "gives the results as the search finds them"),
    (r"SCAN (\S+)", r"reads every row of \1"),
    (r"SCAN (\S+) USING (?:COVERING )?INDEX (\S+)", r"reads every row of \1 in the order of its index \2"),
    (r"SEARCH (\S+) USING AUTOMATIC.*? \((.*)\).*", r"looks up \2 in an index of \1 that SQLite makes for this query"),
    (r"SEARCH (\S+) USING (?:COVERING )?INDEX (\S+) \((.*)\).*", r"looks up \3 in the index \2 of \1"),
    (r"SEARCH (\S+) USING .*PRIMARY KEY \((.*)\).*", r"looks up \2 in \1 by its primary key"),
    (r"BLOOM FILTER ON (\S+) .*", r"keeps a note of the values of \1, to skip lookups that find nothing"),
    (r"CO-ROUTINE search", "searches step by step:"),
    (r"CO-ROUTINE (.+)", r"makes the rows of \1 on demand:"),
    (r"MATERIALIZE (.+)", r"once, beforehand, and kept as \1:"),
    (r"SETUP|INITIAL RECURSIVE PART", "the start:"),
    (r"RECURSIVE STEP", "the steps:"),
    (r"CORRELATED (?:SCALAR|LIST) SUBQUERY \d+", "for each row, a query of its own:"),
    (r"(?:REUSE )?(?:SCALAR|LIST) SUBQUERY \d+", "once, a query of its own:"),
    (r"USE TEMP B-TREE FOR (.*)", r"sorts the rows for \1"),
)
