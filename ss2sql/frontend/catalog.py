"""What exists when a script is resolved: functions, variables with their types, tables, representations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from ss2sql import plan
from ss2sql.frontend import ast
from ss2sql.kinds import Type


@dataclass(slots=True)
class Catalog:
    """The world that a script is resolved in.

    `functions` holds the built-in and the registered ones, a registered one in place of a built-in of the
    same name. `variable_type` gives the type of a script variable's current value (it is asked only for
    names in `variables`). `table` finds a table or view by schema (None: any) and name. `late` are variables
    bound to list literals that are resolved where they are used. With `open_names` an unknown name becomes a
    parameter, without it is an error.
    """

    functions: Mapping[str, plan.Function]
    representations: Iterable[str] = ("dict", "list", "rows", "value", "set", "void")
    variables: Iterable[str] = ()
    variable_type: Callable[[str], Type] = lambda name: Type()
    table: Callable[[str | None, str], plan.TableSource | None] = lambda schema, name: None
    tables: Iterable[str] = ()
    late: Mapping[str, ast.ListLiteral] = field(default_factory=dict)
    open_names: bool = False
