"""The parser: limits of size and depth, speed, and the table that it ships with."""

from __future__ import annotations

import json
import logging
import runpy
import sys
from pathlib import Path
from typing import Any

import lark
import pytest
from trees import code, script

from ss2sql.frontend import table, text


def test_nesting_is_refused_above_two_hundred() -> None:
    for opening, closing in ("()", "[]"):
        script(opening * 200 + "a" + closing * 200)
        assert code(opening * 201 + "a" + closing * 201) == "P005"
    script("f(" * 200 + "a" + ")" * 200)
    assert code("f(" * 201 + "a" + ")" * 201) == "P005"
    script("NOT " * 200 + "a")
    assert code("NOT " * 201 + "a") == "P005"
    script("- " * 200 + "a")
    assert code("-" * 201 + "a") == "P005"
    script("^".join(["a"] * 201))
    assert code("^".join(["a"] * 202)) == "P005"
    assert code("2^-" * 201 + "a") == "P005"
    assert code("SELECT a FROM " * 202 + "b") == "P005"
    assert code("(" * 10_000 + ")" * 10_000) == "P005"
    assert code("v{" * 10_000) == "P005"


def test_only_what_nests_counts() -> None:
    script(";".join(["SELECT a FROM b"] * 1000))
    script("[" + ", ".join(["(SELECT a FROM b AS list)"] * 1000) + "]")
    script("[" + ", ".join(["SELECT a FROM b AS list"] * 1000) + "]")
    script("[" + ", ".join(["a ^ 2 - b ^ 2"] * 1000) + "]")
    script("SELECT a FROM b WHERE " + " AND ".join(["NOT a == -1"] * 5000))
    script(" OR ".join(["-a < b"] * 5000))
    script("f(" + ", ".join(["a"] * 20_000) + ")")


def test_trees_deeper_than_three_hundred_are_refused() -> None:
    script("+".join(["a"] * 300))
    assert code("+".join(["a"] * 301)) == "P005"
    assert code("+".join(["1"] * 10_000)) == "P005"
    assert code("a" + "[0]" * 10_000) == "P005"
    assert code(" XOR ".join(["a"] * 10_000)) == "P005"
    assert code("a = " * 10_000 + "1") == "P005"
    assert code("f(1 + 2 * " * 150 + "a" + ")" * 150) == "P005"
    assert code("1 + 2 - " * 151 + "a") == "P005"


def test_size_is_refused_above_256_kib() -> None:
    script("a" + " " * (256 * 1024 - 1))
    assert code("a" + " " * (256 * 1024)) == "P004"
    script("'" + "é" * (128 * 1024 - 1) + "'")
    assert code("'" + "é" * (128 * 1024) + "'") == "P004"
    assert code("x" * 1_000_000) == "P004"


def _calls(written: str) -> int:
    """How many functions are called to parse a text, those of C included."""
    count = 0

    def note(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        script(written)
    finally:
        sys.setprofile(before)
    return count


def test_nested_calls_cost_what_they_are_long() -> None:
    def nested(depth: int) -> str:
        return "f(a, " * depth + "b" + ")" * depth + ";"

    assert _calls(nested(80)) <= 11 * _calls(nested(8))


@pytest.mark.parametrize("part", ["a = f(b, 1)[0] + 2;", "SELECT a FROM b WHERE c == 'd' AS list;", "[[1, 2], x];"])
def test_work_grows_with_the_length_only(part: str) -> None:
    assert _calls(part * 400) <= 4 * _calls(part * 100)


def test_work_of_one_long_list_grows_with_its_length_only() -> None:
    assert _calls("[" + "1, " * 4000 + "1]") <= 4 * _calls("[" + "1, " * 1000 + "1]")


def test_the_shipped_table_is_fresh() -> None:
    shipped = json.loads(table.TABLE.read_text(encoding="utf-8"))
    built = table.build()
    del shipped["lark"], built["lark"]  # another release of lark may build the same table
    assert shipped == built, "run python -m ss2sql.frontend.table"


def test_a_table_of_another_grammar_is_not_used(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = table.load()
    for content in (None, {"format": 0}, {"format": table.FORMAT, "grammar": "of another time"}):
        stale = tmp_path / "table.json"
        if content is not None:
            stale.write_text(json.dumps(content), encoding="utf-8")
        monkeypatch.setattr(table, "TABLE", stale)
        assert table.load.__wrapped__() == shipped


def test_powers_of_powers_nest() -> None:
    script("^".join(["2"] * 200))
    assert code("^".join(["2"] * 203)) == "P005"


def test_the_module_writes_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr(Path, "write_text", lambda _, content, **__: written.append(content))
    monkeypatch.delitem(sys.modules, "ss2sql.frontend.table")
    runpy.run_module("ss2sql.frontend.table", run_name="__main__")
    monkeypatch.undo()
    shipped = json.loads(table.TABLE.read_text(encoding="utf-8"))
    assert [json.loads(content) | {"lark": ""} for content in written] == [shipped | {"lark": ""}]


def test_write_table_writes_what_is_shipped(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = table.TABLE.read_bytes()
    monkeypatch.setattr(table, "TABLE", tmp_path / "table.json")
    table.write_table()
    written = json.loads((tmp_path / "table.json").read_bytes())
    assert written | {"lark": ""} == json.loads(shipped) | {"lark": ""}


def test_the_grammar_is_ambiguous_in_queries_without_parentheses_only(caplog: pytest.LogCaptureFixture) -> None:
    grammar = table.GRAMMAR.read_text(encoding="utf-8")

    def conflicts() -> bool:
        caplog.clear()
        with caplog.at_level(logging.DEBUG, logger="lark"):
            lark.Lark(grammar, parser="lalr", start="script")
        return "Shift/Reduce conflict" in caplog.text

    assert conflicts()
    for old, new in (
        ("| power | query\n", "| power\n"),
        ("(postfix | query)", "postfix"),
        ('| "(" value ")" ', '| "(" (value | query) ")" '),
    ):
        assert grammar.count(old) == 1
        grammar = grammar.replace(old, new)
    assert not conflicts()


def test_the_scanner_knows_the_words_of_the_grammar() -> None:
    kinds = {kind for row in table.load().rows for kind in row if not kind.islower() and not kind.startswith("_")}
    words = {kind for kind in kinds if kind.isalpha()} - {"NAME", "INTEGER", "FLOAT", "STRING"}
    assert words == text.RESERVED | text.CONTEXTUAL
