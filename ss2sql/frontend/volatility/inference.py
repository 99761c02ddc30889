"""The volatility of a Python function, inferred from its source.

Calls of an immutable function are cached, shared and reordered, so `infer_purity` calls a function immutable only where
its source proves it, and volatile in every other case. The proof assumes that

- arguments are plain values (None, bool, int, float, string, list, dict), fresh for each call: the methods of a user's
  class are not examined, so a call with an opaque object must not be cached on this proof alone;
- a name that is bound once in its file is not rebound from elsewhere afterwards (`module.helper = other`, a debugger,
  the next cell of a notebook that defines a helper again);
- the memory and the stack suffice, and the locale stays what it is.

A function in `functools.cache` is judged as the function itself, although the cache takes 1, 1.0 and True for one
argument: its author chose that.
"""

from __future__ import annotations

import gc
import inspect
from collections.abc import Callable
from dataclasses import field
from functools import _lru_cache_wrapper
from types import BuiltinFunctionType, FunctionType, MethodDescriptorType, MethodType
from typing import Any, Literal, TypeAlias

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.volatility.function_source import locate_function, read_module
from ss2sql.frontend.volatility.name_bindings import (
    Findings,
    FunctionNames,
    Unproven,
    find_known_pure,
    is_constant_binding,
    is_exception_class,
)
from ss2sql.frontend.volatility.proof import FunctionProof

Volatility: TypeAlias = Literal["immutable", "stable", "volatile"]

_MOST_FUNCTIONS = 100
_MOST_DEPTH = 25


@dataclass(frozen=True, slots=True)
class Purity:
    """The volatility of a function, and the reason.

    `reason` is a clause with the function as its subject, such as "calls print". `changes` is false where it is proven
    to change nothing, its arguments included.
    """

    volatility: Volatility
    reason: str
    changes: bool = field(default=True, compare=False)


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

    def prove_function(self, function: FunctionType, gives_sets: bool) -> None:
        """Proves a function, which may give a set only if `gives_sets`; returns when it is proven."""
        # A recursive call counts as proven: if the function is not, the walk fails anyway.
        if id(function) in self.followed:
            return
        if self.depth >= _MOST_DEPTH or len(self.followed) >= _MOST_FUNCTIONS:
            raise Unproven("calls more functions than are followed")
        self.followed.add(id(function))
        self.depth += 1
        names = self._read_names(function)
        FunctionProof(names, self.prove_called, gives_sets).check_body(names.located.node)
        self.depth -= 1

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
            inside = _unwrap_cache(value)
            entry = find_known_pure(inside)
            self.findings.iterators |= entry is not None and entry.gives_iterator
            self.prove_called(inside, text)
        else:
            raise Unproven(f"calls {text}, which is not known to be pure")


def infer_purity(function: Callable[..., object]) -> Purity:
    """Whether a function's source proves that it is immutable; it is volatile otherwise, with the reason.

    `function` is any callable. Nothing is called, nothing is raised.
    """
    try:
        reason, changes = _prove_callable(function)
        return Purity("immutable", reason, changes=changes)
    except Unproven as unproven:
        return Purity("volatile", str(unproven))
    except RecursionError:
        return Purity("volatile", "is nested too deeply to be followed")


def _prove_callable(function: Any, cached: bool = False) -> tuple[str, bool]:
    """Why a callable, perhaps of a cache, is immutable, and whether it may change its arguments. Raises `Unproven`."""
    entry = find_known_pure(function)
    if entry is not None:
        if entry.gives_code:
            raise Unproven("gives a function, which is not a value")
        if entry.calls:
            raise Unproven("calls its arguments")
        if cached and entry.gives_iterator:
            raise Unproven("may give an iterator that a cached function remembers")
        return "is known to be pure", entry.changes
    if isinstance(function, _lru_cache_wrapper):
        return _prove_callable(_unwrap_cache(function), cached=True)
    if type(function) is FunctionType:
        proof = Proof()
        proof.prove_function(function, gives_sets=True)
        if proof.findings.caches and proof.findings.changes:
            raise Unproven("may change values that a cached function remembers")
        if proof.findings.iterators and (cached or proof.findings.caches):
            raise Unproven("may give an iterator that a cached function remembers")
        names = ", ".join(f"'{name}'" for name in proof.findings.constants)
        constants = f" and the constants {names}" if names else ""
        return f"has a source that uses only its arguments{constants}", proof.findings.changes
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


def infer_arity(function: Callable[..., object]) -> Arity:
    """How many positional arguments a function takes, from its signature; 0 to any number where it has none.

    Raises a `SessionError` S002 for something that cannot be called, or only with keyword arguments.
    """
    if not callable(function):
        raise SessionError("S002", f"{function!r} cannot be called.", hints=("register a Python function",))
    try:
        # Without __wrapped__, but of a cache: the function that is called counts, not the one that it claims to be.
        signature = inspect.signature(function, follow_wrapped=isinstance(function, _lru_cache_wrapper))
    except (TypeError, ValueError):
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
