"""`make demo`: examples one after the other, all or those that are named, and a table of what they found."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from page import Page, console, size
from rich.table import Table

HERE = Path(__file__).parent
LINES = 24  # of code at a time; an example run alone shows everything
EXAMPLES = ("hanoi", "map_colouring", "hierarchy", "converters")
SIMULATED = ("chaos", "facts", "sensors", "navigation")  # need a simulator
INSTEAD = ("robot",)  # where there is none


def chosen() -> tuple[str, ...]:
    """The examples that can run here."""
    return EXAMPLES + (INSTEAD if find_spec("pybullet") is None else SIMULATED)


def main(names: Sequence[str]) -> None:
    screen = console()
    if find_spec("pybullet") is None:
        screen.print(
            "PyBullet, a simulator, is not installed; it is made for CPython up to 3.11. Without it the robot drives "
            "on a floor made of lists."
        )
    pages: list[Page] = [runpy.run_path(str(HERE / name / "run.py"))["main"](LINES) for name in names]
    screen.print()
    screen.rule("[bold]Summary", style="cyan", characters="━")
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in ("example", "script", "answer", "engine"):
        table.add_column(column, no_wrap=True)
    table.add_column("seconds", justify="right")
    for page in pages:
        for number, shown in enumerate(page.shown):
            title = page.title if number == 0 else ""
            table.add_row(title, shown.heading, size(shown.result), shown.result.engine, f"{shown.seconds:.3f}")
    screen.print(table)
    for page in pages:
        for picture in page.pictures:
            screen.print(f"Picture of {page.title}: {picture}")
    screen.print("\nEach example is a folder of examples/, to be run alone: python examples/hanoi/run.py")
    screen.print("The tutorial begins in docs/tutorial.md; ss2sql --help shows the commands.")


if __name__ == "__main__":
    main(sys.argv[1:] or chosen())
