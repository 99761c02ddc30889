"""Mistakes on purpose: what ss2sql says when a script is wrong, and that the session works on afterwards."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent)]

from page import Page

import ss2sql

LEAD = """Every error names the line and the column, shows the text, says what is wrong and what to do about it. All
errors of names are reported at once. The code in brackets is explained in the error index of the documentation."""

TOUR = (
    ("A name with a typo", "SELECT name FROM famliy WHERE age > 30;"),
    ("A child that is not there", 'SELECT this["children"][0] FROM family;'),
    ("A key that one of the rows lacks", 'SELECT name FROM family WHERE this["age"] > 30;'),
    ("A missing parenthesis", "SELECT name\nFROM family\nWHERE len((name) > 2;"),
    ("STOP without WITH", "SELECT this FROM moves START WITH n = 0 CONNECT BY n = n + 1 STOP n == 3;"),
    (
        "Options that contradict each other",
        "SELECT this FROM moves START WITH n = 0 CONNECT BY NO CYCLE MEMORIZE 3 n = n + 1;",
    ),
    ("An equals sign from SQL", "SELECT name FROM family WHERE name = 'Ada';"),
    ("A star of one source, as in SQL", "SELECT f.* FROM f = family;"),
    (
        "The one typo in the listings of the paper",
        """SELECT this, tower FROM moves
START WITH tower = [[3,2,1],[],[]]
CONNECT BY NO CYCLE tower = move(this, tower)
STOP WITH  [] == move(mov.this, tower);""",
    ),
    ("Two kinds of values that have no order", "SELECT name FROM family WHERE name < 1;"),
    ("A division by zero", "n = 0;\n1 / n;"),
    ("A representation nobody has made", "SELECT name FROM family AS lists;"),
    ("A function that gives a bad value", "SELECT ratio(0) FROM family;"),
    ("Two mistakes at once", "SELECT nam, lenght(name) FROM family;"),
)
FAMILY = [{"name": "Ada", "age": 36, "children": ["Bo"]}, {"name": "Cy", "children": []}]


def ratio(part: float) -> float:
    """Not a number, for 0."""
    return part / part if part else float("nan")


def move(step: list[int], towers: list[list[int]]) -> list[list[int]]:
    """Any function will do here: it is never called."""
    return towers


def main(lines: int | None = None) -> Page:
    page = Page("Mistakes, and what the messages say", LEAD, lines)
    with ss2sql.connect() as ss:
        ss.set("family", FAMILY)
        ss.set("moves", [[0, 1], [1, 0]])
        ss.function(ratio)
        ss.function(move)
        for number, (heading, script) in enumerate(TOUR, start=1):
            page.heading(f"{number}. {heading}")
            page.code("script", script, "sql")
            page.code("error", message(ss, script), "text")
        page.heading("The session works on")
        page.picture(repr(ss.run("SELECT name, len(children) FROM family;")))
    return page


def message(session: ss2sql.Session, script: str) -> str:
    """What the session says to a script that is wrong."""
    try:
        session.run(script)
    except ss2sql.Error as error:
        return str(error)
    return "no error"


if __name__ == "__main__":
    main()
