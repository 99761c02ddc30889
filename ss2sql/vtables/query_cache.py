"""The query caches of worlds: `World.memory`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from ss2sql.vtables.contract import World

QueryCache: TypeAlias = dict[World, dict[str, Any]]


class QueryCaches:
    """The caches of a session's worlds, for each running query; the innermost is the last.

    A query that may move worlds itself, and a call outside of queries, have to read the present world: None stands for
    that, and every call then starts with an empty cache.
    """

    def __init__(self) -> None:
        self._queries: list[QueryCache | None] = [None]

    @contextmanager
    def begin_query(self, moves: bool) -> Iterator[None]:
        """The duration of a query."""
        self._queries.append(None if moves else {})
        try:
            yield
        finally:
            self._queries.pop()

    @property
    def now(self) -> QueryCache | None:
        """The caches of the running query."""
        return self._queries[-1]

    def get_cache(self, world: World) -> dict[str, Any]:
        """The cache for a call of a function."""
        known = self._queries[-1]
        return {} if known is None else known.setdefault(world, {})


class CacheOfQuery:
    """A context in which a world has this cache. It takes 0.2 us, a third of a generator's time."""

    __slots__ = ("memory", "outer", "world")

    def __init__(self, world: World, memory: dict[str, Any]) -> None:
        self.world = world
        self.memory = memory

    def __enter__(self) -> None:
        self.outer = self.world.remembered
        self.world.remembered = self.memory

    def __exit__(self, *_: object) -> None:
        self.world.remembered = self.outer
