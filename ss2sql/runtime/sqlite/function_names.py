"""The names that functions of a session have in SQL."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ss2sql.language import plan
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.lowering.sql_names import SQLITE_FUNCTIONS
from ss2sql.runtime.sqlite.search_functions import FUNCTIONS as SEARCH_FUNCTIONS

# Names that the SQL made by lowering uses for itself; a user's function of such a name gets another one in SQL.
RESERVED_NAMES = SQLITE_FUNCTIONS | {
    *("collect", "collect_nothing", "collect_records", "collect_rows", "collect_set", "collect_value"),
    *(f"group_{name}" for name in GROUPS),
    *("list", "record", "field"),
    *("truth", "in_turn", "as_key", "recall", "remember", "elements", "search"),
    *("step_cost", "step_heuristic", "step_probability"),
    *("expand", "next_number", "next_position", *SEARCH_FUNCTIONS),
}

# The built-in functions and operators as the plan knows them.
BUILT_IN: Mapping[str, plan.Function] = {name: row.make_function() for name, row in OPERATIONS.items()}


def choose_function_names(functions: Mapping[str, Any]) -> dict[str, str]:
    """SQL names for registered functions: their own, but apart where SQL sees no difference or needs the name.

    The order of registration does not matter.
    """
    taken, names = (
        {word.lower() for word in RESERVED_NAMES} | {name.lower().replace(" ", "_") for name in OPERATIONS},
        {},
    )
    for name in sorted(functions, key=lambda word: (word.lower(), word)):
        candidate = stem = _shorten_sqlite_function(name)
        count = 1
        while candidate.lower() in taken and (name not in OPERATIONS or name in RESERVED_NAMES):
            count += 1
            candidate = f"{stem}_{count}"
        taken.add(candidate.lower())
        names[name] = candidate
    return names


def _shorten_sqlite_function(name: str) -> str:
    """A name that SQLite takes for a function, which has 255 bytes at most, with room for a number."""
    return name.encode()[:240].decode(errors="ignore")
