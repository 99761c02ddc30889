"""Reachability over edges in a table: five edges from every node, and behind them a chain that leads to the goal."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from pathlib import Path

from problems.base import Prepare, Problem, Script, Target, Work, bounds
from problems.graphs import Graph, libraries
from problems.levels import duck
from problems.tables import opened, table_file

CHAIN = 30  # so long that the goal is farther than all else: a search looks at every edge before


def nodes_of(edges: int) -> int:
    return edges // 5


def goal_of(edges: int) -> int:
    return nodes_of(edges) + CHAIN - 1


def edges_of(size: int) -> list[tuple[int, int]]:
    chance = random.Random(size)
    nodes = nodes_of(size)
    chain = [(1 if i == nodes else i - 1, i) for i in range(nodes, nodes + CHAIN)]
    edges = [(0, 1), *((chance.randrange(nodes), chance.randrange(nodes)) for _ in range(size - CHAIN - 1)), *chain]
    chance.shuffle(edges)
    return edges


def file_of(size: int, form: str) -> Path:
    columns = "src INTEGER, dst INTEGER"
    create = {
        "": (f"CREATE TABLE edges ({columns})", "CREATE INDEX edges_src ON edges (src)"),
        "-noindex": (f"CREATE TABLE edges ({columns})",),
        "-clustered": (f"CREATE TABLE edges ({columns}, PRIMARY KEY (src, dst)) WITHOUT ROWID",),
    }
    insert = "INSERT OR IGNORE INTO edges VALUES (?, ?)"
    return table_file(f"edges_{size}{form}", create[form], insert, lambda: edges_of(size))


def goal_script(form: str) -> Callable[[int], Script]:
    text = """SELECT dst FROM (SELECT * FROM edges WHERE src == node)
        WHERE dst == goal
        START WITH node = 0
        CONNECT BY UNIQUE MAXIMUM 1 node = dst
        AS list;"""
    return lambda size: Script(text, (), {"goal": goal_of(size)}, file_of(size, form))


def all_script(form: str) -> Callable[[int], Script]:
    text = """SELECT dst FROM (SELECT * FROM edges WHERE src == node)
        START WITH node = 0
        CONNECT BY UNIQUE node = dst
        AS list;"""
    return lambda size: Script(text, (), {}, file_of(size, form))


def goal_by_hand(form: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection, goal = opened(file_of(size, form)), goal_of(size)

        def run() -> list[list[int]]:
            after: dict[int, list[int]] = {}
            for src, dst in connection.execute("SELECT src, dst FROM edges"):
                if src in after:
                    after[src].append(dst)
                else:
                    after[src] = [dst]
            parents: dict[int, int] = {}
            queue = deque([0])
            while queue:
                node = queue.popleft()
                for dst in after.get(node, ()):
                    if dst in parents:
                        continue
                    parents[dst] = node
                    if dst == goal:
                        path = [dst]
                        while node:
                            path.append(node)
                            node = parents[node]
                        return [path[::-1]]
                    queue.append(dst)
            return []

        return Work(run)

    return prepare


def all_by_hand(form: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection = opened(file_of(size, form))

        def run() -> list[list[int]]:
            after: dict[int, list[int]] = {}
            for src, dst in connection.execute("SELECT src, dst FROM edges"):
                if src in after:
                    after[src].append(dst)
                else:
                    after[src] = [dst]
            reached: set[int] = set()
            paths: list[list[int]] = []
            queue: deque[tuple[int, list[int]]] = deque([(0, [])])
            while queue:
                node, path = queue.popleft()
                for dst in after.get(node, ()):
                    if dst not in reached:
                        reached.add(dst)
                        longer = [*path, dst]
                        paths.append(longer)
                        queue.append((dst, longer))
            return paths

        return Work(run)

    return prepare


REACHED = """WITH RECURSIVE reached(node) AS (
    SELECT dst FROM edges WHERE src = 0 UNION SELECT edges.dst FROM reached JOIN edges ON edges.src = reached.node
)"""


def goal_in_sql(form: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection, goal = opened(file_of(size, form)), goal_of(size)
        text = f"{REACHED} SELECT node FROM reached WHERE node = ? LIMIT 1"
        return Work(lambda: connection.execute(text, (goal,)).fetchall(), bool)

    return prepare


def all_in_sql(form: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection = opened(file_of(size, form))
        text = f"{REACHED} SELECT node FROM reached"
        return Work(lambda: connection.execute(text).fetchall(), len)

    return prepare


def graph_of(size: int) -> Callable[[], Graph]:
    connection = opened(file_of(size, ""))
    nodes, goal = nodes_of(size) + CHAIN, goal_of(size)
    return lambda: Graph(nodes, connection.execute("SELECT src, dst FROM edges").fetchall(), 0, goal)


def in_duckdb(all_nodes: bool, key: str) -> Prepare:
    """The edges are loaded into a table of DuckDB before."""

    def prepare(size: int) -> Work:
        connection = duck()
        columns = [list(column) for column in zip(*edges_of(size), strict=True)]
        connection.execute("CREATE TABLE edges AS SELECT unnest(?) AS src, unnest(?) AS dst", columns)
        known = " LEFT JOIN recurring.reached AS old ON old.node = edges.dst WHERE old.node IS NULL" if key else ""
        text = f"""WITH RECURSIVE reached(node) {key} AS (
            SELECT dst FROM edges WHERE src = 0
            UNION
            SELECT DISTINCT edges.dst FROM reached JOIN edges ON edges.src = reached.node {known}
        )
        SELECT node FROM reached {"" if all_nodes else f"WHERE node = {goal_of(size)}"}"""
        return Work(lambda: connection.execute(text).fetchall(), len if all_nodes else bool)

    return prepare


def duckdbs(all_nodes: bool) -> dict[str, Prepare]:
    return {"duckdb": in_duckdb(all_nodes, ""), "duckdb-key": in_duckdb(all_nodes, "USING KEY (node)")}


FORMS = {"": "index on src", "-noindex": "no index", "-clustered": "primary key (src, dst), no rowid"}

PROBLEMS = tuple(
    problem
    for form, about in FORMS.items()
    for problem in (
        Problem(
            f"reach{form}",
            f"is the last node of a graph in a table reachable? {about}",
            "edges",
            (100_000,) if form else (10_000, 100_000, 1_000_000),
            500,
            goal_script(form),
            {
                "python": goal_by_hand(form),
                "sql": goal_in_sql(form),
                **({} if form else duckdbs(False) | libraries(graph_of, lambda path, size: bool(path))),
            },
            "whether there is a path; ss2sql and Python give it too",
            bool,
            full=(1_000_000,) if form else (3_000_000,),
            targets=(*bounds(1.3, 0.9, since=100_000), Target(1.5, "sql", since=100_000)),
        ),
        Problem(
            f"reach-all{form}",
            f"the shortest paths to all nodes of a graph in a table; {about}",
            "edges",
            (100_000,),
            500,
            all_script(form),
            {
                "python": all_by_hand(form),
                "sql": all_in_sql(form),
                **({} if form else duckdbs(True)),
            },
            "the number of nodes; ss2sql and Python give the paths too",
            len,
            full=(1_000_000,),
        ),
    )
)
