"""Map colouring: four ways to say that neighbours differ, and scripts that count and log while they search."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stdout
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent)]

from page import Page

import ss2sql

LEAD = """Colour a map of eight countries with four colours so that no two neighbours have the same one. There are 48
ways; the four scripts below find the same ones. Then a smaller map of five countries shows what else may stand in
WHERE."""


def main(lines: int | None = None) -> Page:
    page = Page("Map colouring", LEAD, lines)
    with ss2sql.connect() as ss:
        for name in ("1_inequalities", "2_nested_query", "3_pairs", "4_names"):
            page.run(ss, HERE / f"{name}.ss", rows=3)
        page.run(ss, HERE / "5_counting.ss")
        for name in ("6_logging", "7_logging_some"):
            log = io.StringIO()
            with redirect_stdout(log):
                page.run(ss, HERE / f"{name}.ss", rows=3)
            lines = [line for line in log.getvalue().splitlines() if line.startswith(("log:", "red:"))]
            page.say(f"It printed {len(lines):,} lines, among them:")
            page.picture("\n".join([*lines[:3], "...", lines[-1]]))
    return page


if __name__ == "__main__":
    main()
