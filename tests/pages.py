"""Pages whose code runs: README.md and docs/ with its folders. `python tests/pages.py --write` writes outputs anew.

The blocks of a page run in order:

- `python` runs in the page's namespace. A `text` or `sql` block after it is what it printed. Python inside of a
  comment, `<!-- python ... -->`, runs without being seen.
- `selectscript` is parsed. If a `sql` or `text` block follows, it also runs in the page's session `ss`: `sql` is the
  SQL that it became, `text` its result, or its error.
- `console`: lines that begin with `$ ss2sql` run; the lines up to the next `$` are what the command printed.
- `ss2sql` is a transcript of the shell: what stands behind `ss> ` and `..> ` is typed, other lines are what it prints.
- Times such as `3.1 ms` may be any.
- A block of code that begins with `# file: NAME` is written to that file, for the commands after it.

Every other block is left alone. A page runs in an empty folder of its own.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from click.testing import CliRunner
from golden import sql_text

import ss2sql
from ss2sql.cli import main as command_line
from ss2sql.errors import Source
from ss2sql.frontend.syntax.parser import parse
from ss2sql.shell.shell import Shell

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts))
OUTPUTS = ("text", "sql")
BLOCK = re.compile(r"^(?P<open>```|<!-- )(?P<kind>\w+)\n(?P<body>.*?)^(?:```|-->)$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# file: (\S+)\n")
TIME = re.compile(r" *\d[\d,]*\.\d ms\b")


@dataclass(frozen=True)
class Difference:
    """A block that does not show what its code gives."""

    line: int
    start: int
    end: int
    shown: str
    actual: str


class Player:
    """Runs the blocks of one page."""

    def __init__(self) -> None:
        self.names: dict[str, Any] = {"__name__": "page"}
        self.sessions: list[ss2sql.Session] = []

    def python(self, text: str, line: int) -> dict[str, str]:
        """Runs a block as a file of its own, with the line numbers of the page, so that functions have a source."""
        file, printed = Path(f"block_{line}.py").resolve(), io.StringIO()
        file.write_text("\n" * line + text, encoding="utf-8")
        with redirect_stdout(printed):
            exec(compile(file.read_text("utf-8"), str(file), "exec"), self.names)
        self.sessions += [value for value in self.names.values() if isinstance(value, ss2sql.Session)]
        return dict.fromkeys(OUTPUTS, printed.getvalue())

    def selectscript(self, text: str) -> dict[str, str]:
        printed = io.StringIO()
        try:
            with redirect_stdout(printed):
                result = self.names["ss"].run(text)
        except ss2sql.Error as error:
            return {"text": f"{printed.getvalue()}{error}"}
        return {"text": f"{printed.getvalue()}{result!r}", "sql": sql_text(result.sql)}

    def console(self, text: str) -> str:
        """The block with every command followed by what it prints."""
        lines = []
        for part in re.findall(r"^\$ .*\n(?:(?!\$ ).*\n)*", text, flags=re.MULTILINE):
            command, *shown = part.splitlines()
            lines.append(command)
            lines.extend(self.printed(command) if command.startswith("$ ss2sql ") else shown)
        return "\n".join(lines)

    def printed(self, command: str) -> list[str]:
        answer = CliRunner().invoke(command_line, shlex.split(command)[2:], env={"COLUMNS": "100"})
        if answer.exception is not None and not isinstance(answer.exception, SystemExit):
            raise answer.exception
        return answer.output.splitlines()

    def transcript(self, text: str) -> str:
        """The block with everything that is typed followed by what the shell prints."""
        lines = []
        for part in re.findall(r"^ss> .*\n(?:\.\.> .*\n)*", text, flags=re.MULTILINE):
            printed = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True)
            with redirect_stdout(printed), redirect_stderr(printed), patch.dict(os.environ, COLUMNS="100"):
                self.shell.run_text("\n".join(line[4:] for line in part.splitlines()))
            lines += [*part.splitlines(), *printed.buffer.getvalue().decode("utf-8").splitlines()]
        return "\n".join(lines)

    @cached_property
    def shell(self) -> Shell:
        """The page's shell, with a session of its own."""
        self.sessions.append(session := ss2sql.connect())
        return Shell(session)

    def close(self) -> None:
        """Closes all sessions, also those whose names have been given to others."""
        for session in self.sessions:
            session.close()


def differences(page: Path) -> list[Difference]:
    """Runs a page and gives the blocks that do not show what their code gives."""
    text = page.read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    player, found = Player(), []
    outputs: dict[str, str] = {}
    with TemporaryDirectory() as folder, chdir(folder):
        for number, block in enumerate(blocks):
            kind, body = block["kind"], block["body"]
            line = text.count("\n", 0, block.start("body"))
            if file := FILE.match(body):
                Path(file[1]).write_text(body[file.end() :], encoding="utf-8")
            if kind == "python":
                outputs = player.python(body, line)
            elif kind == "selectscript":
                parse(Source(body)) if not shows_error(blocks, number) else None
                outputs = player.selectscript(body) if followed_by(blocks, number, OUTPUTS) else {}
            elif kind in ("console", "ss2sql") or kind in outputs:
                match kind:
                    case "console":
                        actual = player.console(body)
                    case "ss2sql":
                        actual = player.transcript(body)
                    case _:
                        actual = outputs.pop(kind)
                if timeless(actual) != timeless(body):
                    found.append(Difference(line, block.start("body"), block.end("body"), body, tidy(actual)))
    player.close()
    return found


def followed_by(blocks: list[re.Match[str]], number: int, kinds: tuple[str, ...]) -> bool:
    return number + 1 < len(blocks) and blocks[number + 1]["kind"] in kinds


def shows_error(blocks: list[re.Match[str]], number: int) -> bool:
    return followed_by(blocks, number, ("text",)) and blocks[number + 1]["body"].startswith("error[P")


def timeless(text: str) -> str:
    """The tidy text without the times in it, which are different every time."""
    return TIME.sub(" # ms", tidy(text))


def tidy(text: str) -> str:
    """The text without blanks at the ends of lines and without empty lines around it."""
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines()) + "\n"


def write(page: Path) -> int:
    """Writes the outputs of a page anew; gives the number of blocks that were changed."""
    found = differences(page)
    text = page.read_text(encoding="utf-8")
    for difference in reversed(found):
        text = text[: difference.start] + difference.actual + text[difference.end :]
    if found:
        page.write_text(text, encoding="utf-8")
    return len(found)


if __name__ == "__main__":
    os.environ["NO_COLOR"] = "1"
    chosen = [Path(name).resolve() for name in sys.argv[2:]] or list(PAGES)
    if sys.argv[1:2] != ["--write"]:
        sys.exit("usage: python tests/pages.py --write [PAGE ...]")
    for path in chosen:
        print(f"{path.relative_to(ROOT)}: {write(path)} outputs changed")
