"""The names from outside that Python code reads, found in its bytecode."""

from __future__ import annotations

import dis
from collections.abc import Iterator
from types import CodeType

from ss2sql.runtime.graph_cache.package_versions import find_package_version
from ss2sql.runtime.graph_cache.value_json import NotCacheable

_GLOBAL_LOADS = frozenset({"LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"})
_LOADS = _GLOBAL_LOADS | {"LOAD_DEREF", "LOAD_CLASSDEREF", "LOAD_FROM_DICT_OR_DEREF"}


def find_names_read(code: CodeType, enclosing: tuple[str, ...]) -> Iterator[tuple[bool, tuple[str, ...]]]:
    """The names from outside that code reads, with the attributes that it asks them for at once.

    With each comes whether it is a variable of an enclosing function, one of `enclosing`. Raises NotKept for code that
    changes a name from outside, or imports a module of the user.
    """
    chain: list[str] = []
    free = False
    for instruction in dis.get_instructions(code):
        name = str(instruction.argval)
        outside = name in enclosing and name in code.co_freevars
        match instruction.opname:
            case "CACHE" | "EXTENDED_ARG":
                continue
            case "LOAD_ATTR" | "LOAD_METHOD" if chain:
                chain.append(name)
                continue
            case "STORE_GLOBAL" | "DELETE_GLOBAL":
                raise NotCacheable(f"changes the global name '{name}'")
            case "STORE_DEREF" | "DELETE_DEREF" if outside:
                raise NotCacheable(f"changes the variable '{name}' of an enclosing function")
            case "IMPORT_NAME" if find_package_version(name) is None:
                raise NotCacheable(f"imports '{name}' when it is called, which is not followed")
        if chain:
            yield free, tuple(chain)
        chain = []
        if instruction.opname in _LOADS and (instruction.opname in _GLOBAL_LOADS or outside):
            free = instruction.opname not in _GLOBAL_LOADS
            chain = [name]
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from find_names_read(constant, enclosing)
