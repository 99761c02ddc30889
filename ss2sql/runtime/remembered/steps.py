"""The steps of a search with MEMORIZE, as far as they are known, and notes of those that had to be evaluated.

What is evaluated, and in which order, is what `Pieces.steps` evaluates, less what is known. A level is looked up before
its states are expanded. What was found out is written when a level, or a part of a long one, is done: of each state all
steps or none.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Sequence
from time import perf_counter
from typing import Any, TypeAlias

import apsw

from ss2sql.errors import ExecutionError, Stopped
from ss2sql.runtime.frozen import State
from ss2sql.runtime.guard import UNREADABLE
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.memorize.pieces import Last, Pieces
from ss2sql.runtime.remembered.graph import MOST_HELD, Edge, GraphInFile, Node
from ss2sql.runtime.remembered.store import spoilt
from ss2sql.runtime.remembered.texts import NotKept
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Stats
from ss2sql.runtime.search.contract import Step

# Writing may take one part in so many of the time, so a search with many small levels writes several together.
SHARE = 20
PART = 0.5  # seconds after which a part of a level is written
MOST_EDGES = 1_500  # that are written in one transaction, which takes 15 ms
MOMENT = 0.01  # seconds after which a run that was stopped begins no other one

Ask: TypeAlias = Callable[[Node, Edge, Last, Row], Any]
_IN_THE_WAY = (apsw.BusyError, apsw.LockedError, apsw.FullError, apsw.ReadOnlyError, apsw.IOError, apsw.CantOpenError)


def tell(stats: Stats, text: str) -> None:
    """Tells the user what becomes of the graph."""
    note = f"graph: {text}"
    if note not in stats.notes:
        stats.notes.append(note)


class Remembering:
    """The steps of one search. A context: what is new is written in its end, too, whatever ends it.

    `places` gives for each clause that calls functions (stop, goal, weight) its place among the graph's; `settling` are
    those after which the next state costs nothing; where `follows` it never does. With `elements` those are kept.
    `changed` names a function that is not what it was when the search began.
    """

    def __init__(
        self,
        hunt: Hunt,
        graph: GraphInFile,
        places: dict[str, int],
        settling: set[str],
        follows: bool,
        elements: bool,
        changed: Callable[[], str | None],
    ) -> None:
        assert hunt.pieces is not None
        self.hunt = hunt
        self.graph = graph
        self.pieces: Pieces = hunt.pieces
        self.follows = follows
        self.changed = changed
        self.keeps_elements = elements
        self.stop = self._ask(self.pieces.ends, places.get("stop"), "stop" in settling)
        self.goal = self._ask(self.pieces.is_goal, places.get("goal"), "goal" in settling)
        self.weight = self._ask_weight(places.get("weight"))
        self.sources = len(hunt.query.sources)
        self.off = False
        self._nodes: dict[int, Node] = {}  # of this level, by the identities of their states
        self._next: dict[int, Node] = {}
        self._pending: list[Node] = []
        self._begun = self._complete = 0  # levels
        self._written, self._seconds = perf_counter(), 0.0
        self._hindered = ""
        self._missed = self._wrote = False
        self._held = 0

    # --- levels ----------------------------------------------------------------------------------------

    def __enter__(self) -> Remembering:
        self._outer, self.hunt.run.knows = self.hunt.run.knows, self.knows
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.hunt.run.knows = self._outer
        if kind is None:
            self._complete = self._begun
        try:
            name = self.changed() if self._pending or self._wrote else None
            if name is None:
                self._write(kind is not None and issubclass(kind, (Stopped, KeyboardInterrupt)))
            else:
                self._disown(name)
        except ExecutionError:
            if kind is None:
                raise
        self.hunt.stats.graph = self.graph.number
        if self._hindered and self._pending:
            tell(self.hunt.stats, f"what is new is not remembered: {self._hindered}")
        elif self._missed and not self.off:
            tell(self.hunt.stats, "what is new is not remembered: the session is read only")

    def level(self, states: Sequence[State]) -> None:
        """Looks up what is known of the states of a level, and writes what the level before has found out."""
        if self.off:
            return
        self._complete = self._begun
        self._begun += 1
        if self._is_due(0.0):
            self._write()
        nodes = [self._next.get(id(state)) or Node(state) for state in states]
        self._next.clear()
        self._let_go()
        try:
            nodes = self.graph.load(nodes)
        except NotKept as reason:
            self._give_up(reason)
        except _IN_THE_WAY as error:
            self._hindered = str(error)
        self._nodes = {id(state): node for state, node in zip(states, nodes, strict=True)}

    def _let_go(self) -> None:
        """Forgets the steps of the level that was, where there are too many; they are read again where need be."""
        for node in self._nodes.values():
            self._held += len(node.edges or ())
            if self._held > MOST_HELD and not node.touched:
                self._held -= len(node.edges or ())
                node.edges = None

    def knows(self, state: State) -> bool:
        """Whether the steps from a state of this level are known."""
        node = self._nodes.get(id(state))
        return node is not None and node.edges is not None

    def _is_due(self, least: float) -> bool:
        passed = perf_counter() - self._written
        return bool(self._pending) and passed >= least and passed >= SHARE * self._seconds

    def _write(self, stopped: bool = False) -> None:
        """Writes what is new, in parts, so that a run can be stopped between them.

        Of one that is `stopped` already as much is written as a moment is enough for; the rest is found out anew.
        """
        started = perf_counter()
        while self._write_part() and self._pending:
            if not stopped:
                self.hunt.check()
            elif perf_counter() - started > MOMENT:
                break
        self._written = perf_counter()
        self._seconds = self._written - started

    def _write_part(self) -> bool:
        """Writes some states; where somebody else is in the way that has to wait, and the answer is no."""
        store = self.graph.store
        if self.off or not (store.writable and (self._pending or self.graph.number)):
            return False
        part = self._pending[: _first(self._pending)]
        try:
            if part or store.is_stale(self.graph.number):
                self.graph.write(part, self._complete)
        except NotKept as reason:
            self._give_up(reason)
            return False
        except _IN_THE_WAY as error:
            self._hindered = str(error)
            return False
        except UNREADABLE as error:
            raise spoilt(str(error)) from error
        self._wrote = True
        for node in part:
            node.touched = False
        del self._pending[: len(part)]
        return True

    def _disown(self, name: str) -> None:
        """Gives up a graph that nobody would find again: a function keeps something in what it reads."""
        if self._wrote and self.graph.made:
            self.graph.store.drop(self.graph.number)
            self.graph.number = None
        self._give_up(NotKept(f"'{name}' changes what it reads"))

    def _give_up(self, reason: NotKept) -> None:
        self.off = True
        self._pending.clear()
        tell(self.hunt.stats, f"not remembered: {reason}")

    # --- steps -----------------------------------------------------------------------------------------

    def steps(self, state: State, seen: Container[Hashable]) -> Iterator[Step]:
        """The steps from a state of this level."""
        node = None if self.off else self._nodes.get(id(state))
        if node is None:
            yield from self.pieces.steps(state, seen)
            return
        fresh = node.edges is None
        edges: list[Edge] = node.edges or []
        lasts = self.pieces.elements(node.state) if fresh else self._lasts(node, edges)
        stop, goal_of, weigh, row_of = self.stop, self.goal, self.weight, self.pieces.row
        keyed, sources = self.hunt.keyed, self.sources if self.keeps_elements else 0
        for position, last in enumerate(lasts):
            if fresh:
                row, key = known = row_of(last)
                edge = Edge(known, last[:sources] if sources else None)
                edges.append(edge)
            else:
                edge = edges[position]
                row, key = edge.row, edge.key
            goal: bool | None = None
            ends = False
            if self.follows and edge.target is None:
                self._follow(node, edge, last)
            if key not in seen:
                ends = stop is not None and stop(node, edge, last, row)
                goal = not ends if goal_of is None else goal_of(node, edge, last, row)
                if ends and not goal:
                    continue
            weight = None if weigh is None else weigh(node, edge, last, row)
            if not weight and self.pieces.probable:
                continue
            following = None
            if not ends and goal is not None:
                target = edge.target or self._follow(node, edge, last)
                following = target.state
                self._next[id(following)] = target
            yield row, key, goal, following is not None, following, weight, None, last if keyed else None
        if fresh:
            self._finish(node, edges)

    def _finish(self, node: Node, edges: list[Edge]) -> None:
        """All steps from a state have been evaluated."""
        if self.off:
            return
        node.edges = edges
        self._touch(node)
        if self._is_due(PART):
            self._write()

    def _lasts(self, node: Node, known: list[Edge]) -> Iterable[Last]:
        """The elements of the steps with the state before them, without a call where they are kept."""
        if node.loaded:
            self.hunt.stats.remembered_steps += len(known)
        if not self.keeps_elements or (known and known[0].elements is None):
            lasts = list(self.pieces.elements(node.state))
            if len(lasts) != len(known):
                raise spoilt("a state has other steps now; is a function declared immutable that is not?")
            return lasts
        self.hunt.check()
        self.hunt.stats.generated += len(known)
        self.hunt.stats.expanded += 1
        return [(*(edge.elements or ()), *node.state) for edge in known]

    def _follow(self, node: Node, edge: Edge, last: Last) -> Node:
        """The node that a step leads to, where that was not known."""
        target = edge.target = Node(self.pieces.follow(last, edge.row))
        self._touch_known(node)
        return target

    def _touch_known(self, node: Node) -> None:
        """Notes that there is something new about a node whose steps are known."""
        if node.edges is not None:
            self._touch(node)

    def _touch(self, node: Node) -> None:
        if not self.graph.store.writable:
            self._missed = True
        elif not node.touched:
            node.touched = True
            self._pending.append(node)

    # --- clauses ---------------------------------------------------------------------------------------

    def _ask(
        self, piece: Callable[[Last, Row, State | None], bool] | None, place: int | None, settles: bool
    ) -> Ask | None:
        """What asks a condition of a step, unless that is known."""
        if piece is None:
            return None

        def ask_freely(node: Node, edge: Edge, last: Last, row: Row) -> Any:
            if edge.target is not None:
                return piece(last, row, edge.target.state)
            value = piece(last, row, None)
            if settles:
                self._follow(node, edge, last)
            return value

        def ask(node: Node, edge: Edge, last: Last, row: Row) -> Any:
            assert place is not None
            value = None if edge.verdicts is None else edge.verdicts.get(place)
            if value is None:
                value = ask_freely(node, edge, last, row)
                edge.note(place, value)
                self._touch_known(node)
            return bool(value)

        return ask_freely if place is None else ask

    def _ask_weight(self, place: int | None) -> Ask | None:
        """What asks for the weight of a step, unless that is known."""
        piece = self.pieces.weigh
        if piece is None:
            return None

        def ask(node: Node, edge: Edge, last: Last, row: Row) -> Any:
            if place is None:
                return piece(last, row)
            value = None if edge.verdicts is None else edge.verdicts.get(place)
            if value is None:
                value = piece(last, row)
                edge.note(place, value)
                self._touch_known(node)
            return value

        return ask


def _first(nodes: Sequence[Node]) -> int:
    """How many of the nodes are written together."""
    edges = 0
    for number, node in enumerate(nodes, 1):
        edges += len(node.edges or ())
        if edges >= MOST_EDGES:
            return number
    return len(nodes)
