"""What a Python function is made of: equal fingerprints stand for functions that compute the same.

A fingerprint takes in the code of the function, its defaults, the values of its enclosing functions and the global
names that it reads, and so on for all functions and classes of the user that it reaches. Of Python's own functions
and of packages it takes the version. What cannot be compared between two runs is refused.
"""

from __future__ import annotations

import functools
import re
import sys
from collections import Counter, OrderedDict, defaultdict, deque
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from hashlib import sha256
from inspect import CO_NESTED, getattr_static
from types import (
    BuiltinFunctionType,
    CellType,
    ClassMethodDescriptorType,
    CodeType,
    FunctionType,
    GetSetDescriptorType,
    MemberDescriptorType,
    MethodDescriptorType,
    MethodType,
    MethodWrapperType,
    ModuleType,
    WrapperDescriptorType,
)
from typing import Any, cast

from ss2sql.frontend.volatility.name_bindings import CACHE_TYPE, UNKNOWN, unwrap_callable
from ss2sql.runtime.graph_cache.bytecode_names import find_names_read
from ss2sql.runtime.graph_cache.package_versions import find_package_version
from ss2sql.runtime.graph_cache.value_json import NotCacheable

_PYTHON = f"{sys.implementation.name} {sys.version_info[:2]}"
_SCALARS = (type(None), bool, int, float, complex, str, bytes, type(...))
_REPEATED = (tuple, frozenset, CodeType)  # of which Python may make one of two equal ones
_MISSING = object()
_FINGERPRINTED_BY_REPR = (range, slice, Decimal, Fraction)  # whose representations tell all
_COLLECTIONS = (defaultdict, OrderedDict, Counter, deque)
# What every class has, and what only tells where it was written.
_OF_ALL_CLASSES = frozenset(
    {"__dict__", "__weakref__", "__module__", "__doc__", "__qualname__", "__firstlineno__", "__static_attributes__"}
)
_OF_PYTHON = frozenset({"_abc_impl", "__dataclass_fields__", "__dataclass_params__", "__annotations__"})
_BUILT_IN = (
    *(BuiltinFunctionType, MethodDescriptorType, ClassMethodDescriptorType, WrapperDescriptorType, MethodWrapperType),
)
_DESCRIPTORS = (GetSetDescriptorType, MemberDescriptorType)


def fingerprint_function(function: Callable[..., Any]) -> str:
    """The fingerprint of a function or class. Raises NotKept, with a clause whose subject it is."""
    made = Fingerprint()
    try:
        made.add(function, "itself")
    except RecursionError:
        raise NotCacheable("is nested too deeply to be compared") from None
    return made.hash.hexdigest()


class Fingerprint:
    """One fingerprint in the making. What is met a second time is named by the number of its first time."""

    def __init__(self) -> None:
        self.hash = sha256(_PYTHON.encode())
        self._numbers_by_identity: dict[int, int] = {}
        self._kept_objects: list[Any] = []

    def _note(self, *parts: object) -> None:
        text = repr(parts).encode("utf-8", "surrogatepass")
        self.hash.update(b"%d:" % len(text) + text)

    def add(self, value: Any, name: str) -> None:
        """Takes in a value, which is called `name` where it is refused."""
        kind = type(value)
        if kind in _SCALARS:
            self._note(kind.__name__, value)
            return
        if kind not in _REPEATED:
            if id(value) in self._numbers_by_identity:
                self._note("met", self._numbers_by_identity[id(value)])
                return
            self._numbers_by_identity[id(value)] = len(self._numbers_by_identity)
            self._kept_objects.append(value)
        if kind in (list, tuple):
            self._note(kind.__name__, len(value))
            for part in value:
                self.add(part, name)
        elif kind is dict:
            self._note("dict", len(value))
            for key, part in value.items():
                self.add(key, name)
                self.add(part, name)
        elif kind in (set, frozenset):
            self._note(kind.__name__, sorted(self._fingerprint_alone(part, name) for part in value))
        elif kind is CodeType:
            self._add_code(value)
        else:
            self._other(value, kind, name)

    def _fingerprint_alone(self, value: Any, name: str) -> str:
        """The fingerprint of a value for itself: sets have no order."""
        other = Fingerprint()
        other.add(value, name)
        return other.hash.hexdigest()

    def _other(self, value: Any, kind: type, name: str) -> None:
        """Functions, classes, modules and objects."""
        if kind is FunctionType:
            self._function(value)
        elif kind is MethodType:
            self._parts("method", name, value.__func__, value.__self__)
        elif kind is functools.partial:
            self._parts("partial", name, value.func, value.args, value.keywords)
        elif kind is CACHE_TYPE and unwrap_callable(value) is not UNKNOWN:
            self._parts("cached", name, unwrap_callable(value))
        elif kind in (staticmethod, classmethod):
            self._parts(kind.__name__, name, value.__func__)
        elif kind is property:
            self._parts("property", name, value.fget, value.fset, value.fdel)
        elif isinstance(value, ModuleType):
            self._module(value, name)
        elif isinstance(value, type):
            self._add_class(value, name)
        elif isinstance(value, _BUILT_IN):
            self._add_built_in(value, name)
        else:
            self._add_object(value, kind, name)

    def _add_object(self, value: Any, kind: type, name: str) -> None:
        """Objects whose values can be told."""
        if isinstance(value, Enum):
            self._parts("enum", name, kind, value.name)
        elif is_dataclass(value):
            self._parts("dataclass", name, kind, *(getattr(value, one.name) for one in fields(value)))
        elif kind in _FINGERPRINTED_BY_REPR:
            self._note(kind.__name__, repr(value))
        elif kind is re.Pattern:
            self._note("pattern", value.pattern, value.flags)
        elif kind in _COLLECTIONS:
            items = list(value.items()) if isinstance(value, dict) else list(value)
            self._parts(kind.__name__, name, items, getattr(value, "default_factory", None))
        elif isinstance(value, tuple):
            self._parts("tuple", name, kind, *value)
        elif _is_array(value):
            self._note("array", str(value.dtype), value.shape, sha256(value.tobytes()).hexdigest())
        elif (place := _find_package_place(value)) is not None:
            self._note("of a package", place)
        else:
            raise NotCacheable(f"reads {name}, an object of the type {kind.__name__}, which cannot be compared")

    def _parts(self, what: str, name: str, *parts: Any) -> None:
        self._note(what, len(parts))
        for part in parts:
            self.add(part, name)

    # --- functions -------------------------------------------------------------------------------------

    def _function(self, function: FunctionType) -> None:
        home = find_package_version(function.__module__)
        if home is not None:
            self._note("function", home, function.__module__, function.__qualname__)
            return
        self._note("function")
        self._add_code(function.__code__)
        name = function.__name__
        self.add(function.__defaults__, f"a default of '{name}'")
        self.add(function.__kwdefaults__, f"a default of '{name}'")
        closure = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
        builtins = cast(Any, function).__builtins__
        code = function.__code__
        for free, names in sorted(set(find_names_read(code, code.co_freevars))):
            first = names[0]
            if free:
                self._name(names, _read_cell(closure[first]), f"the variable '{first}' of an enclosing function")
            else:
                namespace = function.__globals__
                self._name(
                    names, namespace[first] if first in namespace else builtins.get(first, _MISSING), f"'{first}'"
                )

    def _add_code(self, code: CodeType) -> None:
        """What code does, not where it stands."""
        counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags & ~CO_NESTED)
        names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
        self._note("code", code.co_code, code.co_exceptiontable, counts, names, len(code.co_consts))
        for constant in code.co_consts:
            self.add(constant, "a constant")

    def _name(self, names: tuple[str, ...], value: Any, shown: str) -> None:
        """A name from outside, and the names behind it: of a module of the user what is read counts, not the rest."""
        self._note("name", names)
        for attribute in names[1:]:
            if not isinstance(value, ModuleType) or find_package_version(value.__name__) is not None:
                break
            shown = f"'{value.__name__}.{attribute}'"
            value = getattr(value, attribute, _MISSING)
        if value is _MISSING:
            raise NotCacheable(f"reads {shown}, which has no value yet")
        self.add(value, shown)

    def _add_built_in(self, value: Any, name: str) -> None:
        owner = getattr(value, "__self__", None)
        if owner is None or isinstance(owner, (ModuleType, type)):
            module = getattr(value, "__module__", None)
            module = module or getattr(owner or value.__objclass__, "__module__", "builtins")
            home = find_package_version(module)
            if home is None:
                raise NotCacheable(f"calls {name}, which has no Python source")
            self._note("built in", home, module, value.__qualname__)
        else:
            self._note("method", value.__name__)
            self.add(owner, name)

    # --- modules and classes ---------------------------------------------------------------------------

    def _module(self, module: ModuleType, name: str) -> None:
        home = find_package_version(module.__name__)
        if home is None:
            raise NotCacheable(f"reads {name}, a module as a whole, which cannot be compared")
        self._note("module", module.__name__, home)

    def _add_class(self, kind: type, name: str) -> None:
        home = find_package_version(kind.__module__)
        self._note("class", kind.__qualname__, home)
        if home is not None:
            self._note(kind.__module__)
            return
        for base in kind.__bases__:
            self.add(base, name)
        self.add(type(kind), name)
        if is_dataclass(kind):
            for one in fields(kind):
                self._note("field", one.name, one.init, one.compare)
                for given in (one.default, one.default_factory):
                    if given is not MISSING:
                        self.add(given, f"{name}.{one.name}")
        if issubclass(kind, Enum):
            for word, member in kind.__members__.items():
                self._note("member", word)
                self.add(member.value, f"{name}.{word}")
        for word in sorted(vars(kind).keys() - _OF_ALL_CLASSES - _OF_PYTHON):
            value = getattr_static(kind, word)
            if not _is_made_by_python(kind, word, value):
                self._note("attribute", word)
                self.add(value, f"{name}.{word}")


def _is_array(value: Any) -> bool:
    """Whether it is an array or a number of NumPy."""
    numpy = sys.modules.get("numpy")  # where nobody imported NumPy, there is nothing of it
    if numpy is None:
        return False
    return (type(value) is numpy.ndarray or isinstance(value, numpy.generic)) and not value.dtype.hasobject


def _find_package_place(value: Any) -> tuple[str, ...] | None:
    """Where in an installed package an object lies, with the package's version; None where it lies in none."""
    module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if module is None and type(value).__module__ == "numpy":  # its mathematical functions do not know where they are
        module = "numpy"
    if not isinstance(module, str) or not isinstance(name, str):
        return None
    home = find_package_version(module)
    return (home, module, name) if home and getattr(sys.modules.get(module), name, None) is value else None


def _is_made_by_python(kind: type, word: str, value: Any) -> bool:
    """Whether an attribute of a class follows from the others: slots, members of an Enum, methods of a dataclass."""
    if isinstance(value, (*_DESCRIPTORS, Enum)):
        return True
    if issubclass(kind, Enum) and word.startswith("_"):
        return not isinstance(value, FunctionType)
    return is_dataclass(kind) and isinstance(value, FunctionType) and value.__code__.co_filename == "<string>"


def _read_cell(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:
        return _MISSING
