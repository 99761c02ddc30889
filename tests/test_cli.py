"""The command line: scripts and what they may use, how a run ends, what a script and its results become, lists."""

from __future__ import annotations

import ast
import csv
import gc
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from click.shell_completion import ShellComplete
from command_lines import ENDLESS, FUNCTIONS, bad, call, good, moved_into, press_ctrl_c_after, process, value
from golden import each_row

import ss2sql
from ss2sql.cli import COMMANDS, main, output
from ss2sql.cli import script_commands as running
from ss2sql.cli.list_command import SHELLS, TOPICS
from ss2sql.cli.script_commands import ENGINES as ENGINES_OF_OPTION
from ss2sql.cli.script_commands import KINDS as KINDS_OF_OPTION
from ss2sql.errors import CODES
from ss2sql.language.operations import WRITTEN
from ss2sql.lowering.strategies import ORDERS, REPEAT_RULES
from ss2sql.results.plots import KINDS
from ss2sql.runtime.representations.shape import REPRESENTATIONS
from ss2sql.session.compiled_query import ENGINES
from ss2sql.session.session import OFF_SWITCHES
from ss2sql.vtables.contract import list_adapter_types

FACTORY = """
import os
def make(count, *, first=0):
    os.write(1, b'from C')  # as simulators do
    print('made')
    return [first + number for number in range(count)]
def fails(): return 1 / 0
def plain(): return [4]
class Group:
    rows = [8]
"""
TOUCH = "from pathlib import Path\ndef touch(x):\n    Path('touched').touch()\n    return x\n"
FILES = {
    "functions.py": FUNCTIONS, "query.ss": "numbers = [1, 2, 3];\nSELECT this FROM numbers\nWHERE this > 1 AS list;\n",
    "wrong.ss": "SELECT this\nFROM nowhere;", "syntax.py": "def f(:\n", "fails.py": "x = 1\ny = x / 0\n",
    "keywords.py": "def f(*, a): return a\n", "touch.py": TOUCH, "factory.py": FACTORY,
    "scene.py": "bodies = [{'mass': 1}, {'mass': 5}]\nclass Space(list):\n  def __init__(self): self.append(7)\n",
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, staff: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a command line, with a database of four people in `data.db`."""
    (tmp_path / "binary.ss").write_bytes(b"\xff\xfe")
    (tmp_path / "folder").mkdir()
    return moved_into(tmp_path, monkeypatch, FILES)


@each_row("command_line/errors", "line", "told")
def test_wrong_command_lines(line: str, told: str) -> None:
    code, _, words = told.partition(" ")
    error = bad(int(code), *shlex.split(line), stdin=b"\xff")
    assert "runpy" not in error
    assert error.startswith("error[") or not words.startswith("error[")
    for part in words.split(" | "):
        assert part in error or part in error.replace("'", "")  # older ones of click have no quotes there


def test_an_exception_of_the_users_function() -> None:
    answer = call("run", "-e", "SELECT broken(this) FROM [1];", "--functions", "functions.py")
    assert answer.exit_code == 1
    assert 'functions.py", line 13, in broken' in answer.stderr
    assert "TypeError: unsupported operand" in answer.stderr
    assert "raised by the function 'broken', called at <script>:1:8" in answer.stderr
    assert "ss2sql" not in answer.stderr.replace("\\", "/")


@each_row("command_line/values", "line", "told")
def test_values(line: str, told: str, folder: Path) -> None:
    before = (folder / "data.db").read_bytes()
    assert value(*shlex.split(line), stdin="SELECT 'größe' FROM [1] AS list;") == ast.literal_eval(told)
    assert (folder / "data.db").read_bytes() == before


def test_attached_files() -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    pytest.importorskip("duckdb")
    parquet.write_table(pa.table({"who": [1, 1, 2], "hours": [3.5, 4.0, None]}), "work.parquet")
    files = ("--attach", "work=work.parquet", "--attach", "s=data.db")
    script = "SELECT name, hours FROM s.staff, work WHERE id == who AS rows;"
    assert value("-e", script, *files) == [["Ada", 3.5], ["Ada", 4.0], ["Bob", None]]
    assert "error[S002]: missing.parquet is not" in bad(1, "run", "-e", "1;", "--attach", "w=missing.parquet")
    assert value("-e", "SELECT max(hours) FROM work GROUP BY 1 AS list;", *files, "--engine", "duckdb") == [4.0]


def test_functions_of_a_python_file() -> None:
    def printed(script: str) -> tuple[int, str, str]:
        answer = call("run", "-e", script, "--functions", "functions.py")
        return answer.exit_code, answer.stdout, answer.stderr

    assert printed("double(21);") == (0, "42\n", "loading\n")  # a file may print, but not among the results
    assert "2.5" in printed("SELECT mass FROM [Body(2.5)] AS value;")[1]
    ends = [printed(f"{name}(1);")[0] for name in ("root", "_hidden", "dataclass", "sqrt")]
    assert ends == [1, 1, 1, 0]  # sqrt is built in


def test_worlds_that_print() -> None:
    script = "SELECT this FROM w AS list;"
    answer = process("run", "-e", script, "--world", "w=factory:make(3, first=5)", "--format", "json")
    stdout, stderr = answer.communicate(timeout=60)
    assert stdout == "[5, 6, 7]\n"
    assert "made" in stderr
    assert "from C" in stderr


def test_a_scene() -> None:
    pytest.importorskip("pybullet")
    script = "SELECT count(*) FROM space WHERE hasBody(this) GROUP BY 1 AS value;"
    assert "7" in call("run", "-e", script, "--world", "space=ss2sql.scenes:chaos(bodies=7)", "--format", "json").stdout
    shown = bad(1, "run", "-e", script, "--world", "space=factory.py:nothing")
    assert "factory.py has no 'nothing'" in shown
    assert "make" in shown
    assert "did you mean 'chaos'?" in bad(1, "run", "-e", script, "--world", "space=ss2sql.scenes:chaso")


def test_maximum_timeout_and_too_little_memory() -> None:
    assert len(value("-e", ENDLESS, "--maximum", "3")) == 3
    started = time.monotonic()
    answer = call("run", "-e", ENDLESS, "--timeout", "0.1")
    assert time.monotonic() - started < 30
    assert answer.exit_code == 124
    assert answer.stderr.startswith("error[T001]: the run took longer than its timeout\n")
    assert "raise the timeout" in answer.stderr
    found = re.search(r"^broken off; ([\d,]+) paths had been found$", answer.stderr, re.MULTILINE)
    assert found
    assert f"{found[1]} paths, " in answer.stdout.splitlines()[-1]
    assert answer.stdout.endswith(", database, timeout\n")
    answer = call("run", "-e", ENDLESS, "--max-memory", "1000000", "--show", "1")
    assert answer.exit_code == 1
    assert answer.stdout.rstrip().endswith(", memory")  # what was found
    assert "error[T003]" in answer.stderr
    assert "or raise max_memory" in answer.stderr


@pytest.mark.parametrize(
    ("line", "stdin", "code", "printed", "told"),
    [("run - --format json", "SELECT this FROM [1, 2] AS list;", 0, "[1, 2]\n", ""),
     ("run -", "SELECT this FROM\nnowhere;", 1, "", " --> <stdin>:2:1\n"),
     ("run --format csv", "SELECT this FROM [1];", 0, "this\n1\n", ""),
     ("run --format csv -c n=2 -e n", None, 0, "value\n2\n", ""),
     ("run query.ss --engine oracle", None, 2, "", "Usage:")],
)  # fmt: skip
def test_as_a_process(line: str, stdin: str | None, code: int, printed: str, told: str) -> None:
    answer = process(*line.split())
    stdout, stderr = answer.communicate(stdin, timeout=60)
    assert (answer.returncode, stdout) == (code, printed)
    assert told in stderr
    assert bool(stderr) == bool(told)


@pytest.mark.usefixtures("usual")
@pytest.mark.parametrize("engine", ["database", pytest.param("native", marks=pytest.mark.slow)])
def test_ctrl_c(engine: str) -> None:
    script = "touch(1); " + ENDLESS
    with process("run", "-e", script, "--functions", "touch.py", "--engine", engine, "--timeout", "60") as answer:
        try:
            press_ctrl_c_after(Path("touched"), answer)
            pressed = time.monotonic()
            stdout, stderr = answer.communicate(timeout=30)
            assert time.monotonic() - pressed < 25
        finally:
            answer.kill()
    assert answer.returncode == 130
    assert re.fullmatch(r"cancelled; [\d,]+ paths had been found\n", stderr)
    told = " ".join(stdout.split())  # the line is wrapped where there are many paths
    assert re.search(rf"[\d,]+ paths, [\d,]+ rows, the first 20 paths shown, {engine}, cancelled$", told)


@pytest.mark.parametrize("engine", ["native", "database", "duckdb"])
def test_the_engine_is_chosen(engine: str) -> None:
    if engine == "duckdb":
        pytest.importorskip("duckdb")
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this;"
    assert good("run", "-e", script, "--engine", engine).splitlines()[-1] == f"2 paths, 2 rows, {engine}"
    if engine == "duckdb":
        message = bad(1, "run", "-e", script.replace("UNIQUE", "DEPTH FIRST"), "--engine", engine)
        assert "error[U001]: DEPTH FIRST does not go level by level" in message


def test_the_stages() -> None:
    script = "SELECT this FROM [1, 2] WHERE this > 1 AS list;"
    sql = "SELECT\n  this.this\nFROM elements(:p1 /* [1, 2] */) AS this\nWHERE\n  this.this > 1\n-- :p1 = [1, 2]\n"
    for arguments in (("-e", script), ("-e", script, "--stage", "sql"), ("-",)):
        assert good("sql", *arguments, stdin=script) == sql
    assert good("sql", "-e", script, "--stage", "ast").startswith("Query(columns=(This(source=None),)")
    assert good("sql", "query.ss", "--stage", "ast").count("\n") == 2


def test_sql_runs_nothing_and_knows_functions_parameters_and_tables() -> None:
    good("sql", "-e", "touch(1); SELECT touch(this) FROM [1];", "--functions", "touch.py")
    assert not Path("touched").exists()
    arguments = ("sql", "-e", "SELECT name FROM staff WHERE id == wanted AND id != other;",
                 "--database", "data.db", "-p", "wanted", "3")  # fmt: skip
    printed = good(*arguments)
    assert "staff.id" in printed
    assert ":wanted" in printed
    assert "parameters other" in good(*arguments, "--stage", "plan")


def test_help_and_version() -> None:
    assert "SelectScript" in good("--help")
    assert "--functions" in good("run", "-h")
    assert f"version {ss2sql.__version__}" in good("--version")


def listed(*arguments: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(call("list", *arguments, "--format", "json").stdout)
    return found


def test_lists_are_complete_and_show_one() -> None:
    strategies = {order.keyword for order in ORDERS.values()} | {guard.keyword for guard in REPEAT_RULES.values()}
    known = {"functions": WRITTEN, "representations": REPRESENTATIONS, "strategies": strategies - {""} | {"(none)"},
             "worlds": list_adapter_types(), "errors": CODES, "rewrites": OFF_SWITCHES}  # fmt: skip
    assert set(known) == set(TOPICS) == {entry["name"] for entry in listed()}
    for topic, names in known.items():
        assert {entry["name"] for entry in listed(topic)} == set(names)
    # They are written down once more, so that completion need not import the package.
    assert (ENGINES_OF_OPTION, KINDS_OF_OPTION) == (ENGINES, KINDS)
    assert listed("errors", "x001") == [
        {"name": "X001", "title": CODES["X001"].title, "text": CODES["X001"].explanation}
    ]
    assert good("list", "functions", "len").splitlines()[:3] == ["name: len", "arguments: x", "volatility: immutable"]
    assert listed("strategies", "no", "cycle")[0]["decides"] == "repeats"


@pytest.mark.parametrize("topic", TOPICS)
def test_every_entry_is_told_in_a_line(topic: str) -> None:
    entries = listed(topic)
    lines = good("list", topic).splitlines()
    assert lines[0].split() == list(entries[0])
    assert len(lines) == len(entries) + 1
    for entry, line in zip(entries, lines[1:], strict=True):
        assert entry["text"]
        assert all(text in line for text in entry.values())


def test_functions_and_worlds_of_the_user() -> None:
    (entry, *_) = listed("functions", "double", "--functions", "functions.py")
    assert (entry["arguments"], entry["volatility"]) == ("x", "immutable")
    assert entry["text"].startswith("Twice the value; immutable: ")
    pytest.importorskip("pybullet")
    world = ("--world", "space=ss2sql.scenes:chaos(bodies=2)")
    assert "FROM space.links" in call("list", "worlds", *world).stdout
    assert listed("representations", *world)[-1]["name"] not in REPRESENTATIONS


@pytest.mark.parametrize(
    ("words", "expected"),
    [("", list(COMMANDS)), ("co", ["completion"]), ("run --eng", ["--engine"]), ("list err", ["errors"]),
     ("run --engine d", ["database", "duckdb"]),
     ("sql --dialect ", ["sqlite", "duckdb", "spark", "postgres"]),
     ("run -o t", ["t"]), ("completion ", list(SHELLS))],
    ids=str,
)  # fmt: skip
def test_what_is_completed(words: str, expected: list[str]) -> None:
    """Of `-o t` there is only what was typed: the shell goes on with the names of files."""

    def completed(*words: str) -> list[str]:
        *before, incomplete = words
        return [item.value for item in ShellComplete(main, {}, "ss2sql", "_").get_completions(before, incomplete)]

    assert completed(*words.split(" ")) == expected
    assert "--help" in completed("--")


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_for_shells(shell: str) -> None:
    script = good("completion", shell)
    assert f"_SS2SQL_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        answer = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True, timeout=60, check=False)
        assert (answer.returncode, answer.stderr) == (0, "")


# --- what becomes of results: tables, data, files and pictures; and errors as JSON -----------------------------

TABLE = "SELECT this, str(this) FROM range(3);"
THIRTY = "SELECT this, this ^ 2 FROM range(30);"


@pytest.mark.parametrize(("given", "rows"), [("", 20), ("5", 5), ("0", 0), ("all", 30), ("ALL", 30), ("1000", 30)])
def test_so_many_rows_are_shown(given: str, rows: int) -> None:
    lines = good("run", "-e", THIRTY, *(("--show", given) if given else ())).splitlines()
    assert "this ^ 2" in lines[1]
    assert len([line for line in lines if line.startswith("│")]) == rows
    assert lines[-1] == ("30 rows, native" if rows == 30 else f"30 rows, the first {rows} shown, native")


@pytest.mark.parametrize(
    ("script", "printed"), [("1 + 1;", "2\n"), ("'text';", "text\n"), ("None;", "None\n"), ("[1, 'a'];", "[1, 'a']\n")]
)
def test_values_that_are_no_table(script: str, printed: str) -> None:
    assert good("run", "-e", script) == printed


def test_colors_are_for_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "\x1b" not in good("run", "-e", TABLE)  # no terminal
    assert "\x1b" in good("run", "-e", TABLE, "--color")
    assert "\x1b" not in good("run", "-e", TABLE, "--no-color")
    assert "\x1b" in bad(1, "run", "-e", "x", "--color")
    assert "\x1b" not in bad(1, "run", "-e", "x")
    stream: Any = Terminal()
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert output.wants_color(stream)
    for name, given, wanted in (("NO_COLOR", "1", False), ("NO_COLOR", "", True), ("TERM", "dumb", False)):
        monkeypatch.setenv(name, given)
        assert output.wants_color(stream) is wanted


class Terminal:
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("script", "form", "told"),
    [("SELECT 'größe' FROM [1] AS list;", "table", "gr\\xf6\\xdfe"), ("SELECT 'größe' FROM [1] AS list;", "json", None),
     pytest.param("'größe'", "table", "gr\\xf6\\xdfe\n", marks=pytest.mark.slow),
     pytest.param("größe", "table", "unknown name 'gr", marks=pytest.mark.slow)],
)  # fmt: skip
def test_text_that_the_terminal_has_no_characters_for(script: str, form: str, told: str | None) -> None:
    answer = process("run", "-e", script, "--format", form, PYTHONIOENCODING="ascii")
    stdout, stderr = answer.communicate(timeout=60)
    assert (answer.returncode, bool(stderr)) == ((1, True) if script == "größe" else (0, False))
    if told is None:
        assert json.loads(stdout) == ["größe"]  # data is UTF-8
    else:
        assert told in stdout + stderr
        assert stdout.isascii()


@pytest.mark.parametrize("form", ["table", "csv", "json"])
@pytest.mark.parametrize("unbuffered", ["", pytest.param("1", marks=pytest.mark.slow)])
def test_a_reader_that_has_enough(form: str, unbuffered: str) -> None:
    answer = process("run", "-e", "SELECT this FROM range(20000);", "--show", "all", "--format", form,
                     PYTHONUNBUFFERED=unbuffered)  # fmt: skip
    assert answer.stdout is not None
    assert answer.stderr is not None
    answer.stdout.read(5)
    answer.stdout.close()
    assert answer.stderr.read() == ""
    assert answer.wait(60) == 1
    answer.stderr.close()
    assert answer.stdin is not None
    answer.stdin.close()


@each_row("command_line/json", "script", "told")
def test_json(script: str, told: str) -> None:
    expected = ast.literal_eval(told)
    answer = call("run", "-e", script, "--functions", "functions.py", "--format", "json")
    assert (json.loads(answer.stdout), answer.stderr) == (expected, "loading\n")


@each_row("command_line/csv", "script", "told")
def test_csv(script: str, told: str) -> None:
    rows = ast.literal_eval(told)
    assert list(csv.reader(io.StringIO(good("run", "-e", script, "--format", "csv")))) == rows


def test_what_a_script_prints_goes_beside_its_result() -> None:
    answer = call("run", "-e", "print('log'); 7;", "--format", "json", "--functions", "functions.py")
    assert (answer.stdout, answer.stderr) == ("7\n", "loading\nlog\n")


def written(name: str, *more: str, script: str = TABLE) -> Path:
    answer = call("run", "-e", script, "-o", name, *more)
    assert (answer.exit_code, answer.stdout) == (0, "")
    assert answer.stderr.startswith(f"written to {name}: ")
    return Path(name)


def test_the_end_of_the_name_says_the_format() -> None:
    assert written("t.csv").read_bytes() == b"this,str\n0,0\n1,1\n2,2\n"
    assert json.loads(written("t.json").read_bytes())[0] == {"this": 0, "str": "0"}
    assert written("t.TXT").read_text("utf-8").endswith("└──────┴─────┘\n3 rows, native\n")
    assert written("t.txt", script="1 + 1").read_text("utf-8") == "2\n"
    assert written("t.txt", "--format", "csv").read_text("utf-8").startswith("this,")
    assert written("t.data", "--format", "json").read_text("utf-8").startswith("[")
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    expected = {"this": [0, 1, 2], "str": ["0", "1", "2"]}
    for name, read in (("t.arrow", pyarrow.ipc.open_file), ("t.feather", pyarrow.ipc.open_file),
                       ("t.arrows", pyarrow.ipc.open_stream)):  # fmt: skip
        assert read(written(name)).read_all().to_pydict() == expected
    assert parquet.read_table(written("t.parquet")).to_pydict() == expected
    for form, read in (
        ("arrow", lambda file: pyarrow.ipc.open_stream(file).read_all()),
        ("parquet", parquet.read_table),
    ):
        code = subprocess.run([sys.executable, "-m", "ss2sql", "run", "-e", TABLE, "--format", form],
                              capture_output=True, check=True, timeout=60)  # fmt: skip
        assert read(pyarrow.BufferReader(code.stdout)).to_pydict() == expected


def test_terminals_get_no_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output.sys, "stdout", Terminal())
    for form in output.BINARY:
        with pytest.raises(Exception, match=f"--output FILE.{form}"):
            output.make_output(form, None)
        assert output.make_output(form, Path("a")).form == form


@pytest.mark.parametrize(("name", "start"), [("p.png", b"\x89PNG"), ("p.svg", b"<?xml"), ("p.PDF", b"%PDF")])
def test_pictures(name: str, start: bytes) -> None:
    pytest.importorskip("matplotlib")
    answer = call("plot", "-e", THIRTY, "-o", name, "--kind", "line", "--title", "T")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "", f"written to {name}: 30 rows\n")
    assert Path(name).read_bytes().startswith(start)


def test_what_cannot_be_drawn() -> None:
    pytest.importorskip("matplotlib")
    assert "error[V001]" in bad(1, "plot", "-e", "SELECT 'a', 'b' FROM [1];", "-o", "p.png")
    assert not Path("p.png").exists()
    assert "there is no folder nowhere" in bad(1, "plot", "-e", "1", "-o", "nowhere/t.png")


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what was found, little is written: an endless search finds very much. No timeout has to wait for imports."""
    monkeypatch.setattr(running, "MOST_BROKEN_OFF", 100)
    for engine in ("database", "native"):
        assert call("run", "-e", ENDLESS, "--maximum", "1", "--engine", engine).exit_code == 0


def broken_off(*arguments: str) -> tuple[Any, str]:
    gc.collect()  # the paths of the run before would be let go of within the time of this one
    answer = call("run", "--timeout", "0.3", "--format", "json", *arguments)
    assert answer.exit_code == 124
    return json.loads(answer.stdout), answer.stderr


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize(
    ("form", "first"), [(" AS list", [1]), ("", [{"this": 1}]), (" AS rows", [[1]]), (" AS set", [{"this": 1}])]
)
def test_data_has_the_form_that_was_asked_for(form: str, first: list[Any], engine: str) -> None:
    found, error = broken_off("-e", f"{ENDLESS}{form};", "--engine", engine)
    assert found[:2] == [first, first * 2]
    assert "broken off; " in error


def test_no_more_data_than_can_be_written_or_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "MOST_BROKEN_OFF", 6)
    found, error = broken_off("-e", f"{ENDLESS} AS list;")
    assert found == [[1], [1, 1], [1, 1, 1]]
    assert error.startswith("the first 3 of ")
    answer = call("run", "-e", ENDLESS.replace("START", "WHERE n == -1 START"), "--timeout", "0.5", "--format", "csv")
    assert (answer.exit_code, answer.stdout) == (124, "path,step,this\n")
    assert answer.stderr.endswith("\nbroken off; nothing had been found\n")


@pytest.mark.usefixtures("few")
def test_files_get_what_was_found() -> None:
    assert call("run", "-e", f"{ENDLESS};", "--timeout", "0.2", "-o", "found.csv").exit_code == 124
    assert Path("found.csv").read_text("utf-8").startswith("path,step,this\n1,1,1\n2,1,1\n2,2,1\n")
    pytest.importorskip("matplotlib")
    picture = ("-o", "p.png", "--kind", "lengths", "--most", "3")
    assert call("plot", "-e", f"{ENDLESS};", "--timeout", "0.2", *picture).exit_code == 124
    assert Path("p.png").exists()


def errors(code: int, *arguments: str) -> list[dict[str, Any]]:
    answer = call(*arguments, "--error-format", "json")
    assert answer.exit_code == code
    return [json.loads(line) for line in answer.stderr.splitlines()]


def test_errors_and_endings_are_objects(folder: Path) -> None:
    (folder / "wrong.ss").write_text("SELECT a,\n       this + b\nFROM [1];\n")
    first, second = errors(1, "run", "wrong.ss")
    assert first["code"] == second["code"] == "R001"
    assert (first["title"], first["message"]) == ("unknown name", "unknown name 'a'")
    assert [first[key] for key in output.PLACE] == ["wrong.ss", 1, 8, 1, 9]
    assert [second[key] for key in output.PLACE] == ["wrong.ss", 2, 15, 2, 16]
    cure = "assign it before, or give it a value: run(script, a=...), on a command line -p a VALUE"
    assert (first["hints"], first["related"]) == ([cure], [])
    (parse,) = errors(1, "sql", "-e", "max(SELECT this FROM [1]")
    assert parse["code"].startswith("P")
    assert parse["file"] == "<script>"
    (usage,) = errors(2, "run", "--enginge", "x")
    assert usage["title"] == "wrong usage"
    assert "Did you mean --engine?" in usage["message"].replace("'", "")
    (usage,) = errors(2, "run")
    assert "give a script" in usage["message"]
    (timeout,) = errors(124, "run", "-e", f"{ENDLESS};", "--timeout", "0.1")
    assert timeout["code"] == "T001"
    assert timeout["found"]["paths"] > 0
    Path("fails.py").write_text("def fails(x):\n    return x + 'a'\n")
    (exception,) = errors(1, "run", "-e", "fails(1)", "--functions", "fails.py")
    assert exception["code"] is None
    assert exception["message"].startswith("TypeError: ")
    assert (exception["line"], exception["column"], exception["end_column"]) == (2, 12, 19)
    assert exception["file"].endswith("fails.py")
    assert "raised by the function 'fails', called at <script>:1:1" in exception["notes"][0]
    (note,) = errors(0, "run", "-e", "1", "-o", "one.json")
    assert note["title"] == "note"
    assert value("-e", "1", "--error-format=json") == 1
