"""Which graph a search works on: what its steps depend on, as text that is the same wherever the query stands.

A graph is told from others by FROM, SELECT, the names in START WITH, and CONNECT BY, with the functions that they
call and the values that they read. Where a search starts, when it stops and what it looks for makes no other graph.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, fields, is_dataclass
from hashlib import sha256
from marshal import dumps
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Type
from ss2sql.language.plan_traversal import can_vary_with, list_parts, list_plan_functions
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable, fingerprint_function
from ss2sql.vtables.contract import Element, World
from ss2sql.vtables.frames import Frame
from ss2sql.vtables.reading import replace_world_elements

if TYPE_CHECKING:
    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.runtime.run.run_state import Run
    from ss2sql.vtables.attached_worlds import AttachedWorld


MAX_ROWS = 200_000  # of a table or a data frame: reading and comparing them takes 0.2 s


def fingerprint_data(value: Any, what: str) -> str:
    """The digest of a value, called `what` where it is refused with NotCacheable."""
    if isinstance(value, Frame):
        _check_fingerprint_rows(value.length, what)
        value = value.make_value()
    try:
        return sha256(dumps(value, 2)).hexdigest()
    except ValueError:  # there are elements of worlds in it, which marshal does not know
        pass
    try:
        return sha256(repr(replace_world_elements(value)).encode("utf-8", "surrogatepass")).hexdigest()
    except NotImplementedError as reason:
        raise NotCacheable(f"{what} cannot be compared: {reason}") from None


def find_fingerprint_worlds(value: Any) -> set[World]:
    """The worlds whose elements are in a value."""
    if isinstance(value, Element):
        return {value.world}
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return set().union(*map(find_fingerprint_worlds, parts))


def digest_table(source: plan.TableSource, run: Run) -> str:
    """The digest of the rows of a table of the database, or of an attached file."""
    what = f"the table '{source.table}'"
    if source.table.startswith("ss2sql_"):
        raise NotCacheable(f"{what} belongs to ss2sql and changes with every run")
    rows = run.host.read_table_rows(source)
    _check_fingerprint_rows(len(rows), what)
    return fingerprint_data(list(map(list, rows)), what)


def digest_world(world: World) -> str:
    try:
        found = world.fingerprint()
    except Error:
        raise
    except Exception as error:  # whatever an adapter raises
        raise NotCacheable(f"{type(world).__name__} cannot be compared: {error}") from error
    kind = type(world)
    try:
        made = fingerprint_function(kind)
    except NotCacheable as reason:
        raise NotCacheable(f"{kind.__name__}, the class of a world, {reason}") from None
    return sha256(repr((made, found)).encode()).hexdigest()


def _check_fingerprint_rows(rows: int, what: str) -> None:
    if rows > MAX_ROWS:
        raise NotCacheable(f"{what} has {rows:,} rows, more than the {MAX_ROWS:,} that are compared")


FORMAT = 1  # another one makes other graphs of everything
# What does not matter to the value of a node: where it stands, what is promised of it, and names for people.
_LEFT_OUT = frozenset({"id", "span", "place", "type", "element", "scope", "states", "declared"})


@dataclass(slots=True)
class GraphFingerprint:
    """The keys of one search and its clauses. `get_function` gives functions by the names that plans use.

    `functions` and `parameters` are what the graph depends on, for people.
    """

    query: plan.Query
    run: Run
    get_function: Callable[[str], UserFunction]
    worlds: Callable[[], list[AttachedWorld]]
    functions: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, Any] = field(default_factory=dict)
    _sources: dict[int, int] = field(default_factory=dict)
    _queries: dict[int, int] = field(default_factory=dict)
    _worlds: dict[World, str] = field(default_factory=dict)
    _own: dict[str, str] = field(default_factory=dict)  # the fingerprints of functions that belong to no world

    def make_graph_key(self) -> str:
        """The key of the graph. Raises NotCacheable where it would have none, with the reason."""
        search = self.query.search
        assert search is not None
        self._queries[self.query.id] = 0
        outputs = self.query.rows if self.query.aggregated else tuple(output.expr for output in self.query.columns)
        names = tuple(name for name, _ in search.start)
        parts = (
            FORMAT,
            self._describe_node(self.query.sources),
            self._describe_node(outputs),
            names,
            self._describe_node(search.connect),
        )
        return _hash_parts(parts)

    def find_changed_function(self) -> str | None:
        """The name of a function that has changed since its key was made: one that changes what it reads."""
        for name, known in self._own.items():
            try:
                if fingerprint_function(self.get_function(name).function) != known:
                    return name
            except NotCacheable:
                return name
        return None

    def make_clause_key(self, kind: str, clause: plan.Expr) -> str:
        """The key of a clause that is evaluated for the steps of the graph. Raises NotCacheable."""
        sources, queries = dict(self._sources), dict(self._queries)
        try:
            return _hash_parts((kind, self._describe_node(clause)))
        finally:  # queries inside of one clause are none of the next one's
            self._sources, self._queries = sources, queries

    def is_known(self, clause: plan.Expr) -> bool:
        """Whether a clause calls nothing but what CONNECT BY calls: then the next state, which is kept, answers it."""
        search = self.query.search
        assert search is not None
        connect = [expr for _, expr in search.connect]
        if len(connect) != 1 or not isinstance(connect[0], plan.Call) or connect[0].function.builtin:
            return False
        known = self._describe_node(connect[0])
        nodes: list[Any] = [clause]
        while nodes:
            node = nodes.pop()
            if isinstance(node, plan.Subquery) and do_call_functions(node):
                return False
            if not isinstance(node, plan.Call) or node.function.builtin:
                nodes.extend(list_parts(node))
            elif self._describe_node(node) != known:
                return False
        return True

    # --- plans as data ---------------------------------------------------------------------------------

    def _describe_node(self, node: Any) -> Any:
        """A part of a plan as tuples, texts and numbers."""
        match node:
            case tuple():
                return tuple(map(self._describe_node, node))
            case plan.Constant(value=value):
                return "constant", repr(value)
            case plan.Variable(name=name):
                return "variable", self._describe_variable(name)
            case plan.Element(source=source):
                return "element", self._number_source(source)
            case plan.Column(source=source, name=name):
                return "column", self._number_source(source), name
            case plan.State(query=query, name=name):
                return "state", self._number_query(query), name
            case plan.GroupKey(query=query, index=index):
                return "group", self._number_query(query), index
            case plan.Function():
                return self._describe_function(node)
            case plan.TableSource() | plan.WorldSource() | plan.ValueSource() | plan.QuerySource():
                form = self._describe_source(node)
                self._sources[node.id] = len(self._sources)
                return form
            case plan.Query(id=number):
                self._queries[number] = len(self._queries)
            case plan.Eval() | plan.Assign() | plan.Temporal() | plan.TemporalAssign() | plan.AssignLate():
                raise NotCacheable(f"it evaluates {' '.join(node.span.text.split())[:40]}, which may change")
            case Type():
                return ()
        if is_dataclass(node) and not isinstance(node, type):
            names = (one.name for one in fields(node) if one.name not in _LEFT_OUT)
            return type(node).__name__, tuple((name, self._describe_node(getattr(node, name))) for name in names)
        return repr(node)

    def _describe_source(self, source: plan.Source) -> Any:
        match source:
            case plan.TableSource(columns=columns):
                return "table", digest_table(source, self.run), tuple(name for name, _ in columns)
            case plan.WorldSource(table=table, arguments=arguments):
                return "world", self._digest_world(table.world), table.schema.title, self._describe_node(arguments)
            case plan.ValueSource(value=value):
                return "value", self._describe_node(value)
            case plan.QuerySource(query=query):
                return "query", self._describe_node(query)

    def _number_source(self, number: int) -> int:
        if number not in self._sources:
            raise NotCacheable("it reads the row of a query around it")
        return self._sources[number]

    def _number_query(self, number: int) -> int:
        if number not in self._queries:
            raise NotCacheable("it reads the row of a query around it")
        return self._queries[number]

    # --- what plans depend on --------------------------------------------------------------------------

    def _describe_variable(self, name: str) -> str:
        value = self.run.get_source(name)
        digest = fingerprint_data(value, f"the variable '{name}'")
        self.parameters[name] = value
        return _hash_parts((digest, *sorted(map(self._digest_world, find_fingerprint_worlds(value)))))

    def _describe_function(self, function: plan.Function) -> Any:
        if function.builtin:
            if function.volatility != "immutable":
                raise NotCacheable(f"it calls {function.name}, which is {function.volatility}")
            return "built in", function.name
        if function.name not in self.functions:
            self.functions[function.name] = self._fingerprint_function(function)
        return "function", self.functions[function.name]

    def _fingerprint_function(self, function: plan.Function) -> str:
        if function.of_world:
            name = function.of_world
            owners = [attached.world for attached in self.worlds() if name in attached.names]
            return _hash_parts((name, *map(self._digest_world, owners)))
        if function.volatility != "immutable":
            hint = ", although it takes arrays" if function.vectorized else ""
            raise NotCacheable(f"'{function.name}' is {function.volatility}, not immutable{hint}")
        try:
            found = self._own[function.name] = fingerprint_function(self.get_function(function.name).function)
        except NotCacheable as reason:
            raise NotCacheable(f"'{function.name}' {reason}") from None
        return found

    def _digest_world(self, world: World) -> str:
        if world not in self._worlds:
            self._worlds[world] = digest_world(world)
        return self._worlds[world]


def do_call_functions(*nodes: plan.Expr | plan.Source | None) -> bool:
    """Whether functions of the user are called somewhere in these."""
    return any(not function.builtin for node in nodes if node is not None for function in list_plan_functions(node))


def is_read_per_state(source: plan.Source, query: plan.Query) -> bool:
    """Whether a source is read again for each state, or for each element of a source before it."""
    return can_vary_with(source, {one.id for one in query.sources if one is not source}, query.id)


def _hash_parts(parts: Any) -> str:
    return sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()
