"""What the pages show is what their code gives; links lead somewhere; what is made of the code is up to date."""

import doctest
import importlib
import re

import pytest
from pages import PAGES, ROOT, differences

from ss2sql.errors import CODES

DOCS = ROOT / "docs"
DOC_PAGES = [page for page in PAGES if DOCS in page.parents]
LINKING = (*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "examples" / "README.md",
           ROOT / "ss2sql" / "ARCHITECTURE.md")  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_show_what_their_code_gives(page):
    if "ss2sql.scenes" in page.read_text("utf-8"):
        pytest.importorskip("pybullet")
    for module in ("mujoco", "duckdb", "networkx", "pandas", "polars"):
        if f"import {module}" in page.read_text("utf-8"):
            pytest.importorskip(module)
    for found in differences(page):
        pytest.fail(
            f"{page.name}, line {found.line}: `make golden` would write\n{found.actual}\nand there is\n{found.shown}"
        )


def test_links_lead_to_files_and_headings():
    broken = []
    for page in LINKING:
        for target, heading in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([\w-]+))?\)", page.read_text("utf-8")):
            file = page.parent / target if target else page
            if not file.exists() or (heading and heading not in headings(file)):
                broken.append(f"{page.relative_to(ROOT)}: {target}#{heading}")
    assert broken == []


def headings(page):
    """The headings of a page, as links write them."""
    found = re.findall(r"^#+ (.*)", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in found}


def test_the_picture_of_the_readme_is_complete():
    picture = (ROOT / "README.md").read_text("utf-8").split("## One picture")[1].split("\n## ")[0]
    assert "WITH RECURSIVE" in picture
    assert "1 path, 7 rows, database" in picture
    for step in ("[0, 2]", "[0, 1]", "[2, 1]", "[1, 0]", "[1, 2]"):
        assert step in picture


def test_every_page_is_in_a_table_of_contents():
    listed = []
    for page in DOC_PAGES:
        for tree in re.findall(r"^```{toctree}\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE):
            names = [line.strip() for line in tree.splitlines() if line.strip() and line[0] != ":"]
            listed += [(DOCS if name[0] == "/" else page.parent) / name.lstrip("/") for name in names]
    assert len(listed) == len(set(listed))
    assert {page.with_suffix("") for page in DOC_PAGES} == {DOCS / "index", *listed}


def test_tables_of_pages_are_what_the_code_says(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    tables = importlib.import_module("tables")
    texts = {page: page.read_text("utf-8") for page in tables.pages()}
    old = [str(page.relative_to(ROOT)) for page, text in texts.items() if tables.filled(text) != text]
    assert old == [], "python docs/generate.py writes them anew"
    asked = [name for text in texts.values() for _, name, _ in tables.BLOCK.findall(text)]
    assert sorted(asked) == sorted(tables.TABLES)


def test_the_pages_about_errors_are_what_the_code_says(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    written = dict(importlib.import_module("error_pages").pages())
    assert {page.stem for page in written} == {"errors", *CODES}
    assert sorted((DOCS / "errors").glob("*.md")) == sorted(page for page in written if page.parent != DOCS)
    for page, text in written.items():
        assert page.read_text("utf-8") == text, "python docs/generate.py writes it anew"


def test_examples_in_docstrings_hold():
    modules = [path.relative_to(ROOT).with_suffix("") for path in sorted((ROOT / "ss2sql").rglob("*.py"))
               if ">>> " in path.read_text("utf-8")]  # fmt: skip
    names = [".".join(module.parts).removesuffix(".__init__") for module in modules]
    assert [name for name in names if doctest.testmod(importlib.import_module(name)).failed] == []
