"""Colouring maps with four colours: eight countries, written in the four ways of the paper, and longer maps."""

from __future__ import annotations

import re
from collections.abc import Sequence

import apsw

from problems.base import Prepare, Problem, Script, Target, Work, same
from problems.levels import duck

COUNTRIES = "abcdefgh"
BORDERS = re.findall(r"\w+", "ab ac ad ae af bc bd bf bg cd cg ch de dh ef eh fg gh")  # two letters each
COLOURS = ["red", "green", "blue", "yellow"]


def head(names: Sequence[str]) -> str:
    columns = ", ".join(f"{name}.this" for name in names)
    return f"SELECT {columns} FROM {', '.join(f'{name}=colours' for name in names)} WHERE "


def inequalities(borders: Sequence[Sequence[str]]) -> str:
    return " AND ".join(f"{a}.this != {b}.this" for a, b in borders)


HEAD = head(COUNTRIES)
PAIRS = ", ".join(f"[{left}.this, {right}.this]" for left, right in BORDERS)
NAMES = ", ".join(f'["{left}", "{right}"]' for left, right in BORDERS)
FORMS = {
    "map-1": ("inequalities in WHERE", HEAD + inequalities(BORDERS)),
    "map-2": (
        "a nested query over a list of pairs",
        f"{HEAD} [] == (SELECT this FROM [{PAIRS}] WHERE this[0] == this[1] AS list)",
    ),
    "map-3": (
        "the list of pairs in a variable",
        f"neighbours = [{PAIRS}];\n{HEAD} [] == (SELECT this FROM neighbours WHERE this[0] == this[1] AS list)",
    ),
    "map-4": (
        "pairs of names, read by `eval`",
        f"""neighbours = [{NAMES}];\n{HEAD} [] == (SELECT this FROM neighbours
            WHERE eval(this[0] + ".this;") == eval(this[1] + ".this;") AS list)""",
    ),
}


def strip(size: int) -> tuple[list[str], list[tuple[str, str]]]:
    """A map in which every country borders on the three before it: 24 colourings, however long it is."""
    names = [f"c{number}" for number in range(1, size + 1)]
    return names, [(names[i], names[j]) for j in range(size) for i in range(max(0, j - 3), j)]


def colour(names: Sequence[str], borders: Sequence[Sequence[str]]) -> Work:
    """Backtracking by hand."""
    earlier = [[names.index(a) for a, b in borders if b == name] for name in names]

    def run() -> list[dict[str, str]]:
        found: list[dict[str, str]] = []
        chosen: list[str] = []

        def go(place: int) -> None:
            if place == len(names):
                found.append(dict(zip(names, chosen, strict=True)))
                return
            taken = {chosen[other] for other in earlier[place]}
            for colour in COLOURS:
                if colour not in taken:
                    chosen.append(colour)
                    go(place + 1)
                    chosen.pop()

        go(0)
        return found

    return Work(run)


def in_sql(names: Sequence[str], borders: Sequence[Sequence[str]]) -> Work:
    connection = apsw.Connection(":memory:")
    connection.execute("CREATE TABLE colours (number INTEGER PRIMARY KEY, this TEXT)")
    connection.executemany("INSERT INTO colours (this) VALUES (?)", [(colour,) for colour in COLOURS])
    text = f"""SELECT {", ".join(f"{name}.this" for name in names)}
        FROM {" CROSS JOIN ".join(f"colours AS {name}" for name in names)} WHERE {inequalities(borders)}"""
    return Work(lambda: [dict(zip(names, row, strict=True)) for row in connection.execute(text)])


def in_duckdb(names: Sequence[str], borders: Sequence[Sequence[str]]) -> Work:
    connection = duck()
    connection.execute("CREATE TABLE colours (number INTEGER, this TEXT)")
    connection.executemany("INSERT INTO colours VALUES (?, ?)", list(enumerate(COLOURS)))
    text = f"""SELECT {", ".join(f"{name}.this" for name in names)}
        FROM {", ".join(f"colours AS {name}" for name in names)} WHERE {inequalities(borders)}
        ORDER BY {", ".join(f"{name}.number" for name in names)}"""
    return Work(lambda: [dict(zip(names, row, strict=True)) for row in connection.execute(text).fetchall()])


def four_forms() -> dict[str, Prepare]:
    return {
        "python": lambda size: colour(COUNTRIES, BORDERS),
        "sql": lambda size: in_sql(COUNTRIES, BORDERS),
        "duckdb": lambda size: in_duckdb(COUNTRIES, BORDERS),
    }


def strip_script(size: int) -> Script:
    names, borders = strip(size)
    return Script(head(names) + inequalities(borders), (), {"colours": COLOURS})


PROBLEMS = (
    *(
        Problem(
            name,
            f"eight countries, four colours: {about}",
            "countries",
            (8,),
            8,
            lambda size, text=text: Script(text, (), {"colours": COLOURS}),  # type: ignore[misc]
            four_forms(),
            "the 48 colourings, in order",
            same,
            targets=(Target(0.5),) if name == "map-1" else (Target(0.5), Target(2.0, "map-1")),
        )
        for name, (about, text) in FORMS.items()
    ),
    Problem(
        "colouring",
        "a map as a strip, each country bordering on the three before it, four colours",
        "countries",
        (8, 16, 32),
        5,
        strip_script,
        {
            "python": lambda size: colour(*strip(size)),
            "sql": lambda size: in_sql(*strip(size)),
            "duckdb": lambda size: in_duckdb(*strip(size)),
        },
        "the 24 colourings, in order",
        same,
        full=(60,),
    ),
)
