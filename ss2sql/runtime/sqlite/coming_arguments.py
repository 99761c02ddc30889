"""The arguments that are coming: blocks for functions that take arrays, made of what the scouts of a query give.

A scout runs in step with its query. It is read when a call comes whose arguments are not known yet, and no further
than a block reaches; what it gives is sorted by the kinds of the arguments, so that a block has numbers of one kind
in a column and the values of a function do not depend on the rows beside its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping
from itertools import islice
from typing import Any, Protocol, TypeAlias

from ss2sql.runtime.sqlite.call_sites import Site

BLOCK = 8_192  # rows of a block: NumPy's 20 us for a call are then 2 ns for a row
FIRST = 16  # of a query that may end early
SCAN = 4 * BLOCK  # rows of a scout that are looked at for one block, where conditions call such functions, too
ROOM = 4 * SCAN  # what memories of calls have to hold, so that no result is forgotten before its row comes
PATIENCE = 100  # calls that a scout has not foretold before it gives up what it holds

Arguments: TypeAlias = tuple[Any, ...]
Kinds: TypeAlias = tuple[type, ...]
Row: TypeAlias = tuple[Any, Arguments]  # of a block: the key of the arguments, and they themselves
Rows: TypeAlias = Generator[tuple[Any, ...], None, None]


class Asker(Protocol):
    """The function for which blocks are made, as an executor calls it."""

    name: str

    @property
    def remembered_results(self) -> Mapping[Any, Any]:
        """What is remembered of it, by the keys of arguments."""

    def key(self, arguments: Arguments) -> Any:
        """Equal for arguments that are exactly the same."""

    def kinds(self, arguments: Arguments) -> Kinds:
        """For each argument float, int, bool, or object for all else."""

    def may_remember(self, arguments: Arguments) -> bool:
        """Whether it may remember what it gives for the arguments."""


class Chunk:
    """Arguments in their order, by kinds."""

    def __init__(self, asker: Asker) -> None:
        self.asker = asker
        self.lanes: dict[Kinds, tuple[list[Row], dict[Any, int]]] = {}
        self.size = 0

    def add(self, key: Any, arguments: Arguments) -> None:
        kinds = self.asker.kinds(arguments)
        if object in kinds and not self.asker.may_remember(arguments):
            return
        lane = self.lanes.get(kinds)
        if lane is None:
            lane = self.lanes[kinds] = [], {}
        rows, index = lane
        if key not in index:
            index[key] = len(rows)
            rows.append((key, arguments))
            self.size += 1

    def after(self, key: Any, kinds: Kinds) -> Iterator[Row] | None:
        """What follows the arguments with this key, of the same kinds; None where they are not among them."""
        lane = self.lanes.get(kinds)
        place = None if lane is None else lane[1].get(key)
        return None if lane is None or place is None else islice(lane[0], place + 1, None)


class Coming(ABC):
    """The arguments of one call in the script; `size` is that of the next block, which shrinks where blocks fail."""

    def __init__(self, site: Site, asker: Asker, rows: Rows, first: int) -> None:
        self.site = site
        self.asker = asker
        self.rows = rows
        self.size = self.reach = first
        self.busy = False

    def block(self, key: Any, arguments: Arguments) -> list[Row] | None:
        """The arguments, and those that come after them and are not known; None where they were not foretold."""
        if self.busy:  # the scout itself asks
            return None
        self.busy = True
        try:
            following = self.following(key, arguments)
        finally:
            self.busy = False
        if following is None:
            return None
        remembered_results = self.asker.remembered_results
        return [
            (key, arguments),
            *islice((row for row in following if row[0] not in remembered_results), self.size - 1),
        ]

    @abstractmethod
    def following(self, key: Any, arguments: Arguments) -> Iterator[Row] | None:
        """The rows after these arguments, as far as they are foretold; None where these arguments were not."""

    def note(self, failed: bool, number: int) -> None:
        """Takes note of what became of a block of this many rows."""
        self.size = max(1, min(self.size, number) // 8) if failed else min(BLOCK, 4 * self.size)


class InStep(Coming):
    """Those of a call in a flat query: its scout is read as the query goes on."""

    def __init__(self, site: Site, asker: Asker, rows: Rows, first: int) -> None:
        super().__init__(site, asker, rows, first)
        self.chunks: list[Chunk] = []
        self.missed = 0

    def following(self, key: Any, arguments: Arguments) -> Iterator[Row] | None:
        kinds = self.asker.kinds(arguments)
        for number in range(2):
            if number == len(self.chunks):
                self.chunks.append(self._read())
            found = self.chunks[number].after(key, kinds)
            if found is not None:
                del self.chunks[:number]
                return found
        self.missed += 1
        if self.missed % PATIENCE == 0:
            del self.chunks[0]
        return None

    def _read(self) -> Chunk:
        """The next arguments that are not known."""
        chunk, key_of, remembered_results = Chunk(self.asker), self.asker.key, self.asker.remembered_results
        ended = False
        while not chunk.size and not ended:
            ended = True
            for row in islice(self.rows, SCAN):
                ended = False
                if row[0]:
                    arguments = row[1:]
                    key = key_of(arguments)
                    if key not in remembered_results:
                        chunk.add(key, arguments)
                        if chunk.size >= self.reach:
                            break
        self.reach = min(BLOCK, 4 * self.reach)
        return chunk


class EachState(Coming):
    """Those of a call in a search: the elements, with what the call has of the state."""

    chunk: Chunk | None = None

    def following(self, key: Any, arguments: Arguments) -> Iterator[Row] | None:
        asker = self.asker
        if self.chunk is None:
            self.chunk = Chunk(asker)
            for row in islice(self.rows, SCAN):
                self.chunk.add(asker.key(row[1:]), row[1:])
        own = tuple(arguments[position] for position in self.site.free)
        found = self.chunk.after(asker.key(own), asker.kinds(own))
        return None if found is None else self._merged(arguments, found)

    def _merged(self, arguments: Arguments, found: Iterator[Row]) -> Iterator[Row]:
        merged = list(arguments)
        for _, other in found:
            for position, value in zip(self.site.free, other, strict=True):
                merged[position] = value
            row = tuple(merged)
            yield self.asker.key(row), row


class Ahead:
    """What is coming in one run of a query. `rows` starts a scout; None where it cannot run."""

    def __init__(self, sites: tuple[Site, ...], rows: Callable[[Site], Rows | None], may_end_early: bool) -> None:
        self.sites = sites
        self.rows = rows
        self.first = FIRST if may_end_early else BLOCK
        self.coming: dict[Site, Coming | None] = {}

    def block(self, asker: Asker, key: Any, arguments: Arguments) -> tuple[Coming | None, list[Row]]:
        """A block for a call of the function, which begins with these arguments, and where it is from."""
        for site in self.sites:
            if site.function == asker.name:
                if site not in self.coming:
                    self.coming[site] = self._begun(site, asker)
                coming = self.coming[site]
                block = None if coming is None else coming.block(key, arguments)
                if block is not None:
                    return coming, block
        return None, [(key, arguments)]

    def _begun(self, site: Site, asker: Asker) -> Coming | None:
        rows = self.rows(site)
        if rows is None:
            return None
        return (EachState if site.repeats else InStep)(site, asker, rows, self.first)

    def close(self) -> None:
        for coming in self.coming.values():
            if coming is not None:
                coming.rows.close()
