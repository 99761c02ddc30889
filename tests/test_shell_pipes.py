"""The shell that reads a pipe."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from command_lines import press_ctrl_c_after
from shells import moved_into

import ss2sql
from ss2sql.cli import main
from ss2sql.shell.pieces import pieces
from ss2sql.shell.piped import run_piped
from ss2sql.shell.shell import Shell

ENDLESS = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return moved_into(tmp_path, monkeypatch)


@pytest.fixture
def shell() -> Iterator[Shell]:
    with ss2sql.connect() as session:
        yield Shell(session)


def piped(text: str, *options: str) -> Result:
    answer = CliRunner().invoke(main, ["repl", *options], input=text)
    assert answer.exception is None or isinstance(answer.exception, SystemExit)
    return answer


def test_statements_come_from_a_pipe() -> None:
    answer = piped("x = 1;\nSELECT this\n  FROM [x];\n.set y 2\nx + y", "--format", "json")
    assert answer.stdout == '[{"this": 1}]\n3\n'
    assert (answer.exit_code, answer.stderr) == (0, "x = 1\ny = 2\n")
    assert piped("").stdout == ""


def test_a_pipe_goes_on_after_an_error_and_ends_with_code_1() -> None:
    answer = piped("a = 1;\nb = zz;\nc = 3; d = zz;\n\n 'open;\na + c;\n")
    assert answer.stdout == "4\n"
    assert [line for line in answer.stderr.splitlines() if "-->" in line] == [
        " --> <stdin>:2:5", " --> <stdin>:3:12", " --> <stdin>:5:2"]  # fmt: skip
    assert answer.exit_code == 1


def test_a_pipe_ends_at_exit() -> None:
    assert piped("1;\n.exit\n2;").stdout == "1\n"


def test_options_of_run_are_those_of_the_shell() -> None:
    options = ["--functions", "functions.py", "-p", "n", "[1, 2]", "--engine", "native", "--show", "1"]
    lines = piped("twice(3); SELECT this FROM n;", *options).stdout.splitlines()
    assert (lines[0], lines[-1]) == ("6", "2 rows, the first 1 shown, native")
    lines = piped(".timeout\n.maximum\n", "--timeout", "3", "--maximum", "4").stdout.splitlines()
    assert [line.split()[:2] for line in lines] == [["timeout:", "3"], ["maximum:", "4"]]


def test_a_statement_runs_before_the_pipe_ends(shell: Shell, capsys) -> None:
    seen: list[str] = []

    class Stream(io.RawIOBase):
        lines = iter([b"1;\n", b"2\n", b";\n"])

        def __iter__(self):
            return self

        def __next__(self):
            seen.append(capsys.readouterr().out)
            return next(self.lines)

    run_piped(shell, Stream())  # type: ignore[arg-type]
    assert seen == ["", "1\n", "", "2\n"]


def test_a_long_statement_is_not_read_again_with_every_line(shell: Shell, capsys, monkeypatch) -> None:
    cuts = []
    monkeypatch.setattr("ss2sql.shell.piped.pieces", lambda text: cuts.append(text) or pieces(text))
    run_piped(shell, io.BytesIO(b"x = [\n" + b"1,\n" * 1000 + b"1];\n"))
    assert len(cuts) <= 2
    assert capsys.readouterr().err.startswith("x = [1, 1, 1")


def test_text_that_is_no_text() -> None:
    answer = piped(b"1;\n\xff;\n")  # type: ignore[arg-type]
    assert (answer.exit_code, answer.stdout) == (1, "1\n")
    assert "line 2 of the standard input cannot be read" in answer.stderr


def test_as_a_process() -> None:
    command = [sys.executable, "-m", "ss2sql.cli", "repl"]
    answer = subprocess.run(command, input="1 + 1;\n", capture_output=True, text=True, timeout=60)
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "2\n", "")


@pytest.mark.usefixtures("usual")
def test_ctrl_c_ends_a_pipe(folder: Path) -> None:
    (folder / "begun.py").write_text("from pathlib import Path\ndef begun():\n    Path('begun').touch()\n")
    command = [sys.executable, "-m", "ss2sql.cli", "repl", "--functions", "begun.py"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as answer:
        try:
            answer.stdin.write(f"begun(); {ENDLESS} 7;\n8;\n")
            answer.stdin.flush()
            press_ctrl_c_after(folder / "begun", answer)
            out, err = answer.communicate(timeout=60)
        finally:
            answer.kill()
    assert answer.returncode == 130
    assert err.startswith("cancelled\n")
    assert out.splitlines()[-1].endswith(", cancelled")
