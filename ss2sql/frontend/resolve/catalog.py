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
    """All names that a script can refer to.

    `functions` holds the built-in and the registered ones, a registered one in place of a built-in of the
    same name. `variable_type` gives the type of a script variable's current value (it is called only for
    names in `variables`). `table` finds a table or view by schema (None: any) and name. `late` are variables
    bound to list literals that are resolved where they are used. With `open_names` an unknown name becomes a
    parameter, else it is an error. `worlds` are those attached, with the names of their tables; `world_functions`
    their columns and methods, which apply where an argument may be an element. `other_table` finds `name` or
    `schema.name` in the engine's own database and gives the variable that it is read as. `frames` are the variables
    that are data frames, `files` the names of attached SQLite files. `asked` says what representations need beside the
    columns: "elements" or "calls".
    """

    functions: Mapping[str, plan.Function]
    representations: Iterable[str] = ("dict", "list", "rows", "value", "set", "void")
    variables: Iterable[str] = ()
    variable_type: Callable[[str], Type] = lambda name: Type()
    table: Callable[[str | None, str], plan.TableSource | None] = lambda schema, name: None
    tables: Iterable[str] = ()
    other_table: Callable[[str], str | None] = lambda name: None
    late: Mapping[str, ast.ListLiteral] = field(default_factory=dict)
    open_names: bool = False
    worlds: Mapping[str, Any] = field(default_factory=dict)
    world_functions: Mapping[str, plan.Function] = field(default_factory=dict)
    frames: Collection[str] = ()
    files: Collection[str] = ()
    asked: Mapping[str, str] = field(default_factory=dict)
