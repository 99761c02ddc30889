"""Lists that find each other, most by equality: joins, inner queries and searches; time should grow with their size."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from problems.base import Prepare, Problem, Script, Work, same

Data = Mapping[str, list[Any]]


@lru_cache
def data(size: int) -> Data:
    """Numbers in disorder, rows and pairs that have them, a tree, and rows in ten groups."""
    numbers = [number * 7919 % size for number in range(size)]
    return {
        "ns": numbers,
        "es": [{"a": number, "b": 2 * number} for number in range(size)],
        "pairs": [[number, number + 1] for number in range(size)],
        "tree": [[(number - 1) // 2, number] for number in range(1, size)],
        "staff": [{"name": number, "boss": (number - 1) // 2 if number else None} for number in range(size)],
        "places": [{"t": number + number % 7 / 10, "x": 2 * number} for number in range(size)],
        "pictures": [{"t": number + number * 7919 % 10 / 10, "id": number} for number in range(size)],
        "scores": [{"k": number % 10, "x": number * 7919 % size} for number in range(size)],
    }


def inner_query(data: Data) -> list[Any]:
    by_key = defaultdict(list)
    for row in data["es"]:
        by_key[row["a"]].append(row)
    return [(number, by_key[number]) for number in data["ns"]]


def join(data: Data) -> list[Any]:
    by_key = defaultdict(list)
    for pair in data["pairs"]:
        by_key[pair[0]].append(pair)
    return [(number, pair[1]) for number in data["ns"] for pair in by_key[number]]


def paths(start: Any, children: Mapping[Any, list[tuple[Any, Any]]]) -> list[Any]:
    """The paths of a breadth-first search; children are pairs of what is shown and the next state."""
    found, queue = [], [(start, ())]
    for state, path in queue:
        for shown, after in children.get(state, ()):
            found.append([*path, shown])
            queue.append((after, (*path, shown)))
    return found


def search(data: Data) -> list[Any]:
    children = defaultdict(list)
    for pair in data["tree"]:
        children[pair[0]].append((pair, pair[1]))
    return paths(0, children)


def hierarchy(data: Data) -> list[Any]:
    children = defaultdict(list)
    for row in data["staff"]:
        children[row["boss"]].append((row["name"], row["name"]))
    return paths(None, children)


def greatest(data: Data) -> list[Any]:
    best: dict[int, int] = {}
    for row in data["scores"]:
        best[row["k"]] = max(best.get(row["k"], row["x"]), row["x"])
    return [(row["k"], row["x"]) for row in data["scores"] if row["x"] == best[row["k"]]]


def membership(data: Data) -> list[Any]:
    doubled = {row["b"] for row in data["es"]}
    return [number for number in data["ns"] if number in doubled]


def last_before(data: Data) -> list[Any]:
    times = [place["t"] for place in data["places"]]
    found = ((picture["id"], bisect_right(times, picture["t"])) for picture in data["pictures"])
    return [(number, data["places"][end - 1]["x"] if end else None) for number, end in found]


@dataclass(frozen=True)
class Question:
    about: str
    text: str
    by_hand: Callable[[Data], list[Any]]


QUESTIONS = {
    "inner": Question(
        "an inner query by a key of the rows",
        'SELECT n.this, (SELECT this FROM es WHERE this["a"] == n.this AS list) FROM n = ns AS rows;',
        inner_query,
    ),
    "lists": Question(
        "two lists by an element",
        "SELECT n.this, e.this[1] FROM n = ns, e = pairs WHERE e.this[0] == n.this AS rows;",
        join,
    ),
    "search": Question(
        "a search whose steps are looked up in a list",
        "SELECT this FROM tree START WITH here = 0 CONNECT BY BREADTH FIRST here = this[1] STOP WITH this[0] != here"
        " AS list;",
        search,
    ),
    "root": Question(
        "a search from rows without a parent",
        "SELECT name FROM (SELECT * FROM staff WHERE (b == None AND boss == None) OR boss == b)"
        " START WITH b = None CONNECT BY BREADTH FIRST b = name AS list;",
        hierarchy,
    ),
    "greatest": Question(
        "the rows with the greatest value of their group",
        "SELECT k, x FROM n = scores WHERE x == max(SELECT e.x FROM e = scores WHERE e.k == n.k AS list) AS rows;",
        greatest,
    ),
    "membership": Question(
        "membership in what a query finds",
        "SELECT this FROM ns WHERE this IN (SELECT b FROM es AS list) AS list;",
        membership,
    ),
    "times": Question(
        "the last row before each time",
        "SELECT p.id, (SELECT x FROM o = places WHERE o.t <= p.t ORDER BY o.t DESC LIMIT 1 AS value) AS x"
        " FROM p = pictures AS rows;",
        last_before,
    ),
}


def of_lists(text: str) -> Callable[[int], Script]:
    return lambda size: Script(text, variables=data(size))


def by_hand(work: Callable[[Data], list[Any]]) -> Prepare:
    return lambda size: Work(lambda: work(data(size)))


PROBLEMS = tuple(
    Problem(
        f"joins-{name}",
        f"lists that find each other: {question.about}",
        "elements of each list",
        (2_000, 4_000, 8_000),
        20,
        of_lists(question.text),
        {"python": by_hand(question.by_hand)},
        "the rows or paths, in order",
        same,
    )
    for name, question in QUESTIONS.items()
)
