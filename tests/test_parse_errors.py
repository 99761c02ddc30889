"""What the parser says about text that is not SelectScript, or is that of another language: code, place, reason, cure.

Golden cases (`cases/errors`) show the most frequent errors as a user sees them; `syntax.errors` has all others.
"""

from __future__ import annotations

import pytest
from sessions import wrong_scripts
from trees import check, failure

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


# --- several errors at once ------------------------------------------------------------------------------


def places(source: str) -> list[tuple[str, str]]:
    """Code and line:column of every error."""
    return [(error.code, error.span.place.split(":", 1)[1]) for error in failure(source).errors if error.span]


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("x = ;\ny = 3 +;\nz = 4;\nSELECT a FORM b;\nw = (1", "P001 1:5, P001 2:8, P001 4:10, P002 5:7"),
        ("x = 'abc;\ny = 3 3;\nz = 1 $ 2 $ 3; u = -'\\x';", "P003 1:5, P001 2:7, P003 3:7, P003 3:22"),
        ("x = 1e999; y = ; z = SELECT a FROM SELECT b FROM c; w = 1 2;", "P007 1:5, P001 1:16, P009 1:36, P001 1:59"),
        # an open bracket ends with its statement
        ("x = (1 + 2;\ny = 3 3;", "P001 1:11, P001 2:7"),
        ("x = f(1, [2;\nIF(a; b; c);\ny = 3 3;", "P001 1:12, P001 3:7"),
    ],
    ids=ascii,
)
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
