"""Fetching groups of columns: element by element, in blocks that grow, or as whole arrays."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Error
from ss2sql.vtables.contract import Table
from ss2sql.vtables.schema import AdapterGuard, make_adapter_error

if TYPE_CHECKING:
    from ss2sql.vtables.reading import Reading

Values: TypeAlias = tuple[Any, ...]
Fetch: TypeAlias = Callable[[Any], Values]
LARGEST_BLOCK = 64  # elements: their data are still in the processor's cache when the next group is fetched


def make_fetcher(reading: Reading, table: Table, group: str, rows: dict[Hashable, Values]) -> Fetch:
    """A function that fetches a group of the element with a key, and stores its values in `rows`."""
    method = getattr(table, group)
    if group in reading.schema.arrays:
        return _fetch_all(reading, group, method, rows)
    if group in reading.schema.blocks:
        return BlockFetcher(reading, group, method, rows).fetch_key
    return _fetch_singly(reading, group, method, rows)


def _fetch_singly(reading: Reading, group: str, method: Callable[[Any], Any], rows: dict[Hashable, Values]) -> Fetch:
    schema = reading.schema
    fits = schema.make_row_test(group)

    def fetch_key(key: Hashable) -> Values:
        try:
            row: Values = method(key)
            if type(row) is not tuple or not fits(row):
                row = schema.convert_row(group, row)
            rows[key] = row
        except Error as error:
            raise error.with_span(reading.span) from error.__cause__
        except Exception as error:
            raise make_adapter_error(schema, error, key).with_span(reading.span) from error
        return row

    return fetch_key


def _fetch_all(reading: Reading, group: str, method: Callable[[Any], Any], rows: dict[Hashable, Values]) -> Fetch:
    """Fetches the group for all keys that were given last."""
    schema = reading.schema

    def fetch_key(key: Hashable) -> Values:
        wanted = [one for one in reading.announced if one not in rows]
        if key not in wanted:
            wanted = [key]
        with AdapterGuard(schema, span=reading.span):
            raw = method(wanted)
            rows.update(zip(wanted, schema.split_arrays(group, raw, wanted), strict=True))
        return rows[key]

    return fetch_key


class BlockFetcher:
    """Fetches the next elements along with the one that is wanted.

    The first block is one element. As long as the query reads one element after the other, each block is twice as long
    as the one before; where it skips some, blocks start with one again. So at most about twice the elements that are
    read are fetched, and exactly three for `LIMIT 3`.
    """

    def __init__(
        self, reading: Reading, group: str, method: Callable[[Any], Any], rows: dict[Hashable, Values]
    ) -> None:
        self.reading = reading
        self.method = method
        self.rows = rows
        self.single = len(reading.schema.groups[group].parts) == 1  # a block of values, not of tuples
        self.first_fits, self.fit = reading.schema.make_row_test(group), reading.schema.get_block_test(group)
        self.alone = _fetch_singly(reading, group, self._fetch_single, rows)
        self.keys: Sequence[Hashable] = ()  # that were given when the last block was fetched
        self.end = 0  # of the last block
        self.size = 1

    def fetch_key(self, key: Hashable) -> Values:
        block = self._choose_block(key)
        if len(block) > 1:
            try:
                found = self.method(block)
                if self.single:
                    found = list(zip(islice(found, len(block) + 1), strict=True))
                if len(found) == len(block) and self.first_fits(found[0]) and self.fit(found):
                    if self.reading.once:  # reused memory is still in the cache: a scan takes 20 % less
                        self.rows.clear()
                    self.rows.update(zip(block, found, strict=True))
                    return self.rows[key]
            except Exception:
                pass  # perhaps of an element that the query never reads; else it is raised again below
            self.size = 1
        return self.alone(key)

    def _choose_block(self, key: Hashable) -> Sequence[Hashable]:
        keys, place = self.reading.announced, self.end
        if len(keys) == 1:
            return keys
        if keys is self.keys and place < len(keys) and keys[place] == key:
            self.size = min(2 * self.size, LARGEST_BLOCK)
        else:
            self.size = 1
            try:
                place = keys.index(key, place if keys is self.keys else 0)
            except ValueError:
                return (key,)
            self.keys = keys
        self.end = place + self.size
        block = keys[place : self.end]
        return block if self.rows.keys().isdisjoint(block) else [one for one in block if one not in self.rows]

    def _fetch_single(self, key: Hashable) -> Any:
        (row,) = self.method([key])
        return row
