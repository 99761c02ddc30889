"""A digest of a world's contents, equal for equal contents in any process."""

from __future__ import annotations

from collections.abc import Collection
from hashlib import sha256
from typing import Any

from ss2sql.language.value_messages import format_value
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
        made.update(repr((table.name, [_replace_by_keys(key) for key in keys])).encode("utf-8", "surrogatepass"))
        for name in reading.schema.kinds:
            if f"{table.name}.{name}" in without:
                continue
            read = reading.make_reader(name)
            made.update(repr((name, [_replace_by_keys(read(key)) for key in keys])).encode("utf-8", "surrogatepass"))
    return made.hexdigest()


def _replace_by_keys(value: Any) -> Any:
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return list(map(_replace_by_keys, value))
    if kind is tuple:
        return tuple(map(_replace_by_keys, value))
    if kind is dict:
        return [(_replace_by_keys(key), _replace_by_keys(part)) for key, part in value.items()]
    if isinstance(value, Element):
        return value.table.name, _replace_by_keys(value.key)
    raise NotImplementedError(f"{format_value(value)} is an object")
