"""What a Python function is made of: equal fingerprints stand for functions that compute the same.

A fingerprint takes in the code of the function, its defaults, the values of its enclosing functions and the global
names that it reads, and so on for all functions and classes of the user that it reaches. What belongs to Python or to
an installed package goes by its name, and other values by what `pickle` writes of them.

Worker processes load this file by itself, so it imports nothing of ss2sql; see runtime/parallel/worker_process.py.
"""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from hashlib import sha256
from inspect import CO_NESTED
from pathlib import Path
from pickle import Pickler
from types import (
    BuiltinFunctionType,
    CodeType,
    FunctionType,
    GetSetDescriptorType,
    MemberDescriptorType,
    MethodType,
    ModuleType,
    SimpleNamespace,
)
from typing import Any

_PLAIN = frozenset({type(None), bool, int, float, str, bytes, list, tuple, dict})
_GLOBAL_LOADS = frozenset({"LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"})
# What tells where a class was written, and what Python makes of the rest.
_LEFT_OUT = frozenset(
    {"__dict__", "__weakref__", "__module__", "__doc__", "__qualname__", "__firstlineno__", "__static_attributes__"}
    | {"__annotations__", "__dataclass_fields__", "__dataclass_params__", "__slotnames__", "_abc_impl"}
)


class NotCacheable(Exception):  # noqa: N818 - it is a finding, not an error
    """Something cannot be remembered; the text says why."""


def fingerprint_function(function: Callable[..., Any]) -> str:
    """The fingerprint of a function or class. Raises NotCacheable, with a clause whose subject it is."""
    made = Fingerprint()
    made.add_value(function, "its own state")
    return made.hash.hexdigest()


class Fingerprint:
    """One fingerprint in the making. A function or class that is met a second time goes by the number of its first."""

    def __init__(self) -> None:
        self.hash = sha256(f"{sys.implementation.name} {sys.version_info[:2]}".encode())
        self.met: dict[Any, tuple[int, Any]] = {}

    def add_value(self, value: Any, name: str) -> None:
        """Takes in a value, which is called `name` where it is refused."""
        try:
            _Writer(self).dump(value)
        except NotCacheable:
            raise
        except Exception as error:  # whatever an object raises that is to tell its state
            raise NotCacheable(f"reads {name}, which cannot be compared: {error}") from error

    def add_named(self, names: set[str], mentioned: set[str], values: dict[str, Any], where: str) -> None:
        """Takes in those values that have such names; of a module of the user those that are mentioned."""
        for name in sorted(names & values.keys()):
            value, key = values[name], (id(values[name]), frozenset(mentioned))
            if not isinstance(value, ModuleType) or not is_of_user(value.__name__):
                self.add_value((name, value), f"'{where}{name}'")
            elif key not in self.met:
                self.met[key] = len(self.met), value
                self.add_named(mentioned, mentioned, vars(value), f"{value.__name__}.")


class _Writer(Pickler):
    """Writes one value, all parts each time: what is equal is written equally, whether it is the same or not."""

    def __init__(self, made: Fingerprint) -> None:
        super().__init__(SimpleNamespace(write=made.hash.update), 5)
        self.fast = True
        self.made = made

    def persistent_id(self, value: Any) -> Any:
        """What is written in place of a value; None where that is its own affair."""
        kind = type(value)
        if kind in _PLAIN or kind is MethodType:
            return None
        if kind in (set, frozenset):
            return kind.__name__, sorted(value, key=repr)  # sets have no order
        if kind is CodeType:
            return _describe_code(value)
        if kind in (property, staticmethod, classmethod):
            parts = (value.fget, value.fset, value.fdel) if kind is property else value.__func__
            return kind.__name__, parts
        if isinstance(value, ModuleType) or (callable(value) and isinstance(getattr(value, "__qualname__", 0), str)):
            return self._describe_named(value, kind)
        return None

    def _describe_named(self, value: Any, kind: type) -> Any:
        """What has a name and a place: a function, a class, a module."""
        if kind is BuiltinFunctionType and not isinstance(value.__self__, ModuleType):
            return None  # a method
        is_module = isinstance(value, ModuleType)
        module = value.__name__ if is_module else getattr(value, "__module__", None)
        if module is None and kind is not FunctionType:
            module = "builtins"
        if not is_of_user(module):
            return "of a package", module, None if is_module else value.__qualname__
        if id(value) in self.made.met:
            return "met", self.made.met[id(value)][0]
        self.made.met[id(value)] = len(self.made.met), value
        if kind is FunctionType:
            return self._describe_function(value)
        if isinstance(value, type):
            own = {word: part for word, part in vars(value).items() if word not in _LEFT_OUT}
            slots = (GetSetDescriptorType, MemberDescriptorType)
            parts = sorted((word, part) for word, part in own.items() if not isinstance(part, slots))
            return "class", value.__qualname__, value.__bases__, kind, parts
        if hasattr(value, "__wrapped__"):
            return "around", kind, value.__wrapped__
        raise NotCacheable(f"reads '{value.__name__}', which cannot be compared")

    def _describe_function(self, function: FunctionType) -> Any:
        codes = list(_list_fingerprint_codes(function.__code__))
        instructions = [one for code in codes for one in dis.get_instructions(code)]
        for one in instructions:
            if one.opname == "IMPORT_NAME" and is_of_user(one.argval):
                raise NotCacheable(f"imports '{one.argval}' when it is called, which is not followed")
        read = {one.argval for one in instructions if one.opname in _GLOBAL_LOADS}
        mentioned = {name for code in codes for name in code.co_names}
        self.made.add_named(read, mentioned, function.__globals__, "")
        closure = {}
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
            with suppress(ValueError):  # it has no value yet
                closure[name] = cell.cell_contents
        self.made.add_named(set(closure), mentioned, closure, "")
        self.made.add_value((function.__defaults__, function.__kwdefaults__), f"a default of '{function.__name__}'")
        return "function", function.__code__


def _list_fingerprint_codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _list_fingerprint_codes(constant)


def _describe_code(code: CodeType) -> Any:
    """What code does, not where it stands."""
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags & ~CO_NESTED)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return "code", code.co_code, code.co_exceptiontable, counts, names, code.co_consts


@cache
def is_of_user(module: str | None) -> bool:
    """Whether a module is the user's own, which may change: neither Python's nor installed."""
    package = (module or "").partition(".")[0]
    if package in sys.stdlib_module_names or package == "ss2sql":
        return False
    file = getattr(sys.modules.get(package), "__file__", None)
    return package == "__main__" or file is None or not {"site-packages", "dist-packages"} & set(Path(file).parts)
