"""The parser: limits of size and depth, and the table that it ships with."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest
from trees import calls_of, failure, script

from ss2sql.frontend.syntax import parse_table, tokenizer

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


def test_a_table_of_another_grammar_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = parse_table.load_parse_table()
    for content in (None, {"format": 0}, {"format": parse_table.FORMAT, "grammar": "of another time"}):
        stale = tmp_path / "table.json"
        if content is not None:
            stale.write_text(json.dumps(content), encoding="utf-8")
        monkeypatch.setattr(parse_table, "TABLE", stale)
        assert parse_table.load_parse_table.__wrapped__() == shipped


def test_the_module_writes_the_table_that_is_shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr(Path, "write_text", lambda _, content, **__: written.append(content))
    monkeypatch.delitem(sys.modules, "ss2sql.frontend.syntax.parse_table")
    runpy.run_module("ss2sql.frontend.syntax.parse_table", run_name="__main__")
    monkeypatch.undo()
    shipped = json.loads(parse_table.TABLE.read_text(encoding="utf-8"))
    # another release of lark may build the same table
    assert [json.loads(content) | {"lark": ""} for content in written] == [shipped | {"lark": ""}], (
        "run python -m ss2sql.frontend.syntax.parse_table"
    )


def test_the_scanner_knows_the_words_of_the_grammar() -> None:
    kinds = {
        kind
        for row in parse_table.load_parse_table().rows
        for kind in row
        if not kind.islower() and not kind.startswith("_")
    }
    words = {kind for kind in kinds if kind.isalpha()} - {"NAME", "INTEGER", "FLOAT", "STRING"}
    assert words == tokenizer.RESERVED | tokenizer.CONTEXTUAL
