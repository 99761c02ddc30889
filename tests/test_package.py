"""The package as a whole: what is shipped, what is imported, and that the plan of the house is true."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

import ss2sql
from ss2sql.errors import CODES

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "ss2sql"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
HEAVY = ("pandas", "polars", "pyarrow", "matplotlib", "networkx", "pybullet", "mujoco", "IPython", "duckdb", "pyspark",
         "prompt_toolkit", "hypothesis", "pytest")  # fmt: skip
SHIPPED = {".py", ".lark", ".json", ".typed", ".md"}


def sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in SHIPPED and "__pycache__" not in path.parts)


def test_the_version_is_written_in_one_place():
    assert version("ss2sql") == ss2sql.__version__
    assert "version" in PROJECT["dynamic"]
    places = [*sources(PACKAGE), ROOT / "pyproject.toml", ROOT / "docs" / "conf.py", ROOT / "Makefile"]
    written = [str(path.relative_to(ROOT)) for path in places if f'"{ss2sql.__version__}"' in path.read_text("utf-8")]
    assert written == ["ss2sql/__init__.py"]
    assert ss2sql.__version__ in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_the_wheel_has_everything(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
        cwd=ROOT, check=True, capture_output=True, timeout=60,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert {"ss2sql/py.typed", "ss2sql/frontend/grammar.lark", "ss2sql/frontend/grammar_table.json"} <= names
    assert {str(path.relative_to(ROOT)) for path in sources(PACKAGE)} <= names
    assert not [name for name in names if name.startswith(("tests", "examples", "docs", "benchmarks"))]
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_import_loads_no_extra():
    code = "import sys, ss2sql; ss2sql.connect().close(); print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert set(loaded.stdout.split()) & set(HEAVY) == set()


def test_dependencies_are_few():
    names = {re.split(r"[<>=~!\[ ]", line)[0] for line in PROJECT["dependencies"]}
    assert names <= {"apsw", "sqlglot", "lark", "numpy", "orjson", "click", "rich"}


def test_what_the_documentation_calls_public_exists():
    for name in ("connect", "Session", "Query", "Result", "Error", "ParseError", "ResolveError", "UnsupportedError",
                 "ExecutionError", "RepresentationError", "Timeout", "Cancelled"):  # fmt: skip
        assert name in ss2sql.__all__
        assert getattr(ss2sql, name).__doc__


def test_every_name_of_all_exists():
    assert sorted(set(ss2sql.__all__)) == sorted(ss2sql.__all__)
    assert [name for name in ss2sql.__all__ if not hasattr(ss2sql, name)] == []


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_files_stay_small(path):
    assert len(path.read_text("utf-8").splitlines()) <= 400


def test_the_architecture_names_every_file_and_no_other():
    """Each section of a folder lists its files: `### folder/`, then `- `file`: ...`."""
    text = (PACKAGE / "ARCHITECTURE.md").read_text("utf-8")
    listed: set[Path] = set()
    for section in re.split(r"^### ", text, flags=re.MULTILINE)[1:]:
        folder = re.match(r"`([\w/]+)/`", section)
        assert folder, section.splitlines()[0]
        for files in re.findall(r"^- ((?:`[\w.]+`(?:, )?)+)", section, flags=re.MULTILINE):
            listed |= {ROOT / folder[1] / name for name in re.findall(r"`([\w.]+)`", files)}
    assert sorted(str(path.relative_to(ROOT)) for path in listed ^ set(sources(PACKAGE))) == []


def test_the_stages_of_the_architecture_are_functions():
    text = (PACKAGE / "ARCHITECTURE.md").read_text("utf-8")
    stages = re.findall(r"`([\w.]+)` in `([\w/]+\.py)`", text)
    assert len(stages) == 7
    for name, file in stages:
        assert re.search(rf"^ *def {name.split('.')[-1]}\(", (PACKAGE / file).read_text("utf-8"), re.MULTILINE), name


def test_every_error_code_is_used_and_explained():
    code = "\n".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py") if path.name != "errors.py")
    raised = set(
        re.findall(r'"([A-Z]\d{3})"', code + (PACKAGE / "errors.py").read_text("utf-8").split("class Error")[1])
    )
    assert raised == set(CODES)
    index = (ROOT / "docs" / "errors.md").read_text("utf-8")
    assert [name for name in CODES if f"## {name}: " not in index] == []
    assert all(entry.explanation.endswith(".") for entry in CODES.values())
