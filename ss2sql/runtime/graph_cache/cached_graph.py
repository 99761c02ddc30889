"""One remembered graph while a search works on it: the part of it that is in memory, read from the tables by levels."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from operator import is_
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.frozen_values import State, thaw_value
from ss2sql.language.rows import Row
from ss2sql.runtime.graph_cache.graph_store import GraphStore, build_damage_error
from ss2sql.runtime.graph_cache.value_json import decode_values_from_json, encode_values_as_json

MAX_HELD = 200_000  # of each kind of thing that stays in memory, to be read again where need be


_NO_VERDICTS: dict[str, Any] = {}


class CachedEdge:
    """A step: its row, the node it leads to, its elements, and what clauses said of it.

    The elements are None where FROM is read again; `verdicts` go by the names of the clauses, and are not changed.
    """

    __slots__ = ("elements", "row", "target", "verdicts")

    def __init__(self, row: Row, elements: tuple[Any, ...] | None, target: CachedNode | None = None) -> None:
        self.row = row
        self.elements = elements
        self.target = target
        self.verdicts = _NO_VERDICTS


class CachedNode:
    """A state. `number` is that of its row in the tables, as long as `era` is that of the graph.

    `edges` are None as long as they are not known; `loaded` says that another search has found them out, `touched`
    that there is something new to write.
    """

    __slots__ = ("edges", "era", "loaded", "number", "state", "text", "touched")

    def __init__(self, state: State, number: int | None = None, era: int = 0, text: str | None = None) -> None:
        self.state = state
        self.number = number
        self.era = era
        self.text = text
        self.edges: list[CachedEdge] | None = None
        self.loaded = False
        self.touched = False

    def encode_state(self) -> str:
        """The state as text. Raises NotCacheable where that is impossible."""
        if self.text is None:
            self.text = encode_values_as_json(self.state)
        return self.text


@dataclass(frozen=True, slots=True)
class CachedClause:
    """A clause whose values are remembered; `kind` is condition, cost or probability, `name` what notes call it."""

    name: str
    key: str
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class GraphDescription:
    """What people are told of a graph: JSON but for the text of the query."""

    query: str
    functions: str
    parameters: str
    variables: str
    columns: str


class CachedGraph:
    """A graph in the tables of a file."""

    def __init__(
        self, store: GraphStore, key: str, described: GraphDescription, clauses: Sequence[CachedClause]
    ) -> None:
        self.store = store
        self.key = key
        self.described = described
        self.clauses = clauses
        self.number: int | None = None
        self.made = False  # by this search
        self.era = 0  # how often somebody has dropped the graph
        self._nodes: dict[int, CachedNode] = {}
        self._nodes_by_text: dict[str, CachedNode] = {}  # nodes that came without a number
        self._own: set[int] = set()  # the numbers of those whose steps this search has written
        self._rows: dict[str, Row] = {}

    # --- reading ---------------------------------------------------------------------------------------

    def find_nodes(self, states: Sequence[State]) -> list[CachedNode]:
        """A node for each frozen state, the same one where states are the same.

        Raises NotCacheable where a state has no text.
        """
        if len(self._nodes_by_text) > MAX_HELD:
            self._nodes_by_text.clear()
        held = self._nodes_by_text
        texts = list(map(encode_values_as_json, states))
        for text, state in zip(texts, states, strict=True):
            if text not in held:
                held[text] = CachedNode(tuple(map(thaw_value, state)), None, self.era, text)
        return list(map(held.__getitem__, texts))

    def load_nodes(self, nodes: Sequence[CachedNode]) -> list[CachedNode]:
        """Reads what the tables have of nodes; gives those that have it.

        Raises ExecutionError X009 where the tables cannot be read.
        """
        with self.store.while_reading():
            if self.number is None:
                self.number = self.store.find_graph(self.key)
            if self.number is None:
                return list(nodes)
            new = [node for node in nodes if node.number is None]
            for place, number in self.store.find_states(self.number, [node.encode_state() for node in new]):
                new[place].number = number
            found = [node if node.number is None else self._nodes.setdefault(node.number, node) for node in nodes]
            try:
                self._load_edges({node.number: node for node in found if node.number and node.edges is None})
            except (ValueError, TypeError, LookupError) as error:
                raise build_damage_error(f"what they hold is no graph ({error})") from error
        return found

    def _load_edges(self, nodes: dict[int, CachedNode]) -> None:
        assert self.number is not None
        counts = self.store.list_steps(self.number, nodes)
        found = self.store.list_edges(counts)
        sources, _, rows, targets, texts = zip(*found, strict=True) if found else ((), (), (), (), ())
        self._decode_rows(set(rows))
        self._decode_states(set(targets) - {None})
        self._decode_rows(set(texts) - {None})
        elements = {None: None, **{text: self._rows[text] for text in set(texts) - {None}}}
        parts = map(self._rows.__getitem__, rows), map(elements.__getitem__, texts), map(self._nodes.get, targets)
        made = map(CachedEdge, *parts)
        edges = {number: list(islice(made, count)) for number, count in Counter(sources).items()}  # they are in order
        self._load_verdicts(edges)
        for number, count in counts.items():
            if len(edges.get(number, ())) == count:  # else the graph was dropped meanwhile
                nodes[number].edges = edges.get(number, [])
                nodes[number].loaded = number not in self._own

    def _decode_rows(self, texts: Iterable[str]) -> None:
        new = [text for text in texts if text not in self._rows]
        for text, values in zip(new, decode_values_from_json(new), strict=True):
            self._rows[text] = tuple(values)

    def _decode_states(self, numbers: Iterable[int]) -> None:
        found = self.store.list_states([number for number in numbers if number not in self._nodes])
        for (number, text), values in zip(found, decode_values_from_json([text for _, text in found]), strict=True):
            node = self._nodes[number] = CachedNode(tuple(values), number, self.era, text)
            self._nodes_by_text[text] = node

    def _load_verdicts(self, edges: dict[int, list[CachedEdge]]) -> None:
        assert self.number is not None
        known = self.store.list_clauses(self.number) if self.clauses else {}
        for clause in self.clauses:
            if clause.key in known:
                most = math.inf if clause.kind == "cost" else 1
                for source, position, value in self.store.list_verdicts(known[clause.key], edges):
                    if position < 0 or not 0 <= value <= most or math.isinf(value):
                        raise ValueError(f"a {clause.kind} is {value!r}")
                    edge = edges[source][position]
                    edge.verdicts = {**edge.verdicts, clause.name: value}

    # --- writing ---------------------------------------------------------------------------------------

    def write_nodes(self, nodes: Sequence[CachedNode], levels: int) -> None:
        """Writes what is new of nodes. Raises NotCacheable, and errors of apsw where the file cannot be written."""
        edges = list[tuple[CachedNode, int, str, CachedNode | None, str | None]]()
        for node in nodes:
            for position, edge in enumerate(node.edges or ()):
                row, target = encode_values_as_json(edge.row), edge.target
                elements = None if edge.elements is None else _encode_like_row(edge.elements, edge.row, row)
                if target is not None and target.text is None:
                    target.text = _encode_like_row(target.state, edge.row, row)
                edges.append((node, position, row, target, elements))
        targets = [target for *_, target, _ in edges if target is not None]
        with self.store.while_writing():
            number = self.store.find_graph(self.key)
            made = number is None
            if number is None:
                one = self.described
                described = (one.query, one.functions, one.parameters, one.variables, one.columns)
                number = self.store.make_graph(self.key, described)
            if self.number not in (None, number):  # somebody has dropped the graph, and perhaps begun it again
                self.era += 1
                self._nodes.clear()
                self._nodes_by_text.clear()
                self._own.clear()
            self._forget_dropped((*nodes, *targets))
            numbers = self._number_nodes(number, (*nodes, *targets))
            clauses = {one.name: self.store.number_clause(number, one.key, one.kind, one.text) for one in self.clauses}
            self.store.write_edges(
                (numbers[id(node)], position, row, None if target is None else numbers[id(target)], elements)
                for node, position, row, target, elements in edges
            )
            self.store.write_steps((len(node.edges), numbers[id(node)]) for node in nodes if node.edges is not None)
            self.store.write_clause_values(
                (clauses[name], numbers[id(node)], position, value)
                for node in nodes
                for position, edge in enumerate(node.edges or ())
                for name, value in edge.verdicts.items()
            )
            self.store.note_use(number, levels)
        self.made |= made
        self.number = number
        self._own.update(numbers[id(node)] for node in nodes if node.edges is not None)
        for node in (*nodes, *targets):
            node.number = numbers[id(node)]

    def _number_nodes(self, graph: int, nodes: Iterable[CachedNode]) -> dict[int, int]:
        """The numbers of nodes by their identities; those that have none get one."""
        numbers = {id(node): node.number for node in nodes if node.number is not None}
        new = {id(node): node.encode_state() for node in nodes if node.number is None}
        texts = list(dict.fromkeys(new.values()))
        found = self.store.make_nodes(graph, texts)
        if len(found) != len(texts):
            raise build_damage_error("a state that was written cannot be found")
        made = dict(zip(texts, found, strict=True))
        return numbers | {identity: made[text] for identity, text in new.items()}

    def _forget_dropped(self, nodes: Iterable[CachedNode]) -> None:
        """Forgets numbers that nodes had in a graph that was dropped: others may have them now."""
        for node in nodes:
            if node.era != self.era:
                node.number, node.era = None, self.era


def _encode_like_row(values: tuple[Any, ...], row: Row, text: str) -> str:
    """The elements of a step, or the state that it leads to, which often are its row."""
    return text if len(values) == len(row) and all(map(is_, values, row)) else encode_values_as_json(values)
