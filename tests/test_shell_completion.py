"""What the shell suggests at the cursor, which a `|` marks here: by the grammar, the session and the statement."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import ss2sql
from ss2sql.editor.keywords import keywords
from ss2sql.shell.commands import COMMANDS
from ss2sql.shell.completion import Suggestion, signature, suggestions
from ss2sql.shell.known import Known
from ss2sql.vtables import Column, Table, TableFunction, World

SEARCH = "SELECT this FROM moves START WITH tower = start, level = 1 CONNECT BY"


class Bodies(Table):
    """Things."""

    name, key = "bodies", "id"
    columns = (Column("id", int), Column("mass", float, unit="kg", text="how heavy"))

    groups = {"mass": "mass"}

    def keys(self, where: Any) -> range:
        return range(3)

    def mass(self, keys: Any) -> list[float]:
        return [1.0 for _ in keys]


class Contacts(TableFunction):
    """What touches."""

    name = "contacts"
    columns = (Column("first", int), Column("second", int))

    def rows(self, near: Any = 0) -> list[tuple[int, int]]:
        return []


class Space(World):
    """A little world."""

    tables = (Bodies, Contacts)


@pytest.fixture
def known(tmp_path: Path):
    with closing(sqlite3.connect(tmp_path / "staff.db")) as connection, connection:
        connection.executescript("CREATE TABLE staff(id, name, boss); CREATE VIEW bosses AS SELECT boss FROM staff")
    connection.close()
    with ss2sql.connect() as session:
        session.attach("people", [{"name": "Ada", "age": 36}])
        session.attach("work", tmp_path / "staff.db")
        session.set("moves", [[0, 1], [1, 0]])

        @session.function
        def move(step, tower, quick=False):
            """Moves a disk."""
            return tower

        yield Known(session)


def found(marked: str, known: Known) -> list[Suggestion]:
    cursor = marked.index("|")
    return suggestions(marked.replace("|", "", 1), cursor, known)


def texts(marked: str, known: Known, kind: str = "") -> list[str]:
    return [one.text for one in found(marked, known) if kind in ("", one.kind)]


# --- keywords ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("SELECT a FROM b |", {"WHERE", "START WITH", "CONNECT BY", "GROUP BY", "ORDER BY", "LIMIT", "AS"}),
        ("SELECT a FROM b WHERE c |", {"START WITH", "CONNECT BY", "GROUP BY", "ORDER BY", "LIMIT", "AS"}),
        (f"{SEARCH} level = level + 1 |", {"STOP WITH", "GROUP BY", "ORDER BY", "LIMIT", "AS"}),
        ("SELECT a FROM b GROUP BY c |", {"HAVING", "ORDER BY", "LIMIT", "AS"}),
        ("SELECT a FROM b LIMIT 3 ORDER BY c |", {"GROUP BY", "AS"}),
        ("[(SELECT a FROM b WHERE c), (SELECT d FROM e |", {"WHERE", "START WITH", "CONNECT BY", "GROUP BY", "ORDER BY",
                                                           "LIMIT", "AS"}),
        ("SELECT a |", {"FROM"}),
        ("|", {"SELECT"}),
        ("1; |", {"SELECT"}),
    ],
)  # fmt: skip
def test_clauses_stand_in_their_order_and_once(marked: str, expected: set[str], known: Known) -> None:
    clauses = {keyword.text for keyword in keywords().values() if keyword.sort == "clause"}
    assert set(texts(marked, known)) & clauses == expected


@pytest.mark.parametrize(
    ("written", "gone"),
    [
        ("", ""), ("NO CYCLE", "NO CYCLE UNIQUE MEMORIZE"), ("UNIQUE", "NO CYCLE UNIQUE MEMORIZE"),
        ("BREADTH FIRST", "DEPTH FIRST BREADTH FIRST COST PROBABILITY"), ("MAXIMUM 3", "MAXIMUM"),
        ("COST 1 HEURISTIC 2", "DEPTH FIRST BREADTH FIRST COST PROBABILITY HEURISTIC"),
    ],
)  # fmt: skip
def test_options_that_contradict_each_other_are_not_offered(written: str, gone: str, known: Known) -> None:
    options = {keyword.text for keyword in keywords().values() if keyword.sort == "option"}
    assert set(texts(f"{SEARCH} {written} |", known, "keyword")) & options == {
        one for one in options if one not in gone
    }


def test_the_second_of_two_words(known: Known) -> None:
    assert texts("SELECT a FROM b START |", known) == ["WITH"]
    assert texts("SELECT a FROM b GROUP B|", known) == ["BY"]
    assert texts(f"{SEARCH} NO C|", known) == ["CYCLE"]


def test_letters_in_any_case_and_keywords_first_in_capitals(known: Known) -> None:
    assert texts("sel|", known) == ["SELECT"]
    assert texts("SELECT a FROM b wh|", known) == ["WHERE"]
    assert texts("SELECT NO|", known)[0] == "NOT"
    assert texts("SELECT no|", known)[0] == "norm("
    assert [one.length for one in found("SELECT no|", known)] == [2] * len(texts("SELECT no|", known))


def test_nothing_is_offered_where_it_is_there(known: Known) -> None:
    assert texts("SELECT|", known) == []


# --- names ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("SELECT | FROM people", ["name", "age"]),
        ("SELECT na| FROM people;", ["name"]),
        ("SELECT name FROM people WHERE |", ["name", "age"]),
        ("SELECT p.| FROM p = people", ["name", "age"]),
        ("SELECT this.| FROM people", ["name", "age"]),
        ("SELECT | FROM s = work.staff, people", ["id", "name", "boss", "age"]),
        ("SELECT staff.b| FROM work.staff", ["boss"]),
        ("SELECT (SELECT | FROM work.bosses) FROM people", ["boss", "name", "age"]),
        ("SELECT name FROM people WHERE (SELECT | FROM work.bosses)", ["boss", "name", "age"]),
        ("SELECT (SELECT boss FROM work.bosses), | FROM people", ["name", "age"]),
        ("SELECT q.| FROM q = (SELECT name, to(age, years), len(name), 1 FROM people)", ["name", "years", "len"]),
        ("SELECT name FROM people; SELECT |", []),
        ("SELECT name FROM people ORDER BY a|", ["age"]),
    ],
)  # fmt: skip
def test_columns_are_those_of_the_sources_in_the_statement(marked: str, expected: list[str], known: Known) -> None:
    assert texts(marked, known, "column") == expected


def test_columns_of_values_and_their_types(known: Known) -> None:
    pandas = pytest.importorskip("pandas")
    session = known.session
    session.attach("frame", pandas.DataFrame({"size": [1.5, 2.5], "word": ["a", "b"]}))
    session.attach("columns", {"left": [1, 2], "right": [[3], [4]]})
    known = Known(session)
    for source, kinds in (
        ("frame", {"size": "float", "word": "str"}), ("columns", {"left": "int", "right": "list of int"}),
        ("people", {"name": "str", "age": "int"}),
    ):  # fmt: skip
        columns = [one for one in found(f"SELECT | FROM {source}", known) if one.kind == "column"]
        assert {one.text: one.about.split(" ", 1)[1] for one in columns} == kinds
    assert known.variables["frame"] == "data frame of 2 rows"


def test_long_lists_are_not_read_for_their_columns(known: Known) -> None:
    read = []

    class Watched(dict[str, int]):
        def items(self):
            read.append(1)
            return super().items()

    known.session.attach("long", [Watched(a=1) for _ in range(10_000)])
    assert texts("SELECT | FROM long", Known(known.session), "column") == ["a"]
    assert len(read) < 1000


def test_a_view_that_is_broken_does_not_end_the_shell(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "broken.db")) as connection, connection:
        connection.executescript("CREATE TABLE a(x); CREATE VIEW broken AS SELECT * FROM a; DROP TABLE a")
    connection.close()
    with ss2sql.connect(tmp_path / "broken.db") as session:
        assert texts("SELECT | FROM broken", Known(session), "column") == []
        assert texts("SELECT a FROM bro|", Known(session)) == ["broken"]


def test_from_offers_tables_and_variables(known: Known) -> None:
    assert texts("SELECT a FROM |", known)[:4] == ["work.bosses", "work.staff", "moves", "people"]
    assert texts("SELECT a FROM work.|", known) == ["bosses", "staff"]
    assert texts("SELECT a FROM p = pe|", known) == ["people"]
    assert texts("SELECT name FROM people, x = mo|", known) == ["moves", "move("]


def test_worlds(known: Known) -> None:
    known.session.attach("space", Space())
    known = Known(known.session)
    assert texts("SELECT a FROM sp|", known) == ["space", "space.contacts("]
    assert texts("SELECT a FROM space.|", known) == ["contacts("]
    assert texts("SELECT m| FROM space", known, "column") == ["mass"]
    assert texts("SELECT c.| FROM c = space.contacts(1)", known, "column") == ["first", "second"]
    (mass,) = (one for one in found("SELECT ma| FROM s = space", known) if one.kind == "column")
    assert mass.about == "s: float  kg  how heavy"


def test_variables_of_a_search(known: Known) -> None:
    assert texts(f"{SEARCH} NO CYCLE |", known, "variable") == ["tower", "level"]
    assert "tower" in texts("SELECT this FROM moves WHERE to| START WITH tower = 1 CONNECT BY tower = 2", known)
    assert texts(f"{SEARCH} tower = lev|", known) == ["level"]


def test_representations(known: Known) -> None:
    assert set(texts("SELECT a FROM b AS |", known)) >= {"dict", "list", "value", "plane("}
    assert texts("SELECT a FROM b AS p|", known) == ["plane(", "prolog"]
    assert all(one.about for one in found("SELECT a FROM b AS |", known))


def test_functions(known: Known) -> None:
    (move,) = (one for one in found("mov|", known) if one.kind == "function")
    assert (move.text, move.shown, move.about) == ("move(", "move(step, tower, quick=False)", "Moves a disk.")
    assert texts("ge|", known) == ["getTime("]  # not `ge`, which stands for an operator


def test_texts_and_comments_are_left_alone(known: Known) -> None:
    for marked in (
        "'SEL|",
        '"a" + "SEL|',
        "1 # SEL|",
        "# SEL|",
        "/* SEL|",
        "1; /* a\n SEL|",
        "12|",
        "1.|",
        "f(3, 1.5|",
    ):
        assert texts(marked, known) == [], marked


def test_a_statement_with_an_error_still_gets_names(known: Known) -> None:
    assert texts("SELECT a, FROM people WHERE ag|", known) == ["age"]


def test_any_cut_of_a_script_can_be_completed(known: Known) -> None:
    script = (
        "/* a */ SELECT x.y, 'b', [1, {2] FROM (SELECT * FROM people), p = f(1) WHERE 1. START WITH a = 3; .sql (\n.a"
    )
    for cursor in range(len(script) + 1):
        suggestions(script, cursor, known)
        suggestions(script[:cursor], cursor, known)
        signature(script[:cursor], cursor, known)


# --- calls ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("move(|", ("move(step, tower, quick=False)", 0)),
        ("move(1, |)", ("move(step, tower, quick=False)", 1)),
        ("move([1, 2], f(3, 4), |", ("move(step, tower, quick=False)", 2)),
        ("move(1, (2 + |", ("move(step, tower, quick=False)", 1)),
        ("move(len(|", ("len(value)", 0)),
        ("move(1, 2)|", None),
        ("(|", None),
        ("unknown(|", None),
        ("SELECT a FROM b AS plane(0, |", ("plane(plane, start, size, blur=0)", 1)),
    ],
)  # fmt: skip
def test_the_call_around_the_cursor(marked: str, expected: tuple[str, int] | None, known: Known) -> None:
    cursor = marked.index("|")
    around = signature(marked.replace("|", "", 1), cursor, known)
    assert (around and (around[0].call, around[1])) == expected


# --- dot commands --------------------------------------------------------------------------------------


def test_commands_and_what_stands_behind_them(known: Known, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "inner.ss").touch()
    assert texts(".|", known) == list(COMMANDS)
    assert texts("1;\n.ti|", known) == [".timer", ".timeout"]
    assert texts(".engine |", known) == ["auto", "database", "native", "duckdb", "spark"]
    assert texts(".format j|", known) == ["json"]
    assert texts(".read f|", known) == ["folder/"]
    assert texts(".read folder/|", known) == ["inner.ss"]
    assert texts(".attach more st|", known) == ["staff.db"]
    assert texts(".tables work.|", known) == ["work.bosses", "work.staff"]
    assert texts(".functions mo|", known) == ["move"]
    assert texts(".set mo|", known) == ["moves"]
    assert texts(".help CONN|", known) == ["CONNECT BY"]
    assert texts(".sql SELECT n| FROM people", known, "column") == ["name"]
    assert texts(".nothing |", known) == []
