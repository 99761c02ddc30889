"""The plan: a script with every name resolved, the form between the frontend and the executors.

The plan is independent of lark and of SQLite. Statements and queries are expressions. A source has a number that is
unique in the program, a START WITH variable the number of its query, so executors need no scopes. An expression has
a `Type`, a promise about its values, and the span of its text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any, Literal, NamedTuple, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import ANY, BOOL, Type


@dataclass(frozen=True, slots=True)
class Node:
    """A part of the plan, with its place in the script."""

    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class TableSource(Node):
    """A table or view of the database. `order` names what sorts it: `rowid`, primary key columns, or nothing (a view).

    `collated`: columns that SQLite would not compare byte by byte. `indexes`: (columns, index), "" for the primary key.
    `texts_for_numbers`: columns of texts whose declared type makes SQLite read texts beside them as numbers. `kept_by`:
    the index that holds the rows of a table WITHOUT ROWID, where it has them in this order.
    """

    id: int
    name: str
    schema: str
    table: str
    columns: tuple[tuple[str, Type], ...]
    order: tuple[str, ...]
    collated: tuple[str, ...] = ()
    texts_for_numbers: tuple[str, ...] = ()
    indexes: tuple[tuple[tuple[str, ...], str], ...] = ()
    indexed: bool = False  # SQLite may find its rows in another order
    kept_by: str = ""


@dataclass(frozen=True, slots=True)
class ValueSource(Node):
    """The elements of a value, which may mention earlier sources, the search's state and outer queries.

    `columns` is None where they are known only at run time. `lateral`: as written it reads an earlier source or the
    state, so it is evaluated again for each; rewrites may have removed the dependency since. `hides`: what is said of a
    table that the name in FROM does not mean, because a column has it, too.
    """

    id: int
    name: str
    value: Expr
    element: Type
    columns: tuple[tuple[str, Type], ...] | None
    lateral: bool = False
    hides: str = ""


@dataclass(frozen=True, slots=True)
class QuerySource(Node):
    """A query in FROM: its elements are those of the query's value. `lateral` see ValueSource.

    Where it is `optional` and the query has none, there is one element, None, and so is every column.
    """

    id: int
    name: str
    query: Query
    element: Type
    columns: tuple[tuple[str, Type], ...] | None
    lateral: bool = False
    optional: bool = False


@dataclass(frozen=True, slots=True)
class WorldSource(Node):
    """A table of an attached world; the `arguments` of a table function may mention earlier sources and the state.

    `table` is the session's, see vtables/attached_worlds.py.
    """

    id: int
    name: str
    table: Any
    arguments: tuple[Expr, ...]
    element: Type
    columns: tuple[tuple[str, Type], ...]


Source: TypeAlias = TableSource | ValueSource | QuerySource | WorldSource
SOURCES = (TableSource, ValueSource, QuerySource, WorldSource)


# --- the plan: a script with every name resolved, the form between the frontend and the executors
@dataclass(frozen=True, slots=True)
class Statement(Node):
    """One statement with what its plan relies on.

    `reads` are the script variables and parameters that it reads, with the types that were assumed; `tables` those of
    the database. `tentative`: columns were unknown, so it is resolved again after the statements before it have run.
    """

    expr: Expr
    reads: tuple[tuple[str, Type], ...] = ()
    tables: tuple[TableSource | WorldSource, ...] = ()
    tentative: bool = False


@dataclass(frozen=True, slots=True)
class Program:
    """A resolved script. `parameters` are its unknown names: they need a value when the program runs.

    `mentions` are the places where these stand first, and the names that are known there.
    """

    statements: tuple[Statement, ...]
    parameters: tuple[str, ...] = ()
    mentions: Mapping[str, tuple[Span, tuple[str, ...]]] = field(default_factory=dict, compare=False, repr=False)


Volatility: TypeAlias = Literal["immutable", "stable", "volatile"]


@dataclass(frozen=True, slots=True)
class Function:
    """What the plan knows of a function; the callable stays in the session."""

    name: str
    minimum: int
    maximum: int | None
    volatility: Volatility
    builtin: bool = True
    raises: bool = True  # False only if the call cannot fail
    reason: str = field(default="", compare=False)  # explains the volatility
    parameters: tuple[str, ...] = field(default=(), compare=False)
    body: Any = field(default=None, compare=False, repr=False)  # see frontend/inlining.py
    vectorized: bool = field(default=False, compare=False)  # takes arrays
    of_world: str = field(default="", compare=False)  # its name in scripts, if a world brings it
    has_inverse: bool = field(default=False, compare=False)  # was registered with an inverse
    inverse_of: str = ""  # the function whose inverse this is
    collects: bool = False  # with GROUP BY it gets the list of a group's values
    indexed: frozenset[int] = field(default=frozenset(), compare=False)  # the places of lists of which it reads items

    def make_inverse(self) -> Function:
        """The inverse: from the value of the function and the other arguments it computes the missing one."""
        return replace(self, name=f"inverse of {self.name}", has_inverse=False, inverse_of=self.name, body=None)


class FactColumn(NamedTuple):
    """A column of SELECT as a fact. It has no expressions inside, so walks over the plan skip it.

    An empty `name` means the column's own, `places` are the arguments' positions among the hidden columns, and
    `has_value` says whether the column's value is the last argument.
    """

    name: str
    places: tuple[int, ...]
    has_value: bool = True


# --- expressions ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Constant(Node):
    """A value known from the text: None, bool, int, float, str, or a list of such values.

    Constants compare by value and type: [1, 2.0] and [1.0, 2] differ.
    """

    value: Any
    type: Type

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Constant):
            return NotImplemented
        return self.type == other.type and repr(self.value) == repr(other.value)

    def __hash__(self) -> int:
        return hash(repr(self.value))


@dataclass(frozen=True, slots=True)
class Variable(Node):
    """A script variable or parameter, read when the expression is evaluated; in FROM a `frame` stays a data frame."""

    name: str
    type: Type = ANY
    frame: bool = False


@dataclass(frozen=True, slots=True)
class Temporal(Node):
    """`name{}` (when is None: all kept values) or `name{when}`; `times` asks for the times of these values."""

    name: str
    when: Expr | None
    type: Type = ANY
    times: bool = False


@dataclass(frozen=True, slots=True)
class Element(Node):
    """`this` of a source: the current element, of a table the row as a dict."""

    source: int
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class Column(Node):
    """A column of the current element; `declared` is False where columns are known only at run time."""

    source: int
    name: str
    type: Type = ANY
    declared: bool = True


@dataclass(frozen=True, slots=True)
class State(Node):
    """A START WITH variable of the query with this number, as it was before CONNECT BY of this step."""

    query: int
    name: str
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A call of a function or operator; errors point at its `place`: the call, or the operator's sign."""

    function: Function
    arguments: tuple[Expr, ...]
    type: Type = ANY
    place: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class And(Node):
    """Evaluates its parts from left to right until one is false; gives a bool."""

    parts: tuple[Expr, ...]
    type: Type = BOOL


@dataclass(frozen=True, slots=True)
class Or(Node):
    """Evaluates its parts from left to right until one is true; gives a bool."""

    parts: tuple[Expr, ...]
    type: Type = BOOL


@dataclass(frozen=True, slots=True)
class Xor(Node):
    left: Expr
    right: Expr
    type: Type = BOOL


@dataclass(frozen=True, slots=True)
class Not(Node):
    operand: Expr
    type: Type = BOOL


@dataclass(frozen=True, slots=True)
class If(Node):
    """One of two non-empty branches runs left to right; its last value is the result."""

    condition: Expr
    then: tuple[Expr, ...]
    otherwise: tuple[Expr, ...]
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class MakeList(Node):
    items: tuple[Expr, ...]
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """Assigns a script variable; its value is the assigned one."""

    name: str
    value: Expr
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class TemporalAssign(Node):
    """Stores the value with the time, and keeps what was in force during the last `keep` seconds."""

    name: str
    keep: Expr
    value: Expr
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class AssignLate(Node):
    """Binds a variable to a list literal, a syntax tree, that is resolved where the variable is used as a source."""

    name: str
    literal: Any
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class Eval(Node):
    """`eval(text)`: the string is parsed and resolved when it runs, in the scope of this place.

    `scope` belongs to the resolver; `sources` and `states` are all that are visible here, for the script in the string.
    """

    text: Expr
    scope: Any = field(compare=False, repr=False)
    sources: tuple[int, ...]
    states: tuple[tuple[int, str], ...]
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class GroupKey(Node):
    """The value of GROUP BY expression number `index` of a query, in a clause that sees groups."""

    query: int
    index: int
    type: Type = ANY


@dataclass(frozen=True, slots=True)
class Aggregate(Node):
    """`count count_distinct sum min max average` over the rows of a group; `count(*)` has no argument.

    The group `may_be_empty` where there is no GROUP BY.
    """

    function: str
    argument: Expr | None
    type: Type = ANY
    may_be_empty: bool = False


@dataclass(frozen=True, slots=True)
class Subquery(Node):
    """A query as an expression: its value is what its representation makes of its rows."""

    query: Query
    type: Type = ANY


# --- queries -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Output:
    """One column of SELECT; a computed `label` replaces its `name`, `star` lets SELECT * take the element apart."""

    name: str
    expr: Expr
    label: Expr | None = None
    star: bool = False


@dataclass(frozen=True, slots=True)
class OrderKey:
    """A key of ORDER BY; `column` is the number of the column of SELECT that it names, which is computed once."""

    expr: Expr
    descending: bool
    column: int | None = None


@dataclass(frozen=True, slots=True)
class Representation:
    """`AS name(arguments)`; the arguments may mention script variables and outer queries only.

    The last `hidden` columns of the query are for the representation alone, see frontend/resolve/query_clauses.py.
    `facts` names each other column as a fact, with the hidden columns that are its arguments. `labels` are the
    positions of columns whose name is the value of a hidden column, one for each row.
    """

    name: str
    arguments: tuple[Expr, ...] = ()
    named: tuple[tuple[str, Expr], ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    hidden: int = 0
    facts: tuple[FactColumn, ...] = ()
    labels: tuple[int, ...] = ()


Order: TypeAlias = Literal["depth first", "breadth first", "cost", "probability", "greedy"]
Repeats: TypeAlias = Literal["allowed", "no cycle", "unique", "memorize"]
By: TypeAlias = Literal["row", "step", "state"]


@dataclass(frozen=True, slots=True)
class Search:
    """The hierarchical part of a query. `weight`, `key` and `siblings` are evaluated for each step."""

    start: tuple[tuple[str, Expr], ...]  # START WITH: variables and their values
    connect: tuple[tuple[str, Expr], ...]  # CONNECT BY: variables and their values after a step
    stop: Expr | None  # None: never
    order: Order = "depth first"  # of the frontier
    repeats: Repeats = "allowed"  # what happens to a repeated row
    weight: Expr | None = None  # COST or PROBABILITY
    heuristic: Expr | None = None
    bound: Expr | None = None  # MEMORIZE's greatest length, evaluated once, before the search
    maximum: Expr | None = None  # the number of results, likewise
    states: tuple[tuple[str, Type], ...] = ()  # the types that the START WITH variables keep
    made: Expr | None = None  # the condition of CONNECT BY that a step must meet
    first: Expr | None = None  # the same of START WITH, in its place for first steps
    each: tuple[ValueSource, ...] = ()  # lists whose elements START WITH takes one by one
    key: tuple[Expr, ...] = ()  # compared in place of the row: the expressions of BY, or the row's columns that remain
    by: By = "row"  # where `key` is evaluated: in the row, in the step, or in the state after it
    siblings: tuple[OrderKey, ...] = ()  # the order of the steps from one state

    @property
    def plain(self) -> bool:
        """Whether START WITH and CONNECT BY consist of options and assignments alone, and whole rows are compared."""
        return not (self.made or self.first or self.each or self.key or self.siblings or self.order == "greedy")


@dataclass(frozen=True, slots=True)
class Query(Node):
    """A query.

    Without GROUP BY: the product of `sources` (the last varies fastest), filtered by `where`, gives one row
    of `columns` each, sorted by `order`, cut to `limit` after the first `offset`. With `search` the results are
    paths, see Search; `where` is then the goal (None: every step that does not stop), and `group`, `order` and
    `limit` act on paths and see their last step.

    With `group` and `aggregated`: one row per group; `columns`, `having` and `order` contain GroupKey and
    Aggregate and no Element or Column of this query outside an Aggregate. With `aggregated` alone all rows are one
    group, even if there are none. With `group` alone: a dict from group value to the partition; `columns` and `order`
    see elements, `having` groups. `rows` are the compared rows of a search with `aggregated` columns. In a `distinct`
    search the first of equal paths counts, before `order` and `limit`; a flat query is then one of groups. In a search
    with `last` a result is the row of the last step.
    """

    id: int
    sources: tuple[Source, ...]
    columns: tuple[Output, ...]
    where: Expr | None = None
    search: Search | None = None
    group: tuple[Expr, ...] = ()
    having: Expr | None = None
    aggregated: bool = False
    order: tuple[OrderKey, ...] = ()
    limit: Expr | None = None
    offset: Expr | None = None
    representation: Representation = Representation("dict")
    rows: tuple[Expr, ...] = ()
    distinct: bool = False
    last: bool = False

    @property
    def grouped(self) -> bool:
        """Whether its results are groups, or parts of them."""
        return bool(self.group) or self.aggregated

    @property
    def gives_paths(self) -> bool:
        """Whether the results are paths instead of rows."""
        return self.search is not None and not self.aggregated and not self.last


Expr: TypeAlias = (
    Constant | Variable | Temporal | Element | Column | State | Call | And | Or | Xor | Not | If | MakeList | Assign
    | TemporalAssign | AssignLate | Eval | GroupKey | Aggregate | Subquery
)  # fmt: skip
