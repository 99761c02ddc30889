"""The steps of a search with MEMORIZE, as far as they are known, and notes of those that had to be evaluated.

A level is looked up before its states are expanded. What was found out is written when a level, or a part of a long
one, is done: of each state all steps or none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from time import perf_counter
from typing import Any

import apsw

from ss2sql.errors import ExecutionError, Stopped
from ss2sql.language.frozen_values import FREEZERS, UNSET, State
from ss2sql.language.rows import Row
from ss2sql.runtime.graph_cache.cached_graph import MAX_HELD, CachedEdge, CachedGraph, CachedNode
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable
from ss2sql.runtime.graph_cache.graph_store import build_damage_error
from ss2sql.runtime.run.garbage_collector import pause_collector
from ss2sql.runtime.run.run_state import Stats
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_notes import Note, Notes, Pair
from ss2sql.runtime.sqlite.authorizer import READ_ERRORS

# Writing may take one part in so many of the time, so a search with many small levels writes several together.
SHARE = 20
PART = 0.5  # seconds after which a part of a level is written
MAX_EDGES_WRITTEN = 1_500  # that are written in one transaction, which takes 15 ms
MOMENT = 0.01  # seconds after which a run that was stopped begins no other one

_TEMPORARY_ERRORS = (
    apsw.BusyError,
    apsw.LockedError,
    apsw.FullError,
    apsw.ReadOnlyError,
    apsw.IOError,
    apsw.CantOpenError,
)


def add_note(stats: Stats, text: str) -> None:
    """Tells the user what becomes of the graph."""
    note = f"graph: {text}"
    if note not in stats.notes:
        stats.notes.append(note)


class CachedSteps(Notes):
    """The steps of one search. A context: what is new is written in its end, too, whatever ends it.

    `clauses` are those whose values are remembered, by their names in notes. With `elements` those are kept. `changed`
    names a function that is not what it was when the search began.
    """

    def __init__(
        self,
        search_run: SearchRun,
        graph: CachedGraph,
        clauses: Iterable[str],
        elements: bool,
        changed: Callable[[], str | None],
    ) -> None:
        assert search_run.noted is not None
        super().__init__(search_run.noted)
        self.search_run = search_run
        self.graph = graph
        self.changed = changed
        self.stores_elements = elements
        self._clauses = {name: self.noted.places.clauses[name] for name in clauses}
        rows, frozen, shapes, states, *_ = self.noted.places
        self._columns = list(zip(rows, frozen, map(FREEZERS.__getitem__, shapes), strict=True))
        self._states = [(place, at) for at, place in enumerate(states) if place is not None and place not in rows]
        self._rows: dict[int, tuple[Note, Row]] = {}  # by the identity of a row: a note with nothing else
        self.off = False
        self._nodes: list[CachedNode] = []  # of this level
        self._unwritten: list[CachedNode] = []
        self._begun = self._complete = 0  # levels
        self._written, self._seconds = perf_counter(), 0.0
        self._write_failed = ""
        self._missed = self._last_write = False
        self._held = 0

    # --- levels ----------------------------------------------------------------------------------------

    def __enter__(self) -> CachedSteps:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._finish_state()
            self._complete = self._begun
        try:
            name = self.changed() if self._unwritten or self._last_write else None
            if name is None:
                self._write_nodes(kind is not None and issubclass(kind, (Stopped, KeyboardInterrupt)))
            else:
                self._abandon_graph(name)
        except ExecutionError:
            if kind is None:
                raise
        self.search_run.stats.graph = self.graph.number
        if self._write_failed and self._unwritten:
            add_note(self.search_run.stats, f"what is new is not remembered: {self._write_failed}")
        elif self._missed and not self.off:
            add_note(self.search_run.stats, "what is new is not remembered: the session is read only")

    def begin_level(self, states: Sequence[State], chosen: Sequence[list[Any]] | None = None) -> None:
        """Looks up what is known of the states of a level, and writes what the level before has found out."""
        self._finish_state()
        super().begin_level(states, chosen)
        if self.off:
            return
        self._complete = self._begun
        self._begun += 1
        if self._is_due(0.0):
            self._write_nodes()
        self._forget_old_level()
        self._nodes = []
        try:
            with pause_collector():
                self._nodes = self.graph.find_nodes(states)
                self._nodes = self.graph.load_nodes(self._nodes)
        except NotCacheable as reason:
            self._stop_caching(reason)
        except _TEMPORARY_ERRORS as error:
            self._write_failed = str(error)
        if self.stores_elements:
            self.pairs[: len(self._nodes)] = map(self._load_pairs, self._nodes)

    def _forget_old_level(self) -> None:
        """Forgets the steps of the level that was, where there are too many; they are read again where need be."""
        for node in self._nodes:
            self._held += len(node.edges or ())
            if self._held > MAX_HELD and not node.touched:
                self._held -= len(node.edges or ())
                node.edges = None

    def _is_due(self, least: float) -> bool:
        passed = perf_counter() - self._written
        return bool(self._unwritten) and passed >= least and passed >= SHARE * self._seconds

    def _write_nodes(self, stopped: bool = False) -> None:
        """Writes what is new, in parts, so that a run can be stopped between them.

        Of one that is `stopped` already as much is written as a moment is enough for; the rest is found out anew.
        """
        started = perf_counter()
        while self._write_part() and self._unwritten:
            if not stopped:
                self.search_run.check()
            elif perf_counter() - started > MOMENT:
                break
        self._written = perf_counter()
        self._seconds = self._written - started

    def _write_part(self) -> bool:
        """Writes some states; where somebody else is in the way that has to wait, and the answer is no."""
        store = self.graph.store
        if self.off or not (store.writable and (self._unwritten or self.graph.number)):
            return False
        part = self._unwritten[: _count_nodes_to_write(self._unwritten)]
        try:
            if part or store.is_use_unnoted(self.graph.number):
                self.graph.write_nodes(part, self._complete)
        except NotCacheable as reason:
            self._stop_caching(reason)
            return False
        except _TEMPORARY_ERRORS as error:
            self._write_failed = str(error)
            return False
        except READ_ERRORS as error:
            raise build_damage_error(str(error)) from error
        self._last_write = True
        for node in part:
            node.touched = False
        del self._unwritten[: len(part)]
        return True

    def _abandon_graph(self, name: str) -> None:
        """Gives up a graph that nobody would find again: a function keeps something in what it reads."""
        if self._last_write and self.graph.made:
            self.graph.store.drop_graph(self.graph.number)
            self.graph.number = None
        self._stop_caching(NotCacheable(f"'{name}' changes what it reads"))

    def _stop_caching(self, reason: NotCacheable) -> None:
        self.off = True
        self._unwritten.clear()
        add_note(self.search_run.stats, f"not remembered: {reason}")

    # --- steps -----------------------------------------------------------------------------------------

    def get_known_pairs(self) -> list[Pair] | None:
        self._finish_state()
        self.at += 1
        return self.pairs[self.at]

    def pair_elements(self, at: int, items: list[Any]) -> list[Pair]:
        edges = self._nodes[at].edges if self._nodes else None
        if edges is None:
            return super().pair_elements(at, items)
        if len(items) != len(edges):
            raise build_damage_error("a state has other steps now; is a function declared immutable that is not?")
        return list(zip(self._make_notes(edges), items, strict=True))

    def _load_pairs(self, node: CachedNode) -> list[Pair] | None:
        """The pairs of a state whose elements are kept."""
        edges = node.edges
        if edges is None or (edges and edges[0].elements is None):
            return None
        several = self.noted.sources > 1
        elements = [edge.elements if several else (edge.elements or ())[0] for edge in edges]
        return list(zip(self._make_notes(edges), elements, strict=True))

    def _make_notes(self, edges: Sequence[CachedEdge]) -> list[Note]:
        rows = [edge.row for edge in edges]
        found = map(self._rows.get, map(id, rows))
        notes = [(note or self._note_row(row))[0].copy() for note, row in zip(found, rows, strict=True)]
        if self._states or self._clauses:
            for note, edge in zip(notes, edges, strict=True):
                if edge.target is not None:
                    for place, at in self._states:
                        note[place] = edge.target.state[at]
                for name, value in edge.verdicts.items():
                    note[self._clauses[name]] = value
        return notes

    def _note_row(self, row: Row) -> tuple[Note, Row]:
        """A note of which the row is known: steps share their rows."""
        note = self.noted.make_blank_note()
        for value, (place, frozen, freeze) in zip(row, self._columns, strict=True):
            note[place] = value
            if frozen is not None:
                note[frozen] = freeze(value)
        found = self._rows[id(row)] = note, row
        return found

    def _finish_state(self) -> None:
        """Takes from the notes of the state before what was found out; all of its steps were evaluated."""
        if self.off or self.at < 0 or not self._nodes:
            return
        node, pairs = self._nodes[self.at], self.pairs[self.at] or []
        new = node.edges is None
        if node.edges is None:
            elements_of = self.noted.read_elements if self.stores_elements else lambda item: None
            node.edges = [CachedEdge(self.noted.row(note), elements_of(item)) for note, item in pairs]
        elif node.loaded:
            self.search_run.stats.remembered_steps += len(pairs)
        most = len(self._clauses)
        for (note, _), edge in zip(pairs, node.edges, strict=True):
            if edge.target is None:
                after = self.noted.after(note, node.state)
                edge.target = None if after is None else CachedNode(after)
                new = new or after is not None
            if most and len(edge.verdicts) < most:
                known = len(edge.verdicts)
                edge.verdicts = {name: note[place] for name, place in self._clauses.items() if note[place] is not UNSET}
                new = new or len(edge.verdicts) > known
        self.pairs[self.at] = None
        if new:
            self._mark_for_writing(node)
        if self._is_due(PART):
            self._write_nodes()

    def _mark_for_writing(self, node: CachedNode) -> None:
        if not self.graph.store.writable:
            self._missed = True
        elif not node.touched:
            node.touched = True
            self._unwritten.append(node)


def _count_nodes_to_write(nodes: Sequence[CachedNode]) -> int:
    edges = 0
    for number, node in enumerate(nodes, 1):
        edges += len(node.edges or ())
        if edges >= MAX_EDGES_WRITTEN:
            return number
    return len(nodes)
