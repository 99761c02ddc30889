"""Names and texts that stand in the way: of ss2sql's own tables, of SQL, of terminals."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from sessions import write

import ss2sql

HALF = "\ud800"
ESCAPE = "\x1b]0;owned\x07\u202e"
ELEMENTS = """
    CREATE TABLE Elements(a); INSERT INTO Elements VALUES (1), (2);
    CREATE VIEW elements_x AS SELECT a AS x FROM Elements;
"""


@pytest.mark.parametrize("made", ["before", "meanwhile", "attached"])
@pytest.mark.parametrize("engine", ["auto", "native"])
def test_tables_called_as_the_virtual_tables(file: Path, engine: Any, made: str) -> None:
    attached = made == "attached"
    if made != "meanwhile":
        write(file, ELEMENTS)
    with ss2sql.connect(None if attached else file) as ss:
        assert ss.run("SELECT this FROM [7] AS list;", engine=engine).value == [7]
        if made == "meanwhile":
            write(file, ELEMENTS)
        ss.set("dicts", [{"x": 5}])
        scripts = {
            "SELECT this FROM [7, 8] AS list;": [7, 8],
            "SELECT x FROM dicts AS list;": [5],
            "SELECT a FROM Elements AS list;": [1, 2],
            "SELECT x FROM elements_x AS list;": [1, 2],
            "SELECT e.a + b.this FROM e = Elements, b = [10, 20] AS list;": [11, 21, 12, 22],
        }
        if attached:
            ss.attach("f", file)
        for script, value in 2 * list(scripts.items()):
            named = re.sub("(?i)(?=elements)", "f.", script) if attached else script
            assert ss.run(named, engine=engine).value == value
        search = "SELECT n FROM {} START WITH n = 0 CONNECT BY NO CYCLE n = n + a STOP WITH n > 1 AS list;"
        found = ss.run(search.format("f.Elements" if attached else "Elements"), engine=engine).value
        ss.set("listed", [{"a": 1}, {"a": 2}])
        assert found == ss.run(search.format("listed"), engine="native").value != []
        ss.compile("SELECT this FROM [7, 8];").explain()
        tables = [name for name, about in ss.tables().items() if about.kind == "table"]
        assert tables == [f"{'f.' * attached}{name}" for name in ("Elements", "elements_x")]
        if attached:
            ss.detach("f")
            assert ss.run("SELECT x FROM dicts AS list;", engine=engine).value == [5]


def test_columns_with_half_of_a_surrogate_pair(ss: ss2sql.Session) -> None:
    ss.set("rows", [{HALF: 1}, {HALF: 2}])
    script = "SELECT (SELECT * FROM b = rows) FROM [1] AS list;"
    assert ss.eval(script) == [[{HALF: 1}, {HALF: 2}]]
    with pytest.raises(ss2sql.UnsupportedError, match="surrogate"):
        ss.run(script, engine="database")
    script = "SELECT b.this FROM b = (SELECT * FROM rows) AS list;"
    assert ss.eval(script) == ss.run(script, engine="native").value == [{HALF: 1}, {HALF: 2}]


# --- terminals -----------------------------------------------------------------------------------------


def fail(x: Any) -> Any:
    raise ValueError(ESCAPE)


def is_harmless(text: str) -> bool:
    return "owned" in text and not any(char in text for char in "\x1b\x07\u202e")


def test_sql_has_no_texts_that_terminals_obey(ss: ss2sql.Session) -> None:
    ss.set("rows", [{f"a{ESCAPE}": 1, "b": "x"}])
    scripts = [f"SELECT b FROM rows WHERE b != 'x{ESCAPE}' AS list;", f"SELECT b + 'x{ESCAPE}' FROM rows AS list;",
               "SELECT (SELECT * FROM b = rows) FROM [1] AS list;"]  # fmt: skip
    for script in scripts:
        result = ss.run(script, engine="database")
        assert result.value == ss.run(script, engine="native").value
        assert is_harmless(result.sql)


def test_the_shell_and_the_command_line_print_nothing_that_terminals_obey(
    ss: ss2sql.Session, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither in results nor in errors."""
    from click.testing import CliRunner

    from ss2sql.cli import main
    from ss2sql.shell.shell import Shell

    write(file, f'CREATE TABLE t("c{ESCAPE}"); CREATE TABLE "t{ESCAPE}"(a)')
    ss.attach("f", file)
    ss.set("text", ESCAPE)
    ss.function("fail", fail)
    functions = file.with_name(f"none{ESCAPE}.py")
    functions.write_text("x = 1")
    typed = ["SELECT * FROM f.t;\n.sql", ".tables", ".variables", "text;", "a = text;", f".help {ESCAPE}", "fail(1);",
             f".attach x {ESCAPE}", f".attach x m{ESCAPE}:o", f".set x '{ESCAPE}'", f"1;\n.plot {ESCAPE}",
             f".engine {ESCAPE}", "SELECT * FROM f.t;\n.explain", f".load {ESCAPE}", f".load {functions}",
             f".read {ESCAPE}", ".tables t"]  # fmt: skip
    for text in typed:
        out = io.StringIO()
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", out)
            patch.setattr(sys, "stderr", out)
            Shell(ss).run_text(text)
        assert is_harmless(out.getvalue()), text
    functions.write_text(f"def fail(x):\n    raise ValueError({ESCAPE!r})\n")
    done = CliRunner().invoke(main, ["run", "-e", "fail(1);", "--functions", str(functions)])
    assert done.exit_code == 1
    assert is_harmless(done.output)


def test_the_notebook_prints_nothing_that_terminals_obey(
    ss: ss2sql.Session, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from IPython.core.interactiveshell import InteractiveShell

    write(file, f'CREATE TABLE t("c{ESCAPE}")')
    ss.attach("f", file)
    shell = InteractiveShell()
    shell.run_line_magic("load_ext", "ss2sql")
    shell.user_ns["mine"] = ss
    shell.run_cell_magic("ss", "--session mine --sql", "SELECT * FROM f.t;")
    assert is_harmless(capsys.readouterr().out)
    shell.run_cell_magic("ss", "--session mine", "SELECT * FROM f.t;")
    shell.run_line_magic("unload_ext", "ss2sql")
    assert is_harmless(capsys.readouterr().out)
