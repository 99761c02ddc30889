"""The steps of a search with MEMORIZE, as far as they are known, and notes of those that had to be evaluated.

A level is looked up before its states are expanded. What was found out is written when a level, or a part of a long
one, is done: of each state all steps or none.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from marshal import dumps
from time import perf_counter
from typing import Any

import apsw

from ss2sql.errors import ExecutionError, Stopped
from ss2sql.language.frozen_values import UNSET, State
from ss2sql.runtime.graph_cache.cached_graph import MAX_HELD, CachedEdge, CachedGraph, CachedNode
from ss2sql.runtime.graph_cache.graph_store import build_damage_error
from ss2sql.runtime.graph_cache.value_json import NotCacheable
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
        self._clauses = {name: self.noted.places[2][name] for name in clauses}
        rows, states, *_ = self.noted.places
        self._rows = [(place, at) for at, place in enumerate(rows)]
        self._states = [(place, at) for at, place in enumerate(states) if place is not None and place not in rows]
        self._kept = [place for place, _ in self._states] + list(self._clauses.values())
        self._blank = self.noted.blank()
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
            self._finish()
            self._complete = self._begun
        try:
            name = self.changed() if self._unwritten or self._last_write else None
            if name is None:
                self._write(kind is not None and issubclass(kind, (Stopped, KeyboardInterrupt)))
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
        self._finish()
        super().begin_level(states, chosen)
        if self.off:
            return
        self._complete = self._begun
        self._begun += 1
        if self._is_due(0.0):
            self._write()
        edges = (edge for node in self._nodes for edge in node.edges or ())
        targets = {id(edge.target): edge.target for edge in edges if edge.target is not None}
        reached = {_exact(node.state): node for node in targets.values()}
        values = list(map(self.search_run.shapes.thaw, states))
        nodes = [reached.get(_exact(state)) or CachedNode(state) for state in values]
        self._let_go()
        try:
            nodes = self.graph.load(nodes)
        except NotCacheable as reason:
            self._give_up(reason)
        except _TEMPORARY_ERRORS as error:
            self._write_failed = str(error)
        self._nodes = nodes
        self.pairs = list(map(self._pairs, nodes))

    def _let_go(self) -> None:
        """Forgets the steps of the level that was, where there are too many; they are read again where need be."""
        for node in self._nodes:
            self._held += len(node.edges or ())
            if self._held > MAX_HELD and not node.touched:
                self._held -= len(node.edges or ())
                node.edges = None

    def _is_due(self, least: float) -> bool:
        passed = perf_counter() - self._written
        return bool(self._unwritten) and passed >= least and passed >= SHARE * self._seconds

    def _write(self, stopped: bool = False) -> None:
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
                self.graph.write(part, self._complete)
        except NotCacheable as reason:
            self._give_up(reason)
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
            self.graph.store.drop(self.graph.number)
            self.graph.number = None
        self._give_up(NotCacheable(f"'{name}' changes what it reads"))

    def _give_up(self, reason: NotCacheable) -> None:
        self.off = True
        self._unwritten.clear()
        add_note(self.search_run.stats, f"not remembered: {reason}")

    # --- steps -----------------------------------------------------------------------------------------

    def known(self) -> list[Pair] | None:
        self._finish()
        return super().known()

    def paired(self, at: int, items: list[Any]) -> list[Pair]:
        edges = self._nodes[at].edges if self._nodes else None
        if edges is None:
            return super().paired(at, items)
        if len(items) != len(edges):
            raise build_damage_error("a state has other steps now; is a function declared immutable that is not?")
        return list(zip(map(self._note, edges), items, strict=True))

    def _pairs(self, node: CachedNode) -> list[Pair] | None:
        """The pairs of a state whose elements are kept."""
        edges = node.edges
        if edges is None or not self.stores_elements or (edges and edges[0].elements is None):
            return None
        several = self.noted.sources > 1
        return [(self._note(edge), edge.elements if several else (edge.elements or ())[0]) for edge in edges]

    def _note(self, edge: CachedEdge) -> Note:
        """The note of a known step."""
        note = [*self._blank]
        if edge.target is not None:
            for place, at in self._states:
                note[place] = edge.target.state[at]
        for place, at in self._rows:
            note[place] = edge.row[at]
        for name, value in (edge.verdicts or {}).items():
            note[self._clauses[name]] = value
        edge.unknown = self._unknown(note)
        return note

    def _unknown(self, note: Note) -> int:
        """How much is not known of what is kept in the file."""
        return sum([note[place] is UNSET for place in self._kept])

    def _finish(self) -> None:
        """Takes from the notes of the state before what was found out; all of its steps were asked."""
        if self.off or self.at < 0 or not self._nodes:
            return
        node, pairs = self._nodes[self.at], self.pairs[self.at] or []
        if node.edges is None:
            elements_of = self.noted.elements if self.stores_elements else lambda item: None
            node.edges = [CachedEdge(self.noted.row(note), elements_of(item)) for note, item in pairs]
            changed = list(range(len(pairs)))
        else:
            if node.loaded:
                self.search_run.stats.remembered_steps += len(pairs)
            asked = (at for at, edge in enumerate(node.edges) if edge.unknown)
            changed = [at for at in asked if self._unknown(pairs[at][0]) < node.edges[at].unknown]
        for at in changed:
            note, edge = pairs[at][0], node.edges[at]
            after = self.noted.after(note, node.state) if edge.target is None else None
            edge.target = edge.target if after is None else CachedNode(after)
            edge.verdicts = {name: note[place] for name, place in self._clauses.items() if note[place] is not UNSET}
        self.pairs[self.at] = None
        if changed or not node.edges:
            self._touch(node)
        if self._is_due(PART):
            self._write()

    def _touch(self, node: CachedNode) -> None:
        if not self.graph.store.writable:
            self._missed = True
        elif not node.touched:
            node.touched = True
            self._unwritten.append(node)


def _count_nodes_to_write(nodes: Sequence[CachedNode]) -> int:
    """How many of the nodes are written together."""
    edges = 0
    for number, node in enumerate(nodes, 1):
        edges += len(node.edges or ())
        if edges >= MAX_EDGES_WRITTEN:
            return number
    return len(nodes)


def _exact(state: State) -> Hashable:
    """The same for states that are exactly the same; one with objects is only the same as itself."""
    try:
        return dumps(state, 2)
    except ValueError:
        return id(state)
