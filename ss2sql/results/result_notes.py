"""What a person should know of a result: why a search may have found too little, and the cure."""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql.frontend.resolve.search_clauses import FUNCTIONS
from ss2sql.language import plan
from ss2sql.language.plan_traversal import (
    find_growing_states,
    find_unnamed,
    list_states,
    split_and,
    split_stop_conditions,
    walk,
    write_in_script,
)
from ss2sql.language.rows import Rows
from ss2sql.runtime.run.run_state import Stats

REPEAT_KEYWORDS = {"unique": "UNIQUE", "no cycle": "NO CYCLE", "memorize": "MEMORIZE"}


def find_notes(query: plan.Query) -> tuple[str, ...]:
    """What can be said of a query, and of those inside of it, before it runs."""
    searches = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    notes = [note for each in searches for note in _note_undetermined_states(each)]
    calls = (node.function for each in searches for node in walk(each) if isinstance(node, plan.Call))
    notes += [
        f"{call.name} is the function that was registered under this name; give it another name to ask for the path"
        for call in calls
        if call.name in FUNCTIONS and not call.builtin
    ]
    return tuple(dict.fromkeys(notes))


def explain_empty_result(query: plan.Query, rows: Rows, stats: Stats, before: int) -> Iterator[str]:
    """Why a query has found nothing, where bounds of its search may be the reason.

    `before` it ran so many steps had been generated.
    """
    search = query.search
    if search is None or rows.rows or rows.paths or rows.groups:
        return
    variables_read = () if search.made is None or search.first is not None else sorted(list_states(search.made))
    prior = next((name for _, name in variables_read if name.startswith("prior(")), None)
    if prior is not None:
        yield (
            f"in first steps {prior} is None, and nothing was found with it in the condition of CONNECT BY; "
            "START WITH may have a condition of its own, for instance START WITH boss == None"
        )
    if stats.generated == before:
        return
    if rows.ended and search.maximum is not None and query.having is not None:
        most, having = write_in_script(search.maximum), write_in_script(query.having)
        cure = _note_larger_bound("MAXIMUM")
        yield f"MAXIMUM {most} ended the search, and HAVING {having} dropped what it had found; {cure}"
    if search.bound is not None and _is_graph_bounded(query, stats):
        cure = _note_larger_bound("MEMORIZE")
        yield f"MEMORIZE {write_in_script(search.bound)} ended paths before any reached its goal; {cure}"
        return
    grown = {(query.id, name) for name in find_growing_states(query)}
    bounds = [("STOP WITH {}", stop) for stop in split_stop_conditions(query)]
    bounds += [("{} in CONNECT BY", part) for part in split_and(search.made)]
    for place, bound in bounds:
        read = {state for state in list_states(bound) if state[0] == query.id}
        if read and read <= grown:
            words = place.format(write_in_script(bound))
            yield f"nothing was found before {words} ends a path; a wider bound in it may let paths go on"


def explain_overestimates(query: plan.Query) -> Iterator[str]:
    """That A* has found a path which costs less than its estimate of what remained."""
    for node in walk(query):
        if isinstance(node, plan.Query) and node.search and node.search.heuristic and node.search.weight:
            estimate = write_in_script(node.search.heuristic)
            yield (
                f"HEURISTIC {estimate} was more than what remained to be paid on a path, so others may be cheaper than "
                "the first that came; the least costs need an estimate that is never too high, or COST alone"
            )


def suggest_timeout_cure(query: plan.Query | None) -> str:
    """What a query lacks that took longer than its timeout: no option that it has already."""
    searches = [(node, node.search) for node in walk(query) if isinstance(node, plan.Query) and node.search]
    if not searches:
        return "raise timeout=, or narrow the query with WHERE or LIMIT"
    owner, search = searches[0]
    grown = sorted(find_growing_states(owner))
    lacks = ["MAXIMUM"] if search.maximum is None else []
    state = next((name for name, _ in search.connect if name.isidentifier()), "")
    lacks += [f"UNIQUE BY {state}" if state else "UNIQUE"] if search.repeats == "allowed" else []
    lacks += ["STOP WITH"] if search.stop is None and search.bound is None else []
    if grown and search.repeats != "allowed" and search.stop is None and search.made is None and search.bound is None:
        return f"raise timeout=, or bound {grown[0]} by a condition in CONNECT BY, such as {grown[0]} < 1000"
    if lacks:
        return f"raise timeout=, or bound the search with {' or '.join(lacks)}"
    if search.order == "cost" and search.heuristic is None:
        return "raise timeout=, or estimate what remains: COST ... HEURISTIC ..."
    return "raise timeout=, or let a condition in CONNECT BY drop steps that cannot lead to a goal"


def _note_larger_bound(word: str) -> str:
    return f"a larger bound in {word} lets it go on"


def _is_graph_bounded(query: plan.Query, stats: Stats) -> bool:
    """Whether the graph of MEMORIZE could have grown further."""
    inner = [node for node in walk(query) if isinstance(node, plan.Query) and node.search is not None]
    levels = [*stats.levels, *stats.backward]
    return len(inner) == 1 and bool(levels) and levels[-1].rows > 0


def _note_undetermined_states(query: plan.Query) -> Iterator[str]:
    """That a search compares rows which do not tell the state that its clauses read."""
    search = query.search
    assert search is not None
    if search.repeats == "allowed" or search.by != "row":
        return
    found = find_unnamed(query)
    counted = find_growing_states(query, evenly=True)
    read = {expr: clauses for expr, clauses in found.items() if not _is_step_count(expr, clauses, counted, search)}
    # Columns of an element tend to follow from each other, as a name and its key.
    if not any(isinstance(expr, plan.State) for expr in read):
        return
    word, names = REPEAT_KEYWORDS[search.repeats], _join_note_words(list(dict.fromkeys(map(write_in_script, read))))
    clauses = _join_note_words(list(dict.fromkeys(clause for several in read.values() for clause in several)))
    verb = "read" if " and " in clauses else "reads"
    lengths = all(isinstance(expr, plan.State) and expr.name in counted for expr in read)
    bounded = search.repeats == "memorize" and lengths
    cure = f"let MEMORIZE bound the paths in place of {names}" if bounded else f"name {names} in SELECT"
    yield (
        f"{word} compares rows, and {clauses} {verb} {names}, which SELECT does not name, "
        f"so paths may be missing or end elsewhere; {cure}"
    )


def _is_step_count(expr: plan.Expr, clauses: tuple[str, ...], counted: frozenset[str], search: plan.Search) -> bool:
    """Whether it only counts steps, where a row that comes again later is not worth more.

    So it is on a path with NO CYCLE, and in STOP WITH where UNIQUE reaches each row by the fewest steps.
    """
    if not isinstance(expr, plan.State) or expr.name not in counted:
        return False
    fewest = search.repeats == "unique" and search.order == "breadth first" and "WHERE" not in clauses
    return search.repeats == "no cycle" or fewest


def _join_note_words(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
