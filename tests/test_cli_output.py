"""What the command line makes of results: tables, data, files and pictures; and errors as JSON."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_lines import ENDLESS, FUNCTIONS, bad, call, good, moved_into, process, value

from ss2sql.cli import endings, output
from ss2sql.cli import run as running

TABLE = "SELECT this, str(this) FROM range(3);"
THIRTY = "SELECT this, this ^ 2 FROM range(30);"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return moved_into(tmp_path, monkeypatch, {"functions.py": FUNCTIONS})


@pytest.mark.parametrize(("given", "rows"), [("", 20), ("5", 5), ("0", 0), ("all", 30), ("ALL", 30), ("1000", 30)])
def test_so_many_rows_are_shown(given: str, rows: int) -> None:
    lines = good("run", "-e", THIRTY, *(("--show", given) if given else ())).splitlines()
    assert "this ^ 2" in lines[1]
    assert len([line for line in lines if line.startswith("│")]) == rows
    assert lines[-1] == ("30 rows, database" if rows == 30 else f"30 rows, the first {rows} shown, database")


@pytest.mark.parametrize(
    ("script", "printed"), [("1 + 1;", "2\n"), ("'text';", "text\n"), ("None;", "None\n"), ("[1, 'a'];", "[1, 'a']\n")]
)
def test_values_that_are_no_table(script: str, printed: str) -> None:
    assert good("run", "-e", script) == printed


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
    for name, given, wanted in (("NO_COLOR", "1", False), ("NO_COLOR", "", True), ("TERM", "dumb", False)):
        monkeypatch.setenv(name, given)
        assert endings.wants_color(stream) is wanted


@pytest.mark.parametrize(
    ("script", "form", "told"),
    [
        ("SELECT 'größe' FROM [1] AS list;", "table", "gr\\xf6\\xdfe"),
        ("SELECT 'größe' FROM [1] AS list;", "json", None),
        pytest.param("'größe'", "table", "gr\\xf6\\xdfe\n", marks=pytest.mark.slow),
        pytest.param("größe", "table", "unknown name 'gr", marks=pytest.mark.slow),
    ],
)
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
        ("[Body(1)];", ["Body(mass=1)"]),  # what JSON has no form for
        ("lone();", "\ud800"),
    ],
)  # fmt: skip
def test_json(script: str, expected: Any) -> None:
    answer = call("run", "-e", script, "--functions", "functions.py", "--format", "json")
    assert (json.loads(answer.stdout), answer.stderr) == (expected, "loading\n")


@pytest.mark.parametrize(
    ("script", "rows"),
    [
        ("SELECT this, 'a,b' FROM [1, None, [1, 2]];",
         [["this", "'a,b'"], ["1", "a,b"], ["", "a,b"], ["[1, 2]", "a,b"]]),
        ("SELECT this FROM [];", [["this"]]),
        ("7;", [["value"], ["7"]]),
        ("SELECT this FROM [1, 2] WHERE n < 1 START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 0;",
         [["path", "step", "this"], ["1", "1", "1"], ["2", "1", "2"]]),
    ],
)  # fmt: skip
def test_csv(script: str, rows: list[list[str]]) -> None:
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
    assert written("t.TXT").read_text("utf-8").endswith("└──────┴─────┘\n3 rows, database\n")
    assert written("t.txt", script="1 + 1").read_text("utf-8") == "2\n"
    assert written("t.txt", "--format", "csv").read_text("utf-8").startswith("this,")
    assert written("t.data", "--format", "json").read_text("utf-8").startswith("[")


def test_files_of_arrow() -> None:
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
        code = subprocess.run([sys.executable, "-m", "ss2sql.cli", "run", "-e", TABLE, "--format", form],
                              capture_output=True, check=True, timeout=60)  # fmt: skip
        assert read(pyarrow.BufferReader(code.stdout)).to_pydict() == expected


def test_terminals_get_no_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output.sys, "stdout", Terminal())
    for form in output.BINARY:
        with pytest.raises(Exception, match=f"--output FILE.{form}"):
            output.output_of(form, None)
        assert output.output_of(form, Path("a")).form == form


@pytest.mark.parametrize(("name", "start"), [("p.png", b"\x89PNG"), ("p.svg", b"<?xml"), ("p.PDF", b"%PDF")])
def test_pictures(name: str, start: bytes) -> None:
    pytest.importorskip("matplotlib")
    answer = call("plot", "-e", THIRTY, "-o", name, "--kind", "line", "--title", "T", "--size", "4x3")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "", f"written to {name}: 30 rows\n")
    data = Path(name).read_bytes()
    assert data.startswith(start)
    if name == "p.png":
        wide, high = (int.from_bytes(data[place : place + 4]) for place in (16, 20))
        assert wide * 3 == high * 4


def test_what_cannot_be_drawn() -> None:
    pytest.importorskip("matplotlib")
    assert "error[V001]" in bad(1, "plot", "-e", "SELECT 'a', 'b' FROM [1];", "-o", "p.png")
    assert not Path("p.png").exists()
    assert "there is no folder nowhere" in bad(1, "plot", "-e", "1", "-o", "nowhere/t.png")


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what was found, little is written: an endless search finds very much."""
    monkeypatch.setattr(running, "MOST_BROKEN_OFF", 100)


def broken_off(*arguments: str) -> tuple[Any, str]:
    answer = call("run", "--timeout", "0.3", "--format", "json", *arguments)
    assert answer.exit_code == 124
    return json.loads(answer.stdout), answer.stderr


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize(
    ("form", "first"), [(" AS list", [1]), ("", [{"this": 1}]), (" AS rows", [[1]]), (" AS set", [{"this": 1}])]
)
def test_data_has_the_form_that_was_asked_for(form: str, first: list[Any], engine: str) -> None:
    found, error = broken_off("-e", f"{ENDLESS}{form};", "--engine", engine)
    assert found[:2] == [first, first * 2]
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


def test_errors_are_objects_one_on_each_line(folder: Path) -> None:
    (folder / "wrong.ss").write_text("SELECT a,\n       this + b\nFROM [1];\n")
    first, second = errors(1, "run", "wrong.ss")
    assert first["code"] == second["code"] == "R001"
    assert (first["title"], first["message"]) == ("unknown name", "unknown name 'a'")
    assert [first[key] for key in endings.PLACE] == ["wrong.ss", 1, 8, 1, 9]
    assert [second[key] for key in endings.PLACE] == ["wrong.ss", 2, 15, 2, 16]
    assert (first["hints"], first["related"]) == (["assign it before, or give it with -p a VALUE"], [])
    (parse,) = errors(1, "sql", "-e", "max(SELECT this FROM [1]")
    assert parse["code"].startswith("P")
    assert parse["file"] == "<script>"


def test_all_endings_are_objects() -> None:
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
