"""A company in a table: everybody with the chain of command above them. Eight people report to each manager."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from problems.base import Prepare, Problem, Script, Work, bounds
from problems.levels import duck
from problems.tables import opened, table_file


def file_of(size: int, indexed: bool) -> Path:
    create = ["CREATE TABLE employees (id INTEGER PRIMARY KEY, name TEXT, manager INTEGER)"]
    if indexed:
        create.append("CREATE INDEX employees_manager ON employees (manager)")
    name = f"employees_{size}{'_indexed' if indexed else ''}"
    return table_file(name, create, "INSERT INTO employees VALUES (?, ?, ?)", lambda: people(size))


def people(size: int) -> Iterator[tuple[int, str, int | None]]:
    for number in range(1, size + 1):
        yield number, f"e{number}", None if number == 1 else (number + 6) // 8


def script(indexed: bool) -> Callable[[int], Script]:
    text = """SELECT id, name FROM (SELECT * FROM employees WHERE manager == boss)
        START WITH boss = None
        CONNECT BY boss = id
        AS list;"""
    return lambda size: Script(text, file=file_of(size, indexed))


def by_hand(indexed: bool) -> Prepare:
    def prepare(size: int) -> Work:
        connection = opened(file_of(size, indexed))

        def run() -> list[list[Any]]:
            below: dict[int | None, list[tuple[int, str]]] = {}
            for number, name, manager in connection.execute("SELECT id, name, manager FROM employees ORDER BY id"):
                if manager in below:
                    below[manager].append((number, name))
                else:
                    below[manager] = [(number, name)]
            paths: list[list[Any]] = []

            def go(path: list[Any], boss: int | None) -> None:
                for row in below.get(boss, ()):
                    longer = [*path, *row]
                    paths.append(longer)
                    go(longer, row[0])

            go([], None)
            return paths

        return Work(run)

    return prepare


def in_sql(indexed: bool) -> Prepare:
    text = """WITH RECURSIVE tree(id, depth, path) AS (
            SELECT id, 1, id || ' ' || name FROM employees WHERE manager IS NULL
            UNION ALL
            SELECT employees.id, tree.depth + 1, tree.path || ' ' || employees.id || ' ' || employees.name
            FROM tree JOIN employees ON employees.manager = tree.id
            ORDER BY 2 DESC, 1
        )
        SELECT path FROM tree"""

    def prepare(size: int) -> Work:
        connection = opened(file_of(size, indexed))
        return Work(
            lambda: connection.execute(text).fetchall(), lambda rows: checksum([path.split() for (path,) in rows])
        )

    return prepare


def in_duckdb(size: int) -> Work:
    """The people are loaded into a table of DuckDB before."""
    connection = duck()
    columns = [list(column) for column in zip(*people(size), strict=True)]
    connection.execute(
        "CREATE TABLE employees AS SELECT unnest(?) AS id, unnest(?) AS name, unnest(?) AS manager", columns
    )
    text = """WITH RECURSIVE tree(id, path) AS (
            SELECT id, id || ' ' || name FROM employees WHERE manager IS NULL
            UNION ALL
            SELECT employees.id, tree.path || ' ' || employees.id || ' ' || employees.name
            FROM tree JOIN employees ON employees.manager = tree.id
        )
        SELECT path FROM tree"""
    return Work(lambda: connection.execute(text).fetchall(), lambda rows: checksum([path.split() for (path,) in rows]))


def in_networkx(size: int) -> Work:
    import networkx as nx

    connection = opened(file_of(size, True))

    def run() -> dict[int, list[int]]:
        graph = nx.DiGraph(connection.execute("SELECT manager, id FROM employees WHERE manager IS NOT NULL").fetchall())
        return dict(nx.single_source_shortest_path(graph, 1))

    return Work(run, lambda ways: checksum([[part for node in way for part in (node, "")] for way in ways.values()]))


def checksum(paths: list[list[Any]]) -> list[int]:
    """The number of paths, of rows, and the sum of all ids on all paths: not everybody gives the same order."""
    return [len(paths), sum(map(len, paths)) // 2, sum(int(part) for path in paths for part in path[::2])]


PROBLEMS = tuple(
    Problem(
        f"hierarchy{'' if indexed else '-noindex'}",
        f"everybody of a company with all managers above, table {'with' if indexed else 'without'} index on manager",
        "people",
        (1_000, 10_000, 100_000, 1_000_000) if indexed else (100_000,),
        100,
        script(indexed),
        {"python": by_hand(indexed), "sql": in_sql(indexed)}
        | ({"networkx": in_networkx, "duckdb": in_duckdb} if indexed else {}),
        "the number of paths, of their rows, and the sum of the ids on them",
        checksum,
        full=() if indexed else (1_000_000,),
        targets=bounds(0.6, 1.25, since=1_000_000),
    )
    for indexed in (True, False)
)
