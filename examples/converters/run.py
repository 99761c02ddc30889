"""Converters: data formats as states, functions as steps, and the chain of functions that leads from one to another."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from converters import LIBRARY
from page import Page

import ss2sql

LEAD = """A library of functions, each of which turns one data format into another: which of them, one after the other,
lead from what one has to what one wants? The outlook of the paper asks this of robots and their many converters. The
library is a list, so the question is a query."""
TEXT = "x,y,mass\n0.5,1.25,3\n2,0.75,1.5\n"


def main(lines: int | None = None) -> Page:
    page = Page("Chains of converters", LEAD, lines)
    with ss2sql.connect() as ss:
        names = ("name", "takes", "gives", "price")
        ss.set("library", [{name: getattr(entry, name) for name in names} for entry in LIBRARY.values()])
        page.say(f"The library has {len(LIBRARY)} converters:")
        ss.run("SELECT * FROM library;").show(len(LIBRARY), page.console)
        page.run(ss, HERE / "1_fewest.ss")
        (chain,) = page.run(ss, HERE / "2_cheapest.ss").paths
        page.say("The program runs this chain on a piece of data:")
        page.picture("\n\n".join(f"{name}:\n{value}" for name, value in run_chain([name for name, _ in chain], TEXT)))
        page.run(ss, HERE / "3_all.ss", drawn=arrows)
    return page


def run_chain(names: list[str], data: Any) -> list[tuple[str, Any]]:
    """The data after each converter."""
    stages = [("the text", data.strip())]
    for name in names:
        data = LIBRARY[name].function(data)
        stages.append((name, data))
    return stages


def arrows(chains: list[list[str]]) -> str:
    return "\n".join(" > ".join(["csv", *chain]) for chain in chains)


if __name__ == "__main__":
    main()
