"""The plan of a query that SQLite does not run, in the same words as SQLite's plan."""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql.language import plan
from ss2sql.lowering.portable.pushdown import PushdownQuery
from ss2sql.results.explain.findings import PlanLine
from ss2sql.results.explain.vocabulary import cut_script, describe_queue
from ss2sql.runtime.external.level_query import LevelPlan
from ss2sql.runtime.external.level_statements import WORDS

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


def describe_table_plan(query: plan.Query, tables: LevelPlan) -> tuple[PlanLine, ...]:
    """The plan of a search from level to level in tables."""
    assert query.search
    because = "SQL" if tables.sql_hindrance is None else f"Python: {tables.sql_hindrance}"
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
    loaded = {id(table.value) for table in written.loaded}
    return (
        PlanLine(0, "finds the rows with one SELECT over"),
        *(line for source in query.sources for line in _describe_duckdb_source(source, loaded, 1)),
        *_describe_post_processing(query),
    )


def _describe_duckdb_source(source: plan.Source, loaded: set[int], depth: int) -> Iterator[PlanLine]:
    """The lines of a source, and of a query's sources."""
    if isinstance(source, plan.QuerySource):
        yield PlanLine(depth, f"the rows of ({cut_script(source.query.span.text, LONGEST)}), over")
        for inner in source.query.sources:
            yield from _describe_duckdb_source(inner, loaded, depth + 1)
        return
    assert isinstance(source, plan.ValueSource), "others are refused"
    words = cut_script(source.value.span.text or source.name, LONGEST)
    if id(source.value) in loaded:
        yield PlanLine(depth, f"the elements of {words}, which it is given in a table")
    elif isinstance(source.value, plan.Variable):
        yield PlanLine(depth, f"{words}, which it reads itself")
    else:
        yield PlanLine(depth, f"the elements of {words}, which are written out")


def _describe_loops(query: plan.Query, depth: int, inner: bool = False) -> Iterator[PlanLine]:
    """The loops, each one inside of those before it."""
    for number, source in enumerate(query.sources):
        yield PlanLine(depth, f"{'for each of them, ' if number or inner else ''}{_describe_loop(source)}")


def _describe_loop(source: plan.Source) -> str:
    match source:
        case plan.TableSource():
            words = f"reads every row of {source.table}"
        case plan.WorldSource():
            words = f"reads every element of {source.table.title}"
        case plan.QuerySource():
            words = f"finds the rows of ({cut_script(source.query.span.text, LONGEST)})"
        case plan.ValueSource():
            words = f"walks the elements of {cut_script(source.value.span.text or source.name, LONGEST)}"
    return words if source.name == "this" or words.endswith(source.name) else f"{words} (as {source.name})"


def _describe_post_processing(query: plan.Query) -> Iterator[PlanLine]:
    if query.group:
        yield PlanLine(0, "puts them into groups")
    if query.order:
        yield PlanLine(0, "sorts them for ORDER BY")
    if query.limit is not None:
        yield PlanLine(0, "keeps as many as LIMIT says")
