"""How the examples print: the script, the SQL that it becomes, and its rows.

A script file begins with comments: its first line is the heading, the rest says what the script teaches.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.syntax import Syntax
from rich.text import Text

from ss2sql import Result, Session


def console() -> Console:
    """As wide as the terminal, and wide enough for SQL where there is none."""
    wide = None if os.isatty(1) else 110
    return Console(file=sys.stdout, width=wide, highlight=False)


@dataclass(frozen=True)
class Shown:
    """One script that has run: its file's name, its heading, what it gave and how long that took."""

    name: str
    heading: str
    result: Result
    seconds: float


@dataclass
class Page:
    """A page of an example. `lines` bounds the code that is shown at a time; `shown` collects what it has run.

    `pictures` are the files that it has written.
    """

    title: str
    lead: str
    lines: int | None = None
    console: Console = field(default_factory=console)
    shown: list[Shown] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.console.print()
        self.console.rule(f"[bold]{self.title}", style="cyan", characters="━")
        self.say(self.lead)

    def say(self, text: str) -> None:
        """A paragraph."""
        self.console.print(" ".join(text.split()), width=min(self.console.width, 100))

    def picture(self, text: str) -> None:
        """Text as it stands."""
        self.console.print(Padding(Text(text), (1, 2), expand=False))

    def heading(self, text: str) -> None:
        self.console.print()
        self.console.rule(f"[bold]{text}", style="dim", align="left")

    def code(self, name: str, text: str, language: str) -> None:
        """A block of code under its name."""
        self.console.print(f"\n[cyan]{name}")
        colours = Syntax("", language, theme="ansi_dark", background_color="default")
        lines = text.strip().splitlines()
        most = self.lines or len(lines)
        block = colours.highlight("\n".join(lines[:most]))
        block.rstrip()
        self.console.print(Padding(block, (0, 2), expand=False))
        if len(lines) > most:
            self.console.print(f"  ... and {len(lines) - most} lines more", style="dim")

    def file(self, name: str) -> Path:
        """Where to write a picture: a file in the folder `out`, which is made if need be."""
        folder = Path("out")
        folder.mkdir(exist_ok=True)
        self.pictures.append(folder / name)
        return folder / name

    def run(
        self, session: Session, file: Path, rows: int = 8, drawn: Callable[[Any], str] | None = None, **variables: Any
    ) -> Result:
        """Runs a script file and prints its lesson, its text, its SQL and at most `rows` of its rows.

        `drawn` makes a text of a value that is no table.
        """
        heading, lesson, script = read(file)
        self.heading(heading)
        self.say(lesson)
        self.code("script", script, "sql")
        started = time.perf_counter()
        result = session.run(file, **variables)
        seconds = time.perf_counter() - started
        self.code("SQL", queries(result), "sql")
        self.console.print("\n[cyan]rows")
        if drawn is not None:
            self.picture(drawn(result.value))
        elif result.answer is None:
            self.console.print(Padding(Text(repr(result.value)), (0, 2)))
        else:
            result.show(rows, self.console)
        self.shown.append(Shown(file.stem, heading, result, seconds))
        return result


def read(file: Path) -> tuple[str, str, str]:
    """The heading, the lesson and the script of a file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comments = 0
    while comments < len(lines) and lines[comments].startswith("#"):
        comments += 1
    texts = [line.lstrip("# ") for line in lines[:comments]]
    return texts[0], " ".join(texts[1:]), "\n".join(lines[comments:])


def queries(result: Result) -> str:
    """The SQL of the queries of a script, without the statements that are none."""
    texts = [text for text in result.sql.statements if not text.startswith("-- no query")]
    return "\n\n".join(texts)


def size(result: Result) -> str:
    """What came out, in one phrase."""
    if result.answer is None:
        value = repr(result.value)
        return value if len(value) < 40 else f"{type(result.value).__name__} of {len(result.value)}"
    paths = result.answer.rows.paths
    if paths is None:
        return f"{len(result)} row{'s' * (len(result) != 1)}"
    shortest = min(map(len, paths), default=0)
    return f"{len(paths)} path{'s' * (len(paths) != 1)}, shortest {shortest} step{'s' * (shortest != 1)}"
