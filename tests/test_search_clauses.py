"""Searches with conditions, keys behind BY, several starts, and what a step says: loops and laws, and random ones."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from agreement import trial
from cases.needs import for_reference
from golden import cases
from hypothesis import given, seed
from programs import ProgramCase
from programs.drawn import SEED, amount, drawn
from programs.hierarchies import hierarchies

import ss2sql

FLIGHTS = for_reference(["flights"])["tables"]["flights"]
STAFF = for_reference(["employees"])["tables"]["employees"]
TASKS = for_reference(["tasks"])["tables"]["tasks"]


# --- golden cases against loops ------------------------------------------------------------------------


def cheapest_distances() -> Any:
    queue, done, found = [(0, "a")], set[str](), []
    while queue:
        total, town = heapq.heappop(queue)
        if town in done:
            continue
        done.add(town)
        found += [(town, total)] * (town != "a")
        for flight in FLIGHTS:
            if flight["src"] == town:
                heapq.heappush(queue, (total + flight["fare"], flight["dst"]))
    return found


def walks(town: str, visited: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """The simple paths from a town, without it, depth first."""
    for flight in FLIGHTS:
        if flight["src"] == town and flight["dst"] not in visited:
            yield (flight["dst"],)
            yield from ((flight["dst"], *rest) for rest in walks(flight["dst"], (*visited, flight["dst"])))


def simple_paths() -> Any:
    return ["".join(path) for path in walks("a", ("a",))]


def cheapest_with_few_legs() -> Any:
    best: dict[str, int] = {}
    fewest: dict[str, int] = {}

    def go(town: str, visited: tuple[str, ...], fares: int) -> None:
        for flight in FLIGHTS if len(visited) <= 2 else ():
            if flight["src"] == town and flight["dst"] not in visited:
                total, dst = fares + flight["fare"], flight["dst"]
                best[dst] = min(total, best.get(dst, total))
                fewest[dst] = min(len(visited), fewest.get(dst, len(visited)))
                go(dst, (*visited, dst), total)

    go("a", ("a",), 0)
    return [(town, best[town], fewest[town]) for town in sorted(best)]


def flights_by_time() -> Any:
    found, queue = [], deque([("a", 0, ())])
    while queue:
        town, now, path = queue.popleft()
        for flight in FLIGHTS:
            if flight["src"] == town and flight["leaves"] >= now and len(path) < 4:
                longer = (*path, (flight["dst"], flight["arrives"]))
                found += [list(longer)] * (flight["dst"] == "d")
                queue.append((flight["dst"], flight["arrives"], longer))
    return found


def below(boss: Any, level: int, path: tuple[str, ...]) -> Iterator[tuple[Any, ...]]:
    for person in sorted((one for one in STAFF if one["boss"] == boss), key=lambda one: one["name"]):
        names = (*path, person["name"])
        leaf = all(other["boss"] != person["id"] for other in STAFF)
        prior = path[-1] if path else None
        yield person["name"], level, names[0], "/".join(names), prior, leaf
        yield from below(person["id"], level + 1, names)


def roll_up() -> Any:
    def team(person: dict[str, Any]) -> list[dict[str, Any]]:
        return [person, *(one for other in STAFF if other["boss"] == person["id"] for one in team(other))]

    teams = ((person["name"], team(person)) for person in STAFF)
    return [(name, len(people), sum(one["salary"] or 0 for one in people)) for name, people in teams]


def several_starts() -> Any:
    found, seen = [], {"b", "d"}
    queue = deque([("b", "b", 1), ("d", "d", 1)])
    while queue:
        town, start, level = queue.popleft()
        for flight in FLIGHTS:
            if flight["src"] == town and flight["dst"] not in seen:
                seen.add(flight["dst"])
                found.append((start, flight["dst"], level))
                queue.append((flight["dst"], start, level + 1))
    return found


def components() -> Any:
    pairs, seen, found = [[1, 2], [2, 3], [4, 5], [6, 6], [5, 7]], {1, 4, 6}, []
    queue = deque((start, start) for start in (1, 4, 6))
    while queue:
        root, node = queue.popleft()
        for pair in pairs:
            other = pair[1] if pair[0] == node else pair[0]
            if node in pair and other not in seen:
                seen.add(other)
                found.append((root, other))
                queue.append((root, other))
    return found


def levels_of_tasks() -> Any:
    def level(task: str) -> int:
        needed = [row["needs"] for row in TASKS if row["task"] == task]
        return 1 + max((level(one) for one in needed if one is not None), default=0)

    return {(row["task"], level(row["task"])) for row in TASKS}


def each_cycle_once() -> Any:
    found: list[str] = []

    def go(root: str, town: str, path: str) -> None:
        for flight in FLIGHTS:
            dst = flight["dst"]
            if flight["src"] == town and dst >= root and dst not in path:
                found.extend([path + dst] * (dst == root))
                if dst != root:
                    go(root, dst, path + dst)

    for root in "abcde":
        go(root, root, "")
    return sorted(found)


LOOPS: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "cheapest-distances": (cheapest_distances, list), "cheapest-with-few-legs": (cheapest_with_few_legs, list),
    "simple-paths": (simple_paths, list), "flights-by-time": (flights_by_time, list),
    "organisation-chart": (lambda: list(below(None, 1, ())), list), "roll-up": (roll_up, list),
    "several-starts": (several_starts, list), "components": (components, list),
    "levels-of-tasks": (levels_of_tasks, set), "each-cycle-once": (each_cycle_once, sorted),
}  # fmt: skip


@pytest.mark.parametrize("name", LOOPS)
def test_a_golden_case_gives_what_a_loop_gives(name: str, engine: Any) -> None:
    (case,) = [case for case in cases() if case.name == f"hierarchies/{name}"]
    assert len([line for line in case.script.splitlines() if line.strip()]) <= 6
    with ss2sql.connect(engine="auto" if "MEMORIZE" in case.script else engine) as ss:
        for table, rows in for_reference(case.needs)["tables"].items():
            ss.attach(table, rows)
        loop, form = LOOPS[name]
        assert form(ss.eval(case.script)) == loop()


# --- laws ----------------------------------------------------------------------------------------------

EDGES = [{"src": src, "dst": dst, "km": km} for src, dst, km in [(0, 1, 4), (0, 2, 1), (2, 1, 2), (1, 3, 5), (3, 0, 1),
                                                                (2, 3, 8), (3, 4, 1), (4, 2, 1)]]  # fmt: skip
QUERY = "SELECT {shown} FROM edges START WITH town = 0 CONNECT BY {options}, src == town, town = dst{stop} AS rows"


def test_laws_between_options(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.set("edges", EDGES)

        def found(options: str, shown: str = "src, dst", stop: str = "") -> Any:
            chosen = "auto" if "MEMORIZE" in options else engine
            return ss.run(QUERY.format(shown=shown, options=options, stop=stop), engine=chosen).value

        assert found("UNIQUE BY (src, dst)") == found("UNIQUE")
        for bound in range(1, 5):
            simple = [path for path in found("NO CYCLE BY town") if len(path) <= bound]
            assert found(f"MEMORIZE {bound} BY town") == sorted(simple, key=len)
        every = found("BREADTH FIRST", "dst", " STOP WITH level() == 5")
        reached = {path[-1] for path in every} - {(0,)}  # the start counts as visited
        assert {path[-1] for path in found("UNIQUE BY town", "dst")} == reached
        assert found("UNIQUE BY town, MAXIMUM 2") == found("UNIQUE BY town")[:2]
        assert [len(path) for path in found("COST 1 UNIQUE BY town")] == [len(path) for path in found("UNIQUE BY town")]
        costs = [[sum(step[1] for step in path) for path in found(f"COST km {guess} UNIQUE BY town", "dst, km")]
                 for guess in ("", "HEURISTIC 1 - level() / 9")]  # fmt: skip
        assert sorted(costs[0]) == sorted(costs[1])


def test_memorize_counts_paths_without_a_column_of_the_step() -> None:
    script = "SELECT level(), count(*) FROM e START WITH t = 0 CONNECT BY MEMORIZE 2 BY t, a == t, t = b"
    with ss2sql.connect() as ss:
        assert ss.run(f"{script} GROUP BY level() AS rows", e=[{"a": 0, "b": 1}] * 2).value == [(1, 2)]


def test_a_star_takes_the_smaller_estimate_first(engine: Any) -> None:
    moves = [{"dx": dx, "dy": dy} for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    with ss2sql.connect() as ss:
        ss.set("moves", moves)
        result = ss.run(
            """SELECT x + dx, y + dy FROM moves WHERE x + dx == 39 AND y + dy == 39
               START WITH x = 0, y = 0
               CONNECT BY COST 1 HEURISTIC abs(39 - x - dx) + abs(39 - y - dy) UNIQUE BY (x, y) MAXIMUM 1,
                   x + dx >= 0 AND x + dx < 40 AND y + dy >= 0 AND y + dy < 40, x = x + dx, y = y + dy AS rows""",
            engine=engine,
        )
        assert len(result.paths[0]) == 78
        assert result.stats.expanded <= 100


# --- random searches -----------------------------------------------------------------------------------


@pytest.mark.drawn
def test_three_evaluators_agree_on_searches_of_edges() -> None:
    in_the_database = 0

    @seed(SEED)
    @drawn(amount())
    @given(hierarchies())
    def run(case: ProgramCase) -> None:
        nonlocal in_the_database
        tried = trial(case)
        in_the_database += tried.outcomes["database"] is not None
        assert tried.differences == []

    run()
    assert in_the_database > amount() / 4
