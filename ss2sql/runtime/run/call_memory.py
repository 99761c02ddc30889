"""The memory of calls: what functions have given or raised for their arguments in one run, bounded in number."""

from __future__ import annotations

import marshal
from itertools import islice
from types import NoneType
from typing import Any

MEMO_LIMIT = 100_000


def forget_older_half(memory: dict[Any, Any]) -> None:
    """Makes room by forgetting the older half. One by one, each would cost a walk over those that went before it.

    That walk takes 14 us in a dict of 100,000.
    """
    for key in list(islice(memory, (len(memory) + 1) // 2)):
        del memory[key]


class FailedCall:
    """In a memory of calls: the error with which the call ended."""

    __slots__ = ("error",)

    def __init__(self, error: Exception) -> None:
        self.error = error


class CallMemo:
    """The remembered results of one function, by its SQL arguments; the oldest go when there are too many.

    1 and 1.0 are one key of a dict but two arguments of a function, and so are 0.0 and -0.0: where there are numbers
    among the arguments, `exact` keeps the result by marshal's bytes of them, where a look costs 0.2 us. Handles and
    strings need no such care: their results are in `plain`, where it costs 0.1 us.

    What calls have raised is in `exact`, too, as a FailedCall: a statement that is run again must not call a second
    time. `elements` keeps the lists of calls that stand in FROM, element by element, by marshal's bytes. `calls` counts
    real calls, `hits` answers of the memo.
    """

    __slots__ = ("calls", "elements", "exact", "hits", "limit", "plain")

    def __init__(self, limit: int) -> None:
        self.plain: dict[Any, Any] = {}
        self.exact: dict[bytes, Any] = {}
        self.elements: dict[bytes, tuple[Any, ...]] = {}
        self.hits = 0
        self.calls = 0
        self.limit = limit

    def begin_execution(self) -> tuple[Any, ...]:
        """Empties the memo for one more execution and gives what it held, for `end_execution`."""
        outer = (self.plain, self.exact, self.elements, self.calls, self.hits)
        self.plain, self.exact, self.elements, self.calls, self.hits = {}, {}, {}, 0, 0
        return outer

    def end_execution(self, outer: tuple[Any, ...]) -> tuple[int, int]:
        """Puts back what the memo held before, and gives the numbers of calls and of hits."""
        counts = self.calls, self.hits
        self.plain, self.exact, self.elements, self.calls, self.hits = outer
        return counts

    def keep_result(self, arguments: tuple[Any, ...], result: Any) -> None:
        plain = result is not None and type(result) is not FailedCall
        if plain and UNAMBIGUOUS_TYPES.issuperset(map(type, arguments)):
            self._keep(self.plain, arguments, result)
        else:
            self._keep(self.exact, marshal.dumps(arguments, 2), result)

    def keep_elements(self, key: bytes, elements: tuple[Any, ...]) -> None:
        self._keep(self.elements, key, elements)

    def _keep(self, memory: dict[Any, Any], key: Any, value: Any) -> None:
        if len(memory) >= self.limit:
            if not self.limit:
                return
            forget_older_half(memory)
        memory[key] = value


UNAMBIGUOUS_TYPES = frozenset({bytes, str, NoneType})  # of SQL values that equal only what they are
