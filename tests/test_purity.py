"""Python functions whose source proves them immutable."""

from __future__ import annotations

import contextlib
import copy
import re
from typing import Any

import pytest
from purity_samples import Load, load

from ss2sql.frontend.purity import infer

__all__ = ["load"]  # the fixture

BLOCKS = '''\
# a docstring and annotations
def f(a: "Any of them", b: list[int] = None) -> dict:
    """What it says."""
    x: int = 3
    y: int
    z: tuple[int, str] = (a, "a")
    def g(y: dict[str, list[int]]) -> tuple[int, ...]: return y
    return {"a": a, x: b, 3: g({}), 4: z}
# loops
def f(n):
    total, k = 0, n
    for i in range(n):
        if i % 2: continue
        total += i
    else:
        total -= 1
    while k > 0:
        k //= 2
        if k == 3: break
    return total
# exceptions, also of the module's own
class NoMove(ValueError):
    """There is no such move."""
def f(a):
    try:
        if a: raise NoMove
        return a[0]
    except (IndexError, TypeError) as error: raise ValueError("empty") from error
    except KeyError: raise
    except NoMove: raise NoMove(f"none of {a!r:>9}")
    else: return 1
    finally: assert a is not None, "nothing"
# comprehensions
def f(rows, k):
    pairs = [(x, y) for x in rows for y in rows[x] if y != k]
    table = {x: [y for _, y in pairs] for x, _ in pairs}
    return sorted({z for x in table for z in table[x]}), sum(x for x, _ in pairs), any(x > 3 for x in rows)
# inner functions
def f(n):
    def inner(k: int, step: int | None = 1) -> list[int]:
        return [] if k <= 0 else [k, *inner(k - step)]
    double = lambda x: 2 * x
    other = double
    return [other(x) for x in inner(n)] + (lambda y: [y])(n)
# match
def f(value):
    match value:
        case None | True: return 0
        case int(n) | [n, *_] if n > 2: return n
        case {"size": size, **rest}: return [size, len(rest)]
        case str() as text: return text.upper()
        case _: return -1
# starred
def f(*args, **more):
    first, *rest = args
    return [*rest, first, max(*args), *more.items()], {**more, "n": len(more)}
# changes to its arguments
def f(rows, names):
    rows[0][1:2] = [1, 2]
    rows[-1] += [3]
    del rows[2], names["x"]
    names.setdefault("y", []).extend(x for x in rows)
    rows.sort(key=len)
    return rows
# a deque
from collections import deque
def f(graph, start):
    queue, seen = deque([(start, 0)]), {start}
    while queue:
        node, depth = queue.popleft()
        for after in graph.get(node, []):
            if after not in seen:
                seen.add(after)
                queue.append((after, depth + 1))
    return depth
# sets whose order does not matter, and views of dicts
def f(a, b):
    left, right = set(a), {x for x in b}
    both = left & right | set()
    both |= {1, 2}
    both.update(left, right)
    both.discard(3)
    c = dict(a.items())
    c |= b.items()
    views = list(a.items()), sorted(a.keys() & b.keys()), sum(a.values()), 3 in b.values()
    if views and len(both) > 2 and 3 in both and left <= right and not left.isdisjoint(right):
        return sorted(both) + [max(both), sum(left), any(x > 2 for x in right), all(right), min(left - right)]
    return left.union(right, a)
# format strings
FORM = "{0[2]:>{1}} {name!r:.2f}"
def f(a, b):
    text = FORM
    return FORM.format(a, 5, name=b) + "{} and {}".format(*a) + text.format(b, 1, name=a)
# functions that give a set
def others(word): return set(word)
def f(a):
    def letters(word): return {*word}
    return sorted(letters(a) | letters("abc")), len(others(a))
# iterators that are used up
import itertools
def f(a, b):
    pairs = zip(a, reversed(b))
    numbers = enumerate(itertools.chain(a, b), start=1)
    x, y = map(str, a)
    return [n for n, _ in numbers] + [next(pairs, None)] + list(map(abs, filter(None, a))) + [x, y]
# functions of functions
import functools, operator
def f(a, b):
    return (functools.reduce(operator.add, a, 0), sorted(a, key=operator.itemgetter(1)), min(b, key=b.get),
            list(map(str.lower, a)), max(a, key=len, default=None),
            sorted(a, key=functools.cmp_to_key(lambda x, y: x - y)))
# the standard library
import copy, heapq, json, math, statistics, collections
from bisect import bisect_left
from itertools import combinations as choose
def f(a, b):
    count = collections.Counter(a)
    groups = collections.defaultdict(list)
    for x in a: groups[x].append(copy.deepcopy(b))
    heap = []
    for x in a: heapq.heappush(heap, (x, str(x)))
    b = b + [heapq.heappop(heap) for _ in range(len(heap))]
    return (math.sqrt(statistics.mean(a)) + math.pi, json.loads(json.dumps(a, sort_keys=True)),
            bisect_left(a, 3), [list(x) for x in choose(b, 2)], math.hypot(*a), count.most_common(1), groups)
# imports repeated, and inside
import math
import math
import collections
import collections.abc
from math import sqrt
from math import sqrt
def f(a):
    import math
    import operator as op
    from string import digits
    from math import dist, pi as half
    return math.floor(op.add(a, half)), dist(a, a), digits, collections.Counter(a), sqrt(a)
# constants and kinds of values
SIZE = 8
WALLS: tuple = ((1, 2), "x", None, -1.5)
def f(a):
    if isinstance(a, (int, float)) or isinstance(a, str): return int(a) < SIZE
    if type(a) is list or type(a) == dict: return len(a)
    return a is None or True is a or [a, SIZE] not in WALLS
# helpers that call each other and themselves
def f(n): return even(n) + (1 if n < 2 else n * f(n - 1))
def even(n): return n == 0 or odd(n - 1)
def odd(n): return n != 0 and even(n - 1)
# a cache
import functools
@functools.lru_cache(maxsize=None)
def f(n): return n if n < 2 else f(n - 1) + f(n - 2)
# partials, and a decorator that can be followed
import functools
def twice(inner):
    @functools.wraps(inner)
    def outer(*args): return inner(inner(*args))
    return outer
@twice
def more(x): return x + 1
def power(x, y): return x ** y
cube = functools.partial(power, y=3)
def g(x, y): return [x, cube(more(y))]
f = functools.partial(g, 1)
# a closure over constants
def make(size, text="x"):
    scale = 2.5
    def inner(x, *, more=2):
        return [y * size * scale for y in x], text, more
    return inner
f = make(3)
# a recursive closure, and a closure around a closure
def outer(n):
    def fact(k): return n if k < 2 else k * fact(k - 1)
    def middle(m):
        def f(x): return fact(x) + n + m
        return f
    return middle
f = outer(1)(2)
# a plain function of a class
class Moves:
    def up(place): return [place[0], place[1] + 1]
    @staticmethod
    def down(place): return [place[0], place[1] - 1]
f = Moves.down
# a name for a name
import math
m = math
def f(x):
    root = m.sqrt
    again = root
    return sorted(x, key=again), again(x)
'''
IMMUTABLE = {
    "future annotations": "from __future__ import annotations\ndef f(x: Unknown) -> Unknown: return x",
    "a lambda over several lines": "f = (lambda x, y=2:\n     x\n     + y)",
    "other defaults": "def f(x, y=[]): return x\nf.__defaults__ = ((1, 'two'),)",
    "arithmetic": "def f(a, b): return (a ** 2 + -b) / (a % 7 or 1) < a // 2",
    "no arguments, no body": "def f(): pass",
    "a lambda as a key": "def f(rows): return sorted(rows, key=lambda row: (row[1], -row[0]), reverse=True)",
    "a comprehension's name does not leak": "def f(rows): return [[print for print in row] for row in rows]",
    "walrus": "def f(a): return (n := len(a)) + n if (last := a[-1:]) else last",
    "walrus in a comprehension": "def f(a): return [m for x in a if (m := x + 1) > 2] and m",
    "f-strings and slices": 'def f(a, b): return f"{a!r}: {b[1:-1:2]} {len(b):>{a}}" + "%s" % b[:]',
    "text": 'def f(a): return ", ".join(w.strip().title() for w in a.split(";")).replace("A", "b")',
    **dict(re.findall(r"^# (.*)\n((?:(?!# ).*\n)+)", BLOCKS, re.MULTILINE)),
}


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
