"""The bindings of a Python function's names, settled values of outer ones, and Python's own functions that are pure.

A function is listed when it gives the same value for the same plain arguments and changes nothing but them. Its use of
sets and iterators is described too: the order of a set depends on the hash seed, and an iterator is used up.

`FunctionNames` answers three questions for one function, without judging: which object a name or dotted name is
(`find_object`), which functions a call may reach (`find_targets`), and of what kind the value of an expression is
(`infer_kind`).
"""

from __future__ import annotations

import ast
import bisect
import builtins
import collections
import copy
import enum
import functools
import gc
import heapq
import importlib
import itertools
import math
import operator
import sys
from collections.abc import Callable, Iterator
from dataclasses import field
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, TypeAlias, cast

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.volatility.function_source import (
    Binding,
    FunctionNode,
    Located,
    Names,
    Owner,
    find_bindings,
    read_module,
)


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


def find_known_pure(value: object) -> KnownFunction | None:
    """The entry of a function object, or None. Costly modules are read once they are loaded."""
    found = _KNOWN.get(id(value))
    if found is None and _LATE and isinstance(value, FunctionType):
        for name in [name for name in _LATE if name in sys.modules]:
            functions, keywords = _LATE.pop(name)
            _declare_pure(sys.modules[name], functions, keywords=keywords)
        found = _KNOWN.get(id(value))
    return found


def _declare_pure(module: ModuleType, names: str, **facts: Any) -> None:
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

_declare_pure(builtins, "abs ascii bin chr divmod float format hex int oct ord range repr round str")
_declare_pure(builtins, "pow", keywords=("mod", "exp", "base"))
_declare_pure(builtins, "bool len", reads=FIRST, unordered=True, most=1)
_declare_pure(builtins, "any all", reads=FIRST, unordered=True, generated=True, most=1)
_declare_pure(builtins, "set frozenset", reads=FIRST, unordered=True, generated=True, gives=_SET, most=1)
_declare_pure(builtins, "sorted", reads=FIRST, unordered=True, generated=True, keywords=("key", "reverse"), most=1)
_declare_pure(builtins, "min max", reads=FIRST, alone=True, unordered=True, generated=True, keywords=("key", "default"))
# The sum of floats depends on their order: a set of numbers has the same order under every hash seed, but numbers
# computed from a set of strings do not.
_declare_pure(builtins, "sum", reads=FIRST, unordered=True, keywords=("start",))
_declare_pure(builtins, "list tuple next", reads=FIRST)
_declare_pure(builtins, "dict", reads=FIRST, keywords=("*",), most=1)
_declare_pure(builtins, "dict.fromkeys", reads=FIRST)
_declare_pure(builtins, "enumerate", reads=FIRST, keywords=("start",), gives=_OBJECT)
_declare_pure(builtins, "reversed iter", reads=FIRST, gives=_OBJECT, most=1)
_declare_pure(builtins, "zip", reads=ALL, keywords=("strict",), gives=_OBJECT)
_declare_pure(builtins, "map filter", reads=REST, function=0, gives=_OBJECT)
_declare_pure(builtins, "isinstance", reads=FIRST, unordered=True, most=2)
_declare_pure(builtins, "type", gives=_CODE, most=1)
_declare_pure(
    math, " ".join(name for name in vars(math) if callable(vars(math)[name])), keywords=("rel_tol", "abs_tol")
)
_declare_pure(math, "prod fsum", reads=FIRST, keywords=("start",))
_declare_pure(
    operator,
    "abs add and_ concat contains countOf eq floordiv ge getitem gt index indexOf inv invert le lshift lt matmul mod "
    "mul ne neg not_ or_ pos pow rshift sub truediv truth xor",
)
_declare_pure(operator, "delitem setitem", changes=True)
_declare_pure(operator, "itemgetter", gives=_CODE)
_declare_pure(functools, "reduce", reads=SECOND, function=0)
_declare_pure(functools, "cmp_to_key", function=0, gives=_CODE)
_declare_pure(itertools, "chain zip_longest", reads=ALL, keywords=("fillvalue",), gives=_OBJECT)
_declare_pure(itertools, "product", reads=ALL, keywords=("repeat",), gives=_OBJECT)
_declare_pure(itertools, "chain.from_iterable compress pairwise", reads=FIRST, gives=_OBJECT)
_declare_pure(
    itertools, "combinations combinations_with_replacement permutations", reads=FIRST, keywords=("r",), gives=_OBJECT
)
_declare_pure(itertools, "cycle islice", reads=FIRST, gives=_OBJECT)
_declare_pure(itertools, "count repeat", gives=_OBJECT)
_declare_pure(itertools, "accumulate", reads=FIRST, function=1, keywords=("initial",), gives=_OBJECT)
_declare_pure(itertools, "dropwhile filterfalse starmap takewhile", reads=REST, function=0, gives=_OBJECT)
_declare_pure(heapq, "heapify heappop heappush heappushpop heapreplace", changes=True)
_declare_pure(heapq, "nlargest nsmallest", reads=SECOND, keywords=("key",), most=2)
_declare_pure(bisect, "bisect bisect_left bisect_right", keywords=("key", "lo", "hi"))
_declare_pure(bisect, "insort insort_left insort_right", keywords=("key", "lo", "hi"), changes=True)
_declare_pure(collections, "deque", reads=FIRST, keywords=("maxlen",), gives=_OBJECT)
_declare_pure(collections, "defaultdict", reads=REST, function=0, keywords=("*",))
_declare_pure(collections, "Counter OrderedDict", reads=FIRST)
_declare_pure(copy, "copy deepcopy", most=1)

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


def _add_pure_methods() -> None:
    """The same methods as functions of their class: `str.lower`."""
    for owner in (str, int, float, list, tuple, dict, set, frozenset):
        for name, target in vars(owner).items():
            method = METHODS.get(name)
            if method is not None and name != "format" and not (owner is set and name == "pop"):
                facts: dict[str, Any] = {"gives": method.gives, "changes": method.changes, "most": method.most + 1}
                _KNOWN[id(target)] = KnownFunction(target, f"{owner.__name__}.{name}", **facts)


_add_pure_methods()


def _split_pure_names(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Modules that a function may import, modules whose functions are never pure, and built-in functions with effects.
PURE_MODULES = _split_pure_names(
    "bisect collections copy functools heapq itertools json math operator statistics string"
)
IMPURE_MODULES = _split_pure_names(
    "asyncio datetime io locale multiprocessing os pathlib posix random secrets shutil socket subprocess sys threading "
    "time urllib uuid"
)
EFFECTS = _split_pure_names("breakpoint delattr eval exec exit globals input locals open print quit setattr vars")
# Attributes of these classes are looked up, so that `str.lower` and `chain.from_iterable` are found.
CLASSES = (str, int, float, bool, list, tuple, dict, set, frozenset, itertools.chain)


# --- the bindings of a Python function's names: locals by scope, and the settled values of outer names
VALUE, SET, OBJECT, CODE = ResultKind.VALUE, ResultKind.SET, ResultKind.OBJECT, ResultKind.CODE
NOTHING = ResultKind(0)
UNKNOWN: Any = object()
CACHE_TYPE = type(functools.cache(lambda: None))
SET_OPERATORS = (ast.BitOr, ast.BitAnd, ast.BitXor, ast.Sub)
_MOST_STEPS = 50_000
_CODE_TYPES = (FunctionType, BuiltinFunctionType, MethodType, ModuleType, functools.partial, CACHE_TYPE)


class Unproven(Exception):  # noqa: N818 - it is a finding, not an error
    """A function is not proven immutable: `reason` says what it does, `line` where in its file."""

    def __init__(self, reason: str, line: int | None = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.line = line


@dataclass(slots=True)
class Findings:
    """The findings of one proof: the constants that are read, in order, and facts about all functions together."""

    constants: dict[str, None] = field(default_factory=dict)
    changes: bool = False  # values are changed in place
    cached: str | None = None  # a function with a cache is called
    steps: int = 0  # the work so far


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """The local names of a function, lambda or comprehension, inside those of `parent`."""

    owner: Owner
    names: Names
    parent: Scope | None

    def find_bindings(self, name: str) -> tuple[list[Binding], Scope] | None:
        scope: Scope | None = self
        while scope is not None:
            if name in scope.names:
                return scope.names[name], scope
            scope = scope.parent
        return None


@dataclass(frozen=True, slots=True)
class LocalFunction:
    """A function that is defined inside the one under proof, with the scope that it stands in."""

    node: FunctionNode
    scope: Scope


Target: TypeAlias = LocalFunction | Any  # Any: a Python object
Active: TypeAlias = frozenset[tuple[int, str]]


def is_constant_binding(value: object) -> bool:
    """Whether a value can never change: a number, string, bool, None, or a tuple of such."""
    if type(value) is tuple:
        return all(is_constant_binding(part) for part in value)
    return value is None or type(value) in (bool, int, float, str)


def is_exception_class(value: object) -> bool:
    """Whether it is an exception whose creation runs no Python code."""
    if type(value) is not type or not issubclass(value, BaseException):
        return False
    makers = (vars(base).get(name) for base in value.__mro__ for name in ("__init__", "__new__"))
    return not any(isinstance(maker, FunctionType | staticmethod) for maker in makers)


def is_code_binding(value: object) -> bool:
    """Whether it is a function, class or module, not data."""
    return type(value) in _CODE_TYPES or issubclass(type(value), type) or find_known_pure(value) is not None


@dataclass(slots=True, eq=False)
class FunctionNames:
    """The names of one Python function. `Proof.find_names` gives those of another one, where calls are followed."""

    function: FunctionType
    located: Located
    frame_of: Callable[[FunctionType], FunctionNames] | None
    findings: Findings
    root: Scope = field(init=False)
    _scopes: dict[ast.AST, Scope] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.root = self.open_scope(self.located.node, None)

    def open_scope(self, owner: Owner, parent: Scope | None) -> Scope:
        """The scope that a function, lambda or comprehension opens."""
        if owner not in self._scopes:
            self._scopes[owner] = Scope(owner, find_bindings(owner), parent)
        return self._scopes[owner]

    def find_outside(self, name: str) -> Any:
        """The value of a name that is not local.

        Raises `Unproven` when it has no value, or one that may be replaced or changed later.
        """
        code = self.function.__code__
        if name in code.co_freevars:
            what = f"the variable '{name}' of an enclosing function"
            try:
                value = (self.function.__closure__ or ())[code.co_freevars.index(name)].cell_contents
            except ValueError:
                raise Unproven(f"reads {what}, which has no value yet") from None
            if not self.located.is_closure_bound_once(name):
                raise Unproven(f"reads {what}, which may change")
            return self._check_lasting(value, name, what)
        module = self.located.module if self.located.whole else None
        if name not in self.function.__globals__:
            builtins: dict[str, Any] = cast(Any, self.function).__builtins__
            if name in builtins and not (module and (name in module.names or name in module.rebound)):
                return builtins[name]
            raise Unproven(f"reads the name '{name}', which has no value yet")
        what = f"the global name '{name}'"
        value = self.function.__globals__[name]
        if module is None:
            if is_constant_binding(value):
                raise Unproven(f"reads {what}, which may change")
        elif not module.is_bound_once(name) and (
            is_constant_binding(value) or name in module.names or name in module.rebound
        ):
            raise Unproven(f"reads {what}, which may change")
        return self._check_lasting(value, name, what)

    def _check_lasting(self, value: Any, name: str, what: str) -> Any:
        if is_constant_binding(value):
            self.findings.constants[name] = None
        elif not is_code_binding(value):
            raise Unproven(f"reads {what}, " + ("an object with state" if callable(value) else "which may change"))
        return value

    def _find_member(self, module: ModuleType, name: str) -> Any:
        """A module's value of a name; see `find_outside`."""
        namespace = vars(module)
        what = f"'{module.__name__}.{name}'"
        if name not in namespace:
            raise Unproven(f"reads {what}, which does not exist")
        value = namespace[name]
        if find_known_pure(value) or (module.__name__ in IMPURE_MODULES and is_code_binding(value)):
            return value
        file = namespace.get("__file__")
        fixed = module.__name__ == "math" or what == "'sys.maxsize'"
        if (is_constant_binding(value) and not fixed) or type(value) is FunctionType:
            source = read_module(file, namespace) if isinstance(file, str) and file.endswith(".py") else None
            if source is None or not source.is_bound_once(name):
                raise Unproven(f"reads {what}, which may change")
        return self._check_lasting(value, f"{module.__name__}.{name}", what)

    def find_object(self, node: ast.expr, scope: Scope, active: Active = frozenset()) -> Any:
        """The one object that a name or dotted name stands for, or `UNKNOWN` for a local value and its attributes."""
        match node:
            case ast.Name(id=name):
                found = scope.find_bindings(name)
                if found is None:
                    return self.find_outside(name)
                (places, inner), key = found, (id(found[1]), name)
                if len(places) == 1 and key not in active:
                    match places[0]:
                        case Binding("import", ast.Import() | ast.ImportFrom() as statement):
                            return resolve_import(statement, name)
                        case Binding("value", ast.Name() | ast.Attribute() as value):
                            return self.find_object(value, inner, active | {key})
            case ast.Attribute(value=value, attr=name):
                base = self.find_object(value, scope, active)
                if type(base) is ModuleType:
                    return self._find_member(base, name)
                if any(base is owner for owner in CLASSES):
                    return vars(base).get(name, UNKNOWN)
        return UNKNOWN

    def find_targets(self, node: ast.expr, scope: Scope, active: Active = frozenset()) -> Iterator[Target]:
        """Every function that a call of `node` may reach. Raises `Unproven` where that is unknown."""
        match node:
            case ast.Lambda():
                yield LocalFunction(node, scope)
            case ast.IfExp(body=body, orelse=orelse):
                yield from self.find_targets(body, scope, active)
                yield from self.find_targets(orelse, scope, active)
            case ast.Name(id=name) if (found := scope.find_bindings(name)) is not None:
                places, inner = found
                if (id(inner), name) in active:
                    raise Unproven(f"calls '{name}', which is not known")
                for place in places:
                    match place:
                        case Binding("function", ast.FunctionDef() as definition):
                            yield LocalFunction(definition, inner)
                        case Binding("value", ast.expr() as value):
                            yield from self.find_targets(value, inner, active | {(id(inner), name)})
                        case Binding("import", ast.Import() | ast.ImportFrom() as statement):
                            yield resolve_import(statement, name)
                        case Binding("parameter"):
                            raise Unproven(f"calls its argument '{name}'")
                        case _:
                            raise Unproven(f"calls '{name}', which is not known")
            case _:
                value = self.find_object(node, scope)
                if value is UNKNOWN:
                    raise Unproven(f"calls '{ast.unparse(node)[:40]}', which is not known")
                yield value

    def infer_kind(self, node: ast.expr, scope: Scope, active: Active = frozenset()) -> ResultKind:
        """The kinds of an expression's value. A name has the kinds of all its values in the function."""
        self.findings.steps += 1
        if self.findings.steps > _MOST_STEPS:
            raise Unproven("is too long to be followed")
        match node:
            case ast.Name(id=name):
                found = scope.find_bindings(name)
                if found is None:
                    return VALUE if is_constant_binding(self.find_outside(name)) else CODE
                places, inner = found
                if (id(inner), name) in active:
                    return NOTHING
                active |= {(id(inner), name)}
                return functools.reduce(
                    ResultKind.__or__, (self._infer_bound_kind(name, place, inner, active) for place in places)
                )
            case ast.Attribute():
                value = self.find_object(node, scope)
                return VALUE if value is UNKNOWN or is_constant_binding(value) else CODE
            case ast.Call():
                return self._call_kind(node, scope, active)
            case ast.Set() | ast.SetComp():
                return SET
            case ast.GeneratorExp():
                return OBJECT
            case ast.Lambda():
                return CODE
            case ast.NamedExpr(value=value):
                return self.infer_kind(value, scope, active)
            case ast.IfExp(body=body, orelse=orelse):
                return self.infer_kind(body, scope, active) | self.infer_kind(orelse, scope, active)
            case ast.BoolOp(values=values):
                return functools.reduce(ResultKind.__or__, (self.infer_kind(value, scope, active) for value in values))
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, SET_OPERATORS):
                return _prove_set_kind(self.infer_kind(left, scope, active) | self.infer_kind(right, scope, active))
            case _:
                return VALUE

    def _infer_bound_kind(self, name: str, place: Binding, scope: Scope, active: Active) -> ResultKind:
        match place:
            case Binding("value", ast.expr() as value):
                return self.infer_kind(value, scope, active)
            case Binding("update", ast.AugAssign(op=op, value=value)) if isinstance(op, SET_OPERATORS):
                return _prove_set_kind(self.infer_kind(value, scope, active))
            case Binding("import", ast.Import() | ast.ImportFrom() as statement):
                return VALUE if is_constant_binding(resolve_import(statement, name)) else CODE
            case Binding("function"):
                return CODE
            case Binding("error"):
                return OBJECT
            case _:
                return VALUE

    def _call_kind(self, node: ast.Call, scope: Scope, active: Active) -> ResultKind:
        if isinstance(node.func, ast.Attribute) and self.find_object(node.func, scope) is UNKNOWN:
            if node.func.attr == "copy":
                return self.infer_kind(node.func.value, scope, active)
            method = METHODS.get(node.func.attr)
            return method.gives if method else VALUE
        result = NOTHING
        for target in self.find_targets(node.func, scope):
            result |= self.infer_result_kind(target, active)
        return result

    def infer_result_kind(self, target: Target, active: Active = frozenset()) -> ResultKind:
        """The kinds of the value of a call of one of the `targets`."""
        if isinstance(target, LocalFunction):
            key = (id(target.node), "")
            inner = self.open_scope(target.node, target.scope)
            if key in active:
                return NOTHING
            kinds = (self.infer_kind(value, inner, active | {key}) for value in find_returned_expressions(target.node))
            return functools.reduce(ResultKind.__or__, kinds, NOTHING)
        if (entry := find_known_pure(target)) is not None:
            return entry.gives
        if type(target) is CACHE_TYPE or type(target) is functools.partial:
            return self.infer_result_kind(unwrap_callable(target), active)
        if type(target) is FunctionType:
            assert self.frame_of is not None
            frame = self.frame_of(target)
            return frame.infer_result_kind(LocalFunction(frame.located.node, frame.root), active)
        return OBJECT if is_exception_class(target) else VALUE


def unwrap_callable(value: Any) -> Any:
    """The function inside a partial or a cache."""
    if type(value) is functools.partial:
        return value.func
    # `__wrapped__` can be set to anything: it counts only where the cache really holds it.
    claimed = getattr(value, "__wrapped__", None)
    return next((held for held in gc.get_referents(value) if held is claimed), UNKNOWN)


def find_returned_expressions(node: FunctionNode) -> Iterator[ast.expr]:
    """The expressions that a function may return; None for a missing `return`."""
    if isinstance(node, ast.Lambda):
        yield node.body
        return
    yield ast.Constant(None)
    pending: list[ast.AST] = list(node.body)
    while pending:
        part = pending.pop()
        if isinstance(part, ast.Return) and part.value is not None:
            yield part.value
        if not isinstance(part, ast.FunctionDef | ast.expr):
            pending.extend(ast.iter_child_nodes(part))


def _prove_set_kind(kind: ResultKind) -> ResultKind:
    """The kind of `a | b` and its like: of sets, or of views of dicts, a set."""
    return (kind & ~OBJECT) | SET if kind & (SET | OBJECT) else kind


def resolve_import(node: ast.Import | ast.ImportFrom, name: str) -> Any:
    """What an import inside a function binds to a name. Only modules that are known to be pure are imported."""
    sources = [node.module or "."] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
    for source in sources:
        if source not in PURE_MODULES or (isinstance(node, ast.ImportFrom) and node.level):
            raise Unproven(f"imports '{source}'")
    alias = next(alias for alias in node.names if (alias.asname or alias.name) == name)
    if isinstance(node, ast.Import):
        return sys.modules.get(alias.name) or importlib.import_module(alias.name)
    module = sys.modules.get(sources[0]) or importlib.import_module(sources[0])
    return vars(module).get(alias.name, UNKNOWN)
