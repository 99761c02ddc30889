"""Python functions of one expression, and some that are not."""

from __future__ import annotations

import math

WALL = 4
NAME = "abc"
EDGES = (0, 9)
STEP = 1
STEP = 2  # bound twice


def constant():
    return 7


def same(x):
    return x


def inc(n):
    """One more."""
    return n + 1


def cost(a, b=3):
    return abs(a - b)


def mean(a, b):
    return (a + b) / 2


def square(x):
    return x**2


def root(x, y):
    return math.sqrt(x * x % 7 + abs(y)) ** 0.5


def length(x, y):
    return ((x - 1) ** 2 + (y - 1) ** 2) ** 0.5


def sign(x):
    if x > 0:
        return 1
    if x < 0:
        return -1
    return 0


def classify(x):
    if x < WALL:
        if x < 0:
            return "low"
    else:
        return "high"
    return None if x == 0 else "middle"


def between(x, low, high):
    return low <= x < high


def default(x, y=None):
    return x if y is None else x + y


def either(x, y):
    return x or y


def neither(x, y):
    return not (x and y)


def decides(x, y):
    return "both" if x and y else "one" if x or y else x


def member(x):
    return x in (1, 2, 5) or x in EDGES


def pair(x, y):
    return (x, [y, -x])


def taxi(p, q):
    return abs(p[0] - q[0]) + abs(p[-1] - q[-1])


def go(position, step):
    return [position[0] + step[0], position[1] + step[1]]


def greatest(x, y):
    return max(x, y, 2) - min(x, y)


def text(x, y):
    return str(x) + "/" + str(y)


def whole(x, y):
    return int(x / 3) + round(y / 3, 1) + round(y / 7)


def through(x, y):
    return square(x - y) + cost(b=x, a=y)


def named(x, *, scale=2.5):
    return x * scale % 4


def swapped(x, y):
    return pair(y, x)


def apart(p, q):
    return math.dist(p, q) < 3


def head(s):
    return s[:1] + s[1:3]


def perhaps(x):  # noqa: RET503
    if x:
        return "yes"


def letter(x):
    return x in NAME


def truth(x):
    return bool(x)


def switched(x, on=True, off=False, nothing=0):
    if not off and (on and not nothing):
        return (on and x, off and x, x and on, off or x, nothing or x, [on, nothing])
    return "never"


def decided(x, on=True, off=False):
    return "all" if on and x > 0 else "some" if off and x < 0 else "none" if x == 0 or off else "other"


# --- not one expression of the language -------------------------------------------------------------------


def several(x):
    x += 1
    return x


def late_name(x):
    return y[0] + (y := [x])[0]  # noqa: F821, F841


def every_other(x):
    return x[::2]


def spreads(x):
    return cost(*x)


def gives_twice(x):
    return cost(x, a=x)


def gives_too_few(x):
    return cost(b=x)


def gives_what_is_not_taken(x):
    return cost(x, c=x)


def floored(x):
    return x // 2


def sine(x):
    return math.sin(x)


def method(x):
    return x.upper()


def attribute(x):
    return x.real


def rebound(x):
    return x + STEP


def starred(*values):
    return values


def formatted(x):
    return f"{x}"


def record(x):
    return {"x": x}


def recursive(x):
    return 0 if x < 1 else recursive(x - 1)


def compares_tuples(x, y):
    return (x, y) == (y, x)


def counts_a_tuple(x, y):
    return len(pair(x, y))


def identical(x, y):
    return x is y


def keyed(x, y):
    return max(x, y, key=abs)


def large(x):
    return x + 9223372036854775808


def loops(x):
    return [y + 1 for y in x]


def raises(x):
    if x > 1:
        raise ValueError(x)
    return x


def tuple_default(x, y=(1, 2)):
    return y
