"""Python functions whose source proves them immutable: `cases/purity/immutable.txt`, and what changes arguments."""

from __future__ import annotations

import contextlib
import copy
from typing import Any

import pytest
from purity_samples import Load, load
from sessions import samples

from ss2sql.frontend.purity import infer

__all__ = ["load"]  # the fixture

IMMUTABLE = samples("immutable")
TRIED: list[tuple[Any, ...]] = [
    ([0, 1], [[3, 2, 1], [], []]), ([2, 1], [1, 2]), (5, 3), ("ab", 2), ({"a": [1]}, [{"a": 1}]), ([3, 1, 2],),
    (4,), ("a b",), ({"a": [2]},), ([[1], [2]],), (1.5, 2.0, 3), ([1], [2], [3]), (),
]  # fmt: skip


@pytest.mark.parametrize("text", IMMUTABLE.values(), ids=IMMUTABLE.keys())
def test_immutable(load: Load, text: str) -> None:
    function = load(text).f
    found = infer(function)
    assert found.volatility == "immutable", found
    for arguments in [] if found.changes else TRIED:  # what changes nothing leaves its arguments alone
        given = copy.deepcopy(arguments)
        with contextlib.suppress(Exception):  # most functions do not take most of these
            function(*given)
        assert given == arguments


def test_a_module_of_the_users_own_is_followed(load: Load) -> None:
    load("SIZE = 3\ndef double(x): return 2 * x")
    module = load("import purity_sample_0 as constants\ndef f(x): return constants.double(x) + constants.SIZE")
    assert infer(module.f).volatility == "immutable"


CHANGES = [
    "def f(x): y = x[:]; y[0] = 1; return y",  # its own copy, but nobody looks so closely
    "def f(x): x[0] += 1; return x", "def f(x): del x[0]; return x", "def f(x): [x[0]] = [3]; return x",
    "def f(x):\n    for x[0] in [1, 2]: pass\n    return x", "def f(x): return [x.append(1), x]",
    "def f(x): return [y.pop() for y in x]", "def f(x):\n    def g(y): y.sort()\n    g(x)\n    return x",
    "def g(y): y.sort()\ndef f(x): g(x); return x", "import heapq\ndef f(x): heapq.heapify(x); return x",
    "def f(x): return list(map(list.pop, x))",
]  # fmt: skip
CHANGES_NOTHING = [
    "def f(step, towers): return towers[step[0]] + [1]", "def f(x): return sorted(x, key=lambda y: -y)",
    "def g(y): return y\ndef f(x): return g(x)",
]  # fmt: skip


@pytest.mark.parametrize("text", [*CHANGES, *CHANGES_NOTHING])
def test_whether_a_function_may_change_its_arguments(load: Load, text: str) -> None:
    found = infer(load(text).f)
    assert found.changes is (text in CHANGES)
    assert found.volatility == "immutable" or found.changes
