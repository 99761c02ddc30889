"""The package as a whole: what is shipped, what is imported, and that the plan of the house is true."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from collections import Counter
from importlib.metadata import version
from pathlib import Path

import pytest

import ss2sql
from ss2sql.errors import CODES
from ss2sql.extras import PACKAGES

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "ss2sql"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
HEAVY = ("pandas", "polars", "pyarrow", "matplotlib", "networkx", "pybullet", "mujoco", "IPython", "duckdb", "pyspark",
         "prompt_toolkit", "hypothesis", "pytest")  # fmt: skip
SHIPPED = {".py", ".lark", ".json", ".typed", ".md", ".html"}


def sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in SHIPPED and "__pycache__" not in path.parts)


def test_the_version_is_written_in_one_place():
    assert version("ss2sql") == ss2sql.__version__
    assert "version" in PROJECT["dynamic"]
    places = [*sources(PACKAGE), ROOT / "pyproject.toml", ROOT / "docs" / "conf.py", ROOT / "Makefile"]
    written = [str(path.relative_to(ROOT)) for path in places if f'"{ss2sql.__version__}"' in path.read_text("utf-8")]
    assert written == ["ss2sql/__init__.py"]
    assert ss2sql.__version__ in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT, check=True, capture_output=True, timeout=60,
    )  # fmt: skip
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_has_everything(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (metadata,) = (archive.read(name).decode() for name in names if name.endswith("/METADATA"))
    assert {
        "ss2sql/py.typed",
        "ss2sql/frontend/syntax/grammar.lark",
        "ss2sql/frontend/syntax/grammar_table.json",
    } <= names
    assert {str(path.relative_to(ROOT)) for path in sources(PACKAGE)} <= names
    assert not [name for name in names if name.startswith(("tests", "examples", "docs", "benchmarks"))]
    assert any(name.endswith("licenses/LICENSE") for name in names)
    readme = metadata.split("\n\n", 1)[1]
    assert "SELECT this FROM moves" in readme
    assert re.findall(r"\]\((?!https?:)[^)]*\)", readme) == []  # they would lead nowhere outside of the repository


WITHOUT_EXTRAS = """
import sys
sys.modules.update(dict.fromkeys({extras!r}))  # importing any of them is an ImportError
import ss2sql
assert ss2sql.__file__.startswith({folder!r}), ss2sql.__file__
ss = ss2sql.connect()
search = "SELECT this FROM [1, 2] WHERE n == 1 START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS list;"
for engine in ("database", "native"):
    result = ss.run(search, engine=engine)
    assert (result.value, result.engine) == ([[1, 1], [1, 2], [2, 1], [2, 2]], engine)
try:
    ss.run("SELECT a FROM [1];")
except ss2sql.ResolveError as error:
    assert "unknown name 'a'" in str(error)
print(result)
for extra, use in (
    ("df", result.df), ("df", result.pl), ("df", result.arrow), ("df", lambda: result.parquet("x.parquet")),
    ("plot", result.plot), ("plot", result.graph), ("sim", lambda: ss2sql.scenes.chaos()),
):
    try:
        use()
    except ss2sql.SessionError as error:
        assert error.code == "S003", error
        assert ss2sql.extras.install_line(extra) in str(error), error
    else:
        raise AssertionError(use)
from ss2sql.cli import main
main({arguments!r})
"""


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--help"], 0, "Commands:"),
        (["run", "-e", "SELECT this FROM [1] AS list;", "--format", "json"], 0, "[1]\n"),
        (["run", "-e", "SELECT this FROM [1];", "--format", "arrow"], 1, "pip install pyarrow pandas polars"),
        (["plot", "-e", "1", "-o", "p.png"], 1, "pip install matplotlib networkx"),
        (["list", "errors"], 0, "T001"),
    ],
)
def test_the_wheel_without_extras(wheel, tmp_path, arguments, code, told):
    folder = tmp_path / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    extras = [name for name in HEAVY if name not in ("hypothesis", "pytest")]
    script = WITHOUT_EXTRAS.format(extras=extras, folder=str(folder), arguments=arguments)
    answer = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "80"},
        capture_output=True, text=True, encoding="utf-8", timeout=60, check=False,
    )  # fmt: skip
    assert (answer.returncode, told in answer.stdout + answer.stderr) == (code, True), answer.stderr


FIRST_QUERIES = """
import sys, ss2sql
ss = ss2sql.connect()
ss.attach("rows", [{"x": 1}, {"x": 2}])
def run(text):
    assert len(ss.run(text).value) == 1
    print(*sys.modules)
run("SELECT x FROM rows WHERE x > 1;")
run("SELECT x, count(*) FROM rows WHERE x > 1 GROUP BY x;")
ss = ss2sql.connect(engine="database")
run("SELECT this FROM [1, 2] WHERE this > 1;")
run("SELECT this FROM [1] START WITH x = 0 CONNECT BY UNIQUE x = x + this STOP WITH x > 1;")
"""
PARTS = {  # of what is loaded, and what nothing of it is needed for
    "sqlglot numpy sqlite3 hashlib difflib importlib.resources ss2sql.lowering.lower ss2sql.lowering.sql_builder": 2,
    "ss2sql.runtime.search ss2sql.runtime.python.search_compiler ss2sql.runtime.graph_cache": 4,
    "ss2sql.runtime.external ss2sql.bench ss2sql.scenes ss2sql.shell ss2sql.cli lark numpy": 4,
    "ss2sql.frontend.volatility.inference ss2sql.frontend.inlining ss2sql.results.show": 4,
    "ss2sql.frontend.syntax.syntax_errors": 4,
    "ss2sql.vtables.reading ss2sql.vtables.schema ss2sql.vtables.attached_worlds": 4,
    "ss2sql.runtime.sqlite.virtual_table": 4,
    "ss2sql.results.explain.collector ss2sql.runtime.parallel.process_pool asyncio": 4,
}


def test_first_queries_load_what_they_need():
    """Flat queries over lists, natively, then one in SQLite, then a search there."""
    done = subprocess.run([sys.executable, "-c", FIRST_QUERIES], capture_output=True, text=True, check=True, timeout=60)
    loaded = [set(line.split()) for line in done.stdout.splitlines()]
    for names, queries in PARTS.items():
        for known in loaded[:queries]:
            found = {one for one in known for name in names.split() if one == name or one.startswith(f"{name}.")}
            assert found == set()
    assert set(HEAVY) & {name.partition(".")[0] for name in loaded[-1]} == set()
    own = [len([name for name in known if name.startswith("ss2sql")]) for known in loaded]
    assert all(count <= most for count, most in zip(own, [92, 92, 108, 110], strict=True)), own


def test_a_query_in_sqlite_does_without_the_python_engine():
    code = """
import sys, ss2sql
ss = ss2sql.connect(engine="database")
ss.set("rows", [{"x": 1}, {"x": 2}])
assert ss.run("SELECT x FROM rows WHERE x > least;", least=1).value == [{"x": 2}]
print(*[name for name in sys.modules if name.startswith("ss2sql.runtime.python.")])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == []


def test_lines_that_install_extras_name_their_packages():
    extras = PROJECT["optional-dependencies"]
    for extra, packages in PACKAGES.items():
        assert packages.split() == [re.split(r"[<>=]", line)[0] for line in extras[extra]], extra


def test_dependencies_are_few():
    names = {re.split(r"[<>=~!\[ ]", line)[0] for line in PROJECT["dependencies"]}
    assert names <= {"apsw", "sqlglot", "lark", "numpy", "orjson", "click", "rich"}


def test_every_name_of_all_exists():
    assert sorted(set(ss2sql.__all__)) == sorted(ss2sql.__all__)
    assert [name for name in ss2sql.__all__ if not hasattr(ss2sql, name)] == []


def test_files_stay_small():
    large = [path for path in PACKAGE.rglob("*.py") if len(path.read_text("utf-8").splitlines()) > 600]
    assert [str(path.relative_to(PACKAGE)) for path in large] == []


def test_imports_run_downwards():
    text = (PACKAGE / "ARCHITECTURE.md").read_text("utf-8")
    order = re.search(r"Imports\*\* run downwards.*?\n  `([a-z ]+)`", text)[1].split()
    assert set(order) == {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    rank = {"fast_dataclasses": -1, "extras": -1, "package_data": -1} | {
        room: place for place, room in enumerate(order)
    }
    upward = []
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if room not in rank:
            continue  # what users import
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                parts = name.split(".")
                if parts[0] == "ss2sql" and len(parts) > 1 and rank.get(parts[1], len(order)) > rank[room]:
                    upward.append(f"{path.relative_to(PACKAGE)}: {name}")
    assert upward == []


def test_rooms_stay_small():
    lines = Counter()
    for path in PACKAGE.rglob("*.py"):
        lines["/".join(path.relative_to(PACKAGE).parts[:2])] += len(path.read_text("utf-8").splitlines())
    assert {room: count for room, count in lines.items() if count > 6000} == {}


def test_the_stages_of_the_architecture_are_functions():
    text = (PACKAGE / "ARCHITECTURE.md").read_text("utf-8")
    stages = re.findall(r"`([\w.]+)` in `([\w/]+\.py)`", text)
    assert len(stages) == 8
    for name, file in stages:
        assert re.search(rf"^ *def {name.split('.')[-1]}\(", (PACKAGE / file).read_text("utf-8"), re.MULTILINE), name


def test_what_adding_things_touches_exists():
    table = (PACKAGE / "ARCHITECTURE.md").read_text("utf-8").split("## Adding things")[1].split("\n## ")[0]
    named = re.findall(r"`(\w+/[\w/.]*)`", table)
    assert len(named) > 12
    assert [name for name in named if not any((root / name).exists() for root in (PACKAGE, ROOT))] == []


def test_every_error_code_is_used_and_explained():
    table = PACKAGE / "errors" / "codes.py"
    code = "\n".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py") if path != table)
    assert set(re.findall(r'"([A-Z]\d{3})"', code)) == set(CODES)
    assert [name for name, code in CODES.items() if not (ROOT / code.page).is_file()] == []
