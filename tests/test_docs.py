"""What the pages show is what their code gives; links lead somewhere; the error index is complete."""

import doctest
import importlib
import importlib.util
import pkgutil
import re
from pathlib import Path

import pytest
from pages import PAGES, ROOT, differences

import ss2sql
from ss2sql.errors import CODES

DOCS = ROOT / "docs"
LINKING = (*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "examples" / "README.md",
           ROOT / "ss2sql" / "ARCHITECTURE.md")  # fmt: skip
MODULES = sorted(module.name for module in pkgutil.walk_packages(ss2sql.__path__, "ss2sql."))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_show_what_their_code_gives(page):
    if "ss2sql.scenes" in page.read_text("utf-8"):
        pytest.importorskip("pybullet")
    if "import mujoco" in page.read_text("utf-8"):
        pytest.importorskip("mujoco")
    for found in differences(page):
        pytest.fail(
            f"{page.name}, line {found.line}: `make golden` would write\n{found.actual}\nand there is\n{found.shown}"
        )


@pytest.mark.parametrize("page", LINKING, ids=lambda page: page.stem)
def test_links_lead_to_files(page):
    targets = re.findall(r"\]\((?!https?:)([^)#]+)(?:#[\w-]+)?\)", page.read_text("utf-8"))
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_the_picture_of_the_readme_is_complete():
    picture = (ROOT / "README.md").read_text("utf-8").split("## One picture")[1].split("\n## ")[0]
    assert "WITH RECURSIVE" in picture
    assert "1 path, 7 rows, database" in picture
    for step in ("[0, 2]", "[0, 1]", "[2, 1]", "[1, 0]", "[1, 2]"):
        assert step in picture


def test_every_page_is_in_the_table_of_contents():
    listed = re.search(r"```{toctree}\n.*?\n\n(.*?)```", (DOCS / "index.md").read_text("utf-8"), re.DOTALL)
    assert listed
    assert {path.stem for path in DOCS.glob("*.md")} == {"index", *listed[1].split()}


def test_the_error_index_is_what_the_code_says():
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    index = (DOCS / "errors.md").read_text("utf-8")
    assert index == generate.error_index()
    assert re.findall(r"^## ([A-Z]\d{3}): ", index, re.MULTILINE) == list(CODES)


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings_hold(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_every_module_says_what_it_is_for():
    paths = Path(ss2sql.__path__[0]).rglob("*.py")
    assert [str(path) for path in paths if not path.read_text("utf-8").startswith('"""')] == []
