"""The shell without a terminal: cutting what is typed, running it, dot commands; and the shell that reads a pipe."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import command_lines
import pytest
from click.testing import CliRunner, Result
from golden import each_row

import ss2sql
from ss2sql.cli import main
from ss2sql.shell import shell as pipes
from ss2sql.shell.dot_commands import COMMANDS, SETTINGS, Settings
from ss2sql.shell.shell import Shell, run_piped
from ss2sql.shell.statement_splitter import is_typed_input_ready, split_statements

ENDLESS = command_lines.ENDLESS + ";"
FUNCTIONS = '''
from pathlib import Path

def twice(x):
    """Twice the value."""
    return 2 * x

def broken(x):
    return x + "a"

def begun():
    Path("begun").touch()
'''


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return command_lines.moved_into(tmp_path, monkeypatch, {"functions.py": FUNCTIONS})


@pytest.fixture
def shell():
    with ss2sql.connect() as session:
        yield Shell(session)


def said(shell: Shell, text: str, capsys: pytest.CaptureFixture[str]) -> tuple[str, str]:
    """What a text has the shell print, on stdout and on stderr."""
    shell.run_text(text)
    return capsys.readouterr()


@pytest.mark.parametrize(
    ("typed", "expected"),
    [("", []), ("  # nothing\n", []), (";;", []), ("1; 2;", ["1;", "2;"]), ("1; 2", ["1;", "2"]),
     ("IF(a; b; c); 2;", ["IF(a; b; c);", "2;"]), ("'a;b'; \"c;\";", ["'a;b';", '"c;";']),
     ("1 # a;\n + 2; /* ; */ 3;", ["1 # a;\n + 2;", "3;"]), (".tables\n1;", [".tables", "1;"]),
     ("# first\n.sql SELECT 'it; # /* (\n.5 + 1;", [".sql SELECT 'it; # /* (", ".5 + 1;"]), ("x\n.y;", ["x\n.y;"]),
     ("a); b;", ["a);", "b;"]), ("'open; 2;\n3;", ["'open; 2;", "3;"]), ("1;\n  .help\n\n 2;", ["1;", ".help", "2;"])],
)  # fmt: skip
def test_typed_text_is_cut_into_statements_and_commands(typed: str, expected: list[str]) -> None:
    assert [piece.text for piece in split_statements(typed)] == expected
    assert [typed[piece.start : piece.end] for piece in split_statements(typed)] == expected
    assert all(
        piece.is_command == (piece.text in (".tables", ".help") or ".sql" in piece.text)
        for piece in split_statements(typed)
    )


@pytest.mark.parametrize(
    ("typed", "ready"),
    [("", True), ("1;", True), ("1", False), ("1; 2", False), ("SELECT a\nFROM b;", True), ("(1;", False),
     ("(1;\n", True), ("(1;\n2", False), ("1 /* ;", False), ("1; # more", True), (".help", True), ("x = 'open", True),
     ("x = 'a\\", False), ("x = 'a\\\nb';", True), ("IF(a; b", False), ("1;\n.tables", True), ("1\n\n", False)],
)  # fmt: skip
def test_when_enter_runs_what_was_typed(typed: str, ready: bool) -> None:
    assert is_typed_input_ready(typed) is ready


def test_results_are_tables_and_assignments_a_line_beside_them(shell: Shell, capsys) -> None:
    out, err = said(shell, "x = [3, 1];\nSELECT this FROM x; len(x); None; v{5} = 2;", capsys)
    assert out.splitlines()[-2:] == ["2 rows, native", "2"]
    assert "│    3 │" in out
    assert err.splitlines() == ["x = [3, 1]", "v = 2"]
    assert not shell.failed
    out, err = said(shell, "x = range(1000); range(10000);", capsys)  # long values are cut
    assert err.startswith("x = [0, 1, 2")
    assert len(err) < 120
    assert len(out) < 5000
    assert "characters, the first" in out


def test_an_error_or_exception_shows_the_line_and_the_session_goes_on(shell: Shell, capsys) -> None:
    out, err = said(shell, "x = 1;\n  y = zz; x = 2;", capsys)
    assert out == ""
    place = " --> <script>:2:7\n  |\n2 |   y = zz;\n  |       ^^\n"
    assert err.startswith(f"x = 1\nerror[R001]: unknown name 'zz'\n{place}")
    assert ".set zz VALUE" in err or "known here" in err
    assert shell.failed
    assert "help: register it with session.function, or by --functions" in said(shell, "quux(1);", capsys)[1]
    assert said(shell, "x;", capsys) == ("1\n", "")  # what stood behind the error has not run
    assert said(shell, ".load functions.py", capsys) == ("", "functions: twice, broken, begun\n")
    _, err = said(shell, "1;\n broken(2);", capsys)
    assert "TypeError" in err
    assert "called at <script>:2:2" in err
    assert "ss2sql" not in err
    assert said(shell, "twice(4);", capsys) == ("8\n", "")


def test_a_run_that_is_broken_off_shows_what_it_found(shell: Shell, capsys) -> None:
    shell.settings.timeout = 1.0
    out, err = said(shell, ENDLESS, capsys)
    assert err.startswith("error[T001]")
    assert "raise the timeout" in err
    assert out.splitlines()[-1].endswith(", timeout")
    assert "1 → 1" in out
    assert said(shell, "1 + 1;", capsys) == ("2\n", "")


def test_ctrl_c_ends_the_run_only(engine: str, shell: Shell, capsys) -> None:
    shell.settings.engine = engine
    begun = threading.Event()

    @shell.session.function
    def start(x):
        begun.set()
        return x

    def press() -> None:
        begun.wait(30)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    pressing = threading.Thread(target=press)
    pressing.start()
    try:
        out, err = said(shell, f"start(1); {ENDLESS}", capsys)
    finally:
        pressing.join()
        signal.signal(signal.SIGINT, before)
    assert err.startswith("cancelled; ")
    assert out.splitlines()[-1].endswith(", cancelled")
    assert said(shell, "1 + 1;", capsys) == ("2\n", "")


def test_settings_change_runs(shell: Shell, capsys) -> None:
    assert said(shell, ".maximum 2\n.format json", capsys) == ("", "maximum: 2\nformat: json\n")
    assert json.loads(said(shell, ENDLESS, capsys)[0]) == [[{"this": 1}], [{"this": 1}, {"this": 1}]]
    out, _ = said(shell, ".maximum off\n.format table\n.engine native\n.show 1\nSELECT this FROM [1, 2];", capsys)
    assert out.splitlines()[-1] == "2 rows, the first 1 shown, native"
    assert said(shell, ".timer on\n1;", capsys)[0].splitlines()[-1].count(" s: ") == 1
    said(shell, ".timer off\n.engine auto\n.show 20", capsys)
    for name in SETTINGS:  # each takes what it shows
        shown = said(shell, f".{name}", capsys)[0].split()[1]
        assert said(shell, f".{name} {shown}", capsys) == ("", f"{name}: {shown}\n")
    assert shell.settings == Settings()


def test_help_names_every_command_and_has_an_example(shell: Shell, capsys) -> None:
    out, _ = said(shell, ".help", capsys)
    assert [line for line in COMMANDS if f"  {line} " not in out] == []
    example = next(line for line in out.splitlines() if "SELECT" in line)
    assert "rows, native" in said(shell, example, capsys)[0]
    for name in COMMANDS:
        assert said(shell, f".help {name}", capsys)[0].startswith(name)
    assert said(shell, ".help connect by", capsys)[0].startswith("CONNECT BY: ")
    assert said(shell, ".help len", capsys)[0].startswith("len(x)")
    assert "did you mean 'len'?" in said(shell, ".help lenn", capsys)[1]


@each_row("shell/wrong", "line", "told")
def test_what_does_not_exist(line: str, told: str, shell: Shell, capsys) -> None:
    out, err = said(shell, line, capsys)
    assert out == ""
    assert err.startswith("error")
    assert told in err


def test_variables_functions_tables_and_objects(shell: Shell, capsys, folder: Path, staff: Path) -> None:
    assert said(shell, ".variables", capsys)[0].startswith("there are no variables")
    assert said(shell, ".tables", capsys)[0].startswith("FROM finds nothing yet")
    said(shell, ".set start [[2, 1], [], []]\n.set name Ada", capsys)
    assert shell.session.variables() == {"name": "Ada", "start": [[2, 1], [], []]}
    assert [line.split()[0] for line in said(shell, ".variables", capsys)[0].splitlines()] == ["name", "start"]
    said(shell, ".load functions.py", capsys)
    out, _ = said(shell, ".functions", capsys)
    lines = [line.strip() for line in out.splitlines()]
    assert lines[:3] == ["begun()", "broken(x)", "twice(x)   Twice the value."]  # the user's own come first
    for start in ("len(x)", "plane("):
        assert any(line.startswith(start) for line in lines)
    assert said(shell, ".functions twice", capsys)[0].split() == ["twice(x)", "Twice", "the", "value."]
    assert said(shell, ".tables", capsys)[0].split() == ["start", "this"]
    assert said(shell, ".attach work data.db", capsys) == ("", "tables: work.chiefs, work.staff\n")
    assert said(shell, ".tables", capsys)[0].split()[:5] == ["work.chiefs", "name", "work.staff", "id,", "boss,"]
    assert said(shell, ".tables work.staff", capsys)[0].splitlines()[0] == "FROM work.staff"
    assert "│ Ada  │" in said(shell, "SELECT name FROM work.staff;", capsys)[0]
    (folder / "somewhere.py").write_text("people = [{'name': 'Ada'}]\n")
    for line in (".attach people somewhere:people", ".attach people=somewhere:people"):
        assert said(shell, line, capsys)[1].startswith("people: list")
    assert "│ Ada  │" in said(shell, "SELECT name FROM people;", capsys)[0]


def test_a_file_is_read_up_to_its_first_error(shell: Shell, folder: Path, capsys) -> None:
    (folder / "inner.ss").write_text("a = 1;\n.format json\nb = zz;\nc = 3;\n")
    (folder / "outer.ss").write_text(".read inner.ss\nd = 4;\n")
    out, err = said(shell, ".read outer.ss\ne = 5;", capsys)
    assert out == ""
    assert err.startswith("a = 1\nformat: json\nerror[R001]")
    assert " --> inner.ss:3:5" in err
    assert shell.session.variables() == {"a": 1}
    (folder / "circle.ss").write_text(".read circle.ss")
    assert "reads itself" in said(shell, ".read circle.ss", capsys)[1]


def test_sql_and_explain_of_the_last_statement_or_of_a_script(shell: Shell, capsys) -> None:
    said(shell, "SELECT this FROM [1, 2] WHERE this > 1;", capsys)
    out, _ = said(shell, ".sql", capsys)
    assert "this.this > 1" in out
    assert "-- :p1 = [1, 2]" in out
    assert "engine: native" in said(shell, ".explain", capsys)[0]
    assert "this < 3" in said(shell, ".sql SELECT this FROM [7] WHERE this < 3;", capsys)[0]
    assert "SELECT a FROM b" in said(shell, ".explain SELECT a FROM b;", capsys)[0]
    said(shell, "1 + 1;", capsys)
    assert "no query" in said(shell, ".sql", capsys)[0]
    said(shell, "SELECT zz FROM range(2);", capsys)
    assert "error[R001]" not in said(shell, ".explain", capsys)[1]  # zz is a parameter then


def test_plot_writes_a_file(shell: Shell, folder: Path, capsys, monkeypatch) -> None:
    pytest.importorskip("matplotlib").use("agg")
    said(shell, "SELECT this, to(this ^ 2, square) FROM range(4);", capsys)
    assert said(shell, ".plot squares.png line", capsys) == ("", "written to squares.png\n")
    assert (folder / "squares.png").read_bytes().startswith(b"\x89PNG")
    for name in ("plot.png", "plot-2.png"):  # no picture takes the place of another
        assert said(shell, ".plot", capsys)[1] == f"written to {name}\n"
    assert "x.gif" in said(shell, ".plot x.gif", capsys)[1]
    assert "cannot be written" in said(shell, ".plot nowhere/x.png", capsys)[1]


def piped(text: str, *options: str) -> Result:
    answer = CliRunner().invoke(main, ["repl", *options], input=text)
    assert answer.exception is None or isinstance(answer.exception, SystemExit)
    return answer


def test_statements_come_from_a_pipe_also_after_an_error() -> None:
    answer = piped("x = 1;\nSELECT this\n  FROM [x];\n.set y 2\nx + y", "--format", "json")
    assert answer.stdout == '[{"this": 1}]\n3\n'
    assert (answer.exit_code, answer.stderr) == (0, "x = 1\ny = 2\n")
    assert piped("").stdout == ""
    assert piped("1;\n.exit\n2;").stdout == "1\n"
    answer = piped("a = 1;\nb = zz;\nc = 3; d = zz;\n\n 'open;\na + c;\n")
    assert answer.stdout == "4\n"
    assert [line for line in answer.stderr.splitlines() if "-->" in line] == [
        " --> <stdin>:2:5", " --> <stdin>:3:12", " --> <stdin>:5:2"]  # fmt: skip
    assert answer.exit_code == 1
    answer = piped(b"1;\n\xff;\n")  # type: ignore[arg-type]
    assert (answer.exit_code, answer.stdout) == (1, "1\n")
    assert "line 2 of the standard input cannot be read" in answer.stderr


def test_options_of_run_are_those_of_the_shell() -> None:
    options = ["--functions", "functions.py", "-p", "n", "[1, 2]", "--engine", "native", "--show", "1"]
    lines = piped("twice(3); SELECT this FROM n;", *options).stdout.splitlines()
    assert (lines[0], lines[-1]) == ("6", "2 rows, the first 1 shown, native")
    lines = piped(".timeout\n.maximum\n", "--timeout", "3", "--maximum", "4").stdout.splitlines()
    assert [line.split()[:2] for line in lines] == [["timeout:", "3"], ["maximum:", "4"]]


def test_a_pipe_is_read_line_by_line(shell: Shell, capsys, monkeypatch) -> None:
    seen: list[str] = []

    class Stream(io.RawIOBase):
        lines = iter([b"1;\n", b"2\n", b";\n"])

        def readline(self, size=-1):
            seen.append(capsys.readouterr().out)
            return next(self.lines, b"")

    run_piped(shell, Stream())  # type: ignore[arg-type]
    assert seen == ["", "1\n", "", "2\n"]
    cuts = []
    monkeypatch.setattr(pipes, "split_statements", lambda text: cuts.append(text) or split_statements(text))
    run_piped(shell, io.BytesIO(b"x = [\n" + b"1,\n" * 1000 + b"1];\n"))
    assert len(cuts) <= 2
    assert capsys.readouterr().err.startswith("x = [1, 1, 1")


@pytest.mark.parametrize("missing", [(), ("prompt_toolkit",)], ids=str)
def test_as_a_process(missing: tuple[str, ...]) -> None:
    """A pipe needs no prompt_toolkit."""
    code = f"import sys; sys.modules.update(dict.fromkeys({missing})); from ss2sql.cli import main; main(['repl'])"
    answer = subprocess.run([sys.executable, "-c", code], input="1 + 1;\n", capture_output=True, text=True, timeout=60)
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "2\n", "")


@pytest.mark.usefixtures("usual")
def test_ctrl_c_ends_a_pipe(folder: Path) -> None:
    with command_lines.process("repl", "--functions", "functions.py") as answer:
        try:
            loaded = "SELECT n FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n;"  # what the endless one needs
            answer.stdin.write(f"{loaded} begun(); {ENDLESS} 7;\n8;\n")
            answer.stdin.flush()
            command_lines.press_ctrl_c_after(folder / "begun", answer)
            out, err = answer.communicate(timeout=60)
        finally:
            answer.kill()
    assert answer.returncode == 130
    assert err.startswith("cancelled; ")
    assert out.splitlines()[-1].endswith(", cancelled")
