"""A digest of a world's contents, equal for equal contents in any process."""

from __future__ import annotations

from collections.abc import Collection
from hashlib import sha256
from typing import Any

from ss2sql.language.kinds import Opaque
from ss2sql.vtables.contract import Element, Table, Where, World
from ss2sql.vtables.reading import Readings
from ss2sql.vtables.schema import get_world_tables


def digest_world(world: World, without: Collection[str] = ()) -> str:
    """A hash of all columns of all elements, except those named in `without` as "table.column".

    Raises NotImplementedError for values that have no canonical text.
    """
    readings, made = Readings(), sha256()
    for table in get_world_tables(world):
        if not isinstance(table, Table):
            continue
        reading = readings.get_reading(table)
        keys = reading.list_keys(Where())
        made.update(repr((table.name, [replace_world_elements(key) for key in keys])).encode("utf-8", "surrogatepass"))
        for name in reading.schema.kinds:
            if f"{table.name}.{name}" in without:
                continue
            read = reading.make_reader(name)
            made.update(
                repr((name, [replace_world_elements(read(key)) for key in keys])).encode("utf-8", "surrogatepass")
            )
    return made.hexdigest()


def replace_world_elements(value: Any) -> Any:
    """A value with the keys of elements in their place. Raises NotImplementedError for any other object."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return list(map(replace_world_elements, value))
    if kind is tuple:
        return tuple(map(replace_world_elements, value))
    if kind is dict:
        return [(replace_world_elements(key), replace_world_elements(part)) for key, part in value.items()]
    if isinstance(value, Element):
        return Element.__name__, value.table.name, replace_world_elements(value.key)
    kind = type(value.object) if isinstance(value, Opaque) else kind
    raise NotImplementedError(f"there is an object of the type {kind.__name__}")
