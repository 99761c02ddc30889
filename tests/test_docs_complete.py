"""Everything that users can write or call has its place in the documentation: these tests count."""

import importlib
import re
import tomllib
from html import unescape

import click
import pytest
from pages import ROOT

import ss2sql
from ss2sql.cli import COMMANDS, main
from ss2sql.extras import PACKAGES
from ss2sql.frontend.resolve.query_clauses import SYNONYMS
from ss2sql.frontend.resolve.search_clauses import ORDERS as ORDER_WORDS
from ss2sql.frontend.resolve.search_clauses import REPEATS
from ss2sql.language.operations import WRITTEN
from ss2sql.lowering.rewrites import REWRITES
from ss2sql.lowering.strategies import ORDERS, REPEAT_RULES
from ss2sql.runtime.representations.shape import REPRESENTATIONS
from ss2sql.vtables.pybullet import PyBulletWorld

DOCS = ROOT / "docs"
MORE_OPTIONS = ("HEURISTIC", "MAXIMUM")  # of CONNECT BY, beside orders and rules


def page(name):
    return (DOCS / f"{name}.md").read_text("utf-8")


def pages():
    return [path for path in sorted(DOCS.rglob("*.md")) if "_build" not in path.parts]


def first_cells(text):
    """What stands as code in the first cells of tables."""
    cells = re.findall(r"^\| (`[^|]*`) \|", text, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`([^`]*)`", cell)]


# --- the command line ----------------------------------------------------------------------------------


def test_every_command_is_shown_in_use():
    text = "\n".join(path.read_text("utf-8") for path in pages())
    assert [name for name in COMMANDS if not re.search(rf"^(\$ )?ss2sql {name}\b", text, re.MULTILINE)] == []


def test_every_option_is_in_the_section_of_its_command():
    missing = []
    for name in COMMANDS:
        section = page("commands").split(f"\n## `ss2sql {name}`\n")[1].split("\n## ")[0]
        for option in main.get_command(click.Context(main), name).params:
            if isinstance(option, click.Option) and not option.hidden:
                word = max(option.opts, key=len)
                missing += [] if re.search(rf"{word}\b", section) else [f"{name} {word}"]
    assert missing == []


def test_every_extra_is_on_the_page_about_installing():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", page("install"), re.MULTILINE))
    assert list(rows) == list(extras)
    assert [name for name, text in PACKAGES.items() if ", ".join(text.split()) != rows[name]] == []


# --- the language --------------------------------------------------------------------------------------


def test_every_function_has_its_row():
    assert sorted(first_cells(page("functions"))) == sorted(WRITTEN)


def test_every_option_of_connect_by_is_on_the_page_of_searches():
    words = [*ORDER_WORDS, *REPEATS, *MORE_OPTIONS]
    text = page("searches")
    assert [word for word in words if not re.search(rf"^\| .*`[^`]*\b{word}\b", text, re.MULTILINE)] == []


@pytest.mark.parametrize("strategy", [*ORDERS.values(), *(guard for guard in REPEAT_RULES.values() if guard.keyword)])
def test_every_strategy_has_a_page_with_a_script_and_what_becomes_of_it(strategy):
    name = strategy.name.replace(" ", "_")
    text = page(f"strategies/{name}" if (DOCS / "strategies" / f"{name}.md").exists() else name)
    assert re.search(rf"^CONNECT BY .*\b{strategy.keyword}\b", text, re.MULTILINE | re.IGNORECASE)
    assert "\n```sql\n" in text
    assert "## When the database wins" in text
    assert f"| `{strategy.keyword}` |" in page("strategies/index")


# --- what sessions offer -------------------------------------------------------------------------------


def test_every_representation_has_its_row():
    known = {*REPRESENTATIONS, *SYNONYMS, *PyBulletWorld.representations}
    assert {cell.partition("(")[0] for cell in first_cells(page("representations"))} == known


def test_every_switch_is_in_the_table_of_rewrites():
    assert set(first_cells(page("sql").split("## Rewrites")[1].split("\n## ")[0])) == {*REWRITES, "memo"}
    assert "`remember`" in page("sql")


def test_every_public_name_is_in_the_api():
    assert [name for name in ss2sql.__all__ if not re.search(rf"ss2sql\.{name}\b", page("api"))] == []


# --- diagrams ------------------------------------------------------------------------------------------


def test_railroad_diagrams_hold_every_word_of_their_rules(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    railroad = importlib.import_module("railroad")
    named = [
        name for names in re.findall(r"^```{railroad} (.*)$", page("grammar"), re.MULTILINE) for name in names.split()
    ]
    assert len(named) == len(set(named)) > 20
    for name in named:
        words = re.findall(r"<text[^>]*>([^<]*)</text>", railroad.svg(name))
        rule = re.search(rf"^{name} = (.*?) ;$", page("grammar"), re.MULTILINE | re.DOTALL)[1]
        rule = re.sub(r"\s+", " ", rule)
        inside = {word.strip('"') for word in re.findall(r'"[^"]*"|\w+', rule)}
        assert set(map(unescape, words)) - {name} == inside - {name}  # what calls itself may have become a loop
