"""How large the values are that a script makes, and the limit on it.

Values are shared, so what a script makes can be far larger than the memory that it takes: `l = [l, l]`, forty times.
Who prints, compares or copies such a value never comes to an end. So a value is measured where it is made. What
Python gives is taken as it is.

The size of a text is the bytes of its UTF-8. That of a list or dict is 8 for each value inside, at any depth, and 1 for
each character of the texts among them; a list or dict of at most 16 values has room.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.cancellation import ITEMS_PER_CHECK
from ss2sql.language.conversion import DEPTH_LIMIT, build_depth_error
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.operations.lists import RANGE_LIMIT, make_range, zip_lists
from ss2sql.language.operations.operators import add_values
from ss2sql.language.operations.strings import join_list, replace_text
from ss2sql.language.rows import build_row_limit_error

MAX_SIZE = 10**9  # what SQLite allows a text at most
MIN_REMEMBERED_LIMIT = 2**18  # the length of a script, so of the texts in it
CELL_SIZE = 8  # bytes of a value inside of a list
SMALL_LENGTH = 16  # values in a list
LARGE_SIZE = 1024  # lists of this size are measured once
HUGE_SIZE = 2**20  # to make a value of this size takes as long as a few thousand steps
# Methods that stand in for built-in functions, since they know the size of the value before it is made.
MEASURED_FUNCTIONS = {
    "add": "add_values",
    "zip": "zip_lists",
    "range": "list_range",
    "replace": "replace_text",
    "join": "join_texts",
}

Measure = tuple[int, int]  # size and depth
_NESTING = frozenset({list, tuple, dict})  # tuples are rows


class ValueSizes:
    """Measures values for one run, and remembers the sizes of lists: of large ones, as long as `limit` has room.

    `pause` is called, where there is one, whenever a huge one was made, for one step may make many.
    """

    __slots__ = ("_held", "_known", "cells", "limit", "pause", "plain", "refused", "rows")

    def __init__(self, limit: int = MAX_SIZE) -> None:
        self.limit = limit
        self.plain = limit // 4  # characters of a text that fits whatever they are
        self.cells = limit // CELL_SIZE  # numbers of a list that fits
        self.rows: int | None = None  # of the query that gives a value
        self.refused: Exception | None = None  # where it was found out, it could not be raised
        self.pause: Callable[[], None] | None = None
        self._known: dict[int, tuple[Any, Measure]] = {}  # by identity; the value itself keeps it from being given away
        self._held = 0

    # --- what values are made with -------------------------------------------------------------------------

    def check_value(self, value: Any) -> Any:
        """The value, which was made just now. Raises ExecutionError X014 if it is too large, X004 if it is too deep."""
        kind = type(value)
        if kind is str:
            if len(value) > self.plain and len(value.encode("utf-8", "surrogatepass")) > self.limit:
                raise self.build_size_error("a text")
        elif (kind is dict or kind is list) and not _is_small_value(value):
            self._check_measure(value, self._measure_value([value]))
        return value

    def add_values(self, left: Any, right: Any) -> Any:
        """`left + right`."""
        if type(left) is list and type(right) is list:
            result = left + right
            if len(result) > SMALL_LENGTH:
                (size, depth), (more, other) = self._measure_value([left]), self._measure_value([right])
                self._check_measure(result, (size + more, max(depth, other)))
                return result
            return result if _NESTING.isdisjoint(map(type, result)) else self.check_value(result)
        return self.check_value(add_values(left, right))

    def zip_lists(self, *lists: Any) -> Any:
        """`zip(a, b)`."""
        if not all(type(items) is list for items in lists):
            return zip_lists(*lists)  # which refuses it
        length = min(map(len, lists))
        self.check_room(CELL_SIZE * (len(lists) + 1) * length)
        measures = [self._measure_value([items if len(items) == length else items[:length]]) for items in lists]
        result = zip_lists(*lists)
        self._check_measure(
            result, (CELL_SIZE * length + sum(size for size, _ in measures), 1 + max(deep for _, deep in measures))
        )
        return result

    def list_range(self, *bounds: Any) -> Any:
        """`range(...)`."""
        if set(map(type, bounds)) <= {int, bool} and all(bounds[2:]):
            self.check_room(CELL_SIZE * len(range(*bounds)[:RANGE_LIMIT]))
        return make_range(*bounds)

    def replace_text(self, value: Any, old: Any, new: Any) -> Any:
        """`replace(s, old, new)`."""
        if type(value) is type(old) is type(new) is str and old:
            self.check_room(len(value) + value.count(old) * len(new), "a text")
        return self.check_value(replace_text(value, old, new))

    def join_texts(self, values: Any, separator: Any = "") -> Any:
        """`join(list, separator)`."""
        if type(values) is list and type(separator) is str:
            self.check_room(len(separator) * len(values), "a text")
        return self.check_value(join_list(values, separator))

    def wrap_function(self, name: str, python: Callable[..., Any]) -> Callable[..., Any]:
        """A built-in function, whose results are measured where they may be larger than what it is given."""
        if name in MEASURED_FUNCTIONS:
            own: Callable[..., Any] = getattr(self, MEASURED_FUNCTIONS[name])
            return own
        return (lambda *arguments: self.check_value(python(*arguments))) if OPERATIONS[name].grows else python

    # --- measuring -----------------------------------------------------------------------------------------

    def check_room(self, size: int, what: str = "a list") -> None:
        """Raises ExecutionError X014 if there is no room for a value of this size."""
        if size > self.limit:
            raise self.build_size_error(what)

    def measure_rows(self, rows: Sequence[Sequence[Any]], before: int) -> int:
        """The size of rows and what came before them. Raises ExecutionError X014 if that is too large for a value."""
        size = before
        for start in range(0, len(rows), ITEMS_PER_CHECK):
            size += self._measure_value(rows[start : start + ITEMS_PER_CHECK])[0]
            if size > self.limit:
                raise self.build_size_error("the result of a query")
        return size

    def _measure_value(self, level: Sequence[Any]) -> Measure:
        """The size and the depth of lists, dicts or rows. Beyond the limits both are any that are beyond them.

        All that lie at one depth are looked at together, 0.03 us for each, where one by one it would be 0.6.
        """
        size = depth = deepest = 0
        kinds = set(map(type, level))
        while level and depth <= DEPTH_LIMIT:
            if self._known:
                level, more, deep = self._find_unknown(level)
                size, deepest = size + more, max(deepest, deep and depth + deep)
                if not level:
                    break
            depth += 1
            if dict in kinds:
                level = [[*one, *one.values()] if type(one) is dict else one for one in level]
            size += CELL_SIZE * sum(map(len, level))
            if size > self.limit:
                break
            items = level[0] if len(level) == 1 else list(chain.from_iterable(level))
            kinds = set(map(type, items))
            if str in kinds:
                size += sum([len(item) for item in items if type(item) is str])
            if kinds <= _NESTING:
                level = items
            else:
                level = () if kinds.isdisjoint(_NESTING) else [item for item in items if type(item) in _NESTING]
        return size, max(depth, deepest)

    def _find_unknown(self, level: Sequence[Any]) -> tuple[list[Any], int, int]:
        """The lists that nobody has measured, and of the others the size together and the greatest depth."""
        unknown: list[Any] = []
        size = depth = 0
        for value in level:
            known = self._known.get(id(value))
            if known is None or known[0] is not value:
                unknown.append(value)
                continue
            size += known[1][0]
            depth = max(depth, known[1][1])
            if size > self.limit:
                break
        return unknown, size, depth

    def _check_measure(self, value: Any, measure: Measure) -> None:
        size, depth = measure
        if size > self.limit and not _is_small_value(value):
            raise self.build_size_error("a dict" if type(value) is dict else "a list")
        if depth > DEPTH_LIMIT:
            raise build_depth_error("the script made")
        if size > HUGE_SIZE and self.pause is not None:
            self.pause()
        if size > LARGE_SIZE:
            self._held += len(value)
            if self._held > self.cells:
                self._known.clear()
                self._held = len(value)
            self._known[id(value)] = value, measure

    @contextmanager
    def raise_refusals(self) -> Iterator[None]:
        """Raises what was found out meanwhile instead of what came of it."""
        try:
            yield
        except Exception:
            if self.refused is None:
                raise
        self.raise_found()

    def raise_found(self) -> None:
        """Raises what was found out where it could not be raised."""
        if self.refused is not None:
            error, self.refused = self.refused, None
            raise error

    def get_max_list_rows(self) -> int:
        """The most rows that a query may have which gives a list."""
        return self.cells if self.rows is None else min(self.rows, self.cells)

    def build_row_count_error(self) -> ExecutionError:
        if self.rows is None or self.cells < self.rows:
            return self.build_size_error("the result of a query")
        return build_row_limit_error(self.rows)

    def build_size_error(self, what: str) -> ExecutionError:
        message = f"the script made {what} of more than max_size={self.limit} bytes"
        hint = "see whether it is meant to grow like that, keep less of it, or raise max_size"
        return ExecutionError("X014", message, hints=(hint,))


def _is_small_value(value: Any) -> bool:
    """Whether there are few values in a list or dict, at any depth."""
    return _take_room(value, SMALL_LENGTH) >= 0


def _take_room(value: Any, room: int) -> int:
    """What is left of room for so many values, less than nothing where they are more."""
    items = (*value, *value.values()) if type(value) is dict else value
    room -= len(items)
    if room >= 0 and not _NESTING.isdisjoint(map(type, items)):
        for item in items:
            if room >= 0 and type(item) in _NESTING:
                room = _take_room(item, room)
    return room
