"""A hierarchy of employees in a SQLite file: trees, chains of command, and groups."""

from __future__ import annotations

import random
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent)]

from page import Page

import ss2sql

LEAD = """A company of 24 people in a SQLite file; each row names the person's manager. The scripts read the table where
it is: ss2sql.connect(path) makes the tables of a file sources of scripts."""

NAMES = """Ada Bruno Chiara Dimitri Elif Farid Greta Hugo Ines Jonas Kira Lars Mina Noor Otto Petra
Quinn Rosa Samir Tilda Umut Vera Wim Yara""".split()  # noqa: SIM905
DEPARTMENTS = ("Engineering", "Sales", "Support")


def make_company(path: Path, seed: int = 2) -> None:
    """Writes the table of employees; the same seed gives the same company."""
    numbers = random.Random(seed)
    people: list[tuple[int, str, int | None, str, int]] = [(1, NAMES[0], None, "Management", 9800)]
    for number, name in enumerate(NAMES[1:], start=2):
        if number <= 4:
            manager, department = 1, DEPARTMENTS[number - 2]
        else:
            # The newer somebody is, the later the row that leads them may stand.
            manager = 2 + int(numbers.random() * min(number - 2, 9))
            department = people[manager - 1][3]
        salary = (7200 if number <= 4 else 3000) + 50 * int(numbers.random() * 40)
        people.append((number, name, manager, department, salary))
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(
            """CREATE TABLE employees
               (id INTEGER PRIMARY KEY, name TEXT, manager INTEGER, department TEXT, salary INTEGER)"""
        )
        file.executemany("INSERT INTO employees VALUES (?, ?, ?, ?, ?)", people)


def tree(paths: list[list[tuple[int, str]]]) -> str:
    """The paths of a depth-first search as an indented tree: a path's length is the depth of its last row."""
    return "\n".join("   " * (len(path) - 1) + path[-1][1] for path in paths)


def main(lines: int | None = None) -> Page:
    page = Page("Employees in a file", LEAD, lines)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "company.db"
        make_company(file)
        with ss2sql.connect(file, read_only=True) as ss:
            page.run(ss, HERE / "1_managers.ss")
            whole = page.run(ss, HERE / "2_tree.ss", rows=6)
            page.say("A path's last row is a person, its length the depth in the tree:")
            page.picture(tree(whole.paths))
            page.run(ss, HERE / "3_upwards.ss", person=24)
            page.run(ss, HERE / "4_downwards.ss", person=2)
            page.run(ss, HERE / "5_salaries.ss")
    return page


if __name__ == "__main__":
    main()
