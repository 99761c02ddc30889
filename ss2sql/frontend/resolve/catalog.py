"""The catalog: functions, variables with their types, tables and representations that scripts can name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import field
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import Type


@dataclass(slots=True)
class Catalog:
    """All names that a script can refer to."""

    functions: Mapping[str, plan.Function]  # built-in and registered ones
    representations: Iterable[str] = ("dict", "list", "rows", "value", "set", "void")
    variables: Iterable[str] = ()
    variable_type: Callable[[str], Type] = lambda name: Type()  # the type of the present value of one of `variables`
    table: Callable[[str | None, str], plan.TableSource | None] = lambda schema, name: None
    tables: Iterable[str] = ()
    other_table: Callable[[str], str | None] = lambda name: None  # of the engine's database -> its variable
    late: Mapping[str, ast.ListLiteral] = field(default_factory=dict)  # resolved where they are used
    open_names: bool = False  # unknown names become parameters
    worlds: Mapping[str, Any] = field(default_factory=dict)  # name -> the attached world
    world_functions: Mapping[str, plan.Function] = field(default_factory=dict)  # for arguments that may be elements
    frames: Collection[str] = ()  # variables that are data frames
    files: Collection[str] = ()  # names of attached SQLite files
    hidden_columns: Mapping[str, str] = field(default_factory=dict)  # representation -> "elements" or "calls"
