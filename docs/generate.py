"""Writes errors.md, the index of all error codes, each with a golden case as its example. `make golden` runs it."""

from __future__ import annotations

import re
from pathlib import Path

from ss2sql.errors import CODES

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


if __name__ == "__main__":
    (HERE / "errors.md").write_text(error_index(), encoding="utf-8")
