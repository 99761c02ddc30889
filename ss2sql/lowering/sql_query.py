"""A lowered query: its text, the values to bind, the functions to have, and how the steps of a search are kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering.blob_encoding import BlobEncoding
from ss2sql.vtables.late_materialization import LateColumns
from ss2sql.vtables.snapshots import NO_SNAPSHOT, Snapshot

StepCounting: TypeAlias = Literal["steps", "product", "entered"]


@dataclass(frozen=True, slots=True)
class ElementCall:
    """A call of the user's `function` with each element of a list, whose value stands in the column `name`.

    `arguments` are columns of the list by name, `this` among them, and further arguments of the table by number.
    """

    name: str
    function: str
    arguments: tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class ListTable:
    """A virtual table that walks a list: the columns of its elements, after `this`, and then those of calls."""

    columns: tuple[str, ...]
    calls: tuple[ElementCall, ...] = ()

    @property
    def arguments(self) -> int:
        """The number of arguments beside the list."""
        numbers = [part for call in self.calls for part in call.arguments if isinstance(part, int)]
        return max(numbers, default=0)


@dataclass(frozen=True, slots=True)
class Bookkeeping:
    """How the steps of a search are kept and counted.

    `counts` says how it is known how many were generated: one by one, as the product of the sources for each step
    that went on, or as those that entered the queue and those that a guard kept out. `all_go_on` says that whatever
    enters goes on, `all_results` that it also comes out as a result. `compares_raw_rows` says that rows may be compared
    as they are until the interning has met values that have several forms, `keyed` that something else than rows is
    compared, `steps_unkept` that steps have numbers and are not kept. Of what goes on, `starts` are no steps. `sources`
    names the parameters that are walked as sources, `members` those that are walked as lists right of IN, which make no
    steps; the value of one may be that of the other. `arms` are the steps from a state that have a SELECT of their own;
    `parts` says of each column of a row how many values are a list, 0 where it is one value.
    """

    counts: StepCounting = "steps"
    all_go_on: bool = False
    all_results: bool = False
    compares_raw_rows: bool = False
    sources: tuple[str, ...] = ()
    members: frozenset[str] = frozenset()
    arms: int = 1
    parts: tuple[int, ...] = ()
    keyed: bool = False
    steps_unkept: bool = False
    starts: int = 0


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value that is bound as `:name`: the expression is evaluated once, before the statement runs.

    With `flag` set the value is a bool that travels as 0 or 1, with `blob_encoding` it is packed into a blob.
    """

    name: str
    expr: plan.Expr
    flag: bool = False
    blob_encoding: BlobEncoding | None = None

    def bound(self, value: Any) -> Any:
        """What is bound for a value of the expression."""
        return value if self.blob_encoding is None else self.blob_encoding.pack(value)


@dataclass(frozen=True, slots=True)
class OutputColumn:
    """One output column of a statement: whether a bool travels as 0 or 1 in it."""

    flag: bool


@dataclass(frozen=True, slots=True)
class SqlQuery:
    """A lowered query.

    The statement's columns are, in this order: for a search the step's and its parent's number; the
    `outputs`; `keys` group values; `orders` sort keys that SQL does not sort by itself. `sorted` and `limited`
    say what SQL has done of ORDER BY and LIMIT. `plain` are the parameters whose handles stand for all values
    that equal theirs, as long as no other form of such a value turns up. `plain_rows` says that the rows consist of
    numbers, strings and None, `plain_keys` that what a search compares does. `snapshot` is that of worlds, `late` what
    makes the rows where the statement gives keys of worlds alone. `applied` names the rewrites of lowering.
    `truths` are the functions whose calls are conditions as they are, as long as none gives a text or None;
    `told_apart` those whose equal arguments are the same ones.
    """

    query: plan.Query
    text: str
    parameters: tuple[Parameter, ...]
    outputs: tuple[OutputColumn, ...]
    keys: tuple[OutputColumn, ...]
    orders: tuple[OutputColumn, ...]
    sorted: bool
    limited: bool
    calls: Mapping[str, tuple[Span, ...]]
    modules: Mapping[str, ListTable]
    plain: frozenset[str] = frozenset()
    plain_rows: bool = False
    plain_keys: bool = False
    bookkeeping: Bookkeeping = Bookkeeping()
    snapshot: Snapshot = NO_SNAPSHOT
    late: LateColumns | None = None
    applied: tuple[str, ...] = ()
    only_iterated: frozenset[str] = frozenset()  # parameters whose value nobody asks for as a whole
    truths: frozenset[str] = frozenset()
    told_apart: frozenset[str] = frozenset()
