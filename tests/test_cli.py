"""The command line: what goes to which stream, and with which exit code."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from command_lines import ENDLESS, FUNCTIONS, bad, call, good, moved_into, press_ctrl_c_after, process, value

import ss2sql


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    query = "numbers = [1, 2, 3];\nSELECT this FROM numbers\nWHERE this > 1 AS list;\n"
    return moved_into(tmp_path, monkeypatch, {"functions.py": FUNCTIONS, "query.ss": query})


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


@pytest.mark.usefixtures("usual")
@pytest.mark.parametrize("engine", ["database", "native"])
def test_ctrl_c(engine: str, folder: Path) -> None:
    (folder / "begun.py").write_text(
        "from pathlib import Path\ndef begun(x):\n    Path('begun').touch()\n    return x\n"
    )
    script = "begun(1); " + ENDLESS
    with process("run", "-e", script, "--functions", "begun.py", "--engine", engine, "--timeout", "60") as answer:
        try:
            press_ctrl_c_after(folder / "begun", answer)
            pressed = time.monotonic()
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
