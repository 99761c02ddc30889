"""The syntax tree: one frozen dataclass per construct, each with the span of its text.

Comparisons ignore spans, so two trees are equal when their scripts differ only in layout.
The tree is closed: code that walks it uses `match` and ends with `assert_never`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast


def _span() -> Any:
    return field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Literal:
    """None, True, False, an integer, a float or a string."""

    value: bool | int | float | str | None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Name:
    """A bare name: START WITH variable, column, script variable or, alone in SELECT, a function."""

    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class This:
    """`this`, or `source.this` with the source's name."""

    source: str | None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Attribute:
    """`source.column`, or `this.column` (source is None); in FROM also `world.table`."""

    source: str | None
    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class ListLiteral:
    items: tuple[Expr, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Call:
    """`name(arguments)`. An argument `name = expr` is an `Assign`; `count(*)` has `star` set, `world.f()` an owner.

    `count(DISTINCT x)` is `distinct`.
    """

    function: str
    arguments: tuple[Expr, ...]
    span: Span = _span()
    star: bool = False
    owner: str | None = None
    distinct: bool = False


@dataclass(frozen=True, slots=True)
class Index:
    """`value[i]`; `x[i, j]` is an Index of an Index."""

    value: Expr
    index: Expr
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Slice:
    """`value[lower:upper]`, either bound may be missing."""

    value: Expr
    lower: Expr | None
    upper: Expr | None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator by its function name: `add sub mul div mod pow neg lt le eq ne ge gt in not_in like`.

    `span` covers the whole expression, `place` the operator sign alone.
    """

    function: str
    operands: tuple[Expr, ...]
    span: Span = _span()
    place: Span = _span()


@dataclass(frozen=True, slots=True)
class Between:
    """`value BETWEEN low AND high`; `place` see Operator."""

    value: Expr
    low: Expr
    high: Expr
    span: Span = _span()
    place: Span = _span()


@dataclass(frozen=True, slots=True)
class And:
    """`a AND b AND ...`, flattened, at least two parts."""

    parts: tuple[Expr, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Or:
    """`a OR b OR ...`, flattened, at least two parts."""

    parts: tuple[Expr, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Xor:
    left: Expr
    right: Expr
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Not:
    operand: Expr
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class If:
    """`IF(condition; then, ...; otherwise, ...)`; an empty branch gives True, respectively False."""

    condition: Expr
    then: tuple[Expr, ...]
    otherwise: tuple[Expr, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Assign:
    """`name = expr`; its value is the value of the expression."""

    name: str
    value: Expr
    span: Span = _span()
    name_span: Span = _span()


@dataclass(frozen=True, slots=True)
class TemporalAssign:
    """`name{keep} = expr`: stores the value with the time and keeps `keep` seconds of history."""

    name: str
    keep: Expr
    value: Expr
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Temporal:
    """`name{}` (when is None), `name{-2.0}` or `name{22.2}`."""

    name: str
    when: Expr | None
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Star:
    """`SELECT *`."""

    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Named:
    """`expr AS name`, a column of SELECT."""

    expr: Expr
    name: str
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class From:
    """One source of FROM, `name = expr`; without a written name the name is None.

    After JOIN it has a condition `on`, which sees the sources up to it; after LEFT JOIN it is `optional`.
    """

    name: str | None
    expr: Expr
    span: Span = _span()
    on: Expr | None = None
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Each:
    """`EACH name IN values` in START WITH: the search starts once for each value."""

    name: str
    values: Expr
    span: Span = _span()
    name_span: Span = _span()


@dataclass(frozen=True, slots=True)
class Option:
    """An option of CONNECT BY.

    `keyword` is one of `DEPTH FIRST`, `BREADTH FIRST`, `COST`, `HEURISTIC`, `PROBABILITY`, `MEMORIZE`,
    `NO CYCLE`, `UNIQUE`, `MAXIMUM`, in upper case with one blank. `by` is the key after BY.
    """

    keyword: str
    argument: Expr | None
    by: tuple[Expr, ...] = ()
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class OrderKey:
    expr: Expr
    descending: bool
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Representation:
    """`AS name(arguments)`: positional arguments, then named ones."""

    name: str
    arguments: tuple[Expr, ...]
    named: tuple[Assign, ...]
    span: Span = _span()


@dataclass(frozen=True, slots=True)
class Query:
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
    span: Span = _span()

    @property
    def searches(self) -> bool:
        """Whether the query has CONNECT BY."""
        return bool(self.connect) or self.made is not None


Expr: TypeAlias = (
    Literal | Name | This | Attribute | ListLiteral | Call | Index | Slice | Operator | Between | And | Or | Xor | Not
    | If | Assign | TemporalAssign | Temporal | Query
)  # fmt: skip


def list_children(tree: Any) -> Iterator[Any]:
    """The nodes directly below a node."""
    for name in type(tree).__dataclass_fields__:
        value = getattr(tree, name)
        for item in value if isinstance(value, tuple) else (value,):
            if hasattr(type(item), "__dataclass_fields__") and not isinstance(item, Span):
                yield item


@dataclass(frozen=True, slots=True)
class Script:
    """The statements of a script in order, at least one."""

    statements: tuple[Expr, ...]
    span: Span = _span()


def collect_column_names(*trees: ast.Script | ast.Expr) -> frozenset[str] | None:
    """The names in trees that may be columns; None where any column may be read: by `*`, `this` or `eval`."""
    names: set[str] = set()
    waiting: list[Any] = list(trees)
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Star() | ast.This() | ast.Call(function="eval", owner=None):
                return None
            case ast.Name(name=name) | ast.Attribute(name=name):
                names.add(name)
        waiting.extend(ast.list_children(node))
    return frozenset(names)
