"""The pages about errors: the index errors.md, and errors/CODE.md for each code.

What a page says is in ss2sql/errors/codes.py and error_reasons.py; its example is the shortest golden case with this
error, or a few lines of Python where no script alone comes to it.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from error_reasons import REASONS
from test_errors import FROM_PYTHON

import ss2sql
from ss2sql.errors import CODES, Code

HERE = Path(__file__).parent
TESTS = HERE.parent / "tests"
FAMILIES = {
    "P": "Errors of the text", "R": "Errors of names and clauses", "U": "Errors of the engine",
    "X": "Errors while a script runs", "V": "Errors of representations", "T": "Runs that end early",
    "S": "Errors of the session",
}  # fmt: skip
WRITTEN = (
    "<!-- Written by docs/error_pages.py from the tables of codes and reasons, and tests/cases; `make golden` writes "
    "it anew. -->"
)
HEAD = f"""# Errors

{WRITTEN}

Every error has a code, a sentence, the place in the script and what to do about it:

```text
error[P002]: expected ')' before the end of the script
 --> <script>:1:35
  |
1 | max(SELECT age FROM people AS list
  |                                   ^
  |    - opened here
  = help: write the missing ')'
```

`^` marks the place, `-` what has to do with it. Errors of names and clauses are all reported at once. `str(error)` is
this text; `ss2sql.errors.render_all(error, color=True)` has it in the colours of a terminal, `error.as_dict()` as data.
What your own functions raise keeps its type and its traceback, and gets a note that names the line of the script."""

# What the examples from Python look like; what they come to is tested where FROM_PYTHON is.
SHOWN = {
    "P004": 'ss.run("x = 1;" * 100_000)',
    "P005": 'ss.run("(" * 10_000 + "1" + ")" * 10_000)',
    "R009": 'ss.compile("SELECT this * factor FROM [1]").run()',
    "U001": 'ss.run("n = 0; SELECT (n = n + 1) FROM [1]", engine="database")',
    "X010": 'ss.run("SELECT this FROM [1, 2, 3]", max_rows=2)',
    "X014": """ss = ss2sql.connect(max_size=2**18)
ss.run("t = 'ha'; SELECT len(t = t + t) FROM range(40)")""",
    "T003": """ss = ss2sql.connect(max_memory=500_000_000)
ss.run("SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY BREADTH FIRST n = n + this")""",
    "X015": """ss = ss2sql.connect(max_output=10)
ss.run("SELECT this FROM range(1000) WHERE print('looking at', this) > 5")""",
    "T004": """ss = ss2sql.connect(max_steps=1000)
ss.run("SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY BREADTH FIRST n = n + this")""",
    "X012": """ss.function("first", lambda numbers: numbers[:1], vectorized=True)
ss.run("SELECT first(this) FROM [1, 2, 3];")""",
    "X013": "ss.run(script, workers=2)  # and the function onward ends its process",
    "T001": "ss.run(script, timeout=0.05)",
    "T002": "ss.run(script)  # and Ctrl-C",
    "S001": 'ss.close()\nss.run("1;")',
    "S002": 'ss.function("two words", len)',
    "S003": "ss2sql.scenes.chaos()  # without PyBullet",
    "S004": 'ss.function("ask", lambda x: pool.submit(ss.eval, "1 + 1;").result())\n'
    'ss.run("ask(1);")  # it waits for a thread',
    "S005": 'connection = sqlite3.connect("data.db")\nss2sql.connect("data.db")',
}


def pages() -> Iterator[tuple[Path, str]]:
    """Each page with what should stand in it."""
    yield HERE / "errors.md", index()
    for code in CODES.values():
        yield HERE / "errors" / f"{code.code}.md", page(code)


def index() -> str:
    parts = [HEAD]
    for letter, title in FAMILIES.items():
        rows = [f"| [{name}](errors/{name}.md) | {code.title} | {code.explanation} |"
                for name, code in CODES.items() if name[0] == letter]  # fmt: skip
        parts.append("\n".join([f"## {letter}: {title}\n", "| code | name | meaning |", "|---|---|---|", *rows]))
    listed = "\n".join(f"errors/{name}" for name in CODES)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{listed}\n```")
    return "\n\n".join(parts) + "\n"


def page(code: Code) -> str:
    shown = example(code.code)
    parts = [f"# {code.code}: {code.title}", WRITTEN, filled(code.explanation)]
    language = "{code-block} python" if code.code in SHOWN else "text"
    parts += ["```{}\n{}\n```\n\n```text\n{}\n```".format(language, *shown)]
    why, cure = REASONS[code.code]
    parts += ["## Why", filled(why), "## What to do", filled(cure)]
    if further := [
        f"- {literal(message)}" + "".join(f"  \n  {hint}" for hint in hints) for message, hints in others(code.code)
    ]:
        parts += ["## Further messages", "\n".join(further)]
    return "\n\n".join(parts) + "\n"


@cache
def cases() -> list[tuple[str, str]]:
    """Script and message of all golden cases that end with errors of one code, those with one error first."""
    found = []
    for file in sorted((TESTS / "cases").rglob("*.case")):
        text = file.read_text(encoding="utf-8")
        match = re.search(r"^--- error\n(error\[.*?)(?=^--- |\Z)", text, re.MULTILINE | re.DOTALL)
        if match and len(set(re.findall(r"^error\[(\w+)\]", match[1], re.MULTILINE))) == 1:
            found.append((text.split("\n--- ")[0].split("\n\n", 1)[1].strip("\n"), match[1].strip("\n")))
    return sorted(found, key=lambda case: (case[1].count("error["), len("".join(case))))


def example(code: str) -> tuple[str, str]:
    """The script, or the lines of Python, that come to this error, and its message."""
    if code in SHOWN:
        return SHOWN[code], from_python(code)
    return next(case for case in cases() if case[1].startswith(f"error[{code}]"))


def from_python(code: str) -> str:
    with ss2sql.connect() as session:
        try:
            FROM_PYTHON[code](session)
        except ss2sql.Error as error:
            told = str(error).replace("a_package_that_is_missing", "pybullet")  # it is there where this is written
            return re.sub(r"\S*/data\.db", "data.db", told)
    raise AssertionError(f"{code} is not raised")


def others(code: str) -> list[tuple[str, list[str]]]:
    """What else is said under this code, with what to do, each sentence once."""
    first = example(code)[1]
    found: dict[str, list[str]] = {}
    for _, message in cases():
        if message.startswith(f"error[{code}]") and message != first:
            sentence = message.split("\n")[0].split(": ", 1)[1]
            found.setdefault(
                sentence, [literal(hint) for hint in re.findall(r"^ *= help: (.*)$", message, re.MULTILINE)]
            )
    return sorted(found.items())


def filled(text: str) -> str:
    """A paragraph in lines of the width of pages."""
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)


def literal(text: str) -> str:
    """A sentence that is shown as it is."""
    return f"`` {text} ``" if "`" in text else f"`{text}`"
