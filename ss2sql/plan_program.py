"""Programs in the plan: the statements of a script, and what they rely on."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from ss2sql.errors import Span
from ss2sql.kinds import Type
from ss2sql.records import dataclass

if TYPE_CHECKING:
    from ss2sql import plan


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement with what its plan relies on.

    `reads` are the script variables and parameters that it reads, with the types that were assumed; `tables` those of
    the database. `tentative`: columns were unknown, so it is resolved again when the statements before it have run.
    """

    expr: plan.Expr
    reads: tuple[tuple[str, Type], ...] = ()
    tables: tuple[plan.TableSource | plan.WorldSource, ...] = ()
    tentative: bool = False
    span: Span = field(compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Program:
    """A resolved script. `parameters` are names that nobody knew: they need a value when the program runs."""

    statements: tuple[Statement, ...]
    parameters: tuple[str, ...] = ()
