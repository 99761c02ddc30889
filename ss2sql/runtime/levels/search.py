"""Going from level to level: every step from the states of one level is tried, then tables say which are kept.

It finds the results of the breadth-first search that takes one step after the other, in its order, and raises what that
would raise. Only what nobody can notice is different: the clauses of all steps of a level are evaluated, also of those
behind the last result that is asked for, and behind the first step to their row.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from hashlib import blake2b
from itertools import groupby
from marshal import dumps, loads
from operator import itemgetter
from typing import Any

from ss2sql.errors import ExecutionError, Stopped, UnsupportedError
from ss2sql.runtime.levels.statements import Statements
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.pieces import Last, Pieces, State
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Level
from ss2sql.runtime.values import freeze

BLOCK = 5_000  # tries that are added to their table at once
DIGEST = 32  # bytes


class LevelSearch:
    """One search in some tables."""

    def __init__(self, hunt: Hunt, tables: Tables, written: Statements) -> None:
        assert hunt.pieces is not None
        self.hunt, self.tables, self.written = hunt, tables, written
        self.pieces: Pieces = hunt.pieces
        self.tried = 0

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        written, tables = self.written, self.tables
        self._run(written.made)
        tables.add("frontier", [[0], [encoded(self.hunt.start)]])
        going, depth = 1, 0
        while going:
            depth += 1
            before = self.tried
            self._try_all()
            self._run(written.kept)
            ((failed,),) = tables.rows(written.failed)
            tables.run(written.keep, depth=depth)
            ((kept, goals, going),) = tables.rows(written.counts)
            if goals:
                yield from self._paths(failed)
            if failed is not None:
                self._fail(failed, before)
            self.hunt.stats.levels.append(Level(kept, kept, self.tried - before - kept))
            self._run(written.go_on)

    def _run(self, texts: Iterable[str]) -> None:
        for text in texts:
            self.tables.run(text)

    def _try_all(self) -> None:
        """All steps from the states of the frontier."""
        block: list[tuple[Any, ...]] = []
        for parent, state in self._expanded():
            for last in self._lasts(state):
                self.tried += 1
                made = self._failed(None) if last is None else self._tried(last)
                if made is not None:
                    block.append((self.tried, parent, *made))
                    if len(block) >= BLOCK:
                        self._add(block)
        self._add(block)

    def _lasts(self, state: State) -> Iterator[Last | None]:
        """The elements of a state with it; at the end None where the sources fail."""
        try:
            yield from self.pieces.elements(state)
        except (Stopped, UnsupportedError):
            raise
        except Exception:  # raised by `_fail`, if it counts
            yield None

    def _expanded(self) -> Iterator[tuple[int, State]]:
        """The states of the frontier with their steps."""
        after = -1
        while page := list(self.tables.rows(self.written.expanded, after=after)):
            for after, state in page:
                yield after, loads(state)

    def _add(self, block: list[tuple[Any, ...]]) -> None:
        self.hunt.flush()
        self.hunt.check()
        if block:
            self.tables.add("tries", list(zip(*block, strict=True)))
            block.clear()

    def _tried(self, last: Last) -> tuple[Any, ...] | None:
        """What `tries` has of a step but for its numbers; None where it comes to nothing."""
        pieces = self.pieces
        row = None
        try:
            row, _ = pieces.row(last)
            ends = pieces.ends is not None and pieces.ends(last, row, None)
            goal = not ends if pieces.is_goal is None else pieces.is_goal(last, row, None)
            if ends and not goal:
                return None
            state = None if ends else encoded(pieces.follow(last, row))
        except (Stopped, UnsupportedError):
            raise
        except Exception:
            return self._failed(row)
        return key_of(row), encoded(row), encoded(last) if self.hunt.keyed else None, goal, not ends, state, False

    def _failed(self, row: Row | None) -> tuple[Any, ...]:
        """What `tries` has of a step that has raised an error; one without a row counts whatever others there are."""
        key = b"\xff%d" % self.tried if row is None else key_of(row)  # no key of a row begins like this
        return key, None, None, False, False, None, True

    def _paths(self, failed: int | None) -> Iterator[Found]:
        """The paths to the goals of a level, those before the step that failed."""
        self.tables.run(self.written.ways)
        for goal, rows in groupby(self.tables.rows(self.written.paths), itemgetter(0)):
            if failed is not None and goal > failed:
                break
            path = list(rows)
            last = path[-1][2]
            yield [loads(row) for _, row, _ in path], None if last is None else loads(last)
        self.tables.run(self.written.no_ways)

    def _fail(self, step: int, before: int) -> None:
        """Takes the step that failed once more, which raises its error."""
        number = before
        for _, state in self._expanded():
            for last in self.pieces.elements(state):
                number += 1
                if number == step:
                    row, _ = self.pieces.row(last)
                    for clause in (self.pieces.ends, self.pieces.is_goal):
                        if clause is not None:
                            clause(last, row, None)
                    self.pieces.follow(last, row)
        hint = "see whether a function is declared immutable that is not"
        raise ExecutionError("X009", "a step that failed did not fail again", hints=(hint,))


def encoded(values: State) -> bytes:
    """Values as bytes. Raises UnsupportedError where there are objects among them."""
    try:
        return dumps(values, 2)
    except ValueError:
        raise _no_objects() from None


def key_of(row: tuple[Any, ...]) -> bytes:
    """Bytes that are the same for equal rows. Raises UnsupportedError where there are objects among their values."""
    key = freeze(list(row))
    if not isinstance(key, bytes):
        raise _no_objects()
    # What is compared with all other rows should be short. Two rows with the same digest of 256 bits nobody has seen.
    return key if len(key) <= DIGEST else blake2b(key, digest_size=DIGEST).digest()


def _no_objects() -> UnsupportedError:
    hints = ("show and keep numbers, texts and lists, or leave the engine to ss2sql",)
    return UnsupportedError("U001", "a row or state has an object, which no other database can keep", hints=hints)
