"""Whether the graph of a search is remembered, and how: what a session has for it."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.errors import Error, Stopped
from ss2sql.records import dataclass
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.messages import show
from ss2sql.runtime.remembered.graph import Clause, Described, GraphInFile
from ss2sql.runtime.remembered.keys import Keys, calls_functions, follows_state
from ss2sql.runtime.remembered.steps import Remembering, tell
from ss2sql.runtime.remembered.store import Store
from ss2sql.runtime.remembered.texts import NotKept, text_of

if TYPE_CHECKING:
    from ss2sql.runtime.functions import UserFunction
    from ss2sql.vtables.attached import AttachedWorld

MOST_TEXT = 500  # characters of a parameter as people see it


@dataclass(frozen=True, slots=True)
class GraphKeeper:
    """The tables of a session's file, its functions by the names that plans use, and its worlds."""

    store: Store
    entry_of: Callable[[str], UserFunction]
    worlds: Callable[[], list[AttachedWorld]]

    def remembering(self, hunt: Hunt) -> Remembering | None:
        """What gives a search the steps that are known; None where its graph is not remembered, which is told."""
        hunt.stats.graph = None
        try:
            if hunt.noted is None:
                raise NotKept("the search calls a function that is volatile, or assigns a variable")
            if hunt.noted.goals is not None and not calls(hunt.query):
                raise NotKept("the search goes from both ends, and calls no function")
            return self._remembering(hunt)
        except NotKept as reason:
            tell(hunt.stats, f"not remembered: {reason}")
        except Stopped:
            raise
        except Error as error:  # what cannot be read may be what the search does not read either
            tell(hunt.stats, f"not remembered: {error.message}")
        return None

    def _remembering(self, hunt: Hunt) -> Remembering:
        query, search = hunt.query, hunt.query.search
        assert search is not None
        assert hunt.noted is not None
        keys = Keys(query, hunt.run, self.entry_of, self.worlds)
        key = keys.graph()
        described = _described(query, keys)
        weight = "probability" if search.order == "probability" else "cost"
        asked = (
            ("stop", "condition", search.stop),
            ("goal", "condition", query.where),
            ("weight", weight, search.weight),
        )
        clauses = [
            Clause(name, keys.clause(kind, clause), kind, clause.span.text)
            for name, kind, clause in asked
            if clause is not None and calls_functions(clause) and not keys.is_known(clause)
        ]
        elements = hunt.noted.plain and any(follows_state(s, query) and calls_functions(s) for s in query.sources)
        graph = GraphInFile(self.store, key, described, clauses)
        return Remembering(hunt, graph, [clause.name for clause in clauses], elements, keys.changed)


def calls(query: plan.Query) -> bool:
    """Whether a search calls functions of the user in its steps."""
    search = query.search
    assert search is not None
    clauses = (*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect))
    return calls_functions(*query.sources, *clauses, query.where, search.stop, search.weight)


def _described(query: plan.Query, keys: Keys) -> Described:
    assert query.search is not None
    functions = [keys.entry_of(name).of_world or name for name in keys.functions]
    parameters = {name: _shown(value) for name, value in keys.parameters.items()}
    names = [output.name for output in query.columns]
    if query.aggregated:
        names = [expr.span.text for expr in query.rows]
    variables = [name for name, _ in query.search.start]
    return Described(query.span.text, *map(json.dumps, (functions, parameters, variables, names)))


def _shown(value: Any) -> Any:
    """A parameter as people see it: its value, or a short text of it."""
    try:
        return value if len(text_of((value,))) <= MOST_TEXT else show(value)
    except NotKept:
        return show(value)
