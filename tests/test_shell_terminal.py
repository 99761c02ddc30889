"""The shell on a terminal, and its history: keys go through prompt_toolkit's own input, what it shows is lost."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import ss2sql
from ss2sql.shell.shell import Shell
from ss2sql.shell.terminal import find_state_folder, open_history_file

pytest.importorskip("prompt_toolkit")

from prompt_toolkit.completion import CompleteEvent
from prompt_toolkit.document import Document
from prompt_toolkit.formatted_text import fragment_list_to_text
from prompt_toolkit.input import PipeInput, create_pipe_input
from prompt_toolkit.output import DummyOutput

from ss2sql.shell.terminal import ShellLexer, Terminal, _ShellHistory

ENTER, TAB, CTRL_C, CTRL_D, UP, ESCAPE = "\r", "\t", "\x03", "\x04", "\x1b[A", "\x1b"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def keys() -> Iterator[PipeInput]:
    with create_pipe_input() as found:
        yield found


@pytest.fixture
def terminal(keys: PipeInput) -> Iterator[Terminal]:
    with ss2sql.connect() as session:
        yield Terminal(Shell(session), remembers=False, input=keys, output=DummyOutput())


def run(terminal: Terminal, keys: PipeInput, *steps: str | Callable[[], object]) -> None:
    """Types the texts one after the other, each function once it gives something, and waits until the shell ends."""

    def type_all() -> None:
        for step in steps:
            if isinstance(step, str):
                keys.send_text(step)
                continue
            until = time.monotonic() + 20
            while not step() and time.monotonic() < until:
                time.sleep(0.01)
        keys.send_text(CTRL_C + CTRL_D)

    typing = threading.Thread(target=type_all)
    typing.start()
    terminal.run_until_exit()
    typing.join()


def results(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines on stdout; what this is has been said beside them, because stdout is no terminal here."""
    out, err = capsys.readouterr()
    assert err.startswith(f"ss2sql {ss2sql.__version__}")
    assert ".help" in err.splitlines()[2]
    return out.splitlines()


def text(terminal: Terminal) -> str:
    return terminal.prompts.default_buffer.text


def menu(terminal: Terminal) -> bool:
    return terminal.prompts.default_buffer.complete_state is not None


def remembered(terminal: Terminal) -> bool:
    """Whether the prompt has read the history, which it does in the background."""
    return len(terminal.prompts.default_buffer._working_lines) > 1


@pytest.mark.parametrize(
    ("steps", "shown"),
    [
        ([f"1 + 1;{ENTER}", f"2 +{ENTER}{ENTER}3;{ENTER}"], ["2", "5"]),  # statements of one line and of several
        ([f"7{CTRL_C}", f"1;{ENTER}{CTRL_D}"], ["1"]),  # Ctrl-C clears the line and Ctrl-D leaves
        ([f"exit = 3;{ENTER}", f"exit;{ENTER}"], ["3"]),  # a variable of such a name is a variable
        # pasted text is one entry, of which what stands behind an error does not run
        ([f"\x1b[200~a = 1;\n\nb = zz;\nc = 3;\n.variables\x1b[201~{ENTER}", f".variables{ENTER}"], ["  a  1"]),
        # what was typed comes back
        ([f"1 +{ENTER}1;{ENTER}", remembered, f"{UP}{ENTER}"], ["2", "2"]),
        # Enter in the middle of several lines begins a new one
        ([f"1 +{ENTER}2;{UP}{ENTER}", lambda terminal: text(terminal).count("\n") == 2], []),
        # Tab takes the only completion, and Enter then runs
        (["sqr", menu, TAB, lambda terminal: text(terminal) == "sqrt(" and not menu(terminal), f"9);{ENTER}"], ["3.0"]),
    ],
    ids=["lines", "ctrl", "exit", "paste", "up", "middle", "tab"],
)
def test_keys(steps: list[Any], shown: list[str], terminal: Terminal, keys: PipeInput, capsys) -> None:
    run(terminal, keys, *(step if isinstance(step, str) else partial(step, terminal) for step in steps))
    assert results(capsys) == shown


def test_an_error_does_not_end_the_shell(terminal: Terminal, keys: PipeInput, capsys) -> None:
    run(terminal, keys, f"zz;{ENTER}", f"(1;{ENTER}{ENTER}", f"'open{ENTER}", f".nothing{ENTER}", f"2;{ENTER}")
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "2"
    assert [line.split("]")[0] for line in err.splitlines() if line.startswith("error")] == [
        "error[R001", "error[P001", "error[P003", "error: there is no command '.nothing'"]  # fmt: skip


def test_words_of_newcomers(terminal: Terminal, keys: PipeInput, capsys) -> None:
    run(terminal, keys, f"help{ENTER}", f"quit{ENTER}", f"7;{ENTER}")
    lines = results(capsys)
    assert lines[0].startswith("A statement ends with ;")
    assert "7" not in lines


def test_enter_takes_the_completion_that_is_chosen(terminal: Terminal, keys: PipeInput, capsys) -> None:
    run(terminal, keys, ".ti", lambda: menu(terminal), TAB, lambda: text(terminal) == ".timer", ENTER,
        lambda: not menu(terminal), ENTER)  # fmt: skip
    assert results(capsys)[0].startswith("timer: off")


def test_suggestions_while_typing_need_the_beginning_of_a_word(terminal: Terminal) -> None:
    def offered(typed: str, asked: bool) -> list[str]:
        event = CompleteEvent(completion_requested=asked, text_inserted=not asked)
        return [one.text for one in terminal.prompts.completer.get_completions(Document(typed), event)]

    assert offered("SELECT a FROM b ", asked=False) == []
    assert "WHERE" in offered("SELECT a FROM b ", asked=True)
    assert offered("SELECT a FROM b W", asked=False) == ["WHERE"]


@pytest.mark.parametrize(
    ("typed", "shown"),
    [("", "Ctrl-D leaves"), ("round(1, ", "round(x, digits)  the nearest"), ("1 +\n", "a statement ends with ;")],
)  # fmt: skip
def test_the_line_at_the_bottom(typed: str, shown: str, terminal: Terminal) -> None:
    assert shown in fragment_list_to_text(terminal.describe_toolbar(Document(typed)))


def test_the_line_at_the_bottom_and_suggestions_know_what_was_set(terminal: Terminal, keys: PipeInput) -> None:
    run(terminal, keys, f".engine native\r.timeout 5{ENTER}", f"harvest = 1;{ENTER}", "harv", lambda: menu(terminal))
    assert "harvest" in terminal.known.variables
    assert "engine native   timeout 5" in fragment_list_to_text(terminal.describe_toolbar(Document("")))


def test_colors_of_commands_and_statements() -> None:
    typed = "# a\n.sql SELECT 1;\n.read it's\nSELECT a FROM b;"
    found = [(str(kind)[6:], part) for _, kind, part in ShellLexer().get_tokens_unprocessed(typed)]
    assert "".join(part for _, part in found) == typed
    assert [part for kind, part in found if kind == "Keyword.Pseudo"] == [".sql", ".read"]
    assert [part for kind, part in found if kind == "Keyword"] == ["SELECT", "SELECT", "FROM"]
    assert ("Text", " it's") in found


def test_the_history_outlives_the_shell(keys: PipeInput, folder: Path, capsys) -> None:
    for typed in (f"1 +{ENTER}1;{ENTER}", f" 40 + 2;{ENTER}", f"{UP}{ENTER}"):
        with ss2sql.connect() as session:
            terminal = Terminal(Shell(session), input=keys, output=DummyOutput())
            run(terminal, keys, *([partial(remembered, terminal)] if UP in typed else []), typed)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.isdecimal()]
    assert lines == ["2", "42", "2"]  # a line that begins with a blank is not kept
    assert "40 + 2" not in (folder / "state" / "ss2sql" / "history").read_text()


def test_a_history_that_cannot_be_written(keys: PipeInput, folder: Path, capsys) -> None:
    """From some time on, or at all."""
    with ss2sql.connect() as session:
        terminal = Terminal(Shell(session), input=keys, output=DummyOutput())
        (folder / "state" / "ss2sql" / "history").unlink()
        (folder / "state" / "ss2sql" / "history").mkdir()
        run(terminal, keys, f"1;{ENTER}", f"2;{ENTER}")
    assert capsys.readouterr().out.splitlines()[-2:] == ["1", "2"]
    (folder / "state").rename(folder / "other")
    (folder / "state").write_text("a file")
    with ss2sql.connect() as session:
        run(Terminal(Shell(session), input=keys, output=DummyOutput()), keys, f"1;{ENTER}")
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "1"
    assert err.startswith("what you type will not be remembered: ")
    assert len(err.splitlines()) == 4


def test_the_history_is_for_its_owner_alone(folder: Path, monkeypatch) -> None:
    before = os.umask(0)
    try:
        path = open_history_file()
    finally:
        os.umask(before)
    assert path == folder / "state" / "ss2sql" / "history"
    assert (stat.S_IMODE(path.stat().st_mode), stat.S_IMODE(path.parent.stat().st_mode)) == (0o600, 0o700)
    assert list(_ShellHistory(str(path.parent)).load_history_strings()) == []  # nothing where it cannot be read
    path.chmod(0o644)
    assert stat.S_IMODE(open_history_file().stat().st_mode) == 0o600
    path.unlink()  # it follows no link
    (folder / "other").write_text("precious")
    path.symlink_to(folder / "other")
    with pytest.raises(OSError, match="history"):
        open_history_file()
    assert (folder / "other").read_text() == "precious"
    monkeypatch.setenv("HOME", str(folder))
    for value in ("", "relative/folder"):
        monkeypatch.setenv("XDG_STATE_HOME", value)
        assert find_state_folder() == folder / ".local" / "state" / "ss2sql"


def test_without_prompt_toolkit_an_error_says_how_to_get_it() -> None:
    code = (
        "import sys; sys.modules['prompt_toolkit'] = None; sys.stdin.isatty = lambda: True;"
        "from ss2sql.cli import main; main(['repl'])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert answer.returncode == 1
    assert "error[S003]: the shell needs the package prompt_toolkit, which is not installed" in answer.stderr
    assert "pip install prompt_toolkit" in answer.stderr
