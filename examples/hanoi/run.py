"""Towers of Hanoi: one problem, five ways to ask for its solution."""

from __future__ import annotations

import runpy
import sys
from collections import Counter
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from page import Page
from towers import move

import ss2sql

LEAD = """Three towers, the disks on the first one, the largest below. A move takes the top disk of one tower to
another, never onto a smaller one. Which moves bring all disks to the third tower? `move` is an ordinary Python
function; the scripts below ask for the answer in the five ways of the paper."""


def main(lines: int | None = None) -> Page:
    page = Page("Towers of Hanoi", LEAD, lines)
    with ss2sql.connect() as ss:
        ss.function(move)
        page.run(ss, HERE / "1_nested.ss")
        page.run(ss, HERE / "2_search.ss")
        no_cycle = page.run(ss, HERE / "3_no_cycle.ss")
        page.say(f"Paths by their length: {lengths(no_cycle)}.")
        page.run(ss, HERE / "4_unique.ss")
        memorize = page.run(ss, HERE / "5_memorize.ss")
        page.say(f"Paths by their length: {lengths(memorize)}.")
    page.heading("The program of the paper")
    page.say("stub.py is the paper's own program; only its import line is changed. It prints:")
    page.picture(str(runpy.run_path(str(HERE / "stub.py"))["result"]))
    return page


def lengths(result: ss2sql.Result) -> str:
    counts = sorted(Counter(map(len, result.paths)).items())
    return ", ".join(f"{count} of {length} steps" for length, count in counts)


if __name__ == "__main__":
    main()
