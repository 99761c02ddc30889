"""The volatility of a Python function, inferred from its source.

Calls of an immutable function are cached, shared and reordered, so `infer_purity` calls a function immutable only where
its source proves it, and volatile in every other case. The proof assumes that

- arguments are plain values (None, bool, int, float, string, list, dict), fresh for each call: the methods of a user's
  class are not examined, so a call with an opaque object must not be cached on this proof alone;
- a name that is bound once in its file is not rebound from elsewhere afterwards (`module.helper = other`, a debugger,
  the next cell of a notebook that defines a helper again);
- the memory and the stack suffice, and the locale stays what it is.

A function in `functools.cache` is judged as the function itself, although the cache takes 1, 1.0 and True for one
argument, and gives an iterator again that is used up: its author chose that.
"""

from __future__ import annotations

import ast
import gc
import inspect
import re
from collections.abc import Callable, Iterable
from dataclasses import field
from functools import _lru_cache_wrapper
from types import BuiltinFunctionType, FunctionType, MethodDescriptorType, MethodType
from typing import Any, Literal, TypeAlias

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.volatility.function_names import (
    METHODS,
    SET_OPERATORS,
    UNKNOWN,
    Comprehension,
    Findings,
    FunctionNames,
    FunctionNode,
    KnownFunction,
    Unproven,
    find_known_pure,
    is_constant_binding,
    is_exception_class,
    list_parameters,
    locate_function,
    pair_targets,
    read_module,
)

Volatility: TypeAlias = Literal["immutable", "stable", "volatile"]

_MOST_FUNCTIONS = 100
_MOST_DEPTH = 25


@dataclass(frozen=True, slots=True)
class Purity:
    """The volatility of a function, and the reason.

    `reason` is a clause with the function as its subject, such as "calls print". `changes` is false where it is proven
    to change nothing, its arguments included. `indexed` are the places of parameters of which it only reads items.
    """

    volatility: Volatility
    reason: str
    changes: bool = field(default=True, compare=False)
    indexed: frozenset[int] = field(default=frozenset(), compare=False)


@dataclass(frozen=True, slots=True)
class Arity:
    """How many positional arguments a function takes; `maximum` is None with `*args`, `names` are their names."""

    minimum: int
    maximum: int | None
    names: tuple[str, ...]


@dataclass(slots=True)
class Proof:
    """One proof: the functions that it has followed, and their findings together."""

    findings: Findings = field(default_factory=Findings)
    followed: set[int] = field(default_factory=set)  # by identity
    depth: int = 0

    def prove_function(self, function: FunctionType, gives_sets: bool) -> FunctionNode | None:
        """Proves a function, which may give a set only if `gives_sets`; gives its tree when it is proven.

        A recursive call counts as proven, without a tree: if the function is not, the walk fails anyway.
        """
        if id(function) in self.followed:
            return None
        if self.depth >= _MOST_DEPTH or len(self.followed) >= _MOST_FUNCTIONS:
            raise Unproven("calls more functions than are followed")
        self.followed.add(id(function))
        self.depth += 1
        names = self._read_names(function)
        FunctionProof(names, self.prove_called, gives_sets).check_body(names.located.node)
        self.depth -= 1
        return names.located.node

    def _read_names(self, function: FunctionType) -> FunctionNames:
        code = function.__code__
        if code.co_flags & (inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR):
            raise Unproven("is a generator or coroutine")
        located = locate_function(function)
        if located is None and read_module(code.co_filename, function.__globals__) is None:
            raise Unproven("has no Python source")
        if located is None:
            raise Unproven("is not in its source file as it runs")
        defaults = (*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values())
        if not all(is_constant_binding(default) for default in defaults):
            raise Unproven("has a default argument that may change")
        return FunctionNames(function, located, self.findings)

    def prove_called(self, value: Any, text: str) -> None:
        """Proves a Python object that is called as `text`."""
        if find_known_pure(value) is not None or is_exception_class(value):
            return
        if type(value) is FunctionType:
            try:
                self.prove_function(value, gives_sets=False)
            except Unproven as error:
                raise Unproven(f"calls {text}, which {error}") from None
        elif isinstance(value, _lru_cache_wrapper):
            self.findings.caches = True
            self.prove_called(_unwrap_cache(value), text)
        else:
            raise Unproven(f"calls {text}, which is not known to be pure")


def infer_purity(function: Callable[..., object]) -> Purity:
    """Whether a function's source proves that it is immutable; it is volatile otherwise, with the reason.

    `function` is any callable. Nothing is called, nothing is raised.
    """
    try:
        return _prove_callable(function)
    except Unproven as unproven:
        return Purity("volatile", str(unproven))
    except RecursionError:
        return Purity("volatile", "is nested too deeply to be followed")


def _find_indexed_parameters(function: FunctionNode) -> frozenset[int]:
    """The places of parameters of which a proven function only reads items, so that it cannot change a flat list.

    `a, b = step`, `step[0]`, `for disk in step` and tests read; whatever else is done with the name may keep or change
    the list.
    """
    reads: set[int] = set()
    for node in ast.walk(function):
        match node:
            case ast.Subscript(value=ast.Name() as read, ctx=ast.Load()) | ast.UnaryOp(op=ast.Not(), operand=read):
                reads.add(id(read))
            case ast.Assign(targets=[ast.Tuple()], value=read) | ast.For(iter=read) | ast.comprehension(iter=read):
                reads.add(id(read))
            case ast.If(test=read) | ast.IfExp(test=read) | ast.While(test=read):
                reads.add(id(read))
    parameters = [parameter.arg for parameter in (*function.args.posonlyargs, *function.args.args)]
    kept = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and id(node) not in reads}
    return frozenset(place for place, name in enumerate(parameters) if name not in kept)


def _prove_callable(function: Any, cached: bool = False) -> Purity:
    """That a callable, perhaps of a cache, is immutable. Raises `Unproven`."""
    entry = find_known_pure(function)
    if entry is not None:
        if entry.gives_code:
            raise Unproven("gives a function, which is not a value")
        if entry.calls:
            raise Unproven("calls its arguments")
        return Purity("immutable", "is known to be pure", entry.changes)
    if isinstance(function, _lru_cache_wrapper):
        return _prove_callable(_unwrap_cache(function), cached=True)
    if type(function) is FunctionType:
        proof = Proof()
        node = proof.prove_function(function, gives_sets=True)
        if proof.findings.caches and proof.findings.changes:
            raise Unproven("may change values that a cached function remembers")
        names = ", ".join(f"'{name}'" for name in proof.findings.constants)
        constants = f" and the constants {names}" if names else ""
        reason, changes = f"has a source that uses only its arguments{constants}", proof.findings.changes
        indexed = _find_indexed_parameters(node) if node and changes and not cached else frozenset()
        return Purity("immutable", reason, changes, indexed)
    if type(function) is MethodType:
        raise Unproven("is a method of an object, which may have state")
    if type(function) in (BuiltinFunctionType, MethodDescriptorType):
        raise Unproven("has no Python source")
    raise Unproven(
        "is a class, whose objects may have state" if issubclass(type(function), type) else "is an object with state"
    )


def _unwrap_cache(cache: Any) -> Any:
    """The function inside a cache. `__wrapped__` can be set to anything: it counts where the cache really holds it."""
    claimed = getattr(cache, "__wrapped__", None)
    return next((held for held in gc.get_referents(cache) if held is claimed), None)


def read_signature(function: Callable[..., object]) -> inspect.Signature | None:
    """The signature of a function; None where Python knows none."""
    try:
        # Without __wrapped__, but of a cache: the function that is called counts, not the one that it claims to be.
        return inspect.signature(function, follow_wrapped=isinstance(function, _lru_cache_wrapper))
    except (TypeError, ValueError):
        return None


def infer_arity(function: Callable[..., object]) -> Arity:
    """How many positional arguments a function takes, from its signature; 0 to any number where it has none.

    Raises a `SessionError` S002 for something that cannot be called, or only with keyword arguments.
    """
    if not callable(function):
        raise SessionError("S002", f"{function!r} cannot be called.", hints=("register a Python function",))
    signature = read_signature(function)
    if signature is None:
        return Arity(0, None, ())
    names: list[str] = []
    minimum, unbounded = 0, False
    for parameter in signature.parameters.values():
        match parameter.kind:
            case inspect.Parameter.POSITIONAL_ONLY | inspect.Parameter.POSITIONAL_OR_KEYWORD:
                names.append(parameter.name)
                minimum += parameter.default is inspect.Parameter.empty
            case inspect.Parameter.VAR_POSITIONAL:
                unbounded = True
            case inspect.Parameter.KEYWORD_ONLY if parameter.default is inspect.Parameter.empty:
                name = getattr(function, "__name__", "the function")
                raise SessionError(
                    "S002",
                    f"{name} needs the keyword argument '{parameter.name}', which a script cannot give.",
                    hints=(f"give '{parameter.name}' a default value, or make it a positional parameter",),
                )
            case _:
                pass
    return Arity(minimum, None if unbounded else len(names), tuple(names))


# --- the walk over one function's source, which refuses everything unknown -----------------------------
# A function is immutable when equal arguments give equal values and nothing but its arguments and their parts is
# changed. The walk keeps one invariant: no value is or holds a set, whose order depends on the hash seed, a function or
# an exception. Sets stay in local names, and are refused wherever they would be stored, passed on or put in an order;
# only the function itself may give one. Functions are called, or given to functions that call them.
# A field of a format string with a dotted name: `{0.name}`, also inside another field.
_ATTRIBUTE = re.compile(r"\{[^{}:!]*\.")
# Of these it is enough to check the parts.
_PLAIN = (
    ast.Constant, ast.Name, ast.BinOp, ast.UnaryOp, ast.Subscript, ast.Slice, ast.Starred, ast.List, ast.Tuple,
    ast.Dict, ast.JoinedStr, ast.FormattedValue, ast.keyword, ast.expr_context, ast.operator, ast.unaryop, ast.Pass,
    ast.Break, ast.Continue, ast.Try, ast.Delete,
)  # fmt: skip


@dataclass(slots=True)
class FunctionProof:
    """The walk over one function's body, which may give a set if `gives_sets`.

    `follow` proves another Python object that is called by a name. Every check raises `Unproven` where the proof fails.
    """

    names: FunctionNames
    follow: Callable[[Any, str], None]
    gives_sets: bool

    def check_body(self, node: FunctionNode) -> None:
        """Walks the body of the function, or of an inner one."""
        if isinstance(node, ast.Lambda):
            self.check(node.body, self.gives_sets)
        else:
            self.check_all(node.body)

    def check_all(self, nodes: Iterable[ast.AST | None], sets: bool = False) -> None:
        for node in nodes:
            if node is not None:
                self.check(node, sets)

    def check(self, node: ast.AST, sets: bool = False) -> None:
        """Checks a statement, or an expression that is read as a value; with `sets` it may be one."""
        if not sets and self.names.is_set(node):
            raise Unproven(f"uses the set '{ast.unparse(node)[:40]}' where its order may count")
        if what := self.names.describe_code(node):
            raise Unproven(f"keeps or passes on '{ast.unparse(node)[:40]}', {what}")
        match node:
            case ast.Call():
                self.check_call(node)
            case ast.Attribute(value=value, attr=name, ctx=ast.Load()):
                if self.names.find_object(node) is UNKNOWN:
                    if not self.names.describe_code(value):
                        self.check(value, sets=True)
                    raise Unproven(f"reads the attribute '{name}' of an object")
            case ast.Attribute(attr=name):
                raise Unproven(f"changes the attribute '{name}'")
            case ast.Subscript(value=value, slice=index, ctx=ast.Store() | ast.Del()):
                self.names.findings.changes = True
                self.check_all((value, index))
            case ast.Compare():
                self.check_comparison(node)
            case ast.BinOp(left=left, op=op, right=right) if isinstance(op, SET_OPERATORS):
                self.check_all((left, right), sets=True)
            case ast.BoolOp(values=values):
                self.check_all(values, sets)
            case ast.UnaryOp(op=ast.Not(), operand=operand) | ast.Expr(value=operand):
                self.check(operand, sets=True)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                self.check(test, sets=True)
                self.check_all((body, orelse), sets)
            case ast.Set(elts=parts):
                for part in parts:
                    starred = isinstance(part, ast.Starred)
                    self.check(part.value if isinstance(part, ast.Starred) else part, sets=starred)
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                self.check_comprehension(node, unordered=isinstance(node, ast.SetComp))
            case ast.Return(value=value):
                self.check_all([value], self.gives_sets)
            case ast.Assign(targets=targets, value=value):
                for part, own in (pair for target in targets for pair in pair_targets(target, value)):
                    self.check_assignment(part, value if own is None else own)
            case ast.NamedExpr(target=target, value=value):
                self.check_assignment(target, value)
            case ast.AnnAssign(target=target, value=value):
                self.check_assignment(target, value) if value else self.check(target)
            case ast.AugAssign(target=target, op=op, value=value):
                self.names.findings.changes = True
                # Only a set takes another in without regard to its order: `|=` of a dict reads it as pairs.
                self.check(value, sets=isinstance(op, SET_OPERATORS) and self.names.is_always_set(target))
                self.check(target)
            case ast.For(target=target, iter=iterable, body=body, orelse=orelse):
                self.check_all([iterable, target, *body, *orelse])
            case ast.While(test=test, body=body, orelse=orelse) | ast.If(test=test, body=body, orelse=orelse):
                self.check(test, sets=True)
                self.check_all([*body, *orelse])
            case ast.Assert(test=test, msg=message):
                self.check(test, sets=True)
                self.check_all([message])
            case ast.Raise(exc=raised, cause=cause):
                self.check_raised(raised)
                self.check_raised(cause)
            case ast.ExceptHandler(type=caught, body=body):
                self.check_caught(caught)
                self.check_all(body)
            case ast.FunctionDef():
                self.check_nested(node)
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                raise Unproven(f"declares '{names[0]}' {type(node).__name__.lower()}")
            case _ if isinstance(node, _PLAIN):
                self.check_all(ast.iter_child_nodes(node))
            case _:
                raise Unproven(f"uses '{type(node).__name__.removeprefix('Async').lower()}'")

    def check_comparison(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for left, op, right in zip(operands, node.ops, node.comparators, strict=False):
            known = any(_is_single(side) or self.names.describe_code(side) for side in (left, right))
            if isinstance(op, ast.Is | ast.IsNot) and not known:
                raise Unproven(f"compares identities in '{ast.unparse(node)[:40]}'")
        for operand in operands:
            self.check_used(operand, sets=True)

    def check_used(self, node: ast.expr, sets: bool = False) -> None:
        """Checks an expression that may also be a function or an exception."""
        if isinstance(node, ast.Call):
            self.check_call(node)
        elif not self.names.describe_code(node):
            self.check(node, sets)

    def check_comprehension(self, node: Comprehension, unordered: bool) -> None:
        for generator in node.generators:
            self.check(generator.iter, sets=unordered)
            self.check(generator.target)
            self.check_all(generator.ifs, sets=True)
        self.check_all([node.key, node.value] if isinstance(node, ast.DictComp) else [node.elt])

    def check_assignment(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Name) and isinstance(value, ast.Lambda):
            self.check_nested(value)
        else:
            self.check(value, sets=isinstance(target, ast.Name))
        self.check(target)

    def check_nested(self, node: FunctionNode) -> None:
        arguments = node.args
        self.check_all([*arguments.defaults, *arguments.kw_defaults])
        if isinstance(node, ast.FunctionDef):
            if node.decorator_list:
                raise Unproven(f"decorates the inner function '{node.name}'")
            for annotation in (node.returns, *(parameter.annotation for parameter in list_parameters(arguments))):
                if annotation and any(isinstance(part, ast.Call) for part in ast.walk(annotation)):
                    raise Unproven(f"computes the annotation '{ast.unparse(annotation)[:40]}'")
        FunctionProof(self.names, self.follow, gives_sets=False).check_body(node)

    def check_raised(self, node: ast.expr | None) -> None:
        """Checks what is raised, or its cause. Raising a class calls it."""
        if isinstance(node, ast.Name | ast.Attribute) and self.names.find_object(node) is not UNKNOWN:
            self.check_followed(node, self.names.find_object(node))
        elif node is not None:
            self.check_used(node)

    def check_caught(self, node: ast.expr | None) -> None:
        for part in node.elts if isinstance(node, ast.Tuple) else [node]:
            if part is not None and not issubclass(type(self.names.find_object(part)), type):
                raise Unproven(f"catches '{ast.unparse(part)[:40]}', which is not an exception class")

    # --- calls -----------------------------------------------------------------------------------------

    def check_call(self, node: ast.Call) -> None:
        func = node.func
        target = self.names.find_object(func)
        entry = find_known_pure(target)
        if target is UNKNOWN and isinstance(func, ast.Attribute):
            self.check_method(node, func)
        elif entry is not None:
            self.check_known_call(node, entry)
        else:
            self.check_followed(func, target)
            self.check_all([*node.args, *node.keywords])

    def check_followed(self, func: ast.expr, target: Any) -> None:
        """Checks a function that is called: one of Python's objects, or an inner one, which the walk comes to."""
        text = ast.unparse(func)[:40]
        if target is not UNKNOWN:
            self.follow(target, text)
        elif isinstance(func, ast.Name) and func.id in self.names.parameters:
            raise Unproven(f"calls its argument '{text}'")
        elif not isinstance(func, ast.Name) or func.id not in self.names.functions:
            raise Unproven(f"calls '{text}', which is not known")

    def check_known_call(self, node: ast.Call, entry: KnownFunction) -> None:
        self.names.findings.changes |= entry.changes
        keyed = any(keyword.arg == "key" for keyword in node.keywords)
        unordered = entry.unordered and len(node.args) == 1 and not keyed
        for position, argument in enumerate(node.args):
            if position == 0 and entry.calls:
                self.check_callable(argument)
            elif position == 1 and entry.target is isinstance:
                for part in argument.elts if isinstance(argument, ast.Tuple) else [argument]:
                    self.check_used(part)
            elif unordered and isinstance(argument, ast.GeneratorExp):
                self.check_comprehension(argument, unordered=True)
            else:
                self.check(argument, sets=unordered)
        self.check_keywords(node)

    def check_keywords(self, node: ast.Call) -> None:
        for keyword in node.keywords:
            self.check_callable(keyword.value) if keyword.arg == "key" else self.check(keyword.value)

    def check_callable(self, node: ast.expr) -> None:
        """Checks an argument that is called: it must be proven, and give plain values."""
        text = ast.unparse(node)[:40]
        if isinstance(node, ast.Constant):
            return
        if isinstance(node, ast.Lambda):
            self.check_nested(node)
            return
        if isinstance(node, ast.Call):
            entry = find_known_pure(self.names.find_object(node.func))
            if entry is None or not entry.gives_code or entry.target is type:
                raise Unproven(f"calls the result of '{text}'")
            self.check_call(node)
            return
        target = self.names.find_object(node)
        if target is UNKNOWN and isinstance(node, ast.Attribute):
            method = METHODS.get(node.attr)
            if method is None or method.gives_set or node.attr in ("copy", "format", "pop"):
                raise Unproven(f"uses the method '{node.attr}', which is not known to be pure")
            self.names.findings.changes |= method.changes
            self.check(node.value, sets=True)
            return
        entry = find_known_pure(target)
        if entry is None:
            self.check_followed(node, target)
        elif entry.gives_set or entry.gives_code or entry.calls:
            raise Unproven(f"uses {text} as a function, which does not give plain values")
        else:
            self.names.findings.changes |= entry.changes

    def check_method(self, node: ast.Call, func: ast.Attribute) -> None:
        name = func.attr
        method = METHODS.get(name)
        if self.names.describe_code(func.value):
            raise Unproven(f"calls {ast.unparse(func)}, which is not known to be pure")
        self.check(func.value, sets=True)
        if method is None or len(node.args) < method.fewest:
            raise Unproven(f"calls the method '{name}', which is not known to be pure")
        if name == "format":
            self.check_template(func.value)
        of_set = self.names.is_set(func.value)
        if of_set and name == "pop":
            raise Unproven("takes an element of a set, which may be any")
        self.names.findings.changes |= method.changes
        self.check_all(node.args, sets=method.unordered or (method.reads and of_set))
        self.check_keywords(node)

    def check_template(self, node: ast.expr) -> None:
        """Checks that a format string is constant and reads no attributes: the text of a method has an address."""
        text = node.value if isinstance(node, ast.Constant) else self.names.find_object(node)
        if not isinstance(text, str):
            raise Unproven("formats with a text that is not constant")
        if _ATTRIBUTE.search(text):
            raise Unproven(f"reads attributes through the format '{text[:40]}'")


def _is_single(node: ast.expr) -> bool:
    """Whether it is None, True or False, of which there is one each."""
    return isinstance(node, ast.Constant) and (node.value is None or isinstance(node.value, bool))
