"""How errors look: marks below lines, several lines, wide characters, colour; and errors as data."""

from __future__ import annotations

import ast
import json
import re
import runpy
from functools import cache
from pathlib import Path

import pytest
from cases.data import Body
from golden import each_row

import ss2sql
from ss2sql.errors import CODES, Error, Source, Span, combine_errors, render_all, render_error


@cache
def source(text: str) -> Source:
    return Source(text, "s.ss")


def at(text: str, part: str) -> Span:
    """The stretch of a text that is a part of it."""
    start = text.index(part)
    return Span(source(text), start, start + len(part))


def shown(error: Error) -> list[str]:
    """The rendered lines behind the sentence."""
    return render_error(error).split("\n")[1:]


def test_no_place() -> None:
    assert render_error(Error("S001", "the session is closed", hints=["open one"])) == (
        "error[S001]: the session is closed\n  = help: open one"
    )


@pytest.mark.parametrize(
    ("text", "start", "end", "expected"),
    [
        ("a +\n b + c", 5, 6, [" --> s.ss:2:2", "  |", "2 |  b + c", "  |  ^"]),
        ("\n" * 9 + "a", 9, 10, ["  --> s.ss:10:1", "   |", "10 | a", "   | ^"]),
        ("abc\n", 0, 4, [" --> s.ss:1:1", "  |", "1 | abc", "  | ^^^"]),
        ("SELECT a\nFROM b\nWHERE c;", 0, 23,
         [" --> s.ss:1:1", "  |", "1 | SELECT a", "  | ^^^^^^^^ ... to line 3"]),
        ("x = (1 +\n  2)", 4, 13, [" --> s.ss:1:5", "  |", "1 | x = (1 +", "  |     ^^^^ ... to line 2"]),
        ("a" * 119 + "X", 119, 120, [" --> s.ss:1:120", "  |", "1 | " + "a" * 119 + "X", "  | " + " " * 119 + "^"]),
    ],
    ids=["one place", "wide gutter", "line break", "lines", "within a line", "a line that fits"],
)  # fmt: skip
def test_a_stretch_of_text(text: str, start: int, end: int, expected: list[str]) -> None:
    error = Error("P009", "no", Span(Source(text, "s.ss"), start, end), ["do"])
    edge = " " * (len(expected[1]) - 1)
    assert render_error(error).split("\n") == ["error[P009]: no", *expected, f"{edge}= help: do"]


def test_the_gutter_is_as_wide_as_the_largest_number() -> None:
    text = "\n" * 9 + "a"
    related = [(Span(Source(text, "s.ss"), 8, 9), "before")]
    assert shown(Error("P001", "no", at(text, "a"), ["do"], related))[4:] == [
        "  --> s.ss:9:1: before", "   |", " 9 |", "   | -", "   = help: do",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("related", "expected"),
    [
        (["c"], ["1 | a b c d", "  |   ^", "  |     - c here"]),
        (["a", "d"], ["1 | a b c d", "  |   ^", "  | - a here", "  |       - d here"]),
        (["b c"], ["1 | a b c d", "  |   ^", "  |   --- b c here"]),
    ],
)
def test_what_has_to_do_with_it_stands_on_the_same_line(related: list[str], expected: list[str]) -> None:
    text = "a b c d"
    places = [(at(text, part), f"{part} here") for part in related]
    assert shown(Error("P001", "no", at(text, "b"), related=places))[2:] == expected


def test_what_has_to_do_with_it_on_another_line_or_in_another_text() -> None:
    own = at("a\nb", "b")
    other = at("eval(x)", "x")
    error = Error("P001", "no", own, related=[(Span(own.source, 0, 1), "first"), (other, "read here")])
    assert shown(error) == [
        " --> s.ss:2:1", "  |", "2 | b", "  | ^", "  |", "1 | a", "  | - first",
        " --> s.ss:1:6: read here", "  |", "1 | eval(x)", "  |      -",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "part", "line", "marks"),
    [
        ("\tx + y", "y", "    x + y", "        ^"), ("x\t+ y", "+ y", "x    + y", "     ^^^"),
        ("'日本' + y", "y", "'日本' + y", "         ^"), ("'日本' + y", "'日本'", "'日本' + y", "^^^^^^"),
        ("'e\u0301' + y", "y", "'e\u0301' + y", "      ^"),
        ("'\x1b[31m' + y", "y", "'␛[31m' + y", "          ^"),
        ("'\x7f\x00' + y", "y", "'␡␀' + y", "       ^"), ("'\u202e' + y", "y", "'\ufffd' + y", "      ^"),
        ("'\ud800' + y", "y", "'\ufffd' + y", "      ^"), ("'\U0001f600' + y", "y", "'\U0001f600' + y", "       ^"),
    ],
    ids=lambda value: ascii(value)[:20],
)  # fmt: skip
def test_marks_stand_below_what_they_mark(text: str, part: str, line: str, marks: str) -> None:
    assert shown(Error("P001", "no", at(text, part)))[2:] == [f"1 | {line}", f"  | {marks}"]


@pytest.mark.parametrize("place", [0, 1, 59, 60, 61, 119, 120, 200, 499])
@pytest.mark.parametrize("filler", ["a", "日"])
def test_a_long_line_is_cut_around_its_place(place: int, filler: str) -> None:
    text = filler * place + "X" + filler * (499 - place)
    _, _, line, marks = shown(Error("P001", "no", at(text, "X")))
    cells = "".join("##" if char == "日" else char for char in line)
    assert cells[marks.index("^")] == "X"
    assert len(cells) <= 4 + 120 + 6
    assert line.endswith("...") == (place < 430)


# --- colour --------------------------------------------------------------------------------------------

ANSI = re.compile(r"\x1b\[[\d;]*m")


TEXT = "a b\nc d\ne"
KINDS = [
    Error("P001", "no", at(TEXT, "b"), ["do", "or do"], [(at(TEXT, "a"), "here"), (at(TEXT, "c d"), "there")]),
    Error("P001", "no", Span(Source(TEXT, "s.ss"), 2, 9), ["do"]),
    Error("S001", "no", hints=["do"]),
]


@pytest.mark.parametrize("error", KINDS, ids=["related", "lines", "no place"])
def test_colour_changes_nothing_else(error: Error) -> None:
    assert "\x1b" not in render_error(error)
    assert "\x1b" not in str(error)
    assert ANSI.sub("", render_error(error, color=True)) == render_error(error)
    assert render_error(error, color=True).count("\x1b[0m") * 2 == render_error(error, color=True).count("\x1b")


def test_what_is_coloured() -> None:
    text = render_error(KINDS[0], color=True)
    assert text.startswith("\x1b[1;31merror[P001]\x1b[0m\x1b[1m: no\x1b[0m")
    assert "\x1b[1;31m^\x1b[0m" in text
    assert "\x1b[1;34m--- there\x1b[0m" in text
    assert "\x1b[1;36mhelp\x1b[0m: do" in text


# --- several at once, and data -------------------------------------------------------------------------


def test_all_errors_stand_in_the_order_of_their_places() -> None:
    text = "a b"
    error = combine_errors([Error("R001", "second", at(text, "b")), Error("R002", "first", at(text, "a"))])
    assert render_all(error) == f"{render_error(error.errors[0])}\n\n{render_error(error.errors[1])}" == str(error)
    assert [one.message for one in error.errors] == ["first", "second"]
    assert render_error(error) == render_error(error.errors[0])
    assert ANSI.sub("", render_all(error, color=True)) == render_all(error)


def test_an_error_as_data() -> None:
    text = "a\n  b +\nc"
    own = Span(Source(text, "s.ss"), 4, 9)
    error = Error("X002", "no", own, ["do", "or do"], [(Span(own.source, 0, 1), "here")])
    assert error.as_dict() == {
        "code": "X002", "title": "division by zero", "message": "no", "file": "s.ss", "line": 2, "column": 3,
        "end_line": 3, "end_column": 2, "hints": ["do", "or do"],
        "related": [{"message": "here", "file": "s.ss", "line": 1, "column": 1, "end_line": 1, "end_column": 2}],
        "documentation": "docs/errors/X002.md",
    }  # fmt: skip
    assert json.loads(json.dumps(error.as_dict())) == error.as_dict()
    found = Error("S001", "no").as_dict()
    assert [found[key] for key in ("file", "line", "column", "end_line", "end_column")] == [None] * 5
    assert found["related"] == found["hints"] == []


def test_every_code_says_what_it_means_why_and_what_to_do() -> None:
    reasons = runpy.run_path(str(Path(__file__).parent.parent / "docs" / "error_reasons.py"))["REASONS"]
    assert list(reasons) == list(CODES)
    for code in CODES.values():
        for text in (code.explanation, *reasons[code.code]):
            assert re.fullmatch(r"\S.*[.]", text, re.DOTALL), (code.code, text)
        assert code.page.endswith(f"{code.code}.md")


# --- a hint shows the right form in the user's own names, and this form runs -----------------------------
STAFF = (
    "CREATE TABLE staff(id INTEGER PRIMARY KEY, name TEXT, boss INTEGER, age INTEGER);"
    "INSERT INTO staff VALUES (1, 'Ann', NULL, 40), (2, 'Bob', 1, 37), (3, 'Cy', 2, 36)"
)


def open_staff() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.host.connection.execute(STAFF)
    ss.attach("pairs", [[0, 1], [1, 2]])
    ss.set("m", {"A": 1})
    ss.set("k", 2)
    ss.set("body", Body("anvil", 80.0))
    ss.attach("bodies", [Body("anvil", 80.0)])
    return ss


def form_of(error: ss2sql.Error) -> str:
    """What the first hint says to write."""
    found = re.match(
        r"(?:None has no order: write|write|it works on a list:) "
        r"(.*?)(?: to compare| to join strings| to name .*| for .*|, s\.x .*| to choose .*|, or on the groups .*)?\Z",
        error.hints[0],
    )
    assert found is not None, error.hints
    return found[1]


@each_row("errors/hints", "marked", "value")
def test_the_form_in_the_hint_runs(marked: str, value: str) -> None:
    before, wrong, behind = re.split("[«»]", marked)
    with open_staff() as ss:
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(before + wrong + behind)
        form = form_of(caught.value)
        if form.startswith("; in front of "):
            form = f"; {wrong}"
        elif form.endswith(", right after CONNECT BY"):
            form = f"CONNECT BY {form.removesuffix(' right after CONNECT BY')} PRIOR id == boss"
        assert ss.eval(before + form + behind) == ast.literal_eval(value)
