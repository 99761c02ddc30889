"""Steps that are evaluated once for each state, where a search may come to a state again and calls are expensive.

The 9 moves of Hanoi with its states in any order take 0.4 of the time of a loop by hand; with a memory of calls 0.7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from collections.abc import Set as AbstractSet
from itertools import islice
from marshal import dumps
from typing import Any

from ss2sql.errors import Stopped
from ss2sql.language.values import State
from ss2sql.runtime.search.step_contract import Expand, Step


class StateSteps:
    """The steps of one state, each evaluated when it is first needed; several may walk over them at a time.

    `rest` is None when all are `known`; `elements` is the number of elements of the state then. `dropped` has the keys
    of steps that stop without being goals, `keys` has them as a set, for a set knows the hashes of what is in it.
    """

    __slots__ = ("dropped", "elements", "error", "keys", "known", "rest")

    def __init__(self) -> None:
        self.known: list[Step] = []
        self.dropped: list[Any] = []
        self.keys: frozenset[Any] = frozenset()
        self.rest: Iterator[Step] | None = None
        self.error: Exception | None = None
        self.elements = 0

    def walk_steps(self) -> Iterator[Step]:
        known, place = self.known, 0
        while True:
            while place < len(known):
                yield known[place]
                place += 1
            if self.rest is None:
                return
            if self.error is not None:
                raise self.error
            try:
                known.append(next(self.rest))
            except StopIteration as end:
                self.rest, self.elements, self.keys = None, end.value, frozenset(self.dropped)
            except Exception as error:
                self.error = error
                raise


class MemoizedSteps:
    """`expand` of a search whose clauses are all steady, for whoever expands a state again and again.

    `look(elements)` counts a state that was known, and looks at the clock; `prune(steps)` counts pruned steps. At most
    so many states are kept as `most`. `compares`: with NO CYCLE steps to rows on the path are left out.
    """

    def __init__(
        self, expand: Expand, most: int, look: Callable[[int], None], prune: Callable[[int], None], compares: bool
    ) -> None:
        self._expand, self._most, self._look, self._prune = expand, most, look, prune
        self._compares = compares
        self._known: dict[bytes, StateSteps] = {}

    @property
    def expand(self) -> Expand:
        """The function. When nobody has it any more, steps that are not known yet are given back to the counters."""
        return self._iterate_open_steps if self._compares else self._iterate_all_steps

    def _get_steps(self, state: State) -> tuple[StateSteps | None, bool]:
        """The steps of a state, None where objects are in it, and whether somebody has begun to walk over them."""
        try:
            key = dumps(state, 2)
        except ValueError:
            return None, False
        found = self._known.get(key)
        if found is not None:
            return found, True
        if len(self._known) >= self._most:
            self._known.clear()
        found = self._known[key] = StateSteps()
        found.rest = self._expand(state, (), found.dropped.append) if self._compares else self._expand(state, ())
        return found, False

    def _iterate_all_steps(self, state: State, closed: AbstractSet[Any]) -> Any:
        """The steps of a search that compares no rows."""
        found, begun = self._get_steps(state)
        if found is None:
            return self._expand(state, ())
        if found.rest is None:
            self._look(found.elements)
            return found.known
        return self._walk_again(found, begun)

    def _walk_again(self, found: StateSteps, begun: bool) -> Iterator[Step]:
        yield from found.walk_steps()
        if begun:
            self._look(found.elements)

    def _iterate_open_steps(self, state: State, closed: AbstractSet[Any]) -> Any:
        """The steps to rows that are not on the path, which is the same whenever one of them is drawn."""
        found, begun = self._get_steps(state)
        if found is None:
            return self._expand(state, closed, ignore_step_key)
        if found.rest is not None:
            return self._walk_open(found, begun, state, closed)
        self._look(found.elements)
        steps = [step for step in found.known if step[1] not in closed]
        pruned = len(found.known) - len(steps)
        if not closed.isdisjoint(found.keys):
            pruned += sum(key in closed for key in found.dropped)
        if pruned:
            self._prune(pruned)
        return steps

    def _walk_open(self, found: StateSteps, begun: bool, state: State, closed: AbstractSet[Any]) -> Iterator[Step]:
        """The same while they are evaluated.

        A step to a row on the path may fail, which the written order does not evaluate: then nothing is remembered.
        """
        generated = pruned = 0
        try:
            for step in self._walk_again(found, begun):
                if step[1] in closed:
                    pruned += 1
                else:
                    generated += 1
                    yield step
            pruned += sum(key in closed for key in found.dropped)
        except Stopped:
            raise
        except Exception:
            pruned = 0
            yield from islice(self._expand(state, closed, ignore_step_key), generated, None)
        finally:
            self._prune(pruned)


def ignore_step_key(key: object) -> None:
    """Nobody wants to hear it."""
