"""Facts for Prolog: what a simulation knows, for a program that draws conclusions."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from page import Page

import ss2sql

LEAD = """A simulation knows where everything is, Prolog knows what follows from that. A query writes what it selects as
facts, which SWI-Prolog reads beside the rules of the user."""
SOME = 8  # facts that are shown


def main(lines: int | None = None) -> Page:
    page = Page("Facts for Prolog", LEAD, lines)
    with ss2sql.scenes.hall(seed=0) as hall, ss2sql.connect() as ss:
        ss.attach("hall", hall)
        scripts = ("1_bodies.ss", "2_relations.ss", "3_sensing.ss")
        facts = [page.run(ss, HERE / script, drawn=some).value for script in scripts]
    page.heading("What follows")
    page.code("rules.pl", (HERE / "rules.pl").read_text("utf-8"), "prolog")
    if shutil.which("swipl") is None:
        page.say("SWI-Prolog is not installed here; where it is, its answer follows.")
    else:
        page.say("SWI-Prolog reads the facts and these rules, and answers:")
        page.picture(answer("".join(facts)))
    return page


def some(facts: str) -> str:
    """The first facts."""
    lines = facts.splitlines()
    return "\n".join(lines[:SOME] + [f"... and {len(lines) - SOME} more"] * (len(lines) > SOME))


def answer(facts: str) -> str:
    """What SWI-Prolog prints when it runs `main` of the rules over the facts."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "facts.pl"
        file.write_text(facts, encoding="utf-8")
        command = ["swipl", "-q", "-g", "main", "-t", "halt", str(file), str(HERE / "rules.pl")]
        return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=True).stdout.rstrip()


if __name__ == "__main__":
    main()
