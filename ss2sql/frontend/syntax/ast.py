"""The syntax tree: one frozen dataclass per construct, each with the span of its text.

Comparisons ignore spans, so two trees are equal when their scripts differ only in layout.
The tree is closed: code that walks it uses `match` and ends with `assert_never`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass


def _span() -> Any:
    return field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Node:
    """A part of the tree, with the place of its text."""

    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Literal(Node):
    """None, True, False, an integer, a float or a string."""

    value: bool | int | float | str | None


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A bare name: START WITH variable, column, script variable or, alone in SELECT, a function."""

    name: str


@dataclass(frozen=True, slots=True)
class This(Node):
    """`this`, or `source.this` with the source's name."""

    source: str | None


@dataclass(frozen=True, slots=True)
class Attribute(Node):
    """`source.column`, or `this.column` (source is None); in FROM also `world.table`."""

    source: str | None
    name: str


@dataclass(frozen=True, slots=True)
class ListLiteral(Node):
    items: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Call(Node):
    """`name(arguments)`. An argument `name = expr` is an `Assign`; `count(*)` has `star` set, `world.f()` an owner.

    `count(DISTINCT x)` is `distinct`.
    """

    function: str
    arguments: tuple[Expr, ...]
    star: bool = False
    owner: str | None = None
    distinct: bool = False


@dataclass(frozen=True, slots=True)
class Index(Node):
    """`value[i]`; `x[i, j]` is an Index of an Index."""

    value: Expr
    index: Expr


@dataclass(frozen=True, slots=True)
class Slice(Node):
    """`value[lower:upper]`, either bound may be missing."""

    value: Expr
    lower: Expr | None
    upper: Expr | None


@dataclass(frozen=True, slots=True)
class Operator(Node):
    """An operator by its function name: `add sub mul div mod pow neg lt le eq ne ge gt in not_in like`.

    `span` covers the whole expression, `place` the operator sign alone.
    """

    function: str
    operands: tuple[Expr, ...]
    place: Span = _span()


@dataclass(frozen=True, slots=True)
class Between(Node):
    """`value BETWEEN low AND high`; `place` see Operator."""

    value: Expr
    low: Expr
    high: Expr
    place: Span = _span()


@dataclass(frozen=True, slots=True)
class And(Node):
    """`a AND b AND ...`, flattened, at least two parts."""

    parts: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Or(Node):
    """`a OR b OR ...`, flattened, at least two parts."""

    parts: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Xor(Node):
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Not(Node):
    operand: Expr


@dataclass(frozen=True, slots=True)
class If(Node):
    """`IF(condition; then, ...; otherwise, ...)`; an empty branch gives True, respectively False."""

    condition: Expr
    then: tuple[Expr, ...]
    otherwise: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """`name = expr`; its value is the value of the expression."""

    name: str
    value: Expr
    name_span: Span = _span()


@dataclass(frozen=True, slots=True)
class TemporalAssign(Node):
    """`name{keep} = expr`: stores the value with the time and keeps `keep` seconds of history."""

    name: str
    keep: Expr
    value: Expr


@dataclass(frozen=True, slots=True)
class Temporal(Node):
    """`name{}` (when is None), `name{-2.0}` or `name{22.2}`."""

    name: str
    when: Expr | None


@dataclass(frozen=True, slots=True)
class Star(Node):
    """`SELECT *`."""


@dataclass(frozen=True, slots=True)
class Named(Node):
    """`expr AS name`, a column of SELECT."""

    expr: Expr
    name: str


@dataclass(frozen=True, slots=True)
class From(Node):
    """One source of FROM, `name = expr`; without a written name the name is None.

    After JOIN it has a condition `on`, which sees the sources up to it; after LEFT JOIN it is `optional`.
    """

    name: str | None
    expr: Expr
    on: Expr | None = None
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Each(Node):
    """`EACH name IN values` in START WITH: the search starts once for each value."""

    name: str
    values: Expr
    name_span: Span = _span()


@dataclass(frozen=True, slots=True)
class Option(Node):
    """An option of CONNECT BY.

    `keyword` is one of `DEPTH FIRST`, `BREADTH FIRST`, `COST`, `HEURISTIC`, `PROBABILITY`, `MEMORIZE`,
    `NO CYCLE`, `UNIQUE`, `MAXIMUM`, in upper case with one blank. `by` is the key after BY.
    """

    keyword: str
    argument: Expr | None
    by: tuple[Expr, ...] = ()


@dataclass(frozen=True, slots=True)
class OrderKey(Node):
    expr: Expr
    descending: bool


@dataclass(frozen=True, slots=True)
class Representation(Node):
    """`AS name(arguments)`: positional arguments, then named ones."""

    name: str
    arguments: tuple[Expr, ...]
    named: tuple[Assign, ...]


@dataclass(frozen=True, slots=True)
class Query(Node):
    """A query; clauses that are not written are None or empty tuples.

    `first` is the condition of START WITH, `made` that of CONNECT BY, `siblings` are the keys of ORDER SIBLINGS BY.
    """

    columns: tuple[Expr | Named | Star, ...]
    sources: tuple[From, ...]
    where: Expr | None = None
    start: tuple[Assign | Each, ...] = ()
    first: Expr | None = None
    options: tuple[Option, ...] = ()
    connect: tuple[Assign, ...] = ()
    made: Expr | None = None
    stop: Expr | None = None
    group: tuple[Expr, ...] = ()
    having: Expr | None = None
    siblings: tuple[OrderKey, ...] = ()
    order: tuple[OrderKey, ...] = ()
    limit: Expr | None = None
    offset: Expr | None = None
    distinct: bool = False
    representation: Representation | None = None
    last: bool = False

    @property
    def searches(self) -> bool:
        """Whether the query has CONNECT BY."""
        return bool(self.connect) or self.made is not None


Expr: TypeAlias = (
    Literal | Name | This | Attribute | ListLiteral | Call | Index | Slice | Operator | Between | And | Or | Xor | Not
    | If | Assign | TemporalAssign | Temporal | Query
)  # fmt: skip


def list_syntax_children(tree: Any) -> Iterator[Any]:
    """The nodes directly below a node."""
    for name in type(tree).__dataclass_fields__:
        value = getattr(tree, name)
        for item in value if isinstance(value, tuple) else (value,):
            if hasattr(type(item), "__dataclass_fields__") and not isinstance(item, Span):
                yield item


def walk_syntax(tree: Any, closed: Callable[[Any], bool] = lambda part: False) -> Iterator[Any]:
    """A node and all nodes below it, parents first, but for those that are `closed` and what they hold."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(reversed([part for part in list_syntax_children(node) if not closed(part)]))


@dataclass(frozen=True, slots=True)
class Script(Node):
    """The statements of a script in order, at least one."""

    statements: tuple[Expr, ...]


def collect_syntax_columns(*trees: Script | Expr) -> frozenset[str] | None:
    """The names in trees that may be columns; None where any column may be read: by `*`, `this` or `eval`."""
    names: set[str] = set()
    for node in (node for tree in trees for node in walk_syntax(tree)):
        match node:
            case Star() | This() | Call(function="eval", owner=None):
                return None
            case Name(name=name) | Attribute(name=name):
                names.add(name)
    return frozenset(names)


def is_row_count_syntax(columns: tuple[Expr | Named | Star, ...]) -> bool:
    """Whether SELECT without GROUP BY has `count(*)` or `count(DISTINCT x)`, outside of inner queries."""
    own = (column for column in columns if not isinstance(column, Query))
    parts = (part for column in own for part in walk_syntax(column, lambda part: isinstance(part, Query)))
    return any(
        isinstance(part, Call) and part.function == "count" and part.owner is None and (part.star or part.distinct)
        for part in parts
    )
