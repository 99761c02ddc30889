"""Python objects as virtual tables of SQLite: lists (vtables/sequences.py), and worlds.

For worlds, in the order of reading: vtables/base.py is the contract of adapters, vtables/schema.py checks their
declarations, vtables/attached.py holds the worlds of a session, vtables/reading.py reads for one query,
vtables/module.py serves SQLite, vtables/conformance.py tests adapters. `adapter_of` finds an object's adapter.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from dataclasses import is_dataclass
from functools import lru_cache
from importlib import import_module
from types import NoneType
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.vtables.base import Column as Column
from ss2sql.vtables.base import Element as Element
from ss2sql.vtables.base import Gone as Gone
from ss2sql.vtables.base import Table as Table
from ss2sql.vtables.base import TableFunction as TableFunction
from ss2sql.vtables.base import Where as Where
from ss2sql.vtables.base import World as World
from ss2sql.vtables.base import function as function
from ss2sql.vtables.files import ATTACHED, cure_for, ending_of

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "ss2sql.worlds"  # of entry points: the name is that of a type, "module.Class", the value its adapter

# Adapters that ship with the package, by the type that they serve, imported on demand.
SHIPPED: dict[str, str] = {
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
    _has_adapter.cache_clear()
    return adapter


def known_types() -> tuple[str, ...]:
    """The names of the types that have adapters."""
    return tuple(sorted({*_registered, *SHIPPED, *(point.name for point in _entry_points())}))


def _entry_points() -> Iterable[EntryPoint]:
    from importlib.metadata import entry_points  # 10 ms, for sessions with worlds only

    return entry_points(group=GROUP)


def adapter_of(source: Any) -> World | None:
    """The world for an object: itself, what its method `__world__` gives, or by the adapter for its type; else None."""
    if isinstance(source, World):
        return source
    own = getattr(type(source), "__world__", None)
    if own is not None:
        world = own(source)
        if not isinstance(world, World):
            raise SessionError("S002", f"{type(source).__name__}.__world__ gives a {type(world).__name__}, not a World")
        return world
    names = _names_of(type(source))
    for name in names:
        if name in _registered:
            return _registered[name](source)
        if name in SHIPPED:
            return _loaded(SHIPPED[name])(source)
    if type(source).__module__ in ("builtins", "numpy"):
        return None
    for point in _entry_points():
        if point.name in names:
            adapter: type[World] = point.load()
            return adapter(source)
    return None


def _loaded(place: str) -> type[World]:
    module, _, name = place.partition(":")
    adapter: type[World] = getattr(import_module(module), name)
    return adapter


def has_adapter(value: Any) -> bool:
    """Whether an object is a world, or of a type that has an adapter; the adapter is not made."""
    kind: Any = type(value)
    return _has_adapter(kind)


@lru_cache(1000)
def _has_adapter(kind: type) -> bool:
    """The same for a type, cached: reading entry points takes 10 ms, and FROM may walk many objects."""
    if issubclass(kind, World) or hasattr(kind, "__world__"):
        return True
    return kind.__module__ not in ("builtins", "numpy") and not set(known_types()).isdisjoint(_names_of(kind))


def _names_of(kind: type) -> list[str]:
    """The names by which adapters say that they serve a type, its own first."""
    return [f"{one.__module__}.{one.__qualname__}" for one in kind.__mro__[:-1]]


def attachable(name: str, source: Any) -> Any:
    """The object to attach for `source`: an iterator becomes a list, a number may mean a client of PyBullet.

    Raises SessionError S002 for the path of a file that cannot be attached.
    """
    ending = ending_of(source)
    if ending is not None and ending not in ATTACHED:
        path = os.fspath(source)
        raise SessionError("S002", f"a file {ending} cannot be attached by its path", hints=(cure_for(path, name),))
    pybullet = sys.modules.get("pybullet")  # without this import there are no clients
    if pybullet is not None and (source is pybullet or (type(source) is int and 0 <= source < PYBULLET_CLIENTS)):
        number = 0 if source is pybullet else source  # the default client of its functions
        if pybullet.getConnectionInfo(number)["isConnected"]:
            return _loaded(SHIPPED["ss2sql.vtables.pybullet.scene.Scene"])(number)
    from ss2sql.runtime.border import is_read_once

    return list(source) if is_read_once(source) else source


def refuse_unknown(source: Any) -> None:
    """Raises SessionError S002 for an object that is no value and has no columns, as it probably lacks an adapter."""
    from ss2sql.runtime.border import normalise

    kind = type(source)
    if kind in (list, tuple, dict) or is_dataclass(source):
        return
    try:
        plain = normalise(source, "the source")
    except ExecutionError:
        return  # reading it raises the error
    if isinstance(plain, (bool, int, float, str, list, dict, bytes, NoneType)):
        return
    known = ", ".join(known_types())
    hints = (
        "what can be attached: lists, dicts of columns, data frames, numbers, texts and other values, worlds, paths of"
        " SQLite files" + (f", objects of the types {known}" if known else ""),
        "write an adapter, a class derived from ss2sql.World; or make it a variable with session.set",
    )
    raise SessionError("S002", f"a {kind.__module__}.{kind.__qualname__} cannot be attached", hints=hints)
