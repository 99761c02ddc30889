"""The magics `%%ss` and `%ss`, in a shell of IPython, and in a kernel, where Ctrl-C has to work; and the tutorial."""

from __future__ import annotations

import atexit
import copy
import importlib.util
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("IPython")

from IPython.core.displaypub import CapturingDisplayPublisher
from IPython.core.error import UsageError
from IPython.core.interactiveshell import InteractiveShell

import ss2sql
from ss2sql.notebook.magics import Options, read_magic_options

PAGE = Path(__file__).parent.parent / "docs" / "notebook.md"
NOTEBOOK = PAGE.with_name("tutorial.ipynb")


class Notebook:
    """Runs cells and says what they show."""

    def __init__(self, shell: Any, capture: pytest.CaptureFixture[str]) -> None:
        self.shell = shell
        self._capture = capture
        shell.display_pub = CapturingDisplayPublisher(parent=shell)
        self.run("%load_ext ss2sql")

    def run(self, text: str) -> str:
        """All that a cell shows, as text; an error is a part of it."""
        self.shell.display_pub.outputs.clear()
        self._capture.readouterr()
        self.outcome = self.shell.run_cell(text, store_history=True)
        self.error = self.outcome.error_in_exec
        shown = [output["data"]["text/plain"] for output in self.shell.display_pub.outputs]
        printed = self._capture.readouterr()
        return "\n".join([*shown, printed.out + printed.err]).rstrip("\n")

    def html(self) -> list[str]:
        return [output["data"]["text/html"] for output in self.shell.display_pub.outputs]

    def __getitem__(self, name: str) -> Any:
        return self.shell.user_ns[name]


@pytest.fixture
def notebook(capsys: pytest.CaptureFixture[str]) -> Iterator[Notebook]:
    InteractiveShell.clear_instance()
    shell = InteractiveShell.instance(colors="nocolor", history_load_length=0)  # type: ignore[no-untyped-call]
    shell.history_manager.enabled = False
    yield Notebook(shell, capsys)
    shell.run_line_magic("unload_ext", "ss2sql")
    shell.atexit_operations()
    atexit.unregister(shell.atexit_operations)
    InteractiveShell.clear_instance()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", Options()), ("SELECT this", Options(rest="SELECT this")), ("-1", Options(rest="-1")),
        ("plan <<", Options(output="plan", quiet=True)), (" plan<< 7", Options(output="plan", quiet=True, rest=" 7")),
        ("--engine native --timeout 2.5 --maximum=3 1 + 1",
         Options(engine="native", timeout=2.5, maximum=3, rest="1 + 1")),
        ("-o plan --show 0 --explain", Options(output="plan", show=0, explain=True)),
        ("--session ss --sql plan <<", Options(session="ss", sql=True, output="plan", quiet=True)),
        ("plan < 3", Options(rest="plan < 3")), ("v{5.0} = 3", Options(rest="v{5.0} = 3")),
    ],
)  # fmt: skip
def test_options(line: str, expected: Options) -> None:
    assert read_magic_options(line) == expected


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--enigne native", "'--engine'?"), ("--engine oracle", "'auto', 'database', 'native'"),
        ("--engine", "requires an argument"), ("--timeout --sql", "'--timeout'"), ("--timeout soon", "'soon'"),
        ("--maximum 0", "x>=1"), ("--show -1", "requires an argument"), ("-o 1x", "1x"),
        ("-o a b <<", "two names, a and b"),
    ],
)  # fmt: skip
def test_wrong_options(line: str, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        read_magic_options(line)


@pytest.mark.parametrize(
    ("python", "cell", "told"),
    [
        ("", "%%ss --enigne native\n1", "UsageError: %ss: No such option"),
        ("", "%ss", "%ss needs a script"),
        ("", "%%ss --session ghost\n1", "ghost is no session"),
        ("", "%%ss --engine native\nSELECT this\nFROM nowhere;",
         "error[R003]: unknown source 'nowhere'\n --> In[3]:3:6\n"),
        ("", "%ss 1 + nothing", " --> In[3]:1:"),
        ("numbers = [1]", "%%ss\nSELECT this FROM nmbers;", "the notebook has 'numbers'"),
        ("def double(x):\n    return 2 * x", "%%ss\ndoubel(1);", "the notebook has 'double'"),
        ("", "%%ss\nquit();", "error[R002]"),
        *(("import math\n_private = 1", f"%%ss\n{name};", "error[R0")  # what is never looked up
          for name in ("math", "_private", "Out", "get_ipython", "quit", "open")),
    ],
)  # fmt: skip
def test_errors_have_no_traceback(python: str, cell: str, told: str, notebook: Notebook) -> None:
    notebook.run(python or "1")
    shown = notebook.run(cell)
    assert told in shown
    assert "Traceback" not in shown
    assert shown.startswith("error[" if isinstance(notebook.error, ss2sql.ResolveError) else "UsageError")
    assert not notebook.outcome.success  # so "run all" stops here


def test_a_cell_shows_its_result_although_it_ends_with_a_semicolon(notebook: Notebook) -> None:
    assert notebook.run("%%ss\nSELECT this FROM range(2);").splitlines()[-1] == "2 rows, native"
    assert "<table" in notebook.html()[0]


def test_results_in_variables(notebook: Notebook) -> None:
    assert notebook.run("%%ss plan <<\nSELECT this FROM range(2) AS list;") == ""
    assert notebook["plan"].value == [0, 1]
    assert notebook.run("%%ss -o other --maximum 1\nSELECT 7 FROM [1] START WITH n = 0 CONNECT BY n = n + 1;") != ""
    assert notebook["other"].status == "maximum"
    notebook.run("third = %ss SELECT this FROM range(3) AS list;")
    assert notebook["third"].value == [0, 1, 2]
    assert isinstance(notebook["third"], ss2sql.Result)
    notebook.run("x = 'wrong'\ntemporal = %ss v{5.0} = 3")  # Python does not expand what is the script's own
    assert notebook["temporal"].value == 3


def test_how_much_is_shown(notebook: Notebook) -> None:
    shown = notebook.run("%%ss --show 2\nSELECT this FROM range(100);")
    assert shown.splitlines()[-1] == "100 rows, the first 2 shown, native"
    assert notebook.html()[0].count("<tr>") == 3
    assert notebook.run("%%ss --sql\nSELECT this FROM [1, 2] WHERE this > 1;").startswith("SELECT\n  this.this")
    explained = notebook.run("%%ss --explain --engine native\nSELECT this FROM [1, 2] WHERE this > 1;")
    assert "engine: native" in explained
    notebook.run("%%ss --play\nSELECT this FROM [1] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2;")
    assert notebook.html()[0].startswith("<iframe srcdoc")
    notebook.run("seen = []\ndef see(x):\n    seen.append(x)\n    return x")
    notebook.run("%%ss --sql\nSELECT see(this) FROM [1];")  # it runs nothing
    assert notebook["seen"] == []
    assert notebook.error is None


SCALED = "SELECT double(this) * factor FROM numbers AS list;"


@pytest.mark.parametrize(
    "steps",
    [
        [("def double(x):\n    return 2 * x\nnumbers = [1, 2]\nfactor = 10", SCALED, [20, 40]),
         ("def double(x):\n    return 3 * x\nnumbers.append(3)\nfactor = 1", SCALED, [3, 6, 9]),
         ("", "SELECT double FROM numbers AS list;", [3, 6, 9])],  # a function of `this`
        [("import pandas as pd\nframe = pd.DataFrame({'a': [1, 2, 3]})\nleast = 1",
          "SELECT a FROM frame WHERE a > least AS list;", [2, 3]),
         ("frame = pd.DataFrame({'b': [5]})", "SELECT * FROM frame AS list;", [5])],
        [("rows = [{'a': 1}, {'a': 2}]\na = 7\nb = 8", "SELECT a, b FROM rows AS list;", [1, 8, 2, 8])],
        [("def add(a, b):\n    return 0\ndef count(x):\n    return 'wrong'", "[1 + 2, count([5, 6])];", [3, 2])],
        [("total = 100", "total = 1; total + 1;", 2), ("assert total == 100", "total + 1;", 2)],
    ],
    ids=["what stands now", "frames", "a column comes first", "the script's own comes first", "assigned"],
)  # fmt: skip
def test_names_of_the_notebook(steps: list[tuple[str, str, Any]], notebook: Notebook) -> None:
    for python, script, expected in steps:
        notebook.run(python or "1")
        assert notebook.error is None
        notebook.run(f"%%ss found <<\n{script}")
        assert notebook["found"].value == expected


def test_a_name_that_is_gone_is_unknown(notebook: Notebook) -> None:
    notebook.run("numbers = [1, 2]\n")
    assert "2 rows" in notebook.run("%%ss\nSELECT this FROM numbers;")
    notebook.run("del numbers")
    assert "error[R003]: unknown source 'numbers'" in notebook.run("%%ss\nSELECT this FROM numbers;")


def test_sessions(notebook: Notebook) -> None:
    notebook.run("%%ss\nx = 1;")
    notebook.run("import ss2sql\nss = ss2sql.connect()\nss.function('own', lambda x: 'right')\nss.set('n', 1)\nn = 2")
    notebook.run("def own(x):\n    return 'wrong'")
    assert "error[R001]" in notebook.run("%%ss --session ss\nx;")
    notebook.run("%%ss --session ss found <<\n[own(1), n];")  # what it has comes before the notebook's
    assert notebook["found"].value == ["right", 1]
    notebook.run("%ss --session ss")
    notebook.run("%%ss\ny = 2;")
    assert notebook["ss"].get("y") == 2


def test_unloading_closes_the_notebooks_own_session(notebook: Notebook) -> None:
    notebook.run("%%ss\nx = 1;")
    notebook.run("%reload_ext ss2sql")
    assert "error[R001]" in notebook.run("%%ss\nx;")
    notebook.run("%unload_ext ss2sql")
    assert "not found" in notebook.run("%%ss\n1;")
    notebook.run("%load_ext ss2sql")


def test_exceptions_of_python_keep_theirs(notebook: Notebook) -> None:
    notebook.run("def bad(x):\n    return x / 0")
    shown = notebook.run("import ss2sql\nss2sql.connect().run('nothing')")
    assert "Traceback" in shown  # Python code has one as always
    shown = notebook.run("%%ss\nSELECT bad(this) FROM [1];")
    assert "return x / 0" in shown
    assert "ZeroDivisionError: division by zero" in shown
    assert "raised by the function 'bad', called at In[4]:2:8" in shown
    assert "ss2sql/" not in shown.replace("\\", "/")


def test_a_timeout_leaves_what_was_found(notebook: Notebook) -> None:
    shown = notebook.run(
        "%%ss --timeout 0.2 --show 1 -o part\nSELECT this FROM [1] START WITH n = 0 CONNECT BY n = n + 1;"
    )
    assert "error[T001]" in shown
    assert notebook["part"].status == "timeout"
    assert len(notebook["part"]) > 0
    assert "the first 1 path" in shown


def test_the_examples_of_the_page(notebook: Notebook, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells of the page are `ipython` blocks; a `text` block behind one is what it shows."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    shown: str | None = None
    tested = 0
    for kind, body in blocks:
        if kind == "ipython" and body != "%load_ext ss2sql\n":  # which has been the first cell already
            shown = notebook.run(body.rstrip("\n"))
        elif kind == "text" and shown is not None:
            assert [line.rstrip() for line in body.splitlines()] == [line.rstrip() for line in shown.splitlines()]
            shown = None
            tested += 1
    assert tested >= 3


@pytest.mark.parametrize("engine", ["database", pytest.param("native", marks=pytest.mark.slow)])
def test_interrupting_the_kernel_leaves_what_was_found(engine: str) -> None:
    pytest.importorskip("ipykernel")
    manager_of = pytest.importorskip("jupyter_client").manager
    manager, client = manager_of.start_new_kernel(kernel_name="python3")
    try:
        client.execute_interactive("%load_ext ss2sql", timeout=60)
        client.execute_interactive(
            "from pathlib import Path\ndef begun(x):\n    print('begun', flush=True)\n    return x"
        )
        script = f"%%ss --engine {engine} --timeout 60 --show 1 -o part\nbegun(1);\n"
        script += "SELECT this FROM [1] START WITH n = 0 CONNECT BY n = n + 1;"
        told: list[str] = []

        def hear(message: dict[str, Any]) -> None:
            if message["msg_type"] == "stream" and "begun" in message["content"]["text"]:
                time.sleep(0.5)
                manager.interrupt_kernel()
            elif message["msg_type"] == "error":
                told.append("\n".join(message["content"]["traceback"]))

        reply = client.execute_interactive(script, timeout=60, output_hook=hear)
        assert reply["content"]["status"] == "error"
        assert "error[T002]" in re.sub(r"\x1b\[[\d;]*m", "", told[0])
        reply = client.execute_interactive(
            "", user_expressions={"found": "part.status, len(part) > 0"}, timeout=60, output_hook=hear
        )
        assert reply["content"]["user_expressions"]["found"]["data"]["text/plain"] == "('cancelled', True)"
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)


def shown(cell: Any) -> list[str]:
    """What a cell shows, as text; of a picture that there is one. A stream may come in any number of parts."""
    found: list[str] = []
    stream = None
    for output in cell.get("outputs", ()):
        before, stream = stream, output.get("name")
        match output["output_type"]:
            case "stream" if stream == before:
                found[-1] += output["text"]
            case "stream":
                found.append(output["text"])
            case "error":
                found.append("\n".join(output["traceback"]))
            case _ if "image/png" in output["data"]:
                found.append("a picture")
            case _:
                found.append(output["data"].get("text/html", "") + output["data"]["text/plain"])
    return found


@pytest.mark.slow
def test_the_tutorial_shows_what_its_cells_give(tmp_path: Path) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    written = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(written)
    played = copy.deepcopy(written)
    for cell in played.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    folder = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(played, timeout=120, kernel_name="python3", resources=folder).execute()
    for before, after in zip(written.cells, played.cells, strict=True):
        assert shown(before) == shown(after), before.source
    told = "\n".join(text for cell in written.cells for text in shown(cell))
    assert "[0, 2] → [0, 1] → [2, 1] → [0, 2] → [1, 0] → [1, 2] → [0, 2]" in told
    assert "3462 steps looked at" in told  # what the default search for seven moves generates
    assert "48 rows, the first 3 shown" in told
    assert told.count("a picture") == 2


def test_the_notebook_is_a_page() -> None:
    spec = importlib.util.spec_from_file_location("notebooks", NOTEBOOK.parent / "notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    notebooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(notebooks)
    (mark,) = notebooks.MARK.findall((NOTEBOOK.parent / "notebook_tutorial.md").read_text("utf-8"))
    assert NOTEBOOK.parent / mark == NOTEBOOK
    page = notebooks.markdown(json.loads(NOTEBOOK.read_text("utf-8")))
    assert page.count("````selectscript\n%%ss") == 9
    assert page.count("data:image/png;base64,") == 2
    assert "error[R003]: unknown source 'movs'" in page
    assert "\x1b" not in page
    assert not page.startswith("# ")
