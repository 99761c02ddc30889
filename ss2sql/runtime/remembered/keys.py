"""Which graph a search works on: what its steps depend on, as text that is the same wherever the query stands.

A graph is told from others by FROM, SELECT, the names in START WITH, and CONNECT BY, with the functions that they
call and the values that they read. Where a search starts, when it stops and what it looks for makes no other graph.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, fields, is_dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.kinds import Type
from ss2sql.records import dataclass
from ss2sql.runtime.remembered.functions import fingerprint
from ss2sql.runtime.remembered.sources import digest_of, table_digest, world_digest, worlds_in
from ss2sql.runtime.remembered.texts import NotKept
from ss2sql.vtables.base import World
from ss2sql.walk import functions, moves, parts

if TYPE_CHECKING:
    from ss2sql.runtime.functions import UserFunction
    from ss2sql.runtime.run import Run
    from ss2sql.vtables.attached import AttachedWorld

FORMAT = 1  # another one makes other graphs of everything
# What does not matter to the value of a node: where it stands, what is promised of it, and names for people.
_LEFT_OUT = frozenset({"id", "span", "place", "type", "element", "scope", "states", "declared"})


@dataclass(slots=True)
class Keys:
    """The keys of one search and its clauses. `entry_of` gives functions by the names that plans use.

    `functions` and `parameters` are what the graph depends on, for people.
    """

    query: plan.Query
    run: Run
    entry_of: Callable[[str], UserFunction]
    worlds: Callable[[], list[AttachedWorld]]
    functions: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, Any] = field(default_factory=dict)
    _sources: dict[int, int] = field(default_factory=dict)
    _queries: dict[int, int] = field(default_factory=dict)
    _worlds: dict[World, str] = field(default_factory=dict)
    _own: dict[str, str] = field(default_factory=dict)  # the fingerprints of functions that belong to no world

    def graph(self) -> str:
        """The key of the graph. Raises NotKept where it would have none, with the reason."""
        search = self.query.search
        assert search is not None
        self._queries[self.query.id] = 0
        outputs = self.query.rows if self.query.aggregated else tuple(output.expr for output in self.query.columns)
        names = tuple(name for name, _ in search.start)
        parts = (FORMAT, self._form(self.query.sources), self._form(outputs), names, self._form(search.connect))
        return _hashed(parts)

    def changed(self) -> str | None:
        """The name of a function that has changed since its key was made: one that changes what it reads."""
        for name, known in self._own.items():
            try:
                if fingerprint(self.entry_of(name).function) != known:
                    return name
            except NotKept:
                return name
        return None

    def clause(self, kind: str, clause: plan.Expr) -> str:
        """The key of a clause that is asked of the steps of the graph. Raises NotKept."""
        sources, queries = dict(self._sources), dict(self._queries)
        try:
            return _hashed((kind, self._form(clause)))
        finally:  # queries inside of one clause are none of the next one's
            self._sources, self._queries = sources, queries

    def is_known(self, clause: plan.Expr) -> bool:
        """Whether a clause calls nothing but what CONNECT BY calls: then the next state, which is kept, answers it."""
        search = self.query.search
        assert search is not None
        connect = [expr for _, expr in search.connect]
        if len(connect) != 1 or not isinstance(connect[0], plan.Call) or connect[0].function.builtin:
            return False
        known = self._form(connect[0])
        nodes: list[Any] = [clause]
        while nodes:
            node = nodes.pop()
            if isinstance(node, plan.Subquery) and calls_functions(node):
                return False
            if not isinstance(node, plan.Call) or node.function.builtin:
                nodes.extend(parts(node))
            elif self._form(node) != known:
                return False
        return True

    # --- plans as data ---------------------------------------------------------------------------------

    def _form(self, node: Any) -> Any:
        """A part of a plan as tuples, texts and numbers."""
        match node:
            case tuple():
                return tuple(map(self._form, node))
            case plan.Constant(value=value):
                return "constant", repr(value)
            case plan.Variable(name=name):
                return "variable", self._variable(name)
            case plan.Element(source=source):
                return "element", self._source(source)
            case plan.Column(source=source, name=name):
                return "column", self._source(source), name
            case plan.State(query=query, name=name):
                return "state", self._query(query), name
            case plan.GroupKey(query=query, index=index):
                return "group", self._query(query), index
            case plan.Function():
                return self._function(node)
            case plan.TableSource() | plan.WorldSource() | plan.ValueSource() | plan.QuerySource():
                form = self._source_form(node)
                self._sources[node.id] = len(self._sources)
                return form
            case plan.Query(id=number):
                self._queries[number] = len(self._queries)
            case plan.Eval() | plan.Assign() | plan.Temporal() | plan.TemporalAssign() | plan.AssignLate():
                raise NotKept(f"it evaluates {' '.join(node.span.text.split())[:40]}, which may change")
            case Type():
                return ()
        if is_dataclass(node) and not isinstance(node, type):
            names = (one.name for one in fields(node) if one.name not in _LEFT_OUT)
            return type(node).__name__, tuple((name, self._form(getattr(node, name))) for name in names)
        return repr(node)

    def _source_form(self, source: plan.Source) -> Any:
        match source:
            case plan.TableSource(columns=columns):
                return "table", table_digest(source, self.run), tuple(name for name, _ in columns)
            case plan.WorldSource(table=table, arguments=arguments):
                return "world", self._world(table.world), table.schema.title, self._form(arguments)
            case plan.ValueSource(value=value):
                return "value", self._form(value)
            case plan.QuerySource(query=query):
                return "query", self._form(query)

    def _source(self, number: int) -> int:
        if number not in self._sources:
            raise NotKept("it reads the row of a query around it")
        return self._sources[number]

    def _query(self, number: int) -> int:
        if number not in self._queries:
            raise NotKept("it reads the row of a query around it")
        return self._queries[number]

    # --- what plans depend on --------------------------------------------------------------------------

    def _variable(self, name: str) -> str:
        value = self.run.source(name)
        digest = digest_of(value, f"the variable '{name}'")
        self.parameters[name] = value
        return _hashed((digest, *sorted(map(self._world, worlds_in(value)))))

    def _function(self, function: plan.Function) -> Any:
        if function.builtin:
            if function.volatility != "immutable":
                raise NotKept(f"it calls {function.name}, which is {function.volatility}")
            return "built in", function.name
        if function.name not in self.functions:
            self.functions[function.name] = self._fingerprint(function)
        return "function", self.functions[function.name]

    def _fingerprint(self, function: plan.Function) -> str:
        if function.of_world:
            name = function.of_world
            owners = [attached.world for attached in self.worlds() if name in attached.offered()]
            return _hashed((name, *map(self._world, owners)))
        if function.volatility != "immutable":
            hint = ", although it takes arrays" if function.vectorized else ""
            raise NotKept(f"'{function.name}' is {function.volatility}, not immutable{hint}")
        try:
            found = self._own[function.name] = fingerprint(self.entry_of(function.name).function)
        except NotKept as reason:
            raise NotKept(f"'{function.name}' {reason}") from None
        return found

    def _world(self, world: World) -> str:
        if world not in self._worlds:
            self._worlds[world] = world_digest(world)
        return self._worlds[world]


def calls_functions(*nodes: plan.Expr | plan.Source | None) -> bool:
    """Whether functions of the user are called somewhere in these."""
    return any(not function.builtin for node in nodes if node is not None for function in functions(node))


def follows_state(source: plan.Source, query: plan.Query) -> bool:
    """Whether a source is read again for each state, or for each element of a source before it."""
    return moves(source, {one.id for one in query.sources if one is not source}, query.id)


def _hashed(parts: Any) -> str:
    return sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()
