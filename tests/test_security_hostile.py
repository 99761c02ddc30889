"""Many hostile scripts: each ends with a value or an error of ss2sql, and leaves everything as it was.

SS2SQL_HOSTILE=10000 tries so many.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import re
from pathlib import Path
from typing import Any

import apsw
import pytest

import ss2sql
from ss2sql.errors import Error

COUNT = int(os.environ.get("SS2SQL_HOSTILE", "1000"))
AT_ONCE = 250  # scripts of one session


ALLOWED = frozenset(
    {"__class__", "__eq__", "__hash__", "__repr__", "__len__", "__array__", "__arrow_c_stream__", "__dict__"}
)

NAMES = (
    "__class__", "__dict__", "__globals__", "__builtins__", "__import__", "_private", "secret", "os", "sys", "open",
    "exec", "compile", "getattr", "host", "self", "session", "connection", "sqlite_master", "sqlite_schema", "file",
    "pragma_table_list", "json_each", "generate_series", "readfile", "writefile", "load_extension", "edit", "printf",
    "zeroblob", "randomblob", "fts3_tokenizer", "dbstat", "main", "temp", "ss2sql_temporal", "canary", "t", "xs", "f",
    "rowid", "this", "level", "list", "value", "cost", "pool", "field", "collect", "step_cost", "in_turn", "elements",
)  # fmt: skip
TEXTS = (
    "/etc/passwd", "../../x", "x; DROP TABLE t", "x' OR '1'='1", '\\"; DROP TABLE t; --', "\\0", "a\\0b",
    "\\x1b]0;t\\x07", "ATTACH 'x.db' AS y", "PRAGMA writable_schema = 1", "__import__('os')", "{0.__class__}", "%s%n",
    "(a+)+$", "x.db",
    'eval(\\"eval(1)\\")', "SELECT * FROM t", "canary.secret", "*/", "${x}", "`x`", "ſelect", "this.__class__;",
    "1;", "file:x?mode=rwc",
)  # fmt: skip
NUMBERS = ("0", "-1", "1", "2", "9223372036854775807", "1e308", "10 ^ 12", "0.5", "True", "None")
FORMS = (
    "list", "dict", "rows", "value", "set", "void", "csv", "json", "plane", "prolog", "file", "pickle", "environment",
)  # fmt: skip
CALLS = (
    "len", "str", "int", "float", "range", "sum", "min", "max", "sorted", "uniq", "zip", "round", "sqrt", "help", "var",
    "print", "eval", "abs", "norm", "distance", "f", "getTime",
)  # fmt: skip


class Canary:
    """An object that writes down what is read of it beside its data and what values of the language are asked for."""

    def __init__(self) -> None:
        self._private = "secret"

    @property
    def secret(self) -> str:
        return "secret"

    def __getattribute__(self, name: str) -> Any:
        if name not in ALLOWED:
            reached.add(name)
        return object.__getattribute__(self, name)

    def __repr__(self) -> str:
        return "<canary>"


reached: set[str] = set()


INNER = "{expression}"
SIMPLE = ("{name}", "{text}", "{number}", "canary", "xs")
COLUMNS = ("this", "this", INNER, INNER)
# What each part of a script may be written as; those at the front of an expression end it.
GRAMMAR: dict[str, tuple[str, ...]] = {
    "script": ("{query}", INNER, "{query}; {query}", f"{INNER}; {INNER}", f"{{query}}; {INNER}", f"{INNER}; {{query}}"),
    "expression": (
        *SIMPLE * 3, "{call}()", f"{{call}}({INNER})", f"{{call}}({INNER}, {INNER})", f"{{name}}({INNER})",
        *(f"{named}.{{name}}" for named in ("canary", "xs", "this", "t", "a")), f"{INNER}[{INNER}]",
        *(f"({INNER} {sign} {INNER})" for sign in ("+", "-", "*", "/", "%", "^", "==", "<", "IN", "AND", "OR")),
        f"[{INNER}, {INNER}]", f"IF({INNER}; {INNER}; {INNER})", "({query} AS {form})", "({query} AS {form})",
        f"{{name}}{{{{{INNER}}}}}",
    ),
    "text": ('"{words}"', '"{words}"', "'{name}'"),
    "form": ("{shape}", "{shape}", "{shape}({text})", "{shape}(path = {text})"),
    "source": ("xs", "t", "canary", "objects", "{name}", INNER, "{name} = xs", f"{{name}} = {INNER}"),
    "column": (*COLUMNS, "to(this, {text})", f"to({INNER}, {{text}})"),
    "query": ("SELECT {column}, {column} FROM {source}{clause}",),
    "clause": (
        "", "", "", f" WHERE {INNER}", f" GROUP BY {INNER}", f" ORDER BY {INNER}", " LIMIT {number}",
        f" START WITH s = {INNER} CONNECT BY MAXIMUM 3 UNIQUE s = {INNER}",
    ),
    "name": NAMES, "words": TEXTS, "number": NUMBERS, "call": CALLS, "shape": FORMS,
}  # fmt: skip
DEEPEST = 5  # parts inside of each other


class Maker:
    """Makes scripts from a seed. None of them assigns a variable."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def script(self) -> str:
        text = self.made("script", 0)
        if self.random.random() < 0.1:  # torn apart somewhere
            at = self.random.randrange(len(text) + 1)
            torn = self.random.choice(("'", '"', "(", ")", "/*", ";", "\0", "[", "--", "\\", "#"))
            text = text[:at] + torn + text[at:]
        return text

    def made(self, part: str, depth: int) -> str:
        written = self.random.choice(SIMPLE if part == "expression" and depth > DEEPEST else GRAMMAR[part])
        if GRAMMAR[part] in (NAMES, TEXTS, NUMBERS, CALLS, FORMS):
            return written  # braces in a text are its own
        pieces = re.split(r"\{(\w+)\}", written)
        pieces[::2] = [piece.replace("{{", "{").replace("}}", "}") for piece in pieces[::2]]
        pieces[1::2] = [self.made(inside, depth + 1) for inside in pieces[1::2]]
        return "".join(pieces)


@pytest.mark.parametrize("first", range(0, COUNT, AT_ONCE))
def test_hostile_scripts_reach_nothing_and_change_nothing(
    first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "data.db"
    connection = apsw.Connection(str(path))
    connection.execute(
        "CREATE TABLE t(a, b); INSERT INTO t VALUES (1, 'x'), (2, 'y'); CREATE VIEW v AS SELECT a FROM t"
    )
    connection.close()
    before, folder = path.read_bytes(), tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with ss2sql.connect(path, progress=False, max_size=2**20) as ss:
        ss.function("f", lambda x=None: x, volatility="immutable")
        ss.set("xs", [1, [2, "b"], None])
        canary = Canary()
        assert canary.secret == "secret"
        assert "secret" in reached  # so it would sing
        ss.attach("objects", [canary])
        ss.set("canary", canary)
        variables = ss.variables()
        reached.clear()
        for seed in range(first, min(first + AT_ONCE, COUNT)):
            script = Maker(seed).script()
            for engine in ("database", "native"):
                output = io.StringIO()
                with contextlib.redirect_stdout(output), contextlib.suppress(Error):
                    ss.run(script, engine=engine, timeout=2.0, max_rows=10_000)  # type: ignore[arg-type]
                assert "\x1b" not in output.getvalue(), script
                assert not reached, (script, reached)
        assert ss.variables() == variables
        assert ss.eval("SELECT a FROM t AS list") == [1, 2]
    assert path.read_bytes() == before
    assert list(folder.iterdir()) == []
    assert list(tmp_path.glob("data.db?*")) == []
