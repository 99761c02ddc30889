"""Python functions whose source proves them immutable, and others, with the reason, both in `cases/purity`.

Also places, functions without source, attempts to deceive, and proofs that would take too long.
"""

from __future__ import annotations

import builtins
import contextlib
import copy
import functools
import linecache
import math
import operator
import random
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from golden import each_row
from purity_samples import Load, load
from sessions import samples

from ss2sql.frontend.volatility import Purity, function_names, infer_purity

__all__ = ["load"]  # the fixture
IMMUTABLE = samples("immutable")
TRIED: list[tuple[Any, ...]] = [
    ([0, 1], [[3, 2, 1], [], []]), ([2, 1], [1, 2]), (5, 3), ("ab", 2), ({"a": [1]}, [{"a": 1}]), ([3, 1, 2],),
    (4,), ("a b",), ({"a": [2]},), ([[1], [2]],), (1.5, 2.0, 3), ([1], [2], [3]), (),
]  # fmt: skip


@pytest.mark.parametrize("text", IMMUTABLE.values(), ids=IMMUTABLE.keys())
def test_immutable(load: Load, text: str) -> None:
    function = load(text).f
    found = infer_purity(function)
    assert found.volatility == "immutable", found
    for arguments in TRIED:
        given = copy.deepcopy(arguments)
        with contextlib.suppress(Exception):  # most functions do not take most of these
            function(*given)
        assert found.changes or given == arguments  # what changes nothing leaves its arguments alone
        for place in found.indexed.intersection(range(len(given))):
            if not any(isinstance(item, list) for item in ([] if isinstance(given[place], int) else given[place])):
                assert given[place] == arguments[place]


OUTSIDE = "import datetime, os, time, uuid"
LOOK_OUTSIDE = ["input", "open", "id", "hash", "eval", "getattr", "time.time", "os.getcwd", "uuid.uuid4",
                "datetime.datetime.now"]  # fmt: skip
VOLATILE = {f"calls {name}": f"{OUTSIDE}\ndef f(x): return {name}(x)\n=> calls {name}" for name in LOOK_OUTSIDE}
VOLATILE["a very deep chain of helpers"] = (
    "def f0(x): return x\n" + "".join(f"def f{n + 1}(x): return f{n}(x)\n" for n in range(60)) +
    "f = f60\n=> more functions than are followed"
)  # fmt: skip
VOLATILE |= samples("volatile")


@pytest.mark.parametrize("text", VOLATILE.values(), ids=VOLATILE.keys())
def test_volatile(load: Load, text: str) -> None:
    source, _, words = text.partition("=>")
    purity = infer_purity(load(source).f)
    assert purity.volatility == "volatile"
    for word in words.strip().split(" | "):
        assert word in purity.reason


def test_modules_of_the_users_own_are_followed_and_constants_named(load: Load) -> None:
    load("SIZE = 3\ndef double(x): return 2 * x")
    module = load("import purity_sample_0 as constants\ndef f(x): return constants.double(x) + constants.SIZE")
    assert infer_purity(module.f).volatility == "immutable"
    module = load("import math\nSIZE, DEPTH = 8, 3\n"
                  "def f(x): return g(x) * SIZE + math.pi * SIZE\ndef g(x): return x + DEPTH")  # fmt: skip
    names = "'DEPTH', 'SIZE', 'math.pi'"
    assert infer_purity(module.f).reason == f"has a source that uses only its arguments and the constants {names}"


@each_row("purity/changes", "text", "told")
def test_whether_a_function_may_change_its_arguments(load: Load, text: str, told: str) -> None:
    found = infer_purity(load(text).f)
    assert str(found.changes) == told
    assert found.volatility == "immutable" or found.changes


KNOWN = [abs, len, min, max, sorted, round, int, float, str, list, dict, set, tuple, bool, math.sqrt, math.dist,
         operator.add, operator.getitem, str.upper, list.append, dict.get]  # fmt: skip
UNKNOWN = [
    *((known, "has no Python source") for known in (print, time.time, random.random, id, [].append, "text".upper)),
    (eval("lambda x: x"), "has no Python source"),
    (random.choice, "is a method of an object"), (map, "calls its arguments|iterator"),
    (functools.reduce, "calls its arguments"), (type, "function"), (bytearray, "is a class"),
    (object(), "is an object with state"), (None, "is an object with state"),
]  # fmt: skip


@each_row("purity/indexed", "text", "told")
def test_of_which_arguments_a_function_only_reads_items(load: Load, text: str, told: str) -> None:
    function = load(text).f
    found = infer_purity(function)
    names = function.__code__.co_varnames
    assert (", ".join(sorted(names[place] for place in found.indexed)) or "none") == told


@pytest.mark.parametrize("function", KNOWN)
def test_functions_without_source_that_are_known(function: Callable[..., object]) -> None:
    assert infer_purity(function) == Purity("immutable", "is known to be pure")


@pytest.mark.parametrize(("function", "words"), UNKNOWN, ids=range(len(UNKNOWN)))
def test_functions_without_source_that_are_not(function: Any, words: str) -> None:
    purity = infer_purity(function)
    assert purity.volatility == "volatile"
    assert any(word in purity.reason for word in words.split("|"))


def test_cells_of_a_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their lines are known, but none of them is the whole of a module."""
    monkeypatch.setattr(linecache, "cache", dict(linecache.cache))
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, text in enumerate((
        "import math\nSIZE = 3\ndef helper(x): return math.sqrt(x)\n",
        "def f(x): return helper(x)\ndef g(x): return x + SIZE\n",
    )):  # fmt: skip
        name = f"<cell {number}>"
        linecache.cache[name] = (len(text), None, text.splitlines(True), name)
        exec(compile(text, name, "exec"), namespace)
    assert infer_purity(namespace["f"]).volatility == "immutable"
    # Another cell may assign it again, and nothing would show it.
    assert "'SIZE', which may change" in infer_purity(namespace["g"]).reason


def test_a_file_that_changed_since_is_not_taken_for_the_source(load: Load) -> None:
    module = load("def noisy(x):\n    print(x)\n    return x\ndef still(x): return x\n")
    path = Path(str(module.__file__))
    path.write_text(path.read_text(encoding="utf-8").replace("print(x)", "abs(x)  # quiet"), encoding="utf-8")
    assert infer_purity(module.noisy) == Purity("volatile", "is not in its source file as it runs")
    assert infer_purity(module.still).volatility == "immutable"
    path.unlink()
    assert infer_purity(module.still) == Purity("volatile", "has no Python source")


CLOSURE = "def g(n):\n    def f(x): return x + n\n    return f\nf = g(1)\n"
ANOTHER_PROGRAM = [
    ("# above\ndef f(x): return x\n", "def g(n):\n    def f(x):\n        nonlocal n\n        n = x\n",
     "is not in its source file as it runs"),
    ("# above\ndef f(x): return x\n", "def g(n):\n    def f(x:\n", "has no Python source"),
    (CLOSURE, CLOSURE.replace("g(n)", "g(other)"), "reads the variable 'n' of an enclosing function, which may change"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "now", "reason"), ANOTHER_PROGRAM)
def test_a_file_that_is_another_program_now(load: Load, text: str, now: str, reason: str) -> None:
    module = load(text)
    Path(str(module.__file__)).write_text(now, encoding="utf-8")
    assert (infer_purity(module.f).volatility, infer_purity(module.f).reason) == ("volatile", reason)


def test_every_lambda_of_a_line_is_told_from_the_others(load: Load) -> None:
    module = load("fs = [lambda x: x + 1, lambda x: x.name, lambda x: print(x), (lambda x: lambda: x), lambda x: x]")
    found = [infer_purity(f).volatility for f in module.fs]
    assert found == ["immutable", "volatile", "volatile", "volatile", "immutable"]
    assert infer_purity(module.fs[3](1)).volatility == "immutable"
    assert infer_purity(module.fs[3]([])).volatility == "volatile"


logged: list[object] = []


def logged_length(value: list[object]) -> int:
    logged.append(value)
    return value.__len__()


def test_what_was_replaced_before_it_was_looked_at_is_not_known() -> None:
    module = ModuleType("other")
    vars(module)["length"] = logged_length
    function_names._declare_pure(module, "length")
    assert function_names.find_known_pure(logged_length) is None


def test_what_is_replaced_is_noticed(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    module = load("import math\ndef f(x): return len(x)\ndef g(x): return math.sqrt(x)")
    assert infer_purity(module.f).volatility == infer_purity(module.g).volatility == "immutable"
    with monkeypatch.context() as patch:
        patch.setattr(math, "sqrt", logged_length)
        assert "math.sqrt" in infer_purity(module.g).reason
        patch.setattr(builtins, "len", logged_length)
        purity = infer_purity(module.f)
    assert "calls len, which reads the global name 'logged'" in purity.reason
    module = load("import time\ndef helper(x): return x\n"
                  "def other(x): return time.time()\ndef f(x): return helper(x)")  # fmt: skip
    assert infer_purity(module.f).volatility == "immutable"
    module.helper = module.other
    assert "calls helper, which calls time.time" in infer_purity(module.f).reason
    module.helper = time.time
    assert "calls helper" in infer_purity(module.f).reason
    del module.helper
    assert infer_purity(module.f).volatility == "volatile"


def test_proofs_of_large_sources_end(load: Load) -> None:
    module = load(f"def deep(x): return {' + '.join(['x'] * 800)}\n")
    assert infer_purity(module.deep).reason == "is nested too deeply to be followed"
