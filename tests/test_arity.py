"""How many positional arguments a Python function takes."""

from __future__ import annotations

import functools
from typing import Any

import pytest

from ss2sql.errors import SessionError
from ss2sql.frontend.volatility import Arity, infer_arity


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
