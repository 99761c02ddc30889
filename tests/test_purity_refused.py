"""Python functions that are not proven immutable, each with the reason; many are in `cases/purity/volatile.txt`."""

from __future__ import annotations

from textwrap import indent

import pytest
from purity_samples import Load, load
from sessions import samples

from ss2sql.frontend.purity import infer

__all__ = ["load"]  # the fixture

OUTSIDE = "import datetime, os, time, uuid"
LOOK_OUTSIDE = ["input", "open", "id", "hash", "eval", "getattr", "time.time", "os.getcwd", "uuid.uuid4",
                "datetime.datetime.now"]  # fmt: skip

# What functions of x, y and g return, each with words that the reason must hold.
# fmt: off
RETURNED = [
    ("x + N", "'N'", "no value yet"), ("f.calls", "attribute 'calls'"), ("x.mass", "attribute 'mass'"),
    ("x.__class__", "attribute '__class__'"), ("x.step()", "method 'step'"), ("x.get()", "method 'get'"),
    ("x.get(1, cached=True)", "method 'get'", "cached"), ("g(x)", "calls its argument 'g'"),
    ("y[0](x)", "calls 'y[0]'"), ("[g(x) for g in y]", "calls 'g'"), ("sorted(x, key=g)", "calls its argument 'g'"),
    ("list(map(g, x))", "calls its argument 'g'"), ("list(map(*x))", "calls map"),
    ("'{0.append}'.format(x)", "attributes", "{0.append}"), ("y.format(x)", "text that is not constant"),
    ("'{0:{1.real}}'.format(x, 2)", "attributes"), ("sorted(x, key=y.format)", "method 'format'"),
    ("list(iter(g, 0))", "calls iter"), ("list(iter(*g))", "calls iter"), ("sorted(x, **y)", "calls sorted", "**"),
    ("x is y", "identities", "x is y"), ("list(set(x))", "the set 'set(x)'"), ("', '.join({*x})", "the set '{*x}'"),
    ("f'{set(x)}'", "the set 'set(x)'"), ("set(x).pop()", "element of a set"),
    ("next(iter(set(x)))", "the set 'set(x)'"), ("max(set(x), key=len)", "the set 'set(x)'"),
    ("{y: 1 for y in set(x)}", "the set 'set(x)'"), ("sum(g[w] for w in set(x))", "the set 'set(x)'"),
    ("[list(y) for y in map(set, x)]", "set as a function"),
    ("[(y := {z}) and 1 for z in x], list(y)", "the set '{z}'"), ("list(set(x).copy())", "the set 'set(x).copy()'"),
    ("(y for y in x)", "'(y for y in x)'", "iterator"), ("map(abs, x)", "'map(abs, x)'", "iterator"),
    ("[iter(x)]", "'iter(x)'"), ("x.keys()", "'x.keys()'", "view"), ("lambda: x", "'lambda: x'", "function"),
    ("type(x)", "'type(x)'", "function"), ("[len(y) for y, len in x]", "calls 'len'"),
    ("(len if x else print)(x)", "print"), ("print(x).real", "calls print"),
]
# Functions of x and xs, likewise.
BODIES = [
    ("print(x); return x", "calls print", "effects"), ("if False: print(x)\nreturn x", "calls print"),
    ("globals()['n'] = x", "calls globals"), ("f.calls = x; return x", "changes the attribute 'calls'"),
    ("del x.x", "changes the attribute 'x'"), ("for x.x in xs: pass", "changes the attribute 'x'"),
    ("b = 1000; return x is not b", "identities"), ("match x:\n    case int(real=r): return r", "matches attributes"),
    ("for i in range(x): yield i", "is a generator"), ("def g(): yield x\nreturn list(g())", "uses 'yield'"),
    ("class A: pass\nreturn x", "defines the class 'A'"),
    ("def g():\n    nonlocal x\n    x = 2\ng()\nreturn x", "'x' nonlocal"), ("import os; return x", "imports 'os'"),
    ("import math, os.path; return x", "imports 'os.path'"),
    ("from random import choice; return x", "imports 'random'"),
    ("@print\ndef g(): pass\nreturn x", "decorates the inner function 'g'"),
    ("def g(y: print('hi')): pass\nreturn x", "annotation", "print"),
    ("def g(y=print('hi')): pass\nreturn x", "calls print"), ("assert x, print(x); return x", "calls print"),
    ("try: x[0]\nexcept IndexError as error: return error", "'error'", "exception"),
    ("try: return 1\nexcept x: return 2", "catches 'x'"),
    ("for y in {'a', x}: return y", "the set '{'a', x}'", "order"),
    ("y = frozenset(x); return tuple(y)", "the set 'y'"), ("z = x.keys() - xs; return [w for w in z]", "the set 'z'"),
    ("y = x or set(x); return list(y)", "the set 'y'"), ("y = x; y |= {1}; return [*y]", "the set '{1}'"),
    ("y = {}; y |= {(z, w) for z, w in x}; return y", "the set '{(z, w) for z, w in x}'"),
    ("a, b = set(x); return a", "the set 'set(x)'"), ("x.extend(set(xs)); return x", "the set 'set(xs)'"),
    ("y = [set(x)]; return list(y[0])", "the set 'set(x)'"),
    ("y = {}; y[0] = set(x); return list(y[0])", "the set 'set(x)'"),
    ("y = []; y.append({x}); return list(y[0])", "the set '{x}'"),
    ("def g():\n    if x: return set(x)\n    return []\nreturn list(g())", "the set 'g()'"),
    ("if (y := set(x)): return list(y)", "the set 'y'"), ("y, z = set(x), 1; return list(y)", "the set 'y'"),
    ("y = zip(x, x); return y", "'y'", "iterator"), ("def g(): return x\nreturn g", "'g'", "function"),
    ("for len in xs: return len(x)", "calls 'len'"), ("p = print; return p(x)", "calls p"),
    ("g = g; return g(x)", "calls 'g'"),
]
# Modules that may give N another value.
GLOBALS = [
    "N = 1\n{f}\nN = 1", "N = 1\nN += 1\n{f}", "for N in range(3): pass\n{f}", "for _ in range(3): N = 1\n{f}",
    "N = 1\n{f}\nif not f: del N", "N = 1\ndef g(x: (N := 2)): pass\n{f}",
]
# fmt: on
# Others, likewise.
VOLATILE: dict[str, tuple[str, ...]] = {
    "a very deep chain of helpers": (
        "def f0(x): return x\n" + "".join(f"def f{i + 1}(x): return f{i}(x)\n" for i in range(60)) + "f = f60",
        "more functions than are followed",
    ),
}
for title, sample in samples("volatile").items():
    text, _, words = sample.rstrip("\n").partition("=>")
    VOLATILE[title] = (text, *words.strip().split(" | "))
VOLATILE |= {f"returns {text}": (f"def f(x, y, g): return {text}", *words) for text, *words in RETURNED}
VOLATILE |= {f"calls {name}": (f"{OUTSIDE}\ndef f(x): return {name}(x)", f"calls {name}") for name in LOOK_OUTSIDE}
VOLATILE |= {text: (text.format(f="def f(x): return x + N"), "global name 'N'", "may change") for text in GLOBALS}
VOLATILE |= {text: (f"def f(x, xs):\n{indent(text, '    ')}", *words) for text, *words in BODIES}


@pytest.mark.parametrize(("text", "words"), [(text, words) for text, *words in VOLATILE.values()], ids=VOLATILE.keys())
def test_volatile(load: Load, text: str, words: list[str]) -> None:
    purity = infer(load(text).f)
    assert purity.volatility == "volatile"
    for word in words:
        assert word in purity.reason
