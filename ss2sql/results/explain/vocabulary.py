"""The vocabulary for rewrites, searches and stages."""

from __future__ import annotations

from ss2sql.language import plan
from ss2sql.lowering.strategies import get_order, get_repeat_rule

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
        found[order.keyword] = _make_sentence(order.promise.partition(";")[0])  # the rest is about HEURISTIC
    if search.repeats == "memorize" and search.weight is not None:
        promise = "every path without a repeated row up to the bound"
        found[guard.keyword] = f"{promise}, {'the cheapest' if search.order == 'cost' else 'the likeliest'} first"
    elif guard.keyword:
        found[guard.keyword] = _make_sentence(guard.promise)
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


def cut_script(text: str, most: int) -> str:
    """A piece of a script on one line, of at most so many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def _make_sentence(text: str) -> str:
    return text[0].lower() + text[1:].rstrip(".")
