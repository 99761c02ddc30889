"""What a representation is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Any, Literal, TypeVar

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.cancellation import Check, iterate_with_check
from ss2sql.language.plan import FactColumn
from ss2sql.language.rows import make_unique_names


def make_label(value: Any) -> str:
    """The name that `to(expr, value)` gives a column."""
    return value if isinstance(value, str) else str(value)


F = TypeVar("F", bound=Callable[..., Any])
HIDDEN_COLUMNS_ATTRIBUTE = "__ss2sql_asks__"


def request_hidden_columns(wanted: Literal["elements", "calls"]) -> Callable[[F], F]:
    """Decorator of representations that ask for more than the columns: they find it in `Table.hidden`.

    "elements": the element of the first source, one for each row. "calls": the arguments of the calls in SELECT.
    Searches and groups with aggregates have rows that belong to no single element; of them nothing is hidden.
    """

    def note_columns(function: F) -> F:
        setattr(function, HIDDEN_COLUMNS_ATTRIBUTE, wanted)
        return function

    return note_columns


@dataclass(frozen=True, slots=True)
class Table:
    """Rows with names for their columns: `columns` a tuple of strings, `rows` a list of tuples.

    `hidden` are tuples, one for each row, of what a representation has requested; without any where there is nothing.
    `facts` says how the columns are calls, see `ss2sql.language.plan.FactColumn`; `labels` are the places of columns
    that each row names by what is hidden behind it. Who walks the table itself, not its `rows`, is ended where the run
    has to end, which is what `check` says.
    """

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]
    hidden: list[tuple[Any, ...]] = field(default_factory=list)
    facts: tuple[FactColumn, ...] = ()
    labels: tuple[int, ...] = ()
    check: Check | None = field(default=None, compare=False, repr=False)

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        return iter(iterate_with_check(self.rows, self.check))

    def __len__(self) -> int:
        return len(self.rows)

    def dicts(self) -> list[dict[str, Any]]:
        """The rows as dicts."""
        if not self.labels:
            return [dict(zip(self.columns, row, strict=True)) for row in self]
        return [dict(zip(self._choose_names(n), row, strict=True)) for row, n in zip(self, self.hidden, strict=True)]

    def _choose_names(self, labels: tuple[Any, ...]) -> tuple[str, ...]:
        names = dict(enumerate(self.columns)) | dict(zip(self.labels, map(make_label, labels), strict=True))
        return make_unique_names(names.values())
