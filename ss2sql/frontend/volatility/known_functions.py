"""Python's own functions and methods that are pure.

A function is listed when it gives the same value for the same plain arguments and changes nothing but them. Its use of
sets and iterators is described too: the order of a set depends on the hash seed, and an iterator is used up.
"""

from __future__ import annotations

import bisect
import builtins
import collections
import copy
import enum
import functools
import heapq
import itertools
import math
import operator
import sys
from types import FunctionType, ModuleType
from typing import Any

from ss2sql.fast_dataclasses import dataclass


class ResultKind(enum.Flag):
    """The kinds of value that an expression may have, as flags."""

    VALUE = enum.auto()  # a plain value: a number, a string, a list and the like, made of plain values
    SET = enum.auto()  # a set, whose order is not fixed
    OBJECT = enum.auto()  # an iterator, a view, an exception: of use inside a function, but not a value
    CODE = enum.auto()  # a function, class or module


NONE = range(0)
FIRST = range(1)
SECOND = range(1, 2)
REST = range(1, 99)
ALL = range(99)


@dataclass(frozen=True, slots=True, eq=False)
class KnownFunction:
    """A function that is known to be pure."""

    target: Any
    name: str
    reads: range = NONE  # the positions of iterables that it reads through
    alone: bool = False  # `reads` is for calls with one argument
    unordered: bool = False  # gives the same for every order of a set
    generated: bool = False  # also where the elements are computed from a set one by one
    function: int | None = None  # the position of an argument that it calls
    keywords: tuple[str, ...] = ()  # that it accepts, `*`: any; it calls `key`, too
    gives: ResultKind = ResultKind.VALUE
    changes: bool = False  # changes an argument in place
    most: int = 99  # the number of arguments that this entry covers


@dataclass(frozen=True, slots=True)
class KnownMethod:
    """A method of Python's own value types that has no effect beyond the value it is called on."""

    fewest: int
    most: int
    keywords: tuple[str, ...] = ()
    gives: ResultKind = ResultKind.VALUE
    reads: bool = False  # it reads through iterables given as arguments
    unordered: bool = False  # and gives the same for every order of a set there
    changes: bool = False


METHODS: dict[str, KnownMethod] = {}

# By the function's identity, so that a replacement under the same name is not mistaken for it.
_KNOWN: dict[int, KnownFunction] = {}


def find_known(value: object) -> KnownFunction | None:
    """The entry of a function object, or None. Costly modules are read once they are loaded."""
    found = _KNOWN.get(id(value))
    if found is None and _LATE and isinstance(value, FunctionType):
        for name in [name for name in _LATE if name in sys.modules]:
            functions, keywords = _LATE.pop(name)
            _declare(sys.modules[name], functions, keywords=keywords)
        found = _KNOWN.get(id(value))
    return found


def _declare(module: ModuleType, names: str, **facts: Any) -> None:
    for name in names.split():
        target: Any = module
        for part in name.split("."):
            # vars() keeps a class method as it stands in its class: an object that stays the same.
            target = vars(target)[part]
        if isinstance(target, FunctionType) and target.__globals__ is not vars(module):
            continue  # somebody has replaced it
        prefix = "" if module is builtins else f"{module.__name__}."
        _KNOWN[id(target)] = KnownFunction(target, prefix + name, **facts)


def _make_methods(names: str, fewest: int, most: int, **facts: Any) -> None:
    for name in names.split():
        METHODS[name] = KnownMethod(fewest, most, **facts)


_SET, _OBJECT, _CODE = ResultKind.SET, ResultKind.OBJECT, ResultKind.CODE

_declare(builtins, "abs ascii bin chr divmod float format hex int oct ord range repr round str")
_declare(builtins, "pow", keywords=("mod", "exp", "base"))
_declare(builtins, "bool len", reads=FIRST, unordered=True, most=1)
_declare(builtins, "any all", reads=FIRST, unordered=True, generated=True, most=1)
_declare(builtins, "set frozenset", reads=FIRST, unordered=True, generated=True, gives=_SET, most=1)
_declare(builtins, "sorted", reads=FIRST, unordered=True, generated=True, keywords=("key", "reverse"), most=1)
_declare(builtins, "min max", reads=FIRST, alone=True, unordered=True, generated=True, keywords=("key", "default"))
# The sum of floats depends on their order: a set of numbers has the same order under every hash seed, but numbers
# computed from a set of strings do not.
_declare(builtins, "sum", reads=FIRST, unordered=True, keywords=("start",))
_declare(builtins, "list tuple next", reads=FIRST)
_declare(builtins, "dict", reads=FIRST, keywords=("*",), most=1)
_declare(builtins, "dict.fromkeys", reads=FIRST)
_declare(builtins, "enumerate", reads=FIRST, keywords=("start",), gives=_OBJECT)
_declare(builtins, "reversed iter", reads=FIRST, gives=_OBJECT, most=1)
_declare(builtins, "zip", reads=ALL, keywords=("strict",), gives=_OBJECT)
_declare(builtins, "map filter", reads=REST, function=0, gives=_OBJECT)
_declare(builtins, "isinstance", reads=FIRST, unordered=True, most=2)
_declare(builtins, "type", gives=_CODE, most=1)
_declare(math, " ".join(name for name in vars(math) if callable(vars(math)[name])), keywords=("rel_tol", "abs_tol"))
_declare(math, "prod fsum", reads=FIRST, keywords=("start",))
_declare(
    operator,
    "abs add and_ concat contains countOf eq floordiv ge getitem gt index indexOf inv invert le lshift lt matmul mod "
    "mul ne neg not_ or_ pos pow rshift sub truediv truth xor",
)
_declare(operator, "delitem setitem", changes=True)
_declare(operator, "itemgetter", gives=_CODE)
_declare(functools, "reduce", reads=SECOND, function=0)
_declare(functools, "cmp_to_key", function=0, gives=_CODE)
_declare(itertools, "chain zip_longest", reads=ALL, keywords=("fillvalue",), gives=_OBJECT)
_declare(itertools, "product", reads=ALL, keywords=("repeat",), gives=_OBJECT)
_declare(itertools, "chain.from_iterable compress pairwise", reads=FIRST, gives=_OBJECT)
_declare(
    itertools, "combinations combinations_with_replacement permutations", reads=FIRST, keywords=("r",), gives=_OBJECT
)
_declare(itertools, "cycle islice", reads=FIRST, gives=_OBJECT)
_declare(itertools, "count repeat", gives=_OBJECT)
_declare(itertools, "accumulate", reads=FIRST, function=1, keywords=("initial",), gives=_OBJECT)
_declare(itertools, "dropwhile filterfalse starmap takewhile", reads=REST, function=0, gives=_OBJECT)
_declare(heapq, "heapify heappop heappush heappushpop heapreplace", changes=True)
_declare(heapq, "nlargest nsmallest", reads=SECOND, keywords=("key",), most=2)
_declare(bisect, "bisect bisect_left bisect_right", keywords=("key", "lo", "hi"))
_declare(bisect, "insort insort_left insort_right", keywords=("key", "lo", "hi"), changes=True)
_declare(collections, "deque", reads=FIRST, keywords=("maxlen",), gives=_OBJECT)
_declare(collections, "defaultdict", reads=REST, function=0, keywords=("*",))
_declare(collections, "Counter OrderedDict", reads=FIRST)
_declare(copy, "copy deepcopy", most=1)

# Modules that are read once they are loaded: their functions, and the keywords that these accept.
_LATE = {
    "json": ("dumps loads", ("ensure_ascii", "indent", "separators", "sort_keys")),
    "statistics": (
        "fmean geometric_mean harmonic_mean mean median median_high median_low mode multimode pstdev pvariance "
        "quantiles stdev variance",
        ("method", "mu", "n", "weights", "xbar"),
    ),
}

_make_methods("capitalize casefold isalnum isalpha isascii isdecimal isdigit isidentifier islower isnumeric", 0, 0)
_make_methods("isprintable isspace istitle isupper lower swapcase title upper", 0, 0)
_make_methods("lstrip rstrip strip", 0, 1)
_make_methods("partition removeprefix removesuffix rpartition translate zfill", 1, 1)
_make_methods("center ljust rjust", 1, 2)
_make_methods("count endswith find index rfind rindex startswith", 1, 3)
_make_methods("replace", 2, 3)
_make_methods("split rsplit", 0, 2, keywords=("sep", "maxsplit"))
_make_methods("splitlines", 0, 1, keywords=("keepends",))
_make_methods("expandtabs", 0, 1, keywords=("tabsize",))
_make_methods("format", 0, 99, keywords=("*",))
_make_methods("join", 1, 1, reads=True)
_make_methods("as_integer_ratio bit_count bit_length is_integer", 0, 0)
_make_methods("append appendleft add discard remove", 1, 1, changes=True)
_make_methods("clear popitem popleft reverse", 0, 0, changes=True)
_make_methods("sort", 0, 0, keywords=("key", "reverse"), changes=True)
_make_methods("pop", 0, 2, changes=True)
_make_methods("insert", 2, 2, changes=True)
_make_methods("rotate", 0, 1, changes=True)
_make_methods("extend extendleft", 1, 1, reads=True, changes=True)
_make_methods("update", 1, 99, keywords=("*",), reads=True, changes=True)
_make_methods("setdefault", 1, 2, changes=True)
_make_methods("get", 1, 2)
_make_methods("copy", 0, 0)
_make_methods("most_common", 0, 1)
_make_methods("items keys values", 0, 0, gives=_OBJECT)
_make_methods("difference intersection union", 0, 99, gives=_SET, reads=True, unordered=True)
_make_methods("symmetric_difference", 1, 1, gives=_SET, reads=True, unordered=True)
_make_methods("isdisjoint issubset issuperset", 1, 1, reads=True, unordered=True)
_make_methods("difference_update intersection_update", 0, 99, reads=True, unordered=True, changes=True)
_make_methods("symmetric_difference_update", 1, 1, reads=True, unordered=True, changes=True)


def _add_methods() -> None:
    """The same methods as functions of their class: `str.lower`."""
    for owner in (str, int, float, list, tuple, dict, set, frozenset):
        for name, target in vars(owner).items():
            method = METHODS.get(name)
            if method is not None and name != "format" and not (owner is set and name == "pop"):
                facts: dict[str, Any] = {"gives": method.gives, "changes": method.changes, "most": method.most + 1}
                _KNOWN[id(target)] = KnownFunction(target, f"{owner.__name__}.{name}", **facts)


_add_methods()


def _split_words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Modules that a function may import, modules whose functions are never pure, and built-in functions with effects.
PURE_MODULES = _split_words("bisect collections copy functools heapq itertools json math operator statistics string")
IMPURE_MODULES = _split_words(
    "asyncio datetime io locale multiprocessing os pathlib posix random secrets shutil socket subprocess sys threading "
    "time urllib uuid"
)
EFFECTS = _split_words("breakpoint delattr eval exec exit globals input locals open print quit setattr vars")
# Attributes of these classes are looked up, so that `str.lower` and `chain.from_iterable` are found.
CLASSES = (str, int, float, bool, list, tuple, dict, set, frozenset, itertools.chain)
