"""The steps of a search with MEMORIZE, as far as they are known, and notes of those that had to be evaluated.

A level is looked up before its states are expanded. What was found out is written ten times a second, and in the end:
of each state all steps or none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.errors import Error, ExecutionError, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import format_value
from ss2sql.language.values import FREEZERS, UNSET, State, thaw_value
from ss2sql.runtime.graph_cache.fingerprint import GraphFingerprint, do_call_functions, is_read_per_state
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable
from ss2sql.runtime.graph_cache.graph_store import (
    CachedStep,
    GraphStore,
    build_damaged_graph_error,
    decode_steps,
    encode_steps,
    encode_values_as_json,
)
from ss2sql.runtime.run.run_state import Stats, pause_collector
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_contract import Note, Notes, Pair
from ss2sql.runtime.sqlite.connections import READ_ERRORS

if TYPE_CHECKING:
    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.vtables.attached_worlds import AttachedWorld


PART = 0.1  # seconds after which what is new is written, which takes as long at most: a run can be stopped meanwhile

_TEMPORARY_ERRORS = (
    apsw.BusyError,
    apsw.LockedError,
    apsw.FullError,
    apsw.ReadOnlyError,
    apsw.IOError,
    apsw.CantOpenError,
)


def add_graph_note(stats: Stats, text: str) -> None:
    """Tells the user what becomes of the graph."""
    note = f"graph: {text}"
    if note not in stats.notes:
        stats.notes.append(note)


@dataclass(slots=True)
class CachedState:
    """A state and its text. `steps` are None until they are known; `loaded`: another search has found them out."""

    values: State
    text: str
    steps: list[CachedStep] | None = None
    loaded: bool = False


class CachedSteps(Notes):
    """The steps of one search. A context: what is new is written in its end, too, whatever ends it."""

    def __init__(
        self,
        search_run: SearchRun,
        store: GraphStore,
        key: str,
        keys: GraphFingerprint,
        clauses: dict[str, str],
        elements: bool,
    ) -> None:
        """`clauses` are the keys of those whose values are kept, by their names in notes, as are `elements` if so."""
        assert search_run.noted is not None
        super().__init__(search_run.noted)
        self.search_run, self.store, self.keys = search_run, store, keys
        self.key, self.described = key, _describe_graph(search_run.query, keys)
        self.elements = elements
        rows, frozen, shapes, states, *_ = self.noted.places
        self._clauses = [(key, self.noted.places.clauses[name]) for name, key in clauses.items()]
        self._columns = list(zip(rows, frozen, map(FREEZERS.__getitem__, shapes), strict=True))
        self._places = [(place, at) for at, place in enumerate(states) if place is not None and place not in rows]
        self._widths = len(rows), len(states), self.noted.sources
        self.off = False
        self._number: int | None = None  # of the graph
        self._states: list[CachedState] = []  # of this level
        self._unwritten: dict[str, CachedState] = {}
        self._own: set[str] = set()  # states that this search has written
        self._begun = self._complete = 0  # levels
        self._written = perf_counter()
        self._unkept = ""  # why what is new is not remembered

    # --- levels ----------------------------------------------------------------------------------------

    def __enter__(self) -> CachedSteps:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._finish_state()
            self._complete = self._begun
        try:
            changed = self.keys.find_changed_function() if self._unwritten or self._own else None
            if changed is not None:  # nobody would find the graph again
                self.store.drop_graph(self._number)
                self._number = None
                self._stop_caching(NotCacheable(f"'{changed}' changes what it reads"))
            self._write_states()
        except ExecutionError:
            if kind is None:
                raise
        self.search_run.stats.graph = self._number
        if self._unkept and not self.off and (self._unwritten or not self.store.writable):
            add_graph_note(self.search_run.stats, f"what is new is not remembered: {self._unkept}")

    def begin_level(self, states: Sequence[State], chosen: Sequence[list[Any]] | None = None) -> None:
        """Looks up what is known of the states of a level, and writes what the level before has found out."""
        self._finish_state()
        super().begin_level(states, chosen)
        if self.off:
            return
        self._complete = self._begun
        self._begun += 1
        self._states = []
        with self._while_using_store(), pause_collector():
            self._states = self._load_states(states)
        if self.elements:
            self.pairs[: len(self._states)] = map(self._load_pairs, self._states)

    def _load_states(self, states: Sequence[State]) -> list[CachedState]:
        texts = list(map(encode_values_as_json, states))
        held = dict(self._unwritten)
        self._number = self.store.find_graph(self.key) if self._number is None else self._number
        new = [text for text in dict.fromkeys(texts) if text not in held]
        known = {} if self._number is None else self.store.read_states(self._number, new)
        steps = dict(zip(known, decode_steps(list(known.values()), self._widths), strict=True))
        for text, state in zip(texts, states, strict=True):
            if text not in held:
                loaded = text in steps and text not in self._own
                held[text] = CachedState(tuple(map(thaw_value, state)), text, steps.get(text), loaded)
        return list(map(held.__getitem__, texts))

    def _write_states(self) -> None:
        """Writes what is new, in one transaction; where somebody else is in the way that has to wait."""
        self._written = perf_counter()
        store = self.store
        if self.off or not (store.writable and (self._unwritten or self._number)):
            return
        with self._while_using_store():
            new = [(text, len(o.steps or ()), encode_steps(o.steps or ())) for text, o in self._unwritten.items()]
            if new or store.is_use_unnoted(self._number):
                self._number = store.write_states(self.key, self.described, new, self._complete)
            self._own.update(self._unwritten)
            self._unwritten.clear()

    @contextmanager
    def _while_using_store(self) -> Iterator[None]:
        """Notes why nothing is kept. Raises ExecutionError X009 where the tables are damaged."""
        try:
            yield
        except NotCacheable as reason:
            self._stop_caching(reason)
        except _TEMPORARY_ERRORS as error:
            self._unkept = str(error)
        except (*READ_ERRORS, ValueError) as error:
            raise build_damaged_graph_error(str(error)) from error

    def _stop_caching(self, reason: NotCacheable) -> None:
        self.off = True
        self._unwritten.clear()
        add_graph_note(self.search_run.stats, f"not remembered: {reason}")

    # --- steps -----------------------------------------------------------------------------------------

    def get_known_pairs(self) -> list[Pair] | None:
        self._finish_state()
        self.at += 1
        return self.pairs[self.at]

    def pair_elements(self, at: int, items: list[Any]) -> list[Pair]:
        steps = self._states[at].steps if self._states else None
        if steps is None:
            return super().pair_elements(at, items)
        if len(items) != len(steps):
            raise build_damaged_graph_error(
                "a state has other steps now; is a function declared immutable that is not?"
            )
        return list(zip(map(self._make_note, steps), items, strict=True))

    def _load_pairs(self, state: CachedState) -> list[Pair] | None:
        """The pairs of a state whose elements are kept."""
        if state.steps is None:
            return None
        pairs = list[Pair]()
        for step in state.steps:
            if step.elements is None:
                return None
            pairs.append((self._make_note(step), step.elements if self.noted.sources > 1 else step.elements[0]))
        return pairs

    def _make_note(self, step: CachedStep) -> Note:
        note = self.noted.make_blank_note()
        for value, (place, frozen, freeze) in zip(step.row, self._columns, strict=True):
            note[place] = value
            if frozen is not None:
                note[frozen] = freeze(value)
        if step.after is not None:
            for place, at in self._places:
                note[place] = step.after[at]
        for key, place in self._clauses:
            note[place] = step.verdicts.get(key, UNSET)
        return note

    def _finish_state(self) -> None:
        """Takes from the notes of the state before what was found out; all of its steps were evaluated."""
        if self.off or self.at < 0 or not self._states:
            return
        state, pairs = self._states[self.at], self.pairs[self.at] or []
        new = state.steps is None
        if state.steps is None:
            elements_of = self.noted.read_elements if self.elements else lambda item: None
            state.steps = [CachedStep(self.noted.row(note), None, elements_of(item), {}) for note, item in pairs]
        elif state.loaded:
            self.search_run.stats.remembered_steps += len(pairs)
        for (note, _), step in zip(pairs, state.steps, strict=True):
            if step.after is None:
                step.after = self.noted.after(note, state.values)
                new = new or step.after is not None
            for key, place in self._clauses:
                if note[place] is not UNSET and key not in step.verdicts:
                    step.verdicts[key] = note[place]
                    new = True
        self.pairs[self.at] = None
        if new and self.store.writable:
            self._unwritten[state.text] = state
        elif new:
            self._unkept = "the session is read only"
        if self._unwritten and perf_counter() - self._written >= PART:
            self._write_states()


# --- whether the graph of a search is remembered, and how: what a session has for it
MAX_TEXT_LENGTH = 500  # characters of a parameter as people see it


@dataclass(frozen=True, slots=True)
class CachePolicy:
    """The tables of a session's file, its functions by the names that plans use, and its worlds."""

    store: GraphStore
    get_function: Callable[[str], UserFunction]
    worlds: Callable[[], list[AttachedWorld]]

    def open_cached_graph(self, search_run: SearchRun) -> CachedSteps | None:
        """What gives a search the steps that are known; None where its graph is not remembered, which is told."""
        search_run.stats.graph = None
        try:
            if search_run.noted is None:
                raise NotCacheable("the search calls a function that is volatile, or assigns a variable")
            if search_run.noted.goal is not None and not do_steps_call_user(search_run.query):
                raise NotCacheable("the search goes from both ends, and calls no function")
            return self._open_cached_graph(search_run)
        except NotCacheable as reason:
            add_graph_note(search_run.stats, f"not remembered: {reason}")
        except Stopped:
            raise
        except Error as error:  # what cannot be read may be what the search does not read either
            add_graph_note(search_run.stats, f"not remembered: {error.message}")
        return None

    def _open_cached_graph(self, search_run: SearchRun) -> CachedSteps:
        query, search = search_run.query, search_run.query.search
        assert search is not None
        assert search_run.noted is not None
        keys = GraphFingerprint(query, search_run.run, self.get_function, self.worlds)
        key = keys.make_graph_key()
        weight = "probability" if search.order == "probability" else "cost"
        parts = (
            ("stop", "condition", search.stop),
            ("goal", "condition", query.where),
            ("weight", weight, search.weight),
        )
        clauses = {
            name: f"{kind} {keys.make_clause_key(kind, clause)[:16]}"
            for name, kind, clause in parts
            if clause is not None and do_call_functions(clause) and not keys.is_known(clause)
        }
        elements = search_run.noted.plain and any(
            is_read_per_state(s, query) and do_call_functions(s) for s in query.sources
        )
        return CachedSteps(search_run, self.store, key, keys, clauses, elements)


def do_steps_call_user(query: plan.Query) -> bool:
    """Whether a search calls functions of the user in its steps."""
    search = query.search
    assert search is not None
    clauses = (*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect))
    return do_call_functions(*query.sources, *clauses, query.where, search.stop, search.weight)


def _describe_graph(query: plan.Query, keys: GraphFingerprint) -> tuple[str, ...]:
    """What people are told of a graph, see TABLES."""
    assert query.search is not None
    functions = [keys.get_function(name).of_world or name for name in keys.functions]
    parameters = {name: _format_graph_parameter(value) for name, value in keys.parameters.items()}
    names = [output.name for output in query.columns]
    if query.aggregated:
        names = [expr.span.text for expr in query.rows]
    variables = [name for name, _ in query.search.start]
    return query.span.text, *map(json.dumps, (functions, parameters, variables, names))


def _format_graph_parameter(value: Any) -> Any:
    """A parameter as people see it: its value, or a short text of it."""
    try:
        return value if len(encode_values_as_json((value,))) <= MAX_TEXT_LENGTH else format_value(value)
    except NotCacheable:
        return format_value(value)
