"""Many hostile scripts: each ends with a value or an error of ss2sql, and leaves everything as it was."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import apsw
import pytest

import ss2sql
from ss2sql.errors import Error

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


# What is asked of an object, of a list and of rows; names, texts, numbers, calls and forms take the place of what is
# in braces, each of them once in each.
SCRIPTS = (
    *(f"{of}.{{name}};" for of in ("canary", "xs", "canary.secret")), "canary[{text}];", "{name};", "{name}(canary);",
    "eval({text});", "SELECT {name} FROM objects;", "SELECT this.{name}, a.{name} FROM a = objects;",
    "SELECT * FROM {name};", "SELECT this[{text}], {text} FROM objects WHERE this == {text} AS {form};",
    "SELECT this, to(a, {text}) FROM t, xs AS {form}({text});", "SELECT a FROM t AS {form}(path = {text});",
    "SELECT canary, {name} FROM xs GROUP BY this AS {form};", "SELECT a FROM t WHERE {name} LIMIT {number};",
    "{call}(canary, {text}); {call}(xs);", "{call}({number}, {number}) + canary;", "xs[{number}] ^ {number};",
    "SELECT {call}(this, {text}) FROM objects START WITH s = {number} CONNECT BY MAXIMUM 3 UNIQUE s = {call}(this);",
    "SELECT this FROM objects ORDER BY {call}(this, {number});", "{name}{{number}}; canary.{name} + {text};",
    "'{name}' IN {text}{torn}",
)  # fmt: skip
HOLES = {
    "name": NAMES, "text": (*(f'"{text}"' for text in TEXTS), *(f"'{name}'" for name in NAMES[:9])), "number": NUMBERS,
    "call": CALLS, "form": FORMS, "torn": ("'", '"', "(", ")", "/*", ";", "\0", "[", "--", "\\", "#"),
}  # fmt: skip


def hostile() -> Iterator[str]:
    """Each script with everything that may stand in its holes, in turn."""
    for number, written in enumerate(SCRIPTS):
        holes = re.findall(r"{(\w+)}", written)
        for turn in range(max(len(HOLES[hole]) for hole in holes)):
            fill = iter(HOLES[hole][(turn + 7 * at + number) % len(HOLES[hole])] for at, hole in enumerate(holes))
            yield re.sub(r"{\w+}", lambda _, fill=fill: next(fill), written)


def test_hostile_scripts_reach_nothing_and_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
        for script in hostile():
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
