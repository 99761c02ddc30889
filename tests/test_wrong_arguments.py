"""Wrong arguments from Python: every public function works, or says what is wrong in an error of ss2sql.

What Python's own functions say of a path or of a keyword that nobody has stays theirs: TypeError and OSError.
"""

from __future__ import annotations

import asyncio
import functools
import inspect
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from sessions import code_of

import ss2sql
from ss2sql.errors import SessionError
from ss2sql.frontend.volatility import Arity, infer_arity

ODD = [None, 0, -1, 1.5, "x", "SELECT", "", [1], {"a": 1}, len, object(), b"x", True, "a.csv"]
METHODS = {
    "function": 2, "attach": 2, "set": 2, "get": 1, "detach": 1, "describe": 1, "representation": 1, "compile": 1,
    "run": 1, "eval": 1, "on_change": 1, "tables": 0, "variables": 0, "graphs": 0, "interrupt": 0,
}  # fmt: skip
RESULTS = {"show": 0, "csv": 0, "json": 0, "explain": 0, "plot": 0}
PATHS = ("csv", "json")
SEARCH = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 0"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)


def calls(function: Callable[..., Any], positional: int) -> Iterator[tuple[tuple[Any, ...], dict[str, Any]]]:
    """Every odd value in every place, and for each keyword."""
    names = [one.name for one in inspect.signature(function).parameters.values() if one.default is not one.empty]
    sound = ("x", [1])[:positional]
    for arguments in product(ODD, repeat=positional):
        yield arguments, {}
    for name, value in product(names[max(0, positional - 1) :] if positional else names, ODD):
        yield sound, {name: value}


def wrong(function: Callable[..., Any], positional: int, usual: tuple[type[Exception], ...]) -> list[str]:
    """The calls that end with an exception which is neither ours nor usual."""
    found = []
    for arguments, named in calls(function, positional):
        try:
            function(*arguments, **named)
        except (ss2sql.Error, *usual):
            continue
        except Exception as error:
            if "multiple values" not in str(error) and "positional-only" not in str(error):
                found.append(f"{arguments} {named}: {error!r}")
    return found


@pytest.mark.parametrize("name", METHODS)
def test_methods_of_a_session(ss: ss2sql.Session, name: str) -> None:
    usual = (KeyError, TypeError) if name in ("get", "detach") else ()  # what a dict says of a key
    assert wrong(getattr(ss, name), METHODS[name], usual) == []
    assert ss.eval("SELECT this + 1 FROM [1] AS list") == [2]


@pytest.mark.parametrize("script", ["SELECT this, this + 1 FROM [1, 2]", SEARCH])
@pytest.mark.parametrize("name", RESULTS)
def test_methods_of_a_result(ss: ss2sql.Session, name: str, script: str) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.close("all")
    assert wrong(getattr(ss.run(script), name), 0, (TypeError, OSError) if name in PATHS else ()) == []
    pyplot.close("all")


def test_connect() -> None:
    assert wrong(ss2sql.connect, 0, ()) == []


def test_keywords_count_wherever_the_function_stands(ss: ss2sql.Session) -> None:
    calls = []

    def f(x: int) -> int:
        calls.append(x)
        return x

    ss.function(f, volatility="immutable")
    assert ss.eval("SELECT f(1) FROM [1, 2, 3] AS list") == [1, 1, 1]
    assert calls == [1]
    assert code_of(ss.function, f, volatility="often") == "S002"
    assert code_of(ss.function, f, f) == "S002"


def test_async_functions_are_refused(ss: ss2sql.Session) -> None:
    async def wait(x: int) -> int:
        return x

    async def several(x: int) -> Any:
        yield x

    assert code_of(ss.function, wait) == code_of(ss.function, "several", several) == "S002"
    ss.function("wait", lambda x: asyncio.run(wait(x)))
    assert ss.eval("wait(3);") == 3


def test_names_of_any_length(ss: ss2sql.Session, engine: Any) -> None:
    names = ["f" * 256, "f" * 300, "é" * 200, "f" * 240, "f" * 242]
    for number, name in enumerate(names):
        ss.function(name, lambda x, number=number: x + number, volatility="immutable")
    calls = ", ".join(f"{name}(this)" for name in names)
    assert ss.run(f"SELECT {calls} FROM [10] AS list", engine=engine).value == [10, 11, 12, 13, 14]


# --- how many arguments a function takes ----------------------------------------------------------------


class Robot:
    """Callables of every sort for the tests of arity."""

    def __init__(self, name: str, speed: float = 1.0) -> None:
        self.name = name

    def __call__(self, place: object) -> object:
        return place

    def move(self, place: object, speed: float = 1.0) -> object:
        return place


def wraps_three(*args: object) -> None:
    """Claims below to be a function of three arguments."""


wraps_three.__wrapped__ = lambda a, b, c: a  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("script", "cure", "value"),
    [
        ("reach([1, 2], tol = 0.5);", "reach([1, 2], 1.0, 0.5)", 9.5),
        ("reach(tol = 0.5, place = 3);", "reach(3, 1.0, 0.5)", 9.5),
        ("reach(1, tol = (x = 0.5), speed = 2);", "reach(1, 2, x = 0.5)", 19.5),
        ("SELECT reach(this, tol = this) FROM [1] AS value;", "reach(this, 1.0, this)", 9),
    ],
)
def test_a_named_argument_at_another_place(script: str, cure: str, value: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("reach", lambda place, speed=1.0, tol=0.1: speed * 10 - tol, volatility="immutable")
        with pytest.raises(ss2sql.ResolveError) as caught:
            ss.run(script)
        assert (caught.value.code, caught.value.hints[0]) == ("R005", f"write {cure}")
        start, _, rest = script.partition("reach(")
        end = rest[rest.rindex(")") + 1 :]
        assert ss.eval(f"{start}{cure}{end}") == value
        assert ss.eval("reach(place = 1, speed = 2, 0);") == 20  # at their own places
        assert ss.eval("reach(1, z = 2);") == 19.9  # of no parameter
        ss.function("keyed", lambda a, *, b=1: a)
        with pytest.raises(ss2sql.ResolveError, match="by its name alone"):
            ss.run("keyed(1, b = 3);")


TAKES: list[tuple[Any, Arity]] = [
    (lambda: 0, Arity(0, 0, ())), (lambda a, b, /, c=1: 0, Arity(2, 3, ("a", "b", "c"))),
    (lambda a, *rest: 0, Arity(1, None, ("a",))), (lambda a, *, b=1, **more: 0, Arity(1, 1, ("a",))),
    (functools.partial(lambda a, b, c: 0, 1), Arity(2, 2, ("b", "c"))),
    (functools.partial(lambda a, b: 0, b=1), Arity(1, 1, ("a",))),
    (functools.cache(lambda a, b=1: 0), Arity(1, 2, ("a", "b"))), (wraps_three, Arity(0, None, ())),
    (Robot("R").move, Arity(1, 2, ("place", "speed"))), (Robot("R"), Arity(1, 1, ("place",))),
    (Robot, Arity(1, 2, ("name", "speed"))), (len, Arity(1, 1, ("obj",))),
    *((function, Arity(0, None, ())) for function in (min, dict)),
]  # fmt: skip


def needs_key(a: int, *, unit: str) -> int:
    return a


def test_arity() -> None:
    assert [infer_arity(function) for function, _ in TAKES] == [expected for _, expected in TAKES]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [(needs_key, "needs_key.*unit"), (functools.partial(lambda a, b: 0, a=1), "'b'"), (3, "3"), ("move", "'move'")],
)
def test_arity_refuses_what_a_script_cannot_call(wrong: Any, words: str) -> None:
    with pytest.raises(SessionError, match=words) as caught:
        infer_arity(wrong)
    assert caught.value.code == "S002"
    assert caught.value.hints
