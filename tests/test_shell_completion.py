"""What the shell suggests at the cursor, which a `|` marks here: by the grammar, the session and the statement."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases.shelf import Shelf
from golden import each_row
from sessions import write

import ss2sql
from ss2sql.editor.keywords import keywords
from ss2sql.shell.completion import Suggestion, find_signature_at_cursor, suggest_completions
from ss2sql.shell.dot_commands import COMMANDS
from ss2sql.shell.symbols import SymbolTable

SEARCH = "SELECT this FROM moves START WITH tower = start, level = 1 CONNECT BY"


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "inner.ss").touch()
    write(tmp_path / "staff.db", "CREATE TABLE staff(id, name, boss); CREATE VIEW bosses AS SELECT boss FROM staff")
    with ss2sql.connect() as session:
        session.attach("people", [{"name": "Ada", "age": 36}])
        session.attach("work", tmp_path / "staff.db")
        session.attach("space", Shelf())
        session.set("moves", [[0, 1], [1, 0]])

        @session.function
        def move(step, tower, quick=False):
            """Moves a disk."""
            return tower

        yield SymbolTable(session)


def found(marked: str, known: SymbolTable) -> list[Suggestion]:
    cursor = marked.index("|")
    return suggest_completions(marked.replace("|", "", 1), cursor, known)


def texts(marked: str, known: SymbolTable, kind: str = "") -> list[str]:
    return [one.text for one in found(marked, known) if kind in ("", one.kind)]


@each_row("shell/clauses", "marked", "told")
def test_clauses_stand_in_their_order_and_once(marked: str, told: str, known: SymbolTable) -> None:
    clauses = {keyword.text for keyword in keywords().values() if keyword.sort == "clause"}
    assert ", ".join(sorted(set(texts(marked, known)) & clauses)) == told


@pytest.mark.parametrize(
    ("written", "gone"),
    [("", ""), ("NO CYCLE", "NO CYCLE UNIQUE MEMORIZE"), ("UNIQUE", "NO CYCLE UNIQUE MEMORIZE"),
     ("BREADTH FIRST", "DEPTH FIRST BREADTH FIRST COST PROBABILITY"), ("MAXIMUM 3", "MAXIMUM"),
     ("COST 1 HEURISTIC 2", "DEPTH FIRST BREADTH FIRST COST PROBABILITY HEURISTIC")],
)  # fmt: skip
def test_options_that_contradict_each_other_are_not_offered(written: str, gone: str, known: SymbolTable) -> None:
    options = {keyword.text for keyword in keywords().values() if keyword.sort == "option"}
    offered = set(texts(f"{SEARCH} {written} |", known, "keyword")) & options
    assert offered == {one for one in options if one not in gone}


@each_row("shell/offered", "marked", "told")
def test_what_is_offered(marked: str, told: str, known: SymbolTable) -> None:
    kind, _, expected = told.rpartition(": ")
    assert texts(marked, known, kind) == (expected.split(", ") if expected != "nothing" else [])


def test_what_is_offered_first_and_what_is_said_about_it(known: SymbolTable) -> None:
    assert texts(".|", known) == list(COMMANDS)
    assert texts("SELECT NO|", known)[0] == "NOT"  # keywords come first in capitals
    assert texts("SELECT no|", known)[0] == "norm("
    assert [one.length for one in found("SELECT no|", known)] == [2] * len(texts("SELECT no|", known))
    tables = ["work.bosses", "work.staff", "space", "space.beside(", "moves", "people"]
    assert texts("SELECT a FROM |", known)[:6] == tables
    assert set(texts("SELECT a FROM b AS |", known)) >= {"dict", "list", "value", "plane("}
    assert all(one.about for one in found("SELECT a FROM b AS |", known))
    (move,) = (one for one in found("mov|", known) if one.kind == "function")
    assert (move.text, move.shown, move.about) == ("move(", "move(step, tower, quick=False)", "Moves a disk.")
    about = {one.text: one.about for one in found("SELECT | FROM s = space", known)}
    assert about["x"] == "s: float  m  how far from the left"


def test_columns_of_values_and_their_types(known: SymbolTable) -> None:
    pandas = pytest.importorskip("pandas")
    session = known.session
    session.attach("frame", pandas.DataFrame({"size": [1.5, 2.5], "word": ["a", "b"]}))
    session.attach("columns", {"left": [1, 2], "right": [[3], [4]]})
    known = SymbolTable(session)
    for source, kinds in (
        ("frame", {"size": "float", "word": "str"}), ("columns", {"left": "int", "right": "list of int"}),
        ("people", {"name": "str", "age": "int"}),
    ):  # fmt: skip
        columns = [one for one in found(f"SELECT | FROM {source}", known) if one.kind == "column"]
        assert {one.text: one.about.split(" ", 1)[1] for one in columns} == kinds
    assert known.variables["frame"] == "data frame of 2 rows"


def test_a_view_that_is_broken_does_not_end_the_shell(file: Path) -> None:
    write(file, "CREATE TABLE a(x); CREATE VIEW broken AS SELECT * FROM a; DROP TABLE a")
    with ss2sql.connect(file) as session:
        assert texts("SELECT | FROM broken", SymbolTable(session), "column") == []
        assert texts("SELECT a FROM bro|", SymbolTable(session)) == ["broken"]


def test_any_cut_of_a_script_can_be_completed(known: SymbolTable) -> None:
    script = (
        "/* a */ SELECT x.y, 'b', [1, {2] FROM (SELECT * FROM people), p = f(1) WHERE 1. START WITH a = 3; .sql (\n.a"
    )
    for cursor in range(len(script) + 1):
        suggest_completions(script, cursor, known)
        suggest_completions(script[:cursor], cursor, known)
        find_signature_at_cursor(script[:cursor], cursor, known)


@each_row("shell/calls", "marked", "told")
def test_the_call_around_the_cursor(marked: str, told: str, known: SymbolTable) -> None:
    cursor = marked.index("|")
    around = find_signature_at_cursor(marked.replace("|", "", 1), cursor, known)
    assert repr(around and (around[0].call, around[1])) == told
