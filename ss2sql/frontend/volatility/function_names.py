"""What the names in a Python function stand for, and Python's own functions that are pure.

A function is listed when it gives the same value for the same plain arguments and changes nothing but them. Its use of
sets is described too, whose order depends on the hash seed.

`FunctionNames` answers questions for one function, without judging: which object a name or dotted name is
(`find_object`), and whether an expression may be a set (`is_set`) or no value at all (`describe_code`).
`locate_function` finds the source of a function.
"""

from __future__ import annotations
import __future__

import ast
import bisect
import builtins
import collections
import copy
import dis
import functools
import heapq
import inspect
import itertools
import linecache
import math
import operator
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from functools import lru_cache
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any, TypeAlias, cast

from ss2sql.fast_dataclasses import dataclass

UNKNOWN: Any = object()
SET_OPERATORS = (ast.BitOr, ast.BitAnd, ast.BitXor, ast.Sub)
_CODE_TYPES = (
    FunctionType,
    BuiltinFunctionType,
    MethodType,
    ModuleType,
    functools.partial,
    functools._lru_cache_wrapper,
)


# --- functions and methods that are known to be pure ---------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class KnownFunction:
    """A function that is known to be pure."""

    target: Any
    unordered: bool = False  # called with one argument, it gives the same for every order of a set
    calls: bool = False  # its first argument is a function
    gives_set: bool = False
    gives_code: bool = False  # a function or a class
    changes: bool = False  # changes an argument in place


@dataclass(frozen=True, slots=True)
class KnownMethod:
    """A method of Python's own value types that has no effect beyond the value it is called on."""

    fewest: int = 0  # with fewer arguments it is a method of something else
    gives_set: bool = False
    reads: bool = False  # it reads through iterables given as arguments: of a set in any order
    unordered: bool = False  # and so does every value that it is called on
    changes: bool = False


# By the function's identity, so that a replacement under the same name is not mistaken for it.
_KNOWN: dict[int, KnownFunction] = {}
METHODS: dict[str, KnownMethod] = {}


def find_known_pure(value: object) -> KnownFunction | None:
    """The entry of a function object, or None."""
    return _KNOWN.get(id(value))


def _declare_pure(module: ModuleType, names: str, **facts: Any) -> None:
    for name in names.split():
        target: Any = module
        for part in name.split("."):
            # vars() keeps a class method as it stands in its class: an object that stays the same.
            target = vars(target)[part]
        if isinstance(target, FunctionType) and target.__globals__ is not vars(module):
            continue  # somebody has replaced it
        _KNOWN[id(target)] = KnownFunction(target, **facts)


def _make_methods(names: str, **facts: Any) -> None:
    METHODS.update((name, KnownMethod(**facts)) for name in names.split())


_declare_pure(
    builtins,
    "abs ascii bin chr dict dict.fromkeys divmod enumerate float format hex int isinstance iter list next oct ord pow "
    "range repr reversed round str sum tuple zip",  # sum takes no sets: that of floats depends on their order
)
_declare_pure(builtins, "all any bool len max min sorted", unordered=True)
_declare_pure(builtins, "frozenset set", unordered=True, gives_set=True)
_declare_pure(builtins, "filter map", calls=True)
_declare_pure(builtins, "type", gives_code=True)
_declare_pure(math, " ".join(name for name in vars(math) if callable(vars(math)[name])))
_declare_pure(
    operator,
    "abs add and_ concat contains countOf eq floordiv ge getitem gt index indexOf inv invert le lshift lt matmul mod "
    "mul ne neg not_ or_ pos pow rshift sub truediv truth xor",
)
_declare_pure(operator, "delitem setitem", changes=True)
_declare_pure(operator, "itemgetter", gives_code=True)
_declare_pure(functools, "reduce", calls=True)
_declare_pure(
    itertools,
    "chain chain.from_iterable combinations combinations_with_replacement compress count cycle islice pairwise "
    "permutations product repeat zip_longest",
)
_declare_pure(heapq, "heapify heappop heappush heappushpop heapreplace", changes=True)
_declare_pure(heapq, "nlargest nsmallest")
_declare_pure(bisect, "bisect bisect_left bisect_right")
_declare_pure(bisect, "insort insort_left insort_right", changes=True)
_declare_pure(collections, "Counter OrderedDict deque")
_declare_pure(collections, "defaultdict", calls=True)
_declare_pure(copy, "copy deepcopy")

_make_methods("capitalize casefold expandtabs format isalnum isalpha isascii isdecimal isdigit isidentifier islower")
_make_methods(
    "isnumeric isprintable isspace istitle isupper lower lstrip rsplit rstrip split splitlines strip swapcase"
)
_make_methods("as_integer_ratio bit_count bit_length copy is_integer most_common title upper")
_make_methods("center count endswith find get index ljust partition removeprefix removesuffix replace", fewest=1)
_make_methods("rfind rindex rjust rpartition startswith translate zfill", fewest=1)
_make_methods("join", fewest=1, reads=True)
_make_methods("clear pop popitem popleft reverse rotate sort", changes=True)
_make_methods("add append appendleft discard insert remove setdefault", fewest=1, changes=True)
_make_methods("extend extendleft update", fewest=1, reads=True, changes=True)
_make_methods("items keys values")
_make_methods("difference intersection symmetric_difference union", gives_set=True, unordered=True)
_make_methods("isdisjoint issubset issuperset", unordered=True)
_make_methods("difference_update intersection_update symmetric_difference_update", unordered=True, changes=True)


def _add_pure_methods() -> None:
    """The same methods as functions of their class: `str.lower`."""
    for owner in (str, int, float, list, tuple, dict, set, frozenset):
        for name, target in vars(owner).items():
            method = METHODS.get(name)
            if method is not None and name != "format" and not (owner is set and name == "pop"):
                _KNOWN[id(target)] = KnownFunction(target, gives_set=method.gives_set, changes=method.changes)


_add_pure_methods()


# Attributes of these classes are looked up, so that `str.lower` and `chain.from_iterable` are found.
CLASSES = (str, int, float, bool, list, tuple, dict, set, frozenset, itertools.chain)


# --- the names of one function -------------------------------------------------------------------------


class Unproven(Exception):  # noqa: N818 - it is a finding, not an error
    """A function is not proven immutable, or not translated; the reason has the function as its subject."""


@dataclass(slots=True)
class Findings:
    """The findings of one proof: the constants that are read, in order, and facts about all functions together."""

    constants: dict[str, None] = field(default_factory=dict)
    changes: bool = False  # values are changed in place
    caches: bool = False  # a function in `functools.cache` is called


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


class FunctionNames:
    """The names of one Python function.

    Names that are local anywhere in it, inner functions and comprehensions included, are taken together, so a name
    that is also read from outside is refused. `functions` are local names that stand for inner functions alone.
    """

    def __init__(self, function: FunctionType, located: Located, findings: Findings) -> None:
        self.function = function
        self.located = located
        self.findings = findings
        self.parameters = {parameter.arg for parameter in list_parameters(located.node.args)}
        # The expressions whose values a local name may have; None for a part of another value.
        self._values: dict[str, list[ast.AST | None]] = {}
        for name, value in _iterate_local_values(located.node):
            self._values.setdefault(name, []).append(value)
        self.functions = {
            name
            for name, values in self._values.items()
            if all(isinstance(value, ast.FunctionDef | ast.Lambda) for value in values)
        }
        self._sets: set[str] | None = None
        code = function.__code__
        outside = {*code.co_freevars, *_iterate_global_names(code)}
        if twice := sorted(outside & self._values.keys()):
            raise Unproven(f"uses the name '{twice[0]}' for several things")

    def is_local(self, name: str) -> bool:
        return name in self._values

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
        names = self.located.module.names if self.located.whole else None
        if name not in self.function.__globals__:
            builtins: dict[str, Any] = cast(Any, self.function).__builtins__
            if name in builtins and not (names and name in names):
                return builtins[name]
            raise Unproven(f"reads the name '{name}', which has no value yet")
        value = self.function.__globals__[name]
        # A constant may be assigned again by another cell of a notebook, which nothing shows.
        known = names is not None and name in names
        if not (self.located.module.is_bound_once(name) if known else not is_constant_binding(value)):
            raise Unproven(f"reads the global name '{name}', which may change")
        return self._check_lasting(value, name, f"the global name '{name}'")

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
        if is_constant_binding(value) and module.__name__ not in ("math", "string", "sys"):
            file = namespace.get("__file__")
            source = read_module(file, namespace) if isinstance(file, str) and file.endswith(".py") else None
            if source is None or not source.is_bound_once(name):
                raise Unproven(f"reads {what}, which may change")
        return self._check_lasting(value, f"{module.__name__}.{name}", what)

    def find_object(self, node: ast.expr) -> Any:
        """The one object that a name or dotted name stands for, or `UNKNOWN` for a local value and its attributes."""
        match node:
            case ast.Name(id=name) if not self.is_local(name):
                return self.find_outside(name)
            case ast.Attribute(value=value, attr=name):
                base = self.find_object(value)
                if type(base) is ModuleType:
                    return self._find_member(base, name)
                if any(base is owner for owner in CLASSES):
                    return vars(base).get(name, UNKNOWN)
        return UNKNOWN

    def describe_code(self, node: ast.AST) -> str:
        """What an expression is that is no value, "a function" or "an exception"; empty for everything else."""
        match node:
            case ast.Lambda():
                return "a function"
            case ast.Name(id=name, ctx=ast.Load()) if self.is_local(name):
                definitions = {type(value) for value in self._values[name]}
                if ast.ExceptHandler in definitions:
                    return "an exception"
                return "a function" if definitions & {ast.FunctionDef, ast.Lambda} else ""
            case ast.Name(ctx=ast.Load()) | ast.Attribute(ctx=ast.Load()):
                value = self.find_object(node)
                return "a function" if value is not UNKNOWN and is_code_binding(value) else ""
            case ast.Call(func=func):
                value = self.find_object(func)
                if is_exception_class(value):
                    return "an exception"
                entry = find_known_pure(value)
                return "a function" if entry is not None and entry.gives_code else ""
            case _:
                return ""

    def is_set(self, node: ast.AST | None) -> bool:
        """Whether the value of an expression may be a set."""
        match node:
            case ast.Name(id=name, ctx=ast.Load()):
                return name in self._find_sets()
            case ast.Set() | ast.SetComp():
                return True
            case ast.NamedExpr(value=value) | ast.Call(func=ast.Attribute(value=value, attr="copy")):
                return self.is_set(value)
            case ast.IfExp(body=left, orelse=right):
                return self.is_set(left) or self.is_set(right)
            case ast.BoolOp(values=values):
                return any(map(self.is_set, values))
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, SET_OPERATORS):
                return any(self.is_set(part) or self._is_view(part) for part in (left, right))
            case ast.Call(func=func):
                target = self.find_object(func)
                if target is UNKNOWN and isinstance(func, ast.Attribute):
                    return func.attr in METHODS and METHODS[func.attr].gives_set
                entry = find_known_pure(target)
                return entry is not None and entry.gives_set
            case _:
                return False

    def is_always_set(self, node: ast.AST) -> bool:
        """Whether it is a local name, and each of its values may be a set."""
        return isinstance(node, ast.Name) and all(map(self.is_set, self._values[node.id]))

    def _is_view(self, node: ast.AST | None) -> bool:
        """Whether it may be a view of a dict, of which operators make a set."""
        match node:
            case ast.Name(id=name) if self.is_local(name):
                return any(isinstance(value, ast.Call) and self._is_view(value) for value in self._values[name])
            case ast.Call(func=ast.Attribute(attr="keys" | "items")):
                return True
            case _:
                return False

    def _find_sets(self) -> set[str]:
        """The local names that may stand for a set: a fixpoint."""
        if self._sets is None:
            self._sets, before = set(), None
            while before != len(self._sets):
                before = len(self._sets)
                self._sets |= {name for name, values in self._values.items() if any(map(self.is_set, values))}
        return self._sets


def _iterate_local_values(root: FunctionNode) -> Iterator[tuple[str, ast.AST | None]]:
    """Every name that a function or a part of it binds, with its value: an expression, a definition, or None."""
    valued: set[ast.AST] = set()
    for node in ast.walk(root):  # which comes to a statement before its targets
        match node:
            case ast.Assign(targets=targets, value=value):
                for part, own in (pair for target in targets for pair in pair_targets(target, value)):
                    if isinstance(part, ast.Name) and own is not None:
                        valued.add(part)
                        yield part.id, own
            case ast.AnnAssign(target=ast.Name() as target, value=value) | ast.NamedExpr(target=target, value=value):
                valued.add(target)
                yield target.id, value
            case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                valued.add(target)
                yield target.id, value if isinstance(op, SET_OPERATORS) else None
            case ast.ExceptHandler(name=str(name)):
                yield name, node
            case ast.FunctionDef(name=name) if node is not root:
                yield name, node
            case ast.arg(arg=name):
                yield name, None
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()) if node not in valued:
                yield name, None


def _iterate_global_names(code: CodeType) -> Iterator[str]:
    """The names that a function or a part of it reads from outside."""
    yield from (one.argval for one in dis.get_instructions(code) if one.opname in ("LOAD_GLOBAL", "LOAD_NAME"))
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _iterate_global_names(const)


# --- the source of a function --------------------------------------------------------------------------
# The file on disk may differ from what runs. So a node counts as a function's source only when it compiles to the very
# code of the function; this also distinguishes several lambdas on one line.
FunctionNode: TypeAlias = ast.FunctionDef | ast.Lambda
Comprehension: TypeAlias = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
FunctionPlace: TypeAlias = tuple[FunctionNode, tuple[ast.AST, ...]]  # a function, and the functions around it

_FUTURE = 0
for _feature in __future__.all_feature_names:
    _FUTURE |= getattr(__future__, _feature).compiler_flag


@dataclass(frozen=True, slots=True)
class Module:
    """A file's functions by first line and name, each with the functions around it, and its global names."""

    functions: dict[tuple[int, str], list[FunctionPlace]]
    names: Counter[str]  # how often each global name is given a value; imports do not count
    imports: tuple[ast.stmt, ...]  # a statement that imports all names that the module imports

    def is_bound_once(self, name: str) -> bool:
        """Whether the file gives this global name a value once at the most."""
        return name in self.names and self.names[name] <= 1


@dataclass(frozen=True, slots=True)
class Located:
    """A function's node, the functions around it from the outermost inwards, and its file."""

    node: FunctionNode
    around: tuple[ast.AST, ...]
    module: Module
    whole: bool  # whether the file is that of the function's module, so that it shows every assignment

    def is_closure_bound_once(self, name: str) -> bool:
        """Whether a name of an enclosing function is given its value exactly once."""
        for owner in reversed(self.around):
            times = _count_bindings_of_function(owner)
            if name in times:
                return times[name] == 1 and not any(
                    isinstance(node, ast.Nonlocal) and name in node.names for node in ast.walk(owner)
                )
        return False


def locate_function(function: FunctionType) -> Located | None:
    """The source of a function; None where there is none, or where it differs from what runs."""
    code = function.__code__
    module = read_module(code.co_filename, function.__globals__)
    if module is None:
        return None
    for node, around in module.functions.get((code.co_firstlineno, code.co_name), ()):
        if _is_source_of_code(node, code, module.imports):
            file = function.__globals__.get("__file__")
            whole = isinstance(file, str) and os.path.abspath(file) == os.path.abspath(code.co_filename)
            return Located(node, around, module, whole)
    return None


def read_module(filename: str, namespace: dict[str, Any]) -> Module | None:
    """The contents of a Python file; None where it is missing or has a syntax error."""
    linecache.checkcache(filename)
    text = "".join(linecache.getlines(filename, namespace))
    return _parse_module(text) if text else None


@lru_cache(maxsize=4)
def _parse_module(text: str) -> Module | None:
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return None
    functions: dict[tuple[int, str], list[FunctionPlace]] = defaultdict(list)
    names = _count_bindings(tree.body)
    pending: list[tuple[ast.AST, tuple[ast.AST, ...]]] = [(tree, ())]
    while pending:
        node, around = pending.pop()
        match node:
            case ast.Global(names=declared):
                names.update([*declared, *declared])
            case ast.FunctionDef():
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                functions[first, node.name].append((node, around))
            case ast.Lambda():
                functions[node.lineno, "<lambda>"].append((node, around))
        if isinstance(node, ast.FunctionDef | ast.Lambda | ast.AsyncFunctionDef | Comprehension):
            around = (*around, node)
        pending.extend((child, around) for child in ast.iter_child_nodes(node))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    aliases = [ast.alias(_name_import(alias)) for node in imported for alias in node.names if alias.name != "*"]
    imports = (ast.fix_missing_locations(ast.Import(aliases)),) if aliases else ()
    return Module(dict(functions), names, imports)


def _is_source_of_code(node: FunctionNode, code: CodeType, imports: Sequence[ast.stmt]) -> bool:
    body: list[ast.stmt] = [node if isinstance(node, ast.FunctionDef) else ast.copy_location(ast.Expr(node), node)]
    try:
        if code.co_flags & inspect.CO_NESTED:
            # The free names of the function become parameters of a function around it.
            wrapper = ast.parse(f"def _({', '.join(code.co_freevars)}): pass").body[0]
            assert isinstance(wrapper, ast.FunctionDef)
            wrapper.body = body
            body = [wrapper]
        flags = code.co_flags & _FUTURE
        # Python compiles `name.f()` differently where the module imports `name`.
        compiled = compile(ast.Module([*imports, *body], []), code.co_filename, "exec", flags, dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError):
        return False
    if code.co_flags & inspect.CO_NESTED:
        compiled = next(const for const in compiled.co_consts if isinstance(const, CodeType))
    return any(isinstance(const, CodeType) and const == code for const in compiled.co_consts)


def list_parameters(arguments: ast.arguments) -> Iterator[ast.arg]:
    """The parameters of a function, starred ones included."""
    yield from (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    yield from (starred for starred in (arguments.vararg, arguments.kwarg) if starred is not None)


def pair_targets(target: ast.expr, value: ast.expr) -> Iterator[tuple[ast.expr, ast.expr | None]]:
    """The single targets of an assignment, each with its value, or with None for a part of a value."""
    match target, value:
        case ((ast.Tuple(elts=left) | ast.List(elts=left)), (ast.Tuple(elts=right) | ast.List(elts=right))) if len(
            left
        ) == len(right) and not any(isinstance(part, ast.Starred) for part in (*left, *right)):
            for part, part_value in zip(left, right, strict=True):
                yield from pair_targets(part, part_value)
        case ((ast.Name() | ast.Subscript() | ast.Attribute()), _):
            yield target, value
        case _:
            yield target, None


# --- names that are given a value once -----------------------------------------------------------------


def _count_bindings(nodes: Iterable[ast.AST], repeated: bool = False) -> Counter[str]:
    """How often parts of a scope give each name a value; not at all by an import, twice where that may run again."""
    found: Counter[str] = Counter()
    for node, again in _iterate_scope(nodes, repeated):
        match node:
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                found.update(dict.fromkeys(map(_name_import, aliases), 0))
            case (
                ast.FunctionDef(name=str(name))
                | ast.AsyncFunctionDef(name=str(name))
                | ast.ClassDef(name=str(name))
                | ast.Name(id=str(name), ctx=ast.Store() | ast.Del())
                | ast.ExceptHandler(name=str(name))
                | ast.MatchAs(name=str(name))
                | ast.MatchStar(name=str(name))
                | ast.MatchMapping(rest=str(name))
            ):
                found[name] += 1 + again
    return found


def _iterate_scope(nodes: Iterable[ast.AST], repeated: bool) -> Iterator[tuple[ast.AST, bool]]:
    """The nodes of a scope, without the bodies of functions and classes in it, and whether each may run again."""
    for node in nodes:
        yield node, repeated
        inside: Iterable[ast.AST] = ast.iter_child_nodes(node)
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                inside = [part for part in inside if not isinstance(part, ast.stmt)]
            case ast.Lambda(args=arguments):
                inside = [arguments]
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                # The targets are local to the comprehension, but `:=` inside it binds out here.
                inside = [part for part in ast.walk(node) if isinstance(part, ast.NamedExpr)]
        loops = isinstance(node, ast.For | ast.AsyncFor | ast.While | Comprehension)
        yield from _iterate_scope(inside, repeated or loops)


def _count_bindings_of_function(owner: ast.AST) -> Counter[str]:
    """How often a function, lambda or comprehension gives each of its names a value."""
    if isinstance(owner, Comprehension):
        return _count_bindings([generator.target for generator in owner.generators], repeated=True)
    assert isinstance(owner, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
    body = [owner.body] if isinstance(owner, ast.Lambda) else owner.body
    return _count_bindings(body) + Counter(parameter.arg for parameter in list_parameters(owner.args))


def _name_import(alias: ast.alias) -> str:
    """The name that an import binds."""
    return alias.asname or alias.name.partition(".")[0]
