"""The command line: what goes to which stream, and with which exit code."""

from __future__ import annotations

import csv
import io
import json
import re
import signal
import sqlite3
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from command_lines import ENDLESS, FUNCTIONS, bad, call, good, process, value

import ss2sql


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    (tmp_path / "query.ss").write_text("numbers = [1, 2, 3];\nSELECT this FROM numbers\nWHERE this > 1 AS list;\n")
    return tmp_path


# --- where the script comes from -----------------------------------------------------------------------


def test_a_script_is_a_file_the_standard_input_or_text() -> None:
    assert value("query.ss") == [2, 3]
    assert value("-", stdin="SELECT 'größe' FROM [1] AS list;") == ["größe"]
    assert value("-e", "1 + 1") == 2
    assert value("--execute", "x = 2; x * 3;") == 6


@pytest.mark.parametrize("arguments", [(), ("query.ss", "-e", "1;"), ("query.ss", "query.ss"), (".",)])
@pytest.mark.parametrize("command", ["run", "sql"])
def test_one_script_is_needed(command: str, arguments: tuple[str, ...]) -> None:
    assert "Usage:" in bad(2, command, *arguments)


@pytest.mark.parametrize(
    "arguments",
    ["run -e 1 --engine oracle", "run -e 1 --format xml", "run -e 1 --timeout -1", "run -e 1 --maximum 0",
     "run -e 1 --functions missing.py", "run -e 1 --world module", "run -e 1 --world w=m:f(x)", "run -e 1 --world w=m",
     "sql -e 1 --stage c", "sql -e 1 --dialect c", "sql -e 1 --dialect sqlite --stage ast", "jump", "run --no",
     "run -e 1 --show -1", "run -e 1 --show few", "run -e 1 -o x.xyz", "run -e 1 -o x", "plot -e 1",
     "plot -e 1 -o x.gif", "plot -e 1 -o x.png --size 3", "plot -e 1 -o x.png --kind pie", "list things",
     "list errors X999", "completion tcsh", "completion"],
)  # fmt: skip
def test_wrong_usage(arguments: str) -> None:
    assert "Usage:" in bad(2, *arguments.split())


def test_p_takes_two_words() -> None:
    assert "requires 2 arguments" in bad(2, "run", "-e", "x;", "-p", "x")


def test_what_was_meant() -> None:
    assert "No such command 'rnu'. Did you mean 'run'?" in bad(2, "rnu")
    assert "The commands are run, " in bad(2, "xyzzy")
    told = bad(2, "run", "-e", "1", "--enginge", "native")
    assert "Did you mean --engine?" in told.replace("'", "")  # older ones of click have no quotes there
    assert "there is no dialect 'mysql'; SQL can be written in: sqlite" in bad(
        2, "sql", "-e", "1", "--dialect", "mysql"
    )
    assert "did you mean 'breadth first'" in bad(2, "list", "strategies", "bredth", "first").lower()


def test_files_that_cannot_be_read(folder: Path) -> None:
    (folder / "binary.ss").write_bytes(b"\xff\xfe")
    for command in ("run", "sql"):
        assert "error[S002]: the script missing.ss cannot be read" in bad(1, command, "missing.ss")
        assert "error[S002]: the script binary.ss cannot be read" in bad(1, command, "binary.ss")
        assert "error[S002]: the script on standard input cannot be read" in bad(1, command, "-", stdin=b"\xff")
    assert "cannot be read" in bad(1, "sql", "missing.ss", "--stage", "ast")


# --- what the script may use ---------------------------------------------------------------------------


def test_functions_of_a_python_file() -> None:
    answer = call("run", "-e", "double(21);", "--functions", "functions.py")
    assert (answer.stdout, answer.stderr) == ("42\n", "loading\n")  # a file may print, but not among the results
    script = "SELECT mass FROM [Body(2.5)] AS value;"
    assert "2.5" in call("run", "-e", script, "--functions", "functions.py").stdout
    for name in ("root", "_hidden", "dataclass", "sqrt"):
        answer = call("run", "-e", f"{name}(1);", "--functions", "functions.py")
        assert answer.exit_code == (0 if name == "sqrt" else 1)  # sqrt is built in


def test_a_file_of_functions_with_an_error(folder: Path) -> None:
    (folder / "syntax.py").write_text("def f(:\n")
    (folder / "fails.py").write_text("x = 1\ny = x / 0\n")
    (folder / "keyword.py").write_text("def f(*, a): return a\n")
    assert "SyntaxError" in bad(1, "run", "-e", "1;", "--functions", "syntax.py")
    error = bad(1, "run", "-e", "1;", "--functions", "fails.py")
    assert "ZeroDivisionError" in error
    assert 'fails.py", line 2' in error
    assert "runpy" not in error
    assert "error[S002]: f needs the keyword argument 'a'" in bad(1, "run", "-e", "1;", "--functions", "keyword.py")


@pytest.mark.parametrize(
    ("text", "expected"),
    [("3", 3), ("-3.5", -3.5), ("True", True), ("None", None), ("[1, (2, 3)]", [1, [2, 3]]), ("{'a': 1}", {"a": 1}),
     ("word", "word"), ("'word'", "word"), ("two words", "two words"), ("{[]}", "{[]}"), ("1 + 1", "1 + 1"), ("", ""),
     ("{2, 1}", [1, 2])],
)  # fmt: skip
def test_values_given_with_p(text: str, expected: Any) -> None:
    assert value("-e", "x;", "-p", "x", text) == expected


def test_any_name_can_be_given() -> None:
    options = [
        part for name in ("engine", "timeout", "maximum", "script", "value") for part in ("-p", name, f"'{name}'")
    ]
    assert value("-e", "[engine, timeout, maximum, script, value];", *options) == [
        "engine", "timeout", "maximum", "script", "value"]  # fmt: skip
    assert "error[S002]: '1x' is not a name" in bad(1, "run", "-e", "1;", "-p", "1x", "3")
    assert "error[X004]" in bad(1, "run", "-e", "1;", "-p", "x", "1e999")


def test_tables_of_a_database(folder: Path) -> None:
    with closing(sqlite3.connect("staff.db")) as connection, connection:
        connection.executescript("CREATE TABLE staff(id, name); INSERT INTO staff VALUES (1, 'Ada')")
    connection.close()
    before = (folder / "staff.db").read_bytes()
    assert value("-e", "v{5} = 1; SELECT name FROM staff AS list;", "--database", "staff.db") == ["Ada"]
    assert (folder / "staff.db").read_bytes() == before
    assert "cannot be opened" in bad(1, "run", "-e", "1;", "--database", "missing.db")


def test_attached_files(folder: Path) -> None:
    with closing(sqlite3.connect("staff.db")) as connection, connection:
        connection.executescript("CREATE TABLE people(id, name); INSERT INTO people VALUES (1, 'Ada')")
    pq.write_table(pa.table({"who": [1, 1, 2], "hours": [3.5, 4.0, None]}), "work.parquet")
    script = "SELECT name, hours FROM staff.people, work WHERE id == who AS rows;"
    files = ("--attach", "work=work.parquet", "--attach", "staff=staff.db")
    assert value("-e", script, *files) == [["Ada", 3.5], ["Ada", 4.0]]
    assert value("-e", "SELECT max(hours) FROM work GROUP BY 1 AS list;", *files, "--engine", "duckdb") == [4.0]
    assert "error[S002]: missing.parquet is not" in bad(1, "run", "-e", "1;", "--attach", "w=missing.parquet")
    assert "--attach takes NAME=FILE, not work.parquet" in bad(2, "run", "-e", "1;", "--attach", "work.parquet")


def test_worlds(folder: Path) -> None:
    (folder / "scene.py").write_text(
        "bodies = [{'mass': 1}, {'mass': 5}]\nclass Space(list):\n  def __init__(self): self.append(7)\n"
    )
    assert value("-e", "SELECT mass FROM w WHERE mass > 2 AS list;", "--world", "w=scene:bodies") == [5]
    assert value("-e", "SELECT this FROM w AS list;", "--world", "w=scene:Space") == [7]
    for world in ("w=scene:nothing", "w=nothing:bodies"):
        assert "error[S002]: the world" in bad(1, "run", "-e", "1;", "--world", world)
    assert "did you mean 'bodies'?" in bad(1, "run", "-e", "1;", "--world", "w=scene:bodis")


def test_worlds_that_are_made(folder: Path) -> None:
    (folder / "factory.py").write_text(
        "import os\n"
        "def make(count, *, first=0):\n"
        "    os.write(1, b'from C')\n"  # as simulators do
        "    print('made')\n"
        "    return [first + number for number in range(count)]\n"
        "def fails(): return 1 / 0\n"
        "def plain(): return [4]\n"
        "class Group:\n"
        "    rows = [8]\n"
    )
    script = "SELECT this FROM w AS list;"
    answer = process("run", "-e", script, "--world", "w=factory:make(3, first=5)", "--format", "json")
    stdout, stderr = answer.communicate(timeout=60)
    assert stdout == "[5, 6, 7]\n"
    assert "made" in stderr
    assert "from C" in stderr
    assert value("-e", script, "--world", "w=factory:plain") == [4]
    assert value("-e", script, "--world", "w=factory.py:plain") == [4]
    assert value("-e", script, "--world", "w=factory:Group.rows") == [8]
    error = bad(1, "run", "-e", script, "--world", "w=factory:fails()")
    assert "ZeroDivisionError" in error
    assert 'factory.py", line 6, in fails' in error
    assert "TypeError" in bad(1, "run", "-e", script, "--world", "w=factory:make(1, 2, 3)")


def test_a_scene(folder: Path) -> None:
    pytest.importorskip("pybullet")
    script = "SELECT count(*) FROM space WHERE hasBody(this) GROUP BY 1 AS value;"
    assert "7" in call("run", "-e", script, "--world", "space=ss2sql.scenes:chaos(bodies=7)", "--format", "json").stdout
    assert "did you mean 'chaos'?" in bad(1, "run", "-e", script, "--world", "space=ss2sql.scenes:chaso")


# --- how results are printed ---------------------------------------------------------------------------


def test_a_table_is_the_default() -> None:
    lines = good("run", "-e", "SELECT this, this ^ 2 FROM range(30);").splitlines()
    assert "this ^ 2" in lines[1]
    assert len([line for line in lines if line.startswith("│")]) == 20
    assert lines[-1] == "30 rows, the first 20 shown, database"
    assert good("run", "-e", "1 + 1;") == "2\n"
    assert good("run", "-e", "'text';") == "text\n"
    assert good("run", "-e", "None;") == "None\n"
    assert good("run", "-e", "[1, 'a'];") == "[1, 'a']\n"


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("SELECT this, this / 2 FROM [1, 2];", [{"this": 1, "this / 2": 0.5}, {"this": 2, "this / 2": 1.0}]),
        ("SELECT this FROM [2, 1, 2] AS set;", [1, 2]),
        ("SELECT this, 1 FROM [2] AS rows;", [[2, 1]]),
        ("SELECT this FROM [1, 2, 3] GROUP BY this % 2 AS list;", {"1": [1, 3], "0": [2]}),
        ("SELECT this FROM [1, 2] GROUP BY this > 1, [this] AS list;", {"[false, [1]]": [1], "[true, [2]]": [2]}),
        ("SELECT this FROM [1] AS void;", None),
        ("SELECT this FROM [[1, None], True, 1.0, 'ä\\u2028'] AS list;", [[1, None], True, 1.0, "ä\u2028"]),
        ("SELECT this FROM [1, 2] WHERE n < 2 START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1 AS list;",
         [[1], [1, 1], [1, 2], [2], [2, 1], [2, 2]]),
    ],
)  # fmt: skip
def test_json(script: str, expected: Any) -> None:
    assert value("-e", script) == expected


def test_json_of_what_json_has_no_form_for() -> None:
    for script, expected in (("[Body(1)];", ["Body(mass=1)"]), ("lone();", "\ud800")):
        printed = call("run", "-e", script, "--functions", "functions.py", "--format", "json").stdout
        assert json.loads(printed) == expected


def test_csv() -> None:
    printed = good("run", "-e", "SELECT this, 'a,b' FROM [1, None, [1, 2]];", "--format", "csv")
    assert list(csv.reader(io.StringIO(printed))) == [
        ["this", "'a,b'"], ["1", "a,b"], ["", "a,b"], ["[1, 2]", "a,b"]]  # fmt: skip
    assert good("run", "-e", "SELECT this FROM [];", "--format", "csv") == "this\n"
    assert good("run", "-e", "7;", "--format", "csv") == "value\n7\n"
    search = "SELECT this FROM [1, 2] WHERE n < 1 START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 0;"
    assert good("run", "-e", search, "--format", "csv") == "path,step,this\n1,1,1\n2,1,2\n"


def test_what_a_script_prints_goes_beside_its_result() -> None:
    answer = call("run", "-e", "print('log'); 7;", "--format", "json", "--functions", "functions.py")
    assert answer.stdout.splitlines()[-1] == "7"
    assert "log" in answer.stderr.splitlines()
    assert "log" not in answer.stdout


def test_the_engine_is_chosen() -> None:
    assert good("run", "-e", "SELECT this FROM [1];", "--engine", "native").splitlines()[-1] == "1 row, native"
    assert good("run", "-e", "SELECT this FROM [1];", "--engine", "database").splitlines()[-1] == "1 row, database"
    assert "error[U001]" in bad(1, "run", "-e", "SELECT eval(this) FROM ['1'];", "--engine", "database")


def test_an_unknown_function_may_be_in_a_file() -> None:
    assert "--functions FILE.py; 'ss2sql list functions' lists the known ones" in call("run", "-e", "foo(1)").stderr


# --- how a run ends ------------------------------------------------------------------------------------


def test_maximum_and_timeout() -> None:
    assert len(value("-e", ENDLESS, "--maximum", "3")) == 3
    started = time.monotonic()
    answer = call("run", "-e", ENDLESS, "--timeout", "0.1")
    assert time.monotonic() - started < 5
    assert answer.exit_code == 124
    assert answer.stderr.startswith("error[T001]: the run took longer than its timeout\n")
    assert "raise --timeout" in answer.stderr  # not timeout=, which is for Python
    found = re.search(r"^broken off; ([\d,]+) paths had been found$", answer.stderr, re.MULTILINE)
    assert found
    assert f"{found[1].replace(',', '')} paths, " in answer.stdout.splitlines()[-1]
    assert answer.stdout.endswith(", database, timeout\n")


def test_errors_of_a_script(folder: Path) -> None:
    (folder / "wrong.ss").write_text("SELECT this\nFROM nowhere;")
    error = bad(1, "run", "wrong.ss")
    assert error.startswith("error[R003]: unknown source 'nowhere'\n --> wrong.ss:2:6\n")
    assert "error[P002]" in bad(1, "run", "-e", "SELECT this FROM")
    assert "error[X002]" in bad(1, "run", "-e", "1 / 0;")
    assert "error[P002]" in bad(1, "sql", "-e", "SELECT this FROM", "--stage", "ast")


def test_an_exception_of_the_users_function() -> None:
    answer = call("run", "-e", "SELECT broken(this) FROM [1];", "--functions", "functions.py")
    assert answer.exit_code == 1
    assert 'functions.py", line 13, in broken' in answer.stderr
    assert "TypeError: unsupported operand" in answer.stderr
    assert "raised by the function 'broken', called at <script>:1:8" in answer.stderr
    assert "ss2sql" not in answer.stderr.replace("\\", "/")


def test_as_a_process() -> None:
    answer = process("run", "-", "--format", "json")
    stdout, stderr = answer.communicate("SELECT this FROM [1, 2] AS list;", timeout=30)
    assert (answer.returncode, json.loads(stdout), stderr) == (0, [1, 2], "")
    answer = process("run", "-")
    stdout, stderr = answer.communicate("SELECT this FROM\nnowhere;", timeout=60)
    assert (answer.returncode, stdout) == (1, "")
    assert " --> <stdin>:2:1\n" in stderr
    answer = process("run", "query.ss", "--engine", "oracle")
    stdout, stderr = answer.communicate(timeout=30)
    assert (answer.returncode, stdout) == (2, "")


@pytest.mark.parametrize("engine", ["database", "native"])
def test_ctrl_c(engine: str, folder: Path) -> None:
    (folder / "begun.py").write_text(
        "from pathlib import Path\ndef begun(x):\n    Path('begun').touch()\n    return x\n"
    )
    script = "begun(1); " + ENDLESS
    answer = process("run", "-e", script, "--functions", "begun.py", "--engine", engine, "--timeout", "60")
    try:
        for _ in range(600):
            if (folder / "begun").exists():
                break
            time.sleep(0.05)
        time.sleep(0.2)
        pressed = time.monotonic()
        answer.send_signal(signal.SIGINT)
        stdout, stderr = answer.communicate(timeout=30)
        assert time.monotonic() - pressed < 5
    finally:
        answer.kill()
    assert answer.returncode == 130
    assert re.fullmatch(r"cancelled; [\d,]+ paths had been found\n", stderr)
    assert re.search(rf"\d+ paths, \d+ rows, the first 20 paths shown, {engine}, cancelled$", stdout.rstrip())


# --- what a script becomes -----------------------------------------------------------------------------


def test_the_stages(folder: Path) -> None:
    script = "SELECT this FROM [1, 2] WHERE this > 1 AS list;"
    assert good("sql", "-e", script).splitlines() == [
        "SELECT",
        "  this.this",
        "FROM elements(:p1 /* [1, 2] */) AS this",
        "WHERE",
        "  this.this > 1",
        "-- :p1 = [1, 2]",
    ]
    assert good("sql", "-e", script, "--stage", "sql") == good("sql", "-e", script)
    plan = good("sql", "-e", script, "--stage", "plan").splitlines()
    assert plan[:3] == ["subquery", "  query: query 1 as list", "    sources: source 2 this [int 1..2]"]
    ast = good("sql", "-e", script, "--stage", "ast")
    assert ast.startswith("Query(columns=(This(source=None),)")
    assert good("sql", "query.ss", "--stage", "ast").count("\n") == 2
    assert good("sql", "-", stdin=script) == good("sql", "-e", script)


def test_sql_runs_nothing(folder: Path) -> None:
    (folder / "effect.py").write_text(
        "from pathlib import Path\ndef effect(x):\n    Path('done').touch()\n    return x\n"
    )
    good("sql", "-e", "effect(1); SELECT effect(this) FROM [1];", "--functions", "effect.py")
    assert not (folder / "done").exists()


def test_sql_knows_functions_parameters_and_tables(folder: Path) -> None:
    with closing(sqlite3.connect("staff.db")) as connection, connection:
        connection.executescript("CREATE TABLE staff(id, name)")
    connection.close()
    script = "SELECT name FROM staff WHERE id == wanted AND id != other;"
    printed = good("sql", "-e", script, "--database", "staff.db", "-p", "wanted", "3")
    assert "staff.id" in printed
    assert ":wanted" in printed
    assert "parameters other" in good(
        "sql", "-e", script, "--database", "staff.db", "-p", "wanted", "3", "--stage", "plan"
    )


def test_help_and_version() -> None:
    assert "SelectScript" in good("--help")
    assert "--functions" in good("run", "-h")
    assert f"version {ss2sql.__version__}" in good("--version")


def test_limits_of_size_and_memory() -> None:
    message = bad(1, "run", "-e", "l = range(100000); l + l;", "--max-size", "900000")
    assert "error[X014]" in message
    assert message.rstrip().endswith("or raise --max-size")
    answer = call("run", "-e", ENDLESS, "--max-memory", "1000000", "--show", "1")
    assert answer.exit_code == 1
    assert answer.stdout.rstrip().endswith(", memory")  # what was found
    assert "error[T003]" in answer.stderr
    assert "or raise --max-memory" in answer.stderr
    assert "at least 262144, not 3" in bad(1, "run", "-e", "1;", "--max-size", "3")


def test_a_search_in_duckdb() -> None:
    pytest.importorskip("duckdb")
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this;"
    assert good("run", "-e", script, "--engine", "duckdb").splitlines()[-1] == "2 paths, 2 rows, duckdb"
    message = bad(1, "run", "-e", script.replace("UNIQUE", "DEPTH FIRST"), "--engine", "duckdb")
    assert "error[U001]: DEPTH FIRST goes on from the last step" in message
