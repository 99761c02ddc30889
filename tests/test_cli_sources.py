"""The command line: the functions, values, tables, files and worlds that a script may use."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from command_lines import FUNCTIONS, bad, call, moved_into, process, value


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return moved_into(tmp_path, monkeypatch, {"functions.py": FUNCTIONS})


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
