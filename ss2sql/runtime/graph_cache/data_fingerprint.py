"""What data are made of: equal digests stand for equal values of variables, tables and worlds."""

from __future__ import annotations

from hashlib import sha256
from marshal import dumps
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error
from ss2sql.language import plan
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable, fingerprint_function
from ss2sql.vtables.content_digest import replace_by_keys
from ss2sql.vtables.contract import Element, World
from ss2sql.vtables.frames.frame import Frame

if TYPE_CHECKING:
    from ss2sql.runtime.run.run_state import Run

MAX_ROWS = 200_000  # of a table or a data frame: reading and comparing them takes 0.2 s


def digest_data(value: Any, what: str) -> str:
    """The digest of a value, called `what` where it is refused with NotCacheable."""
    if isinstance(value, Frame):
        _check_row_count(value.length, what)
        value = value.make_value()
    try:
        return sha256(dumps(value, 2)).hexdigest()
    except ValueError:  # there are elements of worlds in it, which marshal does not know
        pass
    try:
        return sha256(repr(replace_by_keys(value)).encode("utf-8", "surrogatepass")).hexdigest()
    except NotImplementedError as reason:
        raise NotCacheable(f"{what} cannot be compared: {reason}") from None


def find_worlds(value: Any) -> set[World]:
    """The worlds whose elements are in a value."""
    if isinstance(value, Element):
        return {value.world}
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return set().union(*map(find_worlds, parts))


def digest_table(source: plan.TableSource, run: Run) -> str:
    """The digest of the rows of a table of the database, or of an attached file."""
    what = f"the table '{source.table}'"
    if source.table.startswith("ss2sql_"):
        raise NotCacheable(f"{what} belongs to ss2sql and changes with every run")
    rows = run.host.read_table_rows(source)
    _check_row_count(len(rows), what)
    return digest_data(list(map(list, rows)), what)


def digest_world(world: World) -> str:
    """The fingerprint of a world as it is now."""
    try:
        found = world.fingerprint()
    except Error:
        raise
    except Exception as error:  # whatever an adapter raises
        raise NotCacheable(f"{type(world).__name__} cannot be compared: {error}") from error
    kind = type(world)
    try:
        made = fingerprint_function(kind)
    except NotCacheable as reason:
        raise NotCacheable(f"{kind.__name__}, the class of a world, {reason}") from None
    return sha256(repr((made, found)).encode()).hexdigest()


def _check_row_count(rows: int, what: str) -> None:
    if rows > MAX_ROWS:
        raise NotCacheable(f"{what} has {rows:,} rows, more than the {MAX_ROWS:,} that are compared")
