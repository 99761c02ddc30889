"""What results look like on stdout and in files, and errors as JSON."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_lines import ENDLESS, FUNCTIONS, bad, call, good, process, value

from ss2sql.cli import endings, output
from ss2sql.cli import run as running

TABLE = "SELECT this, str(this) FROM range(3);"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    return tmp_path


# --- tables --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("given", "rows"), [("5", 5), ("0", 0), ("all", 30), ("ALL", 30), ("1000", 30)])
def test_so_many_rows_are_shown(given: str, rows: int) -> None:
    lines = good("run", "-e", "SELECT this FROM range(30);", "--show", given).splitlines()
    assert len([line for line in lines if line.startswith("│")]) == rows
    assert lines[-1].startswith("30 rows, ")


def test_color() -> None:
    assert "\x1b" not in good("run", "-e", TABLE)  # no terminal
    assert "\x1b" in good("run", "-e", TABLE, "--color")
    assert "\x1b" not in good("run", "-e", TABLE, "--no-color")
    assert "\x1b" in bad(1, "run", "-e", "x", "--color")
    assert "\x1b" not in bad(1, "run", "-e", "x")


class Terminal:
    def isatty(self) -> bool:
        return True


def test_colors_are_for_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    stream: Any = Terminal()
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert endings.wants_color(stream)
    monkeypatch.setenv("NO_COLOR", "1")
    assert not endings.wants_color(stream)
    monkeypatch.setenv("NO_COLOR", "")  # is as if it was not there
    assert endings.wants_color(stream)
    monkeypatch.setenv("TERM", "dumb")
    assert not endings.wants_color(stream)


def test_text_that_the_terminal_has_no_characters_for() -> None:
    for given, printed in (("'größe'", "gr\\xf6\\xdfe\n"), ("SELECT 'größe' FROM [1] AS list;", "gr\\xf6\\xdfe")):
        answer = process("run", "-e", given, PYTHONIOENCODING="ascii")
        stdout, stderr = answer.communicate(timeout=60)
        assert (answer.returncode, stderr) == (0, "")
        assert printed in stdout
        assert stdout.isascii()
    answer = process("run", "-e", "SELECT 'größe' FROM [1] AS list;", "--format", "json", PYTHONIOENCODING="ascii")
    assert json.loads(answer.communicate(timeout=60)[0]) == ["größe"]  # data is UTF-8
    answer = process("run", "-e", "größe", PYTHONIOENCODING="ascii")
    assert "unknown name 'gr" in answer.communicate(timeout=60)[1]


@pytest.mark.parametrize("form", ["table", "csv", "json"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_enough(form: str, unbuffered: str) -> None:
    answer = process("run", "-e", "SELECT this FROM range(60000);", "--show", "all", "--format", form,
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


# --- files ---------------------------------------------------------------------------------------------


def written(name: str, *more: str, script: str = TABLE) -> Path:
    answer = call("run", "-e", script, "-o", name, *more)
    assert (answer.exit_code, answer.stdout) == (0, "")
    assert answer.stderr.startswith(f"written to {name}: ")
    return Path(name)


def test_the_end_of_the_name_says_the_format() -> None:
    assert written("t.csv").read_bytes() == b"this,str\n0,0\n1,1\n2,2\n"
    assert json.loads(written("t.json").read_bytes())[0] == {"this": 0, "str": "0"}
    assert written("t.TXT").read_text("utf-8").endswith("└──────┴─────┘\n3 rows, database\n")
    assert written("t.txt", script="1 + 1").read_text("utf-8") == "2\n"
    assert written("t.txt", "--format", "csv").read_text("utf-8").startswith("this,")
    assert written("t.data", "--format", "json").read_text("utf-8").startswith("[")


def test_files_of_arrow() -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    expected = {"this": [0, 1, 2], "str": ["0", "1", "2"]}
    assert pyarrow.ipc.open_file(written("t.arrow")).read_all().to_pydict() == expected
    assert pyarrow.ipc.open_file(written("t.feather")).read_all().to_pydict() == expected
    assert pyarrow.ipc.open_stream(written("t.arrows")).read_all().to_pydict() == expected
    assert parquet.read_table(written("t.parquet")).to_pydict() == expected
    for form, read in (("arrow", pyarrow.ipc.open_stream), ("parquet", parquet.ParquetFile)):
        code = subprocess.run([sys.executable, "-m", "ss2sql.cli", "run", "-e", TABLE, "--format", form],
                              capture_output=True, check=True, timeout=60)  # fmt: skip
        found = read(pyarrow.BufferReader(code.stdout))
        assert (found.read_all() if form == "arrow" else found.read()).to_pydict() == expected


def test_terminals_get_no_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output.sys, "stdout", Terminal())
    for form in output.BINARY:
        with pytest.raises(Exception, match=f"--output FILE.{form}"):
            output.output_of(form, None)
        assert output.output_of(form, Path("a")).form == form


def test_a_file_that_cannot_be_written() -> None:
    Path("folder").mkdir()
    assert "there is no folder nowhere" in bad(1, "run", "-e", "1", "-o", "nowhere/t.csv")
    assert "there is no folder nowhere" in bad(1, "plot", "-e", "1", "-o", "nowhere/t.png")
    error = bad(2, "run", "-e", "1", "-o", "t.xyz")
    assert ".csv" in error
    assert ".parquet" in error
    assert "is a directory" in bad(2, "run", "-e", "1", "-o", "folder")


# --- what was found until a run was broken off ---------------------------------------------------------


def broken_off(*arguments: str) -> tuple[Any, str]:
    answer = call("run", "--timeout", "0.2", "--format", "json", *arguments)
    assert answer.exit_code == 124
    return json.loads(answer.stdout), answer.stderr


@pytest.mark.parametrize("engine", ["database", "native"])
def test_data_has_the_form_that_was_asked_for(engine: str) -> None:
    for form, first in ((" AS list", [1]), ("", [{"this": 1}]), (" AS rows", [[1]]), (" AS set", [{"this": 1}])):
        found, error = broken_off("-e", f"{ENDLESS}{form};", "--engine", engine)
        assert found[0] == first
        assert found[1] == first * 2
        assert "broken off; " in error


def test_no_more_data_than_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "MOST_BROKEN_OFF", 6)
    found, error = broken_off("-e", f"{ENDLESS} AS list;")
    assert found == [[1], [1, 1], [1, 1, 1]]
    assert error.startswith("the first 3 of ")


def test_a_run_that_found_nothing() -> None:
    answer = call("run", "-e", ENDLESS.replace("START", "WHERE n == -1 START"), "--timeout", "0.1", "--format", "csv")
    assert (answer.exit_code, answer.stdout) == (124, "path,step,this\n")
    assert answer.stderr.endswith("\nbroken off; nothing had been found\n")


def test_a_file_gets_what_was_found() -> None:
    answer = call("run", "-e", f"{ENDLESS};", "--timeout", "0.2", "-o", "found.csv")
    assert answer.exit_code == 124
    assert Path("found.csv").read_text("utf-8").startswith("path,step,this\n1,1,1\n2,1,1\n2,2,1\n")


# --- errors as JSON ------------------------------------------------------------------------------------


def errors(code: int, *arguments: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in bad(code, *arguments).splitlines()]


def test_errors_are_objects_one_on_each_line(folder: Path) -> None:
    (folder / "wrong.ss").write_text("SELECT a,\n       this + b\nFROM [1];\n")
    first, second = errors(1, "run", "wrong.ss", "--error-format", "json")
    assert first["code"] == second["code"] == "R001"
    assert first["title"] == "unknown name"
    assert first["message"] == "unknown name 'a'"
    assert [first[key] for key in endings.PLACE] == ["wrong.ss", 1, 8, 1, 9]
    assert [second[key] for key in endings.PLACE] == ["wrong.ss", 2, 15, 2, 16]
    assert first["hints"] == ["assign it before, or give it with -p a VALUE"]
    assert first["related"] == []
    (parse,) = errors(1, "sql", "-e", "max(SELECT this FROM [1]", "--error-format", "json")
    assert parse["code"].startswith("P")
    assert parse["file"] == "<script>"


def test_all_endings_are_objects(folder: Path) -> None:
    json_option = ("--error-format", "json")
    (usage,) = errors(2, "run", "--enginge", "x", "--error-format=json")
    assert usage["title"] == "wrong usage"
    assert "Did you mean --engine?" in usage["message"].replace("'", "")
    (usage,) = errors(2, "run", *json_option)
    assert "give a script" in usage["message"]
    answer = call("run", "-e", f"{ENDLESS};", "--timeout", "0.1", *json_option)
    assert answer.exit_code == 124
    (timeout,) = [json.loads(line) for line in answer.stderr.splitlines()]
    assert timeout["code"] == "T001"
    assert timeout["found"]["paths"] > 0
    (folder / "fails.py").write_text("def fails(x):\n    return x + 'a'\n")
    (exception,) = errors(1, "run", "-e", "fails(1)", "--functions", "fails.py", *json_option)
    assert exception["code"] is None
    assert exception["message"].startswith("TypeError: ")
    assert (exception["line"], exception["column"], exception["end_column"]) == (2, 12, 19)
    assert exception["file"].endswith("fails.py")
    assert "raised by the function 'fails', called at <script>:1:1" in exception["notes"][0]
    answer = call("run", "-e", "1", "-o", "one.json", *json_option)
    assert json.loads(answer.stderr)["title"] == "note"
    assert value("-e", "1", *json_option) == 1
