"""Random functions of one expression: inlined or called, on both engines, a script comes to the same.

SS2SQL_PROGRAMS sets the number of functions; `make nightly` tries many.
"""

from __future__ import annotations

import importlib.util
import random
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from agreement import exact
from programs.drawn import amount

import ss2sql

FUNCTIONS = amount(1 / 10)
HELPERS = """import math

LIMIT = 3
PAIR = (1, 2)


def minus(a, b):
    return a - b


def either(a, b):
    return (b, a) if a else b


def scaled(a, b=2):
    return a * b


"""
VALUES: dict[str, list[Any]] = {
    "int": [0, 1, 2, -1, 3, 7, -5],
    "wide": [0, 1, 2**62, -(2**63), 2**63 - 1, 10**15, 10**15 + 1, -(10**9), 2**53 + 1],
    "float": [0.0, -0.0, 0.5, -1.5, 2.0, 1e308, -1e308, 5e-324, 1.5e15],
    "num": [1, -2, 0.5, -0.0, 2**40, 3.0],
    "bool": [True, False],
    "str": ["", "a", "b", "ab", "ü", "1"],
    "maybe": [None, 1, 2.5, 0],
    "mixed": [1, "a", None, [1], True, 0.5, {"k": 1}],
    "list": [[1, 2], [0.5, 1], [3, 4]],
    "lists": [[], [1], [1, 2]],
}
TEMPLATES: dict[str, tuple[str, ...]] = {
    "num": (
        *("({num} + {num})", "({num} - {num})", "({num} * {num})", "({num} / {num})", "({num} % {num})", "(-{num})"),
        *("({num} ** 2)", "(abs({num}) ** 0.5)", "math.sqrt({num} * {num})", "abs({num})", "min({num}, {num})"),
        *("max({num}, {num}, 1)", "int({num})", "round({num})", "round({num}, 1)", "float({num})", "len({str})"),
        *("({num} if {bool} else {num})", "({num} and {num})", "({num} or {num})", "[{num}, {num}][1]", "LIMIT"),
        *("minus({num}, {num})", "scaled({num})", "scaled(b={num}, a={num})", "{list}[0]", "PAIR[-1]"),
        *("0", "1", "-2", "0.5", "-0.0", "1e300", "9223372036854775807", "True"),
    ),
    "bool": (
        *("({num} < {num})", "({num} <= {num})", "({any} == {any})", "({any} != {any})", "({num} >= {num} > {num})"),
        *("(not {any})", "({bool} and {bool})", "({bool} or {bool})", "({any} is None)", "({any} is not None)"),
        *("({any} in (1, 2.5, 3))", "({num} not in PAIR)", "({str} in {str})", "({str} < {str})", "bool({any})"),
    ),
    "str": (
        *("({str} + {str})", "str({num})", "{str}[:1]", "({str} if {bool} else {str})", "'a'", "''", "({str} or 'x')"),
    ),
    "list": ("[{num}, {num}]", "({list} + {list})", "{list}[1:]", "either({list}, {list})", "[{any}, {any}]"),
    "any": ("{num}", "{num}", "{bool}", "{str}", "{list}", "None", "({any} if {bool} else {any})", "({any} or {any})"),
}
KINDS = {"num": ("int", "wide", "float", "num", "maybe"), "bool": ("bool",), "str": ("str",), "list": ("list", "lists")}
SCRIPTS = (
    "SELECT {call} FROM rows WHERE i == {i} AS list;",
    "SELECT i FROM rows WHERE i == {i} AND {call} AS list;",
    "SELECT {call}, count(*) FROM rows WHERE i == {i} GROUP BY {call} AS list;",
    "SELECT x FROM (SELECT to({call}, x), i FROM rows) WHERE i == {i} AS list;",
    "SELECT (SELECT {call} FROM [1] AS value) FROM rows WHERE i == {i} AS list;",
    "SELECT i FROM rows WHERE i == {i} ORDER BY {call} AS list;",
    "SELECT n, s FROM rows WHERE i == {i} START WITH s = a, n = 0 CONNECT BY s = {call}, n = n + 1"
    " STOP WITH n == 1 OR i != {i} AS list;",
)


class Writer:
    """Writes the text of a function, and knows of what kind its parameters are meant to be."""

    def __init__(self, choices: random.Random) -> None:
        self.choices = choices
        self.kinds = [
            choices.choice(["num", "num", "num", "bool", "str", "list"]) for _ in range(choices.randint(1, 3))
        ]

    def expression(self, kind: str, depth: int) -> str:
        pick = self.choices
        named = [name for name, known in zip("abc", self.kinds, strict=False) if known == kind or kind == "any"]
        if named and pick.random() < (0.4 if depth else 0.9):
            return pick.choice(named)
        if pick.random() < 0.03:
            kind = "any"
        options = TEMPLATES[kind]
        if not depth:
            options = tuple(text for text in options if "{" not in text) or options[:1]
        text = pick.choice(options)
        while "{" in text:
            start, end = text.index("{"), text.index("}")
            text = text[:start] + self.expression(text[start + 1 : end], max(depth - 1, 0)) + text[end + 1 :]
        return text

    def function(self, name: str) -> str:
        pick = self.choices
        parameters = list("abc"[: len(self.kinds)])
        if pick.random() < 0.2:
            parameters[-1] += pick.choice(["=1", "=None", "=0.5", "='a'"])
        kind = pick.choice(["num", "num", "num", "bool", "bool", "str", "list", "any"])
        lines = [f"    return {self.expression(kind, pick.randint(1, 3))}"]
        if pick.random() < 0.25:
            lines.insert(0, f"    if {self.expression('bool', 2)}:\n        return {self.expression(kind, 2)}")
        return f"def {name}({', '.join(parameters)}):\n" + "\n".join(lines) + "\n\n\n"

    def row(self, number: int, pools: list[str]) -> dict[str, Any]:
        values = {name: self.choices.choice(VALUES[pool]) for name, pool in zip("abc", pools, strict=False)}
        return {"i": number, **values}

    def pools(self) -> list[str]:
        choose = self.choices.choice
        return [choose(KINDS[kind]) if self.choices.random() < 0.9 else choose(list(VALUES)) for kind in self.kinds]

    def call(self, name: str) -> str:
        """A call with columns, or with small expressions of columns."""
        pick = self.choices
        arguments = []
        for column, kind in zip("abc", self.kinds, strict=False):
            forms = [column] * 6 + {"num": [f"-{column}", f"{column} + 1", f"1 / {column}"]}.get(kind, [])
            arguments.append(pick.choice([*forms, f"[{column}, 1]"] if kind == "list" else forms))
        text = f"{name}({', '.join(arguments)})"
        return f"{name}({text})" if len(arguments) == 1 and pick.random() < 0.15 else text


def written(folder: Path, seed: int) -> tuple[ModuleType, list[Writer]]:
    """A module of random functions `f0`, `f1` ..., and who wrote them."""
    writers = [Writer(random.Random(seed * 100_000 + number)) for number in range(FUNCTIONS)]
    path = folder / f"random_functions_{seed}.py"
    path.write_text(HELPERS + "".join(writer.function(f"f{number}") for number, writer in enumerate(writers)), "utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, writers


def outcome(ss: ss2sql.Session, script: str, engine: Any) -> tuple[Any, int]:
    """What a script comes to, to the last detail of an error, and the number of calls."""
    try:
        result = ss.run(script, engine=engine)
    except ss2sql.UnsupportedError:
        return None, 0
    except Exception as error:
        return (type(error).__name__, str(error)), 0
    return exact(result.value), sum(result.stats.calls.values())


@pytest.mark.drawn
@pytest.mark.filterwarnings("ignore::SyntaxWarning")  # of `1 is None` and the like
@pytest.mark.parametrize("seed", [1, 2])
def test_inlined_or_called_a_script_comes_to_the_same(tmp_path: Path, seed: int) -> None:
    module, writers = written(tmp_path, seed)
    sessions = {on: ss2sql.connect(disable=[] if on else ["inline"]) for on in (True, False)}
    for ss in sessions.values():
        for number in range(len(writers)):
            ss.function(f"f{number}", getattr(module, f"f{number}"), volatility="immutable")
    counts: Counter[str] = Counter()
    for number, writer in enumerate(writers):
        pools = writer.pools()
        rows = [writer.row(i, pools) for i in range(writer.choices.choice([1, 3]))]
        for ss in sessions.values():
            ss.attach("rows", rows)
        for i in range(len(rows)):
            script = writer.choices.choice(SCRIPTS).replace("{call}", writer.call(f"f{number}")).replace("{i}", str(i))
            for engine in ("database", "native"):
                value, calls = outcome(sessions[True], script, engine)
                expected, _ = outcome(sessions[False], script, engine)
                if expected is None and value is not None:  # what is inlined is known better, and SQL can do more
                    expected, _ = outcome(sessions[False], script, "native")
                assert value == expected, (engine, script, rows, (tmp_path / f"{module.__name__}.py"))
                if value is not None and value[0] == "list":
                    counts["called" if calls else "inlined"] += 1
    assert counts["inlined"] > counts["called"] / 2
