"""Scripts of somebody who wants out: fragments that have opened other programs, combined at random."""

from __future__ import annotations

import random
from typing import Any

ALLOWED = frozenset({"__class__", "__eq__", "__hash__", "__repr__", "__len__", "__array__", "__arrow_c_stream__"})

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
    """An object that writes down whatever is read of it beside what values of the language are asked for."""

    def __init__(self) -> None:
        self.secret = "secret"

    def __getattribute__(self, name: str) -> Any:
        if name not in ALLOWED:
            reached.add(name)
        return object.__getattribute__(self, name)

    def __repr__(self) -> str:
        return "<canary>"


reached: set[str] = set()


class Maker:
    """Makes scripts from a seed. None of them assigns a variable."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.pick = self.random.choice

    def script(self) -> str:
        text = "; ".join(self.pick((self.query, self.expression))(3) for _ in range(self.random.randint(1, 2)))
        if self.random.random() < 0.1:  # torn apart somewhere
            at = self.random.randrange(len(text) + 1)
            text = text[:at] + self.pick(("'", '"', "(", ")", "/*", ";", "\0", "[", "--", "\\", "#")) + text[at:]
        return text

    def expression(self, depth: int) -> str:
        simple = (lambda: self.pick(NAMES), self.text, lambda: self.pick(NUMBERS), lambda: "canary", lambda: "xs")
        if depth <= 0:
            return self.pick(simple)()
        inner = lambda: self.expression(depth - 1)  # noqa: E731 - the shortest name for it
        return self.pick(
            (
                *simple,
                lambda: f"{self.pick(CALLS)}({', '.join(inner() for _ in range(self.random.randint(0, 2)))})",
                lambda: f"{self.pick(NAMES)}({inner()})",
                lambda: f"{self.pick(('canary', 'xs', 'this', 't', 'a'))}.{self.pick(NAMES)}",
                lambda: f"{inner()}[{inner()}]",
                lambda: (
                    f"({inner()} {self.pick(('+', '-', '*', '/', '%', '^', '==', '<', 'IN', 'AND', 'OR'))} {inner()})"
                ),
                lambda: f"[{inner()}, {inner()}]",
                lambda: f"IF({inner()}; {inner()}; {inner()})",
                lambda: f"({self.query(depth - 1)} AS {self.form()})",
                lambda: f"{self.pick(NAMES)}{{{inner()}}}",
            )
        )()

    def text(self) -> str:
        return f'"{self.pick(TEXTS)}"' if self.random.random() < 0.7 else f"'{self.pick(NAMES)}'"

    def form(self) -> str:
        form = self.pick(FORMS)
        return form if self.random.random() < 0.6 else f"{form}({self.pick((self.text(), 'path = ' + self.text()))})"

    def source(self, depth: int) -> str:
        source = self.pick(("xs", "t", "canary", "objects", self.pick(NAMES), self.expression(depth - 1)))
        return source if self.random.random() < 0.7 else f"{self.pick(NAMES)} = {source}"

    def column(self, depth: int) -> str:
        column = self.pick(("this", "this", self.expression(depth - 1), self.expression(depth - 2)))
        return column if self.random.random() < 0.7 or column == "*" else f"to({column}, {self.text()})"

    def query(self, depth: int) -> str:
        text = f"SELECT {self.column(depth)}, {self.column(depth)} FROM {self.source(depth)}"
        clauses = (
            lambda: f" WHERE {self.expression(depth - 1)}",
            lambda: f" GROUP BY {self.expression(depth - 1)}",
            lambda: f" ORDER BY {self.expression(depth - 1)}",
            lambda: f" LIMIT {self.pick(NUMBERS)}",
            lambda: f" START WITH s = {self.expression(1)} CONNECT BY MAXIMUM 3 UNIQUE s = {self.expression(1)}",
        )
        return text + (self.pick(clauses)() if self.random.random() < 0.6 else "")
