"""What the parser says about text that is not SelectScript, or is that of another language: code, place, reason, cure.

Golden cases (`cases/errors`) show the most frequent errors as a user sees them; `syntax.errors` has all others.
Limits of size and depth are here, too, and the table of the grammar.
"""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest
from golden import each_row
from sessions import wrong_scripts
from trees import calls_of, check, failure, script

from ss2sql.frontend.syntax import parser, tokenizer

# Code, words of the message and of the hints, and scripts that are not one line of visible text; all others stand in
# `syntax.errors`. The place of the error stands between « and », the bracket that is open there between ‹ and ›.
ERRORS: list[tuple[str, ...]] = [
    ("P001", "expected an operator or ';' between 'y' and 'z'", "write ; in front of z", "x = y\n«z»"),
    ("P001", "expected an operator, ',' or ']' between '2' and 'y'", "the elements of a list are separated by commas",
     "x = ‹[›1, 2\n«y» = 3"),
    ("P003", "this string is not closed", "write ' at its end", "x = «'abc;»\n"),
    ("P003", "U+0001", "", "a «\x01» b"),
    ("P003", "U+200B ZERO WIDTH SPACE", "", "a«\u200b»b"),
    ("P003", "contains a NUL character", "binary", "a«\0»b", "x = 1;«\0»", "\x7fELF\x02\x01\x01«\0»\0\0"),
    ("P003", "half of a character, U+D800", "Unicode", "a = '«\ud800»'"),
    ("P006", "-- does not start a comment", "write a blank after it", "«--»a comment\ny = 2"),
    ("P008", "no statement", "SELECT this FROM", "«» ; # nothing\n ;; /* at all */"),
    *((code, words[0], words[-1] if len(words) > 1 else "", text) for code, words, text in wrong_scripts("syntax")),
]  # fmt: skip


@pytest.mark.parametrize(
    ("marked", "code", "message", "hint"), [(text, *row[:3]) for row in ERRORS for text in row[3:]], ids=ascii
)
def test_an_error_has_a_code_a_place_a_reason_and_a_cure(marked: str, code: str, message: str, hint: str) -> None:
    check(marked, code, message, hint)


# --- cures are typed: the right form takes the place of the wrong one ---------------------------------------------

FORM = "SELECT a FROM b START WITH n = 0 CONNECT BY {} AS list"


@pytest.mark.parametrize(
    ("form", "wrong"),
    [(FORM, "n = b.c AND n == a"), (FORM, "n = (c) and b == n AND (b > 1 OR b IN d)"), ("SELECT {} FROM b", "a += 1"),
     ("SELECT a FROM b WHERE {} AND c", "b + 1 NOT NULL")],
)  # fmt: skip
def test_a_cure_can_be_typed(form: str, wrong: str) -> None:
    (hint, *_) = failure(form.format(wrong)).hints
    script(form.format(hint.removeprefix("write ")))


@pytest.mark.parametrize("item", ["n = n AND a > 2", "n = a < 2 AND a > 0", "n = (a AND b > 2)", "n = f(a) AND b > 2"])
def test_a_variable_of_a_search_may_be_true_or_false(item: str) -> None:
    script(FORM.format(item))


# --- several errors at once ------------------------------------------------------------------------------


def places(source: str) -> list[tuple[str, str]]:
    """Code and line:column of every error."""
    return [(error.code, error.span.place.split(":", 1)[1]) for error in failure(source).errors if error.span]


@each_row("errors/statement-by-statement", "source", "found")
def test_each_statement_has_its_error(source: str, found: str) -> None:
    assert ", ".join(map(" ".join, places(source))) == found


@pytest.mark.parametrize(
    "source",
    ["IF(a b; c d; e f)", "f(IF(a; b; c; d), IF(a; b; c; d))",
     "SELECT a b c FROM d e WHERE f = g AND h = IF(i = j; k; l)", "x = [1, 2 3, f(4 5; 6)]",
     "SELECT a FROM b STOP WITH c START WITH d = 1 WHERE e"],
)  # fmt: skip
def test_errors_inside_a_statement_do_not_multiply(source: str) -> None:
    assert len(places(source)) == 1
    assert places(f"{source}; y = = 2") == [*places(source), ("P001", f"1:{len(source) + 7}")]


def test_at_most_ten_errors_are_told() -> None:
    error = failure("x = ;\n" * 50)
    assert len(error.errors) == 10
    assert error.errors[0] is error
    assert str(error).count("error[P001]") == 10
    assert places("9223372036854775808;" * 50) == [("P007", f"1:{20 * number + 1}") for number in range(10)]


# --- limits of size and depth, and the table that is shipped --------------------------------------------


KIB = 1024
# Texts with the code of their error, and its place where that is a matter of the limit; "" where there is none.
LIMITS = {
    "(": ("(" * 10_000 + "a" + ")" * 10_000, ""),
    "[": ("[" * 299 + "a" + "]" * 299, ""),
    "[ too many": ("[" * 300 + "a" + "]" * 300, "P005 1:1"),
    "calls": ("f(" * 299 + "a" + ")" * 299, ""),
    "calls too many": ("f(" * 300 + "a" + ")" * 300, "P005"),
    "calls without end": ("x = " + "f(" * 10_000, "P002"),
    "NOT": ("NOT " * 299 + "a", ""), "NOT too many": ("NOT " * 300 + "a", "P005 1:1"),
    "minus": ("- " * 299 + "a", ""), "minus too many": ("-" * 300 + "a", "P005"),
    "powers": ("^".join(["a"] * 300), ""), "powers too many": ("^".join(["a"] * 301), "P005"),
    "negative powers": ("2^-" * 151 + "a", "P005"), "queries in FROM": ("SELECT a FROM " * 202 + "b", "P005"),
    "queries in parentheses": ("SELECT this FROM (" * 250 + "[1]" + ")" * 250, "P005"),
    "braces": ("v{" * 10_000, "P002"),
    # only what nests counts
    "queries side by side": (";".join(["SELECT a FROM b"] * 1000), ""),
    "queries in a list": ("[" + ", ".join(["(SELECT a FROM b AS list)"] * 1000) + "]", ""),
    "open queries in a list": ("[" + ", ".join(["SELECT a FROM b AS list"] * 1000) + "]", ""),
    "powers in a list": ("[" + ", ".join(["a ^ 2 - b ^ 2"] * 1000) + "]", ""),
    "conditions": ("SELECT a FROM b WHERE " + " AND ".join(["NOT a == -1"] * 5000), ""),
    "alternatives": (" OR ".join(["-a < b"] * 5000), ""),
    "arguments": ("f(" + ", ".join(["a"] * 20_000) + ")", ""),
    # trees deeper than three hundred
    "sums": ("+".join(["a"] * 300), ""),
    "sums too many": ("+".join(["a"] * 301), "P005"), "sums far too many": ("+".join(["1"] * 10_000), "P005"),
    "indexes": ("a" + "[0]" * 10_000, "P005"), "XOR": (" XOR ".join(["a"] * 10_000), "P005"),
    "assignments": ("a = " * 10_000 + "1", "P005"), "sums in calls": ("f(1 + 2 * " * 150 + "a" + ")" * 150, "P005"),
    "sums and differences": ("1 + 2 - " * 151 + "a", "P005"),
    # 256 KiB
    "blanks": ("a" + " " * (256 * KIB - 1), ""),
    "blanks too many": ("a" + " " * (256 * KIB), "P004 1:1"),
    "letters with two bytes": ("'" + "é" * (128 * KIB - 1) + "'", ""),
    "letters with two bytes too many": ("'" + "é" * (128 * KIB) + "'", "P004 1:1"),
    "a comment": ("#" * 300_000, "P004 1:1"),
    "statements": ("x = 1;" * 100_000, "P004 1:1"),
}  # fmt: skip


@pytest.mark.parametrize("what", LIMITS)
def test_what_is_too_deep_or_too_large_is_refused(what: str) -> None:
    written, expected = LIMITS[what]
    if not expected:
        script(written)
        return
    error = failure(written)
    assert error.span is not None
    assert f"{error.code} {error.span.line}:{error.span.column}".startswith(expected)
    assert error.hints
    assert len(str(error)) < 2_000


def test_nested_calls_cost_what_they_are_long() -> None:
    def nested(depth: int) -> str:
        return "f(a, " * depth + "b" + ")" * depth + ";"

    assert calls_of(lambda: script(nested(80))) <= 11 * calls_of(lambda: script(nested(8)))


# --- the table -------------------------------------------------------------------------------------------


def test_the_module_writes_the_table_that_is_shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr(Path, "write_text", lambda _, content, **__: written.append(content))
    monkeypatch.delitem(sys.modules, "ss2sql.frontend.syntax.parse_table", raising=False)
    runpy.run_module("ss2sql.frontend.syntax.parse_table", run_name="__main__")
    monkeypatch.undo()
    shipped = json.loads(parser.TABLE.read_text(encoding="utf-8"))
    assert list(map(json.loads, written)) == [shipped], "run python -m ss2sql.frontend.syntax.parse_table"


def test_the_scanner_knows_the_words_of_the_grammar() -> None:
    kinds = {
        kind
        for row in parser.load_parse_table().rows
        for kind in row
        if not kind.islower() and not kind.startswith("_")
    }
    words = {kind for kind in kinds if kind.isalpha()} - {"NAME", "INTEGER", "FLOAT", "STRING"}
    assert words == tokenizer.RESERVED | tokenizer.CONTEXTUAL
