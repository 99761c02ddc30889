"""Questions to the particles of a particle filter, flat queries of a list and of a table."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from problems.base import Prepare, Problem, Script, Work, bounds
from problems.levels import duck
from problems.tables import opened, table_file

COLUMNS = ("x", "y", "heading", "w")
Row = tuple[float, float, float, float]


@lru_cache
def particles(size: int) -> list[Row]:
    chance = random.Random(size)
    return [(chance.uniform(0, 10), chance.uniform(0, 10), chance.uniform(-3, 3), chance.random()) for _ in range(size)]


def file_of(size: int) -> Path:
    create = (f"CREATE TABLE particles ({' REAL, '.join(COLUMNS)} REAL)",)
    return table_file(f"particles_{size}", create, "INSERT INTO particles VALUES (?, ?, ?, ?)", lambda: particles(size))


def mean_by_hand(rows: list[Row]) -> list[tuple[float, float]]:
    mass = left = up = 0.0
    for x, y, _, w in rows:
        mass += w
        left += x * w
        up += y * w
    return [(left / mass, up / mass)]


def best_by_hand(rows: list[Row]) -> list[tuple[float, ...]]:
    x, y, heading, _ = max(rows, key=lambda row: row[3])
    return [(x, y, heading)]


def near_by_hand(rows: list[Row]) -> list[tuple[float, float]]:
    return [(x, y) for x, y, _, w in rows if (x - 4) ** 2 + (y - 5) ** 2 < 4 and w > 0.5]


def cells_by_hand(rows: list[Row]) -> list[tuple[Any, ...]]:
    cells: dict[tuple[int, int], list[float]] = {}
    for x, y, _, w in rows:
        cell = cells.setdefault((int(x), int(y)), [0, 0.0])
        cell[0] += 1
        cell[1] += w
    return [(*place, *cell) for place, cell in cells.items()]


# Name: what is asked, the script, the same in SQL, and by hand. In SQL the groups need an order of their own.
QUESTIONS: dict[str, tuple[str, str, str, Callable[[list[Row]], list[Any]]]] = {
    "mean": (
        "the weighted mean",
        "SELECT sum(x * w) / sum(w), sum(y * w) / sum(w) FROM particles GROUP BY True AS rows;",
        "SELECT sum(x * w) / sum(w), sum(y * w) / sum(w) FROM particles",
        mean_by_hand,
    ),
    "best": (
        "the best one",
        "SELECT x, y, heading FROM particles ORDER BY w DESC LIMIT 1 AS rows;",
        "SELECT x, y, heading FROM particles ORDER BY w DESC LIMIT 1",
        best_by_hand,
    ),
    "near": (
        "the good ones near a place",
        "SELECT x, y FROM particles WHERE (x - 4) ^ 2 + (y - 5) ^ 2 < 4 AND w > 0.5 AS rows;",
        "SELECT x, y FROM particles WHERE (x - 4) * (x - 4) + (y - 5) * (y - 5) < 4 AND w > 0.5",
        near_by_hand,
    ),
    "cells": (
        "number and weight by cell",
        "SELECT int(x), int(y), count(*), sum(w) FROM particles GROUP BY int(x), int(y) AS rows;",
        "SELECT CAST(trunc(x) AS INTEGER), CAST(trunc(y) AS INTEGER), count(*), sum(w) FROM particles GROUP BY 1, 2",
        cells_by_hand,
    ),
}


def from_list(text: str) -> Callable[[int], Script]:
    def script(size: int) -> Script:
        return Script(text, (), {"particles": [dict(zip(COLUMNS, row, strict=True)) for row in particles(size)]})

    return script


def from_table(text: str) -> Callable[[int], Script]:
    return lambda size: Script(text, file=file_of(size))


def list_by_hand(work: Callable[[list[Row]], list[Any]]) -> Prepare:
    """Over the same dicts that the script gets."""

    def prepare(size: int) -> Work:
        dicts = [dict(zip(COLUMNS, row, strict=True)) for row in particles(size)]
        return Work(lambda: work([(p["x"], p["y"], p["heading"], p["w"]) for p in dicts]))

    return prepare


def table_by_hand(work: Callable[[list[Row]], list[Any]]) -> Prepare:
    def prepare(size: int) -> Work:
        connection = opened(file_of(size))
        return Work(lambda: work(connection.execute("SELECT x, y, heading, w FROM particles").fetchall()))

    return prepare


def in_sql(text: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection = opened(file_of(size))
        return Work(lambda: connection.execute(text).fetchall())

    return prepare


def in_duckdb(text: str) -> Prepare:
    def prepare(size: int) -> Work:
        connection = duck()
        connection.execute(f"CREATE TABLE particles ({' DOUBLE, '.join(COLUMNS)} DOUBLE)")
        columns = list(zip(*particles(size), strict=True))
        connection.execute(
            "INSERT INTO particles SELECT unnest(?), unnest(?), unnest(?), unnest(?)", [list(c) for c in columns]
        )
        return Work(lambda: connection.execute(text).fetchall())

    return prepare


def rounded(rows: list[Any]) -> list[list[float]]:
    """Sums come in another order with each contender, and so do groups."""
    return sorted([round(value, 6) for value in row] for row in rows)


PROBLEMS = tuple(
    Problem(
        f"particles-{name}{'-table' if table else ''}",
        f"particle filter: {about}, from a {'table' if table else 'list of dicts'}",
        "particles",
        (1_000, 10_000, 100_000) if name == "cells" else (10_000,),
        20,
        from_table(text) if table else from_list(text),
        {"python": table_by_hand(work), "sql": in_sql(sql), "duckdb": in_duckdb(sql)}
        if table
        else {"python": list_by_hand(work)},
        "the rows, numbers to 6 decimals",
        rounded,
        full=(1_000_000,),
        targets=() if table or name == "cells" else bounds(4.5, 1.25),
    )
    for name, (about, text, sql, work) in QUESTIONS.items()
    for table in (False, True)
)
