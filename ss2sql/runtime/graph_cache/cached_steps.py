"""What is remembered of a search with MEMORIZE: of each state its steps, and the calls of functions that they needed.

A level is looked up before its states are expanded: calls that are known are not made again. What was found out is
written ten times a second, and in the end: of each state all steps or none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from marshal import dumps
from time import perf_counter
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.errors import Error, ExecutionError, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.conversion import format_value
from ss2sql.language.values import State, copy_for_python, thaw_value
from ss2sql.runtime.graph_cache.fingerprint import GraphIdentity, identify_graph, list_step_variables
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable
from ss2sql.runtime.graph_cache.graph_store import (
    Calls,
    GraphStore,
    add_calls,
    build_damaged_graph_error,
    decode_calls,
    encode_calls,
    encode_values_as_json,
)
from ss2sql.runtime.run.run_state import Run, Stats, pause_collector
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_contract import Notes, Pair
from ss2sql.runtime.sqlite.connections import READ_ERRORS
from ss2sql.vtables.reading import replace_world_elements

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
    """A state and its text; `steps` are None until they are known. `loaded`: another search has found them out."""

    values: State
    text: str
    steps: str | None = None
    calls: str = "{}"
    length: int = 0
    loaded: bool = False


class CachedSteps(Notes):
    """The steps of one search, and the calls of its functions while it lasts. A context: what is new is written in its
    end, too, whatever ends it.
    """

    def __init__(self, search_run: SearchRun, store: GraphStore, identity: GraphIdentity) -> None:
        assert search_run.noted is not None
        super().__init__(search_run.noted)
        self.search_run, self.store, self.identity = search_run, store, identity
        self.described = _describe_graph(search_run.query, search_run.run, identity)
        self.off = False
        self._outer: CachedSteps | None = None  # of the search around this one
        self._known: Calls = {}
        self._made: Calls = {}  # since the last state was done
        self._number: int | None = None  # of the graph
        self._states: list[CachedState] = []  # of this level
        self._unwritten: dict[str, CachedState] = {}
        self._own: set[str] = set()  # states that this search has written
        self._begun = self._complete = 0  # levels
        self._written = perf_counter()
        self._unkept = ""  # why what is new is not remembered

    # --- calls -----------------------------------------------------------------------------------------

    def make_call(self, function: UserFunction, real: Callable[[Any], Any], arguments: Iterable[Any]) -> Any:
        """What a call gives, which is made where that is not known."""
        arguments = tuple(arguments)
        name, text = self._describe_call(function, arguments)
        known = self._known.get(name)
        if known is not None and text in known:
            return known[text]
        value = real(map(copy_for_python, arguments) if function.changes else arguments)
        self._note_value(name, text, value)
        return value

    def note_call(self, function: UserFunction, arguments: tuple[Any, ...], value: Any) -> None:
        """Takes note of a call that another process has made."""
        self._note_value(*self._describe_call(function, arguments), value)

    def _note_value(self, name: str, text: str, value: Any) -> None:
        if name:
            self._made.setdefault(name, {})[text] = value

    def _describe_call(self, function: UserFunction, arguments: tuple[Any, ...]) -> tuple[str, str]:
        """The function with its hash, and its arguments as Python writes them; none for a call with other objects."""
        name = self.identity.functions.get(function.name, "")
        try:
            dumps(arguments, 2)
        except ValueError:
            try:
                return (name, repr(replace_world_elements(arguments))) if function.of_world else ("", "")
            except NotImplementedError:
                return "", ""
        return name, repr(arguments)

    # --- levels ----------------------------------------------------------------------------------------

    def __enter__(self) -> CachedSteps:
        run = self.search_run.run
        self._outer, run.cached_steps = run.cached_steps, self
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.search_run.run.cached_steps = self._outer
        if kind is None:
            self._finish_state()
            self._complete = self._begun
        try:
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

    def _load_states(self, states: Sequence[State]) -> list[CachedState]:
        texts = list(map(encode_values_as_json, states))
        held = dict(self._unwritten)
        self._number = self.store.find_graph(self.identity.key) if self._number is None else self._number
        new = [text for text in dict.fromkeys(texts) if text not in held]
        known = {} if self._number is None else self.store.read_states(self._number, new)
        for _, calls in known.values():
            add_calls(self._known, decode_calls(calls))
        for text, state in zip(texts, states, strict=True):
            if text not in held:
                loaded = text in known and text not in self._own
                steps, calls = known.get(text, (None, "{}"))
                held[text] = CachedState(tuple(map(thaw_value, state)), text, steps, calls, loaded=loaded)
        return list(map(held.__getitem__, texts))

    def _write_states(self) -> None:
        """Writes what is new, in one transaction; where somebody else is in the way that has to wait."""
        self._written = perf_counter()
        store = self.store
        if self.off or not (store.writable and (self._unwritten or self._number)):
            return
        with self._while_using_store():
            new = [(text, one.length, one.steps or "[]", one.calls) for text, one in self._unwritten.items()]
            if new or store.is_use_unnoted(self._number):
                self._number = store.write_states(self.identity.key, self.described, new, self._complete)
            self._own.update(self._unwritten)
            self._unwritten.clear()

    @contextmanager
    def _while_using_store(self) -> Iterator[None]:
        """Notes why nothing is kept. Raises ExecutionError X009 where the tables are damaged."""
        try:
            yield
        except NotCacheable as reason:
            self.off = True
            self._unwritten.clear()
            add_graph_note(self.search_run.stats, f"not remembered: {reason}")
        except _TEMPORARY_ERRORS as error:
            self._unkept = str(error)
        except (*READ_ERRORS, ValueError) as error:
            raise build_damaged_graph_error(str(error)) from error

    # --- steps -----------------------------------------------------------------------------------------

    def get_known_pairs(self) -> list[Pair] | None:
        self._finish_state()
        return super().get_known_pairs()

    def _finish_state(self) -> None:
        """Takes from the notes of the state before what was found out; all of its steps were evaluated."""
        if self.off or self.at < 0 or not self._states:
            return
        state, pairs, made = self._states[self.at], self.pairs[self.at] or [], self._made
        self.pairs[self.at], self._made = None, {}
        if state.loaded:
            self.search_run.stats.remembered_steps += len(pairs)
        if state.loaded and not made:
            return  # its steps stay as they were written with its calls: JSON of them takes a fifth of the time
        with self._while_using_store():
            rows = [(self.noted.row(note), self.noted.after(note, state.values)) for note, _ in pairs]
            steps = encode_values_as_json(tuple(rows))
            if made:
                calls = decode_calls(state.calls)
                add_calls(calls, made)
                state.calls = encode_calls(calls)
            if made or steps != state.steps:
                state.steps, state.length = steps, len(pairs)
                if self.store.writable:
                    self._unwritten[state.text] = state
                else:
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
        """What gives a search the calls that are known; None where its graph is not remembered, which is told.

        There is nothing to tell of a search that calls no function.
        """
        search_run.stats.graph = None
        try:
            if search_run.noted is None:
                raise NotCacheable("the search calls a function that is volatile, or assigns a variable")
            identity = identify_graph(search_run.query, self.get_function, self.worlds)
            return CachedSteps(search_run, self.store, identity) if identity.functions else None
        except NotCacheable as reason:
            add_graph_note(search_run.stats, f"not remembered: {reason}")
        except Stopped:
            raise
        except Error as error:  # what cannot be read may be what the search does not read either
            add_graph_note(search_run.stats, f"not remembered: {error.message}")
        return None


def _describe_graph(query: plan.Query, run: Run, identity: GraphIdentity) -> tuple[str, ...]:
    """What people are told of a graph, see TABLES."""
    assert query.search is not None
    functions = [identity.functions[name].partition(" ")[0] for name in identity.steps]
    parameters = {name: _format_graph_parameter(run.get_source(name)) for name in list_step_variables(query)}
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
