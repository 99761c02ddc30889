"""Bodies of Python functions as expressions: which are read, and that they give what the function gives."""

from __future__ import annotations

import inspect
import itertools
import sys
from collections.abc import Callable
from typing import Any

import pytest
from agreement import exact
from inline_samples import (
    WALL,
    apart,
    attribute,
    between,
    classify,
    compares_tuples,
    constant,
    cost,
    counts_a_tuple,
    decided,
    decides,
    default,
    either,
    every_other,
    floored,
    formatted,
    gives_too_few,
    gives_twice,
    gives_what_is_not_taken,
    go,
    greatest,
    head,
    identical,
    inc,
    keyed,
    large,
    late_name,
    length,
    letter,
    loops,
    mean,
    member,
    method,
    named,
    neither,
    pair,
    perhaps,
    raises,
    rebound,
    record,
    recursive,
    root,
    same,
    several,
    sign,
    sine,
    spreads,
    square,
    starred,
    swapped,
    switched,
    taxi,
    text,
    through,
    truth,
    tuple_default,
    whole,
)
from purity_samples import Load, load
from sessions import both

import ss2sql
from ss2sql.frontend.inline import Body, body_of

__all__ = ["load"]  # the fixture

Numbers = [0, 1, -2, 5, 7]
Floats = [0.0, -0.0, 1.5, -2.25, 4.0]
Mixed = [0, -0.0, 2, 2.5, True]
# function, arguments in terms of a and b, elements of a and of b
INLINED: list[tuple[Callable[..., Any], str, list[Any], list[Any]]] = [
    (constant, "", [1], [1]),
    (same, "a.this", [1, "x", None, [1], 0.5], [1]),
    (inc, "a.this", Mixed, [1]),
    (cost, "a.this", Numbers, [1]),
    (cost, "a.this, b.this", Floats, Numbers),
    (mean, "a.this, b.this", Numbers, Floats),
    (square, "a.this", Numbers, [1]),
    (square, "a.this", Floats, [1]),
    (root, "a.this, b.this", Numbers, Floats),
    (length, "a.this, b.this", Floats, Numbers),
    (sign, "a.this", Mixed, [1]),
    (classify, "a.this", Mixed, [1]),
    (between, "a.this, 0, b.this", Numbers, Floats),
    (between, "a.this, 'a', 'c'", ["", "a", "b", "c"], [1]),
    (default, "a.this", [1, None, "x"], [1]),
    (default, "a.this, b.this", Numbers, Numbers),
    (default, "a.this, b.this", ["", "ü"], ["", "x"]),
    (either, "a.this, b.this", Mixed, ["", "x", None, []]),
    (neither, "a.this, b.this", [None, 0, [], "x"], Mixed),
    (decides, "a.this, b.this", Mixed, [True, False]),
    (member, "a.this", [0, 1, 1.0, True, "1", None, 9], [1]),
    (pair, "a.this, b.this", Mixed, Numbers),
    (taxi, "[a.this, 1], [2, b.this]", Numbers, Floats),
    (go, "[a.this, b.this], [1, -1]", Numbers, Floats),
    (greatest, "a.this, b.this", Mixed, Floats),
    (text, "a.this, b.this", Mixed, [None, "x", ""]),
    (whole, "a.this, b.this", Numbers, Mixed),
    (through, "a.this, b.this", Numbers, Numbers),
    (named, "a.this", Floats, [1]),
    (swapped, "a.this, b.this", Numbers, Numbers),
    (apart, "[a.this, 1], [2, b.this]", Numbers, Floats),
    (head, "a.this", ["", "a", "abcd"], [1]),
    (head, "a.this", [[], [1], [1, 2, 3, 4]], [1]),
    (perhaps, "a.this", Mixed, [1]),
    (switched, "a.this", Mixed, [1]),
    (decided, "a.this", Numbers, [1]),
    (letter, "a.this", ["a", "", "bc", "x"], [1]),
    (truth, "a.this", Mixed, [1]),
]


@both
@pytest.mark.parametrize("disable", [(), ("unnest",)])
@pytest.mark.parametrize(
    ("function", "arguments", "first", "second"), INLINED, ids=lambda part: getattr(part, "__name__", "")
)
def test_what_is_inlined_gives_what_the_function_gives(
    function: Callable[..., Any],
    arguments: str,
    first: list[Any],
    second: list[Any],
    disable: tuple[str, ...],
    engine: Any,
) -> None:
    expected = []
    for one, other in itertools.product(first, second):
        values = [eval(part, {"a": _This(one), "b": _This(other)}) for part in _split(arguments)]
        expected.append([function(*values)])
    with ss2sql.connect(disable=disable) as ss:
        ss.function("f", function)
        ss.attach("first", first)
        ss.attach("second", second)
        result = ss.run(f"SELECT f({arguments}) FROM a = first, b = second AS rows;", engine=engine)
        assert exact([list(row) for row in result.value]) == exact(_plain(expected))
        assert result.stats.calls == {}
        assert "inline" in ss.compile(f"SELECT f({arguments}) FROM a = first, b = second AS rows;").explain()


class _This:
    def __init__(self, this: Any) -> None:
        self.this = this


def _split(arguments: str) -> list[str]:
    """The texts of the arguments; their words are Python's, too."""
    import ast

    return [ast.unparse(part) for part in ast.parse(f"f({arguments})", mode="eval").body.args]  # type: ignore[attr-defined]


def _plain(value: Any) -> Any:
    """Tuples as lists, as functions hand them over."""
    return list(map(_plain, value)) if isinstance(value, (list, tuple)) else value


# --- bodies that are not one expression of the language ------------------------------------------------


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (several, "is more than one expression"),
        (raises, "is more than one expression"),
        (floored, "the operator //"),
        (late_name, "is more than one expression"),
        (every_other, "a slice with a step"),
        (spreads, "calls cost with arguments that cannot be told apart"),
        (gives_twice, "calls cost with arguments that cannot be told apart"),
        (gives_too_few, "calls cost with the wrong arguments"),
        (gives_what_is_not_taken, "calls cost with the wrong arguments"),
        (sine, "calls math.sin"),
        (method, "calls x.upper"),
        (attribute, "reads 'x.real'"),
        (rebound, "reads the global name 'STEP', which may change"),
        (starred, "takes any number of arguments"),
        (formatted, "uses a format string"),
        (record, "uses a dict"),
        (recursive, "too deeply"),
        (compares_tuples, "a tuple inside an expression"),
        (counts_a_tuple, "calls pair, which gives a tuple"),
        (identical, "compares identities"),
        (keyed, "arguments by name"),
        (large, "uses a int"),
        (loops, "'listcomp'"),
        (tuple_default, "uses a tuple"),
        (abs, "is not a function written in Python"),
        (eval("lambda x: x"), "has no source"),
    ],
    ids=lambda part: getattr(part, "__name__", ""),
)
def test_bodies_that_the_language_does_not_have(function: Callable[..., Any], reason: str) -> None:
    found = body_of(function)
    assert isinstance(found, str)
    assert reason in found


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("return " + " + ".join(["x"] * 101), "is too long"),
        ("\n    ".join(f"if x == {number}: pass" for number in range(8)), "is too long"),
    ],
    ids=["many operators", "many conditions"],
)
def test_bodies_that_are_too_large(load: Load, text: str, reason: str) -> None:
    assert body_of(load(f"def f(x):\n    {text}\n").f) == reason


def test_a_body_is_followed_as_deep_as_python_goes(load: Load) -> None:
    function = load("def f(x): return " + "abs(" * 150 + "x" + ")" * 150).f
    limit = sys.getrecursionlimit()
    assert isinstance(body_of(function), Body)
    sys.setrecursionlimit(len(inspect.stack()) + 200)
    try:
        found = body_of(function)
    finally:
        sys.setrecursionlimit(limit)
    assert found == "is nested too deeply to be followed"


def test_what_a_body_says_of_itself() -> None:
    found = body_of(lambda x, y=WALL: x if x else (y, x))
    assert isinstance(found, Body)
    assert (found.parameters, found.defaults["y"].value, found.gives_tuple) == (("x", "y"), 4, True)
    assert found.text == "x if x else (y, x)"
    assert body_of(through).uses == {"add", "sub", "pow", "abs"}  # type: ignore[union-attr]
