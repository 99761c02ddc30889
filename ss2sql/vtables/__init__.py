"""Python's objects as tables: adapters of simulators, frames and other sources, and what a query reads of them.

contract is what an adapter declares, schema checks it; attached_worlds is what a session makes of it. reading is what
one query reads. body_functions serves all simulators.
`find_adapter` finds the adapter of an object by its type.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from functools import lru_cache
from importlib import import_module
from types import NoneType
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.frontend.resolve.from_clause import ATTACHED, find_file_ending, suggest_source
from ss2sql.vtables.contract import Column as Column
from ss2sql.vtables.contract import Element as Element
from ss2sql.vtables.contract import Gone as Gone
from ss2sql.vtables.contract import Table as Table
from ss2sql.vtables.contract import TableFunction as TableFunction
from ss2sql.vtables.contract import Where as Where
from ss2sql.vtables.contract import World as World
from ss2sql.vtables.contract import function as function

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINTS = "ss2sql.worlds"  # of entry points: the name is that of a type, "module.Class", the value its adapter

# Adapters that ship with the package, by the type that they serve, imported on demand.
SHIPPED_ADAPTERS: dict[str, str] = {
    "pybullet_utils.bullet_client.BulletClient": "ss2sql.vtables.pybullet:PyBulletWorld",
    "ss2sql.vtables.pybullet.scene.Scene": "ss2sql.vtables.pybullet:PyBulletWorld",
    "mujoco._structs.MjData": "ss2sql.vtables.mujoco:MuJoCoWorld",
    "ode.SpaceBase": "ss2sql.vtables.ode:OdeWorld",
    **dict.fromkeys(
        (
            "openravepy.openravepy_int.Environment",
            "openravepy._openravepy_.openravepy_int.Environment",
            "openravepy._openravepy_0_9.openravepy_int.Environment",
            "openravepy_int.Environment",
        ),
        "ss2sql.vtables.openrave:OpenRaveWorld",
    ),
}

PYBULLET_CLIENTS = 1024  # PyBullet's own limit; its functions fail for numbers beyond 32 bits

_registered: dict[str, type[World]] = {}


def register_world(adapter: type[World]) -> type[World]:
    """Makes an adapter known for the types that it `serves`; also a decorator of its class."""
    for name in adapter.serves:
        _registered[name] = adapter
    _find_adapter_type.cache_clear()
    return adapter


def list_adapter_types() -> tuple[str, ...]:
    """The names of the types that have adapters."""
    return tuple(sorted({*_registered, *SHIPPED_ADAPTERS, *(point.name for point in _list_entry_points())}))


def _list_entry_points() -> Iterable[EntryPoint]:
    from importlib.metadata import entry_points  # 10 ms, for sessions with worlds only

    return entry_points(group=ENTRY_POINTS)


def find_adapter(source: Any) -> World | None:
    """The world for an object: itself, what its method `__world__` gives, or by the adapter for its type; else None."""
    if isinstance(source, World):
        return source
    own = getattr(type(source), "__world__", None)
    if own is not None:
        world = own(source)
        if not isinstance(world, World):
            raise SessionError("S002", f"{type(source).__name__}.__world__ gives a {type(world).__name__}, not a World")
        return world
    kind: Any = type(source)
    adapter = _find_adapter_type(kind)
    return None if adapter is None else adapter(source)


def has_adapter(value: Any) -> bool:
    """Whether an object is a world, or of a type that has an adapter; the adapter is not made."""
    kind: Any = type(value)
    return issubclass(kind, World) or hasattr(kind, "__world__") or _find_adapter_type(kind) is not None


@lru_cache(1000)
def _find_adapter_type(kind: type) -> type[World] | None:
    """The adapter for a type, cached: reading entry points takes 10 ms, and FROM may walk many objects."""
    names = [f"{one.__module__}.{one.__qualname__}" for one in kind.__mro__[:-1]]  # the type's own first
    for name in names:
        if name in _registered:
            return _registered[name]
        if name in SHIPPED_ADAPTERS:
            return _load_adapter(SHIPPED_ADAPTERS[name])
    if kind.__module__ in ("builtins", "numpy"):
        return None
    found: Iterator[type[World]] = (point.load() for point in _list_entry_points() if point.name in names)
    return next(found, None)


def _load_adapter(place: str) -> type[World]:
    module, _, name = place.partition(":")
    adapter: type[World] = getattr(import_module(module), name)
    return adapter


def make_attachable(name: str, source: Any) -> Any:
    """The object to attach for `source`: an iterator becomes a list, a number may mean a client of PyBullet.

    Raises SessionError S002 for the path of a file that cannot be attached.
    """
    ending = find_file_ending(source)
    if ending is not None and ending not in ATTACHED:
        path = os.fspath(source)
        raise SessionError(
            "S002", f"a file {ending} cannot be attached by its path", hints=(suggest_source(path, name),)
        )
    pybullet = sys.modules.get("pybullet")  # without this import there are no clients
    if pybullet is not None and (source is pybullet or (type(source) is int and 0 <= source < PYBULLET_CLIENTS)):
        number = 0 if source is pybullet else source  # the default client of its functions
        if pybullet.getConnectionInfo(number)["isConnected"]:
            return _load_adapter(SHIPPED_ADAPTERS["ss2sql.vtables.pybullet.scene.Scene"])(number)
    from ss2sql.language.conversion import is_iterator_value

    return list(source) if is_iterator_value(source) else source


def refuse_without_adapter(source: Any) -> None:
    """Raises SessionError S002 for an object that is no value and has no columns, as it probably lacks an adapter."""
    from ss2sql.language.conversion import convert_value

    kind = type(source)
    if kind in (list, tuple, dict) or is_dataclass(source):
        return
    try:
        plain = convert_value(source, "the source")
    except ExecutionError:
        return  # reading it raises the error
    if isinstance(plain, (bool, int, float, str, list, dict, bytes, NoneType)):
        return
    known = ", ".join(list_adapter_types())
    hints = (
        "what can be attached: lists, dicts of columns, data frames, numbers, texts and other values, worlds, paths of"
        " SQLite files" + (f", objects of the types {known}" if known else ""),
        "write an adapter, a class derived from ss2sql.World; or make it a variable with session.set",
    )
    raise SessionError("S002", f"a {kind.__module__}.{kind.__qualname__} cannot be attached", hints=hints)
