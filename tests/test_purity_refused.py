"""Python functions that are not proven immutable, each with the reason."""

from __future__ import annotations

from textwrap import indent

import pytest
from purity_samples import Load, load

from ss2sql.frontend.purity import infer

__all__ = ["load"]  # the fixture

LIAR = """
import types
class Liar:
    __class__ = types.FunctionType
    def __eq__(self, other): return True
    def __hash__(self): return hash(len)
    def __call__(self, x): return x"""

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
# Others, likewise.
VOLATILE = {
    # Effects, and values that do not come from the arguments.
    "random": ("import random\ndef f(x): return random.random() + x", "random.random"),
    "random, imported": ("from random import choice\ndef f(x): return choice(x)", "calls choice", "arguments alone"),
    "the environment": ("import os\ndef f(x): return os.environ[x]", "os.environ", "may change"),
    "standard output": ("import sys\ndef f(x): sys.stdout.write(x)", "sys.stdout", "may change"),
    "a random key": ("import random\ndef f(x): return sorted(x, key=lambda _: random.random())", "random.random"),
    "a random default factory": ("import random, collections\n"
        "def f(): return collections.defaultdict(random.random)[0]", "random.random"),
    # Names outside the function.
    "a global list": ("log = []\ndef f(x): log.append(x); return x", "'log'", "may change"),
    "a global dict": ("memo = {}\ndef f(x): return memo[x]", "'memo'", "may change"),
    "a global that is counted": ("n = 0\ndef f(x):\n    global n\n    n += x\n    return n", "'n'"),
    "a global that another function counts": ("n = 0\ndef count():\n    global n\n    n += 1\ndef f(x): return x + n",
        "global name 'n'", "may change"),
    "a global bound by a class": ("N = 1\nclass A:\n    global N\n    N = 2\ndef f(x): return N", "global name 'N'"),
    "two imports under one name": ("import math as m\nimport copy as m\ndef f(x): return m.copy(x)", "global name 'm'"),
    "a global tuple with a list": ("N = (1, [2])\ndef f(x): return N[1]", "global name 'N'"),
    "a global set by the walrus twice": ("(N := 1)\nif (N := 2): pass\ndef f(x): return N", "global name 'N'"),
    "an object with state": ("class Robot:\n    def __call__(self, x): return x\nrobot = Robot()\n"
        "def f(x): return robot(x)", "'robot'", "object with state"),
    "a class of the user's": ("class Place: pass\ndef f(x): return Place()", "calls Place"),
    "a constant of a class": ("class Place:\n    SIZE = 2\ndef f(x): return Place.SIZE", "attribute 'SIZE'"),
    "an enumeration": ("import enum\nclass E(enum.Enum):\n    A = 1\ndef f(x): return E.A == x", "attribute 'A'"),
    "a helper of a helper": ("import time\ndef b(): return time.time()\ndef a(): return b()\ndef f(): return a()",
        "calls a, which calls b, which calls time.time"),
    "a method of a class": ("class A:\n    def m(self): return self.x\nf = A.m", "attribute 'x'"),
    "an unknown module": ("import purity_sample_0 as me\nN = 1\nN = 2\ndef f(x): return me.N", "may change"),
    # Arguments.
    "an attribute that is set": ("def f(body, x): body.x = x", "changes the attribute 'x'"),
    "a function's result as a key": ("def g(): return len\ndef f(x): return sorted(x, key=g())",
        "calls the result of 'g()'"),
    "what a module does not have": ("import math\ndef f(x): return math.root(x)", "'math.root'", "does not exist"),
    "an argument for reduce": ("import functools\ndef f(xs, g): return functools.reduce(g, xs)",
        "calls its argument 'g'"),
    "json with a function": ("import json\ndef f(x, g): return json.dumps(x, default=g)", "json.dumps", "'default'"),
    "matching attributes": ("class P: pass\ndef f(p):\n    match p:\n        case P(): return 1",
        "asks whether a value is a 'P'"),
    "isinstance of a user's class": ("class P: pass\ndef f(p): return isinstance(p, P)", "'P'"),
    # Default arguments.
    "a list as a default": ("def f(x, seen=[]):\n    seen.append(x)\n    return len(seen)", "default argument"),
    "a dict as a keyword default": ("def f(x, *, seen={}): return seen", "default argument"),
    "a function as a default": ("def f(x, g=len): return x", "default argument"),
    # Statements.
    "a coroutine": ("async def f(n): return n", "coroutine"),
    "with": ("import contextlib\ndef f(x):\n    with contextlib.suppress(ValueError): return x", "uses 'with'"),
    "an exception with its own __init__": ("class Loud(Exception):\n    def __init__(self): print('hi')\n"
        "def f(x): raise Loud", "calls Loud"),
    "such an exception, inherited": ("class Loud(Exception):\n    def __new__(cls): print('hi')\n"
        "class Louder(Loud): pass\ndef f(x): raise Louder()", "calls Louder"),
    # Sets, iterators and functions that get out.
    "a set to a helper": ("def g(x): return list(x)\ndef f(x): return g(set(x))", "the set 'set(x)'"),
    "a set from a helper": ("def g(x): return set(x)\ndef f(x): return list(g(x))", "the set 'g(x)'"),
    "a set from a recursive helper": ("def g(x): return set() if not x else h(x)\ndef h(x): return g(x[1:])\n"
        "def f(x): return list(h(x))", "the set 'h(x)'"),
    "an iterator to a helper": ("def g(x): return x\ndef f(x): return g(iter(x))", "'iter(x)'"),
    "a deque returned": ("import collections\ndef f(x): return collections.deque(x)", "'collections.deque(x)'"),
    "a function in a list": ("def g(): pass\ndef f(x): return [g]", "'g'", "function"),
    "a module as a value": ("import math\ndef f(x): return [math]", "'math'"),
    # Names that are not what they seem.
    "a built-in function shadowed": ("import random\ndef len(x): return random.random()\ndef f(x): return len(x)",
        "len"),
    "a built-in function shadowed later": ("def f(x): return len(x)\nif not f:\n    def len(x): return 1", "'len'"),
    "a built-in function shadowed by an argument": ("def f(x, len): return len(x)", "calls its argument 'len'"),
    "a name that a lambda binds": ("n = []\ndef f(x): return [(lambda: (n := y))() for y in x] + n", "global name 'n'"),
    "a replacing decorator": ("import functools, time\ndef timed(g):\n    @functools.wraps(g)\n"
        "    def h(x): return g(x), time.time()\n    return h\n@timed\ndef f(x): return x", "time.time"),
    "a decorator that makes an object": ("class Deco:\n    def __init__(self, g): self.g = g\n"
        "    def __call__(self, x): return self.g(x)\n@Deco\ndef f(x): return x", "is an object with state"),
    "a counting closure": ("def make():\n    n = 0\n    def g(x):\n        nonlocal n\n        n += 1\n"
        "        return n\n    return g\nf = make()", "'n' nonlocal"),
    "a closure that another function counts": ("def make():\n    n = 0\n    def count():\n        nonlocal n\n"
        "        n += 1\n    def g(x): return n + x\n    return g\nf = make()",
        "variable 'n' of an enclosing function"),
    "a closure over a loop variable": ("def make():\n    gs = []\n"
        "    for i in range(3): gs.append(lambda x: x + i)\n    return gs\nf = make()[0]",
        "variable 'i' of an enclosing function"),
    "a closure over a list": ("def make(seen):\n    def g(x): return x in seen\n    return g\nf = make([])",
        "variable 'seen' of an enclosing function"),
    "a closure over a variable that is assigned twice": ("def make(n):\n    def g(x): return x + n\n    n = 2\n"
        "    return g\nf = make(1)", "variable 'n' of an enclosing function"),
    "a closure over an impure function": ("def make(h):\n    return lambda x: h(x)\nf = make(print)", "calls h"),
    "a closure before its value": ("kept = []\ndef make():\n    def g(x): return x + n\n    kept.append(g)\n"
        "    return\n    n = 1\nmake()\nf = kept[0]", "no value yet"),
    "a cached helper whose value is changed": ("import functools\n@functools.cache\ndef g(n): return [n]\n"
        "def f(n):\n    x = g(n)\n    x.append(1)\n    return x", "calls g", "remembered"),
    "a partial of an impure function": ("import functools\ndef g(x, y): print(x)\nf = functools.partial(g, 1)",
        "is a partial of a function that calls print"),
    "a partial with a list": ("import functools\ndef g(x, y): return x\nf = functools.partial(g, [])",
        "argument that may change"),
    "a bound method": ("class A:\n    def m(self): return 1\nf = A().m", "is a method of an object"),
    "a class": ("class f: pass", "is a class"),
    # Attempts to deceive.
    "the code of another function": ("def f(x): return x\ndef noisy(x): print(x)\nf.__code__ = noisy.__code__",
        "calls print"),
    "one code with several closures": ("def make(g): return lambda x: g(x)\nquiet, loud = make(len), make(print)\n"
        "def f(x): return quiet(x), loud(x)", "calls loud, which calls g, which is not known to be pure"),
    "a cache of another function": ("import functools\ndef pure(x): return x\n@functools.cache\ndef f(x): print(x)\n"
        "f.__wrapped__ = pure",),
    "an object that says it is a function": (f"{LIAR}\nf = Liar()", "is an object with state"),
    "a call of such an object": (f"{LIAR}\nliar = Liar()\ndef f(x): return liar(x)", "'liar', an object with state"),
    "the private name of a class": ("__n = 1\n_A__n = []\nclass A:\n    def f(x): return __n\nf = A.f",),
    "a very deep chain of helpers": (
        "def f0(x): return x\n" + "".join(f"def f{i + 1}(x): return f{i}(x)\n" for i in range(60)) + "f = f60",
        "more functions than are followed"),
}
# fmt: on


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
