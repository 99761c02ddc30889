"""Whether the graph of a search is remembered, and how: what a session has for it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.value_messages import format_value
from ss2sql.runtime.graph_cache.cached_steps import CachedGraph, CachedSteps, add_note
from ss2sql.runtime.graph_cache.fingerprint import GraphFingerprint, do_call_functions, is_read_per_state
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable
from ss2sql.runtime.graph_cache.graph_store import GraphDescription, GraphStore
from ss2sql.runtime.graph_cache.value_json import encode_values_as_json
from ss2sql.runtime.search.search_run import SearchRun

if TYPE_CHECKING:
    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.vtables.attached_worlds import AttachedWorld

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
            if search_run.noted.goals is not None and not do_steps_call_user(search_run.query):
                raise NotCacheable("the search goes from both ends, and calls no function")
            return self._open_cached_graph(search_run)
        except NotCacheable as reason:
            add_note(search_run.stats, f"not remembered: {reason}")
        except Stopped:
            raise
        except Error as error:  # what cannot be read may be what the search does not read either
            add_note(search_run.stats, f"not remembered: {error.message}")
        return None

    def _open_cached_graph(self, search_run: SearchRun) -> CachedSteps:
        query, search = search_run.query, search_run.query.search
        assert search is not None
        assert search_run.noted is not None
        keys = GraphFingerprint(query, search_run.run, self.get_function, self.worlds)
        key = keys.make_graph_key()
        described = _describe_graph(query, keys)
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
        graph = CachedGraph(self.store, key, described, clauses, elements, keys.find_changed_function)
        return CachedSteps(search_run, graph)


def do_steps_call_user(query: plan.Query) -> bool:
    """Whether a search calls functions of the user in its steps."""
    search = query.search
    assert search is not None
    clauses = (*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect))
    return do_call_functions(*query.sources, *clauses, query.where, search.stop, search.weight)


def _describe_graph(query: plan.Query, keys: GraphFingerprint) -> GraphDescription:
    assert query.search is not None
    functions = [keys.get_function(name).of_world or name for name in keys.functions]
    parameters = {name: _format_parameter(value) for name, value in keys.parameters.items()}
    names = [output.name for output in query.columns]
    if query.aggregated:
        names = [expr.span.text for expr in query.rows]
    variables = [name for name, _ in query.search.start]
    return GraphDescription(query.span.text, *map(json.dumps, (functions, parameters, variables, names)))


def _format_parameter(value: Any) -> Any:
    """A parameter as people see it: its value, or a short text of it."""
    try:
        return value if len(encode_values_as_json((value,))) <= MAX_TEXT_LENGTH else format_value(value)
    except NotCacheable:
        return format_value(value)
