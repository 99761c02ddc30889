"""The bindings of a Python function's names: locals by scope, and the settled values of outer names.

`FunctionNames` answers three questions for one function, without judging: which object a name or dotted name is
(`find_object`), which functions a call may reach (`find_targets`), and of what kind the value of an expression is
(`infer_kind`).
"""

from __future__ import annotations

import ast
import functools
import gc
import importlib
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
from ss2sql.frontend.volatility.known_functions import (
    CLASSES,
    IMPURE_MODULES,
    METHODS,
    PURE_MODULES,
    ResultKind,
    find_known,
)

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


def is_constant(value: object) -> bool:
    """Whether a value can never change: a number, string, bool, None, or a tuple of such."""
    if type(value) is tuple:
        return all(is_constant(part) for part in value)
    return value is None or type(value) in (bool, int, float, str)


def is_exception_class(value: object) -> bool:
    """Whether it is an exception whose creation runs no Python code."""
    if type(value) is not type or not issubclass(value, BaseException):
        return False
    makers = (vars(base).get(name) for base in value.__mro__ for name in ("__init__", "__new__"))
    return not any(isinstance(maker, FunctionType | staticmethod) for maker in makers)


def is_code(value: object) -> bool:
    """Whether it is a function, class or module, not data."""
    return type(value) in _CODE_TYPES or issubclass(type(value), type) or find_known(value) is not None


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
            if is_constant(value):
                raise Unproven(f"reads {what}, which may change")
        elif not module.is_bound_once(name) and (is_constant(value) or name in module.names or name in module.rebound):
            raise Unproven(f"reads {what}, which may change")
        return self._check_lasting(value, name, what)

    def _check_lasting(self, value: Any, name: str, what: str) -> Any:
        if is_constant(value):
            self.findings.constants[name] = None
        elif not is_code(value):
            raise Unproven(f"reads {what}, " + ("an object with state" if callable(value) else "which may change"))
        return value

    def _find_member(self, module: ModuleType, name: str) -> Any:
        """A module's value of a name; see `find_outside`."""
        namespace = vars(module)
        what = f"'{module.__name__}.{name}'"
        if name not in namespace:
            raise Unproven(f"reads {what}, which does not exist")
        value = namespace[name]
        if find_known(value) or (module.__name__ in IMPURE_MODULES and is_code(value)):
            return value
        file = namespace.get("__file__")
        fixed = module.__name__ == "math" or what == "'sys.maxsize'"
        if (is_constant(value) and not fixed) or type(value) is FunctionType:
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
                    return VALUE if is_constant(self.find_outside(name)) else CODE
                places, inner = found
                if (id(inner), name) in active:
                    return NOTHING
                active |= {(id(inner), name)}
                return functools.reduce(
                    ResultKind.__or__, (self._infer_bound_kind(name, place, inner, active) for place in places)
                )
            case ast.Attribute():
                value = self.find_object(node, scope)
                return VALUE if value is UNKNOWN or is_constant(value) else CODE
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
                return _join_set_kinds(self.infer_kind(left, scope, active) | self.infer_kind(right, scope, active))
            case _:
                return VALUE

    def _infer_bound_kind(self, name: str, place: Binding, scope: Scope, active: Active) -> ResultKind:
        match place:
            case Binding("value", ast.expr() as value):
                return self.infer_kind(value, scope, active)
            case Binding("update", ast.AugAssign(op=op, value=value)) if isinstance(op, SET_OPERATORS):
                return _join_set_kinds(self.infer_kind(value, scope, active))
            case Binding("import", ast.Import() | ast.ImportFrom() as statement):
                return VALUE if is_constant(resolve_import(statement, name)) else CODE
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
        if (entry := find_known(target)) is not None:
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


def _join_set_kinds(kind: ResultKind) -> ResultKind:
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
