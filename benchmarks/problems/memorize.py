"""MEMORIZE: the first thousand paths of a robot, all plans of Hanoi up to a length, and one plan.

networkx and igraph get their graphs ready-made here; ss2sql makes its own by asking the script's functions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any

from problems.base import Prepare, Problem, Script, Target, Work, bounds, lengths
from problems.hanoi import MOVES, goal_of, move, start_of, unique_by_hand

Cell = list[int]

# --- by hand: distances back from the goals, then only steps that can still end there in time ---------------------


def within(nexts: Callable[[Any], list[tuple[Any, Any, bool]]], start: Any, bound: int) -> Iterator[list[Any]]:
    """The paths of at most `bound` steps from the start to a goal, the shorter ones first.

    `nexts` gives what can be reached from a place by one step: a key, the place, whether it is a goal.
    """
    edges, far, goals = explored(nexts, start, bound)
    shortest = min((far[key] + 1 for key in edges[None] if key in far), default=bound + 1)
    for length in range(shortest, bound + 1):
        path: list[Any] = []
        on_path = set()
        stack = [iter(edges[None])]
        while stack:
            left = length - len(stack)
            for key in stack[-1]:
                if key in on_path or far.get(key, bound) > left:
                    continue
                if not left:
                    if key in goals:
                        yield [*path, key]
                    continue
                path.append(key)
                on_path.add(key)
                stack.append(iter(edges.get(key, ())))
                break
            else:
                stack.pop()
                if path:
                    on_path.discard(path.pop())


def explored(
    nexts: Callable[[Any], list[tuple[Any, Any, bool]]], start: Any, bound: int
) -> tuple[dict[Any, list[Any]], dict[Any, int], set[Any]]:
    """The keys behind each key, the steps from each to the nearest goal, and the goals."""
    edges: dict[Any, list[Any]] = {}
    into: dict[Any, list[Any]] = {}
    goals = set()
    level = [(None, start)]
    for _ in range(bound):
        following = []
        for key, place in level:
            edges[key] = []
            for after, there, is_goal in nexts(place):
                edges[key].append(after)
                if after not in into:
                    into[after] = []
                    following.append((after, there))
                    if is_goal:
                        goals.add(after)
                into[after].append(key)
        level = following
    far = dict.fromkeys(goals, 0)
    queue = list(goals)
    for key in queue:
        for before in into.get(key, ()):
            if before not in far:
                far[before] = far[key] + 1
                queue.append(before)
    return edges, far, goals


def by_length(found: Sequence[Sequence[Any]]) -> dict[int, int]:
    """How many paths there are of each length."""
    return dict(sorted(Counter(map(len, found)).items()))


# --- the robot ----------------------------------------------------------------------------------------------------

STEPS = [[0, 1], [0, -1], [1, -1], [-1, -1], [1, 0], [-1, 0], [-1, 1], [1, 1]]
WAYS = 1000


def moved(cell: Cell, step: Cell) -> Cell:
    return [cell[0] + step[0], cell[1] + step[1]]


def collides_on(size: int) -> Callable[[Cell], bool]:
    wall = {(size // 2, y) for y in range(2, size - 2)}

    def collides(cell: Cell) -> bool:
        x, y = cell
        return not (0 <= x < size and 0 <= y < size) or (x, y) in wall

    return collides


def ends_of(size: int) -> tuple[Cell, Cell]:
    return [0, size // 2], [size - 1, size // 2]


def bound_of(size: int) -> int:
    return size * 5 // 4


def robot_script(size: int) -> Script:
    start, target = ends_of(size)
    return Script(
        f"""SELECT moved(cell, this) FROM steps WHERE target == moved(cell, this)
            START WITH cell = start
            CONNECT BY MEMORIZE {bound_of(size)} MAXIMUM {WAYS} cell = moved(cell, this)
            STOP WITH  target == moved(cell, this) OR collides(moved(cell, this))
            AS list;""",
        (moved, (collides_on(size), "immutable")),
        {"steps": STEPS, "start": start, "target": target},
    )


def robot_by_hand(size: int) -> Work:
    start, target = ends_of(size)
    collides = collides_on(size)

    def nexts(cell: Cell) -> list[tuple[tuple[int, ...], Cell, bool]]:
        if cell == target:
            return []
        reached = [moved(cell, step) for step in STEPS]
        return [(tuple(after), after, after == target) for after in reached if not collides(after)]

    return Work(lambda: list(islice(within(nexts, start, bound_of(size)), WAYS)))


def robot_edges(size: int) -> tuple[list[tuple[int, int]], int, int]:
    """The edges of the ready-made graph, and its ends."""
    collides = collides_on(size)
    cells = [[x, y] for x in range(size) for y in range(size) if not collides([x, y])]
    numbers = {tuple(cell): number for number, cell in enumerate(cells)}
    reached = ((cell, tuple(moved(cell, step))) for cell in cells for step in STEPS)
    edges = [(numbers[tuple(cell)], numbers[after]) for cell, after in reached if after in numbers]
    start, target = (numbers[tuple(cell)] for cell in ends_of(size))
    return edges, start, target


def robot_in_networkx(size: int) -> Work:
    import networkx as nx

    edges, start, target = robot_edges(size)
    graph = nx.DiGraph(edges)
    return Work(lambda: list(islice(nx.shortest_simple_paths(graph, start, target), WAYS)), without_start)


def robot_in_igraph(size: int) -> Work:
    import igraph

    edges, start, target = robot_edges(size)
    graph = igraph.Graph(edges=edges, directed=True)
    return Work(lambda: graph.get_k_shortest_paths(start, target, WAYS), without_start)


def without_start(paths: list[list[Any]]) -> dict[int, int]:
    return by_length([path[1:] for path in paths])


# --- Hanoi ----------------------------------------------------------------------------------------------------------

Towers = list[list[int]]
BOUNDS = {3: 12, 4: 18, 5: 33}  # of the reference counts: 600, 285 and 177 plans


def hanoi_script(disks: int) -> Script:
    return Script(
        f"""SELECT this, tower FROM moves WHERE goal == move(this, tower)
            START WITH tower = start
            CONNECT BY MEMORIZE {BOUNDS[disks]} tower = move(this, tower)
            STOP WITH  [] == move(this, tower);""",
        (move,),
        {"moves": MOVES, "start": start_of(disks), "goal": goal_of(disks)},
    )


def hanoi_steps(disks: int) -> Callable[[Towers], list[tuple[Any, Towers, bool]]]:
    """What the script compares are moves with the towers before them."""
    goal = goal_of(disks)

    def nexts(towers: Towers) -> list[tuple[Any, Towers, bool]]:
        before = tuple(map(tuple, towers))
        reached = [(number, move(step, [tower[:] for tower in towers])) for number, step in enumerate(MOVES)]
        return [((number, before), after, after == goal) for number, after in reached if after]

    return nexts


def hanoi_by_hand(disks: int) -> Work:
    return Work(lambda: list(within(hanoi_steps(disks), start_of(disks), BOUNDS[disks])))


def hanoi_in_networkx(disks: int) -> Work:
    import networkx as nx

    edges, _, goals = explored(hanoi_steps(disks), start_of(disks), 3**disks)
    start = (-1, ())  # None cannot be a node
    graph = nx.DiGraph((key or start, after) for key, following in edges.items() for after in following)
    return Work(lambda: list(nx.all_simple_paths(graph, start, goals, BOUNDS[disks])), without_start)


def one_script(disks: int) -> Script:
    return Script(
        f"""SELECT move(this, tower) FROM moves WHERE goal == move(this, tower)
            START WITH tower = start
            CONNECT BY MEMORIZE {2**disks - 1} MAXIMUM 1 tower = move(this, tower)
            STOP WITH  [] == move(this, tower);""",
        (move,),
        {"moves": MOVES, "start": start_of(disks), "goal": goal_of(disks)},
    )


OTHERS: dict[str, Prepare] = {
    "python": robot_by_hand,
    "networkx": robot_in_networkx,
    "igraph": robot_in_igraph,
}

PROBLEMS = (
    Problem(
        "memorize-robot",
        f"the {WAYS:,} shortest paths around a wall in 8 directions, the libraries on a ready-made graph",
        "cells a side",
        (16,),
        6,
        robot_script,
        OTHERS,
        "the number of paths of each length",
        by_length,
        full=(24,),
        targets=(*bounds(None, 3.3), Target(1 / 15, "igraph", "native"), Target(1 / 80, "networkx", "native")),
    ),
    Problem(
        "memorize-hanoi",
        "all plans of up to 12, 18 and 33 moves for 3, 4 and 5 disks, networkx on a ready-made graph",
        "disks",
        (3, 4, 5),
        3,
        hanoi_script,
        {"python": hanoi_by_hand, "networkx": hanoi_in_networkx},
        "the number of plans of each length",
        by_length,
        targets=(Target(1 / 20, "networkx", "native", since=4),),
    ),
    Problem(
        "memorize-one",
        "the shortest plan of Hanoi as the first of MEMORIZE, `move` in Python",
        "disks",
        (4, 6, 8),
        3,
        one_script,
        {"python": unique_by_hand},
        "the number of moves",
        lengths,
        full=(9, 10),
        targets=bounds(None, 1.4, since=8),
    ),
)
