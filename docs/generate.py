"""Writes what pages take from the code; `make golden` runs it.

That is errors.md, the index of all error codes, each with a golden case as its example, and the tables of columns and
functions in pybullet.md.
"""

from __future__ import annotations

import re
from inspect import signature
from pathlib import Path

from ss2sql.errors import CODES
from ss2sql.vtables.attached import AttachedTable, AttachedWorld
from ss2sql.vtables.describe import column_rows
from ss2sql.vtables.pybullet import PyBulletWorld

HERE = Path(__file__).parent
CASES = HERE.parent / "tests" / "cases"
FAMILIES = {
    "P": "of the text", "R": "of names and clauses", "U": "of the engine", "X": "while a script runs",
    "V": "of representations", "T": "of runs that end early", "S": "of the session",
}  # fmt: skip
HEAD = """# Errors

<!-- Written by docs/generate.py from ss2sql/errors.py and tests/cases; `make golden` writes it anew. -->

Every error has a code, the place in the script, the reason and the cure. Errors of names and clauses are all reported
at once. What your own functions raise keeps its type and gets a note that names the line of the script.
"""


def error_index() -> str:
    """The page."""
    parts = [HEAD]
    parts.append("| code | |\n|---|---|")
    parts[-1] += "".join(f"\n| `{letter}...` | errors {text} |" for letter, text in FAMILIES.items())
    for entry in CODES.values():
        parts.append(f"## {entry.code}: {entry.title}\n\n{entry.explanation}")
        if case := example(entry.code):
            script, message = case
            parts.append(f"```\n{script}\n```\n\n```\n{message}\n```")
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def example(code: str) -> tuple[str, str] | None:
    """Script and message of the shortest golden case that ends with this error alone, if it fits on a page."""
    found = []
    for file in sorted(CASES.rglob("*.case")):
        text = file.read_text(encoding="utf-8")
        if match := re.search(rf"^--- error\n(error\[{code}\].*?)(?=^--- |\Z)", text, re.MULTILINE | re.DOTALL):
            script = text.split("\n--- ")[0].split("\n\n", 1)[1].strip("\n")
            if match[1].count("error[") == 1 and len(script) < 400:
                found.append((script, match[1].strip("\n")))
    return min(found, key=lambda case: len("".join(case)), default=None)


# --- worlds --------------------------------------------------------------------------------------------

BEGIN, END = "<!-- written by docs/generate.py -->\n", "<!-- end of what is written -->\n"


def world_page(text: str) -> str:
    """The page of the PyBullet world, with its tables as they are declared now."""
    before, rest = text.split(BEGIN)
    world = AttachedWorld("space", PyBulletWorld(0), lambda name, table: name)
    tables = "\n".join(map(_table, world.tables.values()))
    return f"{before}{BEGIN}\n{tables}\n{_functions(world)}\n{END}{rest.split(END)[1]}"


def _table(table: AttachedTable) -> str:
    schema = table.schema
    title = f"space.{schema.signature}" if schema.parameters else table.title
    head = f"### `FROM {title}`\n\n{_sentence(table.table.text)}"
    if schema.walked is not None:
        return f"{head} The columns are those of `{schema.walked.name}`.\n"
    lines = [head, "", "| column | type | unit | filter | |", "|---|---|---|---|---|"]
    for name, kind, unit, used, text in column_rows(table):
        cells = (f"`{name}`", kind.replace("|", "or"), unit, used and f"`{used}`", text)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _functions(world: AttachedWorld) -> str:
    lines = ["### Functions\n", "| function | | |\n|---|---|---|"]
    for name, (method, volatility) in sorted(world.functions.items()):
        text = " ".join((method.__doc__ or "").split())
        parameters = ", ".join(
            one.name if one.default is one.empty else f"{one.name}={one.default!r}"
            for one in signature(method).parameters.values()
        )
        lines.append(f"| `{name}({parameters})` | {volatility} | {text} |")
    return "\n".join(lines) + "\n"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


if __name__ == "__main__":
    (HERE / "errors.md").write_text(error_index(), encoding="utf-8")
    page = HERE / "pybullet.md"
    page.write_text(world_page(page.read_text("utf-8")), encoding="utf-8")
